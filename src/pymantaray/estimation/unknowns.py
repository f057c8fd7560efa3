"""Unknowns that ranges share, estimated with the poses: amplitudes of sound-speed modes, offset and skew of clocks."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.assemble import TimedRanges
from pymantaray.estimation.range_models import Prediction, RangeLinks, RangeModel

Array = NDArray[np.float64]


@runtime_checkable
class AdjustableModel(Protocol):
    """A range model whose ocean has shapes of unknown amplitude."""

    amplitude_sigma: Array
    """Prior standard deviation of each amplitude about zero, shape (n_modes,). [m s⁻¹]"""

    def predict(self, links: RangeLinks) -> Prediction:
        """Travel times of all links."""
        ...

    def adjusted(self, amplitudes: Array) -> "AdjustableModel":
        """Give the model with these amplitudes, shape (n_modes,), counted from the ocean that was believed first. [m s⁻¹]."""
        ...

    def sensitivity(self, links: RangeLinks) -> Array:
        """Change of the travel times by the amplitudes, shape (n, n_modes); zero where not possible. [s² m⁻¹]."""
        ...


class ClockPrior(NamedTuple):
    """What is known of the vehicles' clocks beforehand; landmarks keep true time."""

    offset_sigma: float
    """Standard deviation of each clock's offset at the start of the mission; 0 where it is known to be none. [s]"""
    skew_sigma: float
    """Of its growth with time, likewise. [-]"""
    turn_around: float | None = None
    """From ping to answer of a two-way exchange; None where ranging is one way. [s]"""


class Unknowns:
    r"""
    Parameters that the ranges of one graph share, each with a Gaussian prior about zero.

    Parameters
    ----------
    model : RangeModel
        The amplitudes of an `AdjustableModel` are unknowns.
    ranges : TimedRanges
    pose_agent : ndarray of int, shape (n_poses,)
        Vehicle of each pose; variables beyond are landmarks.
    agent_name : sequence of str
    clocks : ClockPrior, optional
        By default clocks are taken to be right.

    Attributes
    ----------
    name, unit : tuple of str
    sigma : ndarray, shape (n_unknowns,)
        Prior standard deviation of each, in its unit.

    Raises
    ------
    EstimationError
        If a standard deviation is not positive and finite, or nothing is unknown.

    Notes
    -----
    The solver has them in units of their standard deviations: one variable :math:`u \sim N(0, I)`. One way, a
    ping sent at true time T and received at T + t is measured as

    .. math:: t + o_r + k_r (T + t) - o_t - k_t T

    with the offsets o and skews k of receiver and transmitter; two ways, after the turn-around time
    :math:`\tau`, half the round trip less that as :math:`t + \frac12 [k_i (2 t + \tau) - k_r \tau]`.
    """

    def __init__(
        self,
        model: RangeModel,
        ranges: TimedRanges,
        pose_agent: NDArray[np.int32],
        agent_name: Sequence[str],
        *,
        clocks: ClockPrior | None = None,
    ) -> None:
        self._model, self._clocks = model, clocks
        modes = model.amplitude_sigma if isinstance(model, AdjustableModel) else np.empty(0)
        n = len(agent_name)
        names = [f"mode {k + 1}" for k in range(modes.size)]
        units, sigma = ["m/s"] * modes.size, [*modes]
        self._known = [
            clocks is None or clocks.offset_sigma == 0.0,
            clocks is None or clocks.skew_sigma == 0.0,
        ]
        if clocks is not None:
            kinds = ("clock offset", "s", clocks.offset_sigma), ("clock skew", "1", clocks.skew_sigma)
            for known, (what, unit, prior) in zip(self._known, kinds, strict=True):
                names += [] if known else [f"{what} {name}" for name in agent_name]
                units += [] if known else [unit] * n
                sigma += [] if known else [prior] * n
        self.name, self.unit, self.sigma = tuple(names), tuple(units), np.array(sigma, dtype=float)
        if not self.name:
            raise EstimationError(
                "unknowns: neither modes nor clocks; give one of them or leave unknowns out"
            )
        wrong = ~((self.sigma > 0.0) & np.isfinite(self.sigma))
        if wrong.any():
            first = int(np.argmax(wrong))
            raise EstimationError(
                f"unknowns: prior sigma of {names[first]} is {self.sigma[first]:g} {units[first]}; needs a positive"
                " finite value"
            )
        self._n_modes, self._n_agents = modes.size, n
        agent = np.append(
            np.asarray(pose_agent, dtype=np.intp), n
        )  # all landmarks as one agent, left out in the end
        last = agent.size - 1
        self._transmitter, self._receiver = (
            agent[np.minimum(v, last)] for v in (ranges.transmitter, ranges.receiver)
        )

    def predict(self, links: RangeLinks, rows: NDArray[np.intp], u: Array) -> tuple[Prediction, Array]:
        """
        Measured travel times to be expected, and how they change with the unknowns.

        Parameters
        ----------
        links : RangeLinks
        rows : ndarray of int, shape (n,)
            Which of the ranges the links are.
        u : ndarray, shape (n_unknowns,)
            In standard deviations.

        Returns
        -------
        found : Prediction
        by_unknowns : ndarray, shape (n, n_unknowns)
            [s]
        """
        value, k = self.sigma * u, self._n_modes
        columns = []
        if isinstance(self._model, AdjustableModel):
            model = self._model.adjusted(value[:k])
            found = model.predict(links)
            columns.append(model.sensitivity(links))
        else:
            found = self._model.predict(links)
        if not all(self._known):
            by_clocks = self._by_clocks(links.time, np.where(found.possible, found.travel_time, 0.0), rows)
            found = found._replace(travel_time=found.travel_time + by_clocks @ value[k:])
            columns.append(by_clocks)
        return found, np.hstack(columns) * self.sigma

    def _by_clocks(self, sent: Array, time: Array, rows: NDArray[np.intp]) -> Array:
        """Change of measured travel times by the offsets of all clocks, then by their skews; without the known ones."""
        assert self._clocks is not None  # asked only then
        n = self._n_agents
        offset, skew = np.zeros((rows.size, n + 1)), np.zeros((rows.size, n + 1))
        row, t, r = np.arange(rows.size), self._transmitter[rows], self._receiver[rows]
        if self._clocks.turn_around is None:
            offset[row, r] += 1.0
            offset[row, t] -= 1.0
            skew[row, r] += sent + time
            skew[row, t] -= sent
        else:
            skew[row, t] += time + 0.5 * self._clocks.turn_around
            skew[row, r] -= 0.5 * self._clocks.turn_around
        return np.hstack(
            [by[:, :n] for by, known in zip((offset, skew), self._known, strict=True) if not known]
        )


class UnknownsEstimate(NamedTuple):
    """What a solve found of the unknowns that its ranges share."""

    name: tuple[str, ...]
    unit: tuple[str, ...]
    prior_sigma: Array
    """Shape (n_unknowns,)."""
    value: Array
    """Shape (n_unknowns,)."""
    covariance: Array
    """Shape (n_unknowns, n_unknowns), in the units of the values."""
