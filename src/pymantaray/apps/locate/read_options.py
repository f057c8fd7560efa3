"""Options for data that a survey's file does not contain, and functions shared by readers."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pymantaray.apps.locate.survey import LeverArm, Node, PlatformError, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError


@dataclass(frozen=True)
class ReadOptions:
    """
    Data that a survey's file does not contain, or that replace its data.

    Parameters
    ----------
    nodes : str or pathlib.Path, optional
        Table of prior positions: name, lat, lon (or north_m, east_m), depth_m, standard deviations.
    track : tuple of str or pathlib.Path
        Trajectory of the platform, in any format that ``mantaray ranges`` reads.
    platform : str, optional
        Name of the platform in the track; required if the track has several.
    position_at : {"both", "transmission", "reception"}
        Instant of a single position per ping; with one of the two, the other position is
        interpolated.
    transducer_depth : float
        Depth of positions without depth. [m]
    depth : float, optional
        Prior depth of nodes without one. [m]
    depth_sigma : float, optional
        Standard deviation of prior depths. Default: from the file. [m]
    horizontal_sigma : float, optional
        Standard deviation of prior north and east positions. Default: from the file. [m]
    turn_around : float, optional
        Turn-around time of all nodes, such as 0.013 s. Default: from the file. [s]
    turn_around_sigma : float, optional
        Standard deviation of turn-around times, which the solver then estimates. Default: from the
        file. [s]
    offset_sigma : float, optional
        Standard deviation of clock offsets, for one-way times. Default: from the file. [s]
    drift_sigma : float, optional
        Standard deviation of clock drifts, for one-way times. Default: from the file. [s/s]
    sigma : float, optional
        Standard deviation of times without one, for a chi-square test. [s]
    lever : tuple of float, optional
        Vector from antenna to transducer: forward, starboard, down. Default: from the file. [m]
    lever_sigma : tuple of float, optional
        Standard deviations of the lever arm, which the solver then estimates. Default: from the
        file. [m]
    platform_error : PlatformError, optional
        Errors of positions, which replace those of the file.
    """

    nodes: str | Path | None = None
    track: tuple[str | Path, ...] = ()
    platform: str | None = None
    position_at: Literal["both", "transmission", "reception"] = "both"
    transducer_depth: float = 0.0
    depth: float | None = None
    depth_sigma: float | None = None
    horizontal_sigma: float | None = None
    turn_around: float | None = None
    turn_around_sigma: float | None = None
    offset_sigma: float | None = None
    drift_sigma: float | None = None
    sigma: float | None = None
    lever: tuple[float, float, float] | None = None
    lever_sigma: tuple[float, float, float] | None = None
    platform_error: PlatformError | None = None

    def node(self, node: Node) -> Node:
        """
        Apply the options to a node.

        Parameters
        ----------
        node : Node
            Node from a file.

        Returns
        -------
        Node
        """
        changes = {
            name: getattr(self, name)
            for name in ("turn_around", "turn_around_sigma", "offset_sigma", "drift_sigma")
            if getattr(self, name) is not None
        }
        horizontal = self.horizontal_sigma
        sigma = (
            node.sigma[0] if horizontal is None else horizontal,
            node.sigma[1] if horizontal is None else horizontal,
            node.sigma[2] if self.depth_sigma is None else self.depth_sigma,
        )
        return replace(node, sigma=sigma, **changes)

    def apply(self, survey: Survey) -> Survey:
        """
        Apply the options to a survey.

        Parameters
        ----------
        survey : Survey
            Survey from a file.

        Returns
        -------
        Survey
        """
        values: dict[str, Any] = {
            "nodes": tuple(self.node(node) for node in survey.nodes),
            "lever": LeverArm(
                self.lever or survey.lever.offset, self.lever_sigma or survey.lever.sigma
            ),
        }
        if self.sigma is not None:
            if not self.sigma > 0.0:
                raise LocateError(f"sigma is {self.sigma:g} s; it must be positive")
            values["sigma"] = np.where(np.isfinite(survey.sigma), survey.sigma, self.sigma)
        if self.platform_error is not None:
            values["platform_error"] = self.platform_error
        return survey.assign(**values)

    def both_ends(
        self, time: Array, duration: Array, position: Array
    ) -> tuple[Array, Array, Array]:
        """
        Compute times of transmission and positions at both instants from one position per ping.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Times of the positions. [s]
        duration : ndarray, shape (n,)
            Two-way times. [s]
        place : ndarray, shape (n, 3)
            Positions in the local frame. [m]

        Returns
        -------
        time : ndarray, shape (n,)
            Times of transmission; approximate for ``position_at="reception"``. [s]
        transmit_position, receive_position : ndarray, shape (n, 3)
            [m]
        """
        if self.position_at == "both":
            return time, position, position
        rising, first = np.unique(time, return_index=True)
        if rising.size < 2:
            raise LocateError(
                "position_at: interpolation needs at least two pings; use `position_at='both'`"
            )
        transmit_time = time if self.position_at == "transmission" else time - duration
        other_time = (
            transmit_time + duration if self.position_at == "transmission" else transmit_time
        )
        other = np.column_stack(
            [_extrapolate(other_time, rising, position[first, axis]) for axis in range(3)]
        )
        if self.position_at == "transmission":
            return transmit_time, position, other
        # times in order, even if a duration is wrong
        return time - float(np.median(duration)), other, position


def _extrapolate(instant: Array, time: Array, values: Array) -> Array:
    """Linear interpolation with linear extrapolation."""
    i = np.clip(np.searchsorted(time, instant) - 1, 0, time.size - 2)
    slope = (values[i + 1] - values[i]) / (time[i + 1] - time[i])
    return np.asarray(values[i] + slope * (instant - time[i]))


def skipped_note(path: Path, count: int) -> tuple[str, ...]:
    """Note with the number of events without an answer."""
    return (f"{path}: {count} event{'' if count == 1 else 's'} without an answer",) if count else ()
