"""Commands of `mantaray atlas`; what they need is imported when they run, so that help is quick."""

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

app = Commands(cls=RunGroup, help="The bias of straight-line ranging in every column of an ocean.")

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
            "--out", metavar="ATLAS.nc", help="What is done of it, in ATLAS.nc.blocks, is not done again."
        ),
    ],
    every: Annotated[int, typer.Option("--every", min=1, help="Every n-th column each way.")] = 1,
    window: Annotated[
        str | None,
        typer.Option("--window", metavar="S,N,W,E", help="Columns, in degrees; water beyond is still read."),
    ] = None,
    depths: Annotated[
        str,
        typer.Option("--depths", metavar="M,...", help="All pairs of these depths, the transmitter above."),
    ] = "20,200,800",
    pair: Annotated[
        list[str] | None,
        typer.Option(
            "--pair", metavar="M,M", help="Depths of transmitter and receiver; repeated; instead of --depths."
        ),
    ] = None,
    distances: Annotated[
        str, typer.Option("--distances", metavar="M,...", help="Horizontal distances in metres, rising.")
    ] = "2000,5000,10000",
    bearings: Annotated[
        int, typer.Option("--bearings", min=1, help="Directions, evenly spaced from north.")
    ] = 4,
    nominal: Annotated[
        float,
        typer.Option(
            "--nominal",
            parser=quantity("m/s"),
            metavar="M/S",
            help="The one sound speed where nothing is measured.",
        ),
    ] = 1500.0,
    safe: Annotated[
        str, typer.Option("--safe", metavar="M,...", help="Range errors that are put up with, rising.")
    ] = "1,5,20",
    within_db: Annotated[
        float, typer.Option("--within-db", help="Count arrivals so much weaker than the strongest, or less.")
    ] = 10.0,
    start: Annotated[str | None, typer.Option("--start", help="First instant (UTC) of a series.")] = None,
    stop: Annotated[str | None, typer.Option("--stop", help="Last instant (UTC) of a series.")] = None,
    step_h: Annotated[
        str | None,
        typer.Option(
            "--step-h",
            metavar="DURATION",
            help="Time between instants at least: hours, or such as '2 d'. Default: all; of a synthetic ocean 24 h.",
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """Compute an atlas, or what is left of it."""
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
        raise AtlasError("--start and --stop belong together, and exclude --time")
    if step_h is not None and start is None:
        raise AtlasError("--step-h: there are steps from --start to --stop alone; give both")
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
    """Print how much of an atlas is safe, by convention and distance."""
    from pymantaray.atlas import open_atlas, safety_table

    with open_atlas(file) as dataset, printer(as_json=as_json, to=to) as printed:
        printed.line(dataset.attrs["title"], title=dataset.attrs["title"])
        printed.table(_safety(safety_table(dataset)))


@app.command()
def plot(
    file: AtlasFile,
    out: Annotated[Path, typer.Option("--out", help="Folder for the figures, PNG and PDF, and the page.")],
    convention: Annotated[
        str, typer.Option("--convention", help="transmitter, receiver, mean, chord or nominal.")
    ] = "transmitter",
    distance: Annotated[
        float | None,
        typer.Option(
            "--distance",
            parser=quantity("m"),
            metavar="M",
            help="One of the atlas'. Default: the middle one.",
        ),
    ] = None,
    pair: Annotated[
        str | None, typer.Option("--pair", metavar="M,M", help="One of its pairs of depths. Default: all.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="LAT,LON", help="Place of the series, where there are several instants."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Draw maps of where ranging is safe, of the error and of lost paths, the error through time, and a page to look around."""
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
    """Numbers with commas between."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if not numbers or (count is not None and len(numbers) != count):
        many = "numbers" if count is None else f"{count} numbers"
        raise AtlasError(f"{option} is {text!r}; needs {many} with commas between")
    return numbers


def _safety(table: "pd.DataFrame") -> "ResultTable":
    from pymantaray.records.result_table import ResultTable

    caption = "Largest error of a place, and share of the places where it is below a threshold"
    return ResultTable("safety", table, caption)
