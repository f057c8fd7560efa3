r"""
Corrections of the sound speed relative to the profile, as terms with columns and normal priors.

Travel times are :math:`t\,e^{-\gamma}`, where :math:`\gamma` is the fraction by which the mean
sound speed along a ray exceeds that of the profile. It is a scale, or a cubic B-spline in time,
plus optional horizontal gradients, which multiply the distance of the platform or the node from the
array's centre. Amplitudes of vertical modes use path integrals instead.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from pymantaray.apps.locate.options import Kind, SpeedPrior
from pymantaray.apps.locate.survey import Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.ocean.modes import VerticalModes

KM = 1000.0
_CHUNK = 8192  # pings whose rows are in memory at a time
_DEGREE = 3
_UNPENALIZED = 1  # column of a spline whose prior is not that of the drift: the mean
_MIN_KNOTS = 4
_MAX_KNOTS = 120
_MAX_GRADIENT_KNOTS = 40
_KNOTS_LIMIT = 1000  # of intervals on request, for the memory
_MIN_KNOT_INTERVAL = 300.0  # s
_MIN_NODE_SPREAD = 50.0  # m; distance of nodes from their centre that is required for a gradient


class Term:
    """
    Columns of one term.

    ``sd`` are prior standard deviations of its coefficients. If the hyperparameter of `group`
    multiplies them, they are 1 times `weight`.
    """

    def __init__(self, group: str, spline: "Spline | None", factor: Array, prior: float) -> None:
        self.group = group
        self.spline = spline
        self.factor = factor
        if spline is None:
            self.sd = np.array([prior])
            self.scaled = np.array([False])
        else:
            self.scaled = np.arange(spline.unit.size) >= _UNPENALIZED
            self.sd = np.where(self.scaled, spline.unit, prior * spline.unit)

    def rows(self, part: slice) -> Array:
        """Columns of a slice of pings: derivative of the fraction gamma by the coefficients."""
        factor = self.factor[part]
        if self.spline is None:
            return np.asarray(factor.mean(axis=1)[:, None])
        at_transmission, at_reception = (
            self.spline.at(self.spline.times[part, end]) * factor[:, end, None] for end in (0, 1)
        )
        return np.asarray(0.5 * (at_transmission + at_reception))


class Spline:
    """
    Cubic B-spline over a survey's time in coordinates with independent priors.

    Without a `memory`, the prior penalizes second differences of the coefficients: an integrated
    random walk. With one [s], it is an Ornstein-Uhlenbeck process whose correlation falls to 1/e in
    this time, a random walk if that is the survey's duration. The coordinates are eigenvectors of
    the prior about the mean, which is the first coordinate and has a prior of its own. ``unit``
    normalizes the mean variance of the others, the drift, to 1.
    """

    def __init__(self, times: Array, interval: float, most: int, memory: float = np.inf) -> None:
        first = float(times.min())
        last = float(times.max())
        span = max(last - first, 1.0)
        spacing = interval or max(_MIN_KNOT_INTERVAL, span / most)
        if not span <= _KNOTS_LIMIT * spacing:
            raise LocateError(
                f"knot_interval is {spacing:g} s in a survey of {span:g} s; allowed are"
                f" {span / _KNOTS_LIMIT:.2g} s or more"
            )
        count = max(int(np.ceil(span / spacing)), _MIN_KNOTS)
        step = span / count
        self.knots = first + step * np.arange(-_DEGREE, count + _DEGREE + 1)
        self.times = times
        size = count + _DEGREE
        if np.isinf(memory):
            line = np.linspace(-1.0, 1.0, size)
            differences = np.diff(np.eye(size), n=2, axis=0)
            values, vectors = np.linalg.eigh(differences.T @ differences)
            walk = (vectors[:, 2:] / values[2:]) @ vectors[:, 2:].T
            # half of the variance is a straight line, which has no second differences
            prior = walk / np.trace(walk) + np.outer(line, line) / (line @ line)
        else:
            apart = step * np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
            prior = np.exp(-apart / memory)
        without_mean = np.eye(size) - 1.0 / size
        values, vectors = np.linalg.eigh(without_mean @ prior @ without_mean)
        self._basis = np.column_stack([np.full(size, size**-0.5), vectors[:, _UNPENALIZED:]])
        unit = np.sqrt(values[_UNPENALIZED:])
        sample = self.at(np.linspace(first, last, 4 * count))[:, _UNPENALIZED:] * unit
        unit /= np.sqrt(np.mean(np.sum(sample**2, axis=1)))
        self.unit = np.concatenate([[np.sqrt(size)], unit])

    def at(self, time: Array) -> Array:
        """Values of the columns at times within the survey."""
        inside = np.clip(time, self.knots[_DEGREE], self.knots[-_DEGREE - 1])
        return np.asarray(BSpline.design_matrix(inside, self.knots, _DEGREE) @ self._basis)


@dataclass(frozen=True, eq=False)
class SoundSpeed:
    """
    Terms of a kind of model for a survey.

    ``terms`` of a richer kind begin with those of a simpler kind.
    """

    kind: Kind
    terms: tuple[Term, ...]
    modes: VerticalModes | None = None
    memory: float = np.inf
    """Memory of the splines' prior. [s]"""

    @property
    def size(self) -> int:
        """Number of coefficients, including amplitudes of modes."""
        n_modes = 0 if self.modes is None else len(self.modes.modes)
        return sum(term.sd.size for term in self.terms) + n_modes

    def rows(self, part: slice) -> Array:
        """Derivative of the fraction gamma by the coefficients, without modes."""
        n = part.stop - part.start
        return np.concatenate([np.empty((n, 0)), *(term.rows(part) for term in self.terms)], axis=1)

    def fraction(self, coefficients: Array, count: int) -> Array:
        """Fraction gamma of all pings (n,)."""
        starts = range(0, count, _CHUNK)
        parts = [slice(start, min(start + _CHUNK, count)) for start in starts]
        return np.concatenate([self.rows(part) @ coefficients for part in parts])


def sound_speed_terms(
    survey: Survey,
    position: Array,
    kind: Kind,
    prior: SpeedPrior,
    modes: VerticalModes | None = None,
    memory: float = np.inf,
) -> SoundSpeed:
    """
    Terms of a kind of model.

    Gradients are relative to the middle of the node positions (n_nodes, 3) [m].
    """
    n = len(survey)
    times = np.stack([survey.time, survey.time + np.maximum(survey.travel_time, 0.0)], axis=1)
    one = np.ones((n, 2))
    if kind == "modes":
        if modes is None:
            raise LocateError(
                "speed_model 'modes' needs vertical modes; give several profiles or an ocean as"
                " `modes`"
            )
        return SoundSpeed(kind, (), modes)
    if kind == "known":
        return SoundSpeed(kind, ())
    if kind == "scale":
        return SoundSpeed(kind, (Term("", None, one, prior.scale),))
    spline = Spline(times, prior.knot_interval, _MAX_KNOTS, memory)
    terms = [Term("time", spline, one, prior.scale)]
    if kind == "gradient":
        spline = Spline(times, prior.knot_interval, _MAX_GRADIENT_KNOTS, memory)
        centre = position.mean(axis=0)
        ends = np.stack([survey.transmit_position, survey.receive_position], axis=1) - centre
        distances = {"platform gradient": np.where(survey.between_nodes[:, None, None], 0.0, ends)}
        offsets = position - centre
        if len(position) > 2 and np.linalg.norm(offsets[:, :2], axis=1).max() > _MIN_NODE_SPREAD:
            distances["node gradient"] = np.repeat(offsets[survey.node][:, None, :], 2, axis=1)
        terms += [
            Term(name, spline, distance[..., axis] / KM, prior.gradient)
            for name, distance in distances.items()
            for axis in (0, 1)
        ]
    return SoundSpeed(kind, tuple(terms), memory=memory)
