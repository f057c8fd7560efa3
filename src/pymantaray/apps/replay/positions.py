"""Smoothed positions of nodes: a random walk with drift, measured with noise."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pymantaray.apps.replay.events import ENDS, Events
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.geometry import LocalFrame
from pymantaray.quantities.checks import check_number
from pymantaray.records.position_rows import middle_longitude

# m per square root of a second, among which the likelihood chooses
_WALKS = np.geomspace(1e-4, 10.0, 21)
_REFINEMENTS = 3  # of the choice, each ten times finer
_DRIFT = 2.0  # m/s; prior standard deviation of the drift, above that of ice
_VAGUE = 1e4  # m; prior standard deviation of the first position


class SmoothedPositions(NamedTuple):
    """Events with smoothed positions, and a table of the nodes."""

    events: Events
    nodes: pd.DataFrame
    """
    One row per node: ``readings``, ``sigma_m``, ``walk_m_per_sqrt_s``, drift ``north_m_s`` and
    ``east_m_s``, ``rms_change_m``, ``max_change_m`` and ``innovation_ratio``.
    """


class _SmoothCoordinate(NamedTuple):
    position: Array
    drift: float
    innovations: Array
    """Normalized by their standard deviations."""


def smooth_positions(events: Events, sigma: float) -> SmoothedPositions:
    r"""
    Smooth the horizontal positions of all nodes.

    Each coordinate of a node is :math:`x(t) = x_0 + v t + w(t)` with a constant drift v and a
    random walk w, and is measured with independent errors. A Kalman filter and a
    Rauch-Tung-Striebel smoother estimate it. The strength of the random walk has the largest
    likelihood for both coordinates of the node.

    Parameters
    ----------
    events : Events
        Positions at the same time of a node count as one reading; different ones are averaged.
    sigma : float
        Standard deviation of a measured horizontal coordinate. [m]

    Returns
    -------
    SmoothedPositions

    Raises
    ------
    ReplayError
        If sigma is not positive.

    Notes
    -----
    Depths are not changed. Errors that are constant over the campaign remain, because no position
    shows them; see `pymantaray.apps.replay.consistency.node_table`. ``innovation_ratio`` is the
    root mean square of the normalized innovations: about 1 if sigma is right, more if the errors
    are larger.

    Examples
    --------
    >>> from pathlib import Path
    >>> axes = ("north", "east", "depth")
    >>> ends = [f"{end}_{axis}" for end in ("source", "receiver") for axis in axes]
    >>> head = ",".join(["time", "source", "receiver", *ends, "travel_time"])
    >>> _ = Path("events.csv").write_text(head + "\n0,A,B,0,0,30,1500,0,150,1.03\n")
    >>> from pymantaray.apps.replay import read_events, smooth_positions
    >>> smoothed, positions = smooth_positions(read_events("events.csv"), sigma=3.0)
    >>> smoothed.travel_time
    array([1.03])
    """
    check_number(ReplayError, "smooth positions: sigma", sigma, "m", positive=True)
    # horizontal positions in metres
    frame = None
    coordinates = np.stack([events.source_position, events.receiver_position])[..., :2].copy()
    if events.geographic:
        flat = coordinates.reshape(-1, 2)
        frame = LocalFrame(float(np.median(flat[:, 0])), middle_longitude(flat[:, 1]))
        coordinates = np.stack(frame.to_local(coordinates[..., 0], coordinates[..., 1]), axis=-1)
    # smooth the readings of each node
    names = np.stack([events.source, events.receiver])
    times = np.broadcast_to(events.time, names.shape)
    rows = []
    for name in np.unique(names):
        of_node = names == name
        instants, reading_of = np.unique(times[of_node], return_inverse=True)
        sums = [np.bincount(reading_of, coordinate) for coordinate in coordinates[of_node].T]
        readings = np.stack(sums, axis=-1) / np.bincount(reading_of)[:, None]
        walk, axes = _fit_walk(instants, readings, sigma)
        north, east = axes
        smooth = np.stack([north.position, east.position], axis=-1)
        change = np.linalg.norm(smooth - readings, axis=-1)
        innovations = np.concatenate([axis.innovations for axis in axes])
        ratio = float(np.sqrt(np.mean(innovations**2))) if innovations.size else np.nan
        row = {
            "node": name,
            "readings": instants.size,
            "sigma_m": sigma,
            "walk_m_per_sqrt_s": walk,
            "north_m_s": north.drift,
            "east_m_s": east.drift,
            "rms_change_m": np.sqrt(np.mean(change**2)),
            "max_change_m": change.max(),
            "innovation_ratio": ratio,
        }
        rows.append(row)
        coordinates[of_node] = smooth[reading_of]
    # positions in the coordinates of the events
    table = pd.DataFrame(rows)
    if frame is not None:
        coordinates = np.stack(frame.to_geodetic(coordinates[..., 0], coordinates[..., 1]), axis=-1)
    positions: dict[str, Any] = {
        f"{end}_position": np.column_stack(
            [coordinates[k], getattr(events, f"{end}_position")[:, 2]]
        )
        for k, end in enumerate(ENDS)
    }
    return SmoothedPositions(replace(events, **positions), table)


def _fit_walk(time: Array, readings: Array, sigma: float) -> tuple[float, list[_SmoothCoordinate]]:
    """Strength of the random walk with the largest likelihood, and both smoothed coordinates."""

    def likelihood(walk: float) -> float:
        return sum(
            _filter(time, coordinate, sigma, walk).log_likelihood for coordinate in readings.T
        )

    if time.size < 3:
        return 0.0, [_smooth(time, coordinate, sigma, 0.0) for coordinate in readings.T]
    grid = _WALKS
    for _ in range(_REFINEMENTS):
        best = int(np.argmax([likelihood(walk) for walk in grid]))
        low = grid[max(best - 1, 0)]
        high = grid[min(best + 1, grid.size - 1)]
        walk = float(grid[best])
        grid = np.geomspace(low, high, 7)
    return walk, [_smooth(time, coordinate, sigma, walk) for coordinate in readings.T]


_State = tuple[float, float, float, float, float]
"""Position, drift and their covariance (xx, xv, vv)."""


class _FilterResult(NamedTuple):
    states: list[_State]
    """State after each reading."""
    predicted: list[_State]
    """The same before it."""
    log_likelihood: float
    innovations: list[float]


def _filter(time: Array, reading: Array, sigma: float, walk: float) -> _FilterResult:
    """Kalman filter of one coordinate relative to its first reading."""
    x = 0.0
    v = 0.0
    xx = _VAGUE**2
    xv = 0.0
    vv = _DRIFT**2
    first = float(reading[0])
    before = float(time[0])
    total = 0.0
    states: list[_State] = []
    predictions: list[_State] = []
    innovations: list[float] = []
    for now, value in zip(time.tolist(), reading.tolist(), strict=True):
        step = now - before
        before = now
        x = x + step * v
        xx = xx + step * (2.0 * xv + step * vv) + walk**2 * step
        xv = xv + step * vv
        predictions.append((x, v, xx, xv, vv))
        variance = xx + sigma**2
        innovation = value - first - x
        x = x + xx / variance * innovation
        v = v + xv / variance * innovation
        xx, xv, vv = xx * sigma**2 / variance, xv * sigma**2 / variance, vv - xv**2 / variance
        states.append((x, v, xx, xv, vv))
        innovations.append(innovation / math.sqrt(variance))
        total -= 0.5 * (innovations[-1] ** 2 + math.log(variance))
    return _FilterResult(states, predictions, total, innovations)


def _smooth(time: Array, reading: Array, sigma: float, walk: float) -> _SmoothCoordinate:
    """
    Kalman filter and Rauch-Tung-Striebel smoother of one coordinate.

    The state is position and drift.
    """
    forward = _filter(time, reading, sigma, walk)
    states = np.array(forward.states)
    predictions = np.array(forward.predicted)
    covariance, predicted_covariance = (
        values[:, [[2, 3], [3, 4]]] for values in (states, predictions)
    )
    smooth = states[:, :2].copy()
    for k in range(time.size - 2, -1, -1):
        transition = np.array([[1.0, float(time[k + 1] - time[k])], [0.0, 1.0]])
        gain = covariance[k] @ transition.T @ np.linalg.pinv(predicted_covariance[k + 1])
        smooth[k] += gain @ (smooth[k + 1] - predictions[k + 1, :2])
    position = float(reading[0]) + smooth[:, 0]
    innovations = np.array(forward.innovations[2:])  # the first two determine position and drift
    return _SmoothCoordinate(position, float(smooth[-1, 1]), innovations)
