"""
Start of one-way surveys with an unknown clock, such as air-gun shots at an ocean-bottom instrument.

The first arrival of a far shot is often a head wave in the sea bed, which is faster than water, or
a reflection beyond the last direct ray. The nearest shots are those of the smallest times. A grid
of positions starts a fit to these; the fit then grows towards farther shots as long as direct rays
explain their times within the noise of the picks.
"""

from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.locate.earth import in_water
from pymantaray.apps.locate.evidence import robust_sigma
from pymantaray.apps.locate.survey import Node, Survey, TravelDirection
from pymantaray.apps.locate.travel_times import transducers
from pymantaray.arrays import Array, Mask
from pymantaray.errors import LocateError

_MIN_PINGS = 15
_GROWTH = 1.25  # of the number of shots
_FIRST_FRACTION = 0.15  # of all shots, for the grid
_MISFIT = 2.0  # allowed mean square of scaled residuals, relative to the best fit
_CLIP = 5.0  # standard deviations
_MIN_SIGMA = 2e-3  # s; errors of the table of travel times and of the water
_SPEED_SIGMA = 5e-3  # relative error of the sound speed
_GRID = 41  # positions along each axis
_STARTS = 6
_MIN_SPREAD = 1.0  # m; of the depths of the table
_STEPS = 40
_REFITS = 6
_CONVERGED = 0.1  # m
_RANGES = 400  # of the table of travel times
_DEPTHS = 7
_LONGEST = 80e3  # m
_LEAST_LEAD = 0.03  # s; smaller deviations are errors of the water or of positions
_MOST = 0.8  # fraction of the shots beyond the last direct arrivals
_NOMINAL_SPEED = 1500.0  # m/s
_ANY_OFFSET = 1e3  # s
_LEAST_OFFSET = 0.1  # s
_CLOCK_GAIN = 4.0  # ratio of mean squares without and with a clock offset
_TOP = 1.0  # m; least depth of a node


class DirectArrivals(NamedTuple):
    """Start positions of the nodes, and pings that are not direct arrivals."""

    position: dict[int, Array]
    """North, east, depth by index of the node. [m]"""
    reason: NDArray[np.str_]
    """Reason for each omitted ping, (n,); empty for others."""


def direct_arrivals(survey: Survey, medium: Medium) -> DirectArrivals:
    """
    Find the direct arrivals of nodes with an unknown clock and one-way times.

    Raise an error if the clock of a node counts as known, but is not.
    """
    reason = np.full(len(survey), "", dtype=object)
    position = {}
    ends = [in_water(survey, medium, end) for end in transducers(survey, np.zeros(3))]
    for k, node in enumerate(survey.nodes):
        if min(node.sigma[:2]) == 0.0:
            continue
        of_node = (survey.node == k) & (survey.partner < 0) & ~survey.flagged
        for direction, end in zip(
            (TravelDirection.TO_NODE, TravelDirection.FROM_NODE), ends, strict=True
        ):
            rows = np.flatnonzero(of_node & (survey.direction == direction))
            if rows.size < max(_MIN_PINGS, 0.5 * of_node.sum()):
                continue
            sign = 1.0 if direction == TravelDirection.TO_NODE else -1.0
            shots = _Shots(survey, rows, end[rows], medium, sign)
            if node.offset_sigma > 0.0:
                values, reason[rows] = shots.solve(node)
                position[k] = values[:3]
                continue
            # a known clock: would an unknown one explain the times much better?
            values, words = shots.solve(replace(node, offset_sigma=_ANY_OFFSET))
            if abs(values[3]) >= _LEAST_OFFSET:
                direct = np.flatnonzero([not word for word in words])
                misfit = max(shots.misfit(values, direct), 1.0)
                shots.set_priors(node)
                fits = [shots.descend(start, direct)[0] for start in shots.grid(direct)]
                if min(shots.misfit(fit, direct) for fit in fits) > _CLOCK_GAIN * misfit:
                    raise LocateError(
                        f"{survey.source}: the one-way times of node {node.name} imply a clock"
                        f" offset of about {values[3]:.2f} s, but its clock is known; give"
                        " `offset_sigma`, and for a drift `drift_sigma`"
                    )
    return DirectArrivals(position, reason.astype(str))


class _Shots:
    """One-way times of a node, with position, depth, clock and sound speed as unknowns."""

    def __init__(
        self,
        survey: Survey,
        rows: NDArray[np.int64],
        points: Array,
        medium: Medium,
        sign: float,
    ) -> None:
        self._time = survey.travel_time[rows]
        self._since = survey.time[rows] - survey.time[0]
        self._points = points[:, :2]
        self._sign = sign
        node = survey.nodes[survey.node[rows[0]]]
        self.set_priors(node)
        # noise of the picks, from their neighbours in time
        order = np.argsort(self._since, kind="stable")
        t, y = self._since[order], self._time[order]
        part = (t[1:-1] - t[:-2]) / np.maximum(t[2:] - t[:-2], 1e-9)
        difference = y[1:-1] - (1.0 - part) * y[:-2] - part * y[2:]
        noise = robust_sigma(difference / np.sqrt(1.0 + part**2 + (1.0 - part) ** 2))
        self._sigma = max(noise, _MIN_SIGMA)
        # table of travel times
        north, east, depth = node.position
        spread = max(2.5 * node.sigma[2], _MIN_SPREAD)
        bed = float(np.min(medium.bottom_depth(points))) - 1e-2
        lowest = max(min(depth + spread, bed), 2.0 * _TOP)
        highest = np.clip(depth - spread, _TOP, lowest - _MIN_SPREAD)
        middle = self._points.mean(axis=0)
        farthest = np.linalg.norm(self._points - middle, axis=1).max()
        longest = 2.0 * farthest + np.linalg.norm(middle - [north, east]) + max(node.sigma[:2])
        self._depths = np.linspace(highest, lowest, _DEPTHS)
        ranges = np.linspace(0.0, min(longest, _LONGEST), _RANGES)
        top = float(np.median(points[:, 2]))
        times, self._last_range = _direct_times(medium, top, ranges, self._depths)
        self._longest = ranges[-1]
        self._table = RegularGridInterpolator((ranges, self._depths), times)

    def set_priors(self, node: Node) -> None:
        """Set the priors of position, depth, clock offset, clock drift and sound speed."""
        self._prior = np.array([*node.position, 0.0, 0.0, 0.0])
        self._sd = np.maximum(
            [*node.sigma, node.offset_sigma, node.drift_sigma, _SPEED_SIGMA],
            [1e-2, 1e-2, 1e-2, 1e-6, 1e-12, 1e-6],
        )

    def solve(self, node: Node) -> tuple[Array, list[str]]:
        """Values of the unknowns, and a reason for each shot that is no direct arrival."""
        # fits to a growing number of shots, from the nearest ones
        self.set_priors(node)
        order = np.argsort(self._time, kind="stable")
        n = order.size
        size = min(max(_MIN_PINGS, round(_FIRST_FRACTION * n)), n)
        starts = self.grid(order[:size])
        fits = []
        while True:
            ends = sorted(
                (self.descend(start, order[:size]) for start in starts), key=itemgetter(1)
            )
            starts = [values for values, _ in ends]
            fits.append((self.misfit(starts[0], order[:size]), starts[0], order[:size]))
            if size == n:
                break
            size = min(max(size + 1, round(_GROWTH * size)), n)
        # the largest number that direct rays explain
        allowed = _MISFIT * max(min(misfit for misfit, *_ in fits), 1.0)
        _, values, rows = [fit for fit in fits if fit[0] <= allowed][-1]
        is_near = np.zeros(n, dtype=bool)
        is_near[rows] = True
        for _ in range(_REFITS):
            # other errors of near shots are found later, as in all surveys
            is_direct = self._is_direct(values, rows)
            distance = self._distance(values)
            is_kept = (is_direct | is_near) & (distance < self._edge(distance, is_direct))
            is_kept &= ~self._is_beyond(values)
            if is_kept.sum() < _MIN_PINGS or np.array_equal(np.flatnonzero(is_kept), rows):
                break
            rows = np.flatnonzero(is_kept)
            values, _ = self.descend(values, rows)
        if is_kept.sum() < _MIN_PINGS:
            return values, [""] * n
        return values, self._reasons(values, is_kept)

    def _edge(self, distance: Array, is_direct: Mask) -> float:
        """
        Distance beyond which most shots are not direct, less that of a deviation in the noise.
        """
        order = np.argsort(-distance)
        share = np.cumsum(~is_direct[order]) / np.arange(1.0, order.size + 1.0)
        few = np.flatnonzero((share > _MOST) & ~is_direct[order])
        if not few.size:
            return np.inf
        # a head wave leads by half of its distance over the speed of sound, or more
        margin = 2.0 * _CLIP * self._sigma * _NOMINAL_SPEED
        return float(distance[order[few[-1]]] - margin)

    def grid(self, rows: NDArray[np.int64]) -> list[Array]:
        """Best positions of a grid for a part of the shots."""
        points = self._points[rows]
        depth = self._prior[2]
        centre = points[np.argmin(self._time[rows])]
        half = max(float(np.ptp(points, axis=0).max()), 2.0 * depth)
        axis = np.linspace(-half, half, _GRID)
        cells = centre + np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        distance = np.linalg.norm(cells[:, None] - points, axis=-1)
        residual = self._time[rows] - self._water_time(distance, depth)
        offset = np.median(residual, axis=1)
        cost = np.median(np.abs(residual - offset[:, None]), axis=1) / self._sigma
        prior = (cells - self._prior[:2]) / self._sd[:2]
        cost = cost + np.sum(prior**2, axis=1) / rows.size
        starts: list[Array] = []
        for cell in np.argsort(cost):
            if all(np.linalg.norm(cells[cell] - start[:2]) > 0.2 * half for start in starts):
                clock = self._sign * offset[cell]
                starts.append(np.array([*cells[cell], depth, clock, 0.0, 0.0]))
            if len(starts) == _STARTS:
                break
        return starts

    def _water_time(self, distance: Array, depth: float) -> Array:
        """Times of distances (...) for a node at a depth. [s]"""
        depth = float(np.clip(depth, self._depths[0], self._depths[-1]))
        nearest = np.minimum(distance, self._longest)
        return np.asarray(self._table(np.stack([nearest, np.full_like(nearest, depth)], axis=-1)))

    def _distance(self, values: Array) -> Array:
        """Horizontal distance of all shots. [m]"""
        return np.asarray(np.linalg.norm(values[:2] - self._points, axis=1))

    def _is_beyond(self, values: Array) -> Mask:
        """True for shots beyond the last direct ray."""
        last = np.interp(values[2], self._depths, self._last_range)
        return np.asarray(self._distance(values) > last)

    def _model(
        self, values: Array, rows: NDArray[np.int64] | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Residuals and derivatives of the predicted times of some shots."""
        step = values[:2] - self._points[rows]
        distance = np.hypot(step[:, 0], step[:, 1])
        time = self._water_time(distance, values[2])
        slope = (self._water_time(distance + 10.0, values[2]) - time) / 10.0
        by_depth = self._water_time(distance, values[2] + 1.0) - time
        direction = step / np.maximum(distance, 1e-6)[:, None]
        slowing = 1.0 - values[5]
        since = self._since[rows]
        clock = self._sign * (values[3] + values[4] * since)
        columns = [
            slowing * slope * direction[:, 0],
            slowing * slope * direction[:, 1],
            slowing * by_depth,
            np.full(since.size, self._sign),
            self._sign * since,
            -time,
        ]
        return self._time[rows] - slowing * time - clock, np.column_stack(columns)

    def _normal(self, columns: Array, weight: Array) -> Array:
        return np.asarray(columns.T @ (weight[:, None] * columns) + np.diag(self._sd**-2.0))

    def descend(self, start: Array, rows: NDArray[np.int64]) -> tuple[Array, float]:
        """Values of the lowest Cauchy cost with priors, and the cost of clipped residuals."""

        def prior_cost(values: Array) -> float:
            return float(np.sum(((values - self._prior) / self._sd) ** 2))

        values = start.copy()
        damping = 1e-3
        residual, columns = self._model(values, rows)
        for _ in range(_STEPS):
            scale = 2.4 * max(self._sigma, robust_sigma(residual))
            weight = 1.0 / (1.0 + (residual / scale) ** 2) / self._sigma**2
            right = columns.T @ (weight * residual) + (self._prior - values) / self._sd**2
            normal = self._normal(columns, weight)
            normal += damping * np.diag(np.diag(normal))
            change = np.linalg.solve(normal, right)
            new = values + change
            new[2] = np.clip(new[2], self._depths[0], self._depths[-1])
            new_residual, new_columns = self._model(new, rows)
            gain = np.log1p((residual / scale) ** 2) - np.log1p((new_residual / scale) ** 2)
            robust_gain = (scale / self._sigma) ** 2 * float(np.sum(gain))
            if robust_gain + prior_cost(values) - prior_cost(new) <= 0.0:
                damping *= 5.0
                continue
            values, residual, columns = new, new_residual, new_columns
            damping *= 0.2
            if np.linalg.norm(change[:3]) < _CONVERGED:
                break
        return values, rows.size * self._clipped(residual) + prior_cost(values)

    def misfit(self, values: Array, rows: NDArray[np.int64]) -> float:
        """Mean square of scaled and clipped residuals. [-]"""
        return self._clipped(self._model(values, rows)[0])

    def _clipped(self, residual: Array) -> float:
        return float(np.mean(np.minimum((residual / self._sigma) ** 2, _CLIP**2)))

    def _is_direct(self, values: Array, rows: NDArray[np.int64]) -> Mask:
        """True for shots that a fit of some shots explains, with its own uncertainty."""
        residual, columns = self._model(values)
        sigma = max(self._sigma, robust_sigma(residual[rows]))
        covariance = np.linalg.inv(self._normal(columns[rows], np.full(rows.size, sigma**-2.0)))
        variance = np.einsum("ij,jk,ik->i", columns, covariance, columns)
        is_near = np.abs(residual) < np.maximum(_CLIP * np.sqrt(sigma**2 + variance), _LEAST_LEAD)
        return np.asarray(is_near & ~self._is_beyond(values))

    def _reasons(self, values: Array, is_direct: Mask) -> list[str]:
        """Reason for each shot that is no direct arrival."""
        residual, _ = self._model(values)
        distance = 1e-3 * self._distance(values)
        out = []
        for direct, beyond, late, far in zip(
            is_direct, self._is_beyond(values), residual, distance, strict=True
        ):
            if direct:
                out.append("")
            elif beyond:
                out.append(f"no direct ray at {far:.1f} km: head wave or reflection")
            elif abs(late) < _LEAST_LEAD:
                out.append(f"at {far:.1f} km, first arrivals change from direct to head waves")
            elif late < 0.0:
                out.append(f"head wave at {far:.1f} km, {-late:.2f} s before the direct ray")
            else:
                out.append(f"reflection at {far:.1f} km, {late:.2f} s after the direct ray")
        return out


def _direct_times(medium: Medium, top: float, ranges: Array, depths: Array) -> tuple[Array, Array]:
    """Times of direct rays (n_ranges, n_depths) [s], and the last range with one by depth [m]."""
    middle = medium.north.size // 2, medium.east.size // 2
    centre = np.array([[medium.north[middle[0]], medium.east[middle[1]], 0.0]])
    column = Medium.from_profile(
        medium.depth,
        medium.sound_speed[middle],
        bottom_depth=float(medium.bottom_depth(centre)[0]),
        interpolation=medium.interpolation,
        earth=medium.earth,
    )
    distance, depth = (axis.ravel() for axis in np.meshgrid(ranges, depths, indexing="ij"))
    source = np.tile([0.0, 0.0, max(top, 1e-3)], (distance.size, 1))
    receiver = np.column_stack([distance, np.zeros(distance.size), depth])
    first = find_eigenrays(column, source, receiver).first()
    times = np.array(first.travel_time).reshape(ranges.size, depths.size)
    has_ray = np.isfinite(times).cumprod(axis=0)
    last = np.maximum(has_ray.sum(axis=0) - 1, 0)
    # beyond the last direct ray, times continue with the slowness of the last one
    for of_depth, row in zip(times.T, np.maximum(last, 1), strict=True):
        slope = of_depth[row] - of_depth[row - 1]
        of_depth[row:] = of_depth[row] + slope * np.arange(ranges.size - row)
    return times, ranges[last]
