"""Ranges without noise: pairs of every ping, their receptions, and outcomes of attempts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.currents import Currents
from pymantaray.arrays import Array, Codes, Indices, Mask
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import Arrivals, RangingTruth, RayStatus, Trajectories, VehicleStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.exchanges import (
    exchange_times,
    exchange_values,
    selected_exchanges,
    velocities_of,
)
from pymantaray.sensing.landmarks import Landmark, check_names, landmark_positions
from pymantaray.sensing.receptions import Receptions, join_receptions, values_at
from pymantaray.sensing.schedule import Attempts, Schedule
from pymantaray.sensing.timing import ONE_WAY, Timing
from pymantaray.sensing.transmission import DIRECT, ReceptionOptions, Transmission, find_receptions


@dataclass(frozen=True, eq=False)
class Links(Record):
    """
    Unordered pairs of participants at a ping, row by row the links of an `Arrivals` record.

    A participant is an index into the vehicles if it is below their number, otherwise this number
    plus an index into the landmarks. The first participant is the source of the rays, the second
    the receiver.
    """

    kind: ClassVar[str] = "links"

    sample: Column = column("link", "1", "index into time", "i4")
    first: Column = column("link", "1", "participant at the source", "i4")
    second: Column = column("link", "1", "participant at the receiver", "i4")


def link_positions(
    truth: Trajectories, landmark_position: Array, links: Links, end: Literal["first", "second"]
) -> Array:
    """
    Return the positions of one end of each link.

    Parameters
    ----------
    truth : Trajectories
        True poses of the vehicles.
    landmark_position : ndarray, shape (n_landmarks, 3)
        Positions of the landmarks. [m]
    links : Links
        Links.
    end : {"first", "second"}
        End of each link.

    Returns
    -------
    ndarray, shape (n_links, 3)
        Positions. [m]

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import link_positions
    >>> print(link_positions(truth, np.empty((0, 3)), ranging.links, "second"))
    [[2000.    0.  400.]]
    """
    return _positions(truth, landmark_position, getattr(links, end), links.sample)


def _positions(
    truth: Trajectories, landmark_position: Array, participant: Indices, sample: Indices
) -> Array:
    """Positions of participants at samples. [m]"""
    n_vehicles = truth.name.size
    positions = truth.position[np.minimum(participant, n_vehicles - 1), sample]
    is_landmark = participant >= n_vehicles
    positions[is_landmark] = landmark_position[participant[is_landmark] - n_vehicles]
    return np.asarray(positions)


class Ranging(NamedTuple):
    """
    All range attempts without noise, one row each, and the arrivals and receptions behind them.
    """

    attempts: Attempts
    status: Codes
    truth: RangingTruth
    links: Links
    arrivals: Arrivals
    receptions: Receptions
    link: Indices
    """Row of `links` of each attempt; -1 if one of both participants is silent."""
    probability: Array | None = None
    """
    Probability that an attempt succeeds (two-way: ping and answer); NaN without an arrival, None
    without a detector.
    """


def measure_ranges(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    medium: Medium | Callable[[float], Medium],
    schedule: Schedule,
    reception: ReceptionOptions = DIRECT,
    *,
    currents: Currents | Callable[[float], Currents] | None = None,
    timing: Timing = ONE_WAY,
    progress: CountProgress | None = None,
) -> Ranging:
    """
    Range between all pairs that a schedule names, at every ping.

    Parameters
    ----------
    truth : Trajectories
        True poses of the vehicles.
    landmarks : sequence of Landmark
        Fixed receivers.
    medium : Medium or callable
        Sound speed and bathymetry; if they vary in time, a function that returns them at a time of
        the truth [s]. It is called once per ping.
    schedule : PingSchedule, SlotSchedule or PingList
        Times and transmitters of the pings.
    reception : ReceptionOptions
        By default direct arrivals, all of them detected.
    currents : Currents or callable, optional
        Their first-order effect on travel times, a function if they vary. By default the water is
        at rest.
    timing : OneWay or TwoWay
        One-way, the fleet is at rest during a ping; two-way, it moves as the truth says.
    progress : callable, optional
        Called with the number of finished unordered pairs, counted at every ping, and the total.

    Returns
    -------
    Ranging
        A link without an arrival has a status with the reason, and a travel time of NaN. A stopped
        vehicle is silent: its attempts have status STOPPED and all values that need no arrival, and
        its links are not among `links` and `arrivals`. If an end lies outside the water (status
        OUTSIDE), the travel time along the chord and the sound speed are NaN too.

    Raises
    ------
    SensingError
        If a ping is not at a sample, or a name is used twice.

    Notes
    -----
    Sound travels through the water as it is at the ping; two-way, this includes the answer: in the
    seconds of an exchange the ocean does not change. Only one medium is in memory at a time.

    Except for the current, travel time is reciprocal. Therefore each unordered pair is solved once
    per sample, whichever of the two transmits. The two refracted ranges ``c t`` of a pair differ,
    because the sound speed is that at the transmitter (two-way: the initiator).

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import PingSchedule, measure_ranges
    >>> ranging = measure_ranges(truth, [], medium, PingSchedule(interval=600.0))
    >>> ranging.status.tolist(), ranging.truth.travel_time.round(4).tolist()
    ([0, 0], [1.393, 1.393])
    """
    check_names(truth.name.tolist(), landmarks)
    attempts = schedule.attempts(
        truth.time, truth.name.tolist(), [landmark.name for landmark in landmarks]
    )
    pairs = _pairs(attempts, truth, landmarks)
    changes = np.empty(0, dtype=np.int64)  # first pairs of a new water
    if callable(medium) or callable(currents):
        changes = np.flatnonzero(np.diff(pairs.sample)) + 1
    parts = []
    for start, stop in pairwise([0, *changes.tolist(), pairs.sample.size]):
        now = float(truth.time[pairs.sample[start]]) if stop else 0.0
        water = medium(now) if callable(medium) else medium
        flow = currents(now) if callable(currents) else currents
        parts.append(_transmit(reception, pairs, slice(start, stop), water, flow, progress))
        del water, flow  # one medium is in memory at a time
    sound = join_transmissions([sound for sound, _ in parts])
    chords = [chords for _, chords in parts]
    all_chords = _Chords(*(np.concatenate(values) for values in zip(*chords, strict=True)))
    ranging = _ranging(attempts, pairs, sound, all_chords, truth, timing)
    return ranging if reception.detector is not None else ranging._replace(probability=None)


class _Pairs(NamedTuple):
    """Unordered pairs with attempts, each once per sample."""

    of_attempt: Indices
    """Pair of each attempt."""
    sample: Indices
    first: Indices
    second: Indices
    """Participants of each pair, in ascending order."""
    source: Array
    receiver: Array
    """Positions of both, shape (n_pairs, 3). [m]"""
    silent: Mask
    """True if one of both participants has stopped."""


def _pairs(attempts: Attempts, truth: Trajectories, landmarks: Sequence[Landmark]) -> _Pairs:
    low = np.minimum(attempts.transmitter, attempts.receiver)
    high = np.maximum(attempts.transmitter, attempts.receiver)
    rows = np.stack([attempts.sample, low, high], axis=-1)
    pairs, of_attempt = np.unique(rows, axis=0, return_inverse=True)
    sample, first, second = pairs.T
    marks = landmark_positions(landmarks)
    has_stopped = truth.status != VehicleStatus.ACTIVE
    stopped = np.concatenate([has_stopped, np.zeros((len(marks), truth.time.size), dtype=bool)])
    return _Pairs(
        of_attempt=of_attempt.reshape(-1),
        sample=sample,
        first=first,
        second=second,
        source=_positions(truth, marks, first, sample),
        receiver=_positions(truth, marks, second, sample),
        silent=stopped[first, sample] | stopped[second, sample],
    )


class _Chords(NamedTuple):
    """Columns of every pair that the evaluation needs, silent pairs included."""

    travel_time: Array
    """Along the straight chord, shape (n_pairs,). [s]"""
    sound_speed: Array
    """At both ends, shape (n_pairs, 2). [m/s]"""
    distance: Array
    """Straight distance, shape (n_pairs,). [m]"""


def _transmit(
    reception: ReceptionOptions,
    pairs: _Pairs,
    rows: slice,
    medium: Medium,
    currents: Currents | None,
    progress: CountProgress | None,
) -> tuple[Transmission, _Chords]:
    """Sound between consecutive pairs; the links are the pairs that are not silent."""
    source = pairs.source[rows]
    receiver = pairs.receiver[rows]
    is_silent = pairs.silent[rows]
    active = np.flatnonzero(~is_silent)
    silent = np.flatnonzero(is_silent)

    def progress_from(before: int, count: int) -> CountProgress | None:
        if progress is None:
            return None
        return lambda done, total: progress(
            before + done * count // max(total, 1), pairs.sample.size
        )

    sound = find_receptions(
        source[active],
        receiver[active],
        medium,
        reception,
        currents=currents,
        progress=progress_from(rows.start, active.size),
    )
    distance = medium.straight_distance(source, receiver)
    chords = _Chords(
        np.full(is_silent.size, np.nan), np.full((is_silent.size, 2), np.nan), distance
    )
    results = [(active, sound.arrivals)]
    if silent.size:
        count = progress_from(rows.start + active.size, silent.size)
        eigenrays = find_eigenrays(
            medium, source[silent], receiver[silent], threads=reception.threads, progress=count
        )
        results.append((silent, eigenrays))
    for members, arrivals in results:
        chords.travel_time[members] = arrivals.chord_travel_time
        chords.sound_speed[members] = np.stack(
            [arrivals.source_sound_speed, arrivals.receiver_sound_speed], axis=-1
        )
    return sound, chords


def join_transmissions(parts: Sequence[Transmission]) -> Transmission:
    """Join the sound of several media, with links and arrivals in order."""
    if len(parts) == 1:
        return parts[0]
    offsets = np.cumsum(
        [[0, 0], *([part.status.size, part.arrivals.link.size] for part in parts)], axis=0
    )
    arrivals = []
    receptions = []
    for (link, row), part in zip(offsets[:-1], parts, strict=True):
        arrivals.append(replace(part.arrivals, link=part.arrivals.link + link))
        rows = part.receptions
        number = np.where(rows.arrival < 0, -1, rows.arrival + row)
        receptions.append(replace(rows, link=rows.link + link, arrival=number))
    return Transmission(
        Arrivals.stack(arrivals),
        np.concatenate([part.status for part in parts]),
        np.concatenate([part.near_cutoff for part in parts]),
        join_receptions(receptions),
    )


def _ranging(
    attempts: Attempts,
    pairs: _Pairs,
    sound: Transmission,
    chords: _Chords,
    truth: Trajectories,
    timing: Timing,
) -> Ranging:
    """Convert the results of links to those of range attempts."""
    active = ~pairs.silent
    n = sound.status.size
    pair = pairs.of_attempt
    link = np.where(active, np.cumsum(active) - 1, -1)[pairs.of_attempt]
    direction = (attempts.transmitter > attempts.receiver).astype(np.int64)  # direction of the ping
    exchanges = selected_exchanges(sound.receptions, n, link, direction)
    velocity = velocities_of(truth, attempts, timing)
    chances = exchange_values(sound.receptions.probability, exchanges, timing)
    values = {
        "distance": chords.distance[pair],
        "sound_speed": chords.sound_speed[pair, direction],
        "travel_time": exchange_times(sound.receptions, exchanges, timing, velocity),
        "chord_travel_time": chords.travel_time[pair],
        "near_cutoff": np.append(sound.near_cutoff, False)[link],
    }
    status = np.append(sound.status, np.int8(RayStatus.STOPPED))[link]
    is_outside_cone = (status == RayStatus.OK) & np.isnan(values["travel_time"])
    status[is_outside_cone] = RayStatus.SHADOW
    # further columns are those of the selected reception of each ping
    of_ping = {
        item.name: values_at(getattr(sound.receptions, item.name), exchanges.ping)
        for item in fields(RangingTruth)
        if item.name != "travel_time" and hasattr(sound.receptions, item.name)
    }
    return Ranging(
        attempts=attempts,
        status=status,
        truth=RangingTruth(**values | of_ping),
        links=Links(
            sample=pairs.sample[active], first=pairs.first[active], second=pairs.second[active]
        ),
        arrivals=sound.arrivals,
        receptions=sound.receptions,
        link=link,
        probability=np.prod(chances, axis=0),
    )
