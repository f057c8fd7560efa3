"""A small ocean with a known current, and short ways to run vehicles in it."""

import numpy as np
import pytest
import xarray as xr

from pymantaray.fleet import FloatCycle, Vehicle, simulate

BOX = 5000.0  # m; half the side of the domain
FLOOR = 1000.0  # m


def build_ocean(*, uniform=(0.0, 0.0), rotation=0.0, shear=0.0, slope=0.0):
    """
    Current: uniform + solid-body rotation about the origin + a north component linear in depth.

    The sea floor is at FLOOR, rising by `slope` to the north of the origin. All are reproduced
    exactly by trilinear interpolation.
    """
    north, east = np.linspace(-BOX, BOX, 11), np.linspace(-BOX, BOX, 9)
    depth = np.array([0.0, 10.0, 30.0, 100.0, 250.0, 600.0, 1200.0])
    n, e, z = np.meshgrid(north, east, depth, indexing="ij")
    dims = ("north", "east", "depth")
    return xr.Dataset(
        {
            "current_north": (dims, uniform[0] - rotation * e + shear * z),
            "current_east": (dims, uniform[1] + rotation * n),
            "sea_floor_depth": (dims[:2], FLOOR - slope * np.maximum(n[..., 0], 0.0)),
        },
        coords={"north": north, "east": east, "depth": depth},
    )


@pytest.fixture(scope="session")
def make_ocean():
    return build_ocean


@pytest.fixture(scope="session")
def make_float():
    def make(name="B", north=0.0, east=0.0, depth=0.5, heading=0.0, **cycle):
        parameters = {"target_depth": 100.0, "surface_depth": 0.5} | cycle
        parameters = {"hold_depth_time": 600.0, "hold_surface_time": 300.0} | parameters
        return Vehicle(name, (north, east, depth), FloatCycle(**parameters), heading)

    return make


@pytest.fixture(scope="session")
def run():
    def simulate_fleet(
        *vehicles, water=None, duration=4000.0, physics_step=0.5, sampling_period=50.0
    ):
        return simulate(
            vehicles,
            build_ocean() if water is None else water,
            duration=duration,
            physics_step=physics_step,
            sampling_period=sampling_period,
        )

    return simulate_fleet
