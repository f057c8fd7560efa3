"""Survey: pings between a platform and nodes, or between two nodes, with priors."""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.tangent_plane import TangentPlane
from pymantaray.quantities.checks import MAGNITUDES, check_magnitudes

DepthReference = Literal["surface", "plane"]
LARGEST_POSITION = 1e6
"""Limit of coordinates in the frame of a survey, whose nodes are near its centre. [m]"""
_LONGEST_LEVER = 1e4  # m
_MAX_TRAVEL_TIME = 120.0  # s; two-way time of 90 km, beyond the reach of any transponder


class TravelDirection(IntEnum):
    """Direction of a measured time."""

    TWO_WAY = 0  # to the node and back, including its turn-around time
    FROM_NODE = 1  # one way, from the node to the platform or to the other node
    TO_NODE = 2  # one way, from the platform or the other node to the node


@dataclass(frozen=True)
class Node:
    """
    A node with priors of its position, turn-around time and clock.

    Parameters
    ----------
    name : str
        Unique name.
    position : tuple of float
        Prior mean: north, east, depth in the survey's frame, for example of the drop point. [m]
    sigma : tuple of float
        Prior standard deviations of the position; 0 for a known coordinate. [m]
    turn_around : float
        Delay between reception and answer of a two-way time. [s]
    turn_around_sigma : float
        Prior standard deviation of this delay; 0 if it is known. [s]
    offset_sigma, drift_sigma : float
        Prior standard deviations of the clock's offset at the first ping [s] and of its drift
        [s/s], for one-way times.

    Examples
    --------
    >>> from pymantaray.apps.locate import Node
    >>> Node("M1", (0.0, 0.0, 1300.0), turn_around=0.32).name
    'M1'
    """

    name: str
    position: tuple[float, float, float]
    sigma: tuple[float, float, float] = (2000.0, 2000.0, 200.0)
    turn_around: float = 0.0
    turn_around_sigma: float = 0.0
    offset_sigma: float = 0.0
    drift_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not self.name:
            raise LocateError("node: the name is empty; give every node a unique name")
        if not (np.abs(self.position) <= LARGEST_POSITION).all():  # NaN does not pass
            raise LocateError(
                f"node {self.name}: position is {self.position}; it must be finite and within"
                f" {LARGEST_POSITION:g} m"
            )
        numbers = (
            *self.sigma,
            self.turn_around,
            self.turn_around_sigma,
            self.offset_sigma,
            self.drift_sigma,
        )
        check_magnitudes(LocateError, f"node {self.name}: a standard deviation or time", *numbers)
        if self.turn_around > 60.0:
            raise LocateError(
                f"node {self.name}: turn-around time is {self.turn_around:g} s, which is too long;"
                " write milliseconds as '13 ms'"
            )


@dataclass(frozen=True)
class LeverArm:
    """
    Vector from the antenna, which defines the positions, to the transducer.

    Parameters
    ----------
    offset : tuple of float
        Components forward, starboard and down. [m]
    sigma : tuple of float
        Prior standard deviations of the lever arm (forward, starboard, down); 0 for a known axis.
        [m]
    exact : bool
        True if the lever arm and the headings have no small errors. Otherwise these are part of
        the standard deviations of the positions.

    Examples
    --------
    >>> from pymantaray.apps.locate import LeverArm
    >>> LeverArm(offset=(6.0, -2.5, 20.0), sigma=(0.02, 0.02, 0.05)).offset
    (6.0, -2.5, 20.0)
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    exact: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (np.abs(self.offset) <= _LONGEST_LEVER).all():  # NaN does not pass
            raise LocateError(
                f"lever arm is {self.offset}; it must be three numbers within"
                f" {_LONGEST_LEVER:g} metres"
            )
        check_magnitudes(LocateError, "lever arm: sigma", *self.sigma, unit="m")

    @property
    def used(self) -> bool:
        """True if the lever arm or its standard deviation is not 0."""
        return any(self.offset) or any(self.sigma)


@dataclass(frozen=True)
class PlatformError:
    """
    Errors of the platform's positions.

    Parameters
    ----------
    horizontal : float
        Standard deviation of north and of east. [m]
    vertical : float
        Standard deviation of depth. [m]
    correlation : float
        Correlation time. [s]

    Examples
    --------
    >>> from pymantaray.apps.locate import PlatformError
    >>> PlatformError(horizontal=0.05, vertical=0.1).correlation
    600.0
    """

    horizontal: float = 0.0
    vertical: float = 0.0
    correlation: float = 600.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_magnitudes(LocateError, "platform error", self.horizontal, self.vertical, unit="m")
        if not self.correlation > 0.0:
            raise LocateError(
                f"platform error: correlation time is {self.correlation:g} s; it must be positive"
            )


@dataclass(frozen=True, eq=False)
class Survey:
    r"""
    Measured travel times and positions of the platform.

    Parameters
    ----------
    nodes : sequence of Node
        Nodes with priors.
    node : array_like of int, shape (n,)
        Index of each ping's node.
    time : array_like, shape (n,)
        Time of transmission. [s]
    travel_time : array_like, shape (n,)
        Measured time: two-way including the turn-around time, or one-way. [s]
    transmit_position, receive_position : array_like, shape (n, 3)
        Positions of the platform's antenna at transmission and reception: north, east, depth; NaN
        for pings between nodes. [m]
    transmit_attitude, receive_attitude : array_like, shape (n, 3), optional
        Heading, pitch (bow up) and roll (starboard down). [rad]
    direction : array_like of int, shape (n,), optional
        `TravelDirection` of each time; two-way by default.
    partner : array_like of int, shape (n,), optional
        Index of the other node of a ping between two nodes, or of the same node for an echo of the
        sea surface (inverted echo sounder); -1 (default) for the platform.
    sigma : array_like, shape (n,), optional
        Stated standard deviation of each time; NaN if unknown. [s]
    flagged : array_like of bool, shape (n,), optional
        True for pings that the file marks as bad.
    line : array_like of int, shape (n,), optional
        Line in the file of each ping.
    lever : LeverArm
        Vector from antenna to transducer.
    platform_error : PlatformError
        Errors of the platform's positions.
    frame : LocalFrame, optional
        Frame of the positions; None if latitude and longitude are unknown.
    depth_reference : {"surface", "plane"}
        Origin of depths: the sea surface, which is curved, or the tangent plane at the frame's
        centre, in which north and east are then straight axes.
    epoch : numpy.datetime64
        UTC of time 0; NaT if it is unknown.
    rigid : tuple of float, optional
        Prior standard deviations of north, east, depth [m] and rotation [rad] of a rigid array.
        Default: free nodes.
    profile : tuple of ndarray, optional
        Depth [m] and sound speed [m/s] of the profile in the survey's files.
    source : str
        File, for messages.
    notes : sequence of str
        Changes and omissions by the reader.

    Examples
    --------
    Continues the example of `pymantaray.apps.locate`:

    >>> [node.name for node in survey.nodes]
    ['M1']
    """

    nodes: tuple[Node, ...]
    node: Indices
    time: Array
    travel_time: Array
    transmit_position: Array
    receive_position: Array
    transmit_attitude: Array = field(default_factory=lambda: np.empty(0))
    receive_attitude: Array = field(default_factory=lambda: np.empty(0))
    direction: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    partner: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    sigma: Array = field(default_factory=lambda: np.empty(0))
    flagged: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    line: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    lever: LeverArm = LeverArm()
    platform_error: PlatformError = PlatformError()
    frame: LocalFrame | None = None
    depth_reference: DepthReference = "surface"
    epoch: np.datetime64 = field(default_factory=lambda: np.datetime64("NaT", "ns"))
    rigid: tuple[float, float, float, float] | None = None
    profile: tuple[Array, Array] | None = None
    source: str = "survey"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Set defaults and check all values."""
        n = np.size(self.travel_time)
        object.__setattr__(self, "nodes", tuple(self.nodes))
        for name, n_columns, default, kind in (
            ("time", 0, 0.0, float),
            ("travel_time", 0, 0.0, float),
            ("transmit_position", 3, 0.0, float),
            ("receive_position", 3, 0.0, float),
            ("transmit_attitude", 3, 0.0, float),
            ("receive_attitude", 3, 0.0, float),
            ("node", 0, 0, np.int64),
            ("direction", 0, TravelDirection.TWO_WAY, np.int64),
            ("partner", 0, -1, np.int64),
            ("sigma", 0, np.nan, float),
            ("flagged", 0, False, bool),
            ("line", 0, 0, np.int64),
        ):
            values = np.asarray(getattr(self, name))
            shape = (n, n_columns) if n_columns else (n,)
            if values.size:
                array = np.array(values, dtype=kind)
            else:
                array = np.full(shape, default, dtype=kind)
            if array.shape != shape:
                raise LocateError(
                    f"{self.source}: {name} has shape {array.shape}; it must be {shape}"
                )
            object.__setattr__(self, name, array)
        self._check()

    def _check(self) -> None:
        n = self.travel_time.size
        if n == 0:
            raise LocateError(f"{self.source}: no ping has an answer; the survey needs answers")
        names = [node.name for node in self.nodes]
        check_names(names, self.source)
        if self.node.min() < 0 or max(self.node.max(), self.partner.max()) >= len(names):
            raise LocateError(
                f"{self.source}: the node of a ping does not exist; allowed indices: 0 to"
                f" {len(names) - 1}"
            )
        self.refuse("travel_time", ~np.isfinite(self.travel_time), "a number of seconds")
        # the unknown clock of a one-way time may make it negative
        two_way = self.direction == TravelDirection.TWO_WAY
        self.refuse("travel_time", (self.travel_time <= 0.0) & two_way, "positive seconds")
        self.refuse("direction", self.echoes & ~two_way, "two-way for an echo of the surface")
        middle = float(np.median(self.travel_time))
        if middle > _MAX_TRAVEL_TIME:
            raise LocateError(
                f"{self.source}: the median travel time is {middle:g} s; times must be in seconds;"
                " divide milliseconds by 1000 (or name the column two_way_time_ms)"
            )
        alone = self.partner < 0
        for name in ("transmit_position", "receive_position"):
            self.refuse(
                name, alone & ~np.isfinite(getattr(self, name)).all(axis=1), "finite metres"
            )
        self.refuse("time", ~np.isfinite(self.time), "a number of seconds")
        low, high = MAGNITUDES
        wrong = (self.sigma < low) | (self.sigma > high)
        self.refuse("sigma", wrong, f"{low:g} to {high:g} seconds, or NaN")

    def refuse(self, name: str, wrong: NDArray[np.bool_], allowed: str) -> None:
        """
        Raise an error for the first ping with an invalid value.

        Parameters
        ----------
        name : str
            Field.
        wrong : ndarray of bool, shape (n,)
            True for invalid values.
        allowed : str
            Description of valid values.
        """
        if wrong.any():
            row = int(np.argmax(wrong))
            raise LocateError(
                f"{self.where(row)}: {name} is {getattr(self, name)[row]}; allowed: {allowed}"
            )

    def where(self, row: int) -> str:
        """
        Location of a ping for messages.

        Parameters
        ----------
        row : int
            Index of the ping.

        Returns
        -------
        str
            File with line, or with the index of the ping.
        """
        if self.line[row]:
            return f"{self.source}, line {self.line[row]}"
        return f"{self.source}, ping {row + 1}"

    def __len__(self) -> int:
        """Number of pings."""
        return int(self.travel_time.size)

    @property
    def names(self) -> list[str]:
        """Names of the nodes."""
        return [node.name for node in self.nodes]

    @property
    def between_nodes(self) -> NDArray[np.bool_]:
        """True for pings between two nodes, (n,)."""
        return self.partner >= 0

    @property
    def echoes(self) -> NDArray[np.bool_]:
        """True for times of a node to the sea surface and back, (n,)."""
        return np.asarray(self.partner == self.node)

    def assign(self, **changes: Any) -> Self:
        """
        Copy of the survey with other values of fields.

        Parameters
        ----------
        **changes
            New values by field.

        Returns
        -------
        Survey
        """
        return replace(self, **changes)

    def rows(self, which: NDArray[Any]) -> Self:
        """
        Survey with a part of the pings.

        Parameters
        ----------
        which : ndarray of int or bool
            Pings to keep.

        Returns
        -------
        Survey
        """
        names = (
            "node time travel_time transmit_position receive_position transmit_attitude"
            " receive_attitude direction partner sigma flagged line"
        )
        return self.assign(**{name: getattr(self, name)[which] for name in names.split()})

    def in_frame(self, frame: LocalFrame) -> Self:
        """
        Convert all positions and headings to another frame, with depths below the sea surface.

        Parameters
        ----------
        frame : LocalFrame
            Frame of the result.

        Returns
        -------
        Survey
        """
        old_frame = self.frame
        if old_frame is None:
            raise LocateError(
                f"{self.source}: its positions are not geographic, which an ocean requires; use a"
                " profile instead"
            )
        old_centre = old_frame.latitude_deg, old_frame.longitude_deg
        is_plane = self.depth_reference == "plane"
        if old_centre == (frame.latitude_deg, frame.longitude_deg) and not is_plane:
            return self

        def convert(position: Array) -> Array:
            if is_plane:
                plane = TangentPlane(old_frame)
                return plane.to_frame(position.reshape(-1, 3), frame).reshape(position.shape)
            lat, lon = old_frame.to_geodetic(position[..., 0], position[..., 1])
            north, east = frame.to_local(lat, lon)
            return np.stack([north, east, position[..., 2]], axis=-1)

        middle = old_frame.to_geodetic(0.0, 0.0)
        rotation = np.array([float(frame.convergence(*middle)), 0.0, 0.0])
        nodes = tuple(
            replace(node, position=_coordinates(convert(np.array(node.position))))
            for node in self.nodes
        )
        return self.assign(
            frame=frame,
            depth_reference="surface",
            nodes=nodes,
            transmit_position=convert(self.transmit_position),
            receive_position=convert(self.receive_position),
            transmit_attitude=self.transmit_attitude + rotation,
            receive_attitude=self.receive_attitude + rotation,
        )


def _coordinates(values: Array) -> tuple[float, float, float]:
    north, east, depth = map(float, values)
    return north, east, depth


def check_names(names: list[str], source: object) -> None:
    """Raise an error if two nodes of a source have one name."""
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise LocateError(f"{source}: two nodes have the name {twice}; rename one")
