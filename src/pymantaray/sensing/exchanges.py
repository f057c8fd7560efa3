"""Exchanges: the receptions of each range attempt, one-way or two-way, and their travel times."""

from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.records import Trajectories
from pymantaray.sensing.receptions import Direction, Receptions, rows_between, values_at
from pymantaray.sensing.schedule import Attempts
from pymantaray.sensing.timing import Leg, OneWay, Timing, half_round_trip, velocities

Velocities = tuple[Array, Array]
"""Velocities of initiators and of responders, each of shape (n, 3). [m/s]"""


class Exchanges(NamedTuple):
    """Rows of the receptions of ping and answer, -1 without one; one-way, only the ping counts."""

    ping: Indices
    answer: Indices
    direction: Indices
    """Direction of each ping."""


def selected_exchanges(
    receptions: Receptions, links: int, link: Indices, direction: Indices
) -> Exchanges:
    """
    Return the exchange of the selected receptions of each attempt.

    ``link`` is the link of each attempt, -1 without one; ``direction`` is the direction of its
    ping.
    """
    # the last column is that of attempts without a link
    rows = np.full((2, links + 1), -1, dtype=np.intp)
    rows[:, :-1] = receptions.selected_rows(links)
    return Exchanges(rows[direction, link], rows[1 - direction, link], direction)


def all_exchanges(
    receptions: Receptions, link: Indices, direction: Indices, timing: Timing
) -> tuple[Indices, Exchanges]:
    """
    Return attempts and exchanges, all that each attempt may have, independent of the selection.

    Two-way, these are all combinations of receptions of ping and answer.
    """
    attempt = np.flatnonzero(link >= 0)
    row, ping = rows_between(*receptions.rows_of(link[attempt], direction[attempt]))
    attempt = attempt[row]
    if isinstance(timing, OneWay):
        return attempt, Exchanges(ping, np.full(ping.size, -1), direction[attempt])
    pair, answer = rows_between(*receptions.rows_of(link[attempt], 1 - direction[attempt]))
    return attempt[pair], Exchanges(ping[pair], answer, direction[attempt[pair]])


def exchange_times(
    receptions: Receptions, exchanges: Exchanges, timing: Timing, velocity: Velocities
) -> Array:
    """
    Travel time of each exchange; NaN without a reception. [s]

    Two-way, it is half of the round trip without the turn-around time.
    """
    ping, answer, direction = exchanges
    if isinstance(timing, OneWay):
        return values_at(receptions.travel_time, ping)
    ping_leg, answer_leg = (_leg(receptions, rows, direction) for rows in (ping, answer))
    return half_round_trip(timing, ping_leg, answer_leg, *velocity)


def _leg(receptions: Receptions, rows: Indices, direction: Indices) -> Leg:
    """
    Leg of exchanges.

    The initiator is at the source of the link for a ping in direction 0, otherwise at the receiver.
    """
    at_source = -values_at(receptions.source_slowness, rows)
    at_receiver = values_at(receptions.receiver_slowness, rows)
    back = (direction == Direction.BACK)[:, None]
    return Leg(
        values_at(receptions.travel_time, rows),
        np.where(back, at_receiver, at_source),
        np.where(back, at_source, at_receiver),
    )


def exchange_values(values: Array, exchanges: Exchanges, timing: Timing) -> tuple[Array, ...]:
    """Values of the receptions of ping and, two-way, answer; NaN without a reception."""
    legs = (exchanges.ping,) if isinstance(timing, OneWay) else (exchanges.ping, exchanges.answer)
    return tuple(values_at(values, rows) for rows in legs)


def velocities_of(truth: Trajectories, attempts: Attempts, timing: Timing) -> Velocities:
    """
    Velocities of initiator and responder of each attempt. [m/s]

    They are zero for one-way ranges and for landmarks.
    """
    n = 1 + max(
        attempts.transmitter.max(initial=0), attempts.receiver.max(initial=0), truth.name.size - 1
    )
    samples, epoch = np.unique(attempts.sample, return_inverse=True)
    velocity = np.zeros((n, samples.size, 3))
    if not isinstance(timing, OneWay):
        velocity[: truth.name.size] = velocities(truth, samples)
    return velocity[attempts.transmitter, epoch], velocity[attempts.receiver, epoch]
