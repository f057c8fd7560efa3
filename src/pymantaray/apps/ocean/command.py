"""
Commands of `mantaray ocean`: check, show, plot and make oceans. They import modules when they run.
`fetch` is a separate group.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pymantaray.apps.ocean import fetch_command
from pymantaray.cli.groups import existing, quantities, quantity, with_options
from pymantaray.cli.options import (
    OUTPUT,
    Commands,
    FigureFormats,
    Force,
    GridOptions,
    Json,
    Quiet,
    RepairFreezing,
    Set,
    To,
    WaterOptions,
    changes_of,
    format_names,
    metres_of,
    parse_duration,
)
from pymantaray.cli.output import check_output, progress_bars
from pymantaray.cli.printing import Printer, in_options, printer
from pymantaray.errors import MantaRayError, OceanError
from pymantaray.ocean.names import CurrentsPolicy, Equation
from pymantaray.plotting.formats import FIGURE_FORMATS

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from pymantaray.acoustics.profiles import Profile
    from pymantaray.config.door.ocean import MissionOcean
    from pymantaray.ocean.check import Findings
    from pymantaray.ocean.schema import Finding

EXIT_WRONG = 2
_M_PER_KM = 1e3
_S_PER_DAY = 86_400.0
# first words of lines in a history
_MAKING = ("cast ", "corrected with ", "sound speed perturbed ", "replaced by ")

app = Commands(help="Fetch, make, check, show and plot oceans.")

Files = Annotated[
    list[str],
    typer.Argument(
        callback=existing(),
        metavar="OCEAN",
        help="Files that belong together, a profile or cast, synthetic:beaufort or synthetic:fram,"
        " a preset, or a TOML file.",
    ),
]
Ocean = Annotated[
    str,
    typer.Argument(
        callback=existing(),
        metavar="OCEAN",
        help="As in mantaray ocean show. An ocean of several files: a TOML file with source in its"
        " section ocean.",
    ),
]
CastFile = Annotated[
    Path,
    typer.Argument(
        callback=existing(),
        metavar="CAST",
        help="A table, an instrument's file, Argo profiles or CF profiles.",
    ),
]
CastFiles = Annotated[
    list[Path],
    typer.Argument(
        callback=existing(),
        metavar="CASTS",
        help="Tables, instruments' files, Argo profiles or CF profiles.",
    ),
]
NewOcean = Annotated[Path, typer.Argument(metavar="OUT.nc", help="The ocean to write.")]


@dataclass(frozen=True)
class CastOptions:
    """Choice of a cast from a file, and what the file lacks."""

    lat: Annotated[
        float | None,
        typer.Option(
            parser=quantity("deg"),
            metavar="DEGREES",
            help="Latitude of a cast whose file has none.",
        ),
    ] = None
    lon: Annotated[
        float | None,
        typer.Option(
            parser=quantity("deg"),
            metavar="DEGREES",
            help="Longitude of a cast whose file has none.",
        ),
    ] = None
    time: Annotated[
        str | None, typer.Option(metavar="TIME", help="Instant (UTC), such as 2014-07-24T19:20.")
    ] = None
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the cast, if the file contains several."),
    ] = None
    repair_freezing: RepairFreezing = False


@app.command()
@with_options
def check(
    water: WaterOptions,
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="OCEAN",
            help="As in mantaray ocean show. Default with --study: the ocean of the study.",
        ),
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Preset or TOML file; the ocean must cover its domain and fleet.",
        ),
    ] = None,
    changes: Set = None,
    as_json: Json = False,
) -> None:
    """List the errors (exit 2) and doubts (exit 0) about an ocean."""
    from pymantaray.ocean.check import Findings

    if study is None and not files:
        raise OceanError("no ocean; name one, or give a study with --study")
    note = ""
    if study is None:
        own, _, note = _at_one_instant(_configured(files or [], water, currents="rest"))
        findings = _checked(own)
        if findings.ok and water.own_keys:
            findings = Findings([*_refusals(files or [], water), *findings])
    else:
        from pymantaray.apps.study.mission import fleet_findings
        from pymantaray.config import load_study
        from pymantaray.config.door.fleet import with_tracks
        from pymantaray.config.door.study import build_study
        from pymantaray.config.load import dotted_keys

        # these files replace the study's ocean, as in `study run --ocean`
        config = load_study(
            study, ocean=files or None, **dotted_keys(water.keys), **changes_of(changes)
        )
        mission = build_study(with_tracks(config))
        own = mission.ocean
        moved = mission.fleet.existing is not None
        findings = _checked(mission.ocean, fleet=mission.planned, existing_trajectories=moved)
        if findings.ok and not moved:
            findings = Findings([*fleet_findings(mission), *findings])
    with printer(as_json=as_json) as out:
        out.notes(own.notes() if findings.ok else ())
        if note:
            out.line(note)
        for finding in findings:
            out.line(str(finding))
        out.line(
            f"{len(findings.wrong)} wrong, {len(findings.doubtful)} doubtful",
            findings=[asdict(finding) for finding in findings],
            wrong=len(findings.wrong),
            doubtful=len(findings.doubtful),
        )
    if not findings.ok:
        raise typer.Exit(EXIT_WRONG)


def _configured(
    words: list[str], options: GridOptions, *, currents: CurrentsPolicy = "required"
) -> "MissionOcean":
    """An ocean; whether it must have currents, unless an option says so."""
    from pymantaray.config.door.ocean import build_mission_ocean
    from pymantaray.config.door.water import configuration_of

    return build_mission_ocean(configuration_of(words, {"currents": currents} | options.keys))


def _refusals(words: list[str], options: WaterOptions) -> "list[Finding]":
    """Findings of options of ice, rays and profiles, which only the water itself has."""
    from pymantaray.config.door.water import open_water
    from pymantaray.ocean.schema import Finding

    try:
        open_water(words, **{"currents": "rest"} | options.keys)
    except MantaRayError as error:
        return [Finding("wrong", "water", in_options(str(error)))]
    return []


def _checked(own: "MissionOcean", **fleet: Any) -> "Findings":
    """Check an ocean, with its domain and sea floor."""
    from pymantaray.ocean import check_ocean
    from pymantaray.ocean.check import Findings
    from pymantaray.ocean.schema import Finding

    if own.in_metres:
        try:
            own.local_start()
        except OceanError as error:
            return Findings([Finding("wrong", "water in metres", in_options(str(error)))])
        return Findings([])
    options = {"equation": own.equation, "currents": own.reading["currents"], **own.domain, **fleet}
    if not (own.is_profile or own.reading["names"] or own.has_sea_floor):
        return check_ocean(own.source, time=own.time, **options)
    try:
        ocean = own.geographic_start()
    except OceanError as error:
        return Findings([Finding("wrong", "cannot be opened", str(error))])
    return check_ocean(ocean, sea_floor=own.sea_floor(ocean), **options)


@app.command()
@with_options
def show(files: Files, water: GridOptions, as_json: Json = False, to: To = "text") -> None:
    """
    Print extent, levels, time, ranges of each variable and history of an ocean, or the levels of
    profiles.
    """
    from pymantaray.ocean.summary import ocean_facts, region_table, variable_table

    own = _configured(files, water, currents="rest")
    with printer(as_json=as_json, to=to) as out:
        if own.in_metres:
            out.frame("region", own.open().region.reset_index(), by_row=True)
            return
        if own.is_profile and not own.has_sea_floor:
            out.notes(own.notes())
            _show_profiles(own.profiles(), out)
            return
        own, times, note = _at_one_instant(own)
        out.add(times=[str(t)[:16] for t in times])
        if note:
            out.line(f"{note}\n")
        ocean, floor = own.in_domain()
        facts = ocean_facts(ocean, floor)
        for name, text in facts.items():
            out.line(f"{name:<11} {text}")
        out.notes(own.notes_of(ocean, floor))
        region = region_table(ocean, equation=own.equation, sea_floor=floor).iloc[:, 0].to_dict()
        out.add(title=facts["title"], region=region)
        out.frame("variables", variable_table(ocean, own.equation).reset_index(), by_row=True)
        levels = ocean["depth"].values
        out.line(f"levels [m]\n{' '.join(f'{z:g}' for z in levels)}", levels_m=levels)
        history = str(ocean.attrs.get("history", "")).strip()
        if history:
            out.line(f"\nhistory\n{history}")
        out.add(history=history.splitlines())


def _at_one_instant(
    own: "MissionOcean",
) -> "tuple[MissionOcean, Sequence[np.datetime64], str]":
    """
    An ocean at its own time, or at the first of several instants; all its known instants, and a
    line about the choice.
    """
    try:
        times = own.instants()
    except OceanError:
        times = []  # the command itself reports it
    if own.time is not None or len(times) < 2:
        return own, times, ""
    listed = " ".join(str(t)[:16] for t in times)
    note = f"times       {len(times)}; this is the first, --time selects another\n{listed}"
    return own.at(times[0]), times, note


def _show_profiles(profiles: "Sequence[Profile]", out: "Printer") -> None:
    """Print the levels of profiles, which need no sea bed here."""
    from pymantaray.ocean.schema import place_text

    shown = []
    for profile in profiles:
        columns = {"depth [m]": profile.depth, "sound speed [m/s]": profile.sound_speed}
        if profile.water is not None:
            columns |= {"temperature [degC]": profile.water[0], "salinity [1]": profile.water[1]}
        facts = {
            "profile": profile.name,
            "time": f"{str(profile.time)[:16].replace('T', ' ')} UTC"
            if str(profile.time) != "NaT"
            else "unknown",
            "position": "unknown" if profile.place is None else place_text(*profile.place),
            "levels": f"{profile.depth.size}, {profile.depth[0]:.6g} to {profile.depth[-1]:.6g} m",
        }
        lists = {
            name.partition(" [")[0].replace(" ", "_"): values.tolist()
            for name, values in columns.items()
        }
        shown.append({**facts, **lists, "notes": list(profile.notes)})
        if len(profiles) == 1:
            for name, text in facts.items():
                out.line(f"{name:<11} {text}")
            out.line(
                f"{'sea bed':<11} not part of a profile; --bathymetry gives it to commands that"
                " need one"
            )
            ranges = [
                {"variable": name, "min": values.min(), "max": values.max()}
                for name, values in columns.items()
            ]
            out.frame("variables", ranges, by_row=True)
    if len(profiles) > 1:
        few = ("profile", "time", "position", "levels")
        out.frame("profiles", [{name: one[name] for name in few} for one in shown])
    out.add(levels=shown)


@app.command()
@with_options
def plot(
    files: Files,
    water: GridOptions,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder for the figures, PNG and PDF.",
            rich_help_panel=OUTPUT,
        ),
    ],
    depth: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Depth of the map. Default: 100 m, or half the water depth.",
        ),
    ] = None,
    at: Annotated[
        Any,
        typer.Option(
            parser=quantities("deg", 2),
            metavar="LAT,LON",
            help="Intersection of the sections. Default: the middle.",
        ),
    ] = None,
    formats: FigureFormats = "",
    quiet: Quiet = False,
) -> None:
    """Draw the spread of profiles, sections, a map with currents, and the sea floor."""
    names = format_names(formats, FIGURE_FORMATS)
    from pymantaray.apps.ocean import write_ocean_plots

    own, _, note = _at_one_instant(_configured(files, water, currents="rest"))
    ocean, floor = own.in_domain()
    printed = Printer(quiet=quiet)
    printed.notes([note] if note else [])
    printed.notes(own.notes() if own.is_profile else own.notes_of(ocean, floor))
    with progress_bars(quiet=quiet) as progress:
        paths = write_ocean_plots(
            ocean,
            out,
            depth=depth,
            place=at,
            sea_floor=floor,
            formats=names,
            progress=progress,
        )
    for path in paths:
        typer.echo(str(path))


@dataclass(frozen=True)
class UniformOptions:
    """Domain of a horizontally uniform ocean, and its water below a cast."""

    bathymetry: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Depth of the sea bed. Default: from the file.",
        ),
    ] = None
    half_extent: Annotated[
        tuple[str, str],
        typer.Option(metavar="NORTH EAST", help="Half sides of the domain, in METRES each."),
    ] = ("60 km", "60 km")
    below: Annotated[
        Literal["refuse", "constant"],
        typer.Option(
            help="Water below the deepest sample: refuse (an error), or constant (its values)."
        ),
    ] = "refuse"
    below_cast: Annotated[
        Path | None,
        typer.Option(
            callback=existing(),
            metavar="FILE",
            help="A deeper cast for the water below the deepest sample.",
        ),
    ] = None
    equation: Annotated[Equation, typer.Option(help="Equation of sound speed.")] = "teos-10"


@app.command()
@with_options
def from_cast(
    cast: CastFile, out: NewOcean, which: CastOptions, uniform: UniformOptions, force: Force = False
) -> None:
    """Make a horizontally uniform ocean at rest from one cast."""
    check_output(out, [".nc"], inputs=[cast], force=force)
    from pymantaray.ocean import cast_ocean, read_cast
    from pymantaray.ocean.cast import notes_of_casts

    if uniform.below_cast is not None and uniform.below != "refuse":
        raise OceanError("--below and --below-cast cannot be combined; give one of them")
    north, east = (metres_of("--half-extent", side) for side in uniform.half_extent)
    upper = read_cast(cast, **asdict(which))
    deep = (
        None
        if uniform.below_cast is None
        else read_cast(uniform.below_cast, repair_freezing=which.repair_freezing)
    )
    ocean = cast_ocean(
        upper,
        bathymetry=uniform.bathymetry,
        half_extent=(north, east),
        below=uniform.below if deep is None else deep,
        equation=uniform.equation,
    )
    _write(ocean, out, notes_of_casts([upper] if deep is None else [upper, deep]))


@app.command("convert-cast")
@with_options
def convert_cast(
    cast: CastFile,
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT", help="A Kongsberg .asvp, or a CF data set of profiles (.nc)."
        ),
    ],
    which: CastOptions,
    thin: Annotated[
        float | None,
        typer.Option(
            metavar="M/S", help="Remove levels if linear interpolation stays within this error."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write casts as profiles of sound speed for other programs."""
    check_output(out, [".asvp", ".nc"], inputs=[cast], force=force)
    from pymantaray.acoustics import read_profiles, write_asvp, write_profiles
    from pymantaray.acoustics.profiles import names_of
    from pymantaray.ocean.convert import parse_instant

    if (which.lat is None) != (which.lon is None):
        raise OceanError("--lat and --lon must be used together; give both")
    place = None if which.lat is None or which.lon is None else (which.lat, which.lon)
    profiles = read_profiles(cast, place, repair_freezing=which.repair_freezing)
    names = names_of(profiles)
    if which.name is not None:
        profiles = [p for p in profiles if p.name == which.name]
    if not profiles or (out.suffix == ".asvp" and len(profiles) > 1):
        cause = (
            f"no cast {which.name!r}"
            if not profiles
            else f"{len(profiles)} casts, but .asvp allows only one"
        )
        raise OceanError(f"{cast}: {cause}; available: {names}; select one with --name")
    if which.time is not None:
        time = parse_instant(which.time)
        profiles = [p._replace(time=time) for p in profiles]
    if thin is not None:
        profiles = [_thinned(p, thin) for p in profiles]
    if out.suffix == ".asvp":
        write_asvp(out, profiles[0])
    else:
        write_profiles(out, profiles)
    with printer() as printed:
        printed.notes(f"{cast}: {note}" for p in profiles for note in p.notes)
        printed.paths(out)


def _thinned(profile: "Profile", tolerance: float) -> "Profile":
    """Keep the levels that linear interpolation needs to stay within a tolerance. [m/s]"""
    from pymantaray.acoustics import thin_profile

    few = thin_profile(
        profile.depth, profile.sound_speed, tolerance=tolerance, interpolation="linear"
    )
    return profile._replace(depth=few.depth, sound_speed=few.sound_speed, water=None)


@dataclass(frozen=True)
class CorrectionOptions:
    """Scales and errors of an optimal interpolation."""

    scale: Annotated[
        float,
        typer.Option(
            parser=quantity("km"), metavar="KM", help="Horizontal scale of the background's error."
        ),
    ] = 50.0
    noise_ratio: Annotated[
        float, typer.Option(help="Error variance of the casts over that of the background.")
    ] = 0.1
    vertical_scale: Annotated[
        float,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Scale of the decay below the deepest sample.",
        ),
    ] = 100.0
    time_scale: Annotated[
        str | None,
        typer.Option(
            metavar="DAYS",
            help="Scale in time, a number or text such as '36 h'. Default: all casts have full"
            " weight.",
        ),
    ] = None


@app.command()
@with_options
def correct(
    ocean: Ocean,
    casts: CastFiles,
    out: NewOcean,
    water: GridOptions,
    scales: CorrectionOptions,
    force: Force = False,
) -> None:
    """Correct a gridded ocean with casts (optimal interpolation)."""
    check_output(out, [".nc"], inputs=[Path(ocean), *casts], force=force)
    from pymantaray.ocean import correct_with_casts, read_casts
    from pymantaray.ocean.cast import notes_of_casts

    time_scale = None
    if scales.time_scale is not None:
        time_scale = parse_duration("--time-scale", scales.time_scale, "d") * _S_PER_DAY
    own = _configured([ocean], water)
    measured = read_casts(casts, repair_freezing=water.repair_freezing)
    true = _fields(own)
    corrected = correct_with_casts(
        true,
        measured,
        horizontal_scale=scales.scale * _M_PER_KM,
        noise_ratio=scales.noise_ratio,
        vertical_scale=scales.vertical_scale,
        time_scale=time_scale,
    )
    _write(corrected, out, [*_of_fields(own, true), *notes_of_casts(measured)])


@dataclass(frozen=True)
class PerturbationOptions:
    """Method of a perturbation, and the options of each method."""

    method: Annotated[
        Literal["eof", "mean", "column"],
        typer.Option(
            help="eof: random, in vertical modes; mean: horizontal mean; column: one column."
        ),
    ] = "eof"
    rms: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m/s"), metavar="M/S", help="For eof: rms of the sound-speed error."
        ),
    ] = None
    scale: Annotated[
        float | None,
        typer.Option(
            parser=quantity("km"),
            metavar="KM",
            help="For eof: horizontal scale; inf for a uniform error.",
        ),
    ] = None
    down_to: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="For eof: depth limit of the water for --rms. Default: the sea bed.",
        ),
    ] = None
    mode_cast: Annotated[
        list[Path] | None,
        typer.Option(
            callback=existing(), metavar="CASTS", help="For eof: casts for the vertical modes."
        ),
    ] = None
    place: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LAT LON", help="For column: its position, in degrees."),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="For eof: seed of the member.")] = 0

    def __post_init__(self) -> None:
        needed, further = {
            "eof": ({"rms", "scale"}, {"down_to", "mode_cast"}),
            "mean": (set[str](), set[str]()),
            "column": ({"place"}, set[str]()),
        }[self.method]
        options = {"rms", "scale", "down_to", "mode_cast", "place"}
        given = {name for name in options if getattr(self, name) not in (None, [])}
        words = {name: f"--{name.replace('_', '-')}" for name in options}
        if missing := sorted(needed - given):
            raise OceanError(
                f"--method {self.method} needs {' and '.join(words[name] for name in missing)}"
            )
        if extra := sorted(given - needed - further):
            unused = " and ".join(words[name] for name in extra)
            raise OceanError(f"--method {self.method} does not use {unused}; remove the option")


@app.command()
@with_options
def perturb(
    files: Files,
    out: NewOcean,
    water: GridOptions,
    error: PerturbationOptions,
    force: Force = False,
) -> None:
    """Write a perturbed ocean for an estimator."""
    check_output(out, [".nc"], inputs=[*map(Path, files), *(error.mode_cast or [])], force=force)
    from pymantaray.geometry import stream
    from pymantaray.ocean import (
        column_ocean,
        mean_ocean,
        perturb_ocean,
        read_casts,
        vertical_modes,
        with_history,
    )

    own = _configured(files, water)
    true = _fields(own)
    equation = own.equation
    notes = _of_fields(own, true)
    if error.method == "mean":
        return _write(mean_ocean(true), out, notes)
    if error.place is not None:
        return _write(column_ocean(true, error.place), out, notes)
    assert error.rms is not None and error.scale is not None  # noqa: PT018  checked by the options
    modes = None
    if error.mode_cast:
        casts = read_casts(error.mode_cast, repair_freezing=water.repair_freezing)
        modes = vertical_modes(casts, equation=equation)
        notes += modes.notes
    member = perturb_ocean(
        true,
        rms=error.rms,
        horizontal_scale=error.scale * _M_PER_KM,
        rng=stream(error.seed, 0, "ocean", "perturb"),
        modes=modes,
        down_to=error.down_to,
        equation=equation,
    )
    return _write(with_history(member, f"seed {error.seed}"), out, notes)


def _fields(own: "MissionOcean") -> "xr.Dataset":
    """Temperature, salinity and currents of an ocean in its domain."""
    if own.has_sea_floor and not own.is_profile:
        raise OceanError(
            "--bathymetry applies to a profile here: the water of an ocean ends where its levels"
            " end; remove it, and use it with the commands that trace rays"
        )
    ocean, _ = own.in_domain()
    return ocean


def _of_fields(own: "MissionOcean", ocean: "xr.Dataset") -> list[str]:
    """Notes of the readers of an ocean, or of a profile."""
    return list(own.notes() if own.is_profile else own.notes_of(ocean, None))


def _write(ocean: "xr.Dataset", out: Path, notes: Sequence[str]) -> None:
    """Write an ocean atomically, and print notes and one line about its last change."""
    import numpy as np

    from pymantaray.records import write_netcdf

    write_netcdf(ocean, out)
    size = " x ".join(str(ocean.sizes[name]) for name in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))
    making = [line for line in str(ocean.attrs["history"]).splitlines() if line.startswith(_MAKING)]
    with printer() as printed:
        printed.notes(notes)
        printed.line(
            f"{out}: {size} levels, latitudes, longitudes to {ocean['depth'].values[wet][-1]:g} m;"
            f" {making[-1]}"
        )


COMMANDS = {"ocean": app, "ocean fetch": fetch_command.app}
