r"""
Terms by which the sound speed may differ from the profile, each a set of columns with a normal prior.

Travel times are :math:`t\,e^{-\gamma}`: :math:`\gamma` is the fraction by which the mean sound speed along a ray exceeds the
profile's. It is a scale, or a cubic B-spline in time, to which horizontal gradients may be added that multiply the platform's or
the node's distance from the array's centre. Amplitudes of vertical modes act by path integrals instead.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pymantaray.errors import LocateError
from pymantaray.locate.survey import Survey
from pymantaray.ocean.modes import VerticalModes

Array = NDArray[np.float64]
Kind = Literal["known", "scale", "time", "gradient", "modes"]
KINDS: tuple[Kind, ...] = ("known", "scale", "time", "gradient", "modes")
KM = 1000.0
_DEGREE = 3
_FEWEST_KNOTS, _MOST_KNOTS, _MOST_GRADIENT_KNOTS = 4, 80, 40
_SHORTEST = 300.0  # s; spacing of knots
_APART = 50.0  # m; nodes nearer than this to their centre show no gradient


@dataclass(frozen=True)
class SpeedPrior:
    """
    What is assumed of the sound speed before the survey.

    Parameters
    ----------
    scale : float
        Standard deviation of the fraction by which the whole profile may be wrong. [-]
    gradient : float
        Standard deviation of the constant part of a horizontal gradient of that fraction. [1/km]
    knot_interval : float
        Spacing of the splines' knots; 0 for one eightieth of the survey, 5 min at least. [s]
    """

    scale: float = 5e-3
    gradient: float = 1e-4
    knot_interval: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.scale > 0.0 and self.gradient > 0.0 and self.knot_interval >= 0.0):
            raise LocateError(
                f"sound speed: scale {self.scale:g}, gradient {self.gradient:g}, knots every {self.knot_interval:g} s;"
                " positive numbers are needed"
            )


class Term:
    """
    Columns of one term.

    ``sd`` are prior standard deviations of its coefficients where these are fixed, and 1 times `weight` where the hyperparameter
    of `group` multiplies them.
    """

    def __init__(self, name: str, group: str, spline: "Spline | None", factor: Array, prior: float) -> None:
        self.name, self.group, self.spline, self.factor = name, group, spline, factor
        if spline is None:
            self.sd, self.scaled = np.array([prior]), np.array([False])
        else:
            self.sd = np.concatenate([prior * spline.unit[:2], spline.unit[2:]])
            self.scaled = np.arange(self.sd.size) >= 2

    def rows(self, part: slice) -> Array:
        """Columns of some pings: the derivative of the fraction gamma by the coefficients."""
        factor = self.factor[part]
        if self.spline is None:
            return np.asarray(factor.mean(axis=1)[:, None])
        both = [self.spline.rows(part, k) * factor[:, k, None] for k in (0, 1)]
        return np.asarray(0.5 * (both[0] + both[1]))


class Spline:
    """
    Cubic B-spline over a survey's time in coordinates of independent priors.

    The second differences of its coefficients are penalized. In the eigenvectors of that penalty the prior is diagonal; the
    first two, a constant and a straight line, carry no penalty. ``unit`` is such that the rest has a mean variance of 1.
    """

    def __init__(self, times: Array, interval: float, most: int) -> None:
        first, last = float(times.min()), float(times.max())
        span = max(last - first, 1.0)
        spacing = interval or max(_SHORTEST, span / most)
        count = max(int(np.ceil(span / spacing)), _FEWEST_KNOTS)
        step = span / count
        self.knots = first + step * np.arange(-_DEGREE, count + _DEGREE + 1)
        self._times = times
        size = count + _DEGREE
        differences = np.diff(np.eye(size), n=2, axis=0)
        values, vectors = np.linalg.eigh(differences.T @ differences)
        line = np.linspace(-1.0, 1.0, size)
        vectors[:, 0] = 1.0 / np.sqrt(size)
        vectors[:, 1] = line / np.linalg.norm(line)
        self._basis = vectors
        unit = np.concatenate([[np.sqrt(size), np.linalg.norm(line)], 1.0 / np.sqrt(values[2:])])
        sample = self.at(np.linspace(first, last, 4 * count))[:, 2:] * unit[2:]
        unit[2:] /= np.sqrt(np.mean(np.sum(sample**2, axis=1)))
        self.unit = unit

    def rows(self, part: slice, end: int) -> Array:
        """Values of the columns at one end's times of some pings."""
        return self.at(self._times[part, end])

    def at(self, time: Array) -> Array:
        """Values of the columns at times within the span."""
        inside = np.clip(time, self.knots[_DEGREE], self.knots[-_DEGREE - 1])
        return np.asarray(BSpline.design_matrix(inside, self.knots, _DEGREE) @ self._basis)


@dataclass(frozen=True, eq=False)
class SoundSpeed:
    """Terms of one kind of model for a survey; ``terms`` of a richer kind begin with those of a poorer one."""

    kind: Kind
    terms: tuple[Term, ...]
    modes: VerticalModes | None = None

    @property
    def size(self) -> int:
        """Number of coefficients, amplitudes of modes included."""
        return sum(t.sd.size for t in self.terms) + (0 if self.modes is None else len(self.modes.modes))

    def rows(self, part: slice) -> Array:
        """Derivative of the fraction by the coefficients without those of modes."""
        n = len(range(*part.indices(1 << 62)))
        return np.concatenate([np.empty((n, 0)), *(t.rows(part) for t in self.terms)], axis=1)

    def fraction(self, coefficients: Array, count: int) -> Array:
        """The fraction gamma of all pings (n,)."""
        out = np.zeros(count)
        at = 0
        for term in self.terms:
            own = coefficients[at : at + term.sd.size]
            at += term.sd.size
            for start in range(0, count, 8192):
                part = slice(start, min(start + 8192, count))
                out[part] += term.rows(part) @ own
        return out


def sound_speed_terms(
    survey: Survey,
    position: Array,
    kind: Kind,
    prior: SpeedPrior,
    modes: VerticalModes | None = None,
) -> SoundSpeed:
    """Terms of a kind of model; the gradients are about the middle of the node positions (n_nodes, 3) [m]."""
    n = len(survey)
    both = np.stack([survey.time, survey.time + np.maximum(survey.travel_time, 0.0)], axis=1)
    one = np.ones((n, 2))
    if kind == "modes":
        if modes is None:
            raise LocateError(
                "sound speed: modes need several profiles, or an ocean, to make them from; give --modes"
            )
        return SoundSpeed(kind, (), modes)
    if kind == "known":
        return SoundSpeed(kind, ())
    if kind == "scale":
        return SoundSpeed(kind, (Term("scale", "", None, one, prior.scale),))
    terms = [Term("time", "time", Spline(both, prior.knot_interval, _MOST_KNOTS), one, prior.scale)]
    if kind == "gradient":
        spline = Spline(both, prior.knot_interval, _MOST_GRADIENT_KNOTS)
        centre = position.mean(axis=0)
        ends = np.stack([survey.transmit_position, survey.receive_position], axis=1) - centre
        ends = np.where(survey.between_nodes[:, None, None], 0.0, ends) / KM
        for axis, name in enumerate(("north", "east")):
            terms.append(
                Term(
                    f"platform gradient {name}", "platform gradient", spline, ends[..., axis], prior.gradient
                )
            )
        offsets = position - centre
        if len(position) > 2 and np.linalg.norm(offsets[:, :2], axis=1).max() > _APART:
            at_node = np.repeat(offsets[survey.node][:, None, :] / KM, 2, axis=1)
            for axis, name in enumerate(("north", "east")):
                terms.append(
                    Term(f"node gradient {name}", "node gradient", spline, at_node[..., axis], prior.gradient)
                )
    return SoundSpeed(kind, tuple(terms))
