"""
Grid points that several local grids share: the same numbers as alone, each conversion once, bad
oceans refused at the door.
"""

import numpy as np
import pytest
from refusals import refused

from pymantaray.acoustics import Medium
from pymantaray.errors import OceanError
from pymantaray.ocean import grid_points, sound_speed, to_local
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.ocean.local import LocalGrid, local_grid
from pymantaray.ocean.window import Window

HALF = 15e3, 15e3
PARTS = [(slice(0, 24), slice(0, 30)), (slice(6, 30), slice(4, 40)), (slice(2, 28), slice(8, 40))]


@pytest.fixture
def coast(fram_strait):
    """Part of the Fram Strait with an island."""
    part = fram_strait.isel(lat=slice(20, 50), lon=slice(60, 100)).copy(deep=True)
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        part[name][:, 8:12, 10:15] = np.nan
    return part


def places(ocean, rows, columns):
    part = ocean.isel(lat=rows, lon=columns)
    return part, (float(part["lat"].mean()), float(part["lon"].mean()))


def floor_of(ocean, depth):
    return (0.0 * ocean["water_temp"].isel(depth=0, drop=True).fillna(0.0) + depth).rename(
        "sea_floor_depth"
    )


@pytest.mark.parametrize("equation", ["teos-10", "unesco"])
@pytest.mark.parametrize("deepest", [None, 7_000.0], ids=["own floor", "a deeper floor"])
def test_parts_of_an_ocean_are_those_of_an_ocean_of_that_size(coast, equation, deepest):
    points = GridPoints.of(coast, equation)
    floor = None if deepest is None else floor_of(coast, deepest)
    for rows, columns in PARTS:
        ocean, centre = places(coast, rows, columns)
        own = points.part(rows, columns)
        shared = LocalGrid.of(own, Window.on(own.lat, own.lon, centre), HALF, floor)
        alone = to_local(ocean, centre, HALF, equation=equation, sea_floor=floor)
        assert shared.to_dataset().identical(alone)


def test_sound_speed_of_a_column_of_water_is_computed_once(coast, monkeypatch):
    converted = []

    def counted(T, *arguments, **options):
        converted.append(np.shape(T)[1:])
        return sound_speed(T, *arguments, **options)

    monkeypatch.setattr(grid_points, "sound_speed", counted)
    points = GridPoints.of(coast.isel(lat=slice(0, 6)))  # without the island
    for first in range(5):
        points.part(slice(0, 6), slice(first, first + 8)).sound_speed(np.empty(0))
    assert converted == [(6, 8), *4 * [(6, 1)]]


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_a_medium_of_a_local_grid_is_that_of_its_data_set(coast, interpolation):
    options = {"interpolation": interpolation, "earth": "sphere"}
    for floor in (None, floor_of(coast, 7_000.0)):
        local = to_local(coast, None, HALF, sea_floor=floor)
        of_data = Medium.from_dataset(local, **options)
        of_grid = Medium.from_local_grid(local_grid(coast, None, HALF, sea_floor=floor), **options)
        np.testing.assert_array_equal(of_grid.field, of_data.field)
        np.testing.assert_array_equal(of_grid.bed.depth, of_data.bed.depth)
        np.testing.assert_array_equal(of_grid.bed.north, of_data.bed.north)
        assert of_grid.earth == of_data.earth
        assert repr(of_grid) == repr(of_data)


def test_bad_oceans_are_refused_before_any_conversion(coast):
    warm = coast.copy(deep=True)
    warm["water_temp"][3, 1, 2] = 60.0
    refused(OceanError, "allowed -5 to 45 degC", GridPoints.of, warm)
    refused(OceanError, "salinity", GridPoints.of, coast.drop_vars("salinity"))
    refused(OceanError, "'guess' is unknown", GridPoints.of, coast, "guess")
    land = coast.where(False)
    refused(OceanError, "no valid value", GridPoints.of, land.assign_attrs(coast.attrs))
