"""Commands of `mantaray rays`: travel times, eigenrays and paths between the positions of a table."""

from pathlib import Path
from typing import Annotated

import typer

from pymantaray.cli.options import OceanCommand
from pymantaray.cli.rays_bellhop import compare_bellhop, write_bellhop
from pymantaray.cli.rays_options import MediumOptions, SearchOptions, with_options

app = typer.Typer(help="Travel times and rays between your own positions.", no_args_is_help=True)

In = Annotated[
    Path,
    typer.Argument(
        metavar="IN.csv",
        help="Columns source_north, source_east, source_depth, receiver_north, receiver_east, receiver_depth, all in"
        " metres; one link a row.",
    ),
]
Out = Annotated[Path, typer.Argument(metavar="OUT.csv", help="Table to write; OUT.nc for NetCDF.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite the output if it exists.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress bar and no summary.")]


@app.command(cls=OceanCommand)
@with_options
def times(
    links: In,
    out: Out,
    medium: MediumOptions,
    search: SearchOptions,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Travel time of the earliest arrival of each link, and why there is none."""
    from pymantaray.cli.rays_run import begin, finish, solve
    from pymantaray.cli.rays_tables import times_table

    job = begin("times", links, out, medium, search, force=force, quiet=quiet)
    arrivals = solve(job)
    if out.suffix == ".nc":
        finish(job, arrivals.first().to_dataset(), status=arrivals.status)
    else:
        finish(job, times_table(job.table.text, job.source, job.receiver, arrivals), status=arrivals.status)


@app.command(cls=OceanCommand)
@with_options
def eigen(
    links: In,
    out: Out,
    medium: MediumOptions,
    search: SearchOptions,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Every arrival of each link: time, bounces, angles, spreading and slowness."""
    from pymantaray.cli.rays_run import begin, finish, solve
    from pymantaray.cli.rays_tables import arrivals_table

    job = begin("eigen", links, out, medium, search, force=force, quiet=quiet)
    arrivals = solve(job)
    result = arrivals.to_dataset() if out.suffix == ".nc" else arrivals_table(job.table.text, arrivals)
    finish(job, result, status=arrivals.status, found=f"{arrivals.link.size} arrivals")


@app.command(cls=OceanCommand)
@with_options
def trace(
    links: In,
    out: Out,
    medium: MediumOptions,
    search: SearchOptions,
    fan: Annotated[
        tuple[float, float, int] | None,
        typer.Option(
            metavar="FROM TO COUNT",
            help="Trace so many rays launched between two angles in degrees, positive down, instead of eigenrays.",
        ),
    ] = None,
    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEG", help="Direction of the fan, clockwise from north. Default: to the receiver."
        ),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(metavar="M", help="Horizontal length of the fan in metres. Default: to the receiver."),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Path of each eigenray, or of a fan of rays from each source, node by node."""
    from pymantaray.cli.rays_run import begin, finish, trace_arrivals, trace_fans
    from pymantaray.cli.rays_tables import paths_dataset, paths_table

    job = begin(
        "trace",
        links,
        out,
        medium,
        search,
        force=force,
        quiet=quiet,
        fan=fan,
        azimuth=azimuth,
        distance=distance,
    )
    rays, status = trace_arrivals(job) if job.fan is None else (trace_fans(job, job.fan), None)
    result = paths_dataset(rays) if out.suffix == ".nc" else paths_table(rays)
    finish(job, result, status=status, found=f"{rays.row.size} rays, {rays.paths.arrival.size} nodes")


app.command("compare-bellhop", cls=OceanCommand)(compare_bellhop)
app.command("write-bellhop", cls=OceanCommand)(write_bellhop)
