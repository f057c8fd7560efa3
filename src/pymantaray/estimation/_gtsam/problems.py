"""What is minimized: a graph whose ranges are distances, or travel times expanded about one place."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values
from pymantaray.estimation.expansion import Block, Expansion, whiten
from pymantaray.estimation.graph import FactorGraph
from pymantaray.estimation.losses import Loss, whitened_ranges
from pymantaray.estimation.range_models import Rows, TimedRanges

Array = NDArray[np.float64]
_MIN_WEIGHT = 1e-12  # of an expanded range; less would leave its rows without digits


class Distances:
    """A graph whose ranges are distances."""

    def __init__(self, builder: FactorBuilder, graph: FactorGraph, loss: Loss | None = None) -> None:
        self._builder, self._graph, self.loss = builder, graph, loss
        self.stock = builder.factors(graph, loss)
        self.error, self.linearize = self.stock.error, self.stock.linearize

    def under(self, loss: Loss | None) -> "Distances":
        """The same ranges under another loss."""
        return Distances(self._builder, self._graph, loss)

    def whitened(self, values: Any) -> Array:
        """Residuals of the ranges in their standard deviations."""
        return whitened_ranges(self._graph, to_graph_values(values, self._graph))


class EpochTerms(NamedTuple):
    """Ranges of one epoch: which rows of the tables, between which keys, and how their residuals are whitened."""

    rows: Rows
    keys: list[int]
    transmitter: Rows  # index into the keys
    receiver: Rows
    root: Array  # lower triangular root of the covariance


def epoch_terms(ranges: TimedRanges, blocks: Sequence[Block]) -> list[EpochTerms]:
    """Ranges of each epoch that has any in use."""
    terms = []
    for rows, covariance in blocks:
        if rows.size:
            ends = np.concatenate([ranges.transmitter[rows], ranges.receiver[rows]])
            keys, at = np.unique(ends, return_inverse=True)
            root = np.asarray(np.linalg.cholesky(covariance), dtype=float)
            terms.append(EpochTerms(rows, keys.tolist(), at[: rows.size], at[rows.size :], root))
    return terms


class Ends:
    """Where the ends of a graph's timed ranges are at GTSAM values, and the unknowns that they share."""

    def __init__(self, ranges: TimedRanges, n_poses: int, shared: int | None = None) -> None:
        self.n_poses, self.shared = n_poses, shared
        self._keys, at = np.unique(np.concatenate([ranges.transmitter, ranges.receiver]), return_inverse=True)
        self._transmitter, self._receiver = at[: ranges.time.size], at[ranges.time.size :]

    def at(self, values: Any) -> tuple[Array, Array, Array]:
        """Positions of transmitters and receivers, shape (n, 3) [m], and the unknowns in their standard deviations."""
        keys, n = self._keys.tolist(), self.n_poses
        ends = [values.atPose3(k).translation() if k < n else values.atPoint3(k) for k in keys]
        place = np.array(ends).reshape(-1, 3)
        return place[self._transmitter], place[self._receiver], self.unknowns(values)

    def unknowns(self, values: Any) -> Array:
        """Shape (n_unknowns,), empty if nothing is shared."""
        return np.empty(0) if self.shared is None else np.array(values.atVector(self.shared), dtype=float)


class ExpandedRanges:
    """
    A graph whose ranges are travel times expanded about one place.

    ``common`` has everything but the ranges; ``stock_of`` gives a graph of stock factors of corrected distances under
    a loss, for damped steps. What the ranges share has a prior of unit covariance about zero. Under a loss the
    covariances of the epochs have to be diagonal.
    """

    def __init__(
        self,
        common: Any,
        ends: Ends,
        terms: list[EpochTerms],
        expansion: Expansion,
        stock_of: Callable[[Loss | None], Any],
        loss: Loss | None = None,
    ) -> None:
        self._common, self._ends, self._terms, self._expansion = common, ends, terms, expansion
        self._stock_of, self.loss = stock_of, loss
        self.shared = ends.shared

    @property
    def stock(self) -> Any:
        """Graph of stock factors."""
        return self._stock_of(self.loss)

    def under(self, loss: Loss | None) -> "ExpandedRanges":
        """The same ranges under another loss."""
        return ExpandedRanges(self._common, self._ends, self._terms, self._expansion, self._stock_of, loss)

    def error(self, values: Any) -> float:
        """Cost at values."""
        residual, _, _ = self._at(values)
        if self.loss is None:
            white = (whiten(t.root, residual[t.rows]) for t in self._terms)
            cost = 0.5 * sum(float(w @ w) for w in white)
        else:
            cost = sum(float(self.loss.cost(u).sum()) for u in self._by_epoch(residual))
        shared = 0.5 * float(np.sum(self._ends.unknowns(values) ** 2))
        return float(self._common.error(values)) + shared + cost

    def whitened(self, values: Any) -> Array:
        """Residuals of the ranges in their standard deviations, epoch by epoch."""
        return np.concatenate([np.empty(0), *self._by_epoch(self._at(values)[0])])

    def linearize(self, values: Any) -> Any:
        """Linear system at values, with one factor for each epoch."""
        linear = self._common.linearize(values)
        residual, by_transmitter, by_receiver = self._at(values)
        terms = self._terms
        if self.loss is not None:
            weights = (np.maximum(self.loss.weight(u), _MIN_WEIGHT) for u in self._by_epoch(residual))
            terms = [t._replace(root=t.root / np.sqrt(w)) for t, w in zip(terms, weights, strict=True)]
        for t in terms:
            jacobian = _jacobians(values, t, self._ends.n_poses, by_transmitter[t.rows], by_receiver[t.rows])
            keys = t.keys
            if self.shared is not None:
                keys = [*keys, self.shared]
                jacobian.append(whiten(t.root, self._expansion.by_unknowns[t.rows]))
            linear.push_back(_linear_factor(t, keys, residual[t.rows], jacobian, values))
        if self.shared is not None:
            u = self._ends.unknowns(values)
            unit = gtsam.noiseModel.Unit.Create(u.size)
            linear.push_back(gtsam.PriorFactorVector(self.shared, np.zeros(u.size), unit).linearize(values))
        return linear

    def _at(self, values: Any) -> tuple[Array, Array, Array]:
        return self._expansion(*self._ends.at(values))

    def _by_epoch(self, residual: Array) -> list[Array]:
        return [residual[t.rows] / np.diagonal(t.root) for t in self._terms]


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
    unit = gtsam.noiseModel.Unit.Create(t.rows.size)
    return gtsam.CustomFactor(unit, keys, error).linearize(few)
