"""Health gate: whether a solve ended at an optimum, and whether that optimum is believable."""

import math
from dataclasses import dataclass

from pymantaray.records import SolveStatus


@dataclass(frozen=True)
class SolveOptions:
    """
    Limits of the solver and of the health gate.

    Parameters
    ----------
    step_tolerance : float
        The solver stops when no variable moves by more than this in a step. Convergence is linear, by a
        factor of about six a step: the default leaves less than 1e-5 m at the paper's size, 1e-3 leaves 0.2 mm for
        an eighth less time. [m, rad]
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
    """

    step_tolerance: float = 4e-5
    end_tolerance: float = 1e-3
    max_iterations: int = 50
    decrement_tolerance: float = 1e-3
    chi_square_sigmas: float = 5.0


@dataclass(frozen=True)
class Progress:
    """
    How an optimization went.

    Parameters
    ----------
    iterations : int
        Steps taken.
    initial_cost, final_cost : float
        Half the sum of squared whitened residuals. [-]
    singular : bool
        The linear system could not be solved, or left a variable undetermined.
    gradient_norm : float
        Largest component of the cost's gradient at the last linearization; NaN if none was solved.
    newton_decrement : float
        Cost that the step from the last linearization promised to take away: half the gradient's square
        in the metric of the inverse Hessian, hence free of units. [-]
    last_step : float
        Largest component of that step. [m, rad]
    """

    iterations: int
    initial_cost: float
    final_cost: float
    singular: bool = False
    gradient_norm: float = math.nan
    newton_decrement: float = math.nan
    last_step: float = math.nan


def gate(
    progress: Progress, degrees_of_freedom: int, options: SolveOptions, *, model_is_right: bool
) -> SolveStatus:
    """
    Verdict on one solve.

    A solver that gives up at once returns its starting point, which looks perfect when it was started at
    the truth; hence nothing is taken on trust.

    Parameters
    ----------
    progress : Progress
    degrees_of_freedom : int
        Twice the expected cost.
    options : SolveOptions
    model_is_right : bool
        Whether the cost has to lie within its chi-square bounds.

    Returns
    -------
    SolveStatus
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
        options.chi_square_sigmas * math.sqrt(max(degrees_of_freedom, 0) / 2.0) + options.decrement_tolerance
    )
    if model_is_right and abs(progress.final_cost - degrees_of_freedom / 2.0) > half_width:
        return SolveStatus.OVER_CHI_SQUARE
    return SolveStatus.OK
