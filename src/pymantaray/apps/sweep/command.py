"""Commands of `mantaray sweep`; they import modules when they run, which keeps the help fast."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import (
    OUTPUT,
    Commands,
    Force,
    Json,
    PrintOptions,
    ProcessOptions,
    RunGroup,
    Set,
    changes_of,
)
from pymantaray.cli.output import check_output, counted_progress, duration, resumable
from pymantaray.cli.printing import LOG, Printer, printer

if TYPE_CHECKING:
    from pymantaray.apps.sweep.estimate import Estimate
    from pymantaray.apps.sweep.plan import SweepPlan
    from pymantaray.apps.sweep.results import Status

app = Commands(cls=RunGroup, help="Run many studies that differ in some keys.")

EXIT_POINTS_FAILED = 1
_MAX_REASONS = 5  # reasons of failed points in the output

SweepFile = Annotated[
    Path, typer.Argument(callback=existing(), metavar="FILE", help="A sweep in TOML.")
]
Place = Annotated[str, typer.Argument(metavar="FOLDER", help="Folder or URL of a sweep's results.")]


@app.command()
def show(
    file: SweepFile,
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="FOLDER|URL",
            help="Folder or URL of results; finished points are not counted.",
        ),
    ] = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Run the first point to estimate the time.")
    ] = False,
    workers: Annotated[
        int, typer.Option("--workers", min=1, help="Number of workers for the estimated time.")
    ] = 1,
    changes: Set = None,
    as_json: Json = False,
) -> None:
    """Show points, shared stages, and estimated time and disk space."""
    from pymantaray.apps.sweep import load_sweep, open_sweep
    from pymantaray.apps.sweep.estimate import cost_of, estimate, known_cost, measured_cost
    from pymantaray.apps.sweep.keys import finished
    from pymantaray.apps.sweep.plan import SweepPlan
    from pymantaray.jobs.store import open_store

    sweep = load_sweep(file, **changes_of(changes))
    plan = SweepPlan(sweep)
    with printer(as_json=as_json) as printed:
        printed.line(f"{sweep.name}: {len(sweep)} points", name=sweep.name, points=len(sweep))
        axes = [dict(axis.coordinates()) for axis in sweep.axes]
        printed.add(axes=axes)
        for name, values in (pair for axis in axes for pair in axis.items()):
            listed = ", ".join(f"{value}"[:40] for value in values[:8])
            printed.line(f"  {name}: {listed}{f', ... ({len(values)})' if len(values) > 8 else ''}")
        cost = None
        points = set(plan.points)
        if out is not None:
            done, failed = finished(open_store(out), points)
            points -= done | failed
            printed.line(
                f"of these {len(done)} done, {len(failed)} failed, {len(points)} open in {out}",
                done=len(done),
                failed=len(failed),
            )
            cost = cost_of(open_sweep(out).contents) if done else None
        if measure:
            cost = measured_cost(sweep)
        _print_estimate(
            printed, plan, points, estimate(plan, points, cost or known_cost(sweep)), workers
        )


def _print_estimate(
    out: Printer, plan: "SweepPlan", points: set[str], what: "Estimate", workers: int
) -> None:
    from pymantaray.apps.sweep.keys import STAGES

    counts = {stage: plan.count(stage, points) for stage in STAGES} | {"points": len(points)}
    listed = ", ".join(f"{stage} {count}" for stage, count in counts.items())
    out.line(f"to do: {listed}; shared stages are computed once", to_do=counts)
    shared = what.seconds / workers
    alone = what.unshared_seconds / workers
    many = f"{workers} worker{'' if workers == 1 else 's'}"
    out.line(
        f"time: about {duration(shared)} on {many}, {duration(alone)} without shared stages;"
        f" estimated from {what.origin}",
        workers=workers,
        time_s=shared,
        unshared_time_s=alone,
        estimated_by=what.origin,
    )
    size = "" if what.stage_bytes is None else f", {what.stage_bytes / 1e6:.3g} MB for one of each"
    out.line(
        f"disk space: {len(points)} files of results, {what.point_bytes / 1e6:.3g} MB; temporarily"
        f" at most {len(plan.shared)} oceans, fleets and rays{size}",
        results_bytes=what.point_bytes,
        shared_bytes=what.stage_bytes,
        shared_files=len(plan.shared),
    )


@dataclass(frozen=True)
class PointOptions:
    """Points to compute, and stages and folders to keep."""

    studies: Annotated[
        bool, typer.Option("--studies", help="Keep the run folder of each point.")
    ] = False
    keep_stages: Annotated[
        bool, typer.Option("--keep-stages", help="Keep oceans, fleets and rays for later sweeps.")
    ] = False
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Compute failed points again.")
    ] = False


@app.command()
@with_options
def run(
    file: SweepFile,
    out: Annotated[
        str,
        typer.Option(
            metavar="FOLDER|URL",
            help="Folder or URL of the results. Finished points are skipped.",
            rich_help_panel=OUTPUT,
        ),
    ],
    points: PointOptions,
    processes: ProcessOptions,
    printing: PrintOptions,
    changes: Set = None,
) -> None:
    """Compute the points that are not finished; exit with 1 if some fail."""
    from pymantaray.apps.sweep import load_sweep

    sweep = load_sweep(file, **changes_of(changes))
    # the import takes seconds, so the file is read first
    from pymantaray.apps.sweep import run_sweep

    with (
        resumable(lambda: f"the same command resumes with the points that are not in {out}"),
        counted_progress("points", quiet=printing.quiet) as progress,
    ):
        results = run_sweep(
            sweep,
            out,
            client=processes.scheduler,
            workers=processes.workers,
            progress=progress,
            **asdict(points),
        )
    status = results.status()
    with printing.printer() as printed:
        printed.notes(results.notes)
        _print_status(printed, out, status)
        printed.paths(folder=out)
    if status.failed:
        raise typer.Exit(EXIT_POINTS_FAILED)


@app.command()
def status(folder: Place, as_json: Json = False) -> None:
    """Count finished, failed and open points; exit with 1 if some failed."""
    from pymantaray.apps.sweep import open_sweep

    counts = open_sweep(folder).status()
    with printer(as_json=as_json) as printed:
        _print_status(printed, folder, counts)
    if counts.failed:
        raise typer.Exit(EXIT_POINTS_FAILED)


@app.command()
def collect(
    folder: Place,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Table to write, .csv or .nc. Default: both, and a page, in FOLDER.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write one table of all points as CSV and NetCDF, and an interactive page."""
    from pymantaray.apps.sweep import open_sweep
    from pymantaray.records import whole_file, write_netcdf
    from pymantaray.records.csv_text import csv_text

    results = open_sweep(folder)
    page = out is None and "://" not in folder
    if out is not None:
        check_output(out, (".csv", ".nc"), force=force)
    elif "://" in folder:
        out = Path("sweep.csv")
        check_output(out, (".csv",), force=force)
    outputs = [out] if out is not None else [Path(folder, "table.csv"), Path(folder, "table.nc")]
    for path in outputs:
        if path.suffix == ".nc":
            write_netcdf(results.dataset(), path)
        else:
            with whole_file(path) as temporary:
                temporary.write_text(csv_text(results.table()), encoding="utf-8")
        typer.echo(str(path))
    if page:
        from pymantaray.apps.sweep import write_sweep_page

        written = write_sweep_page(
            results.table(),
            [name for axis in results.sweep.axes for name in axis.coordinates()],
            folder,
            title=results.sweep.name,
            notes=results.notes,
            synthetic=results.synthetic,
            origin=results.origin,
        )
        typer.echo(str(written))


def _print_status(out: Printer, place: str, status: "Status") -> None:
    out.line(
        f"{place}: {status.done} done, {status.failed} failed, {status.open} open of"
        f" {status.points} points",
        done=status.done,
        failed=status.failed,
        open=status.open,
        points=status.points,
        failures=[{"reason": line, "points": count} for line, count in status.failures.items()],
    )
    for line, count in list(status.failures.items())[:_MAX_REASONS]:
        LOG.warning("failed: %d x %s", count, line)
    if len(status.failures) > _MAX_REASONS:
        LOG.warning(
            "failed: %d more reasons; mantaray sweep collect lists all",
            len(status.failures) - _MAX_REASONS,
        )


COMMANDS = {"sweep": app}
