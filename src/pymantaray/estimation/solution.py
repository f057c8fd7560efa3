"""What a solve is asked for and what it ends with: method, options, progress, health gate and solution."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.covariance import EpochCovariances
from pymantaray.estimation.graph import GraphValues
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.range_models import UnknownsEstimate
from pymantaray.records import SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Method:
    """
    How a graph is solved.

    Parameters
    ----------
    loss : Loss, optional
        Of its ranges, in place of least squares.
    incremental : bool
        Whether the factors are replayed in the order of time, in place of a batch.
    lag : float, optional
        Whether they are so by a smoother that forgets what is older than this. [s]
    """

    loss: Loss | None = None
    incremental: bool = False
    lag: float | None = None


@dataclass(frozen=True)
class ReplayOptions:
    """
    Limits of a replay in the order of time.

    Parameters
    ----------
    every : {"ping", "sample"}
        When to update: at each time with a range and at the end, or at each time with a pose.
    relinearize : float
        Variables that moved by more than this are linearized again. [m, rad]
    wildfire : float
        A change smaller than this is not passed on to the next variables. [m, rad]
    final_updates : int
        Updates without new factors after the last one, at most; they end when nothing is linearized again.
    end_tolerance : float
        Largest component of the step that a batch solver would take from the end. [m, rad]
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
        The solver stops when no variable moves by more than this in a step, which leaves a sixth of it: the
        default 2e-6 m at the paper's size. A looser one saves one step of four or five. [m, rad]
    end_tolerance : float
        Largest step that the undamped system may still ask for at the end of damped steps, where the optimum
        repels undamped ones. [m, rad]
    max_iterations : int
        Steps after which it gives up.
    decrement_tolerance : float
        Largest cost that one more step may promise to take away at the optimum. [-]
    chi_square_sigmas : float
        Half width of the interval about its expectation in which the final cost has to lie where the
        model is right, in standard deviations of the chi-square distribution. [-]
    replay : ReplayOptions
        Of a replay in the order of time.
    report : callable, optional
        Told the number of each step of a batch and the cost behind it.
    """

    step_tolerance: float = 4e-5
    end_tolerance: float = 1e-3
    max_iterations: int = 50
    decrement_tolerance: float = 1e-3
    chi_square_sigmas: float = 5.0
    replay: ReplayOptions = field(default_factory=ReplayOptions)
    report: Callable[[int, float], None] | None = None


@dataclass(frozen=True)
class Progress:
    """How an optimization went; costs are half the sum of squared whitened residuals."""

    iterations: int
    initial_cost: float
    final_cost: float
    singular: bool = False  # the linear system could not be solved, or left a variable undetermined
    gradient_norm: float = math.nan  # largest component of the cost's gradient at the last linearization
    newton_decrement: float = math.nan  # cost that the last step promised to take away
    last_step: float = math.nan  # its largest component [m, rad]


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Values that a solve ended with, and its health; the values are NaN unless ``usable``.

    Fields mean what they mean in `Estimates`; ``position`` and ``quaternion`` have one row for each pose of
    the graph, or the shape ``(n_vehicles, n_times, ...)`` where `solve_conditions` returns them. Of a solve
    with a range model, ``gated_links`` counts the ranges that the believed ocean does not allow in the end,
    and ``expansions`` the times that the model was asked and the graph solved. ``seconds`` of CPU time are told by
    `solve_conditions`; what estimators share is paid by the first that needs it.
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
    covariances: EpochCovariances | None = None  # at the epochs asked for, if the values are usable
    unknowns: UnknownsEstimate | None = None  # what the ranges share, likewise

    @property
    def usable(self) -> bool:
        """Whether the values are a converged optimum."""
        return self.status.usable

    @property
    def values(self) -> GraphValues:
        """The values of the graph's variables."""
        return GraphValues(
            position=self.position.reshape(-1, 3),
            quaternion=self.quaternion.reshape(-1, 4),
            landmark_position=self.landmark_position,
        )


def gate(progress: Progress, options: SolveOptions, *, expected_cost: float = math.nan) -> SolveStatus:
    """
    Verdict on one solve; the cost has to lie within its chi-square bounds where one is expected.

    A solver that gives up at once returns its starting point, which looks perfect when it was started at
    the truth; hence nothing is taken on trust.
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
    half_width = options.chi_square_sigmas * math.sqrt(max(expected_cost, 0.0)) + options.decrement_tolerance
    if progress.final_cost - expected_cost > half_width:  # nor does NaN here
        return SolveStatus.OVER_CHI_SQUARE
    if expected_cost - progress.final_cost > half_width:
        return SolveStatus.UNDER_CHI_SQUARE
    return SolveStatus.OK


def judged(
    values: GraphValues, progress: Progress, status: SolveStatus, expected_cost: float = math.nan
) -> Solution:
    """Solution with a verdict from `gate`: its values are NaN unless that makes them usable."""
    mask = 1.0 if status.usable else np.nan
    return Solution(
        position=values.position * mask,
        quaternion=values.quaternion * mask,
        landmark_position=values.landmark_position * mask,
        status=status,
        iterations=progress.iterations,
        initial_cost=progress.initial_cost,
        final_cost=progress.final_cost,
        expected_cost=expected_cost,
        gradient_norm=progress.gradient_norm,
    )
