"""Options for data that a survey's file does not contain, or that replace its data."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from pymantaray.apps.locate.survey import LeverArm, PlatformError, Survey
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
        Standard deviations of the lever arm, which the solver then estimates; 0 0 0 for an exact
        lever arm and exact headings. Default: from the file. [m]
    platform_error : PlatformError, optional
        Errors of positions, which replace those of the file.

    Examples
    --------
    >>> from pymantaray.apps.locate import ReadOptions
    >>> ReadOptions(nodes="nodes.csv", lever=(6.0, -2.5, 20.0)).lever
    (6.0, -2.5, 20.0)
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
        names = ("turn_around", "turn_around_sigma", "offset_sigma", "drift_sigma")
        changes = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        horizontal = self.horizontal_sigma
        nodes = []
        for node in survey.nodes:
            north, east, depth = node.sigma
            if horizontal is not None:
                north = east = horizontal
            if self.depth_sigma is not None:
                depth = self.depth_sigma
            nodes.append(replace(node, sigma=(north, east, depth), **changes))
        sigma = survey.sigma
        if self.sigma is not None:
            if not self.sigma > 0.0:
                raise LocateError(f"sigma is {self.sigma:g} s; it must be positive")
            sigma = np.where(np.isfinite(sigma), sigma, self.sigma)
        return survey.assign(
            nodes=tuple(nodes),
            lever=LeverArm(
                self.lever or survey.lever.offset,
                self.lever_sigma or survey.lever.sigma,
                exact=self.lever_sigma is not None and not any(self.lever_sigma),
            ),
            sigma=sigma,
            platform_error=self.platform_error or survey.platform_error,
        )

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
        position : ndarray, shape (n, 3)
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
        known = np.isfinite(position).all(axis=1)
        rising, first = np.unique(time[known], return_index=True)
        if rising.size < 2:
            raise LocateError(
                "position_at: interpolation needs at least two pings; use `position_at='both'`"
            )
        from scipy.interpolate import make_interp_spline

        # linear, also beyond the first and the last position
        at = make_interp_spline(rising, position[known][first], k=1)
        if self.position_at == "transmission":
            return time, position, at(time + duration)
        # times in order, even if a duration is wrong
        return time - float(np.median(duration)), at(time - duration), position
