"""
Range models that trace rays: travel times and slowness vectors of the direct arrivals in an assumed
ocean, which may vary in time or have vertical modes of unknown amplitude.
"""

from collections.abc import Callable
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import (
    Currents,
    Medium,
    RayPaths,
    choose_arrivals,
    current_delays,
    find_eigenrays,
    trace_paths,
)
from pymantaray.acoustics.eigenrays import solved_backwards
from pymantaray.acoustics.paths import quadrature, travel_time_sensitivity
from pymantaray.arrays import Array
from pymantaray.estimation import Prediction, RangeEndpoints, RangeModel
from pymantaray.geometry.natural_spline import natural_spline
from pymantaray.records import Arrivals

T = TypeVar("T")


class Pairs(NamedTuple):
    """Links as unordered pairs of positions, each pair once."""

    source: Array
    receiver: Array
    pair: NDArray[np.intp]
    """Row of the pair of each link."""
    backward: NDArray[np.bool_]
    """True if the link runs from the pair's receiver to its source."""


class EigenrayModel(RangeModel):
    """
    Travel time of the earliest direct eigenray in the assumed ocean.

    The cut-off [dB] is that of `find_eigenrays`; currents have their first-order effect, and None
    is water at rest. One call solves all links, reciprocal pairs once. A link without an arrival is
    not possible. The first and the last answers are kept, because the realizations of a study start
    at the same place.
    """

    def __init__(
        self,
        medium: Medium,
        *,
        spreading_cutoff_db: float | None = 15.0,
        currents: Currents | None = None,
    ) -> None:
        self.medium = medium
        self._cutoff = spreading_cutoff_db
        self._currents = currents
        self._latest: dict[bytes, Arrivals] = {}

    def through(self, medium: Medium) -> "EigenrayModel":
        """The same model in another medium."""
        return EigenrayModel(medium, spreading_cutoff_db=self._cutoff, currents=self._currents)

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Travel times, with the slowness vectors at the ends as gradients, which omit the effect of
        currents.
        """
        pairs = pairs_of(links, self.medium)
        arrivals = self._solved(pairs)
        n = pairs.source.shape[0]
        delay = np.zeros(arrivals.link.size)
        if self._currents is not None and delay.size:
            paths = trace_paths(self.medium, pairs.source, pairs.receiver, arrivals)
            delay = current_delays(quadrature(paths), self._currents, delay.size)
        out = []
        for sign in (1.0, -1.0):
            link, row = choose_arrivals(arrivals, "direct", delay=sign * delay)
            time = np.full(n, np.nan)
            ends = np.full((2, n, 3), np.nan)
            time[link] = arrivals.travel_time[row] + sign * delay[row]
            ends[0, link] = -arrivals.source_slowness[row]
            ends[1, link] = arrivals.receiver_slowness[row]
            ends[:, time == 0.0] = 0.0  # equal positions
            out.append((time, ends))
            if self._currents is None:
                out *= 2
                break
        (time, ends), (time_back, ends_back) = out
        p = pairs.pair
        back = pairs.backward
        travel_time = np.where(back, time_back[p], time[p])
        return Prediction(
            travel_time=travel_time,
            transmitter_gradient=np.where(back[:, None], ends_back[1, p], ends[0, p]),
            receiver_gradient=np.where(back[:, None], ends_back[0, p], ends[1, p]),
            possible=np.isfinite(travel_time),
        )

    def paths(self, pairs: Pairs) -> tuple[RayPaths, NDArray[np.int64]]:
        """
        Paths of the direct arrivals, and the pair of each; a pair without an arrival has none.
        """
        arrivals = self._solved(pairs)
        pair, row = choose_arrivals(arrivals, "direct")
        direct = arrivals.at({"arrival": row})
        return trace_paths(self.medium, pairs.source, pairs.receiver, direct), pair

    def _solved(self, pairs: Pairs) -> Arrivals:
        return first_and_last(
            self._latest,
            pairs.source,
            pairs.receiver,
            lambda: find_eigenrays(
                self.medium, pairs.source, pairs.receiver, spreading_cutoff_db=self._cutoff
            ),
        )


def first_and_last(
    answers: dict[bytes, T], source: Array, receiver: Array, answer: Callable[[], T]
) -> T:
    """Answer for pairs of positions; the answers of the first and of the last pairs are kept."""
    key = source.tobytes() + receiver.tobytes()
    if key not in answers:
        while len(answers) > 1:
            answers.pop(list(answers)[1])
        answers[key] = answer()
    return answers[key]


def pairs_of(links: RangeEndpoints, medium: Medium) -> Pairs:
    """
    Unordered pairs of the links' ends, sorted by position; the source is the end at which the rays
    start.

    The noise of a depth sensor can put the estimate of a vehicle above the surface. Such an end is
    moved down to the surface.
    """
    transmitter, receiver = (
        np.column_stack([end[:, :2], np.fmax(end[:, 2], medium.surface_depth(end))])
        for end in (links.transmitter, links.receiver)
    )
    backward = solved_backwards(transmitter, receiver)
    source = np.where(backward[:, None], receiver, transmitter)
    receiver = np.where(backward[:, None], transmitter, receiver)
    distinct, pair = np.unique(np.hstack([source, receiver]), axis=0, return_inverse=True)
    return Pairs(
        np.ascontiguousarray(distinct[:, :3]),
        np.ascontiguousarray(distinct[:, 3:]),
        pair.reshape(-1),
        backward,
    )


class VaryingEigenrays(RangeModel):
    """
    Travel time of the earliest direct eigenray in the water at each ping, by its time since the
    mission's start [s].

    Each prediction makes a medium for each ping, at its time and around its positions (n, 3) [m],
    and does not keep it, so memory does not grow with the pings.
    """

    def __init__(
        self,
        medium_at: Callable[[float, Array], Medium],
        currents_at: Callable[[float], Currents] | None = None,
        *,
        spreading_cutoff_db: float | None = 15.0,
    ) -> None:
        self._medium_at = medium_at
        self._currents_at = currents_at
        self._cutoff = spreading_cutoff_db

    def predict(self, links: RangeEndpoints) -> Prediction:
        """Travel times of the direct arrivals, ping by ping."""
        n = links.time.size
        out = Prediction(
            np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.zeros(n, bool)
        )
        for time in np.unique(links.time):
            rows = links.time == time
            ends = np.concatenate([links.transmitter[rows], links.receiver[rows]])
            model = EigenrayModel(
                self._medium_at(float(time), ends),
                spreading_cutoff_db=self._cutoff,
                currents=None if self._currents_at is None else self._currents_at(float(time)),
            )
            out.put(rows, model.predict(RangeEndpoints(*(column[rows] for column in links))))
        return out


class AdjustableEigenrays(RangeModel):
    r"""
    Travel time of the earliest direct eigenray in an assumed ocean plus the error :math:`\sum_k a_k
    \phi_k(z)` of its sound speed.

    Shapes (n_modes, n_levels) are linear between their levels [m] and constant beyond; the prior
    standard deviation of the amplitudes is in m/s. Rays are traced again in the adjusted medium, so
    travel times are exact for all amplitudes; their derivatives are integrals along these rays
    (Fermat). The shapes are interpolated like the levels of the medium, so both agree to the last
    digit.
    """

    def __init__(
        self, model: EigenrayModel, depth: Array, shapes: Array, amplitude_sigma: Array
    ) -> None:
        self.amplitude_sigma = amplitude_sigma
        medium = model.medium
        self._levels = np.stack([np.interp(medium.depth, depth, shape) for shape in shapes])
        self._model = self._initial = model
        self._amplitudes = np.zeros(amplitude_sigma.size)
        self._latest: Self | None = None

    @property
    def medium(self) -> Medium:
        """Assumed ocean, for which all amplitudes are zero."""
        return self._initial.medium

    def predict(self, links: RangeEndpoints) -> Prediction:
        """Travel times of the direct arrivals."""
        return self._model.predict(links)

    def adjusted(self, amplitudes: Array) -> Self:
        """
        Model with other amplitudes [m/s], relative to the initially assumed ocean; the latest model
        is kept.
        """
        if np.array_equal(amplitudes, self._amplitudes):
            return self
        if self._latest is None or not np.array_equal(amplitudes, self._latest._amplitudes):
            other = type(self).__new__(type(self))
            other.__dict__.update(
                self.__dict__, _latest=None, _amplitudes=np.array(amplitudes, dtype=float)
            )
            medium = self._initial.medium
            other._model = self._initial.through(
                Medium.from_grid(
                    medium.north,
                    medium.east,
                    medium.depth,
                    medium.sound_speed + amplitudes @ self._levels,
                    interpolation=medium.interpolation,
                    bathymetry=medium.bed,
                    ice_draft=medium.surface,
                    earth=medium.earth,
                )
            )
            self._latest = other
        return self._latest

    def sensitivity(self, links: RangeEndpoints) -> Array:
        """
        Derivatives of the travel times by the amplitudes (n, n_modes), zero without an arrival.
        [s²/m]
        """
        pairs = pairs_of(links, self._initial.medium)
        paths, pair = self._model.paths(pairs)
        of_pairs = np.zeros((pairs.source.shape[0], self.amplitude_sigma.size))
        of_pairs[pair] = travel_time_sensitivity(paths, self._shapes_at)
        return of_pairs[pairs.pair]

    def fit(self, difference: Array, weights: Array) -> Array:
        """
        Amplitudes nearest to a difference of sound speeds at the levels, by weighted least squares.
        [m/s]
        """
        root = np.sqrt(weights)
        return np.asarray(
            np.linalg.lstsq((root * self._levels).T, root * difference, rcond=None)[0]
        )

    def _shapes_at(self, position: Array) -> Array:
        medium = self._initial.medium
        z = np.clip(position[:, 2], medium.depth[0], medium.depth[-1])
        if medium.interpolation == "smooth":
            return natural_spline(medium.depth, self._levels, z).T
        return np.stack([np.interp(z, medium.depth, level) for level in self._levels], axis=1)
