"""Ranges without noise: the rays of every pair at every ping, the arrival that each receiver ranges on, travel times."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Leakage, Medium, find_eigenrays, find_leaks, quadrature, trace_paths
from pymantaray.acoustics.currents import Currents, current_delays
from pymantaray.acoustics.eigenrays import solved_backwards
from pymantaray.acoustics.selection import (
    NEAR_DB,
    Rule,
    choose_arrivals,
    is_near_cutoff,
    select,
    within_cutoff,
)
from pymantaray.errors import SensingError
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import Arrivals, FirstArrivals, RangingTruth, RayStatus, Trajectories, VehicleStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.detection import Detector
from pymantaray.sensing.landmarks import Landmark, check_names, landmark_positions
from pymantaray.sensing.schedule import Attempts, Schedule
from pymantaray.sensing.timing import ONE_WAY, Leg, Timing, TwoWay, half_round_trip, velocities

Array = NDArray[np.float64]
_BLOCK = 512  # links whose ray paths are held at a time


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


class Leaked(NamedTuple):
    """What reaches links without a ray, there and back."""

    link: NDArray[np.int64]
    """Rows of `Ranging.links`, increasing."""
    travel_time: Array
    """Shape (n, 2), current included. [s]"""
    slowness: Array
    """Of the travel time by the ends, source and receiver, shape (n, 2, 3). [s/m]"""
    loss_db: Array


class Ranging(NamedTuple):
    """Every attempted range without noise, one row per attempt, and the arrivals behind them."""

    attempts: Attempts
    status: NDArray[np.int8]
    truth: RangingTruth
    links: Links
    arrivals: Arrivals
    link: NDArray[np.int64]
    """Row of `links` of each attempt, -1 for that of a silent pair."""
    probability: Array | None = None
    """That an attempt is heard, two-way the ping and the answer; NaN without an arrival, None without a detector."""
    loss_db: Array | None = None
    """Transmission loss of each of the arrivals, None without a detector. [dB]"""
    delay: Array | None = None
    """What the current adds to each arrival's travel time from source to receiver, None at rest. [s]"""
    leaked: Leaked | None = None
    """Sound that is heard although no ray arrives; None where nothing leaks."""


class Reception(NamedTuple):
    """
    What every receiver listens for, and what it ranges on.

    Parameters
    ----------
    spreading_cutoff_db : float or None
        Weakest eigenray that counts as an arrival, see `pymantaray.acoustics.find_eigenrays`. [dB]
    max_surface_bounces, max_bottom_bounces : int
        Reflections that an arrival may have.
    arrival : {"direct", "first", "strongest"}
        The arrival that is ranged on, see `pymantaray.acoustics.select`.
    detector : Detector, optional
        Gives the probability that an attempt is heard. By default every arrival is.
    leakage : Leakage, optional
        What arrives where no ray does, by the detector's frequency. By default nothing.
    threads : int, optional
        Threads of the ray solver; the result does not depend on it.
    """

    spreading_cutoff_db: float | None = 15.0
    max_surface_bounces: int = 0
    max_bottom_bounces: int = 0
    arrival: Rule = "direct"
    detector: Detector | None = None
    leakage: Leakage | None = None
    threads: int | None = None


_DIRECT = Reception()


def measure_ranges(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    medium: Medium | Callable[[float], Medium],
    schedule: Schedule,
    reception: Reception = _DIRECT,
    *,
    currents: Currents | Callable[[float], Currents] | None = None,
    timing: Timing = ONE_WAY,
    progress: CountProgress | None = None,
) -> Ranging:
    """
    Range between those who ping and those who listen, at every ping.

    Parameters
    ----------
    truth : Trajectories
        Where the vehicles are.
    landmarks : sequence of Landmark
        Fixed receivers.
    medium : Medium or callable
        Sound speed and bathymetry; where they vary in time, a function that gives them at a time of the truth
        [s]. It is called once a ping.
    schedule : PingSchedule, SlotSchedule or PingList
        Who pings when.
    reception : Reception
        By default direct arrivals, all of them heard.
    currents : Currents or callable, optional
        Their first-order effect on travel times, likewise a function where they vary. By default the water is
        at rest.
    timing : OneWay or TwoWay
        One-way, the fleet is at rest while it pings; two-way, it moves on as the truth says.
    progress : callable, optional
        Told how many unordered pairs, counted at every ping, are done, and how many there are.

    Returns
    -------
    Ranging
        A link without an arrival has a status that says why, and NaN for its travel time. A stopped vehicle is
        silent: its attempts have status STOPPED, and everything else that does not need an arrival. Its links are
        not among `links` and `arrivals`. Where an end lies outside the water (status OUTSIDE) there is no chord
        either: its time and the sound speed are NaN.

    Raises
    ------
    SensingError
        If a ping is not at a sample, or a name is used twice.

    Notes
    -----
    Sound runs through the water as it is at the ping, two-way also the answer: in the seconds of an exchange
    the ocean does not change. Media that vary are held one at a time.

    Travel time is reciprocal but for the current, so each unordered pair is solved once a sample, whoever pings. The two refracted
    ranges ``c t`` of a pair differ, since the sound speed is that at the transmitter (two-way: the initiator).
    """
    check_names(truth.name.tolist(), landmarks)
    pairs = _pairs(truth, landmarks, schedule)
    runs = np.empty(0, dtype=np.int64)  # of links that share their water
    if callable(medium) or callable(currents):
        runs = np.flatnonzero(np.diff(pairs.sample)) + 1
    parts = []
    for start, stop in pairwise([0, *runs.tolist(), pairs.sample.size]):
        now = float(truth.time[pairs.sample[start]]) if stop else 0.0
        water = medium(now) if callable(medium) else medium
        flow = currents(now) if callable(currents) else currents
        parts.append(_run(reception, pairs, slice(start, stop), water, flow, progress))
        del water, flow  # media that vary are held one at a time
    return _ranging(_joined(parts), pairs, truth, timing)


class _Pairs(NamedTuple):
    """Unordered pairs between which there are attempts, each once a sample: the links."""

    table: Attempts
    link: NDArray[np.int64]
    """Of each attempt."""
    sample: NDArray[np.int64]
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    """Participants of each link, the first of the smaller number."""
    source: Array
    receiver: Array
    """Places of both, shape (n_links, 3). [m]"""
    silent: NDArray[np.bool_]
    """Whether one of them is."""


def _pairs(truth: Trajectories, landmarks: Sequence[Landmark], schedule: Schedule) -> _Pairs:
    table = schedule.attempts(truth.time, truth.name.tolist(), [landmark.name for landmark in landmarks])
    ends = np.stack([table.sample, np.minimum(*table[1:]), np.maximum(*table[1:])], axis=-1)
    links, link = np.unique(ends, axis=0, return_inverse=True)
    sample, first, second = links.T
    fixed, n_vehicles = landmark_positions(landmarks), truth.name.size

    def place(who: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        moves, vehicle = who < n_vehicles, np.minimum(who, n_vehicles - 1)
        places = truth.position[vehicle, sample]
        places[~moves] = fixed[who[~moves] - n_vehicles]
        return places, moves & (truth.status[vehicle, sample] != VehicleStatus.ACTIVE)

    (source, one), (receiver, other) = place(first), place(second)
    return _Pairs(table, link.reshape(-1), sample, first, second, source, receiver, one | other)


class _Run(NamedTuple):
    """Outcome of a run of links in both directions."""

    status: NDArray[np.int8]
    chord_travel_time: Array
    travel_time: Array
    """Shape (n_links, 2): from source to receiver, and back."""
    sound_speed: Array
    """Shape (n_links, 2): at the source, and at the receiver."""
    gradient: Array
    """Of travel time by the ends: link, way (there, back), end (source, receiver), axis."""
    heard: NDArray[np.bool_]
    """False where an end has stopped; such links are not among the arrivals."""
    arrivals: Arrivals
    """Their travel times are those in water at rest."""
    probability: Array | None
    """Shape (n_links, 2): that the arrival there and the one back are heard; None without a detector."""
    loss_db: Array | None
    delay: Array | None
    near_cutoff: NDArray[np.bool_]
    leak_loss_db: Array | None
    """Of each link without a ray, NaN at others; None without a model."""


def _run(
    reception: Reception,
    pairs: _Pairs,
    links: slice,
    medium: Medium,
    currents: Currents | None,
    progress: CountProgress | None,
) -> _Run:
    """Rays of a run of links, and what each receiver ranges on."""
    source, receiver, stopped = pairs.source[links], pairs.receiver[links], pairs.silent[links]
    loud, quiet = np.flatnonzero(~stopped), np.flatnonzero(stopped)

    def tell(before: int, count: int) -> CountProgress | None:
        if progress is None:
            return None
        return lambda done, total: progress(before + done * count // max(total, 1), pairs.sample.size)

    sound = sound_between(
        source[loud],
        receiver[loud],
        medium,
        reception,
        currents=currents,
        progress=tell(links.start, loud.size),
    )
    there, back = sound.there, sound.back
    n = stopped.size
    status, chord = np.full(n, RayStatus.STOPPED, dtype=np.int8), np.full(n, np.nan)
    time, speed, gradient = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full((n, 2, 2, 3), np.nan)
    status[loud], chord[loud] = there.status, there.chord_travel_time
    time[loud] = np.stack([there.travel_time, back.travel_time], axis=-1)
    speed[loud] = np.stack([there.source_sound_speed, there.receiver_sound_speed], axis=-1)
    gradient[loud] = sound.gradient
    near = np.zeros(n, dtype=bool)
    near[loud] = sound.near_cutoff
    leak_loss = None if sound.leak_loss_db is None else _filled(n, loud, sound.leak_loss_db)
    chances = None if sound.probability is None else np.full((n, 2), np.nan)
    if chances is not None:
        chances[loud] = sound.probability
    if quiet.size:  # what evaluation needs of a silent pair: its chord and sound speeds, no arrival
        bare = find_eigenrays(
            medium,
            source[quiet],
            receiver[quiet],
            threads=reception.threads,
            progress=tell(links.start + loud.size, quiet.size),
        )
        chord[quiet] = bare.chord_travel_time
        speed[quiet] = np.stack([bare.source_sound_speed, bare.receiver_sound_speed], axis=-1)
    return _Run(
        status,
        chord,
        time,
        speed,
        gradient,
        ~stopped,
        sound.arrivals,
        chances,
        sound.loss_db,
        sound.delay,
        near,
        leak_loss,
    )


class Sound(NamedTuple):
    """What passes between pairs of ends, from source to receiver and back."""

    arrivals: Arrivals
    """Of all links; their travel times are those in water at rest."""
    there: FirstArrivals
    """The arrival that each receiver ranges on, or why it has none."""
    back: FirstArrivals
    """That at the source, of sound from the receiver; its slowness vectors too point from source to receiver."""
    probability: Array | None
    """Shape (n_links, 2): that the arrival there and the one back are heard; None without a detector."""
    loss_db: Array | None
    """Transmission loss of each of the arrivals, None without a detector. [dB]"""
    delay: Array | None
    """What the current adds to each arrival's travel time from source to receiver, None at rest. [s]"""
    near_cutoff: NDArray[np.bool_]
    """Whether 1 dB of the cut-off decides what is ranged on, in water at rest, shape (n_links,)."""
    leak_loss_db: Array | None = None
    """Loss of what leaks to each link without a ray, NaN at others, None without a model. [dB]"""

    @property
    def gradient(self) -> Array:
        """Of travel time by the ends (n_links, 2, 2, 3): link, way (there, back), end (source, receiver), axis. [s/m]"""
        ways = self.there, self.back
        return np.stack([np.stack([-w.source_slowness, w.receiver_slowness], axis=1) for w in ways], axis=1)


def sound_between(
    source: Array,
    receiver: Array,
    medium: Medium,
    reception: Reception = _DIRECT,
    *,
    currents: Currents | None = None,
    progress: CountProgress | None = None,
) -> Sound:
    """
    Sound between pairs of ends: all arrivals, and those that each of both ends ranges on.

    Parameters
    ----------
    source, receiver : ndarray, shape (n_links, 3)
        Positions ``(north, east, down)`` in the local frame. [m]
    medium : Medium
    reception : Reception
        By default direct arrivals, all of them heard.
    currents : Currents, optional
        Their first-order effect on travel times. By default the water is at rest.
    progress : callable, optional
        Each link counts once to find its rays, once more to find the direct ones alone and once more to follow its
        rays, as far as that is done.

    Returns
    -------
    Sound

    Notes
    -----
    By ``direct``, time and status of a link do not depend on the bounces allowed: one without a direct arrival has
    the status that it has where none are.
    """
    n, follows = len(source), currents is not None or reception.detector is not None
    bounced = reception.max_surface_bounces > 0 or reception.max_bottom_bounces > 0
    looks_again = reception.arrival == "direct" and bounced
    total = n * (1 + looks_again + follows)

    def tell(before: int) -> CountProgress | None:
        return None if progress is None else lambda done, _: progress(before + done, total)

    most = reception.max_surface_bounces, reception.max_bottom_bounces
    arrivals, near = _rays(reception, medium, (source, receiver), most, tell(0))
    bare, lost = None, np.empty(0, dtype=np.int64)
    if looks_again:
        lost = np.flatnonzero(select(arrivals, "direct").status != RayStatus.OK)
        bare, near_bare = _rays(
            reception, medium, (source[lost], receiver[lost]), (0, 0), tell(2 * n - lost.size)
        )
        near[lost] |= near_bare
        arrivals = _with_more(arrivals, bare, lost)
    delay = loss = None
    if follows:
        last = tell(n * (1 + looks_again))
        delay, loss = _along_rays(reception, medium, currents, (source, receiver), arrivals, last)
    delays = (None,) if delay is None else (delay, -delay)  # there and back, which at rest are the same
    ways = [select(arrivals, reception.arrival, loss_db=loss, delay=d) for d in delays]
    if bare is not None:
        status, margin = ways[0].status.copy(), ways[0].shadow_margin.copy()
        status[lost], margin[lost] = bare.status, bare.shadow_margin
        ways = [replace(way, status=status, shadow_margin=margin) for way in ways]
    probability = None
    if reception.detector is not None and loss is not None:
        heard = reception.detector.sonar.probability_heard(loss)
        probability = np.full((n, 2), np.nan)
        for way, d in enumerate(delays):
            link, row = choose_arrivals(arrivals, reception.arrival, loss_db=loss, delay=d)
            probability[link, way:] = heard[row, None]
    sound = Sound(arrivals, ways[0], ways[-1], probability, loss, delay, near)
    if reception.leakage is None:
        return sound
    return _with_leaks(sound, (source, receiver), medium, reception, currents)


def _rays(
    reception: Reception,
    medium: Medium,
    ends: tuple[Array, Array],
    bounces: tuple[int, int],
    progress: CountProgress | None,
) -> tuple[Arrivals, NDArray[np.bool_]]:
    """Arrivals of links, and on which of these 1 dB of the cut-off decides what is ranged on."""
    cutoff = reception.spreading_cutoff_db
    wide = find_eigenrays(
        medium,
        *ends,
        *bounces,
        None if cutoff is None else cutoff + NEAR_DB,
        threads=reception.threads,
        progress=progress,
    )
    if cutoff is None:
        return wide, np.zeros(wide.status.size, dtype=bool)
    return within_cutoff(wide, cutoff), is_near_cutoff(wide, cutoff, reception.arrival)


_WITHOUT_RAY = (RayStatus.SHADOW, RayStatus.WEAK, RayStatus.BLOCKED)


def _with_leaks(
    sound: Sound, ends: tuple[Array, Array], medium: Medium, reception: Reception, currents: Currents | None
) -> Sound:
    """Sound, and what leaks or is scattered to receivers without a ray; it is none of the arrivals."""
    detector, leakage = reception.detector, reception.leakage
    if leakage is None or detector is None or sound.probability is None:
        raise SensingError("Reception: leakage needs a detector, whose frequency says how much leaks")
    dark = np.flatnonzero(np.isin(sound.there.status, _WITHOUT_RAY))
    source, receiver = (end[dark] for end in ends)
    backwards = solved_backwards(source, receiver)[:, None]  # as rays are: the same from either end
    start, end = np.where(backwards, receiver, source), np.where(backwards, source, receiver)
    direct = reception.arrival == "direct"
    leaks = find_leaks(
        medium,
        start,
        end,
        leakage,
        detector.sonar.frequency_hz,
        bounces=(0, 0) if direct else (reception.max_surface_bounces, reception.max_bottom_bounces),
        spreading_cutoff_db=reception.spreading_cutoff_db,
        threads=reception.threads,
    )
    links, rays = dark[leaks.link], leaks.arrivals
    delay, loss = _along_rays(reception, medium, currents, (start[leaks.link], leaks.place), rays, None)
    assert loss is not None  # there is a detector
    status = sound.there.status.copy()
    status[links] = np.where(leaks.scattered, np.int8(RayStatus.SCATTERED), np.int8(RayStatus.LEAKED))
    probability = sound.probability.copy()
    probability[links] = detector.sonar.probability_heard(loss)[:, None]
    turned = backwards[leaks.link]
    along = np.where(turned[:, 0], -1.0, 1.0) * (0.0 if delay is None else delay)
    slowness = {
        "source_slowness": np.where(turned, -rays.receiver_slowness, rays.source_slowness),
        "receiver_slowness": np.where(turned, -rays.source_slowness, rays.receiver_slowness),
    }
    ways = []
    for way, late in ((sound.there, along), (sound.back, -along)):
        columns = {
            name: getattr(way, name).copy()
            for name in ("travel_time", "source_slowness", "receiver_slowness")
        }
        columns["travel_time"][links] = rays.travel_time + leaks.shift + late
        for name, values in slowness.items():
            columns[name][links] = values
        ways.append(replace(way, status=status, **columns))
    return sound._replace(
        there=ways[0], back=ways[1], probability=probability, leak_loss_db=_filled(status.size, links, loss)
    )


def _filled(n: int, rows: NDArray[np.int64], values: Array) -> Array:
    """Values at some of n rows, NaN at the others."""
    result = np.full(n, np.nan)
    result[rows] = values
    return result


def _with_more(arrivals: Arrivals, more: Arrivals, links: NDArray[np.int64]) -> Arrivals:
    """Arrivals with those of some of their links that the solver had left out, having found too many."""
    if not more.link.size:
        return arrivals
    rows = {
        f.name: np.concatenate([getattr(arrivals, f.name), getattr(more, f.name)])
        for f in fields(arrivals)
        if f.metadata["dims"][0] == "arrival"
    }
    rows["link"] = np.concatenate([arrivals.link, links[more.link]])
    order = np.lexsort((rows["travel_time"], rows["link"]))
    return replace(arrivals, **{name: values[order] for name, values in rows.items()})


def _along_rays(
    reception: Reception,
    medium: Medium,
    currents: Currents | None,
    ends: tuple[Array, Array],
    arrivals: Arrivals,
    progress: CountProgress | None,
) -> tuple[Array | None, Array | None]:
    """Delay by the current and transmission loss of each arrival, None for what is not asked for."""
    delay, loss = np.zeros(arrivals.link.size), np.zeros(arrivals.link.size)
    for start in range(0, arrivals.status.size, _BLOCK):
        stop = min(start + _BLOCK, arrivals.status.size)
        rows = slice(*np.searchsorted(arrivals.link, [start, stop]))
        part = _part(arrivals, slice(start, stop), rows)
        source, receiver = (end[start:stop] for end in ends)
        paths = trace_paths(medium, source, receiver, part, threads=reception.threads)
        if currents is not None:
            delay[rows] = current_delays(quadrature(paths), currents, part.link.size)
        if reception.detector is not None:
            loss[rows] = reception.detector.loss_db(medium, source, receiver, part, paths)
        if progress is not None:
            progress(stop, arrivals.status.size)
    return (None if currents is None else delay), (None if reception.detector is None else loss)


def _part(arrivals: Arrivals, links: slice, rows: slice) -> Arrivals:
    """Arrivals of a run of links."""
    cut = {"arrival": rows, "n_links": links}
    columns = {f.name: getattr(arrivals, f.name)[cut[f.metadata["dims"][0]]] for f in fields(arrivals)}
    return Arrivals(**columns | {"link": columns["link"] - links.start})


def _joined(parts: Sequence[_Run]) -> _Run:
    """One run of links of several, one after the other."""
    if len(parts) == 1:
        return parts[0]
    before = np.cumsum([0, *(part.arrivals.status.size for part in parts)])
    link = np.concatenate([part.arrivals.link + n for part, n in zip(parts, before[:-1], strict=True)])
    arrivals = {
        f.name: np.concatenate([getattr(part.arrivals, f.name) for part in parts]) for f in fields(Arrivals)
    }
    columns: dict[str, Any] = {"arrivals": Arrivals(**arrivals | {"link": link})}
    for name in set(_Run._fields) - {"arrivals"}:
        values = [getattr(part, name) for part in parts]
        columns[name] = None if values[0] is None else np.concatenate(values)
    return _Run(**columns)


def _ranging(sound: _Run, pairs: _Pairs, truth: Trajectories, timing: Timing) -> Ranging:
    """From links, one an unordered pair, to range attempts."""
    table, link = pairs.table, pairs.link
    forth = (table.transmitter > table.receiver).astype(np.int64)  # the way of the ping, and its sender's end
    back, travel_time = 1 - forth, sound.travel_time[link, forth]
    if isinstance(timing, TwoWay):
        samples, epoch = np.unique(table.sample, return_inverse=True)
        last = max(int(who.max(initial=0)) for who in table[1:])
        landmarks = max(last + 1 - truth.name.size, 0)
        velocity = np.pad(velocities(truth, samples), ((0, landmarks), (0, 0), (0, 0)))
        ping, answer = (
            Leg(
                sound.travel_time[link, way],
                sound.gradient[link, way, forth],
                sound.gradient[link, way, back],
            )
            for way in (forth, back)
        )
        initiator, responder = velocity[table.transmitter, epoch], velocity[table.receiver, epoch]
        travel_time = half_round_trip(timing, ping, answer, initiator, responder)
    probability = None
    if sound.probability is not None:
        both = isinstance(timing, TwoWay)
        probability = sound.probability.prod(axis=-1)[link] if both else sound.probability[link, forth]
    heard, leaked = sound.heard, None
    if sound.leak_loss_db is not None:
        dark = np.flatnonzero(np.isfinite(sound.leak_loss_db))
        leaked = Leaked(
            (np.cumsum(heard) - 1)[dark],
            sound.travel_time[dark],
            sound.gradient[dark, 0],
            sound.leak_loss_db[dark],
        )
    return Ranging(
        attempts=table,
        status=sound.status[link],
        truth=RangingTruth(
            distance=np.linalg.norm(pairs.receiver - pairs.source, axis=-1)[link],
            sound_speed=sound.sound_speed[link, forth],
            travel_time=travel_time,
            chord_travel_time=sound.chord_travel_time[link],
            near_cutoff=sound.near_cutoff[link],
        ),
        links=Links(
            sample=pairs.sample[heard],
            first=pairs.first[heard],
            second=pairs.second[heard],
        ),
        arrivals=sound.arrivals,
        link=np.where(heard, np.cumsum(heard) - 1, -1)[link],
        probability=probability,
        loss_db=sound.loss_db,
        delay=sound.delay,
        leaked=leaked,
    )
