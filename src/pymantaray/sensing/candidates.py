"""From ranging to the candidates of every attempt: all arrivals that could be taken for the direct one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import choose_arrivals
from pymantaray.errors import SensingError
from pymantaray.records import Trajectories
from pymantaray.sensing.mistaken import Candidates
from pymantaray.sensing.picker import Picker
from pymantaray.sensing.ranging import Ranging
from pymantaray.sensing.timing import Leg, OneWay, Timing, TwoWay, half_round_trip, velocities

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_ONE_WAY = OneWay()


def find_candidates(
    ranging: Ranging, truth: Trajectories, picker: Picker, *, timing: Timing = _ONE_WAY
) -> Candidates:
    """
    List what each range attempt may take for its direct arrival.

    Parameters
    ----------
    ranging : Ranging
        What `measure_ranges` returned, by the rule ``direct``, with a detector if the picker has a sonar.
    truth : Trajectories
        That was ranged.
    picker : Picker
    timing : OneWay or TwoWay
        As the ranges were measured.

    Returns
    -------
    Candidates
        A link without a direct arrival has its reflected ones. A stopped vehicle's attempts have none.

    Raises
    ------
    SensingError
        If the picker has a sonar, but the arrivals have no loss.

    Notes
    -----
    Without a sonar the losses are the arrivals' spreading alone: reflection and absorption lose nothing. Two-way, ping
    and answer are picked independently.
    """
    arrivals, table = ranging.arrivals, ranging.attempts
    if picker.sonar is not None and ranging.loss_db is None:
        raise SensingError(
            "find_candidates: a picker with a sonar needs ranges that were measured with a detector"
        )
    loss = arrivals.spreading_db if picker.sonar is None or ranging.loss_db is None else ranging.loss_db
    there, back = (_way(ranging, picker, loss, sign) for sign in (1.0, -1.0))
    attempt, link = _attempts_of_links(ranging)
    backward = table.transmitter[attempt] > table.receiver[attempt]
    start, stop = (np.searchsorted(arrivals.link, link, side=side) for side in ("left", "right"))
    row, ping = _spread_out(start, stop)  # which of `attempt`, which arrival
    if isinstance(timing, OneWay):
        chosen = _Way(*(np.where(backward[row], b[ping], t[ping]) for t, b in zip(there, back, strict=True)))
        time, probability, direct = chosen.travel_time, chosen.probability, chosen.direct
        bounces = _bounces(ranging)[ping]
    else:
        one, answer = _spread_out(start[row], stop[row])
        row, ping = row[one], ping[one]
        time, probability, direct = _exchanges(
            ranging, truth, timing, attempt[row], backward[row], ping, answer, there, back
        )
        bounces = _bounces(ranging)[ping] + _bounces(ranging)[answer]
    attempt = attempt[row]
    order = np.lexsort((time, ~direct, attempt))
    return Candidates(
        attempt=attempt[order],
        travel_time=time[order],
        probability=probability[order],
        direct=direct[order],
        bounces=bounces[order],
    )


class _Way(NamedTuple):
    """Arrivals in one direction, row by row."""

    travel_time: Array
    probability: Array
    direct: NDArray[np.bool_]


def _way(ranging: Ranging, picker: Picker, loss: Array, sign: float) -> _Way:
    arrivals = ranging.arrivals
    delay = None if ranging.delay is None else sign * ranging.delay
    time: Array = arrivals.travel_time if delay is None else arrivals.travel_time + delay
    direct = np.zeros(time.size, dtype=bool)
    direct[choose_arrivals(arrivals, "direct", delay=delay).row] = True
    return _Way(time, picker.probabilities(loss, arrivals.link, time), direct)


def _bounces(ranging: Ranging) -> NDArray[np.int16]:
    return np.asarray(ranging.arrivals.surface_bounces + ranging.arrivals.bottom_bounces)


def _attempts_of_links(ranging: Ranging) -> tuple[Indices, Indices]:
    """Attempts whose rays were looked for, and the link of each."""
    table, links = ranging.attempts, ranging.links
    n = 1 + max(table.transmitter.max(initial=0), table.receiver.max(initial=0))
    lower, upper = (
        np.minimum(table.transmitter, table.receiver),
        np.maximum(table.transmitter, table.receiver),
    )
    wanted = (table.sample * n + lower) * n + upper
    there = (links.sample.astype(np.int64) * n + links.first) * n + links.second  # increasing
    at = np.searchsorted(there, wanted)
    found = np.flatnonzero(np.append(there, -1)[at] == wanted)
    return found, at[found]


def _spread_out(start: Indices, stop: Indices) -> tuple[Indices, Indices]:
    """All numbers of several ranges one after the other, and which range each is of."""
    count = stop - start
    of = np.repeat(np.arange(count.size), count)
    return of, np.arange(of.size) - np.repeat(np.cumsum(count) - count, count) + start[of]


def _exchanges(
    ranging: Ranging,
    truth: Trajectories,
    timing: TwoWay,
    attempt: Indices,
    backward: NDArray[np.bool_],
    ping: Indices,
    answer: Indices,
    there: _Way,
    back: _Way,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Half of the round trip, probability, and whether both ways are direct, of pairs of arrivals."""
    arrivals, table = ranging.arrivals, ranging.attempts
    epochs, at = np.unique(table.sample[attempt], return_inverse=True)
    n = 1 + max(table.transmitter.max(initial=0), table.receiver.max(initial=0), truth.name.size - 1)
    velocity = np.zeros((n, epochs.size, 3))
    velocity[: truth.name.size] = velocities(truth, epochs)
    ends = np.stack([-arrivals.source_slowness, arrivals.receiver_slowness])
    own, other = backward.astype(np.int64), 1 - backward.astype(np.int64)

    def leg(row: Indices, returning: NDArray[np.bool_]) -> Leg:
        time = np.where(returning, back.travel_time[row], there.travel_time[row])
        return Leg(time, ends[own, row], ends[other, row])

    time = half_round_trip(
        timing,
        leg(ping, backward),
        leg(answer, ~backward),
        velocity[table.transmitter[attempt], at],
        velocity[table.receiver[attempt], at],
    )
    probability = np.where(
        backward,
        back.probability[ping] * there.probability[answer],
        there.probability[ping] * back.probability[answer],
    )
    direct = np.where(
        backward, back.direct[ping] & there.direct[answer], there.direct[ping] & back.direct[answer]
    )
    return time, probability, direct
