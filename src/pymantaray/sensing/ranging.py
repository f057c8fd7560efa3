"""Noise-free ranges from acoustic travel times, by both of the paper's models."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium, Rule, find_eigenrays
from pymantaray.records import Arrivals, RangingTruth, RayStatus, Trajectories, VehicleStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.detection import Detector
from pymantaray.sensing.landmarks import Landmark, check_names, landmark_positions
from pymantaray.sensing.reception import Progress, Reception, join, receive
from pymantaray.sensing.schedule import Attempts, PingSchedule, attempts
from pymantaray.sensing.timing import Leg, OneWay, Timing, TwoWay, half_round_trip, velocities

Array = NDArray[np.float64]
_ONE_WAY = OneWay()


@dataclass(frozen=True, eq=False)
class Links(Record):
    """
    Unordered pairs whose eigenrays were solved, row by row the links of an `Arrivals` record.

    A participant is an index into the vehicles if it is below their number, else that number plus an
    index into the landmarks. The first is the source of the rays, the second the receiver.
    """

    kind: ClassVar[str] = "links"

    sample: Column = column("link", "1", "index into time", "i4")
    first: Column = column("link", "1", "participant at the source", "i4")
    second: Column = column("link", "1", "participant at the receiver", "i4")


class Ranging(NamedTuple):
    """Every attempted range without noise, one row per attempt, and the arrivals behind them."""

    attempts: Attempts
    status: NDArray[np.int8]
    truth: RangingTruth
    links: Links
    arrivals: Arrivals
    probability: Array | None = None
    """That an attempt is heard, two-way the ping and the answer; NaN without an arrival, None without a detector."""
    loss_db: Array | None = None
    """Transmission loss of each of the arrivals, None without a detector. [dB]"""
    delay: Array | None = None
    """What the current adds to each arrival's travel time from source to receiver, None at rest. [s]"""


def measure_ranges(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    medium: Medium | Callable[[float], Medium],
    schedule: PingSchedule,
    *,
    spreading_cutoff_db: float | None = 15.0,
    max_surface_bounces: int = 0,
    max_bottom_bounces: int = 0,
    arrival: Rule = "direct",
    currents: Currents | Callable[[float], Currents] | None = None,
    timing: Timing = _ONE_WAY,
    detector: Detector | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Ranging:
    """
    Range every pair at every ping.

    Parameters
    ----------
    truth : Trajectories
        Where the vehicles are.
    landmarks : sequence of Landmark
        Fixed receivers.
    medium : Medium or callable
        Sound speed and bathymetry; where they vary in time, a function that gives them at a time of the truth
        [s]. It is called once a ping.
    schedule : PingSchedule
        When the vehicles ping.
    spreading_cutoff_db : float or None
        Weakest eigenray that counts as an arrival, see `pymantaray.acoustics.find_eigenrays`. [dB]
    max_surface_bounces, max_bottom_bounces : int
        Reflections that an arrival may have.
    arrival : {"direct", "first", "strongest"}
        The arrival that is ranged on, see `pymantaray.acoustics.select`.
    currents : Currents or callable, optional
        Their first-order effect on travel times, likewise a function where they vary. By default the water is
        at rest.
    timing : OneWay or TwoWay
        One-way, the fleet is at rest while it pings; two-way, it moves on as the truth says.
    detector : Detector, optional
        Gives the probability that an attempt is heard. By default every arrival is.
    threads : int, optional
        Threads of the ray solver; the result does not depend on it.
    progress : callable, optional
        Told how many unordered pairs, counted at every ping, are done, and how many there are.

    Returns
    -------
    Ranging
        A link without an arrival has a status that says why, and NaN for its travel time. A stopped vehicle is silent: its attempts have status STOPPED, and everything else that
        does not need an arrival. Its links are not among `links` and `arrivals`. Where an end lies outside
        the water (status OUTSIDE) there is no chord either: its time and the sound speed are NaN.

    Raises
    ------
    SensingError
        If an epoch is not a sample, or a name is used twice.

    Notes
    -----
    Sound runs through the water as it is at the ping, two-way also the answer: in the seconds of an exchange
    the ocean does not change. Media that vary are held one at a time.

    Travel time is reciprocal but for the current, so each unordered pair is solved once. The two refracted
    ranges ``c t`` of a pair differ, since the sound speed is that at the transmitter (two-way: the initiator).
    """
    check_names([str(name) for name in truth.name], landmarks)
    epochs = schedule.samples(truth.time)
    n_agents, n_epochs = len(truth.name), epochs.size
    fixed = landmark_positions(landmarks)
    n = n_agents + len(fixed)
    position = np.empty((n, n_epochs, 3))
    position[:n_agents], position[n_agents:] = truth.position[:, epochs], fixed[:, None]
    silent = np.zeros((n, n_epochs), dtype=bool)
    silent[:n_agents] = truth.status[:, epochs] != VehicleStatus.ACTIVE

    first, second = np.triu_indices(n, k=1)
    first, second = first[first < n_agents], second[first < n_agents]
    pair_of = np.zeros((n, n), dtype=np.int64)
    pair_of[first, second] = pair_of[second, first] = np.arange(first.size)
    epoch, pair = np.divmod(np.arange(n_epochs * first.size), max(first.size, 1))
    source, receiver = position[first[pair], epoch], position[second[pair], epoch]
    stopped = silent[first[pair], epoch] | silent[second[pair], epoch]

    status = np.full(pair.size, RayStatus.STOPPED, dtype=np.int8)
    time, chord = np.full((pair.size, 2), np.nan), np.full(pair.size, np.nan)
    speed = np.full((pair.size, 2), np.nan)  # at the source, at the receiver
    heard = ~stopped

    def solve(links: slice, water: Medium, moving: Currents | None) -> Reception:
        loud, quiet = links.start + np.flatnonzero(heard[links]), links.start + np.flatnonzero(stopped[links])

        def tell(before: int, count: int) -> Progress | None:
            if progress is None:
                return None
            return lambda done, total: progress(before + done * count // max(total, 1), pair.size)

        found = receive(
            water,
            source[loud],
            receiver[loud],
            spreading_cutoff_db=spreading_cutoff_db,
            max_surface_bounces=max_surface_bounces,
            max_bottom_bounces=max_bottom_bounces,
            rule=arrival,
            currents=moving,
            detector=detector,
            threads=threads,
            progress=tell(links.start, loud.size),
        )
        there = found.there
        status[loud], chord[loud] = there.status, there.chord_travel_time
        time[loud] = np.stack([there.travel_time, found.back.travel_time], axis=-1)
        speed[loud] = np.stack([there.source_sound_speed, there.receiver_sound_speed], axis=-1)
        if quiet.size:  # what evaluation needs of a silent pair: its chord and sound speeds, no arrival
            unheard = find_eigenrays(
                water,
                source[quiet],
                receiver[quiet],
                threads=threads,
                progress=tell(links.start + loud.size, quiet.size),
            )
            chord[quiet] = unheard.chord_travel_time
            speed[quiet] = np.stack([unheard.source_sound_speed, unheard.receiver_sound_speed], axis=-1)
        return found

    ends: list[int] = [0, pair.size]  # of the runs of links that share their water
    if callable(medium) or callable(currents):
        ends = (first.size * np.arange(n_epochs + 1)).tolist()
    found = join(
        [
            solve(
                slice(start, stop),
                medium(now) if callable(medium) else medium,
                currents(now) if callable(currents) else currents,
            )
            for now, (start, stop) in zip(truth.time[epochs].tolist(), pairwise(ends), strict=False)
        ]
    )

    table = attempts(n_agents, len(fixed), epochs)
    per_epoch = table.sample.size // n_epochs
    link = np.repeat(np.arange(n_epochs), per_epoch) * first.size + pair_of[table.transmitter, table.receiver]
    backward = (table.transmitter > table.receiver).astype(np.int64)
    travel_time, transmitter_speed = time[link, backward], speed[link, backward]
    if isinstance(timing, TwoWay):
        velocity = np.zeros(position.shape)
        velocity[:n_agents] = velocities(truth, epochs)
        gradient = np.full((pair.size, 2, 2, 3), np.nan)
        gradient[heard] = _gradients(found)
        at = np.repeat(np.arange(n_epochs), per_epoch)
        ping, answer = (
            Leg(time[link, way], gradient[link, way, backward], gradient[link, way, 1 - backward])
            for way in (backward, 1 - backward)
        )
        initiator, responder = velocity[table.transmitter, at], velocity[table.receiver, at]
        travel_time = half_round_trip(timing, ping, answer, initiator, responder)
    return Ranging(
        attempts=table,
        status=status[link],
        truth=RangingTruth(
            distance=np.linalg.norm(receiver - source, axis=-1)[link],
            sound_speed=transmitter_speed,
            travel_time=travel_time,
            chord_travel_time=chord[link],
        ),
        links=Links(sample=epochs[epoch][heard], first=first[pair][heard], second=second[pair][heard]),
        arrivals=found.arrivals,
        probability=_probabilities(found, heard, timing, link, backward),
        loss_db=found.loss_db,
        delay=found.delay,
    )


def _gradients(found: Reception) -> Array:
    """Of travel time with respect to the ends: link, way (there, back), end (source, receiver), axis."""
    return np.stack(
        [np.stack([-f.source_slowness, f.receiver_slowness], axis=1) for f in (found.there, found.back)],
        axis=1,
    )


def _probabilities(
    found: Reception,
    heard: NDArray[np.bool_],
    timing: Timing,
    link: NDArray[np.int64],
    backward: NDArray[np.int64],
) -> Array | None:
    """Probability that each attempt is heard; of an exchange, that the ping is and then the answer."""
    if found.probability is None:
        return None
    of_link = np.full((heard.size, 2), np.nan)
    of_link[heard] = found.probability
    if isinstance(timing, TwoWay):
        return np.asarray(of_link.prod(axis=-1)[link])
    return np.asarray(of_link[link, backward])
