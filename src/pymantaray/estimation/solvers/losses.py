"""Robust losses: cost and weight of ranges with errors larger than their noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.names import LossKind
from pymantaray.estimation.ranges.range_models import chord


class _Shape(NamedTuple):
    """Scale that is 95 % as efficient as least squares under normal noise, cost and weight."""

    efficient: float
    cost: Callable[[Array, float], Array]
    """Of sizes of residuals, by the scale."""
    weight: Callable[[Array, float], Array]


_SHAPES: Mapping[str, _Shape] = MappingProxyType(
    {
        "huber": _Shape(
            1.344998,
            lambda u, k: np.where(u <= k, 0.5 * u**2, k * (u - 0.5 * k)),
            lambda u, k: np.asarray(k / np.maximum(u, k)),
        ),
        "cauchy": _Shape(
            2.384947,
            lambda u, k: np.asarray(0.5 * k**2 * np.log1p((u / k) ** 2)),
            lambda u, k: 1.0 / (1.0 + (u / k) ** 2),
        ),
        "geman-mcclure": _Shape(
            3.787419,
            lambda u, k: 0.5 * u**2 / (1.0 + (u / k) ** 2),
            lambda u, k: 1.0 / (1.0 + (u / k) ** 2) ** 2,
        ),
        "tukey": _Shape(
            4.685065,
            lambda u, k: k**2 / 6.0 * (1.0 - np.maximum(1.0 - (u / k) ** 2, 0.0) ** 3),
            lambda u, k: np.asarray(np.maximum(1.0 - (u / k) ** 2, 0.0) ** 2),
        ),
        "welsch": _Shape(
            2.984637,
            lambda u, k: np.asarray(-0.5 * k**2 * np.expm1(-((u / k) ** 2))),
            lambda u, k: np.asarray(np.exp(-((u / k) ** 2))),
        ),
    }
)


@dataclass(frozen=True)
class Loss:
    r"""
    Cost of a whitened residual that grows more slowly than its square.

    Parameters
    ----------
    kind : {"huber", "cauchy", "geman-mcclure", "tukey", "welsch"}
    scale : float
        Residual above which a range loses weight, in its standard deviations. [-]
    graduated : bool
        Graduated non-convexity: begin with a scale so large that the loss is nearly quadratic, and
        reduce it step by step. For ``geman-mcclure`` only.

    Raises
    ------
    EstimationError
        If the kind is unknown, the scale is not positive and finite, or the kind cannot be
        graduated.

    Notes
    -----
    With the whitened residual :math:`u` and the scale :math:`k`:

    - ``huber``: :math:`u^2/2` up to :math:`k`, :math:`k(|u| - k/2)` beyond; convex
    - ``cauchy``: :math:`(k^2/2) \log(1 + u^2/k^2)`; the weight falls without limit
    - ``geman-mcclure``: :math:`(k^2/2)\, u^2/(k^2 + u^2)`; at most :math:`k^2/2` for any residual
    - ``tukey``: :math:`(k^2/6) (1 - (1 - u^2/k^2)^3)` up to :math:`k`, :math:`k^2/6` beyond, where
      a range has no weight
    - ``welsch``: :math:`(k^2/2) (1 - e^{-u^2/k^2})`

    The surrogates of graduated non-convexity [1]_ for Geman-McClure with control parameter
    :math:`\mu` are the same loss with the scale :math:`k\sqrt{\mu}`.

    References
    ----------
    .. [1] GTSAM, ``gtsam/nonlinear/GncOptimizer.h`` (functions initializeMu, updateMu), which names
       Yang, Antonante, Tzoumas and Carlone, "Graduated Non-Convexity for Robust Spatial
       Perception", as its source.

    Examples
    --------
    >>> from pymantaray.estimation import Loss
    >>> print(Loss("huber", scale=1.345).weight([0.5, 2.69]))
    [1.  0.5]
    """

    kind: LossKind
    scale: float
    graduated: bool = False

    def __post_init__(self) -> None:
        """Refuse an unknown kind or an unusable scale."""
        if self.kind not in _SHAPES:
            raise EstimationError(f"loss {self.kind!r}; allowed are {', '.join(_SHAPES)}")
        if not (self.scale > 0.0 and np.isfinite(self.scale)):
            raise EstimationError(
                f"loss {self.kind}: scale is {self.scale:g}; it must be positive and finite"
            )
        if self.graduated and self.kind != "geman-mcclure":
            raise EstimationError(f"loss {self.kind} cannot be graduated; only geman-mcclure can")

    @property
    def incremental(self) -> bool:
        """
        True if ranges can enter one by one: none is needed beforehand, and one that is far from its
        prediction keeps enough weight to correct it.
        """
        return not self.graduated and self.kind not in {"tukey", "welsch"}

    def cost(self, residual: ArrayLike) -> Array:
        """
        Cost of whitened residuals, half the square near zero.

        Parameters
        ----------
        residual : array_like, shape (...)
            Whitened residuals. [-]

        Returns
        -------
        ndarray, shape (...)
            Cost. [-]
        """
        size = np.abs(np.asarray(residual, dtype=float))
        return np.asarray(_SHAPES[self.kind].cost(size, self.scale))

    def weight(self, residual: ArrayLike) -> Array:
        """
        Weight relative to least squares: the slope of the cost divided by the residual.

        Parameters
        ----------
        residual : array_like, shape (...)
            Whitened residuals. [-]

        Returns
        -------
        ndarray, shape (...)
            Weight; 1 at zero. [-]
        """
        size = np.abs(np.asarray(residual, dtype=float))
        return np.asarray(_SHAPES[self.kind].weight(size, self.scale))


LOSSES: Mapping[str, Loss] = MappingProxyType(
    {
        **{kind: Loss(kind, _SHAPES[kind].efficient) for kind in get_args(LossKind)},
        "gnc": Loss("geman-mcclure", _SHAPES["geman-mcclure"].efficient, graduated=True),
    }
)
"""
Losses by name, each with the scale that is 95 % as efficient as least squares without outliers.
"""


def whitened_ranges(graph: FactorGraph, values: GraphValues) -> Array:
    """Residuals of the ranges in their standard deviations, shape (n_ranges,)."""
    position = np.concatenate([values.position, values.landmark_position])
    ranges = graph["range"]
    distance, _ = chord(*position[ranges.variables.T])
    return np.asarray((distance - ranges.column("distance")) / np.sqrt(ranges.variance))
