"""Sections of a configuration about the vehicles and the landmarks."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pymantaray.study.section import Depth, NonNegativeFloat, PositiveFloat, Section, require_unique

VehicleName = Annotated[
    str, Field(pattern=r"^[A-KM-Z]$", description="one capital letter, L is for landmarks")
]
LandmarkName = Annotated[str, Field(pattern=r"^L[0-9]+$", description="L and a number")]


class FloatSection(Section):
    """What all floats share unless a vehicle says otherwise."""

    hold_depth_h: NonNegativeFloat = 24.0
    hold_surface_h: NonNegativeFloat = 1.0
    vertical_speed: PositiveFloat = 0.5
    surface_depth: Depth = 0.5
    depth_gain: PositiveFloat = 0.1
    arrival_tolerance: PositiveFloat = 0.1


class _Placed(Section):
    """A vehicle's name and starting place in the local frame."""

    name: VehicleName
    north: float
    east: float
    heading_deg: float = 0.0


class FloatVehicle(_Placed):
    """Argo-style float: sink, hold, rise, hold at the surface; drifts with the current."""

    kind: Literal["float"]
    target_depth: Depth
    start_delay_h: NonNegativeFloat = 0.0
    hold_depth_h: NonNegativeFloat | None = None
    hold_surface_h: NonNegativeFloat | None = None
    vertical_speed: PositiveFloat | None = None
    surface_depth: Depth | None = None
    depth_gain: PositiveFloat | None = None
    arrival_tolerance: PositiveFloat | None = None


class StationVehicle(_Placed):
    """Station-keeping vehicle: stays where it is put."""

    kind: Literal["station"]
    depth: Depth = 0.5


class TwistVehicle(_Placed):
    """Vehicle under one constant body twist, angular velocity first. [rad/s, m/s]."""

    kind: Literal["twist"]
    depth: Depth
    twist: tuple[float, float, float, float, float, float] = Field(strict=False)


class WaypointVehicle(_Placed):
    """Vehicle that follows points (north, east, depth) at limited speed and turn rate."""

    kind: Literal["waypoints"]
    depth: Depth
    points: tuple[Annotated[tuple[float, float, Depth], Field(strict=False)], ...] = Field(
        min_length=1, strict=False
    )
    speed: PositiveFloat
    turn_rate_deg: PositiveFloat = 5.0
    capture_radius: PositiveFloat = 20.0
    loop: bool = False


AnyVehicle = Annotated[
    FloatVehicle | StationVehicle | TwistVehicle | WaypointVehicle, Field(discriminator="kind")
]


class FleetSection(Section):
    """The vehicles, and what the floats among them share."""

    floats: FloatSection = FloatSection()
    vehicles: tuple[AnyVehicle, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        require_unique("vehicle names", [v.name for v in self.vehicles])
        return self


class LandmarkSection(Section):
    """Fixed point whose surveyed place is known; takes part in ranging."""

    name: LandmarkName
    north: float
    east: float
    depth: Depth
