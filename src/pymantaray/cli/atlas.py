"""Commands of `mantaray atlas`; they import modules when they run, which keeps the help fast."""

from dataclasses import replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli.ocean import Files
from pymantaray.cli.options import (
    Commands,
    Force,
    Json,
    Quiet,
    RunGroup,
    Scheduler,
    SearchOptions,
    To,
    WaterOptions,
    Workers,
    parse_duration,
    parse_pair,
    quantity,
    with_options,
)
from pymantaray.cli.output import check_output, counted_progress
from pymantaray.cli.printing import printer
from pymantaray.errors import AtlasError

if TYPE_CHECKING:
    import pandas as pd

    from pymantaray.records.result_table import ResultTable

app = Commands(cls=RunGroup, help="Map the errors of straight-line ranging in every column of an ocean.")

AtlasFile = Annotated[Path, typer.Argument(metavar="ATLAS.nc", help="File of an atlas.")]


@app.command()
@with_options
def run(
    files: Files,
    water: WaterOptions,
    search: SearchOptions,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="ATLAS.nc", help="File to write. Finished blocks in ATLAS.nc.blocks are skipped."
        ),
    ],
    every: Annotated[int, typer.Option("--every", min=1, help="Use every n-th column along each axis.")] = 1,
    window: Annotated[
        str | None,
        typer.Option(
            "--window",
            metavar="S,N,W,E",
            help="Region of the columns, in degrees. Links may use water outside.",
        ),
    ] = None,
    depths: Annotated[
        str,
        typer.Option(
            "--depths", metavar="M,...", help="Use all pairs of these depths with the transmitter above."
        ),
    ] = "20,200,800",
    pair: Annotated[
        list[str] | None,
        typer.Option(
            "--pair",
            metavar="M,M",
            help="Depths of transmitter and receiver, instead of --depths. May be repeated.",
        ),
    ] = None,
    distances: Annotated[
        str,
        typer.Option(
            "--distances", metavar="M,...", help="Horizontal distances in metres, in ascending order."
        ),
    ] = "2000,5000,10000",
    bearings: Annotated[
        int, typer.Option("--bearings", min=1, help="Number of directions, evenly spaced from north.")
    ] = 4,
    nominal: Annotated[
        float,
        typer.Option(
            "--nominal",
            parser=quantity("m/s"),
            metavar="M/S",
            help="Sound speed of the convention nominal.",
        ),
    ] = 1500.0,
    safe: Annotated[
        str, typer.Option("--safe", metavar="M,...", help="Error thresholds in metres, in ascending order.")
    ] = "1,5,20",
    within_db: Annotated[
        float,
        typer.Option(
            "--within-db", help="Count arrivals at most this many dB weaker than the strongest arrival."
        ),
    ] = 10.0,
    start: Annotated[str | None, typer.Option("--start", help="First instant (UTC) of a series.")] = None,
    stop: Annotated[str | None, typer.Option("--stop", help="Last instant (UTC) of a series.")] = None,
    step_h: Annotated[
        str | None,
        typer.Option(
            "--step-h",
            metavar="DURATION",
            help="Minimum time between instants: hours, or text such as '2 d'. Default: all instants; 24 h for a synthetic"
            " ocean.",
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """Compute an atlas, or complete an interrupted one."""
    check_output(out, [".nc"], inputs=[Path(name) for name in files], force=True)
    if pair:
        pairs = [parse_pair("--pair", text, "m") for text in pair]
    else:
        pairs = list(combinations_with_replacement(_numbers("--depths", depths), 2))
    corners = None if window is None else _numbers("--window", window, 4)
    from pymantaray.atlas import Atlas, AtlasLinks, open_atlas, run_atlas, safety_table
    from pymantaray.atlas.plan import instants_between
    from pymantaray.water.water import configuration_of

    config = configuration_of(files, replace(water, time=None).keys | search.keys)
    acoustics = config.acoustics
    links = AtlasLinks(
        pairs=tuple(pairs),
        distances=_numbers("--distances", distances),
        bearings=bearings,
        nominal_sound_speed=nominal,
        safe=_numbers("--safe", safe),
        within_db=within_db,
        max_surface_bounces=acoustics.max_surface_bounces,
        max_bottom_bounces=acoustics.max_bottom_bounces,
        spreading_cutoff_db=acoustics.cutoff_db,
        tolerance=search.tolerance,
        interpolation=acoustics.interpolation,
    )
    if (start is None) != (stop is None) or (start is not None and water.time):
        raise AtlasError("--start and --stop must be used together and without --time")
    if step_h is not None and start is None:
        raise AtlasError("--step-h needs --start and --stop; give both")
    step = None if step_h is None else parse_duration("--step-h", step_h, "h")
    between = start is not None and stop is not None
    atlas = Atlas(
        config,
        links,
        window=None if corners is None else (corners[0], corners[1], corners[2], corners[3]),
        every=every,
        times=instants_between(config.ocean.source, str(start), str(stop), step)
        if between
        else water.time or None,
    )
    with printer(as_json=as_json, quiet=quiet, to=to) as printed:
        n, columns, rows = atlas.shape
        instants = "1 instant" if n == 1 else f"{n} instants"
        blocks = "1 block" if len(atlas.blocks) == 1 else f"{len(atlas.blocks)} blocks"
        printed.line(f"{columns} x {rows} columns, {instants}, {links.count} links each; {blocks}")
        printed.add(columns_lat=columns, columns_lon=rows, instants=n, links=links.count)
        with counted_progress("blocks", quiet=quiet) as progress:
            run_atlas(atlas, out, client=scheduler, workers=workers, force=force, progress=progress)
        with open_atlas(out) as dataset:
            printed.table(_safety(safety_table(dataset)))
        printed.paths(file=out)


@app.command()
def show(file: AtlasFile, as_json: Json = False, to: To = "text") -> None:
    """Print range errors and safe locations by convention and distance."""
    from pymantaray.atlas import open_atlas, safety_table

    with open_atlas(file) as dataset, printer(as_json=as_json, to=to) as printed:
        printed.line(dataset.attrs["title"], title=dataset.attrs["title"])
        printed.table(_safety(safety_table(dataset)))


@app.command()
def plot(
    file: AtlasFile,
    out: Annotated[Path, typer.Option("--out", help="Folder for the figures, PNG and PDF, and the page.")],
    convention: Annotated[
        str,
        typer.Option("--convention", help="Sound speed: transmitter, receiver, mean, chord or nominal."),
    ] = "transmitter",
    distance: Annotated[
        float | None,
        typer.Option(
            "--distance",
            parser=quantity("m"),
            metavar="M",
            help="A distance of the atlas. Default: the middle one.",
        ),
    ] = None,
    pair: Annotated[
        str | None,
        typer.Option("--pair", metavar="M,M", help="A pair of depths of the atlas. Default: all."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="LAT,LON", help="Place of the time series, for an atlas with several instants."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Draw maps of safe distances, errors and lost paths, time series of the error, and an interactive page."""
    from pymantaray.atlas import open_atlas
    from pymantaray.cli.output import progress_bars
    from pymantaray.report import write_atlas_page, write_atlas_plots

    place = None if at is None else parse_pair("--at", at)
    depths = None if pair is None else parse_pair("--pair", pair, "m")
    with open_atlas(file) as dataset, progress_bars(quiet=quiet) as progress:
        paths = write_atlas_plots(
            dataset,
            out,
            convention=convention,
            distance=distance,
            pair=depths,
            place=place,
            progress=progress,
        )
        page = write_atlas_page(dataset, paths, out)
    for path in (*paths, page):
        typer.echo(str(path))


def _numbers(option: str, text: str, count: int | None = None) -> tuple[float, ...]:
    """Parse numbers separated by commas."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if not numbers or (count is not None and len(numbers) != count):
        many = "numbers" if count is None else f"{count} numbers"
        raise AtlasError(f"{option} is {text!r}; it must be {many} separated by commas")
    return numbers


def _safety(table: "pd.DataFrame") -> "ResultTable":
    from pymantaray.records.result_table import ResultTable

    caption = "Maximum error of a location, and percentage of locations below each threshold"
    return ResultTable("safety", table, caption)
