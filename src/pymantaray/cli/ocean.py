"""Commands of `mantaray ocean`: check, show and plot; others register theirs. What they need is imported when they run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pymantaray.cli import ocean_fetch, ocean_make
from pymantaray.errors import OceanError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

    from pymantaray.study.config import StudyConfig

EXIT_WRONG = 2

app = typer.Typer(help="Fetch, make, check, show and plot the water.", no_args_is_help=True)
app.add_typer(ocean_fetch.app, name="fetch")
ocean_make.register(app)

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE...", help="NetCDF files that belong together, or synthetic:beaufort, synthetic:fram."
    ),
]
Time = Annotated[
    str | None, typer.Option("--time", help="Instant in UTC, as 2014-07-15T12:00, if there are several.")
]
Currents = Annotated[
    Literal["required", "rest"],
    typer.Option(
        "--currents", help="Whether files without currents are refused, or taken with water at rest."
    ),
]
SeaFloor = Annotated[
    Path | None,
    typer.Option("--sea-floor", help="Sea floor from a GEBCO, ETOPO, IBCAO or GLORYS file."),
]
Crs = Annotated[
    str | None,
    typer.Option("--crs", help="Projection of a sea floor that names none, as EPSG:3996 for IBCAO."),
]
Equation = Annotated[
    Literal["teos-10", "del-grosso", "unesco"], typer.Option("--equation", help="Equation of sound speed.")
]


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
) -> None:
    """List what is wrong (exit 2) or doubtful (exit 0) about an ocean."""
    from pymantaray.ocean.check import check_ocean

    options: dict[str, Any] = {"time": time, "equation": equation, "currents": currents}
    sources = list(files or [])
    if study is not None:
        from pymantaray.study import load_study

        config = load_study(study)
        if not sources:
            sources = [*config.ocean.source]
            options["time"] = time or (config.ocean.time and config.ocean.time.isoformat())
            options |= {"equation": config.ocean.equation, "currents": config.ocean.currents}
            sea_floor = sea_floor or (Path(config.ocean.bathymetry) if config.ocean.bathymetry else None)
        options.update(
            centre=config.ocean.centre, half_extent=config.ocean.half_extent, fleet=fleet_plan(config)
        )
    if not sources:
        raise OceanError("no file is given; name one, or a study with --study")
    if sea_floor is not None:
        options["sea_floor"] = _floor_beneath(sources, options["time"], options["currents"], sea_floor, crs)
    found = check_ocean(sources, **options)
    for finding in found:
        typer.echo(str(finding))
    typer.echo(f"{len(found.wrong)} wrong, {len(found.doubtful)} doubtful")
    if not found.ok:
        raise typer.Exit(EXIT_WRONG)


@app.command()
def show(
    files: Files, time: Time = None, currents: Currents = "required", equation: Equation = "teos-10"
) -> None:
    """Print extent, levels, time, ranges of each variable and history of an ocean."""
    from pymantaray.ocean import open_ocean
    from pymantaray.ocean.source import ocean_times
    from pymantaray.ocean.summary import ocean_facts, variable_table

    times = ocean_times(files)
    if time is None and len(times) > 1:
        listed = " ".join(str(t)[:16] for t in times)
        typer.echo(f"times       {len(times)}, the first is shown; --time chooses another\n{listed}\n")
        time = str(times[0])
    ocean = open_ocean(files, time=time, currents=currents)
    for name, text in ocean_facts(ocean).items():
        typer.echo(f"{name:<11} {text}")
    typer.echo("")
    table = variable_table(ocean, equation)
    typer.echo(f"{'variable':<14} {'units':<6} {'least':>9} {'mean':>9} {'greatest':>9}")
    for variable, row in table.iterrows():
        least, mean, greatest = (f"{row[column]:9.2f}" for column in ("least", "mean", "greatest"))
        typer.echo(f"{variable!s:<14} {row['units']:<6} {least} {mean} {greatest}")
    levels = " ".join(f"{z:g}" for z in ocean["depth"].values)
    typer.echo(f"\nlevels [m]\n{levels}")
    history = str(ocean.attrs.get("history", "")).strip()
    if history:
        typer.echo(f"\nhistory\n{history}")


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
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar.")] = False,
) -> None:
    """Draw the spread of profiles, sections, a map with currents, and the sea floor."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.ocean import open_ocean
    from pymantaray.report.ocean_plots import write_ocean_plots

    place = None if at is None else _place(at)
    ocean = open_ocean(files, time=time, currents=currents)
    floor = None if sea_floor is None else _floor_beneath(files, time, currents, sea_floor, crs)
    with progress_bars(quiet=quiet) as progress:
        written = write_ocean_plots(ocean, out, depth=depth, place=place, sea_floor=floor, progress=progress)
    for path in written:
        typer.echo(str(path))


def fleet_plan(config: "StudyConfig") -> dict[str, "NDArray[np.float64]"]:
    """
    Points that each vehicle and landmark of a study starts from and plans to reach.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    dict of str to ndarray, shape (n, 3)
        North, east, down; the start first. Drift is not foreseen. [m]
    """
    import numpy as np

    from pymantaray.study.assemble import build_fleet

    plan = {vehicle.name: [tuple(vehicle.position)] for vehicle in build_fleet(config)}
    for vehicle in config.fleet.vehicles:
        if vehicle.kind == "float":
            plan[vehicle.name].append((vehicle.north, vehicle.east, vehicle.target_depth))
        elif vehicle.kind == "waypoints":
            plan[vehicle.name].extend(vehicle.points)
    plan.update({mark.name: [(mark.north, mark.east, mark.depth)] for mark in config.landmarks})
    return {name: np.array(points, dtype=float) for name, points in plan.items()}


def _floor_beneath(
    files: list[str], time: str | None, currents: Literal["required", "rest"], path: Path, crs: str | None
) -> "xr.DataArray | None":
    """Sea floor of a file in the ocean's window; None if the ocean does not open, which is said elsewhere."""
    from pymantaray.ocean import open_ocean
    from pymantaray.ocean.sea_floor import window_of
    from pymantaray.ocean.topography import open_sea_floor

    try:
        ocean = open_ocean(files, time=time, currents=currents)
    except OceanError:
        return None
    return open_sea_floor(path, window=window_of(ocean), crs=crs)


def _place(text: str) -> tuple[float, float]:
    try:
        lat, lon = (float(part) for part in text.split(","))
    except ValueError:
        raise OceanError(f"--at {text!r} is not a place; write it as 74.5,-140") from None
    return lat, lon
