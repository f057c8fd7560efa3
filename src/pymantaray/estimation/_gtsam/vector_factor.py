"""One factor for all ranges of a ping epoch: as linear terms of the outer iteration, and nonlinear as its check."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.assemble import TimedRanges
from pymantaray.estimation.expansion import Expansion
from pymantaray.estimation.range_models import RangeLinks
from pymantaray.estimation.range_weights import BelievedRanges, whiten

Array = NDArray[np.float64]


class EpochTerms(NamedTuple):
    """Ranges of one epoch: which rows of the tables, between which keys, and how their residuals are whitened."""

    rows: NDArray[np.intp]
    keys: list[int]
    transmitter: NDArray[np.intp]
    receiver: NDArray[np.intp]
    root: Array


def epoch_terms(ranges: TimedRanges, blocks: Sequence[tuple[NDArray[np.intp], Array]]) -> list[EpochTerms]:
    """
    Prepare the ranges of each epoch.

    Parameters
    ----------
    ranges : TimedRanges
    blocks : sequence of (rows, covariance)
        For each epoch the rows that are used, and the covariance of their residuals [m²].

    Returns
    -------
    list of EpochTerms
        ``transmitter`` and ``receiver`` are indices into ``keys``, ``root`` is the covariance's lower triangular
        root. Epochs without rows are left out.
    """
    terms = []
    for rows, covariance in blocks:
        if rows.size:
            ends = np.concatenate([ranges.transmitter[rows], ranges.receiver[rows]])
            keys, at = np.unique(ends, return_inverse=True)
            root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
            terms.append(EpochTerms(rows, keys.tolist(), at[: rows.size], at[rows.size :], root))
    return terms


class ExpandedRanges:
    """
    A graph whose ranges are travel times expanded about one place, for `optimize`.

    Parameters
    ----------
    base : gtsam.NonlinearFactorGraph
        Everything but the ranges.
    stock : callable
        Gives the same with stock range factors of corrected distances, for damped steps; asked only then.
    terms : list of EpochTerms
    n_poses : int
        Keys from here on are landmarks.
    expansion : Expansion
        Of all ranges.
    rows : tuple of ndarray
        Variables of the transmitters and the receivers of all ranges.
    shared : int, optional
        Key of the unknowns that all ranges share; their prior is of unit covariance about zero.
    """

    def __init__(
        self,
        base: Any,
        stock: Any,
        terms: list[EpochTerms],
        n_poses: int,
        expansion: Expansion,
        rows: tuple[NDArray[np.intp], NDArray[np.intp]],
        shared: int | None = None,
    ) -> None:
        self._stock, self.shared = stock, shared
        self._base, self._terms, self._n_poses, self._expansion = base, terms, n_poses, expansion
        self._keys, at = np.unique(np.concatenate(rows), return_inverse=True)
        self._ends = at[: rows[0].size], at[rows[0].size :]

    @property
    def stock(self) -> Any:
        """Graph of stock factors, for damped steps."""
        return self._stock()

    def error(self, values: Any) -> float:
        """
        Cost at values.

        Parameters
        ----------
        values : gtsam.Values

        Returns
        -------
        float
        """
        residual, _, _ = self._at(values)
        white = (whiten(t.root, residual[t.rows]) for t in self._terms)
        return self._error_without_ranges(values) + 0.5 * sum(float(w @ w) for w in white)

    def linearize(self, values: Any) -> Any:
        """
        Linear system at values, with one factor for each epoch.

        Parameters
        ----------
        values : gtsam.Values

        Returns
        -------
        gtsam.GaussianFactorGraph
        """
        linear = self._base.linearize(values)
        residual, by_transmitter, by_receiver = self._at(values)
        for t in self._terms:
            jacobian = _jacobians(values, t, self._n_poses, by_transmitter[t.rows], by_receiver[t.rows])
            keys = t.keys
            if self.shared is not None:
                keys = [*keys, self.shared]
                jacobian.append(whiten(t.root, self._expansion.by_unknowns[t.rows]))
            linear.push_back(_linear_factor(t, keys, residual[t.rows], jacobian, values))
        if self.shared is not None:
            linear.push_back(unit_prior(self.shared, self._unknowns(values).size).linearize(values))
        return linear

    def _error_without_ranges(self, values: Any) -> float:
        return float(self._base.error(values)) + 0.5 * float(np.sum(self._unknowns(values) ** 2))

    def _unknowns(self, values: Any) -> Array:
        return np.empty(0) if self.shared is None else np.asarray(values.atVector(self.shared), dtype=float)

    def _at(self, values: Any) -> tuple[Array, Array, Array]:
        place = positions(values, self._keys, self._n_poses)
        return self._expansion(place[self._ends[0]], place[self._ends[1]], self._unknowns(values))


def unit_prior(key: int, dimension: int) -> Any:
    """
    Prior of unit covariance about zero.

    Parameters
    ----------
    key, dimension : int
        Of a vector.

    Returns
    -------
    gtsam.PriorFactorVector
    """
    return gtsam.PriorFactorVector(key, np.zeros(dimension), gtsam.noiseModel.Unit.Create(dimension))


def vector_factors(
    believed: BelievedRanges, terms: list[EpochTerms], n_poses: int, shared: int | None = None
) -> Any:
    """
    Nonlinear factors, one for each epoch, that ask the model at every evaluation.

    Slow, since every evaluation is a call of Python and of the model: the check of the outer iteration. A link that
    is not possible at the values has no residual and no gradient.

    Parameters
    ----------
    believed : BelievedRanges
    terms : list of EpochTerms
    n_poses : int
        Keys from here on are landmarks.
    shared : int, optional
        Key of the unknowns, if any are believed; their prior is among the factors.

    Returns
    -------
    gtsam.NonlinearFactorGraph
    """
    out = gtsam.NonlinearFactorGraph()
    for t in terms:
        keys = t.keys if shared is None else [*t.keys, shared]
        out.add(gtsam.CustomFactor(_unit(t), keys, _error_function(believed, t, n_poses, shared)))
    if shared is not None:
        out.add(unit_prior(shared, believed.n_unknowns))
    return out


def positions(values: Any, keys: Any, n_poses: int) -> Array:
    """
    Positions of some variables.

    Parameters
    ----------
    values : gtsam.Values
    keys : sequence of int
    n_poses : int
        Keys from here on are landmarks.

    Returns
    -------
    ndarray, shape (n, 3)
        [m]
    """
    found = [values.atPose3(int(k)).translation() if k < n_poses else values.atPoint3(int(k)) for k in keys]
    return np.array(found).reshape(-1, 3)


def _unit(t: EpochTerms) -> Any:
    return gtsam.noiseModel.Unit.Create(t.rows.size)


def _error_function(believed: BelievedRanges, t: EpochTerms, n_poses: int, shared: int | None) -> Any:
    ranges = believed.ranges
    speed = ranges.sound_speed[t.rows]

    def error(_factor: Any, values: Any, jacobians: Any) -> Array:
        place = positions(values, t.keys, n_poses)
        links = RangeLinks(ranges.time[t.rows], place[t.transmitter], place[t.receiver], speed)
        u = np.empty(0) if shared is None else np.asarray(values.atVector(shared), dtype=float)
        found, by_unknowns = believed.predict(links, t.rows, u)
        residual = np.where(found.possible, speed * (found.travel_time - ranges.travel_time[t.rows]), 0.0)
        if jacobians is not None:
            scale = np.where(found.possible, speed, 0.0)[:, None]
            gradients = [
                scale * np.where(found.possible[:, None], g, 0.0)
                for g in (found.transmitter_gradient, found.receiver_gradient)
            ]
            blocks = _jacobians(values, t, n_poses, *gradients)
            if shared is not None:
                blocks.append(whiten(t.root, scale * np.where(found.possible[:, None], by_unknowns, 0.0)))
            for i, block in enumerate(blocks):
                jacobians[i] = block
        return whiten(t.root, residual)

    return error


def _jacobians(
    values: Any, t: EpochTerms, n_poses: int, by_transmitter: Array, by_receiver: Array
) -> list[Array]:
    """Whitened derivative of an epoch's residuals by each of its variables, poses in the body's tangent."""
    m = t.rows.size
    dense = np.zeros((m, len(t.keys), 3))
    row = np.arange(m)
    np.add.at(dense, (row, t.transmitter), by_transmitter)
    np.add.at(dense, (row, t.receiver), by_receiver)
    white = whiten(t.root, dense.reshape(m, -1)).reshape(dense.shape)
    out = []
    for i, key in enumerate(t.keys):
        if key < n_poses:
            turned = white[:, i] @ values.atPose3(key).rotation().matrix()
            out.append(np.hstack([np.zeros((m, 3)), turned]))
        else:
            out.append(white[:, i])
    return [np.asfortranarray(block) for block in out]


def _linear_factor(
    t: EpochTerms, keys: list[int], residual: Array, jacobian: list[Array], values: Any
) -> Any:
    """Linear factor of any number of variables; GTSAM's constructors for Python take at most three."""
    white = whiten(t.root, residual)

    def error(_factor: Any, _values: Any, jacobians: Any) -> Array:
        if jacobians is not None:
            for i, block in enumerate(jacobian):
                jacobians[i] = block
        return np.asarray(white)

    few = gtsam.Values()
    for i, (key, block) in enumerate(zip(keys, jacobian, strict=True)):
        if i == len(t.keys):  # what all ranges share
            few.insert(key, np.asarray(values.atVector(key)))
        elif block.shape[1] == 6:
            few.insert(key, values.atPose3(key))
        else:
            few.insertPoint3(key, values.atPoint3(key))
    return gtsam.CustomFactor(_unit(t), keys, error).linearize(few)
