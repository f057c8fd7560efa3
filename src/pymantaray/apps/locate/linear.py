"""Linear system of a survey at one set of values: residuals, derivatives and their products."""

from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np

from pymantaray.apps.locate.noise import Correlation, Whitener
from pymantaray.apps.locate.survey import PlatformError, TravelDirection
from pymantaray.apps.locate.travel_times import Legs, lever_gradients
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array, Mask

_CHUNK = 2048  # pings whose rows are in memory at a time


class Products(NamedTuple):
    """Products of whitened rows, and terms of the evidence."""

    normal: Array  # (size, size)
    right: Array  # (size,)
    squares: float
    log_determinant: float
    n_rows: int

    def shifted(self, change: Array) -> Self:
        """Products of the residuals after a change of columns (size,)."""
        if not change.any():
            return self
        by_change = self.normal @ change
        squares = self.squares - 2.0 * float(change @ self.right) + float(change @ by_change)
        return self._replace(right=self.right - by_change, squares=squares)


class Linearization:
    """
    Residuals of a survey's times at some values, and their derivatives by all unknowns.

    ``weight`` (n,) is the standard deviation of each ping's white noise divided by that of the
    survey.
    """

    def __init__(self, unknowns: SurveyUnknowns, values: Array, legs: Legs, weight: Array) -> None:
        self.unknowns = unknowns
        self.values = values
        self.legs = legs
        self.weight = weight
        self._slowing = unknowns.slowing(values)
        self.residual = unknowns.survey.travel_time - unknowns.predict_times(values, legs)
        self._by_position = unknowns.position_map(values)
        self._water_times = np.nan_to_num(unknowns.water_times(values, legs))
        has_lever = unknowns.survey.lever.used or unknowns.lever_doubt > 0.0
        self._lever = lever_gradients(unknowns.survey, legs) if has_lever else None

    def rows(self, part: slice) -> Array:
        """Derivatives (m, size) of the predicted times of some pings."""
        unknowns = self.unknowns
        legs = self.legs
        survey = self.unknowns.survey
        columns = unknowns.slices
        slowing = self._slowing[part]
        node = survey.node[part]
        partner = survey.partner[part]
        lines = np.arange(node.size)
        derivative = np.einsum(
            "ia,iaj->ij", legs.node_gradient[part] * slowing[:, None], self._by_position[node]
        )
        other = partner >= 0
        if other.any():
            gradient = legs.partner_gradient[part][other] * slowing[other, None]
            derivative[other] += np.einsum(
                "ia,iaj->ij", gradient, self._by_position[partner[other]]
            )
        derivative[lines, columns["turn_around"].start + node] += (
            survey.direction[part] == TravelDirection.TWO_WAY
        ) & (partner != node)
        time_since_start = (survey.time - survey.time[0])[part]
        for sign, which in unknowns.clock_signs():
            derivative[lines, columns["offset"].start + which[part]] += sign[part]
            derivative[lines, columns["drift"].start + which[part]] += sign[part] * time_since_start
        if self._lever is not None:
            derivative[:, columns["lever"]] = self._lever[part] * slowing[:, None]
        if legs.curvature is not None:
            by_curvature = np.nan_to_num(legs.curvature[part]) * slowing
            derivative[:, columns["curvature"]] = by_curvature[:, None]
        water = self._water_times[part] * slowing
        speed = slice(columns["speed"].start, columns["speed"].stop - legs.modes.shape[1])
        derivative[:, speed] = -water[:, None] * unknowns.speed.rows(part)
        derivative[:, speed.stop : columns["speed"].stop] = legs.modes[part]
        return np.asarray(derivative)

    def whitened_rows(
        self, used: Mask, correlation: Correlation, platform: PlatformError, sigma: float
    ) -> Iterator[tuple[Array, float]]:
        """
        Yield chunks of whitened rows of the used pings, each with a log determinant.

        Residuals are in the last column.

        Rows have the variance ``sigma``² [s²] of the survey's white noise. The log determinant is
        that of the covariance of all rows up to this chunk, in units of this variance.
        """
        rows = np.flatnonzero(used)
        survey = self.unknowns.survey.rows(used)
        platform_gradient = (self.legs.transmit_gradient + self.legs.receive_gradient)[used]
        weight = self.weight[used]
        sensitivity = platform_gradient / (sigma * weight)[:, None]
        whitener = Whitener(survey, correlation, platform, sensitivity)
        logarithm = 2.0 * np.cumsum(np.log(weight))
        for start in range(0, rows.size, _CHUNK):
            some = rows[start : start + _CHUNK]
            part = slice(int(some[0]), int(some[-1]) + 1)
            derivative = self.rows(part)[some - some[0]]
            block = np.concatenate([derivative, self.residual[some, None]], axis=1)
            block /= weight[start : start + some.size, None]
            block = whitener(block, start)
            yield block, float(logarithm[start + some.size - 1]) + whitener.log_determinant

    def products(
        self, used: Mask, correlation: Correlation, platform: PlatformError, sigma: float
    ) -> Products:
        """Normal matrix, right-hand side and sum of squares of the used pings."""
        size = self.unknowns.size
        total = np.zeros((size + 1, size + 1))
        logarithm = 0.0
        count = 0
        for block, log_determinant in self.whitened_rows(used, correlation, platform, sigma):
            total += block.T @ block
            logarithm = log_determinant
            count = count + len(block)
        return Products(total[:-1, :-1], total[:-1, -1], float(total[-1, -1]), logarithm, count)
