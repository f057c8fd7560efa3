"""Somebody else's factor graph: read it, run an estimator on it, and keep what came out."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import EstimationError, StudyError
from pymantaray.estimation import FactorGraph, GraphSolver, GraphValues, Solution
from pymantaray.estimation.diagnose import diagnose, worst_misfit
from pymantaray.estimation.g2o import load_g2o
from pymantaray.estimation.graph import check_anchored, check_values
from pymantaray.estimation.incremental import replay
from pymantaray.estimation.losses import LOSSES
from pymantaray.estimation.pyfg import GraphFile, load_pyfg
from pymantaray.estimation.robust import solve_robust
from pymantaray.estimation.starts import anchor_loose_parts, dead_reckon_graph
from pymantaray.evaluation.trajectory_error import ape, ate_statistics
from pymantaray.records import write_netcdf
from pymantaray.study.store import write_json

Estimator = Callable[[FactorGraph, GraphValues], Solution]
Start = Literal["file", "dead-reckoning"]

G2O = ".g2o"
POOLED = "all"


def _batch(graph: FactorGraph, initial: GraphValues) -> Solution:
    """Solve for all variables at once, by least squares."""
    return GraphSolver().solve(graph, initial)


def _incremental(graph: FactorGraph, initial: GraphValues) -> Solution:
    """Feed the factors to iSAM2 in the order of time, by least squares; the last estimate."""
    return replay(graph, initial).solution


ESTIMATORS: dict[str, Estimator] = {
    "batch": _batch,
    **{name: partial(solve_robust, loss=loss) for name, loss in LOSSES.items()},
    "incremental": _incremental,
}
"""Estimators by name; one more is one more entry."""


@dataclass(frozen=True, eq=False)
class ExternalResult:
    """
    What an estimator made of a graph.

    ``graph`` has the priors that were added; ``taken`` counts the variables whose start is the file's though
    dead reckoning was asked for; ``truth`` is None where the file has none; ``diagnosis`` says in one line why
    the solution is not usable, and is None if it is.
    """

    graph: FactorGraph
    estimator: str
    start: Start
    initial: GraphValues
    taken: int
    anchored: NDArray[np.int32]
    truth: GraphValues | None
    solution: Solution
    diagnosis: str | None
    left_out: dict[str, int]

    @property
    def values(self) -> GraphValues:
        """Estimated values; NaN unless the solution is usable."""
        s = self.solution
        return GraphValues(
            position=s.position, quaternion=s.quaternion, landmark_position=s.landmark_position
        )

    def trajectory_errors(self, values: GraphValues) -> dict[str, dict[str, float]]:
        """
        Absolute trajectory errors by vehicle and pooled, nothing aligned.

        Parameters
        ----------
        values : GraphValues
            `values` or ``initial``.

        Returns
        -------
        dict of str to dict
            From each vehicle's name, and ``"all"``, to what `ate_statistics` gives; empty without a truth.
        """
        if self.truth is None:
            return {}
        errors = ape(values.position, self.truth.position)
        table = {
            str(name): ate_statistics(errors[self.graph.pose_agent == a])
            for a, name in enumerate(self.graph.agent_name)
        }
        return {**table, POOLED: ate_statistics(errors)}

    def summary(self) -> dict[str, Any]:
        """
        Costs, status, counts and errors.

        Returns
        -------
        dict
            Numbers and text only; what is not finite is None.
        """
        s, g = self.solution, self.graph
        content = {
            "estimator": self.estimator,
            "start": self.start,
            "status": s.status.name,
            "usable": s.usable,
            "diagnosis": self.diagnosis,
            "iterations": s.iterations,
            "initial_cost": s.initial_cost,
            "final_cost": s.final_cost,
            "expected_cost": s.expected_cost,
            "gradient_norm": s.gradient_norm,
            "poses": g.n_poses,
            "landmarks": int(g.landmark_name.size),
            "edges": int(g.edge_from.size),
            "ranges": int(g.range_first.size),
            "left_out": self.left_out,
            "anchored": [g.variable_name(int(pose)) for pose in self.anchored],
            "started_as_in_the_file": self.taken,
            "trajectory_error": self.trajectory_errors(self.values),
            "trajectory_error_of_start": self.trajectory_errors(self.initial),
        }
        return {name: _finite(value) for name, value in content.items()}

    def save(self, folder: Path) -> None:
        """
        Write the graph, start, estimate and truth as NetCDF and the summary as JSON.

        Parameters
        ----------
        folder : pathlib.Path
            Must exist.

        Notes
        -----
        ``graph.nc`` is a `FactorGraph`; ``start.nc``, ``estimate.nc`` and ``truth.nc`` are `GraphValues` with
        the poses' vehicles, numbers and times besides. Without a usable solution there is no estimate.
        """
        self.graph.save(folder / "graph.nc")
        write_netcdf(named_dataset(self.graph, self.initial), folder / "start.nc")
        if self.solution.usable:
            write_netcdf(named_dataset(self.graph, self.values), folder / "estimate.nc")
        if self.truth is not None:
            write_netcdf(named_dataset(self.graph, self.truth), folder / "truth.nc")
        write_json(self.summary(), folder / "summary.json")


def open_graph(path: Path | str, *, leave_out: Collection[str] = (), half_angles: bool = False) -> GraphFile:
    """
    Read a graph file: g2o if its name ends in ``.g2o``, else PyFactorGraph text.

    Parameters
    ----------
    path : pathlib.Path or str
    leave_out : collection of str
        Words of lines to leave out; see `load_pyfg` and `load_g2o`.
    half_angles : bool
        How a g2o file means the rotation part of its information; see `load_g2o`.

    Returns
    -------
    GraphFile
    """
    if Path(path).suffix == G2O:
        return load_g2o(path, leave_out=leave_out, half_angles=half_angles)
    return load_pyfg(path, leave_out=leave_out)


def solve_graph(
    file: GraphFile,
    *,
    estimator: str = "batch",
    start: Start = "file",
    anchor: bool = False,
    truth: bool = True,
) -> ExternalResult:
    """
    Run an estimator on a graph that was read from a file.

    Parameters
    ----------
    file : GraphFile
        From `open_graph`.
    estimator : str
        A name in `ESTIMATORS`.
    start : {"file", "dead-reckoning"}
        Start from the values of the file's vertices, or from edges composed from the priors. A start at the
        truth hides local minima.
    anchor : bool
        Give a prior of 1 mm and 1 mrad to the first pose of each part that nothing ties to the world, at the
        file's value, instead of refusing the graph.
    truth : bool
        Whether the file's vertices are the ground truth, as they are in PyFactorGraph files.

    Returns
    -------
    ExternalResult
        Of any status; ``diagnosis`` says what is wrong.

    Raises
    ------
    StudyError
        If there is no such estimator or start.
    EstimationError
        If a part of the graph floats, or it has fewer measurements than unknowns; the message names a
        variable.
    """
    if estimator not in ESTIMATORS:
        raise StudyError(f"estimator {estimator!r}; allowed: {', '.join(ESTIMATORS)}")
    if start not in {"file", "dead-reckoning"}:
        raise StudyError(f"start {start!r}; allowed: file, dead-reckoning")
    graph, values, left_out = file
    check_values(graph, values)
    anchored = np.empty(0, dtype=np.int32)
    if anchor:
        graph, anchored = anchor_loose_parts(graph, values)
    check_anchored(graph)
    initial, taken = (values, 0) if start == "file" else dead_reckon_graph(graph, values)
    if graph.degrees_of_freedom < 0:
        fallback = f"{graph.variable_name(0)}: fewer measurements than unknowns by {-graph.degrees_of_freedom}; singular"
        raise EstimationError(diagnose(graph, initial) or fallback)
    try:
        solution = ESTIMATORS[estimator](graph, initial)
    except (RuntimeError, ValueError) as error:  # what GTSAM throws where it does not abort
        reason = diagnose(graph, initial) or f"the solver gave up: {str(error).strip().partition(chr(10))[0]}"
        raise EstimationError(reason) from None
    diagnosis = None
    if not solution.usable:
        state = solution.status.name.lower().replace("_", " ")
        expected = f", expected {solution.expected_cost:.3g}" if np.isfinite(solution.expected_cost) else ""
        diagnosis = diagnose(graph, initial) or (
            f"{state} after {solution.iterations} iterations of {estimator}, cost {solution.initial_cost:.3g} to"
            f" {solution.final_cost:.3g}{expected}; the worst misfit at the start is at"
            f" {worst_misfit(graph, initial)}: try another start"
        )
    return ExternalResult(
        graph=graph,
        estimator=estimator,
        start=start,
        initial=initial,
        taken=taken,
        anchored=anchored,
        truth=values if truth else None,
        solution=solution,
        diagnosis=diagnosis,
        left_out=left_out,
    )


def named_dataset(graph: FactorGraph, values: GraphValues) -> xr.Dataset:
    """
    Values of a graph with the names, numbers and times of its poses.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues

    Returns
    -------
    xarray.Dataset
        Reads back as `GraphValues`.
    """
    names = ("agent_name", "landmark_name", "pose_agent", "pose_number", "pose_time")
    return values.to_dataset().merge(graph.to_dataset()[list(names)], combine_attrs="override")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(v) for name, v in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value
