"""Read factor graphs from files, solve them, and save the results."""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.diagnose import check_conditioned, diagnose, diagnose_start, worst_misfit
from pymantaray.estimation.g2o import TORO, load_g2o
from pymantaray.estimation.graph import (
    FactorGraph,
    GraphValues,
    check_anchored,
    check_graph,
    check_values,
    connected_parts,
)
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.pyfg import GraphFile, load_pyfg
from pymantaray.estimation.solution import Solution, SolveOptions
from pymantaray.estimation.solve import METHODS, GraphSolver
from pymantaray.estimation.starts import anchor_loose_parts, chordal, dead_reckon_graph
from pymantaray.records import SolveStatus, whole_file, write_netcdf
from pymantaray.records.status import SOLVE_STATUS_WORDS

Start = Literal["file", "dead-reckoning", "chordal"]
_STARTS = {"dead-reckoning": dead_reckon_graph, "chordal": chordal}
EstimatorFunction = Callable[[FactorGraph, GraphValues], Solution]

G2O = ".g2o"
_TORO_WORDS = {word for words in TORO.values() for word in words}
_COSTS = ("iterations", "initial_cost", "final_cost", "expected_cost", "gradient_norm")


@dataclass(frozen=True, eq=False)
class GraphResult:
    """
    Result of an estimator on a graph file.

    ``graph`` includes added priors. ``as_in_file`` lists the variables that start at the file's values in spite of another
    start, because only ranges constrain them: if the file's values are the truth, so is that part of the start. ``start`` is
    chordal if the file has no values. ``truth`` is None if the file has none. ``diagnosis`` says in one line why the solution is
    not usable, and is None if it is.
    """

    graph: FactorGraph
    estimator: str
    start: Start
    initial: GraphValues
    as_in_file: NDArray[np.intp]
    anchored: NDArray[np.int32]
    truth: GraphValues | None
    solution: Solution
    diagnosis: str | None
    left_out: dict[str, int]

    @property
    def values(self) -> GraphValues:
        """Estimated values; NaN unless the solution is usable."""
        return self.solution.values

    @property
    def counts_as_in_file(self) -> dict[str, int]:
        """Numbers of poses and of landmarks among ``as_in_file``."""
        poses = int(np.count_nonzero(self.as_in_file < self.graph.n_poses))
        return {"poses": poses, "landmarks": int(self.as_in_file.size) - poses}

    @property
    def advice(self) -> str | None:
        """Advice for a usable solution whose status is not OK."""
        words = SOLVE_STATUS_WORDS.get(self.solution.status)
        return None if words is None else f"{words.meaning}; {words.advice}"

    @property
    def trajectories(self) -> dict[str, GraphValues]:
        """Values by name: ``start``, ``estimate`` if the solution is usable, ``truth`` if known."""
        tables = {
            "start": self.initial,
            "estimate": self.values if self.solution.usable else None,
            "truth": self.truth,
        }
        return {name: values for name, values in tables.items() if values is not None}

    def summary(self) -> dict[str, Any]:
        """Costs, status and counts, as numbers and text only."""
        s, g = self.solution, self.graph
        return {
            "estimator": self.estimator,
            "start": self.start,
            "status": s.status.name,
            "usable": s.usable,
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
            "anchored": [g.variable_name(int(pose)) for pose in self.anchored],
            "started_as_in_the_file": self.counts_as_in_file,
        }

    def save(self, folder: Path, *, more: Mapping[str, Any] | None = None) -> None:
        """
        Write graph, start, estimate and truth as NetCDF, and the summary as JSON.

        ``graph.nc`` is a `FactorGraph`; ``start.nc``, ``estimate.nc`` and ``truth.nc`` are `GraphValues` with
        vehicle, number and time of each pose. There is no estimate without a usable solution. The
        summary includes the entries of ``more``; numbers that are not finite are null. The folder must exist.
        """
        self.graph.save(folder / "graph.nc")
        names = ["vehicle_name", "landmark_name", "pose_vehicle", "pose_number", "pose_time"]
        about = self.graph.to_dataset()[names]
        for name, values in self.trajectories.items():
            write_netcdf(values.to_dataset().merge(about, combine_attrs="override"), folder / f"{name}.nc")
        summary = _finite({**self.summary(), **(more or {})})
        with whole_file(folder / "summary.json") as path:
            path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def open_graph(
    path: Path | str,
    *,
    leave_out: Collection[str] = (),
    skip_unknown: bool = False,
    half_angles: bool = False,
) -> GraphFile:
    """
    Read a graph file, in three dimensions or two: g2o if its name ends in ``.g2o``, TORO by its first word, else PyFactorGraph text.

    Parameters
    ----------
    path : pathlib.Path or str
    leave_out : collection of str
        Words whose lines to skip and count.
    skip_unknown : bool
        Skip and count lines of unknown words instead of refusing them.
    half_angles : bool
        Read the rotation part of a g2o file's information as that of half the angle, as g2o defines it.

    Raises
    ------
    EstimationError
        If the file cannot be read or a line is not in the grammar; the message names the line.
    """
    if is_pose_graph(Path(path)):
        return load_g2o(path, leave_out=leave_out, skip_unknown=skip_unknown, half_angles=half_angles)
    return load_pyfg(path, leave_out=leave_out, skip_unknown=skip_unknown)


def is_pose_graph(path: Path) -> bool:
    """True for g2o and TORO files, whose vertices are starting values; those of PyFactorGraph text are the ground truth."""
    if path.suffix == G2O:
        return True
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            words = (next(iter(line.split(None, 1)), "#") for line in file)
            return next((word for word in words if not word.startswith("#")), "") in _TORO_WORDS
    except OSError:
        return False  # the reader reports the cause


def solve_graph(
    file: GraphFile,
    *,
    estimator: str | EstimatorFunction = "batch",
    start: Start = "file",
    anchor: bool = False,
    truth: bool = True,
    report: Callable[[int, float], None] | None = None,
) -> GraphResult:
    """
    Run an estimator on a graph from a file; ``diagnosis`` of the result explains a failure.

    Parameters
    ----------
    file : GraphFile
        From `open_graph`.
    estimator : str or callable
        A name in `METHODS`, or a function of a graph and its starting values.
    start : {"file", "dead-reckoning", "chordal"}
        At the values of the file's vertices, at edges composed from the priors, or at linear least squares of all edges; a
        truth hides local minima.
    anchor : bool
        Add a prior of 1 mm and 1 mrad to the first pose of each free part, instead of refusing the graph. A graph without
        any anchor always gets these priors.
    truth : bool
        Whether the file's vertices are the ground truth, as in PyFactorGraph files.
    report : callable, optional
        Called with the number of each step of a named estimator and the cost after it.

    Raises
    ------
    EstimationError
        If the estimator or start is unknown, a part of the graph is free, or there are fewer measurements than
        unknowns; the message names a variable.
    """
    if isinstance(estimator, str) and estimator not in METHODS:
        raise EstimationError(f"estimator {estimator!r}; allowed: {', '.join(METHODS)}")
    if start not in get_args(Start):
        raise EstimationError(f"start {start!r}; allowed: {', '.join(get_args(Start))}")
    graph, poses = anchor_graph(file, all_parts=anchor)
    values, valueless = file.values, file.valueless
    initial, as_in_file = values, np.empty(0, dtype=np.intp)
    if start != "file":
        initial, as_in_file = _STARTS[start](graph, values)
    elif valueless:
        start = "chordal"
    name, solution = _solved(graph, initial, estimator, SolveOptions(report=report))
    diagnosis = None
    if not solution.usable:
        diagnosis = diagnose(graph, initial) or _misfit(graph, initial, name, solution)
    return GraphResult(
        graph=graph,
        estimator=name,
        start=start,
        initial=initial,
        as_in_file=as_in_file,
        anchored=poses,
        truth=values if truth and not valueless else None,
        solution=solution,
        diagnosis=diagnosis,
        left_out=file.left_out,
    )


def anchor_graph(file: GraphFile, *, all_parts: bool = False) -> tuple[FactorGraph, NDArray[np.int32]]:
    """
    Check a file's graph and anchor it; return the poses that got a prior, too.

    Without any anchor, the first pose of each part gets a prior. Otherwise a free part is refused, or anchored with
    ``all_parts``.
    """
    graph, values = file.graph, file.values
    check_graph(graph)
    check_values(graph, values)
    poses = np.empty(0, dtype=np.int32)
    if all_parts or connected_parts(graph).loose.all():
        graph, poses = anchor_loose_parts(graph, values)
    check_anchored(graph)
    check_conditioned(graph)
    return graph, poses


def _solved(
    graph: FactorGraph,
    initial: GraphValues,
    estimator: str | EstimatorFunction,
    options: SolveOptions,
) -> tuple[str, Solution]:
    """Name of an estimator and its solution."""
    if graph.degrees_of_freedom < 0:
        fallback = f"{graph.variable_name(0)}: fewer measurements than unknowns by {-graph.degrees_of_freedom}; singular"
        raise EstimationError(diagnose(graph, initial) or fallback)
    try:
        if isinstance(estimator, str):
            return estimator, GraphSolver(options).solve(graph, initial, method=METHODS[estimator])
        return getattr(estimator, "__name__", "estimator"), estimator(graph, initial)
    except (RuntimeError, ValueError) as error:  # raised by GTSAM
        reason = diagnose(graph, initial) or f"the solver gave up: {str(error).strip().partition(chr(10))[0]}"
        raise EstimationError(reason) from None


def _misfit(graph: FactorGraph, initial: GraphValues, estimator: str, solution: Solution) -> str:
    """Reason of a failed solve of a graph that determines every variable."""
    if solution.status is SolveStatus.FAILED and (start := diagnose_start(graph, initial)) is not None:
        return start
    state = solution.status.name.lower().replace("_", " ")
    expected = f", expected {solution.expected_cost:.3g}" if np.isfinite(solution.expected_cost) else ""
    return (
        f"{state} after {solution.iterations} iterations of {estimator}, cost {solution.initial_cost:.3g} to"
        f" {solution.final_cost:.3g}{expected}; the worst misfit at the start is at"
        f" {worst_misfit(graph, initial)}: try another start"
    )


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(v) for name, v in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def to_gtsam(graph: FactorGraph, values: GraphValues, loss: Loss | None = None) -> tuple[Any, Any]:
    """
    Convert a graph and values to GTSAM, to solve or extend them there.

    Parameters
    ----------
    graph : FactorGraph
        Every factor becomes a GTSAM factor; depths are GPS factors without horizontal precision. Priors hold the poses of a
        planar graph in the plane, without effect on the solution.
    values : GraphValues
        Values of all variables of the graph.
    loss : Loss, optional
        Robust loss on the ranges.

    Returns
    -------
    gtsam.NonlinearFactorGraph, gtsam.Values
        Keys are the rows of the graph: poses first, then landmarks. The ranges are the last factors.
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, values_of

    return graph_factors(graph, loss), values_of(values)
