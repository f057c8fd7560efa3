"""
Water in metres: environment.json of the paper's authors, NetCDF files and data sets in memory.
"""

import json
import os

import numpy as np
import pytest
import xarray as xr
from authors_files import FLOOR, X, Y, Z, arrays, currents, sound_speed, write_environment
from refusals import refused

from pymantaray import find_eigenrays, load_study, open_water
from pymantaray.acoustics import Medium
from pymantaray.apps.atlas import Atlas
from pymantaray.apps.ranges import measure
from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.config.door.study import build_study
from pymantaray.errors import MantaRayError, OceanError
from pymantaray.fleet import Drifting, Vehicle, simulate
from pymantaray.ocean.environment import environment_arrays, read_environment
from pymantaray.records import Trajectories

PLACE = np.array([[1200.0, -3300.0, 120.0], [-900.0, 5000.0, 1700.0]])  # north, east, depth


def dataset():
    """The same water as a data set."""
    at = np.meshgrid(Y, X, Z, indexing="ij")
    east, north = currents(at[1], at[0], at[2])
    dims = "north", "east", "depth"
    fields = {
        "sound_speed": sound_speed(at[1], at[0], at[2]),
        "current_north": north,
        "current_east": east,
    }
    floor = {"sea_floor_depth": (dims[:2], np.full((Y.size, X.size), FLOOR))}
    return xr.Dataset(
        {k: (dims, v) for k, v in fields.items()} | floor, dict(zip(dims, (Y, X, Z), strict=True))
    )


def test_x_is_east_y_is_north_and_z_is_depth(tmp_path, as_stored):
    water = open_water(write_environment(tmp_path), interpolation="linear", currents="carry")
    expected = sound_speed(PLACE[:, 1], PLACE[:, 0], PLACE[:, 2])
    np.testing.assert_allclose(water.medium.sound_speed_at(PLACE), expected, rtol=1e-12)
    east, north = currents(PLACE[:, 1], PLACE[:, 0], PLACE[:, 2])
    np.testing.assert_allclose(
        water.currents.at(PLACE)[:, :2], np.stack([north, east], axis=1), rtol=1e-12
    )
    assert water.medium.bottom_depth([[0.0, 0.0]])[0] == FLOOR
    assert water.frame is None
    as_stored(water)


def test_a_file_and_a_data_set_are_the_same_water(tmp_path):
    dataset().to_netcdf(tmp_path / "local.nc")
    waters = [
        open_water(s) for s in (write_environment(tmp_path), dataset(), tmp_path / "local.nc")
    ]
    for water in waters[1:]:
        np.testing.assert_array_equal(water.medium.field, waters[0].medium.field)


def test_names_are_found_beside_the_file_and_above_it(tmp_path):
    inner = tmp_path / "program" / "sim_config"
    inner.mkdir(parents=True)
    write_environment(tmp_path / "program", source_dir="../../data").rename(
        inner / "environment.json"
    )
    assert open_water(inner / "environment.json").medium.north.size == Y.size


def test_currents_on_their_own_axes_stay_trilinear(tmp_path, as_stored):
    sections = arrays()
    own = {
        "x": np.array([-9e3, -500.0, 9e3]),
        "y": np.array([-8e3, 700.0, 8e3]),
        "z": np.array([0.0, 2000.0]),
    }
    u, v = currents(*np.meshgrid(*own.values(), indexing="ij"))
    sections["current"] = {**own, "u": u, "v": v}
    local = open_water(write_environment(tmp_path, sections), interpolation="linear").local
    east, north = currents(*np.meshgrid(local.east, local.north, local.depth, indexing="ij"))
    np.testing.assert_allclose(
        local.current_east.transpose("east", "north", "depth"), east, atol=1e-12
    )
    np.testing.assert_allclose(
        local.current_north.transpose("east", "north", "depth"), north, atol=1e-12
    )
    as_stored(local)


def test_missing_values_are_below_the_sea_floor_or_on_land(tmp_path, as_stored):
    data = dataset().drop_vars("sea_floor_depth")
    data["sound_speed"][0, 0, 3:] = np.nan  # from 1000 m on
    data["sound_speed"][3, 4] = np.nan  # land
    local = open_water(data).local
    assert local.sea_floor_depth[0, 0] == 600.0  # between the levels at 200 and 1000 m
    assert local.sea_floor_depth[3, 4] == 0.0
    assert local.sea_floor_depth[1, 1] == 2000.0  # the last level
    assert np.isfinite(local.sound_speed).all()
    gap = dataset()
    gap["sound_speed"][1, 2, 1] = np.nan
    refused(
        OceanError, "sound_speed is missing above a value at north -1000, east 0", open_water, gap
    )
    as_stored(local)


def test_rays_take_the_time_of_a_uniform_gradient(tmp_path):
    """
    Travel time between two depths in a constant gradient g: arcosh(1 + g^2 d^2 / (2 c1 c2)) / g.
    """
    sections = arrays()
    at = np.meshgrid(X, Y, Z, indexing="ij")
    sections["ssp"]["data"] = 1450.0 + 0.016 * at[2]
    water = open_water(write_environment(tmp_path, sections), interpolation="linear")
    a, b = np.array([[0.0, 0.0, 300.0]]), np.array([[4000.0, 0.0, 700.0]])
    found = find_eigenrays(water.medium, a, b).first().travel_time[0]
    c = 1450.0 + 0.016 * np.array([300.0, 700.0])
    square = (4000.0**2 + 400.0**2) * 0.016**2
    assert found == pytest.approx(np.arccosh(1.0 + square / (2.0 * c[0] * c[1])) / 0.016, abs=1e-8)


def test_options_of_water_in_metres(tmp_path, as_stored):
    path = write_environment(tmp_path)
    water = open_water(
        path, bathymetry=1500.0, ice=2.0, half_extent=(2e3, 3e3), centre=(75.0, -140.0)
    )
    assert water.medium.bottom_depth([[0.0, 0.0]])[0] == 1500.0
    assert water.medium.surface.depth.max() == 2.0
    np.testing.assert_array_equal(water.medium.north, [-8e3, -1e3, 3e3])
    assert water.frame.latitude_deg == 75.0
    refused(OceanError, "half_extent is 9500 m, but north of", open_water, path, half_extent=9500.0)
    refused(OceanError, "ocean.thin does not apply to water in metres", open_water, path, thin=0.1)
    refused(OceanError, "ocean.bathymetry is a file", open_water, path, bathymetry=str(path))
    refused(MantaRayError, "no latitude", Atlas, path)
    as_stored(water)


def test_a_study_runs_in_water_in_metres(tmp_path, as_stored):
    path = write_environment(tmp_path)
    vehicles = [
        {"name": "A", "kind": "station", "north": 0.0, "east": 0.0, "depth": 50.0},
        {"name": "B", "kind": "station", "north": 3000.0, "east": 0.0, "depth": 500.0},
    ]
    keys = {
        "fleet": {"vehicles": vehicles},
        "mission.duration_h": 4.0,
        "acoustics.interpolation": "linear",
    }
    for source in (path, dataset()):
        config = load_study("quick", ocean=source, **keys)
        mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
        c = sound_speed(0.0, 0.0, 50.0)
        assert mission.measurements.transmitter_sound_speed[0] == pytest.approx(c, abs=1e-9)
    assert (
        str(tmp_path / "data" / "ssp" / "data.npy") in load_study("quick", ocean=path, **keys).files
    )
    as_stored(mission)
    as_stored(mission.ocean.region, name="region")
    as_stored(mission.ocean.profile, name="profile")


def test_ranges_between_existing_trajectories_in_water_in_metres(tmp_path, as_stored):
    still = np.array([[0.0, 0.0, 50.0], [3000.0, 0.0, 500.0]])[:, None].repeat(3, axis=1)
    truth = Trajectories(
        name=np.array(["A", "B"]),
        role=np.array(["track", "track"]),
        time=np.array([0.0, 600.0, 1200.0]),
        position=still,
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (2, 3, 1)),
        status=np.zeros((2, 3), dtype=np.int8),
    )
    run = measure(truth, write_environment(tmp_path), 600.0, interpolation="linear")
    speeds = run.measurements.transmitter_sound_speed
    np.testing.assert_allclose(
        speeds[:2], sound_speed(0.0, np.array([0.0, 3e3]), np.array([50.0, 500.0]))
    )
    as_stored(run.measurements)


def test_currents_are_required_by_a_study_and_optional_for_rays():
    still = dataset().drop_vars(["current_north", "current_east"])
    assert not open_water(still).local.current_east.any()
    refused(OceanError, "no current_north and current_east", open_water, still, currents="required")
    refused(
        OceanError,
        "no current_north; add it",
        open_water,
        still.assign(current_east=still.sound_speed),
    )


def test_vehicles_drift_in_currents_on_unequal_steps():
    """A current linear in the position, u = a + b x, gives x(t) = (x0 + a / b) exp(b t) - a / b."""
    local = open_water(dataset()).local
    vehicle = Vehicle("A", np.array([0.0, 1700.0, 50.0]), Drifting(depth=50.0))
    path = simulate(
        [vehicle], local, duration=57_600.0, physics_step=10.0, sampling_period=3600.0
    ).position[0]
    a, b = currents(0.0, 0.0, 50.0)[0], 1e-6
    expected = (1700.0 + a / b) * np.exp(b * np.arange(17) * 3600.0) - a / b
    np.testing.assert_allclose(path[:, 1], expected, rtol=0, atol=1e-3)


BAD = {
    "`ssp.q`: unknown key": lambda t: t["ssp"].update(q="a.npy"),
    "`currents`: unknown key. Did you mean `current`": lambda t: t.update(
        currents=t.pop("current")
    ),
    "current.v: missing; add it": lambda t: t["current"].pop("v"),
    "ssp: missing; add it": lambda t: t.pop("ssp"),
    "source_dir: no folder": lambda t: t.update(source_dir="no-such-folder"),
    "ssp.data: .*none.npy: no such file": lambda t: t["ssp"].update(data="none.npy"),
    "ssp.x: found 3; it must be a file name": lambda t: t["ssp"].update(x=3),
}


@pytest.mark.parametrize("line", BAD)
def test_wrong_files_are_refused_in_one_line(line, tmp_path):
    path = write_environment(tmp_path)
    tree = json.loads(path.read_text())
    BAD[line](tree)
    path.write_text(json.dumps(tree))
    refused(OceanError, line, open_water, path)


WRONG = {
    "float32; the program reads float64 only": lambda a: a.astype(np.float32),
    "ssp.data has 99 values; its axes x, y, z need 5 x 4 x 5": lambda a: a.ravel()[:-1],
    "Fortran order": lambda a: np.asfortranarray(a),
    "object; the program reads float64 only": lambda _: np.array([object()]),
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_arrays_are_refused_in_one_line(line, tmp_path):
    path = write_environment(tmp_path)
    np.save(
        tmp_path / "data" / "ssp" / "data.npy",
        WRONG[line](arrays()["ssp"]["data"]),
        allow_pickle=True,
    )
    refused(OceanError, line, open_water, path)


def test_arrays_are_regular_files_as_long_as_their_headers_say(tmp_path):
    path = write_environment(tmp_path)
    data = tmp_path / "data" / "ssp" / "data.npy"
    content = data.read_bytes()
    os.mkfifo(tmp_path / "pipe")
    for target in ("/dev/zero", tmp_path / "pipe", tmp_path):
        data.unlink()
        data.symlink_to(target)
        refused(
            OceanError, r"ssp.data: .*data.npy: (not a regular file|is a folder)", open_water, path
        )
    data.unlink()
    for damaged in (
        content[:-8],
        content.replace(b"(100,)", b"(100000000000,)"),
        content[:20],
        b"\x93NUMPY\x09\x00",
    ):
        data.write_bytes(damaged)
        refused(
            OceanError,
            r"ssp.data: .*data.npy: (.* bytes of values|not a .npy file)",
            open_water,
            path,
        )
    for name in ("/dev/zero", str(tmp_path / "pipe"), "n" * 5000, "a\0b"):
        path = write_environment(tmp_path, source_dir=name)
        refused(OceanError, "source_dir: no folder", open_water, path)
    refused(OceanError, "not a regular file", read_environment, tmp_path / "pipe")


def test_wrong_data_sets_are_refused_in_one_line():
    kilometres = dataset()
    kilometres["north"].attrs["units"] = "km"
    refused(OceanError, "north is in 'km'; it must be in m", open_water, kilometres)
    two = dataset().expand_dims(time=2)
    refused(OceanError, "select one of time: isel", open_water, two)
    refused(OceanError, "depth begins at -5 m", open_water, dataset().assign_coords(depth=Z - 5.0))
    refused(OceanError, "no coordinate depth", open_water, dataset().isel(depth=0))
    double = dataset().assign_coords(east=[0.0, 0.0, 1.0, 2.0, 3.0])
    refused(OceanError, "east: values do not increase after 0", open_water, double)


def test_a_medium_needs_no_sea_floor_in_the_data_set():
    medium = Medium.from_dataset(dataset().drop_vars("sea_floor_depth"))
    assert medium.bottom_depth([[0.0, 0.0]])[0] == 2000.0


def test_exported_levels_reach_below_the_sea_floor(as_stored):
    local = open_water(dataset(), bathymetry=2000.0).local
    arrays_out = environment_arrays(local)
    assert arrays_out["ssp"]["z"].tolist() == [*Z.tolist(), 2010.0]
    np.testing.assert_array_equal(
        arrays_out["ssp"]["data"][..., -1], arrays_out["ssp"]["data"][..., -2]
    )
    assert arrays_out["current"]["u"].shape == arrays_out["ssp"]["data"].shape
    assert environment_arrays(open_water(dataset()).local)["ssp"]["z"].tolist() == Z.tolist()
    as_stored(arrays_out)
