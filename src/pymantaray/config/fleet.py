"""
Sections of a configuration for vehicles and landmarks.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pymantaray.config.common import (
    Degrees,
    DegreesPerSecond,
    Depth,
    Hours,
    InputFiles,
    Metres,
    MetresPerSecond,
    NonNegativeFloat,
    ParticipantName,
    PositiveFloat,
    RadiansPerSecond,
    Section,
    require_unique,
)


class FloatSection(Section):
    """Defaults of all floats; a vehicle may have its own values."""

    hold_depth_h: Hours[NonNegativeFloat] = 24.0
    """Time at the target depth. [h]"""
    hold_surface_h: Hours[NonNegativeFloat] = 1.0
    """Time at the surface. [h]"""
    vertical_speed: MetresPerSecond[PositiveFloat] = 0.5
    """Limit of the vertical speed, up and down. [m/s]"""
    surface_depth: Depth = 0.01
    """Depth of the hold at the surface. Not in the paper, record 0001. [m]"""
    depth_gain: PositiveFloat = 10.0
    """Commanded vertical speed per metre of depth error. Not in the paper, record 0001. [1/s]"""


class _Placed(Section):
    """
    Name of a vehicle and its initial position in the local frame; a file may have ``lat`` and
    ``lon``, see `with_local_places`.
    """

    name: ParticipantName
    """Unique; letters, digits, _ and -, 64 at most."""
    north: Metres[float]
    """North of the frame's centre, at the start; or ``lat``, in degrees. [m]"""
    east: Metres[float]
    """East of the frame's centre, at the start; or ``lon``, in degrees. [m]"""
    heading_deg: Degrees[float] = 0.0
    """Heading at the start, clockwise from north. [degrees]"""


class FloatVehicle(_Placed):
    """Argo-style float: sink, hold, rise, hold at the surface; drifts with the current."""

    kind: Literal["float"]
    """An Argo-style float."""
    target_depth: Depth
    """Depth of the lower hold; it must exceed the surface depth. [m]"""
    depth: Depth | None = None
    """Depth at the start, until its first descent. Default: the surface depth. [m]"""
    start_delay_h: Hours[NonNegativeFloat] = 0.0
    """Time of its first descent. [h]"""
    hold_depth_h: Hours[NonNegativeFloat] | None = None
    """Value of this float instead of that of ``[fleet.floats]``. [h]"""
    hold_surface_h: Hours[NonNegativeFloat] | None = None
    """Value of this float instead of that of ``[fleet.floats]``. [h]"""
    vertical_speed: MetresPerSecond[PositiveFloat] | None = None
    """Value of this float instead of that of ``[fleet.floats]``. [m/s]"""
    surface_depth: Depth | None = None
    """Value of this float instead of that of ``[fleet.floats]``. [m]"""
    depth_gain: PositiveFloat | None = None
    """Value of this float instead of that of ``[fleet.floats]``. [1/s]"""


class StationVehicle(_Placed):
    """Vehicle that keeps its initial position."""

    kind: Literal["station"]
    """A vehicle that keeps its position."""
    depth: Depth = 0.01
    """Depth that it keeps; below ``mission.gnss_depth`` it has no GNSS fixes. [m]"""


class DriftingVehicle(_Placed):
    """Buoy that drifts with the current at its depth, or at that of its drogue."""

    kind: Literal["drifting"]
    """A buoy."""
    depth: Depth = 0.01
    """Depth that it keeps; below ``mission.gnss_depth`` it has no GNSS fixes. [m]"""
    drogue_depth: Depth | None = None
    """Depth of the current that moves it. Default: its own depth. [m]"""


class TwistVehicle(_Placed):
    """
    Vehicle with a constant body twist over ground, or with ``current`` relative to the moving
    water.
    """

    kind: Literal["twist"]
    """A vehicle with a constant twist."""
    depth: Depth
    """Depth at the start. [m]"""
    twist: tuple[
        RadiansPerSecond[float],
        RadiansPerSecond[float],
        RadiansPerSecond[float],
        MetresPerSecond[float],
        MetresPerSecond[float],
        MetresPerSecond[float],
    ] = Field(strict=False)
    """Angular velocity about, and velocity along, forward, right and down. [rad/s, m/s]"""
    current: bool = False
    """True if the current moves the vehicle in addition."""


class WaypointVehicle(_Placed):
    """Vehicle that steers to waypoints with constant speed and a limited turn rate."""

    kind: Literal["waypoints"]
    """A vehicle that steers to waypoints."""
    depth: Depth
    """Depth at the start. [m]"""
    points: tuple[
        Annotated[tuple[Metres[float], Metres[float], Depth], Field(strict=False)], ...
    ] = Field(min_length=1, strict=False)
    """
    North, east and depth of each waypoint; latitude, longitude and depth if the vehicle has ``lat``
    and ``lon``. [m]
    """
    speed: MetresPerSecond[PositiveFloat]
    """Speed over ground, or with ``current`` through the water. [m/s]"""
    turn_rate_deg: DegreesPerSecond[PositiveFloat] = 5.0
    """Limit of the angular speed. [degrees/s]"""
    capture_radius: Metres[PositiveFloat] = 20.0
    """Distance at which a waypoint is reached; at least the turning radius. [m]"""
    loop: bool = False
    """True if the vehicle continues from the last waypoint to the first; otherwise it stops."""
    current: bool = False
    """True if the current moves the vehicle."""


AnyVehicle = Annotated[
    FloatVehicle | StationVehicle | DriftingVehicle | TwistVehicle | WaypointVehicle,
    Field(discriminator="kind"),
]


class FleetSection(Section):
    """Vehicles with defaults of all floats, or files with existing trajectories."""

    floats: FloatSection = FloatSection()
    """Defaults of all floats."""
    vehicles: tuple[AnyVehicle, ...] = Field(default=(), strict=False)
    """Each with its ``kind``; a table ``[[fleet.vehicles]]`` for each."""
    trajectories: InputFiles = ()
    """Files with existing trajectories, instead of ``vehicles``; relative to this file."""
    enu: bool = False
    """
    True if TUM, EuRoC and KITTI files use ROS's axes: world east, north, up; body forward, left,
    up.
    """
    names: tuple[str, ...] = Field(default=(), strict=False)
    """Vehicles of the files to use, such as one of two topics of a robot in a bag. Default: all."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        require_unique("vehicle names", [v.name for v in self.vehicles])
        if bool(self.vehicles) == bool(self.trajectories):
            there = (
                "both are given; leave one out"
                if self.vehicles
                else "give [[fleet.vehicles]], or files"
            )
            raise ValueError(f"vehicles or trajectories make a fleet; {there}")
        return self


class LandmarkSection(Section):
    """Fixed point with a surveyed position; takes part in ranging."""

    name: ParticipantName
    """Unique; letters, digits, _ and -, 64 at most."""
    north: Metres[float]
    """North of the frame's centre; or ``lat``, in degrees. [m]"""
    east: Metres[float]
    """East of the frame's centre; or ``lon``, in degrees. [m]"""
    depth: Depth
    """Positive down. [m]"""
    sigma: Metres[PositiveFloat] | None = None
    """
    Standard deviation of each axis of the survey; large if the fleet has to locate the landmark.
    Default: ``noise.landmark_sigma``. [m]
    """
