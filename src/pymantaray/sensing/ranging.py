"""Noise-free ranges from acoustic travel times, by both of the paper's models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import Arrivals, RayStatus, Trajectories, VehicleStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.landmarks import Landmark, check_names, landmark_positions
from pymantaray.sensing.schedule import Attempts, PingSchedule, attempts

Array = NDArray[np.float64]


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
    travel_time: Array
    chord_travel_time: Array
    transmitter_sound_speed: Array
    straight_range: Array
    refracted_range: Array
    links: Links
    arrivals: Arrivals


def measure_ranges(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    medium: Medium,
    schedule: PingSchedule,
    *,
    spreading_cutoff_db: float | None = 15.0,
    threads: int | None = None,
) -> Ranging:
    """
    Range every pair at every ping, with the fleet at rest while it pings.

    Parameters
    ----------
    truth : Trajectories
        Where the vehicles are.
    landmarks : sequence of Landmark
        Fixed receivers.
    medium : Medium
        Sound speed and bathymetry.
    schedule : PingSchedule
        When the vehicles ping.
    spreading_cutoff_db : float or None
        Weakest eigenray that counts as an arrival, see `pymantaray.acoustics.find_eigenrays`. [dB]
    threads : int, optional
        Threads of the ray solver; the result does not depend on it.

    Returns
    -------
    Ranging
        A link without an arrival has a status that says why, and NaN for travel time and refracted
        range. A stopped vehicle is silent: its attempts have status STOPPED, and everything else that
        does not need an arrival. Its links are not among `links` and `arrivals`. Where an end lies outside
        the water (status OUTSIDE) there is no chord either: its time and the sound speed are NaN.

    Raises
    ------
    SensingError
        If an epoch is not a sample, or a name is used twice.

    Notes
    -----
    Travel time is reciprocal, so each unordered pair is solved once. The two refracted ranges
    ``c t`` of a pair differ, since the sound speed is that at the transmitter.
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
    time, chord = np.full(pair.size, np.nan), np.full(pair.size, np.nan)
    speed = np.full((pair.size, 2), np.nan)  # at the source, at the receiver
    arrivals = find_eigenrays(
        medium, source[~stopped], receiver[~stopped], spreading_cutoff_db=spreading_cutoff_db, threads=threads
    )
    found = arrivals.first()
    status[~stopped], time[~stopped], chord[~stopped] = (
        found.status,
        found.travel_time,
        found.chord_travel_time,
    )
    speed[~stopped] = np.stack([found.source_sound_speed, found.receiver_sound_speed], axis=-1)
    if stopped.any():  # what evaluation needs of a silent pair: its chord and sound speeds, no arrival
        unheard = find_eigenrays(medium, source[stopped], receiver[stopped], threads=threads)
        chord[stopped] = unheard.chord_travel_time
        speed[stopped] = np.stack([unheard.source_sound_speed, unheard.receiver_sound_speed], axis=-1)

    table = attempts(n_agents, len(fixed), epochs)
    per_epoch = table.sample.size // n_epochs
    link = np.repeat(np.arange(n_epochs), per_epoch) * first.size + pair_of[table.transmitter, table.receiver]
    backward = (table.transmitter > table.receiver).astype(np.int64)
    transmitter_speed = speed[link, backward]
    return Ranging(
        attempts=table,
        status=status[link],
        travel_time=time[link],
        chord_travel_time=chord[link],
        transmitter_sound_speed=transmitter_speed,
        straight_range=np.linalg.norm(receiver - source, axis=-1)[link],
        refracted_range=transmitter_speed * time[link],
        links=Links(
            sample=epochs[epoch][~stopped], first=first[pair][~stopped], second=second[pair][~stopped]
        ),
        arrivals=arrivals,
    )
