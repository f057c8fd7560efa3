"""Links that events of one pair of nodes share, in both directions."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.replay.event_data import HOUR
from pymantaray.apps.replay.events import Events
from pymantaray.arrays import Array, Indices
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.roughness import Roughness
from pymantaray.sensing.receptions import Direction

_CELL = np.array([10.0, 10.0, 1.0])
"""Events share a link if their ends differ by less than about this, north, east and down. [m]"""
_HOURLY = (0.7548776662466927, 0.5698402909980532)
"""Shift of the ice after an hour as a share of its tile: the R2 sequence, whose points spread."""


class SharedLinks(NamedTuple):
    """Links from the first to the second node of pairs, by name, and the link of each event."""

    source: Array
    """(n_links, 3), mean of the events that share the link. [m]"""
    receiver: Array
    link: Indices
    """Link of each event."""
    direction: Indices
    """`Direction` in which each event uses its link."""
    change: Array
    """
    Horizontal range, depth of the first and depth of the second node of each event, less those of
    its link (n_events, 3). [m]
    """

    @classmethod
    def of(
        cls,
        events: Events,
        rows: Indices,
        ends: tuple[Array, Array],
        *,
        ice: Roughness | None = None,
        drifts: bool = False,
    ) -> Self:
        """
        Share links among events of a pair whose ends are near each other.

        Parameters
        ----------
        events : Events
        rows : ndarray of int, shape (n,)
            Events of the ends.
        ends : tuple of ndarray
            Sources and receivers, each (n, 3). [m]
        ice : Roughness, optional
            Roughness of the ice.
        drifts : bool
            True if only the position of one end relative to the other counts for the water, which
            has no horizontal gradients. Events under rough ice then share a link only within a
            stretch, see `ice_stretches`.

        Returns
        -------
        SharedLinks
        """
        _, pair = np.unique(events.pair, return_inverse=True)
        back = events.source[rows] > events.receiver[rows]
        source, receiver = ends
        first = np.where(back[:, None], receiver, source)
        second = np.where(back[:, None], source, receiver)
        stretch = np.zeros(rows.size, dtype=np.int64)
        if drifts:
            origin = first * [1.0, 1.0, 0.0]
            if ice is not None:
                at = np.where(
                    back[:, None], events.receiver_position[rows], events.source_position[rows]
                )
                stretch, place = ice_stretches(events, rows, pair[rows], at, ice)
                origin[:, :2] -= place
            elif not events.geographic:
                count = np.maximum(np.bincount(pair[rows]), 1)
                middle = np.stack([np.bincount(pair[rows], x) / count for x in origin.T], axis=1)
                origin -= middle[pair[rows]]
            first, second = first - origin, second - origin
        both = np.concatenate([first, second - first], axis=1)
        cells = np.round(both / np.tile(_CELL, 2)).astype(np.int64)
        keys = np.column_stack([pair[rows], stretch, cells])
        _, link = np.unique(keys, axis=0, return_inverse=True)
        link = link.reshape(-1)
        count = np.bincount(link).astype(float)
        mean = np.stack([np.bincount(link, column) for column in both.T], axis=1) / count[:, None]
        shared_first, shared_second = mean[:, :3], mean[:, :3] + mean[:, 3:]
        horizontal = np.hypot(*(second - first)[:, :2].T)
        shared = np.hypot(*(shared_second - shared_first)[:, :2].T)
        change = np.stack(
            [
                horizontal - shared[link],
                first[:, 2] - shared_first[link, 2],
                second[:, 2] - shared_second[link, 2],
            ],
            axis=1,
        )
        direction = np.where(back, Direction.BACK, Direction.FORTH)
        return cls(shared_first, shared_second, link, direction, change)

    @property
    def way(self) -> Indices:
        """Number of the link and direction of each event."""
        return np.asarray(2 * self.link + self.direction)

    def gradient_of(self, link: Indices, source: Array, receiver: Array) -> Array:
        """
        Derivatives of travel times by horizontal range and by the depths of both nodes (n, 3).

        Parameters
        ----------
        link : ndarray of int, shape (n,)
            Link of each arrival.
        source, receiver : ndarray, shape (n, 3)
            Slowness vectors of the arrival at the first and at the second node. [s/m]
        """
        step = (self.receiver - self.source)[link, :2]
        along = step / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
        by_range = 0.5 * np.einsum("ni,ni->n", source[:, :2] + receiver[:, :2], along)
        return np.stack([by_range, -source[:, 2], receiver[:, 2]], axis=1)


def ice_stretches(
    events: Events, rows: Indices, pair: Indices, position: Array, ice: Roughness
) -> tuple[Indices, Array]:
    """
    Stretches of events of a pair under the same ice, and their places on the tile of the ice.

    Parameters
    ----------
    events : Events
    rows, pair : ndarray of int, shape (n,)
        Some events, and the number of the pair of each.
    position : ndarray, shape (n, 3)
        First node of each event, as in `Events`.
    ice : Roughness

    Returns
    -------
    stretch : ndarray of int, shape (n,)
        Number of the stretch of each event.
    place : ndarray, shape (n, 2)
        North and east of the first node on the tile. [m]

    Notes
    -----
    The ice stays over ground, and nodes drift under it: a stretch ends after a drift by one
    correlation length, to the next square of this size. All ice changes at each full hour since the
    first event.
    """
    if events.geographic:
        # the earliest event, in whichever row it is
        earliest = np.lexsort([*events.source_position[:, :2].T, events.time])[0]
        centre = LocalFrame(*events.source_position[earliest, :2])
        ground = np.stack(centre.to_local(position[:, 0], position[:, 1]), axis=1)
    else:
        ground = position[:, :2]
    hour = np.floor((events.time[rows] - events.time.min()) / HOUR)
    square = np.floor(ground / ice.length)
    keys = np.column_stack([pair, hour, square])
    _, stretch = np.unique(keys, axis=0, return_inverse=True)
    stretch = stretch.reshape(-1)
    count = np.bincount(stretch)
    middle = np.stack([np.bincount(stretch, x) / count for x in ground.T], axis=1)[stretch]
    place = middle + ice.side * np.outer(hour, _HOURLY)
    return stretch, np.mod(place, ice.side)


def rows_of_ways(way: Indices, of_events: Indices) -> tuple[Indices, NDArray[np.int64]]:
    """
    Rows of a sorted table of ways for each event, and the event of each row.

    Parameters
    ----------
    way : ndarray of int, shape (n_rows,)
        Way of each row, ascending.
    of_events : ndarray of int, shape (n_events,)
        Way of each event.
    """
    start = np.searchsorted(way, of_events)
    count = np.searchsorted(way, of_events, side="right") - start
    event = np.repeat(np.arange(of_events.size), count)
    before = np.repeat(np.cumsum(count) - count, count)
    return np.arange(event.size) - before + start[event], event
