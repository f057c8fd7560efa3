"""Commands of `mantaray graph`: other people's factor graphs, shown, solved and converted."""

import glob
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Other people's factor graphs: show, solve, convert.", no_args_is_help=True)


class Start(StrEnum):
    """Where a solve begins."""

    FILE = "file"
    DEAD_RECKONING = "dead-reckoning"


In = Annotated[Path, typer.Argument(metavar="FILE", help="PyFactorGraph text, or g2o if it ends in .g2o.")]
LeaveOut = Annotated[
    list[str] | None,
    typer.Option(
        "--leave-out",
        metavar="WORD",
        help="Lines of the input to lose on purpose, counted: the word that begins them, as EDGE_SE3_XYZ; or all that"
        " can be left out. May be given several times.",
    ),
]
LeaveOutToo = Annotated[
    list[str] | None,
    typer.Option(
        "--leave-out",
        metavar="WHAT",
        help="What to lose on purpose, counted: a word that begins lines of the input, as EDGE_SE3_XYZ; what a g2o"
        " file cannot hold, as ranges; or all. May be given several times.",
    ),
]
HalfAngles = Annotated[
    bool,
    typer.Option(
        "--half-angles",
        help="g2o: the rotation part of the information is for half the angle, as g2o has it.",
    ),
]


@app.command()
def show(file: In, leave_out: LeaveOut = None, half_angles: HalfAngles = False) -> None:
    """Print what is in a graph, and whether it can be solved."""
    from pymantaray.cli.graph_tables import describe
    from pymantaray.estimation.diagnose import diagnose
    from pymantaray.estimation.graph import check_anchored, check_values
    from pymantaray.study.external import open_graph

    content = open_graph(file, leave_out=_of_input(file, leave_out), half_angles=half_angles)
    for name, text in describe(content):
        typer.echo(f"{name:<18} {text}")
    check_values(content.graph, content.values)
    check_anchored(content.graph)
    weak = diagnose(content.graph, content.values)
    typer.echo(f"{'determined':<18} {'yes' if weak is None else 'no: ' + weak}")


@app.command()
def solve(
    file: In,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the results; must be new or empty.")
    ] = None,
    start: Annotated[
        Start, typer.Option("--start", help="Start from the file's vertices, or from composed edges.")
    ] = Start.FILE,
    estimator: Annotated[
        str,
        typer.Option(
            "--estimator",
            help="batch (least squares), incremental (iSAM2), or batch with a robust loss on the ranges: huber, cauchy,"
            " geman-mcclure, gnc.",
        ),
    ] = "batch",
    anchor: Annotated[
        bool, typer.Option("--anchor", help="Give a prior to the first pose of each part that floats.")
    ] = False,
    truth: Annotated[
        bool | None,
        typer.Option(
            "--truth/--no-truth", help="Whether the vertices are the ground truth. Default: not in g2o files."
        ),
    ] = None,
    leave_out: LeaveOut = None,
    half_angles: HalfAngles = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No summary.")] = False,
) -> None:
    """Estimate all trajectories of a graph; with --out, as TUM and NetCDF files with a summary."""
    from pymantaray.cli.graph_tables import print_result
    from pymantaray.errors import EstimationError
    from pymantaray.export import write_graph_tum
    from pymantaray.study.external import G2O, open_graph, solve_graph
    from pymantaray.study.store import staged_folder

    content = open_graph(file, leave_out=_of_input(file, leave_out), half_angles=half_angles)
    with ExitStack() as stack:
        folder = (
            None if out is None else stack.enter_context(staged_folder(out))[0]
        )  # refused before the solve
        result = solve_graph(
            content,
            estimator=estimator,
            start=start.value,
            anchor=anchor,
            truth=file.suffix != G2O if truth is None else truth,
        )
        if folder is not None:
            result.save(folder)
            tables = {"start": result.initial, "truth": result.truth}
            if result.solution.usable:
                tables["estimate"] = result.values
            for name, values in tables.items():
                if values is not None:
                    write_graph_tum(folder / f"{name}.tum", result.graph, values)
    if not quiet:
        print_result(result)
    if out is not None:
        typer.echo(str(out))
    if result.diagnosis is not None:
        raise EstimationError(f"{file}: {result.diagnosis}")


@app.command()
def convert(
    file: In,
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="OUT.pyfg, OUT.g2o, or OUT.tum for the vertices (OUT-A.tum, ... if there are several vehicles).",
        ),
    ],
    leave_out: LeaveOutToo = None,
    half_angles: HalfAngles = False,
    symbols: Annotated[
        bool,
        typer.Option("--symbols", help="g2o out: ids are GTSAM symbols, which keep vehicle and pose number."),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the output if it exists.")] = False,
) -> None:
    """Convert between PyFactorGraph text, g2o and TUM; what the target cannot hold is refused unless left out."""
    from pymantaray.cli.output import check_output
    from pymantaray.estimation import write_pyfg
    from pymantaray.estimation.g2o import LEFT_OUT, write_g2o
    from pymantaray.export import write_graph_tum
    from pymantaray.study.external import G2O, open_graph

    check_output(out, (".pyfg", G2O, ".tum"), inputs=[file], beside=_of_vehicles(out), force=force)
    given = leave_out or []
    words = _of_input(file, [what for what in given if what not in LEFT_OUT])
    content = open_graph(file, leave_out=words, half_angles=half_angles)
    lost, files = dict(content.left_out), [out]
    if out.suffix == G2O:
        agreed = LEFT_OUT if "all" in given else [what for what in given if what in LEFT_OUT]
        lost |= write_g2o(
            content.graph,
            out,
            initial=content.values,
            leave_out=agreed,
            symbols=symbols,
            half_angles=half_angles,
        )
    elif out.suffix == ".tum":
        files = write_graph_tum(out, content.graph, content.values)
    else:
        write_pyfg(content.graph, out, initial=content.values)
    for what, count in lost.items():
        typer.echo(f"left out: {count} {what}", err=True)
    for path in files:
        typer.echo(str(path))


def _of_vehicles(out: Path) -> list[Path]:
    """Files of single vehicles that are there already where trajectories are to be written."""
    return sorted(out.parent.glob(f"{glob.escape(out.stem)}-[A-Z].tum")) if out.suffix == ".tum" else []


def _of_input(file: Path, leave_out: list[str] | None) -> list[str]:
    """Words that begin lines of the input file, without ``all``, which stands for those of PyFactorGraph text."""
    from pymantaray.study.external import G2O

    given = leave_out or []
    words = [what for what in given if what != "all"]
    return ["EDGE_SE3_XYZ", *words] if "all" in given and file.suffix != G2O else words
