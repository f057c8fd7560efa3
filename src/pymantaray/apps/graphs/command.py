"""Commands of `mantaray graph`: show, solve and convert factor graphs from files."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import OUTPUT, Commands, Force, Json, TableOptions
from pymantaray.cli.output import EXIT_UNUSABLE
from pymantaray.cli.printing import LOG, Printer, printer

if TYPE_CHECKING:
    from pymantaray.apps.graphs import GraphResult
    from pymantaray.estimation.graph.pyfg import GraphFile

app = Commands(help="Show, solve and convert factor graphs from files.")


In = Annotated[
    Path,
    typer.Argument(callback=existing(), metavar="FILE", help="PyFactorGraph text, g2o or TORO."),
]


@dataclass(frozen=True)
class GraphReadOptions:
    """Reading of a graph's file."""

    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHAT",
            help="Record types to drop; the number dropped is reported. A word that begins lines"
            " of the input, such as EDGE_SE3_XYZ; a kind that g2o output cannot hold, such as"
            " ranges; or all. May be given several times.",
        ),
    ] = None
    skip_unknown: Annotated[
        bool, typer.Option("--skip-unknown", help="Skip and count lines of unknown words.")
    ] = False
    half_angles: Annotated[
        bool,
        typer.Option(
            "--half-angles",
            help="g2o: the rotation part of the information is for half the angle, as g2o defines"
            " it.",
        ),
    ] = False
    isam: Annotated[
        bool,
        typer.Option(
            "--isam",
            help="Matrices of EDGE2 are those of iSAM, the upper triangular root of the"
            " information by rows.",
        ),
    ] = False
    indefinite: Annotated[
        Literal["refuse", "drop", "repair"],
        typer.Option(
            help="Treatment of lines whose matrix is not positive definite; the number dropped or"
            " repaired is reported."
        ),
    ] = "refuse"

    covariances: Annotated[
        Literal["full", "isotropic"],
        typer.Option(
            help="Covariances of the file, or isotropic ones as PyFactorGraph reads them: the mean"
            " variance of each translation and of each rotation, and no depths."
        ),
    ] = "full"

    def open(self, file: Path) -> "GraphFile":
        """Open a graph's file."""
        from pymantaray.apps.graphs import open_graph

        return open_graph(file, **asdict(self) | {"leave_out": self.leave_out or []})


@dataclass(frozen=True)
class GraphSolveOptions:
    """Estimator, starts, anchor and truth of a graph."""

    start: Annotated[
        Literal["file", "dead-reckoning", "chordal", "best"] | None,
        typer.Option(
            help="Start from the file's vertices, from composed edges, from linear least squares"
            " of all edges, or from all of these and take the lowest cost (best). Default: best"
            " for graphs of at most 20,000 factors and batch estimators, else file."
        ),
    ] = None
    random_starts: Annotated[
        int, typer.Option(min=0, help="Number of further random starts of --start best.")
    ] = 0
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random starts.")] = 0
    certificate: Annotated[
        bool | None,
        typer.Option(
            "--certify/--no-certify",
            help="Certify that the estimate is the global minimum, or give the least eigenvalue of"
            " the certificate matrix. Default: for batch least squares of at most 2,000 factors.",
        ),
    ] = None
    estimator: Annotated[
        str,
        typer.Option(
            metavar="WORD",
            help="batch (least squares), gtsam (the same by GTSAM), incremental (iSAM2), or batch"
            " with a robust loss on the ranges: huber, cauchy, geman-mcclure, tukey, welsch, gnc.",
        ),
    ] = "batch"
    anchor: Annotated[
        bool,
        typer.Option(
            "--anchor",
            help="Add a prior to the first pose of each free part. A graph without any anchor"
            " always gets one.",
        ),
    ] = False
    truth: Annotated[
        bool | None,
        typer.Option(
            "--truth/--no-truth",
            help="The vertices are the ground truth, or not. Default: not in g2o and TORO files.",
        ),
    ] = None

    def solve(
        self, file: Path, content: "GraphFile", report: Callable[[int, float], None] | None
    ) -> "GraphResult":
        """Solve the graph of a file."""
        from pymantaray.apps.graphs import solve_graph
        from pymantaray.apps.graphs.external import is_pose_graph, with_certificate

        options = asdict(self) | {
            "truth": not is_pose_graph(file) if self.truth is None else self.truth
        }
        certificate = options.pop("certificate")
        return with_certificate(solve_graph(content, report=report, **options), wanted=certificate)


@app.command()
@with_options
def show(file: In, reading: GraphReadOptions, as_json: Json = False) -> None:
    """Show the contents of a graph, and whether it can be solved."""
    from pymantaray.apps.graphs.diagnose import diagnose
    from pymantaray.apps.graphs.external import anchor_graph, reading_notes

    content = reading.open(file)
    with printer(as_json=as_json) as out:
        out.notes(reading_notes(content.left_out, content.repaired))
        for name, text in _contents(out, content):
            out.line(f"{name:<18} {text}")
        graph, poses = anchor_graph(content)
        names = [graph.variable_name(int(pose)) for pose in poses]
        held = " with the anchor" if names else ""
        dof = graph.degrees_of_freedom
        out.line(f"{'degrees of freedom':<18} {dof}{held}", degrees_of_freedom=dof)
        if names:
            out.line(f"{'anchor':<18} none; solve gives a prior to {', '.join(names)}")
        weak = diagnose(graph, content.values)
        out.line(
            f"{'determined':<18} {'yes' if weak is None else 'no: ' + weak}",
            without_prior=names,
            determined=weak is None,
            not_determined=weak,
        )


@app.command()
@with_options
def solve(
    file: In,
    reading: GraphReadOptions,
    solving: GraphSolveOptions,
    printing: TableOptions,
    worst: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="List the N factors with the largest whitened residual, leverage and Cook's"
            " distance, except odometry.",
        ),
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder for the results; must be new or empty.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
) -> None:
    """Estimate all trajectories of a graph; with --out, as TUM and NetCDF files with a summary."""
    from pymantaray.cli.output import step_line
    from pymantaray.errors import EstimationError
    from pymantaray.jobs.folder import staged_folder
    from pymantaray.records import SolveStatus

    content = reading.open(file)
    with ExitStack() as stack:
        # refuse before the solve
        folder = None if out is None else stack.enter_context(staged_folder(out))[0]
        with step_line(quiet=printing.quiet) as report:
            try:
                result = solving.solve(file, content, report)
            except EstimationError as error:
                raise EstimationError(f"{file}: {error}") from None
        if result.solution.status is SolveStatus.FAILED:  # there is nothing to write
            raise EstimationError(f"{file}: {result.diagnosis}")
        errors = _errors(result)
        if folder is not None:
            from pymantaray.exchange import write_graph_tum  # takes more time than a small solve

            result.save(folder, more=errors)
            for name, values in result.trajectories.items():
                write_graph_tum(folder / f"{name}.tum", result.graph, values)
    with printing.printer() as printed:
        _print_result(printed, result)
        _print_details(printed, result, errors)
        if worst:
            _print_worst(printed, result, worst)
        if out is not None:
            printed.paths(folder=out)
        if result.diagnosis is not None:
            LOG.error("%s: %s", file, result.diagnosis)
            raise typer.Exit(EXIT_UNUSABLE)


@app.command()
@with_options
def convert(
    file: In,
    reading: GraphReadOptions,
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="OUT.pyfg, OUT.g2o, or OUT.tum for the vertices (OUT-NAME.tum for each of several"
            " vehicles).",
        ),
    ],
    symbols: Annotated[
        bool,
        typer.Option(
            "--symbols", help="g2o out: ids are GTSAM symbols, which keep vehicle and pose number."
        ),
    ] = False,
    force: Force = False,
) -> None:
    """
    Convert between PyFactorGraph text, g2o and TUM; --leave-out drops what the output cannot hold.
    """
    from pymantaray.apps.graphs.external import G2O, reading_notes
    from pymantaray.apps.graphs.g2o import LEFT_OUT, write_g2o
    from pymantaray.cli.output import check_output
    from pymantaray.estimation import write_pyfg
    from pymantaray.estimation.graph.pyfg import names_file
    from pymantaray.exchange import graph_tum_files, write_graph_tum

    endings = (".pyfg", G2O, ".tum")
    beside = [names_file(out)] if out.suffix == ".pyfg" else []
    check_output(out, endings, inputs=[file], beside=beside, force=force)
    to_lose = reading.leave_out or []
    words = [what for what in to_lose if what not in (*LEFT_OUT, "all")]
    content = replace(reading, leave_out=words).open(file)
    lost = dict(content.left_out)
    files = [out]
    if out.suffix == G2O:
        lost |= write_g2o(
            content.graph,
            out,
            initial=content.values,
            leave_out=LEFT_OUT
            if "all" in to_lose
            else [what for what in to_lose if what in LEFT_OUT],
            symbols=symbols,
            half_angles=reading.half_angles,
        )
    elif out.suffix == ".tum":
        files = graph_tum_files(out, content.graph)
        check_output(out, endings, inputs=[file], beside=files, force=force)
        write_graph_tum(out, content.graph, content.values)
    else:
        write_pyfg(content.graph, out, initial=content.values)
        files += [path for path in beside if path.exists()]
    with printer() as printed:
        printed.notes(reading_notes(lost, content.repaired))
        printed.paths(*files)


def _contents(out: Printer, file: "GraphFile") -> list[tuple[str, str]]:
    """Name and text of each line on the contents of a graph; adds the numbers for --json."""
    import numpy as np

    g = file.graph
    vehicle = g.pose_vehicle
    number = g.pose_number.astype(int)
    # odometry is an edge between successive poses of a vehicle, other edges are loop closures
    a, b = g["edge"].variables.T
    same = vehicle[a] == vehicle[b]
    odometry = same & (number[b] - number[a] == 1)
    landmarks = (g["range"].variables >= g.n_poses).sum(axis=1)
    time = g.pose_time
    vehicles = (
        f"{name} ({np.count_nonzero(vehicle == k)} poses)" for k, name in enumerate(g.vehicle_name)
    )
    unary = {t.kind.plural: len(t) for t in g.tables.values() if len(t.kind.ends) == 1}
    priors = [f"{plural} {count}" for plural, count in unary.items() if count]
    counts = [np.count_nonzero(landmarks == k) for k in range(3)]
    lines = [
        ("dimensions", "two" if g.planar else "three"),
        ("vehicles", ", ".join(vehicles)),
        ("landmarks", ", ".join(g.landmark_name.tolist()) or "none"),
        ("times", f"{time.min():g} to {time.max():g} s"),
        ("odometry", f"{np.count_nonzero(odometry)}"),
        (
            "loop closures",
            (
                f"{np.count_nonzero(same & ~odometry)} of one vehicle, {np.count_nonzero(~same)}"
                " between two"
            ),
        ),
        ("sightings", f"{len(g['sighting'])} of landmarks from poses"),
        ("ranges", "{} between poses, {} to landmarks, {} between landmarks".format(*counts)),
        ("priors", ", ".join(priors) or "none"),
    ]
    # the same as numbers, for --json
    out.add(
        dimensions=2 if g.planar else 3,
        vehicles=[
            {"name": name, "poses": np.count_nonzero(vehicle == k)}
            for k, name in enumerate(g.vehicle_name)
        ],
        landmarks=g.landmark_name,
        times_s=[time.min(), time.max()],
        odometry=np.count_nonzero(odometry),
        loop_closures=np.count_nonzero(~odometry),
        sightings=len(g["sighting"]),
        ranges=len(g["range"]),
        priors=unary,
        values_in_file=not file.valueless,
        left_out=file.left_out,
        repaired=dict(file.repaired),
    )
    if file.valueless:
        lines.append(("values", "none in the file; by chordal initialization"))
    return lines


def _print_worst(out: Printer, result: "GraphResult", count: int) -> None:
    """Print the factors with the largest influence on a solution, by each measure."""
    from pymantaray.estimation import LOSSES
    from pymantaray.estimation.solvers.influence import MEASURES, factor_influence, worst_factors

    if not result.solution.usable:
        return
    influence = factor_influence(result.graph, result.values, LOSSES.get(result.estimator))
    for measure, caption in MEASURES.items():
        table = worst_factors(influence, measure, count).drop(columns="successive")
        out.frame(f"largest_{measure}", table, f"Factors with the largest {caption}")


def _errors(result: "GraphResult") -> dict[str, dict[str, dict[str, float]]]:
    """Trajectory errors of the solution and of its start; least squares have standard errors."""
    from pymantaray.evaluation import graph_degrees_of_freedom, graph_errors

    freedom = None
    s = result.solution
    if result.truth is not None and s.usable and result.estimator in ("batch", "incremental"):
        freedom = graph_degrees_of_freedom(result.graph, result.values)
    return {
        "trajectory_error": graph_errors(
            result.graph, replace(s, last_point=None).values, result.truth, freedom
        ),
        "trajectory_error_of_start": graph_errors(result.graph, result.initial, result.truth),
    }


def _print_result(out: Printer, result: "GraphResult") -> None:
    """Print status and costs of a solve."""
    import numpy as np

    solution = result.solution
    expected = (
        f", expected {solution.expected_cost:g}" if np.isfinite(solution.expected_cost) else ""
    )
    out.line(
        f"{result.estimator}, start {result.start}: {result.status},"
        f" {solution.iterations} iterations, cost {solution.initial_cost:.6g} to"
        f" {solution.final_cost:.6g}{expected}",
        estimator=result.estimator,
        start=result.start,
        status=result.status,
        unexplained=result.unexplained,
        iterations=solution.iterations,
        cost=solution.final_cost,
        initial_cost=solution.initial_cost,
        final_cost=solution.final_cost,
        expected_cost=solution.expected_cost,
        advice=result.advice,
        left_out=result.left_out,
        repaired=dict(result.repaired),
    )
    if result.advice is not None:
        out.line(f"{solution.status.name}: {result.advice}")
    out.notes(result.notes)
    names = [result.graph.variable_name(int(pose)) for pose in result.anchored]
    if names:
        out.line(f"anchored because there is no prior: {', '.join(names)}")
    same = result.counts_as_in_file
    if any(same.values()):
        out.line(
            f"started at the file's values, because only ranges constrain them: {same['poses']}"
            f" poses, {same['landmarks']} of {result.graph.landmark_name.size} landmarks"
        )
    out.add(anchored=names, as_in_file=same)


def _print_details(
    out: Printer, result: "GraphResult", errors: dict[str, dict[str, dict[str, float]]]
) -> None:
    """
    Print the cost from each start, a warning of a second plausible minimum, the certificate and,
    if the truth is known, trajectory errors at the start and after the solve.
    """
    if len(result.outcomes) > 1:
        out.frame("starts", result.summary()["starts"], "Solutions from each start")
    out.warn(result.warnings)
    out.add(alternative_start=None if result.alternative is None else result.alternative.name)
    if result.certificate is not None:
        out.line(result.certificate.text, certificate=asdict(result.certificate))
    if result.truth is not None and result.solution.usable:
        before = errors["trajectory_error_of_start"]
        rows = [
            {"vehicle": name, "start_rmse_m": before[name]["rmse_m"], **row}
            for name, row in errors["trajectory_error"].items()
        ]
        brief = [
            "vehicle",
            "n",
            "start_rmse_m",
            "mean_m",
            "rmse_m",
            "rmse_standard_error_m",
            "p95_m",
            "max_m",
        ]
        out.frame(
            "trajectory_error",
            rows,
            "Position error by vehicle, no alignment",
            # a robust loss has no standard errors
            brief=[name for name in brief if any(name in row for row in rows)],
            words={"n": "poses"},
        )


COMMANDS = {"graph": app}
