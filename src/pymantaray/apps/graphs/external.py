"""Read factor graphs from files, solve them, and save the results."""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.graphs.chordal_problem import not_quadratic
from pymantaray.apps.graphs.diagnose import (
    check_conditioned,
    diagnose,
    diagnose_start,
    worst_misfit,
)
from pymantaray.apps.graphs.g2o import ISAM, TORO, load_g2o
from pymantaray.apps.graphs.minima import (
    StartOutcome,
    largest_difference,
    plausible_alternative,
    search_minima,
)
from pymantaray.apps.graphs.staircase import Certificate, certify
from pymantaray.arrays import Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import (
    FactorGraph,
    GraphValues,
    check_anchored,
    check_graph,
    check_values,
    connected_parts,
)
from pymantaray.estimation.graph.pyfactorgraph import isotropic
from pymantaray.estimation.graph.pyfg import GraphFile, load_pyfg, plain_path
from pymantaray.estimation.graph.text import MAX_GRAPH_BYTES, Indefinite
from pymantaray.estimation.solve import METHODS, GraphSolver
from pymantaray.estimation.solvers.descents import lowest
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.solution import GraphSolution, SolveOptions
from pymantaray.estimation.solvers.starts import anchor_loose_parts, chordal, dead_reckon_graph
from pymantaray.evaluation import LARGEST_RATIO, LEAST_RANGE, unexplained
from pymantaray.records import SolveStatus, whole_file, write_netcdf
from pymantaray.records.csv_text import is_number
from pymantaray.records.status import SOLVE_STATUS_WORDS
from pymantaray.user_files import open_text

Covariances = Literal["full", "isotropic"]
"""Treatment of a file's covariances."""
Start = Literal["file", "dead-reckoning", "chordal", "best"]
_STARTS = {"dead-reckoning": dead_reckon_graph, "chordal": chordal}
EstimatorFunction = Callable[[FactorGraph, GraphValues], GraphSolution]

# largest graph that is solved from several starts by default: about 2 s of CPU
MAX_CHEAP_FACTORS = 20_000
MAX_CERTIFIED_FACTORS = 2_000  # largest graph that is certified by default: about 2 s of CPU
G2O = ".g2o"
PYFG = ".pyfg"
_TORO_WORDS = {word for words in TORO.values() for word in words}
_FIRST_WORDS = ("VERTEX", "EDGE", *ISAM.values())
UNEXPLAINED = "UNEXPLAINED"
_COSTS = ("iterations", "initial_cost", "final_cost", "expected_cost", "gradient_norm")


@dataclass(frozen=True, eq=False)
class GraphResult:
    r"""
    Result of an estimator on a graph file.

    ``graph`` includes added priors. ``as_in_file`` lists the variables that start at the file's
    values in spite of another start, because only ranges constrain them: if the file's values are
    the truth, so is that part of the start. ``start`` is chordal if the file has no values.
    ``truth`` is None if the file has none. ``diagnosis`` says in one line why the solution is not
    usable, and is None if it is; ``unexplained`` says it of an optimum that does not explain the
    measurements.

    ``start`` is the name of the start that led to the solution. ``outcomes`` has the solutions from
    all starts, and ``alternative`` the lowest other minimum if its cost is within chi-square of the
    solution's. ``certificate`` is set by `with_certificate`.

    Examples
    --------
    Continues the example of `pymantaray.apps.graphs`:

    >>> from pymantaray.apps.graphs import solve_graph
    >>> result = solve_graph(opened)
    >>> result.start, result.solution.status.name
    ('file', 'OK')
    """

    graph: FactorGraph
    estimator: str
    start: str
    initial: GraphValues
    as_in_file: Indices
    anchored: NDArray[np.int32]
    truth: GraphValues | None
    solution: GraphSolution
    diagnosis: str | None
    left_out: dict[str, int]
    repaired: Mapping[str, int]
    unexplained: str | None = None
    outcomes: tuple[StartOutcome, ...] = ()
    alternative: StartOutcome | None = None
    certificate: Certificate | None = None

    @property
    def values(self) -> GraphValues:
        """
        Estimated values; the last point of a descent that did not converge; NaN if the solve
        failed.
        """
        return self.solution.values

    @property
    def counts_as_in_file(self) -> dict[str, int]:
        """Numbers of poses and of landmarks among ``as_in_file``."""
        poses = int(np.count_nonzero(self.as_in_file < self.graph.n_poses))
        return {"poses": poses, "landmarks": int(self.as_in_file.size) - poses}

    @property
    def status(self) -> str:
        """Status of the solution; `UNEXPLAINED` if it does not explain the measurements."""
        return self.solution.status.name if self.unexplained is None else UNEXPLAINED

    @property
    def usable(self) -> bool:
        """True if the solution is an optimum that explains the measurements."""
        return self.solution.usable and self.unexplained is None

    @property
    def notes(self) -> list[str]:
        """Lines of the file that were left out or repaired."""
        return reading_notes(self.left_out, self.repaired)

    @property
    def advice(self) -> str | None:
        """Advice for a usable solution whose status is not OK."""
        words = SOLVE_STATUS_WORDS.get(self.solution.status)
        return None if words is None else f"{words.meaning}; {words.advice}"

    @property
    def trajectories(self) -> dict[str, GraphValues]:
        """
        Values by name: ``start``, ``estimate`` or an unconverged ``last``, ``alternative`` and
        ``truth`` if known.
        """
        tables = {
            "start": self.initial,
            "estimate": self.values if self.solution.usable else None,
            "last": self.solution.last_point,
            "alternative": None if self.alternative is None else self.alternative.solution.values,
            "truth": self.truth,
        }
        return {name: values for name, values in tables.items() if values is not None}

    @property
    def warning(self) -> str | None:
        """Warning of a second minimum that fits the measurements almost as well."""
        if self.alternative is None:
            return None
        name, far = largest_difference(self.graph, lowest(self.outcomes), self.alternative)
        return (
            f"two minima fit the measurements: cost {self.solution.final_cost:.6g}, and"
            f" {self.alternative.cost:.6g} from start {self.alternative.name}; {name} differs by"
            f" {far:.4g} m: compare both, or add a prior or ranges"
        )

    @property
    def warnings(self) -> list[str]:
        """Warnings of a cost above its bounds, and of a second minimum."""
        s = self.solution
        lines = [] if self.warning is None else [self.warning]
        if s.status is not SolveStatus.OVER_CHI_SQUARE:
            return lines
        over = f"{s.status.name}: the cost is {s.final_cost:.4g}, expected {s.expected_cost:.4g}"
        return [f"{over}; the measurements disagree", *lines]

    def summary(self) -> dict[str, Any]:
        """Costs, status and counts, as numbers and text only."""
        s = self.solution
        g = self.graph
        return {
            "estimator": self.estimator,
            "start": self.start,
            "status": self.status,
            "usable": self.usable,
            "diagnosis": self.diagnosis,
            "advice": self.advice,
            "cost": s.final_cost,
            **{name: getattr(s, name) for name in _COSTS},
            "poses": g.n_poses,
            "landmarks": int(g.landmark_name.size),
            "edges": len(g["edge"]),
            "sightings": len(g["sighting"]),
            "ranges": len(g["range"]),
            "left_out": self.left_out,
            "repaired": dict(self.repaired),
            "anchored": [g.variable_name(int(pose)) for pose in self.anchored],
            "started_as_in_the_file": self.counts_as_in_file,
            "starts": [
                {
                    "start": outcome.name,
                    "status": outcome.solution.status.name,
                    "cost": outcome.solution.final_cost,
                    "iterations": outcome.solution.iterations,
                }
                for outcome in self.outcomes
            ],
            "alternative_start": None if self.alternative is None else self.alternative.name,
            "warning": self.warning,
            "certificate": None if self.certificate is None else asdict(self.certificate),
        }

    def save(self, folder: Path, *, more: Mapping[str, Any] | None = None) -> None:
        """
        Write graph, start, estimate and truth as NetCDF, and the summary as JSON.

        ``graph.nc`` is a `FactorGraph`; ``start.nc``, ``estimate.nc``, ``alternative.nc`` and
        ``truth.nc`` are `GraphValues` with vehicle, number and time of each pose. There is no
        estimate without a usable solution; ``last.nc`` is then the last point of a descent that did
        not converge.

        Parameters
        ----------
        folder : pathlib.Path
            Existing folder.
        more : mapping, optional
            Additional entries of the summary; numbers that are not finite are written as null.
        """
        self.graph.save(folder / "graph.nc")
        names = ["vehicle_name", "landmark_name", "pose_vehicle", "pose_number", "pose_time"]
        about = self.graph.to_dataset()[names]
        for name, values in self.trajectories.items():
            write_netcdf(
                values.to_dataset().merge(about, combine_attrs="override"), folder / f"{name}.nc"
            )
        summary = _finite({**self.summary(), **(more or {})})
        with whole_file(folder / "summary.json") as path:
            path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def open_graph(
    path: Path | str,
    *,
    leave_out: Collection[str] = (),
    skip_unknown: bool = False,
    half_angles: bool = False,
    isam: bool = False,
    indefinite: Indefinite = "refuse",
    covariances: Covariances = "full",
) -> GraphFile:
    r"""
    Read a graph file, in three dimensions or two: PyFactorGraph text, g2o, TORO or iSAM, by its
    name and its first vertex or edge.

    Parameters
    ----------
    path : pathlib.Path or str
    leave_out : collection of str
        Words whose lines to skip and count.
    skip_unknown : bool
        Skip and count lines of unknown words instead of refusing them.
    half_angles : bool
        Read the rotation part of a g2o file's information as that of half the angle, as g2o defines
        it.
    isam : bool
        Read the matrices of ``EDGE2`` as iSAM does, the upper triangular root of the information by
        rows. Those of ``ODOMETRY`` and ``LANDMARK`` always are.
    indefinite : {"refuse", "drop", "repair"}
        Treatment of lines whose information or covariance matrix is not positive definite: refuse
        the file, drop the lines, or raise their eigenvalues. ``left_out`` and ``repaired`` of the
        result count the lines.
    covariances : {"full", "isotropic"}
        Covariances of the file, or one variance of each translation and rotation, as PyFactorGraph
        reads them; ``left_out`` of the result counts the depths, which it reads as priors without
        effect.

    Returns
    -------
    GraphFile

    Raises
    ------
    EstimationError
        If the file cannot be read or a line is not in the grammar; the message names the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> noise = "0.01 0 0 0 0 0 0.01 0 0 0 0 0.01 0 0 0 1e-4 0 0 1e-4 0 1e-4"
    >>> lines = [
    ...     "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1",
    ...     "VERTEX_SE3:QUAT 1 A1 10 0 0 0 0 0 1",
    ...     f"VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1 {noise}",
    ...     f"EDGE_SE3:QUAT 1 A0 A1 10.1 0 0 0 0 0 1 {noise}",
    ... ]
    >>> _ = Path("graph.pyfg").write_text("\n".join(lines))
    >>> from pymantaray.apps.graphs import open_graph
    >>> open_graph("graph.pyfg").graph
    <FactorGraph: 1 vehicle, 0 landmarks, 2 poses>
    """
    if covariances not in get_args(Covariances):
        raise EstimationError(
            f"covariances {covariances!r}; allowed: {', '.join(get_args(Covariances))}"
        )
    options: dict[str, Any] = {
        "leave_out": leave_out,
        "skip_unknown": skip_unknown,
        "indefinite": indefinite,
    }
    if is_pose_graph(Path(path)):
        file = load_g2o(path, half_angles=half_angles, isam=isam, **options)
    else:
        file = load_pyfg(path, **options)
    if covariances == "full":
        return file
    graph, lost = isotropic(file.graph, keep_depths=bool(file.depths_from_above))
    left_out = file.left_out | (
        {"depth priors (PyFactorGraph reads precision 0)": lost} if lost else {}
    )
    return file._replace(graph=graph, left_out=left_out)


def is_pose_graph(path: Path) -> bool:
    """
    True for g2o and TORO files, whose vertices are starting values; those of PyFactorGraph text are
    the ground truth.

    Files named neither ``.g2o`` nor ``.pyfg``, with or without ``.gz``, are g2o if the second and
    third field of the first vertex or edge are numbers: PyFactorGraph has a symbol among them.
    """
    suffix = plain_path(path).suffix
    if suffix == G2O:
        return True
    with open_text(path, EstimationError, what="a graph file", limit=MAX_GRAPH_BYTES) as file:
        lines = (line.split(None, 3) for line in file)
        first = next((line for line in lines if line and line[0].startswith(_FIRST_WORDS)), [""])
    if first[0] in _TORO_WORDS or first[0] in ISAM.values():
        return True
    return suffix != PYFG and len(first) > 2 and all(is_number(field) for field in first[1:3])


def solve_graph(
    file: GraphFile,
    *,
    estimator: str | EstimatorFunction = "batch",
    start: Start | None = None,
    random_starts: int = 0,
    seed: int = 0,
    anchor: bool = False,
    truth: bool = True,
    report: Callable[[int, float], None] | None = None,
) -> GraphResult:
    r"""
    Run an estimator on a graph from a file; ``diagnosis`` of the result explains a failure.

    Parameters
    ----------
    file : GraphFile
        From `open_graph`.
    estimator : str or callable
        A name in `METHODS`, or a function of a graph and its starting values.
    start : {"file", "dead-reckoning", "chordal", "best"}, optional
        "file" starts at the file's vertices, "dead-reckoning" at edges composed from the priors,
        "chordal" at linear least squares of all edges. "best" solves from all of them, from
        trilaterated and mirrored landmarks and from a relaxation, and returns the solution of
        lowest cost. The default is "best" for graphs of at most `MAX_CHEAP_FACTORS` factors if the
        estimator is a batch method, else "file". If the file's vertices are the truth, "file" and
        "best" hide local minima.
    random_starts : int
        Number of further random starts of "best".
    seed : int
        Seed of the random starts.
    anchor : bool
        Add a prior of 1 mm and 1 mrad to the first pose of each free part, instead of refusing the
        graph. A graph without any anchor always gets these priors.
    truth : bool
        True if the file's vertices are the ground truth, as in PyFactorGraph files.
    report : callable, optional
        Called with the number of each step of a named estimator and the cost after it.

    Returns
    -------
    GraphResult

    Raises
    ------
    EstimationError
        If the estimator or start is unknown, a part of the graph is free, or there are fewer
        measurements than unknowns; the message names a variable.

    Examples
    --------
    Continues the example of `pymantaray.apps.graphs`:

    >>> from pymantaray.apps.graphs import solve_graph
    >>> result = solve_graph(opened, start="dead-reckoning")
    >>> print(result.solution.status.name, result.solution.position.round(1).tolist())
    OK [[0.0, 0.0, 0.0], [10.1, 0.0, 0.0]]
    """
    # refuse unknown names, and random starts of a single start
    if isinstance(estimator, str) and estimator not in METHODS:
        raise EstimationError(f"estimator {estimator!r}; allowed: {', '.join(METHODS)}")
    if start is not None and start not in get_args(Start):
        raise EstimationError(f"start {start!r}; allowed: {', '.join(get_args(Start))}")
    if random_starts < 0:
        raise EstimationError(f"random starts: {random_starts}; allowed: 0 or more")
    if random_starts and start not in {None, "best"}:
        raise EstimationError(
            f"{random_starts} random starts with start {start!r}; use `start='best'`"
        )
    graph, poses = anchor_graph(file, all_parts=anchor)
    if graph.degrees_of_freedom < 0:
        fallback = f"{graph.variable_name(0)}: fewer measurements than unknowns; singular"
        raise EstimationError(diagnose(graph, file.values) or fallback)
    solver = GraphSolver(SolveOptions(report=report))
    if start is None:
        batch = isinstance(estimator, str) and not METHODS[estimator].incremental
        start = "best" if random_starts or (batch and is_cheap(graph)) else "file"

    def solve(initial: GraphValues, rival: float = np.inf) -> GraphSolution:
        if isinstance(estimator, str):
            solver.options = replace(solver.options, rival_cost=rival)
            return solver.solve(graph, initial, method=METHODS[estimator])
        return estimator(graph, initial)

    name = estimator if isinstance(estimator, str) else getattr(estimator, "__name__", "estimator")
    try:
        outcomes = _outcomes(file, graph, start, solve, random_starts=random_starts, seed=seed)
    except (RuntimeError, ValueError) as error:  # raised by GTSAM
        gave_up = f"the solver gave up: {str(error).strip().partition(chr(10))[0]}"
        raise EstimationError(diagnose(graph, file.values) or gave_up) from None
    best = lowest(outcomes)
    alternative = plausible_alternative(graph, outcomes) if best.solution.usable else None
    solution = best.solution
    diagnosis = None
    if alternative is not None and solution.status is SolveStatus.OK:
        solution = replace(solution, status=SolveStatus.SECOND_MINIMUM)
    why = _unexplained(graph, solution)
    if not solution.usable:
        diagnosis = diagnose(graph, best.initial) or _misfit(graph, best.initial, name, solution)
    elif why is not None:
        worst = worst_misfit(graph, solution.values)
        diagnosis = f"not explained: {why}; the worst misfit is at {worst}"
    return GraphResult(
        graph=graph,
        estimator=name,
        start=best.name,
        initial=best.initial,
        as_in_file=best.unchanged,
        anchored=poses,
        truth=file.values if truth and not file.valueless else None,
        solution=solution,
        diagnosis=diagnosis,
        left_out=file.left_out,
        repaired=file.repaired,
        unexplained=why,
        outcomes=tuple(outcomes),
        alternative=alternative,
    )


def with_certificate(result: GraphResult, *, wanted: bool | None = None) -> GraphResult:
    """
    Add the certificate of a result.

    Parameters
    ----------
    result : GraphResult
    wanted : bool, optional
        By default small results of batch least squares get one, which is not possible with depth
        factors.

    Raises
    ------
    EstimationError
        If a certificate is wanted for a robust loss.
    """
    if wanted and result.estimator not in {"batch", "incremental"}:
        raise EstimationError(
            f"certificate of {result.estimator}: only least squares can be certified; use"
            " estimator 'batch'"
        )
    graph = result.graph
    size = result.graph.n_factors
    small = (
        result.estimator == "batch" and size <= MAX_CERTIFIED_FACTORS and not not_quadratic(graph)
    )
    if wanted is False or not (wanted or small) or not result.solution.usable:
        return result
    return replace(result, certificate=certify(graph, result.values))


def is_cheap(graph: FactorGraph) -> bool:
    """True if a graph is small enough to be solved from several starts by default."""
    return graph.n_factors <= MAX_CHEAP_FACTORS


def _outcomes(
    file: GraphFile,
    graph: FactorGraph,
    start: Start,
    solve: Callable[..., GraphSolution],
    *,
    random_starts: int,
    seed: int,
) -> list[StartOutcome]:
    """Solutions from one start or, for "best", from all."""
    first = "chordal" if file.valueless else "file"
    if start == "best":
        return search_minima(
            graph, file.values, solve, random_starts=random_starts, seed=seed, first=first
        )
    initial = file.values
    unchanged = np.empty(0, dtype=np.intp)
    if start != "file":
        initial, unchanged = _STARTS[start](graph, file.values)
    name = first if start == "file" else start
    return [StartOutcome(name, initial, unchanged, solve(initial))]


def anchor_graph(
    file: GraphFile, *, all_parts: bool = False
) -> tuple[FactorGraph, NDArray[np.int32]]:
    """
    Check a file's graph and anchor it; return the poses that got a prior, too.

    Without any anchor, the first pose of each part gets a prior. Otherwise a free part is refused,
    or anchored with ``all_parts``.
    """
    graph = file.graph
    values = file.values
    check_graph(graph)
    check_values(graph, values)
    poses = np.empty(0, dtype=np.int32)
    if all_parts or connected_parts(graph).loose.all():
        graph, poses = anchor_loose_parts(graph, values)
    check_anchored(graph)
    check_conditioned(graph)
    return graph, poses


def _misfit(
    graph: FactorGraph, initial: GraphValues, estimator: str, solution: GraphSolution
) -> str:
    """Reason of a failed solve of a graph that determines every variable."""
    if (
        solution.status is SolveStatus.FAILED
        and (start := diagnose_start(graph, initial)) is not None
    ):
        return start
    state = solution.status.name.lower().replace("_", " ")
    expected = (
        f", expected {solution.expected_cost:.3g}" if np.isfinite(solution.expected_cost) else ""
    )
    return (
        f"{state} after {solution.iterations} iterations of {estimator}, cost"
        f" {solution.initial_cost:.3g} to {solution.final_cost:.3g}{expected}; the worst misfit at"
        f" the start is at {worst_misfit(graph, initial)}: try another start"
    )


def _unexplained(graph: FactorGraph, solution: GraphSolution) -> str | None:
    """
    Reason why an optimum does not explain the ranges of its graph, by the limits of
    `pymantaray.evaluation.unexplained`, or all its measurements, by the cost of least squares.
    """
    if not solution.usable:
        return None
    ranges = graph["range"]
    place = np.concatenate([solution.values.position, solution.values.landmark_position])
    measured = ranges.column("distance")
    one, other = ranges.variables.T
    predicted = np.linalg.norm(place[one] - place[other], axis=1)
    why = unexplained(measured - predicted, measured, np.sqrt(ranges.variance), least=LEAST_RANGE)
    ratio = np.sqrt(solution.final_cost / max(solution.expected_cost, 0.5))
    if why is None and ratio > LARGEST_RATIO:
        why = (
            f"the rms residual is {ratio:.3g} stated standard deviations; at most"
            f" {LARGEST_RATIO:g} explain it"
        )
    return why


def reading_notes(left_out: Mapping[str, int], repaired: Mapping[str, int]) -> list[str]:
    """Notes about the lines of a graph's file that were left out or repaired."""
    return [f"left out: {count} {what}" for what, count in left_out.items()] + [
        f"repaired: {count} {what} (indefinite matrix)" for what, count in repaired.items()
    ]


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(v) for name, v in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def to_gtsam(graph: FactorGraph, values: GraphValues, loss: Loss | None = None) -> tuple[Any, Any]:
    r"""
    Convert a graph and values to GTSAM, to solve or extend them there.

    Parameters
    ----------
    graph : FactorGraph
        Every factor becomes a GTSAM factor; depths are GPS factors without horizontal precision.
        Priors hold the poses of a planar graph in the plane, without effect on the solution.
    values : GraphValues
        Values of all variables of the graph.
    loss : Loss, optional
        Robust loss on the ranges.

    Returns
    -------
    gtsam.NonlinearFactorGraph, gtsam.Values
        Keys are the rows of the graph: poses first, then landmarks. The ranges are the last
        factors.

    Examples
    --------
    Continues the example of `pymantaray.apps.graphs`:

    >>> from pymantaray.apps.graphs import solve_graph, to_gtsam
    >>> result = solve_graph(opened)
    >>> factors, start = to_gtsam(result.graph, result.initial)
    >>> factors.size()
    2
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, values_of

    return graph_factors(graph, loss), values_of(values)
