"""Commands of `mantaray ocean`: check, show, plot and make oceans. They import modules when they run. `fetch` is a separate group."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pymantaray.cli import ocean_fetch
from pymantaray.cli.options import (
    Commands,
    Force,
    Json,
    Quiet,
    RepairFreezing,
    Set,
    To,
    WaterOptions,
    changes_of,
    parse_duration,
    parse_pair,
    quantity,
    with_options,
)
from pymantaray.cli.output import check_output, progress_bars
from pymantaray.cli.printing import printer
from pymantaray.errors import OceanError

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.acoustics.profiles import Profile
    from pymantaray.config import SoundConfig
    from pymantaray.ocean.check import Findings

EXIT_WRONG = 2
_M_PER_KM = 1e3
_S_PER_DAY = 86_400.0
_MAKING = (
    "cast ",
    "corrected with ",
    "sound speed perturbed ",
    "replaced by ",
)  # first words of lines in a history

app = Commands(help="Fetch, make, check, show and plot oceans.")
app.add_typer(ocean_fetch.app, name="fetch")

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="OCEAN...",
        help="Files that belong together, a profile or cast, synthetic:beaufort or synthetic:fram, a preset, or a TOML file.",
    ),
]
Ocean = Annotated[str, typer.Argument(metavar="OCEAN", help="As in mantaray ocean show.")]
Cast = Annotated[
    Path, typer.Argument(metavar="CAST", help="A table, an instrument's file, Argo profiles or CF profiles.")
]
Casts = Annotated[
    list[Path],
    typer.Argument(metavar="CASTS...", help="Tables, instruments' files, Argo profiles or CF profiles."),
]
Out = Annotated[Path, typer.Argument(metavar="OUT.nc", help="The ocean to write.")]
CastTime = Annotated[str | None, typer.Option("--time", help="Instant (UTC), such as 2014-07-24T19:20.")]
Equation = Annotated[
    Literal["teos-10", "del-grosso", "unesco"], typer.Option("--equation", help="Equation of sound speed.")
]


@app.command()
@with_options
def check(
    water: WaterOptions,
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="OCEAN...",
            help="As in mantaray ocean show. Default with --study: the ocean of the study.",
        ),
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(
            "--study",
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
    if study is None:
        findings = _checked(_configured(files or [], water))
    else:
        from pymantaray.config.options import dotted_keys
        from pymantaray.study import load_study
        from pymantaray.study.assemble import fleet_findings, fleet_plan
        from pymantaray.study.tracks import with_tracks

        # these files replace the study's ocean, as in `study run --ocean`
        config = with_tracks(
            load_study(study, ocean=files or None, **dotted_keys(water.keys), **changes_of(changes))
        )
        moved = bool(config.fleet.trajectories)
        findings = _checked(config, fleet=fleet_plan(config), existing_trajectories=moved)
        if findings.ok and not moved:
            from pymantaray.water.ocean import open_geographic

            findings = Findings([*fleet_findings(config, *open_geographic(config)), *findings])
    with printer(as_json=as_json) as out:
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


def _configured(words: list[str], options: WaterOptions) -> "SoundConfig":
    """Configuration of an ocean, which must have currents unless an option sets them to rest."""
    from pymantaray.water.water import configuration_of

    return configuration_of(words, {"currents": "required"} | options.keys)


def _checked(config: "SoundConfig", **fleet: Any) -> "Findings":
    """Check the ocean of a configuration, with its domain and sea floor."""
    from pymantaray.ocean import check_ocean
    from pymantaray.ocean.check import Findings
    from pymantaray.ocean.schema import Finding
    from pymantaray.water.ocean import build_sea_floor, is_profile, open_start

    section = config.ocean
    options: dict[str, Any] = {"equation": section.equation, "currents": section.currents, **fleet}
    options |= {"centre": section.centre, "half_extent": section.half_extent}
    if not (is_profile(section) or section.standard_names) and section.bathymetry is None:
        time = None if section.time is None else section.time.isoformat()
        return check_ocean(section.source, time=time, **options)
    try:
        ocean = open_start(section)
    except OceanError as error:
        return Findings([Finding("wrong", "cannot be opened", str(error))])
    return check_ocean(ocean, sea_floor=build_sea_floor(section, ocean), **options)


@app.command()
@with_options
def show(files: Files, water: WaterOptions, as_json: Json = False, to: To = "text") -> None:
    """Print extent, levels, time, ranges of each variable and history of an ocean."""
    from pymantaray.ocean import ocean_times
    from pymantaray.ocean.summary import ocean_facts, region_table, variable_table
    from pymantaray.records.result_table import ResultTable
    from pymantaray.water.ocean import is_profile, open_start

    config = _configured(files, water)
    section = config.ocean
    with printer(as_json=as_json, to=to) as out:
        if not is_profile(section):
            times = ocean_times(section.source, section.standard_names)
            out.add(times=[str(t)[:16] for t in times])
            if section.time is None and len(times) > 1:
                listed = " ".join(str(t)[:16] for t in times)
                out.line(f"times       {len(times)}; this is the first, --time selects another\n{listed}\n")
                section = config.with_(**{"ocean.time": times[0].astype("datetime64[us]").item()}).ocean
        ocean = open_start(section)
        facts = ocean_facts(ocean)
        for name, text in facts.items():
            out.line(f"{name:<11} {text}")
        region = region_table(ocean, equation=section.equation).iloc[:, 0].to_dict()
        out.add(title=facts["title"], region=region)
        variables = variable_table(ocean, section.equation).reset_index()
        out.table(ResultTable("variables", variables, by_row=True))
        levels = ocean["depth"].values
        out.line(f"levels [m]\n{' '.join(f'{z:g}' for z in levels)}", levels_m=levels)
        history = str(ocean.attrs.get("history", "")).strip()
        if history:
            out.line(f"\nhistory\n{history}")
        out.add(history=history.splitlines())


@app.command()
@with_options
def plot(
    files: Files,
    water: WaterOptions,
    out: Annotated[Path, typer.Option("--out", help="Folder for the figures, PNG and PDF.")],
    depth: Annotated[
        float | None,
        typer.Option(
            "--depth",
            parser=quantity("m"),
            help="Depth of the map in metres. Default: 100 m, or half the water depth.",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="LAT,LON", help="Intersection of the sections. Default: the middle."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Draw the spread of profiles, sections, a map with currents, and the sea floor."""
    from pymantaray.report import write_ocean_plots
    from pymantaray.water.ocean import open_geographic

    place = None if at is None else parse_pair("--at", at)
    ocean, floor = open_geographic(_configured(files, water))
    with progress_bars(quiet=quiet) as progress:
        paths = write_ocean_plots(ocean, out, depth=depth, place=place, sea_floor=floor, progress=progress)
    for path in paths:
        typer.echo(str(path))


@app.command()
def from_cast(
    cast: Cast,
    out: Out,
    bottom: Annotated[
        float | None,
        typer.Option(
            "--bottom",
            parser=quantity("m"),
            help="Depth of the sea bed, in m. Default: from the file.",
        ),
    ] = None,
    half_extent: Annotated[
        tuple[float, float], typer.Option("--half-extent", help="Half sides north and east, in km.")
    ] = (60.0, 60.0),
    below: Annotated[
        Literal["refuse", "constant"],
        typer.Option(
            "--below", help="Water below the deepest sample: refuse (an error), or constant (its values)."
        ),
    ] = "refuse",
    below_cast: Annotated[
        Path | None,
        typer.Option("--below-cast", help="A deeper cast for the water below the deepest sample."),
    ] = None,
    lat: Annotated[
        float | None,
        typer.Option(
            "--lat", parser=quantity("deg"), help="Latitude of a cast whose file has none, in degrees."
        ),
    ] = None,
    lon: Annotated[
        float | None,
        typer.Option(
            "--lon",
            parser=quantity("deg"),
            help="Longitude of a cast whose file has none, in degrees.",
        ),
    ] = None,
    time: CastTime = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the cast, if the file contains several.")
    ] = None,
    equation: Equation = "teos-10",
    repair_freezing: RepairFreezing = False,
    force: Force = False,
) -> None:
    """Make a horizontally uniform ocean at rest from one cast."""
    check_output(out, [".nc"], inputs=[cast], force=force)
    from pymantaray.ocean import cast_ocean, read_cast

    if below_cast is not None and below != "refuse":
        raise OceanError("--below and --below-cast cannot be combined; give one of them")
    ocean = cast_ocean(
        read_cast(cast, lat=lat, lon=lon, time=time, name=name, repair_freezing=repair_freezing),
        bottom_depth=bottom,
        half_extent=(half_extent[0] * _M_PER_KM, half_extent[1] * _M_PER_KM),
        below=below if below_cast is None else read_cast(below_cast, repair_freezing=repair_freezing),
        equation=equation,
    )
    _write(ocean, out)


@app.command("convert-cast")
def convert_cast(
    cast: Cast,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="A Kongsberg .asvp, or a CF data set of profiles (.nc).")
    ],
    lat: Annotated[
        float | None, typer.Option("--lat", help="Latitude of a cast whose file has none, in degrees.")
    ] = None,
    lon: Annotated[
        float | None, typer.Option("--lon", help="Longitude of a cast whose file has none, in degrees.")
    ] = None,
    time: CastTime = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the cast, if the file contains several.")
    ] = None,
    thin: Annotated[
        float | None,
        typer.Option(
            "--thin", metavar="M/S", help="Remove levels if linear interpolation stays within this error."
        ),
    ] = None,
    repair_freezing: RepairFreezing = False,
    force: Force = False,
) -> None:
    """Write casts as profiles of sound speed for other programs."""
    check_output(out, [".asvp", ".nc"], inputs=[cast], force=force)
    from pymantaray.acoustics import read_profiles, write_asvp, write_profiles
    from pymantaray.ocean.convert import parse_instant

    if (lat is None) != (lon is None):
        raise OceanError("--lat and --lon must be used together; give both")
    place = None if lat is None or lon is None else (lat, lon)
    profiles = read_profiles(cast, place, repair_freezing=repair_freezing)
    names = ", ".join(p.name for p in profiles[:4]) + (", ..." if len(profiles) > 4 else "")
    if name is not None:
        profiles = [p for p in profiles if p.name == name]
    if not profiles or (out.suffix == ".asvp" and len(profiles) > 1):
        cause = f"no cast {name!r}" if not profiles else f"{len(profiles)} casts, but .asvp allows only one"
        raise OceanError(f"{cast}: {cause}; available: {names}; select one with --name")
    if time is not None:
        profiles = [p._replace(time=parse_instant(time)) for p in profiles]
    if thin is not None:
        profiles = [_thinned(p, thin) for p in profiles]
    if out.suffix == ".asvp":
        write_asvp(out, profiles[0])
    else:
        write_profiles(out, profiles)
    for note in dict.fromkeys(note for p in profiles for note in p.notes):
        typer.echo(f"{cast}: {note}", err=True)
    typer.echo(str(out))


def _thinned(profile: "Profile", tolerance: float) -> "Profile":
    """Keep the levels that linear interpolation needs to stay within a tolerance. [m/s]"""
    from pymantaray.acoustics import thin_profile

    few = thin_profile(profile.depth, profile.sound_speed, tolerance=tolerance, interpolation="linear")
    return profile._replace(depth=few.depth, sound_speed=few.sound_speed, water=None)


@app.command()
@with_options
def correct(
    ocean: Ocean,
    casts: Casts,
    out: Out,
    water: WaterOptions,
    scale: Annotated[
        float,
        typer.Option(
            "--scale", parser=quantity("km"), help="Horizontal scale of the background's error, in km."
        ),
    ] = 50.0,
    noise_ratio: Annotated[
        float,
        typer.Option("--noise-ratio", help="Error variance of the casts over that of the background."),
    ] = 0.1,
    vertical_scale: Annotated[
        float,
        typer.Option(
            "--vertical-scale",
            parser=quantity("m"),
            help="Scale of the decay below the deepest sample, in m.",
        ),
    ] = 100.0,
    time_scale: Annotated[
        str | None,
        typer.Option(
            "--time-scale",
            metavar="DURATION",
            help="Scale in time: days, or text such as '36 h'. Default: all casts have full weight.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Correct a gridded ocean with casts (optimal interpolation)."""
    check_output(out, [".nc"], inputs=[Path(ocean), *casts], force=force)
    from pymantaray.ocean import correct_with_casts, read_casts
    from pymantaray.water.ocean import open_start

    corrected = correct_with_casts(
        open_start(_configured([ocean], water).ocean),
        read_casts(casts, repair_freezing=water.repair_freezing),
        horizontal_scale=scale * _M_PER_KM,
        noise_ratio=noise_ratio,
        vertical_scale=vertical_scale,
        time_scale=None
        if time_scale is None
        else parse_duration("--time-scale", time_scale, "d") * _S_PER_DAY,
    )
    _write(corrected, out)


@app.command()
@with_options
def perturb(
    ocean: Ocean,
    out: Out,
    water: WaterOptions,
    method: Annotated[
        Literal["eof", "mean", "column"],
        typer.Option(
            "--method", help="eof: random, in vertical modes; mean: horizontal mean; column: one column."
        ),
    ] = "eof",
    rms: Annotated[
        float | None,
        typer.Option("--rms", parser=quantity("m/s"), help="For eof: rms of the sound-speed error, in m/s."),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            "--scale",
            parser=quantity("km"),
            help="For eof: horizontal scale, in km; inf for a uniform error.",
        ),
    ] = None,
    down_to: Annotated[
        float | None,
        typer.Option(
            "--down-to",
            parser=quantity("m"),
            help="For eof: depth limit of the water for --rms, in m. Default: the sea bed.",
        ),
    ] = None,
    mode_cast: Annotated[
        list[Path] | None, typer.Option("--mode-cast", help="For eof: casts for the vertical modes.")
    ] = None,
    place: Annotated[
        tuple[float, float] | None,
        typer.Option("--place", help="For column: its latitude and longitude, in degrees."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="For eof: seed of the member.")] = 0,
    force: Force = False,
) -> None:
    """Write a perturbed ocean for an estimator."""
    options = {"rms": rms, "scale": scale, "down-to": down_to, "mode-cast": mode_cast, "place": place}
    _check_options(method, {name for name, value in options.items() if value not in (None, [])})
    check_output(out, [".nc"], inputs=[Path(ocean), *(mode_cast or [])], force=force)
    from pymantaray.geometry import stream
    from pymantaray.ocean import (
        column_ocean,
        mean_ocean,
        perturb_ocean,
        read_casts,
        vertical_modes,
        with_history,
    )
    from pymantaray.water.ocean import open_start

    section = _configured([ocean], water).ocean
    true, equation = open_start(section), section.equation
    if method == "mean":
        return _write(mean_ocean(true), out)
    if place is not None:
        return _write(column_ocean(true, place), out)
    assert rms is not None and scale is not None  # noqa: PT018  checked above
    member = perturb_ocean(
        true,
        rms=rms,
        horizontal_scale=scale * _M_PER_KM,
        rng=stream(seed, 0, "ocean", "perturb"),
        modes=vertical_modes(read_casts(mode_cast, repair_freezing=water.repair_freezing), equation=equation)
        if mode_cast
        else None,
        down_to=down_to,
        equation=equation,
    )
    return _write(with_history(member, f"seed {seed}"), out)


def _check_options(method: str, options: set[str]) -> None:
    needed, further = {
        "eof": ({"rms", "scale"}, {"down-to", "mode-cast"}),
        "mean": (set[str](), set[str]()),
        "column": ({"place"}, set[str]()),
    }[method]
    if missing := sorted(needed - options):
        raise OceanError(f"--method {method} needs --{' and --'.join(missing)}")
    if extra := sorted(options - needed - further):
        raise OceanError(f"--method {method} does not use --{' and --'.join(extra)}; remove the option")


def _write(ocean: "xr.Dataset", out: Path) -> None:
    """Write an ocean atomically, and print one line about its last change."""
    import numpy as np

    from pymantaray.records import write_netcdf

    write_netcdf(ocean, out)
    size = " x ".join(str(ocean.sizes[name]) for name in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))
    making = [line for line in str(ocean.attrs["history"]).splitlines() if line.startswith(_MAKING)]
    typer.echo(
        f"{out}: {size} levels, latitudes, longitudes to {ocean['depth'].values[wet][-1]:g} m; {making[-1]}"
    )
