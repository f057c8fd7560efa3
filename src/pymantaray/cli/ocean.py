"""Commands of `mantaray ocean`: check, show, plot and make; `fetch` is a group of its own. What they need is imported when they run."""

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pymantaray.cli import ocean_fetch
from pymantaray.cli.options import Commands, Force, Json, Quiet, parse_duration, parse_pair
from pymantaray.cli.output import check_output, progress_bars
from pymantaray.cli.printing import printer
from pymantaray.errors import OceanError

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.acoustics.profiles import Profile

EXIT_WRONG = 2
_M_PER_KM = 1e3
_S_PER_DAY = 86_400.0
_MAKING = ("cast ", "corrected by ", "sound speed perturbed ", "replaced by ")  # lines of a history begin so

app = Commands(help="Fetch, make, check, show and plot the water.")
app.add_typer(ocean_fetch.app, name="fetch")

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE...", help="NetCDF files that belong together, or synthetic:beaufort, synthetic:fram."
    ),
]
Ocean = Annotated[
    str, typer.Argument(metavar="OCEAN", help="NetCDF file, or synthetic:beaufort, synthetic:fram.")
]
Cast = Annotated[
    Path, typer.Argument(metavar="CAST", help="A table, an instrument's file, Argo or CF profiles.")
]
Casts = Annotated[
    list[Path], typer.Argument(metavar="CASTS...", help="Tables, instruments' files, Argo or CF profiles.")
]
Out = Annotated[Path, typer.Argument(metavar="OUT.nc", help="The ocean to write.")]
Time = Annotated[
    str | None, typer.Option("--time", help="Instant in UTC, as 2014-07-15T12:00, if there are several.")
]
CastTime = Annotated[str | None, typer.Option("--time", help="Instant (UTC), as 2014-07-24T19:20.")]
Currents = Annotated[
    Literal["required", "rest"],
    typer.Option(
        "--currents", help="Whether files without currents are refused, or taken with water at rest."
    ),
]
SeaFloor = Annotated[
    Path | None, typer.Option("--sea-floor", help="Sea floor from a GEBCO, ETOPO, IBCAO or GLORYS file.")
]
Crs = Annotated[
    str | None,
    typer.Option("--crs", help="Projection of a sea floor that names none, as EPSG:3996 for IBCAO."),
]
Equation = Annotated[
    Literal["teos-10", "del-grosso", "unesco"], typer.Option("--equation", help="Equation of sound speed.")
]


VARIABLE_COLUMNS = {
    "variable": ("variable", ""),
    "units": ("units", ""),
    "least": ("least", ".2f"),
    "mean": ("mean", ".2f"),
    "greatest": ("greatest", ".2f"),
}


@app.command()
def check(
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE...", help="As for show; may be left out with --study, whose ocean is then checked."
        ),
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(
            "--study", metavar="NAME|FILE", help="Preset or TOML file whose domain and fleet must fit."
        ),
    ] = None,
    time: Time = None,
    sea_floor: SeaFloor = None,
    crs: Crs = None,
    currents: Currents = "required",
    equation: Equation = "teos-10",
    as_json: Json = False,
) -> None:
    """List what is wrong (exit 2) or doubtful (exit 0) about an ocean."""
    from pymantaray.ocean import check_ocean, open_ocean, open_sea_floor, window_of
    from pymantaray.ocean.check import Findings

    config = None
    options: dict[str, Any] = {"time": time, "equation": equation, "currents": currents}
    sources = list(files or [])
    if study is not None:
        from pymantaray.study import load_study
        from pymantaray.study.assemble import fleet_findings, fleet_plan
        from pymantaray.study.tracks import with_tracks

        # files given here take the place of the study's ocean as those of `study run --ocean` do
        config = with_tracks(load_study(study, ocean=sources or None))
        if not sources:
            sources = [*config.ocean.source]
            options["time"] = time or (config.ocean.time and config.ocean.time.isoformat())
            options |= {"equation": config.ocean.equation, "currents": config.ocean.currents}
            sea_floor = sea_floor or (Path(config.ocean.bathymetry) if config.ocean.bathymetry else None)
        options.update(
            centre=config.ocean.centre,
            half_extent=config.ocean.half_extent,
            fleet=fleet_plan(config),
            moved_elsewhere=bool(config.fleet.trajectories),
        )
    if not sources:
        raise OceanError("no file is given; name one, or a study with --study")
    ocean = None
    if sea_floor is not None or config is not None:
        with suppress(OceanError):  # the findings tell why
            ocean = open_ocean(sources, time=options["time"], currents=options["currents"])
    if sea_floor is not None and ocean is not None:
        options["sea_floor"] = open_sea_floor(sea_floor, window=window_of(ocean), crs=crs)
    findings = check_ocean(sources, **options)
    if config is not None and ocean is not None and findings.ok and not config.fleet.trajectories:
        findings = Findings([*fleet_findings(config, ocean, options.get("sea_floor")), *findings])
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


@app.command()
def show(
    files: Files,
    time: Time = None,
    currents: Currents = "required",
    equation: Equation = "teos-10",
    as_json: Json = False,
) -> None:
    """Print extent, levels, time, ranges of each variable and history of an ocean."""
    from pymantaray.ocean import ocean_times, open_ocean
    from pymantaray.ocean.summary import ocean_facts, region_table, variable_table

    times = ocean_times(files)
    with printer(as_json=as_json) as out:
        out.add(times=[str(t)[:16] for t in times])
        if time is None and len(times) > 1:
            listed = " ".join(str(t)[:16] for t in times)
            out.line(f"times       {len(times)}, the first is shown; --time chooses another\n{listed}\n")
            time = str(times[0])
        ocean = open_ocean(files, time=time, currents=currents)
        facts = ocean_facts(ocean)
        for name, text in facts.items():
            out.line(f"{name:<11} {text}")
        out.add(title=facts["title"], region=region_table(ocean, equation=equation).iloc[:, 0].to_dict())
        out.table("variables", variable_table(ocean, equation).reset_index(), VARIABLE_COLUMNS)
        levels = ocean["depth"].values
        out.line(f"levels [m]\n{' '.join(f'{z:g}' for z in levels)}", levels_m=levels)
        history = str(ocean.attrs.get("history", "")).strip()
        if history:
            out.line(f"\nhistory\n{history}")
        out.add(history=history.splitlines())


@app.command()
def plot(
    files: Files,
    out: Annotated[Path, typer.Option("--out", help="Folder for the figures, PNG and PDF.")],
    time: Time = None,
    depth: Annotated[
        float | None,
        typer.Option("--depth", help="Level of the map in metres. Default: 100, or half-way down."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="LAT,LON", help="Where the sections cross. Default: the middle."),
    ] = None,
    sea_floor: SeaFloor = None,
    crs: Crs = None,
    currents: Currents = "required",
    quiet: Quiet = False,
) -> None:
    """Draw the spread of profiles, sections, a map with currents, and the sea floor."""
    from pymantaray.ocean import open_ocean, open_sea_floor, window_of
    from pymantaray.report import write_ocean_plots

    place = None if at is None else parse_pair("--at", at)
    ocean = open_ocean(files, time=time, currents=currents)
    floor = None if sea_floor is None else open_sea_floor(sea_floor, window=window_of(ocean), crs=crs)
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
        typer.Option("--bottom", help="Depth of the sea bed, in m. Default: what the file tells."),
    ] = None,
    half_extent: Annotated[
        tuple[float, float], typer.Option("--half-extent", help="Half sides north and east, in km.")
    ] = (60.0, 60.0),
    below: Annotated[
        Literal["refuse", "constant"],
        typer.Option("--below", help="Below the deepest sample: an error, or its water."),
    ] = "refuse",
    below_cast: Annotated[
        Path | None, typer.Option("--below-cast", help="A deeper cast for below the deepest sample.")
    ] = None,
    lat: Annotated[
        float | None, typer.Option("--lat", help="The cast's latitude, if its file has none, in degrees.")
    ] = None,
    lon: Annotated[
        float | None, typer.Option("--lon", help="The cast's longitude, if its file has none, in degrees.")
    ] = None,
    time: CastTime = None,
    name: Annotated[
        str | None, typer.Option("--name", help="The cast to take, if the file holds several.")
    ] = None,
    equation: Equation = "teos-10",
    force: Force = False,
) -> None:
    """Make a horizontally uniform ocean at rest from one cast."""
    check_output(out, [".nc"], inputs=[cast], force=force)
    from pymantaray.ocean import cast_ocean, read_cast

    if below_cast is not None and below != "refuse":
        raise OceanError("--below and --below-cast exclude each other; give one")
    ocean = cast_ocean(
        read_cast(cast, lat=lat, lon=lon, time=time, name=name),
        bottom_depth=bottom,
        half_extent=(half_extent[0] * _M_PER_KM, half_extent[1] * _M_PER_KM),
        below=below if below_cast is None else read_cast(below_cast),
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
        float | None, typer.Option("--lat", help="The cast's latitude, if its file has none, in degrees.")
    ] = None,
    lon: Annotated[
        float | None, typer.Option("--lon", help="The cast's longitude, if its file has none, in degrees.")
    ] = None,
    time: CastTime = None,
    name: Annotated[
        str | None, typer.Option("--name", help="The cast to take, if the file holds several.")
    ] = None,
    thin: Annotated[
        float | None,
        typer.Option(
            "--thin", metavar="M/S", help="Leave out levels of which straight lines keep within this."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write casts as profiles of sound speed for other programs."""
    check_output(out, [".asvp", ".nc"], inputs=[cast], force=force)
    from pymantaray.acoustics import read_profiles, write_asvp, write_profiles
    from pymantaray.ocean.convert import parse_instant

    if (lat is None) != (lon is None):
        raise OceanError("--lat and --lon: the one needs the other")
    profiles = read_profiles(cast, None if lat is None or lon is None else (lat, lon))
    names = ", ".join(p.name for p in profiles[:4]) + (", ..." if len(profiles) > 4 else "")
    if name is not None:
        profiles = [p for p in profiles if p.name == name]
    if not profiles or (out.suffix == ".asvp" and len(profiles) > 1):
        wanted = f"no cast {name!r}" if not profiles else f"{len(profiles)} casts, of which .asvp takes one"
        raise OceanError(f"{cast}: {wanted}; there is {names}: choose one by --name")
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
    """Levels that straight lines need to stay within a tolerance of all. [m/s]"""
    from pymantaray.acoustics import thin_profile

    few = thin_profile(profile.depth, profile.sound_speed, tolerance=tolerance, interpolation="linear")
    return profile._replace(depth=few.depth, sound_speed=few.sound_speed, water=None)


@app.command()
def correct(
    ocean: Ocean,
    casts: Casts,
    out: Out,
    scale: Annotated[
        float, typer.Option("--scale", help="Horizontal scale of the background's error, in km.")
    ] = 50.0,
    noise_ratio: Annotated[
        float, typer.Option("--noise-ratio", help="Variance of the casts' errors over the background's.")
    ] = 0.1,
    vertical_scale: Annotated[
        float, typer.Option("--vertical-scale", help="Decay below the deepest sample, in m.")
    ] = 100.0,
    time_scale: Annotated[
        str | None,
        typer.Option(
            "--time-scale",
            metavar="DURATION",
            help="Scale in time: days, or such as '36 h'. Default: casts count in full.",
        ),
    ] = None,
    time: CastTime = None,
    force: Force = False,
) -> None:
    """Correct a gridded ocean by casts (optimal interpolation)."""
    check_output(out, [".nc"], inputs=[Path(ocean), *casts], force=force)
    from pymantaray.ocean import correct_with_casts, open_ocean, read_casts

    corrected = correct_with_casts(
        open_ocean(ocean, time=time),
        read_casts(casts),
        horizontal_scale=scale * _M_PER_KM,
        noise_ratio=noise_ratio,
        vertical_scale=vertical_scale,
        time_scale=None
        if time_scale is None
        else parse_duration("--time-scale", time_scale, "d") * _S_PER_DAY,
    )
    _write(corrected, out)


@app.command()
def perturb(
    ocean: Ocean,
    out: Out,
    method: Annotated[
        Literal["eof", "mean", "column"],
        typer.Option("--method", help="Random in vertical modes, the horizontal mean, or one column."),
    ] = "eof",
    rms: Annotated[float | None, typer.Option("--rms", help="For eof: of sound speed, in m/s.")] = None,
    scale: Annotated[
        float | None,
        typer.Option("--scale", help="For eof: horizontal scale, in km; inf for the same everywhere."),
    ] = None,
    down_to: Annotated[
        float | None,
        typer.Option("--down-to", help="For eof: depth down to which rms is meant, in m. Default: all."),
    ] = None,
    mode_cast: Annotated[
        list[Path] | None, typer.Option("--mode-cast", help="For eof: casts whose modes are taken.")
    ] = None,
    place: Annotated[
        tuple[float, float] | None, typer.Option("--place", help="For column: latitude and longitude.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="For eof: one member for each seed.")] = 0,
    time: CastTime = None,
    equation: Equation = "teos-10",
    force: Force = False,
) -> None:
    """Make an ocean that is believed instead of the true one."""
    options = {"rms": rms, "scale": scale, "down-to": down_to, "mode-cast": mode_cast, "place": place}
    _check_options(method, {name for name, value in options.items() if value not in (None, [])})
    check_output(out, [".nc"], inputs=[Path(ocean), *(mode_cast or [])], force=force)
    from pymantaray.geometry import stream
    from pymantaray.ocean import (
        column_ocean,
        mean_ocean,
        open_ocean,
        perturb_ocean,
        read_casts,
        vertical_modes,
        with_history,
    )

    true = open_ocean(ocean, time=time)
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
        modes=vertical_modes(read_casts(mode_cast), equation=equation) if mode_cast else None,
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
        raise OceanError(f"--method {method}: --{' and --'.join(missing)} needed")
    if extra := sorted(options - needed - further):
        raise OceanError(f"--method {method}: takes no --{' and no --'.join(extra)}")


def _write(ocean: "xr.Dataset", out: Path) -> None:
    """Whole or not at all, and one line for people on what was done last."""
    import numpy as np

    from pymantaray.records import write_netcdf

    write_netcdf(ocean, out)
    size = " x ".join(str(ocean.sizes[name]) for name in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))
    making = [line for line in str(ocean.attrs["history"]).splitlines() if line.startswith(_MAKING)]
    typer.echo(
        f"{out}: {size} levels, latitudes, longitudes to {ocean['depth'].values[wet][-1]:g} m; {making[-1]}"
    )
