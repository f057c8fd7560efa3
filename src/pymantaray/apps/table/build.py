"""Build a travel-time table: cells are halved until the interpolation error is below a bound."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.table.cells import LEAF, REFERENCE_SLOWNESS, CellStatus, Tree, interpolate
from pymantaray.apps.table.samples import NO_ARRIVAL, OUTSIDE, Sampler, Samples
from pymantaray.arrays import Array
from pymantaray.errors import OnlineError
from pymantaray.jobs.progress import CountProgress

Whole = NDArray[np.int64]
_FIRST_HALVINGS = (2, 3, 3)  # of every cell along each axis before any cell is accepted
_SAMPLE = 32  # cells that are refined first for an estimate of the work
_MIN_PLACES = 50  # of the sample in a generation, for its share of all places
_MARGIN = 0.5  # share of the bound that the error at the tested points may have
_MIN_COSINE = 0.1  # of the angle from the horizontal, in the conversion of travel time to range
_QUARTERS = np.array(
    [[1 + 2 * x, 1 + 2 * y, 1 + 2 * z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
)
_HALVES = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2], [0, 1, 2], indexing="ij"), axis=-1).reshape(
    -1, 3
)
_CORNERS = np.array([[corner & 1, corner >> 1 & 1, corner >> 2 & 1] for corner in range(8)])
_CENTRED = np.vstack([2 * _CORNERS, [1, 1, 1]])
_CORNER_ROWS = np.array(
    [int(np.flatnonzero(np.all(2 * c == _HALVES, axis=1))[0]) for c in _CORNERS]
)
_FINEST = 2  # binary logarithm of the smallest cell in lattice steps
# size of a cell without an arrival: a larger one may hide arrivals between the tested points
_LARGEST_SHADOW = _FINEST + 1
_BRANCH_BYTES = 4  # approximate sizes in a table
_CELL_BYTES = 60
_Accepted = tuple[Whole, Whole, Whole]
"""Branches of cells, keys of their corners, and their status."""
_Verdicts = tuple[NDArray[np.bool_], Whole, Whole]
"""Cells that are final, their status, and the axis along which to halve the others."""
_KEY_BITS = 21  # per coordinate of a lattice point in a key


@dataclass(frozen=True)
class Box:
    """
    Limits of a table and its smallest cells.

    Attributes
    ----------
    lower, upper : tuple of float
        Source depth, receiver depth and horizontal range. [m]
    smallest : tuple of float
        Largest permitted size of the smallest cells along each axis. [m]
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    smallest: tuple[float, float, float]

    @property
    def halvings(self) -> tuple[int, int, int]:
        """Number of times that each axis may be halved."""
        wanted = np.ceil(np.log2(np.subtract(self.upper, self.lower) / self.smallest))
        return tuple(int(n) for n in np.clip(wanted, _FIRST_HALVINGS, _KEY_BITS - 3))  # type: ignore[return-value]


class _Store:
    """Solved lattice points, each once, sorted by key."""

    def __init__(
        self, box: Box, sampler: Sampler, notify: Callable[[float], None] | None = None
    ) -> None:
        self._lower = np.array(box.lower)
        self.step = np.subtract(box.upper, box.lower) / np.exp2(np.array(box.halvings) + _FINEST)
        self._sampler = sampler
        self._notify = notify
        self.keys = np.empty(0, dtype=np.int64)
        self._samples: Samples | None = None

    @property
    def solved(self) -> Samples:
        """Arrivals at all solved points, by key."""
        if self._samples is None:
            raise AssertionError("no point is solved")
        return self._samples

    def places(self, points: Whole) -> Array:
        """Convert lattice points to depths and ranges."""
        return np.asarray(self._lower + points * self.step)

    def rows(self, points: Whole) -> Whole:
        """Rows of lattice points, shape (..., 3), after those that are not yet solved have been."""
        keys = _keys(points)
        new = np.setdiff1d(keys, self.keys)
        if new.size:
            places = self.places(self.points(new))
            progress = _counted(self._notify, self.keys.size, new.size)
            self._add(new, _rounded(self._sampler(places, progress)))
        return np.searchsorted(self.keys, keys)

    def family(self, points: Whole) -> Whole:
        """Families of lattice points, shape (..., 3)."""
        rows = self.rows(points)
        return self.solved.family[rows]

    @staticmethod
    def points(keys: Whole) -> Whole:
        """Lattice points of keys."""
        mask = (1 << _KEY_BITS) - 1
        return np.column_stack([keys >> 2 * _KEY_BITS, keys >> _KEY_BITS & mask, keys & mask])

    def _add(self, keys: Whole, samples: Samples) -> None:
        """Merge new points into the sorted store."""
        if self._samples is not None:
            samples = Samples._make(
                np.concatenate(pair) for pair in zip(self._samples, samples, strict=True)
            )
            keys = np.concatenate([self.keys, keys])
        order = np.argsort(keys)
        self.keys, self._samples = keys[order], Samples._make(column[order] for column in samples)


def _counted(
    notify: Callable[[float], None] | None, solved: int, n_new: int
) -> CountProgress | None:
    """Callback that reports the number of solved points while more are solved."""
    if notify is None:
        return None
    return lambda done, total: notify(solved + n_new * done / total)


def _keys(points: Whole) -> Whole:
    """Keys of lattice points, shape (..., 3)."""
    return (points[..., 0] << 2 * _KEY_BITS) + (points[..., 1] << _KEY_BITS) + points[..., 2]


def _corner_keys(cells: "_Cells") -> Whole:
    """Keys of the corners of cells, shape (n, 8)."""
    return _keys(cells.low[:, None] + (_CORNERS << cells.log_size[:, None]))


def _rounded(samples: Samples) -> Samples:
    """Round what is stored to single precision, so that the tested errors include the rounding."""
    return samples._replace(
        value=samples.value.astype(np.float32).astype(np.float64),
        gradient=samples.gradient.astype(np.float32).astype(np.float64),
    )


class _Cells(NamedTuple):
    """
    Boxes of one generation: lowest lattice point, binary logarithm of the size in lattice steps,
    and branch of the tree.
    """

    low: Whole
    log_size: Whole
    branch: Whole


class _Forecast:
    """
    Estimate of the share of the work that is done, from the number of solved places.

    Before most of the work, a sample of cells is refined to the end. It tells how many places there
    are in each later generation of cells; each generation that is done tells the ratio of all
    cells to the sample. The first halvings, before the sample, count as no share.

    Parameters
    ----------
    report : callable or None
        Called with the share. None: no cells are sampled.
    members : int
        Number of oceans, of which all but the first are solved at the corners of final cells.
    """

    def __init__(self, report: Callable[[float], None] | None, members: int) -> None:
        self.report = report
        self._more = members - 1.0
        self._generation = 0
        self._places: list[int] = []
        self._ratio = 1.0
        self._total = math.inf
        self._share = 0.0
        self._before = 0

    def begin(self, store: _Store, cells: _Cells, top: Whole, tolerance: float) -> None:
        """Prepare for the next generation of cells; refine the sample after the first halvings."""
        self._generation += 1
        sampled = self._generation == sum(_FIRST_HALVINGS) + 1
        if self.report is not None and sampled and cells.branch.size > _SAMPLE:
            self._places, corners = _refined_sample(store, cells, top, tolerance)
            self._more *= corners / max(sum(self._places), 1)
            self._ratio = cells.branch.size / _SAMPLE
            self._estimate(store.keys.size)
        self._before = store.keys.size

    def end(self, store: _Store) -> None:
        """Count a generation that is done."""
        if self._places:
            own = self._places.pop(0)
            if own >= _MIN_PLACES:
                self._ratio = 1.0 + (store.keys.size - self._before) / own
            self._estimate(store.keys.size)

    def settle(self, places: int) -> None:
        """Replace the estimate by the number of places of all oceans, which is now known."""
        self._total = places

    def finish(self) -> None:
        """Report that all work is done."""
        self.settle(1)
        self.solved(1.0)

    def solved(self, places: float) -> None:
        """Report the share for this number of solved places; it never decreases."""
        if self.report is not None:
            self._share = max(self._share, min(places / self._total, 1.0))
            self.report(self._share)

    def _estimate(self, solved: int) -> None:
        """Estimate the number of places of all oceans from the sample's places to come."""
        tree = solved + (self._ratio - 1.0) * sum(self._places)
        self._total = tree * (1.0 + self._more)


def _refined_sample(
    store: _Store, cells: _Cells, top: Whole, tolerance: float
) -> tuple[list[int], int]:
    """
    Number of new places in each generation of a sample of cells that is refined to the end, and of
    corners of its final cells.
    """
    rows = np.random.default_rng(0).choice(cells.branch.size, _SAMPLE, replace=False)
    part = _Cells(*(column[rows] for column in cells))
    places = []
    corners = []
    while part.branch.size:
        before = store.keys.size
        done, status, axis = _verdicts(store, part, top, tolerance)
        places.append(store.keys.size - before)
        corners.append(_corner_keys(part)[done & (status <= CellStatus.AMBIGUOUS)].ravel())
        part = _halves(part, ~done, axis, np.zeros(np.count_nonzero(~done), dtype=np.int64))
    return places, np.unique(np.concatenate(corners)).size


def build_tree(
    box: Box,
    samplers: Sequence[Sampler],
    tolerance: float,
    *,
    max_bytes: float = math.inf,
    other_bytes: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> Tree:
    """
    Halve cells until the interpolated range errs by less than a tolerance at all tested points.

    Parameters
    ----------
    box : Box
        Limits of the table and its smallest cells.
    samplers : sequence of callable
        Solvers of places, such as `Radial`. The first defines the table, and the standard deviation
        is that over all.
    tolerance : float
        Bound of the error of the interpolated range at a given travel time. [m]
    max_bytes : float
        Largest allowed size of the table. [B]
    other_bytes : float
        Size of the sectors that the table already has. [B]
    progress : callable, optional
        Called with the estimated share of the work that is done.

    Returns
    -------
    Tree
        One sector. Cells of the smallest size that cannot be interpolated have status BORDER.
    """
    forecast = _Forecast(progress, len(samplers))
    store = _Store(box, samplers[0], None if progress is None else forecast.solved)
    branch = np.zeros(1, dtype=np.int64)
    top = np.array(box.halvings) + _FINEST
    cells = _Cells(np.zeros((1, 3), dtype=np.int64), top[None, :], np.zeros(1, dtype=np.int64))
    accepted: list[_Accepted] = []
    while cells.branch.size:
        forecast.begin(store, cells, top, tolerance)
        done, status, axis = _verdicts(store, cells, top, tolerance)
        corners = _corner_keys(cells)
        has = done & (status <= CellStatus.AMBIGUOUS)
        accepted.append((cells.branch[has], corners[has], status[has]))
        empty = done & ~has
        branch[cells.branch[empty]] = (status[empty] << 3) | LEAF
        children = branch.size + 2 * np.arange(np.count_nonzero(~done))
        branch[cells.branch[~done]] = (children << 2) | axis[~done]
        branch = np.concatenate([branch, np.zeros(2 * children.size, dtype=np.int64)])
        forecast.end(store)
        cells = _halves(cells, ~done, axis, children)
        size = _BRANCH_BYTES * branch.size + _CELL_BYTES * sum(part[0].size for part in accepted)
        _check_size(other_bytes + size, max_bytes, tolerance)
    tree = _tree(store, branch, accepted)
    _check_size(other_bytes + tree.nbytes, max_bytes, tolerance)
    if len(samplers) > 1:
        tree = tree._replace(sigma=_sigma(store, accepted, samplers, forecast))
    forecast.finish()
    return tree


def _verdicts(store: _Store, cells: _Cells, top: Whole, tolerance: float) -> _Verdicts:
    """
    Decide which cells are final, their status, and the axis along which to halve the others.

    The corners are sufficient to halve a cell if their families differ; most cells of water with
    many arrivals are such cells.
    """
    family = store.family(cells.low[:, None] + (_CORNERS << cells.log_size[:, None]))
    mixed = np.any(family != family[:, :1], axis=1)
    can = cells.log_size > _FINEST
    done = np.asarray(~can.any(axis=1))
    status = np.full(done.size, int(CellStatus.BORDER))
    axis = np.zeros(done.size, dtype=np.int64)
    axis[mixed] = _axis_of_corners(family[mixed], cells.log_size[mixed], can[mixed])
    # the smallest cells have no halves that would use their other points
    finest = np.flatnonzero(done & ~mixed)
    finest_cells = _Cells(*(column[finest] for column in cells))
    mixed[finest] = ~_may_be_accurate(store, finest_cells, _MARGIN * tolerance)
    alike = np.flatnonzero(~mixed)
    if alike.size:
        one_family = _Cells(*(column[alike] for column in cells))
        done[alike], status[alike], axis[alike] = _judge(store, one_family, top, tolerance)
    return done, status, axis


def _axis_of_corners(family: Whole, log_size: Whole, can: NDArray[np.bool_]) -> Whole:
    """Axis along which to halve cells: the longest one along which the family changes."""
    cube = family.reshape(-1, 2, 2, 2)  # the last axis of a cube is the first of a cell
    changes = np.stack(
        [np.any(np.diff(cube, axis=3 - axis) != 0, axis=(1, 2, 3)) for axis in range(3)], axis=1
    )
    score = np.where(changes, 1e6 * log_size, 0.0) + 1e-9 * log_size
    return np.asarray(np.argmax(np.where(can, score, -1.0), axis=1))


def _judge(store: _Store, cells: _Cells, top: Whole, tolerance: float) -> _Verdicts:
    """As `_verdicts`, for cells whose corners have equal families."""
    rows = store.rows(cells.low[:, None] + (_HALVES << (cells.log_size[:, None] - 1)))
    samples = store.solved
    family = samples.family[rows]
    alike = np.all(family == family[:, :1], axis=1)
    error = np.full(rows.shape, np.inf)
    regular = np.flatnonzero(alike & (family[:, 0] >= 0))
    size = np.exp2(cells.log_size) * store.step
    corners = rows[:, _CORNER_ROWS]
    error[regular] = _errors(samples, corners[regular], size[regular], rows[regular], 0.5 * _HALVES)
    jump = np.zeros((*rows.shape, 3))
    jump[regular] = _jumps(samples, rows[regular], size[regular])
    halvings = top - cells.log_size
    early = np.any(halvings < _FIRST_HALVINGS, axis=1)
    accurate = np.maximum(error, jump.sum(axis=2)).max(axis=1) <= _MARGIN * tolerance
    accurate &= _accurate_within(store, cells, corners, accurate & ~early, _MARGIN * tolerance)
    can = cells.log_size > _FINEST
    empty = alike & (family[:, 0] < 0)
    unsure = (family[:, 0] == NO_ARRIVAL) & np.any(cells.log_size > _LARGEST_SHADOW, axis=1)
    done = ~early & (accurate | (empty & ~unsure)) | ~can.any(axis=1)
    bounced = samples.bounces[rows[:, 0]].any(axis=1)
    status = np.where(bounced, CellStatus.BOUNCED, CellStatus.DIRECT)
    status = np.where(samples.several[rows].any(axis=1), CellStatus.AMBIGUOUS, status)
    nothing = np.where(family[:, 0] == OUTSIDE, CellStatus.OUTSIDE, CellStatus.SHADOW)
    status = np.where(accurate, status, np.where(empty, nothing, CellStatus.BORDER))
    return (
        done,
        status.astype(np.int64),
        _axis(family, error, jump, cells.log_size, early[:, None] & (halvings < _FIRST_HALVINGS)),
    )


def _may_be_accurate(store: _Store, cells: _Cells, bound: float) -> NDArray[np.bool_]:
    """True for cells that are accurate at their corners and centre, and of one family there."""
    rows = store.rows(cells.low[:, None] + (_CENTRED << (cells.log_size[:, None] - 1)))
    family = store.solved.family[rows]
    good = np.all(family == family[:, :1], axis=1)
    some = np.flatnonzero(good & (family[:, 0] >= 0))
    size = np.exp2(cells.log_size[some]) * store.step
    error = _errors(store.solved, rows[some, :8], size, rows[some, 8:], 0.5 * _CENTRED[8:])
    jump = _jumps(store.solved, rows[some], size).sum(axis=2)
    good[some] = np.maximum(error.max(axis=1), jump.max(axis=1)) <= bound
    return np.asarray(good)


def _accurate_within(
    store: _Store, cells: _Cells, corners: Whole, candidate: NDArray[np.bool_], bound: float
) -> NDArray[np.bool_]:
    """
    True for candidates that are accurate, and of one family, also at eight points between the
    corners and the centre.
    """
    which = np.flatnonzero(candidate)
    keys = store.keys[corners[which]]  # rows move when points are added
    inner = store.rows(cells.low[which, None] + (_QUARTERS << (cells.log_size[which, None] - 2)))
    rows = np.searchsorted(store.keys, keys)
    size = np.exp2(cells.log_size[which]) * store.step
    error = _errors(store.solved, rows, size, inner, 0.25 * _QUARTERS)
    alike = np.all(store.solved.family[inner] == store.solved.family[rows[:, :1]], axis=1)
    accurate = np.zeros(candidate.size, dtype=np.bool_)
    accurate[which] = alike & (np.max(error, axis=1, initial=0.0) <= bound)
    return accurate


def _errors(samples: Samples, corners: Whole, size: Array, rows: Whole, at: Array) -> Array:
    """
    Errors of the interpolated range at points of cells, where ``at`` is their position within each
    cell. [m]
    """
    repeat = len(at)
    interpolated = interpolate(
        np.tile(at, (len(rows), 1)),
        np.repeat(size, repeat, axis=0),
        np.repeat(samples.value[corners], repeat, axis=0),
        np.repeat(samples.gradient[corners], repeat, axis=0),
    ).value.reshape(rows.shape)
    difference = np.abs(interpolated - samples.value[rows]) * samples.straight[rows]
    return difference * REFERENCE_SLOWNESS / _slope(samples, rows)


def _slope(samples: Samples, rows: Whole) -> Array:
    """Change of travel time per metre of range in the conversion of errors. [s/m]"""
    return np.asarray(np.maximum(samples.slowness[rows], _MIN_COSINE * REFERENCE_SLOWNESS))


def _jumps(samples: Samples, rows: Whole, size: Array) -> Array:
    """
    Largest jumps of the range near points of cells, if the next arrival becomes the first, shape
    (n, 27, 3).

    A small region in which another arrival is the first may lie between the points. Each point
    covers a quarter of the cell on both sides along each axis; the lead over the next arrival is
    extrapolated over this distance. The jump of a point is the sum over the axes, each with its
    share. [m]
    """
    change = np.abs(samples.lead_gradient[rows]) * (0.25 * size[:, None])
    total = change.sum(axis=2)
    excess = np.maximum(total - samples.lead[rows], 0.0) / _slope(samples, rows)
    return np.asarray(change * (excess / np.where(total > 0.0, total, 1.0))[..., None])


def _axis(
    family: Whole, error: Array, jump: Array, log_size: Whole, early: NDArray[np.bool_]
) -> Whole:
    """
    Axis along which to halve each cell: one along which the family changes, or the one with the
    largest error.
    """
    n = len(family)
    cube_family = family.reshape(n, 3, 3, 3)
    cube_error = error.reshape(n, 3, 3, 3)
    score = np.empty((n, 3))
    for axis in range(3):
        lines = np.moveaxis(cube_family, axis + 1, 1)
        changes = np.any(lines[:, 1:] != lines[:, :-1], axis=(1, 2, 3))
        middle = np.moveaxis(cube_error, axis + 1, 1)[:, 1][:, ::2, ::2].max(axis=(1, 2))
        middle = np.maximum(
            np.where(np.isfinite(middle), middle, 0.0), jump[:, :, axis].max(axis=1)
        )
        score[:, axis] = np.where(changes, 1e6 * log_size[:, axis], middle)
    score += 1e-9 * log_size + np.where(early, 1e9, 0.0)
    return np.asarray(np.argmax(np.where(log_size > _FINEST, score, -1.0), axis=1))


def _halves(cells: _Cells, split: NDArray[np.bool_], axis: Whole, children: Whole) -> _Cells:
    """Both halves of each cell that is split."""
    along = axis[split]
    log_size = cells.log_size[split].copy()
    each = np.arange(along.size)
    log_size[each, along] -= 1
    upper = cells.low[split].copy()
    upper[each, along] += 1 << log_size[each, along]
    return _Cells(
        np.concatenate([cells.low[split], upper]),
        np.concatenate([log_size, log_size]),
        np.concatenate([children, children + 1]),
    )


def _check_size(size: float, max_bytes: float, tolerance: float) -> None:
    """Raise an error for a table that is too large."""
    if size > max_bytes:
        raise OnlineError(
            f"travel-time table: more than {max_bytes / 1e3:.0f} kB are needed; smooth the profile"
            f" (`smooth=10`), allow a larger error (`tolerance={4.0 * tolerance:g}`), or give"
            " larger steps, narrower limits or fewer `sectors`"
        )


def _sigma(
    store: _Store, accepted: list[_Accepted], samplers: Sequence[Sampler], forecast: _Forecast
) -> NDArray[np.float32]:
    """
    Standard deviation over all oceans of the values at the corners, over those with an arrival of
    the same family.
    """
    keys = np.unique(np.concatenate([part[1].ravel() for part in accepted]))
    rows = np.searchsorted(store.keys, keys)
    own = store.solved.family[rows]
    values = [store.solved.value[rows]]
    notify = None if forecast.report is None else forecast.solved
    forecast.settle(store.keys.size + keys.size * (len(samplers) - 1))
    for k, sampler in enumerate(samplers[1:]):
        progress = _counted(notify, store.keys.size + k * keys.size, keys.size)
        member = sampler(store.places(store.points(keys)), progress)
        values.append(np.where(member.family == own, member.value, np.nan))
    number = np.isfinite(values).sum(axis=0)
    spread = np.nanstd(values, axis=0) * np.sqrt(number / np.maximum(number - 1, 1))
    return np.where(number > 1, spread, 0.0).astype(np.float32)


def _tree(store: _Store, branch: Whole, accepted: list[_Accepted]) -> Tree:
    """Number the cells with an arrival and keep the points that are their corners."""
    samples = store.solved
    cell_branch, keys, status = (np.concatenate(parts) for parts in zip(*accepted, strict=True))
    order = np.argsort(cell_branch)
    used, corner = np.unique(keys[order], return_inverse=True)
    branch[cell_branch[order]] = (np.arange(order.size) << 3) | 0b100 | LEAF
    rows = np.searchsorted(store.keys, used)
    first = np.searchsorted(store.keys, keys[order][:, 0])
    return Tree(
        branch=branch.astype(np.uint32),
        status=status[order].astype(np.uint8),
        surface_bounces=samples.bounces[first, 0].astype(np.uint8),
        bottom_bounces=samples.bounces[first, 1].astype(np.uint8),
        corner=corner.reshape(keys.shape).astype(np.uint32),
        value=np.column_stack([samples.value[rows], samples.gradient[rows]]).astype(np.float32),
        sigma=np.empty(0, dtype=np.float32),
        root=np.zeros(1, dtype=np.uint32),
    )
