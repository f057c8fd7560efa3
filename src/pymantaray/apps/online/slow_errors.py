"""
Relative errors of predicted travel times that an on-line estimator learns, in the last members of
its state: one for each pair of depth bands, and one for each way.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pymantaray.apps.online.drifting_water import DriftingWater
from pymantaray.arrays import Array, Indices
from pymantaray.errors import OnlineError
from pymantaray.estimation.filters.error_state import SIZE, State
from pymantaray.estimation.filters.gauss_markov import Processes, relax
from pymantaray.quantities.checks import check_magnitudes, check_number, is_number

_AXES = 3  # errors that one member of the state holds, in place of a position


class LearnedWays(NamedTuple):
    """
    Relative errors of the predicted travel times, one for each way: a pair and its direction.

    Each is a first-order Gauss-Markov process. The estimate is averaged with that of an estimator
    without such errors, weighted by the likelihoods of both.

    Attributes
    ----------
    sigma : float
        Standard deviation of the relative error; 1e-3 is 1 m at a range of 1 km.
    hours : float
        Correlation time; infinite for an error that is constant. [h]

    Examples
    --------
    >>> from pymantaray.apps.online import LearnedWays
    >>> LearnedWays(2e-3).hours
    6.0
    """

    sigma: float
    hours: float = 6.0

    def checked(self) -> LearnedWays:
        """
        Return the same values as plain numbers.

        Raises
        ------
        OnlineError
            If a value is not allowed.
        """
        check_number(OnlineError, "ways: sigma", self.sigma, "1", positive=True)
        check_magnitudes(OnlineError, "ways: sigma", self.sigma)
        if not (is_number(self.hours) and self.hours > 0.0):
            raise OnlineError(f"ways: hours is {self.hours} h; it must be positive")
        return LearnedWays(float(self.sigma), float(self.hours))


class WayError(NamedTuple):
    """
    Relative error of the predicted travel times from a source to a vehicle, and its sigma.

    Examples
    --------
    >>> from pymantaray.apps.online import WayError
    >>> WayError("B1", "vehicle", 1e-3, 2e-4).value
    0.001
    """

    source: str
    vehicle: str
    value: float
    sigma: float


class SlowErrors(NamedTuple):
    """
    Errors of pairs of depth bands, if ``water`` is given, then of ways, if ``ways`` is given, of
    ``vehicles`` among ``nodes``, which are vehicles and beacons.
    """

    water: DriftingWater | None
    ways: LearnedWays | None
    vehicles: int
    nodes: int

    @property
    def processes(self) -> Processes:
        """Standard deviation and correlation time of each error."""
        sigma, hours = [], []
        for options, count in ((self.water, self.n_bands), (self.ways, self.n_ways)):
            if options is not None:
                sigma += [options.sigma] * count
                hours += [options.hours] * count
        return Processes(np.array(sigma), 3600.0 * np.array(hours))

    @property
    def n_bands(self) -> int:
        """Number of errors of pairs of depth bands."""
        return 0 if self.water is None else len(self.water.pairs)

    @property
    def n_ways(self) -> int:
        """Number of errors of ways."""
        return 0 if self.ways is None else self.vehicles * (self.nodes - 1)

    @property
    def members(self) -> int:
        """Number of members of the state that hold the errors."""
        return -(-(self.n_bands + self.n_ways) // _AXES)

    def columns_of(self, members: int) -> Indices:
        """Columns of the errors in a state with a number of members."""
        number = np.arange(self.n_bands + self.n_ways)
        return np.asarray(
            SIZE * (members - self.members + number // _AXES) + _AXES + number % _AXES
        )

    def way(self, source: int, vehicle: int) -> int:
        """Number of the error of a way."""
        return self.n_bands + vehicle * (self.nodes - 1) + source - (source > vehicle)

    def numbers_of(self, ends: tuple[int, ...], depths: tuple[float, float]) -> list[int]:
        """Numbers of the errors of a range from a source to a vehicle, by both depths [m]."""
        numbers = [] if self.water is None else [self.water.number_of(*depths)]
        return numbers if self.ways is None else [*numbers, self.way(*ends)]

    def relax(self, state: State, elapsed: float) -> State:
        """State after a time in which the errors drift; errors without a variance stay zero. [s]"""
        members = len(state.position)
        columns = self.columns_of(members)
        processes = self.processes
        variance = np.diag(state.covariance)
        share = np.exp(-elapsed / processes.time_scale)
        keep, stationary = np.ones(variance.size), np.zeros(variance.size)
        keep[columns] = share
        stationary[columns] = np.where(variance[columns] > 0.0, processes.sigma**2, 0.0)
        position, covariance = state.position.copy(), state.covariance.copy()
        position[members - self.members :].reshape(-1)[: share.size] *= share
        relax(covariance, keep, stationary)
        return State(state.rotation, position, covariance)

    def without_ways(self, state: State) -> State:
        """The same state, whose ways have no errors."""
        columns = self.columns_of(len(state.position))[self.n_bands :]
        covariance = state.covariance.copy()
        covariance[columns] = covariance[:, columns] = 0.0
        return state._replace(covariance=covariance)

    def errors(self, state: State) -> tuple[Array, Array]:
        """Relative errors and their standard deviations, bands first."""
        columns = self.columns_of(len(state.position))
        values = state.position[len(state.position) - self.members :].reshape(-1)[: columns.size]
        return values.copy(), np.sqrt(np.maximum(np.diag(state.covariance)[columns], 0.0))


def saved_ways(content: Any) -> LearnedWays | None:
    """Ways of a saved estimator; an error if they are none."""
    if content is None:
        return None
    sigma, hours = content
    return LearnedWays(float(sigma), float(hours)).checked()
