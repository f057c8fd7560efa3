"""Commands `mantaray rays compare-bellhop` and `write-bellhop`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.apps.bellhop.options import BellhopOptions
from pymantaray.arrays import Array
from pymantaray.cli.groups import Fields, with_options
from pymantaray.cli.options import (
    LINKS,
    OUTPUT,
    Force,
    PrintOptions,
    SourceOptions,
    WaterOptions,
    parse_duration,
)
from pymantaray.cli.printing import Printer, printer
from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    import pandas as pd

    from pymantaray.acoustics import Medium
    from pymantaray.sensing.water import Water

Refine = Annotated[int, typer.Option(min=1, help="Subdivision of each cell of a smooth ocean.")]


@dataclass(frozen=True)
class ProgramOptions:
    """Program of Bellhop and its input."""

    refine: Refine = 4
    program: Annotated[
        str | None,
        typer.Option(
            metavar="PROGRAM",
            help="bellhopcxx or bellhop3d, a name or a file. Default: the first that is installed.",
        ),
    ] = None
    timeout: Annotated[
        str,
        typer.Option(
            metavar="DURATION",
            help="Time limit of one run of Bellhop.",
        ),
    ] = "10 min"


@with_options
def compare_bellhop(
    links: Annotated[Path, LINKS],
    out: Annotated[
        Path, typer.Option(metavar="OUT.csv", help="Table to write.", rich_help_panel=OUTPUT)
    ],
    source: SourceOptions,
    water: WaterOptions,
    bellhop: ProgramOptions,
    options: Annotated[BellhopOptions, Fields("step")],
    printing: PrintOptions,
    force: Force = False,
) -> None:
    """
    Run Bellhop on every link and compare its first direct travel times with those of MantaRay.
    """
    from pymantaray.apps.bellhop import compare_with_bellhop
    from pymantaray.apps.rays.tables import read_links, write_table
    from pymantaray.cli.output import check_output, progress_bars
    from pymantaray.cli.water import water_notes

    check_output(out, (".csv",), inputs=[links, *source.files, *water.files], force=force)
    content = read_links(links)
    straight, opened = _straight_medium(source, water, bellhop.refine)
    start, receiver = content.places(opened.frame)
    with progress_bars(quiet=printing.quiet) as progress:
        table = compare_with_bellhop(
            straight,
            start,
            receiver,
            options,
            program=bellhop.program,
            timeout=parse_duration("--timeout", bellhop.timeout),
            progress=progress,
        )
    write_table(table, out)
    with printing.printer() as printed:
        printed.notes(water_notes(opened))
        _summarize(printed, table)
        printed.paths(file=out)


@with_options
def write_bellhop(
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder for the files.", rich_help_panel=OUTPUT)
    ],
    source: SourceOptions,
    water: WaterOptions,
    options: Annotated[BellhopOptions, Fields("beams", "step", run="--write", bottom="--sea-bed")],
    links: Annotated[Path | None, LINKS] = None,
    link: Annotated[
        list[int] | None,
        typer.Option(metavar="ROW", help="Row of the run's links.nc. May be repeated."),
    ] = None,
    refine: Refine = 4,
    force: Force = False,
) -> None:
    """Write links and their ocean as BELLHOP3D input files: .env, .ssp and .bty."""
    from pymantaray.apps.bellhop import write_bellhop as write_files
    from pymantaray.apps.rays.tables import read_links
    from pymantaray.cli.water import water_notes

    if (links is None) == (link is None):
        raise AcousticsError("write-bellhop: no links; give LINKS.csv, or --run with --link ROW")
    there = sorted(out.glob("link*.env"))
    if there and not force:
        raise AcousticsError(f"{there[0]}: already exists; give another folder or --force")
    straight, opened = _straight_medium(source, water, refine)
    if links is not None:
        start, receiver = read_links(links).places(opened.frame)
    else:
        start, receiver = _links_of_run(source.run, link or [])
    paths = write_files(out, straight, start, receiver, options)
    with printer() as printed:
        printed.notes(water_notes(opened))
        printed.paths(*paths)


def _straight_medium(
    source: SourceOptions, options: WaterOptions, refine: int
) -> "tuple[Medium, Water]":
    """Linear medium, or a smooth medium sampled on finer cells, and its water."""
    from pymantaray.apps.bellhop import linear_medium
    from pymantaray.cli.water import load_water

    water = load_water(source, options, default="linear")
    medium, _ = water.at_start
    if medium.interpolation == "smooth":
        medium = linear_medium(medium, horizontal=refine, vertical=refine)
    return medium, water


def _links_of_run(run: Path | None, rows: list[int]) -> "tuple[Array, Array]":
    """True positions of both ends of links in a study's run."""
    import numpy as np

    from pymantaray.apps.study import open_run

    if run is None:
        raise AcousticsError("--link needs a run; name it with --run FOLDER")
    results = open_run(run)
    links = results.links
    still = results.measurements.landmark_position
    wrong = [row for row in rows if not 0 <= row < links.sample.size]
    if wrong:
        raise AcousticsError(
            f"--link is {wrong[0]}; the run has links 0 to {links.sample.size - 1}"
        )
    places = [np.concatenate([results.truth.position[:, links.sample[row]], still]) for row in rows]
    source, receiver = (
        np.array([place[who[row]] for place, row in zip(places, rows, strict=True)])
        for who in (links.first, links.second)
    )
    return source, receiver


def _summarize(out: Printer, table: "pd.DataFrame") -> None:
    both = table["difference_us"].dropna()
    ours, theirs = (
        int(table[name].notna().sum()) for name in ("travel_time_s", "bellhop_travel_time_s")
    )
    out.line(
        f"{len(table)} links: {ours} with a direct arrival of MantaRay, {theirs} of Bellhop",
        links=len(table),
        direct_arrivals=ours,
        bellhop_direct_arrivals=theirs,
    )
    if len(both):
        spread = {
            "median": both.median(),
            "rms": (both**2).mean() ** 0.5,
            "least": both.min(),
            "greatest": both.max(),
        }
        out.line(
            "Bellhop minus MantaRay [us]: median {median:+.2f}, rms {rms:.2f},"
            " extremes {least:+.2f} to {greatest:+.2f}".format(**spread),
            bellhop_minus_ours_us=spread,
        )
    cpu = {"cpu_ms": table["cpu_ms"].mean(), "bellhop_cpu_ms": table["bellhop_cpu_ms"].median()}
    out.line(
        "CPU per link [ms]: {cpu_ms:.3f} MantaRay, {bellhop_cpu_ms:.0f} Bellhop (median)".format(
            **cpu
        ),
        **cpu,
    )


COMMANDS = {"rays compare-bellhop": compare_bellhop, "rays write-bellhop": write_bellhop}
