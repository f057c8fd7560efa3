"""Receptions: all sound that reaches the receivers of links, by reception and direction."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pymantaray.acoustics import ArrivalRule, Leaks, Sonar
from pymantaray.acoustics.selection import first_rows
from pymantaray.arrays import AnyArray, Array, Indices, Mask
from pymantaray.records import Arrivals, RayStatus
from pymantaray.records.base import Column, Record, column

_LINKS = 2**40  # more than the number of links; offset of the groups of the second direction


class SoundPath(IntEnum):
    """Path by which sound reaches a receiver."""

    DIRECT = 0  # an eigenray without a reflection
    REFLECTED = 1  # an eigenray with reflections
    LEAKED = 2  # no ray; sound leaks past the nearest one
    SCATTERED = 3  # no ray; scattered sound


NO_RAY = {SoundPath.LEAKED: RayStatus.LEAKED, SoundPath.SCATTERED: RayStatus.SCATTERED}
"""Paths without a ray, and the status of a link with such a path as its selected reception."""


class Direction(IntEnum):
    """End of a link that transmits."""

    FORTH = 0  # from the link's source to its receiver
    BACK = 1


@dataclass(frozen=True, eq=False)
class Receptions(Record):
    """
    Receptions of a set of links, sorted by direction, link and travel time at rest.

    Slowness vectors are along the ray from the link's source to its receiver, in both directions:
    the change of the travel time with the position of the source is minus ``source_slowness``, that
    with the position of the receiver is ``receiver_slowness``.
    """

    kind: ClassVar[str] = "receptions"

    link: Column = column("reception", "1", "index of the link", "i8")
    direction: Column = column(
        "reception", "1", "end of the link that transmits", "i1", flags=Direction
    )
    path: Column = column("reception", "1", "path of the sound", "i1", flags=SoundPath)
    arrival: Column = column(
        "reception", "1", "row of the eigenray among the arrivals, -1 without a ray", "i8"
    )
    travel_time: Column = column("reception", "s", "travel time, current included")
    source_slowness: Column = column(
        "reception axis", "s m-1", "slowness vector at the link's source"
    )
    receiver_slowness: Column = column(
        "reception axis", "s m-1", "slowness vector at the link's receiver"
    )
    surface_bounces: Column = column("reception", "1", "reflections at the surface", "i2")
    bottom_bounces: Column = column("reception", "1", "reflections at the sea bed", "i2")
    spreading_db: Column = column("reception", "1", "geometric spreading beyond spherical, in dB")
    loss_db: Column = column("reception", "1", "transmission loss, in dB; NaN without a detector")
    detection: Column = column("reception", "1", "probability of detection, 1 without a detector")
    selected: Column = column(
        "reception", "1", "1 if the selection rule takes this reception, else 0", "i1"
    )
    probability: Column = column(
        "reception", "1", "probability that the receiver ranges on this reception"
    )

    @property
    def group(self) -> Indices:
        """Number of the link and direction of each row, ascending; rows of one group compete."""
        return np.asarray(self.direction.astype(np.int64) * _LINKS + self.link)

    @property
    def departure_angle(self) -> Array:
        """Angle of the sound from the horizontal at the transmitting end, positive down. [rad]"""
        forth = self.direction == Direction.FORTH
        return np.where(
            forth, _elevation(self.source_slowness), _elevation(-self.receiver_slowness)
        )

    @property
    def arrival_angle(self) -> Array:
        """Angle of the sound from the horizontal at the receiving end, positive down. [rad]"""
        forth = self.direction == Direction.FORTH
        return np.where(
            forth, _elevation(self.receiver_slowness), _elevation(-self.source_slowness)
        )

    def rows_of(self, link: Indices, direction: Indices) -> tuple[Indices, Indices]:
        """
        Range of rows of links in a direction.

        Parameters
        ----------
        link : ndarray of int, shape (n,)
            Links.
        direction : ndarray of int, shape (n,)
            Directions, see `Direction`.

        Returns
        -------
        start, stop : ndarray of int, shape (n,)
            First row, and the row after the last.
        """
        group = self.group
        target = direction * _LINKS + link
        start, stop = (np.searchsorted(group, target, side=side) for side in ("left", "right"))
        return start, stop

    def selected_rows(self, links: int) -> Indices:
        """
        Rows that the selection rule takes.

        Parameters
        ----------
        links : int
            Number of links.

        Returns
        -------
        ndarray of int, shape (2, links)
            Row by direction and link; -1 without one.
        """
        rows = np.full((2, links), -1)
        selected = np.flatnonzero(self.selected)
        rows[self.direction[selected], self.link[selected]] = selected
        return rows


_FROM_ARRIVALS = {f.name for f in fields(Receptions)} & {f.name for f in fields(Arrivals)} - {
    "travel_time"
}
_BOTH = np.array([Direction.FORTH, Direction.BACK], dtype=np.int8)


def _elevation(along: Array) -> Array:
    """Angle of vectors from the horizontal, positive down. [rad]"""
    return np.arctan2(along[:, 2], np.hypot(along[:, 0], along[:, 1]))


def _both(values: AnyArray) -> AnyArray:
    """Values of arrivals, for receptions in both directions."""
    return np.concatenate([values, values])


class AlongRays(NamedTuple):
    """Quantities along the path of each arrival."""

    delay: Array | None
    """Change of the travel time from source to receiver by the current; None at rest. [s]"""
    loss_db: Array | None
    """Transmission loss; None without a detector. [dB]"""


def receptions_of(arrivals: Arrivals, along: AlongRays) -> Receptions:
    """
    Receptions from arrivals in both directions, before detection and selection.

    The effect of a current has opposite signs.
    """
    n = arrivals.link.size
    is_reflected = (arrivals.surface_bounces > 0) | (arrivals.bottom_bounces > 0)
    delay = np.zeros(n) if along.delay is None else along.delay
    loss = np.full(n, np.nan) if along.loss_db is None else along.loss_db
    one_way: dict[str, Any] = {
        "path": is_reflected * np.int8(SoundPath.REFLECTED),  # otherwise DIRECT, which is 0
        "arrival": np.arange(n),
        "loss_db": loss,
        "detection": np.ones(n),
        "selected": np.zeros(n, dtype=np.int8),
        "probability": np.zeros(n),
    }
    one_way |= {name: getattr(arrivals, name) for name in _FROM_ARRIVALS}
    time = np.concatenate([arrivals.travel_time + delay, arrivals.travel_time - delay])
    columns = {name: _both(values) for name, values in one_way.items()}
    return Receptions(**columns | {"direction": np.repeat(_BOTH, n), "travel_time": time})


def with_detection(receptions: Receptions, sonar: Sonar) -> Receptions:
    """Receptions with their probabilities of detection by a sonar."""
    return replace(receptions, detection=sonar.detection_probability(receptions.loss_db))


def with_leaks(
    receptions: Receptions,
    link: Indices,
    leaks: Leaks,
    along: AlongRays,
    backwards: Mask,
) -> Receptions:
    """
    Add receptions of leaked or scattered sound to those of links with rays.

    ``link`` is the link of each leak. If ``backwards``, the leak was computed from the receiver to
    the source.
    """
    rays = leaks.arrivals
    sign = np.where(backwards, -1.0, 1.0)
    delay = 0.0 if along.delay is None else sign * along.delay
    time = rays.travel_time + leaks.shift
    reverse = backwards[:, None]
    rows = receptions_of(replace(rays, link=link), along)
    source = np.where(reverse, -rays.receiver_slowness, rays.source_slowness)
    receiver = np.where(reverse, -rays.source_slowness, rays.receiver_slowness)
    path = np.where(leaks.scattered, SoundPath.SCATTERED, SoundPath.LEAKED)
    return join_receptions(
        [
            receptions,
            replace(
                rows,
                arrival=np.full(rows.link.size, -1),
                path=_both(path),
                travel_time=np.concatenate([time + delay, time - delay]),
                source_slowness=_both(source),
                receiver_slowness=_both(receiver),
            ),
        ]
    )


def within_cone(receptions: Receptions, source: Array, receiver: Array, cone: float) -> Receptions:
    """Receptions whose sound leaves within an angle [rad] of the chord, and those without a ray."""
    step = (receiver - source)[receptions.link]
    forth = receptions.direction == Direction.FORTH
    chord_angle = _elevation(np.where(forth[:, None], step, -step))
    deviation = np.abs(receptions.departure_angle - chord_angle)
    return receptions.at({"reception": ~(deviation > cone) | (receptions.arrival < 0)})


def select_receptions(receptions: Receptions, rule: ArrivalRule) -> Receptions:
    """
    Receptions with at most one selected per link and direction.

    Its probability is that of its detection, others have 0.
    """
    lossless = np.isnan(receptions.loss_db).all()
    strength = receptions.spreading_db if lossless else receptions.loss_db
    keys = [receptions.travel_time]
    if rule == "strongest":
        keys.insert(0, strength)
    if rule == "direct-or-first":
        keys.insert(0, (receptions.path == SoundPath.REFLECTED).astype(float))
    selected = np.zeros(receptions.link.size, dtype=np.int8)
    # sound without a ray exists only on links without a direct eigenray
    admissible = (receptions.path != SoundPath.REFLECTED) | (rule != "direct")
    selected[first_rows(receptions.group, keys, admissible).row] = 1
    probability = np.where(selected == 1, receptions.detection, 0.0)
    return replace(receptions, selected=selected, probability=probability)


def join_receptions(tables: Sequence[Receptions]) -> Receptions:
    """Join tables with the same links and arrivals, in the order of a table."""
    receptions = Receptions.stack(tables)
    return receptions.at({"reception": np.argsort(receptions.group, kind="stable")})


def rows_between(start: Indices, stop: Indices) -> tuple[Indices, Indices]:
    """Index of the pair for every row from its start up to its stop, and these rows."""
    count = stop - start
    pair = np.repeat(np.arange(count.size), count)
    return pair, np.arange(pair.size) - np.repeat(np.cumsum(count) - count, count) + start[pair]


def values_at(values: AnyArray, rows: Indices) -> Array:
    """Values at rows, NaN at rows of -1."""
    result = np.full(rows.shape + values.shape[1:], np.nan)
    exists = rows >= 0
    result[exists] = values[rows[exists]]
    return result
