"""Method, options, progress, health gate and solution of a solve."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.graph.graph import GraphValues
from pymantaray.estimation.ranges.range_models import UnknownsEstimate
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.records import SolveStatus


@dataclass(frozen=True)
class Method:
    """
    Method to solve a graph.

    Parameters
    ----------
    loss : Loss, optional
        Loss on the ranges, instead of least squares.
    incremental : bool
        Pass the factors to iSAM2 in the order of time, instead of a batch solve.
    lag : float, optional
        Use a smoother that marginalizes poses older than this, with ``incremental`` that of iSAM2.
        [s]
    kalman : bool
        Use an error-state extended Kalman filter, which starts at the priors of the graph.
    gtsam : {"converged", "default"}, optional
        Use GTSAM's Levenberg-Marquardt optimizer: until the cost does not fall, or with its default
        parameters.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import GraphSolver, Loss, Method
    >>> method = Method(loss=Loss("huber", scale=1.345))
    >>> GraphSolver().solve(graph, start, method=method).status.name
    'OK'
    """

    loss: Loss | None = None
    incremental: bool = False
    lag: float | None = None
    kalman: bool = False
    gtsam: Literal["converged", "default"] | None = None

    @property
    def uses_distances(self) -> bool:
        """True if ranges can only be distances between positions, without a range model."""
        return self.incremental or self.lag is not None or self.gtsam is not None


@dataclass(frozen=True)
class IncrementalOptions:
    """
    Limits of an incremental solve.

    Parameters
    ----------
    every : {"ping", "sample"}
        Update at each time with a range and at the end, or at each time with a pose.
    relinearize : float
        Relinearize variables that moved by more than this. [m, rad]
    wildfire : float
        Do not propagate smaller changes to further variables. [m, rad]
    final_updates : int
        Maximum number of updates without new factors after the last one; they end when nothing is
        relinearized.
    end_tolerance : float
        Largest allowed component of the next batch step from the end. [m, rad]
    """

    every: Literal["ping", "sample"] = "ping"
    relinearize: float = 1e-3
    wildfire: float = 1e-5
    final_updates: int = 10
    end_tolerance: float = 1e-2


@dataclass(frozen=True)
class SolveOptions:
    """
    Limits of the solver and of the health gate.

    Parameters
    ----------
    step_tolerance : float
        The solver stops when no variable moves by more than this in a step. The remaining error is
        a sixth of it; with the default, 2e-6 m for the paper's graph. A looser tolerance saves one
        step of four or five. [m, rad]
    end_tolerance : float
        Largest allowed undamped step at the end of damped steps, if undamped steps diverge from the
        optimum. [m, rad]
    max_iterations : int
        Maximum number of steps.
    decrement_tolerance : float
        Largest predicted decrease of the cost by one more step at the optimum. [-]
    chi_square_sigmas : float
        Half width of the allowed interval about the expected cost if the model is right, in
        standard deviations of the chi-square distribution. [-]
    rival_cost : float
        Cost of another solution of the graph. A batch descent by damped steps ends as
        ``NOT_CONVERGED`` if it would stay above this cost at the rate of its last steps.
    incremental : IncrementalOptions
        Limits of an incremental solve.
    report : callable, optional
        Called with the number of each batch step and the cost after it.
    """

    step_tolerance: float = 4e-5
    end_tolerance: float = 1e-3
    max_iterations: int = 50
    decrement_tolerance: float = 1e-3
    chi_square_sigmas: float = 5.0
    rival_cost: float = math.inf
    incremental: IncrementalOptions = field(default_factory=IncrementalOptions)
    report: Callable[[int, float], None] | None = None


@dataclass(frozen=True)
class SolveProgress:
    """Progress of an optimization; costs are half the sum of squared whitened residuals."""

    iterations: int
    initial_cost: float
    final_cost: float
    singular: bool = False  # the linear system could not be solved, or left a variable undetermined
    # largest component of the cost's gradient at the last linearization
    gradient_norm: float = math.nan
    newton_decrement: float = math.nan  # predicted decrease of the cost by the last step
    last_step: float = math.nan  # its largest component [m, rad]


@dataclass(frozen=True, eq=False)
class GraphSolution:
    """
    Final values of a solve and its status; the values are NaN unless ``usable``. ``last_point`` is
    the last point of a batch descent that did not converge, and ``values`` then returns it.

    Fields are those of `Estimates`. ``position`` and ``quaternion`` have one row for each pose of
    the graph, or the shape ``(n_vehicles, n_times, ...)`` in results of `solve_conditions`. After a
    solve with a range model, ``gated_links`` counts the ranges without an arrival in the assumed
    ocean, and ``expansions`` the evaluations of the model. `solve_conditions` sets ``seconds`` of
    CPU time; the first estimator includes the time for shared results. After a solve by GTSAM,
    ``from_batch`` is the largest distance of a pose or landmark from the estimate of the batch
    solver from the same start.
    """

    position: Array
    quaternion: Array
    landmark_position: Array
    status: SolveStatus
    iterations: int
    initial_cost: float
    final_cost: float
    expected_cost: float
    gradient_norm: float
    gated_links: int = 0
    expansions: int = 0
    seconds: float = math.nan
    from_batch: float = math.nan  # [m]
    update_seconds: Array | None = None  # CPU time of each update, fixed lag or Kalman filter
    covariances: EpochCovariances | None = None  # at the requested epochs, if the values are usable
    unknowns: UnknownsEstimate | None = None  # of the ranges, likewise
    last_point: GraphValues | None = None  # of a descent that is not usable

    @property
    def usable(self) -> bool:
        """True if the values are a converged optimum."""
        return self.status.usable

    converged = usable

    @property
    def cost(self) -> float:
        """Final cost, also of a descent that did not converge; infinite if the solve failed."""
        has_point = self.usable or self.last_point is not None
        return self.final_cost if has_point and math.isfinite(self.final_cost) else math.inf

    def append(self, again: "GraphSolution") -> "GraphSolution":
        """
        Join the solution of a further descent from the end of this one.

        Parameters
        ----------
        again : GraphSolution
            Solution of the further descent.

        Returns
        -------
        GraphSolution
            The further solution with the steps of both and the first initial cost.
        """
        return replace(
            again, iterations=self.iterations + again.iterations, initial_cost=self.initial_cost
        )

    @property
    def values(self) -> GraphValues:
        """
        Values of the graph's variables: the estimate, or the last point of a descent that did not
        converge.
        """
        if self.last_point is not None:
            return self.last_point
        return GraphValues(
            position=self.position.reshape(-1, 3),
            quaternion=self.quaternion.reshape(-1, 4),
            landmark_position=self.landmark_position,
        )


def gate(
    progress: SolveProgress, options: SolveOptions, *, expected_cost: float = math.nan
) -> SolveStatus:
    """
    Status of one solve; the cost must be within its chi-square bounds if there is an expected cost.

    A solver that stops at once returns its starting values, which look perfect if they are the
    truth; so every condition is checked.
    """
    if progress.singular or not math.isfinite(progress.final_cost):
        return SolveStatus.FAILED
    if progress.iterations < 1:
        return SolveStatus.NO_ITERATION
    if progress.final_cost > progress.initial_cost + 1e-9 * (1.0 + progress.initial_cost):
        return SolveStatus.COST_ROSE
    stopped = progress.last_step <= max(options.step_tolerance, options.end_tolerance)
    flat = abs(progress.newton_decrement) <= options.decrement_tolerance
    if not (stopped and flat):  # NaN does not pass
        return SolveStatus.NOT_CONVERGED
    half_width = (
        options.chi_square_sigmas * math.sqrt(max(expected_cost, 0.0)) + options.decrement_tolerance
    )
    if progress.final_cost - expected_cost > half_width:  # nor does NaN here
        return SolveStatus.OVER_CHI_SQUARE
    if expected_cost - progress.final_cost > half_width:
        return SolveStatus.UNDER_CHI_SQUARE
    return SolveStatus.OK


def make_solution(
    values: GraphValues,
    progress: SolveProgress,
    status: SolveStatus,
    expected_cost: float = math.nan,
) -> GraphSolution:
    """Solution with a status from `gate`; its values are NaN unless the status is usable."""
    mask = 1.0 if status.usable else np.nan
    return GraphSolution(
        position=values.position * mask,
        quaternion=values.quaternion * mask,
        landmark_position=values.landmark_position * mask,
        status=status,
        iterations=progress.iterations,
        initial_cost=progress.initial_cost,
        final_cost=progress.final_cost,
        expected_cost=expected_cost,
        gradient_norm=progress.gradient_norm,
        last_point=values if status is SolveStatus.NOT_CONVERGED else None,
    )
