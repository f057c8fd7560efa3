"""What is believed of the ranges of a graph, and the covariances of their residuals epoch by epoch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from pymantaray.estimation.assemble import TimedRanges
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.range_models import Prediction, RangeLinks, RangeModel, TravelTimeUncertainty
from pymantaray.estimation.unknowns import Unknowns

Array = NDArray[np.float64]
_REWEIGH = 100.0  # m; a larger move of any end asks for new variances


@dataclass(frozen=True, eq=False)
class BelievedRanges:
    """
    What an estimator makes of the ranges of a graph.

    Parameters
    ----------
    model : RangeModel
    ranges : TimedRanges
        What was measured, row by row the ranges of the graph.
    uncertainty : TravelTimeUncertainty, optional
        Adds to the ranges' own variance. By default that stands alone.
    correlated : bool
        Whether the covariances between the links of an epoch count, beside the variances.
    unknowns : Unknowns, optional
        What is to be estimated with the poses. By default nothing is.
    """

    model: RangeModel
    ranges: TimedRanges
    uncertainty: TravelTimeUncertainty | None = None
    correlated: bool = False
    unknowns: Unknowns | None = None

    @property
    def n_unknowns(self) -> int:
        """Dimension of the variable that all ranges share."""
        return 0 if self.unknowns is None else self.unknowns.sigma.size

    def predict(self, links: RangeLinks, rows: NDArray[np.intp], u: Array) -> tuple[Prediction, Array]:
        """
        Travel times to be expected of some of the ranges.

        Parameters
        ----------
        links : RangeLinks
        rows : ndarray of int, shape (n,)
            Which ranges they are.
        u : ndarray, shape (n_unknowns,)
            Unknowns in their standard deviations.

        Returns
        -------
        found : Prediction
        by_unknowns : ndarray, shape (n, n_unknowns)
            [s]
        """
        if self.unknowns is None:
            return self.model.predict(links), np.empty((links.time.size, 0))
        return self.unknowns.predict(links, rows, u)


class RangeWeights:
    """
    Covariances of the residuals of each epoch, computed anew when the ends have moved far.

    Parameters
    ----------
    believed : BelievedRanges
    variance : ndarray, shape (n,)
        Of the ranges apart from what the ocean adds. [m2]
    """

    def __init__(self, believed: BelievedRanges, variance: Array) -> None:
        self._believed, self._variance = believed, variance
        epoch = believed.ranges.epoch
        self._rows = [np.flatnonzero(epoch == e) for e in range(int(epoch.max(initial=-1)) + 1)]
        self._place: Array | None = None
        self._full = [np.diag(variance[rows]) for rows in self._rows]

    def blocks(self, links: RangeLinks, used: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], Array]]:
        """
        Rows and covariance of the used ranges of each epoch, with the ends where the links have them.

        Parameters
        ----------
        links : RangeLinks
        used : ndarray of bool, shape (n,)

        Returns
        -------
        list of tuple of ndarray
            Rows, shape (k,), and covariance, shape (k, k). [m2]
        """
        uncertainty, place = (
            self._believed.uncertainty,
            np.concatenate([links.transmitter, links.receiver]),
        )
        stale = self._place is None or float(np.abs(place - self._place).max(initial=0.0)) > _REWEIGH
        if uncertainty is not None and stale:
            self._place = place
            c = links.sound_speed
            for e, extra in enumerate(uncertainty.covariances(links, self._believed.ranges.epoch)):
                rows = self._rows[e]
                added = c[rows][:, None] * extra * c[rows]
                kept = added if self._believed.correlated else np.diag(np.diagonal(added))
                self._full[e] = np.diag(self._variance[rows]) + kept
        return self.kept(used)

    def kept(self, used: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], Array]]:
        """
        As `blocks`, with the covariances computed last.

        Parameters
        ----------
        used : ndarray of bool, shape (n,)

        Returns
        -------
        list of tuple of ndarray
        """
        out = []
        for rows, full in zip(self._rows, self._full, strict=True):
            mine = used[rows]
            out.append((rows[mine], full[np.ix_(mine, mine)]))
        return out


def cost_of_ranges(blocks: list[tuple[NDArray[np.intp], Array]], residual: Array, loss: Loss | None) -> float:
    """
    Cost of ranges.

    Parameters
    ----------
    blocks : list of tuple of ndarray
        From `RangeWeights`.
    residual : ndarray, shape (n,)
        [m]
    loss : Loss or None
        None for least squares.

    Returns
    -------
    float
        Half the sum of squares, or of the losses, of the whitened residuals.
    """
    if loss is not None:
        return sum(
            float(loss.cost(residual[rows] / np.sqrt(np.diagonal(full))).sum()) for rows, full in blocks
        )
    white = (
        whiten(np.asarray(np.linalg.cholesky(full), dtype=float), residual[rows]) for rows, full in blocks
    )
    return 0.5 * sum(float(w @ w) for w in white)


def whiten(root: Array, values: Array) -> Array:
    """
    Divide by the root of a covariance.

    Parameters
    ----------
    root : ndarray, shape (m, m)
        Lower triangular; most often diagonal, for links that share no error.
    values : ndarray, shape (m,) or (m, k)

    Returns
    -------
    ndarray
        Of the shape of the values, ordered by columns.
    """
    if np.count_nonzero(root) == root.shape[0]:
        return np.asfortranarray((values.T / np.diagonal(root)).T)
    return np.asfortranarray(solve_triangular(root, values, lower=True))
