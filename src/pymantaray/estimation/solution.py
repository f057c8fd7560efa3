"""What a solve ends with, and what one of several solves of nearly the same graph is asked for."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.covariance import EpochCovariances
from pymantaray.estimation.gate import Progress
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.range_weights import BelievedRanges
from pymantaray.estimation.unknowns import UnknownsEstimate
from pymantaray.records import SolveStatus

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """
    Values that a solve ended with, and its health; the values are NaN unless ``usable``.

    Fields mean what they mean in `Estimates`; ``position`` and ``quaternion`` have one row for each pose
    of the graph, or the shape ``(n_agents, n_times, ...)`` where `solve_conditions` returns them. Of a solve
    with a range model, ``gated_links`` counts the ranges that the believed ocean does not allow in the end, and
    ``expansions`` the times that the model was asked and the graph solved.
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
    covariances: EpochCovariances | None = None
    """At the epochs asked for; None if none were, or the values are not usable."""
    unknowns: UnknownsEstimate | None = None
    """What the ranges share, if anything was to be estimated of it and the values are usable."""
    diagnosis: str | None = None
    """From `GraphSolver.solve`, of values that are not usable: what is singular or badly conditioned, if anything is."""

    @property
    def usable(self) -> bool:
        """Whether the values are a converged optimum."""
        return self.status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE}


class Variant(NamedTuple):
    """One of several graphs that differ in their ranges only, and how it is to be solved."""

    graph: FactorGraph
    model_is_right: bool
    believed: BelievedRanges | None = None
    """What is believed of its ranges; None takes them as the distances that the graph has."""
    initial: GraphValues | None = None
    """Where to start if not where all do."""
    loss: Loss | None = None
    """Of the ranges; None is least squares."""
    incremental: bool = False
    """Whether the factors are replayed in the order of time; only for ranges as distances."""
    vector_factors: bool = False
    """Whether what is believed is solved by nonlinear factors that ask the model, in place of outer iterations."""


def judged(
    found: GraphValues, progress: Progress, status: SolveStatus, expected_cost: float = math.nan
) -> Solution:
    """
    Solution with a verdict: its values are NaN unless that makes them usable.

    Parameters
    ----------
    found : GraphValues
        Where the solve ended.
    progress : Progress
    status : SolveStatus
        From `gate`.
    expected_cost : float
        Half the degrees of freedom. By default the cost has no chi-square distribution. [-]

    Returns
    -------
    Solution
    """
    mask = 1.0 if status in {SolveStatus.OK, SolveStatus.OVER_CHI_SQUARE} else np.nan
    return Solution(
        position=found.position * mask,
        quaternion=found.quaternion * mask,
        landmark_position=found.landmark_position * mask,
        status=status,
        iterations=progress.iterations,
        initial_cost=progress.initial_cost,
        final_cost=progress.final_cost,
        expected_cost=expected_cost,
        gradient_norm=progress.gradient_norm,
    )
