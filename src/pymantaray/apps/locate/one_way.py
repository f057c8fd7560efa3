"""
Start of one-way surveys with an unknown clock, such as air-gun shots at an ocean-bottom instrument.

The first arrival of a far shot is often a head wave in the sea bed, which is faster than water, or
a reflection beyond the last direct ray. The nearest shots are those of the smallest times. A grid
of positions starts a fit to these; the fit then grows towards farther shots as long as direct rays
explain their times within the noise of the picks.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
            shots = partial(_Shots, survey, rows, end[rows], medium=medium, sign=sign)
            if node.offset_sigma == 0.0:
                free = shots(node=replace(node, offset_sigma=_ANY_OFFSET))
                _check_clock(shots(node=node), free, node.name, survey.source)
                continue
            values, reason[rows] = shots(node=node).solve()
            position[k] = values[:3]
    return DirectArrivals(position, reason.astype(str))


def _check_clock(fixed: "_Shots", free: "_Shots", name: str, source: str) -> None:
    """Raise an error if a free clock explains the times of a node much better than a known one."""
    values, reason = free.solve()
    if abs(values[3]) < _LEAST_OFFSET:
        return
    direct = np.flatnonzero([not word for word in reason])
    ends = [fixed.descend(start, direct)[0] for start in fixed.grid(direct)]
    misfit = min(fixed.misfit(end, direct) for end in ends)
    if misfit > _CLOCK_GAIN * max(free.misfit(values, direct), 1.0):
        raise LocateError(
            f"{source}: the one-way times of node {name} imply a clock offset of about"
            f" {values[3]:.2f} s, but its clock is known; give `offset_sigma`, and for a drift"
            " `drift_sigma`"
        )


class _Times:
    """Travel times of direct rays over distance and depth in the middle of a medium."""

    def __init__(self, medium: Medium, top: float, depths: Array, longest: float) -> None:
        middle = medium.north.size // 2, medium.east.size // 2
        centre = np.array([[medium.north[middle[0]], medium.east[middle[1]], 0.0]])
        column = Medium.from_profile(
            medium.depth,
            medium.sound_speed[middle],
            bottom_depth=float(medium.bottom_depth(centre)[0]),
            interpolation=medium.interpolation,
            earth=medium.earth,
        )
        self.depths = depths
        self.ranges = np.linspace(0.0, longest, _RANGES)
        grid = np.stack(np.meshgrid(self.ranges, depths, indexing="ij"), axis=-1).reshape(-1, 2)
        source = np.tile([0.0, 0.0, max(top, 1e-3)], (len(grid), 1))
        receiver = np.column_stack([grid[:, 0], 0.0 * grid[:, 0], grid[:, 1]])
        first = find_eigenrays(column, source, receiver).first()
        self._time = np.array(first.travel_time).reshape(_RANGES, depths.size)
        has_ray = np.isfinite(self._time)
        last = np.where(has_ray.any(axis=0), has_ray.cumprod(axis=0).sum(axis=0) - 1, 0)
        self.last_range = self.ranges[last]
        # beyond the last direct ray, times continue with the slowness of the last one
        for column_index, row in enumerate(last):
            times = self._time[:, column_index]
            row = max(int(row), 1)
            slope = times[row] - times[row - 1]
            times[row:] = times[row] + slope * np.arange(times.size - row)

    def at(self, distance: Array, depth: float) -> Array:
        """Times of distances (...) for a node at a depth. [s]"""
        i = np.clip(distance / self.ranges[1], 0.0, self.ranges.size - 1.001)
        low = i.astype(int)
        level = float(np.interp(depth, self.depths, np.arange(self.depths.size)))
        upper = min(int(level), max(self.depths.size - 2, 0))
        part = level - upper
        column = self._time[:, upper]
        if self.depths.size > 1:
            column = (1.0 - part) * column + part * self._time[:, upper + 1]
        return np.asarray(column[low] + (i - low) * (column[low + 1] - column[low]))


class _Shots:
    """One-way times of a node, with position, depth, clock and sound speed as unknowns."""

    def __init__(
        self,
        survey: Survey,
        rows: NDArray[np.int64],
        points: Array,
        node: Node,
        medium: Medium,
        sign: float,
    ) -> None:
        self._time = survey.travel_time[rows]
        self._since = survey.time[rows] - survey.time[0]
        self._points = points[:, :2]
        self._sign = sign
        self._node = node
        north, east, depth = node.position
        self._prior = np.array([north, east, depth, 0.0, 0.0, 0.0])
        self._sd = np.maximum(
            [*node.sigma, node.offset_sigma, node.drift_sigma, _SPEED_SIGMA],
            [1e-2, 1e-2, 1e-2, 1e-6, 1e-12, 1e-6],
        )
        spread = 2.5 * node.sigma[2]
        bed = float(np.min(medium.bottom_depth(points))) - 1e-2
        depths = np.clip(depth + np.linspace(-spread, spread, _DEPTHS), _TOP, max(bed, _TOP))
        middle = points[:, :2].mean(axis=0)
        farthest = np.linalg.norm(points[:, :2] - middle, axis=1).max()
        longest = 2.0 * farthest + np.linalg.norm(middle - [north, east]) + max(node.sigma[:2])
        self._times = _Times(
            medium, float(np.median(points[:, 2])), np.unique(depths), min(longest, _LONGEST)
        )
        self._sigma = max(_noise(self._since, self._time), _MIN_SIGMA)

    def solve(self) -> tuple[Array, list[str]]:
        """Values of the unknowns, and a reason for each shot that is no direct arrival."""
        order = np.argsort(self._time, kind="stable")
        n = order.size
        first = min(max(_MIN_PINGS, round(_FIRST_FRACTION * n)), n)
        sizes = [first]
        while sizes[-1] < n:
            sizes.append(min(max(sizes[-1] + 1, round(_GROWTH * sizes[-1])), n))
        starts = self.grid(order[:first])
        fits = []
        for size in sizes:
            ends = [self.descend(start, order[:size]) for start in starts]
            ends.sort(key=lambda end: end[1])
            fits.append(ends[0])
            starts = [values for values, _ in ends]
        pairs = zip(fits, sizes, strict=True)
        misfits = np.array([self.misfit(values, order[:size]) for (values, _), size in pairs])
        allowed = _MISFIT * max(float(misfits.min()), 1.0)
        best = int(np.flatnonzero(misfits <= allowed).max())
        values, _ = fits[best]
        rows = order[: sizes[best]]
        is_near = np.zeros(n, dtype=bool)
        is_near[rows] = True
        for _ in range(_REFITS):
            # other errors of near shots are found later, as in all surveys
            is_direct = self._is_direct(values, rows)
            distance = np.linalg.norm(values[:2] - self._points, axis=1)
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
        centre = points[np.argmin(self._time[rows])]
        half = max(float(np.ptp(points, axis=0).max()), 2.0 * self._node.position[2])
        axis = np.linspace(-half, half, _GRID)
        cells = centre + np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        distance = np.linalg.norm(cells[:, None] - points, axis=-1)
        residual = self._time[rows] - self._times.at(distance, self._node.position[2])
        offset = np.median(residual, axis=1)
        cost = np.median(np.abs(residual - offset[:, None]), axis=1) / self._sigma
        prior = (cells - self._node.position[:2]) / np.maximum(self._node.sigma[:2], 1e-2)
        cost = cost + np.sum(prior**2, axis=1) / rows.size
        starts: list[Array] = []
        for cell in np.argsort(cost):
            if all(np.linalg.norm(cells[cell] - start[:2]) > 0.2 * half for start in starts):
                clock = self._sign * offset[cell]
                depth = self._node.position[2]
                starts.append(np.array([*cells[cell], depth, clock, 0.0, 0.0]))
            if len(starts) == _STARTS:
                break
        return starts

    def _model(self, values: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Residuals and derivatives of the predicted times of some shots."""
        step = values[:2] - self._points[rows]
        distance = np.hypot(step[:, 0], step[:, 1])
        time = self._times.at(distance, values[2])
        slope = (self._times.at(distance + 10.0, values[2]) - time) / 10.0
        by_depth = (self._times.at(distance, values[2] + 1.0) - time) / 1.0
        direction = step / np.maximum(distance, 1e-6)[:, None]
        slowing = 1.0 - values[5]
        clock = self._sign * (values[3] + values[4] * self._since[rows])
        columns = [
            slowing * slope * direction[:, 0],
            slowing * slope * direction[:, 1],
            slowing * by_depth,
            np.full(rows.size, self._sign),
            self._sign * self._since[rows],
            -time,
        ]
        return self._time[rows] - slowing * time - clock, np.column_stack(columns)

    def _normal(self, columns: Array, weight: Array) -> Array:
        return np.asarray(columns.T @ (weight[:, None] * columns) + np.diag(self._sd**-2.0))

    def descend(self, start: Array, rows: NDArray[np.int64]) -> tuple[Array, float]:
        """Values of the lowest Cauchy cost with priors, and this cost."""
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
            new[2] = np.clip(new[2], self._times.depths[0], self._times.depths[-1])
            new_residual, new_columns = self._model(new, rows)
            before = self._cost(values, residual, scale)
            if self._cost(new, new_residual, scale) < before:
                values = new
                residual = new_residual
                columns = new_columns
                damping *= 0.2
                if np.linalg.norm(change[:3]) < _CONVERGED:
                    break
            else:
                damping *= 5.0
        prior = np.sum(((values - self._prior) / self._sd) ** 2)
        squares = np.minimum((residual / self._sigma) ** 2, _CLIP**2)
        return values, float(np.sum(squares) + prior)

    def _cost(self, values: Array, residual: Array, scale: float) -> float:
        """Cauchy cost of residuals with the cost of the priors."""
        robust = (scale / self._sigma) ** 2 * np.log1p((residual / scale) ** 2)
        return float(np.sum(robust) + np.sum(((values - self._prior) / self._sd) ** 2))

    def misfit(self, values: Array, rows: NDArray[np.int64]) -> float:
        """Mean square of scaled and clipped residuals. [-]"""
        residual, _ = self._model(values, rows)
        return float(np.mean(np.minimum((residual / self._sigma) ** 2, _CLIP**2)))

    def _scaled(self, values: Array, rows: NDArray[np.int64]) -> Array:
        """Residuals of all shots over their uncertainty in the fit of some shots."""
        residual, columns = self._model(values, rows)
        sigma = max(self._sigma, robust_sigma(residual))
        covariance = np.linalg.inv(self._normal(columns, np.full(rows.size, sigma**-2.0)))
        all_residual, all_columns = self._model(values, np.arange(self._time.size))
        variance = np.einsum("ij,jk,ik->i", all_columns, covariance, all_columns)
        return np.asarray(all_residual / np.sqrt(sigma**2 + variance))

    def _is_beyond(self, values: Array) -> Mask:
        """True for shots beyond the last direct ray."""
        distance = np.linalg.norm(values[:2] - self._points, axis=1)
        last = np.interp(values[2], self._times.depths, self._times.last_range)
        return np.asarray(distance > last)

    def _is_direct(self, values: Array, rows: NDArray[np.int64]) -> Mask:
        residual, _ = self._model(values, np.arange(self._time.size))
        is_near = (np.abs(self._scaled(values, rows)) < _CLIP) | (np.abs(residual) < _LEAST_LEAD)
        return is_near & ~self._is_beyond(values)

    def _reasons(self, values: Array, is_direct: Mask) -> list[str]:
        residual, _ = self._model(values, np.arange(self._time.size))
        distance = 1e-3 * np.linalg.norm(values[:2] - self._points, axis=1)
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


def _noise(time: Array, values: Array) -> float:
    """Standard deviation of values from their neighbours in time. [s]"""
    order = np.argsort(time, kind="stable")
    t, y = time[order], values[order]
    part = (t[1:-1] - t[:-2]) / np.maximum(t[2:] - t[:-2], 1e-9)
    difference = y[1:-1] - (1.0 - part) * y[:-2] - part * y[2:]
    return robust_sigma(difference / np.sqrt(1.0 + part**2 + (1.0 - part) ** 2))
