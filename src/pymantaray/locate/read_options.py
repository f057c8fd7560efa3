"""What a survey's file may lack, and what readers of several formats have in common."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import LocateError
from pymantaray.locate.survey import LeverArm, Node, PlatformError, Survey

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReadOptions:
    """
    What a survey's file does not say.

    Parameters
    ----------
    nodes : str or pathlib.Path, optional
        Table of nodes with prior positions.
    track : tuple of str or pathlib.Path
        Trajectory of the platform, of any format that `pymantaray.read_trajectories` reads.
    platform : str, optional
        Name of the platform in the track; needed if that has several.
    position_at : {"both", "transmission", "reception"}
        What a single position per ping is of. With ``both`` the platform is taken to be there at both instants; otherwise the
        other position is interpolated between pings.
    transducer_depth : float
        Depth of positions that come without. [m]
    depth : float, optional
        Prior depth of nodes that come without. [m]
    depth_sigma, horizontal_sigma : float, optional
        Prior standard deviations in place of the files'. [m]
    turn_around, turn_around_sigma : float, optional
        Of all nodes, in place of the files'. [s]
    offset_sigma, drift_sigma : float, optional
        Of all clocks, in place of the files'. [s], [s/s]
    sigma : float, optional
        Stated standard deviation of times that come without. [s]
    lever, lever_sigma : tuple of float, optional
        Antenna to transducer, forward, starboard, down, and standard deviations, in place of the file's. [m]
    platform_error : PlatformError, optional
        In place of the file's.
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
        """The node with what the options say of all nodes."""
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

    def applied(self, survey: Survey) -> Survey:
        """The survey with what the options say of all pings and nodes."""
        changed = survey.changed(nodes=tuple(self.node(node) for node in survey.nodes))
        if self.sigma is not None:
            if not self.sigma > 0.0:
                raise LocateError(f"sigma is {self.sigma:g} s; a positive standard deviation is needed")
            changed = changed.changed(sigma=np.where(np.isfinite(survey.sigma), survey.sigma, self.sigma))
        lever = LeverArm(self.lever or survey.lever.offset, self.lever_sigma or survey.lever.sigma)
        changed = changed.changed(lever=lever)
        if self.platform_error is not None:
            changed = changed.changed(platform_error=self.platform_error)
        return changed

    def both_ends(self, time: Array, duration: Array, place: Array) -> tuple[Array, Array, Array]:
        """
        Times of transmission, about these where receptions are stated, and positions at both ends, from one position per ping at its stated time.

        ``place`` (n, 3) is in the local frame. [m]
        """
        if self.position_at == "both":
            return time, place, place
        rising, first = np.unique(time, return_index=True)
        if rising.size < 2:
            raise LocateError("position at one end: two pings or more are needed to interpolate between")
        sent = time if self.position_at == "transmission" else time - duration
        wanted = sent + duration if self.position_at == "transmission" else sent
        other = np.column_stack([_extended(wanted, rising, place[first, axis]) for axis in range(3)])
        if self.position_at == "transmission":
            return sent, place, other
        return time - float(np.median(duration)), other, place  # in order even where a duration is wrong


def _extended(wanted: Array, time: Array, values: Array) -> Array:
    """Linear interpolation, continued at both ends by the slope there."""
    i = np.clip(np.searchsorted(time, wanted) - 1, 0, time.size - 2)
    slope = (values[i + 1] - values[i]) / (time[i + 1] - time[i])
    return np.asarray(values[i] + slope * (wanted - time[i]))


def skipped_note(path: Path, count: int) -> tuple[str, ...]:
    """Line that counts events without an answer."""
    return (f"{path}: {count} event{'' if count == 1 else 's'} without an answer",) if count else ()
