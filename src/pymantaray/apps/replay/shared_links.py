"""Links that events of one pair of nodes share, in both directions."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.replay.events import Events
from pymantaray.arrays import Array, Indices
from pymantaray.sensing.receptions import Direction

_CELL = np.array([10.0, 10.0, 1.0])
"""Events share a link if their ends differ by less than about this, north, east and down. [m]"""
_PAIR_SPACING = 37.3  # correlation lengths between the ice of successive pairs


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
        ice_length: float | None = None,
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
        ice_length : float, optional
            Correlation length of rough ice. [m]
        drifts : bool
            True if only the position of one end relative to the other counts: water without
            horizontal gradients, and ice that drifts with the nodes. For positions by latitude and
            longitude, each pair has its own ice.

        Returns
        -------
        SharedLinks
        """
        _, pair = np.unique(events.pair, return_inverse=True)
        back = events.source[rows] > events.receiver[rows]
        source, receiver = ends
        first = np.where(back[:, None], receiver, source)
        second = np.where(back[:, None], source, receiver)
        if drifts:
            origin = first * [1.0, 1.0, 0.0]
            if events.geographic:
                origin[:, 0] -= _PAIR_SPACING * (ice_length or 0.0) * pair[rows]
            else:  # a node at rest stays where it is under the ice of the frame
                count = np.maximum(np.bincount(pair[rows]), 1)
                middle = np.stack([np.bincount(pair[rows], x) / count for x in origin.T], axis=1)
                origin -= middle[pair[rows]]
            first, second = first - origin, second - origin
        both = np.concatenate([first, second - first], axis=1)
        cells = np.round(both / np.tile(_CELL, 2)).astype(np.int64)
        keys = np.column_stack([pair[rows], cells])
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
