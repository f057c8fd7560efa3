"""
An ocean that varies in time, from the configuration to the run folder; and a sea floor from a file.
"""

import datetime as dt
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from factories import assert_same

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.ocean_fields import (
    OceanFields,
    build_currents,
    build_medium,
    medium_around,
)
from pymantaray.apps.study import open_run, run_study
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.page import PageLinks, mission_rays
from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.config.door.fleet import build_vehicles
from pymantaray.config.door.ocean import mission_start
from pymantaray.errors import OceanError, StudyError
from pymantaray.estimation import solve_conditions
from pymantaray.fleet import simulate
from pymantaray.jobs.keys import sha256
from pymantaray.ocean import open_ocean, to_local
from pymantaray.ocean.synthetic import EPOCH
from pymantaray.ocean.varying import VARYING, series_of, snapshot_at
from pymantaray.records import write_netcdf

WINDOW = (74.2, 74.8, -141.2, -138.8)
HOUR = 3600.0


ONE = {"realizations": 1}
CONDITIONS = ["odometry", "refracted"]


def local(speed, current=0.0, depth=(0.0, 50.0, 400.0)):
    """A small local ocean of one sound speed."""
    axes = {
        "north": np.linspace(-1e3, 1e3, 5),
        "east": np.linspace(-1e3, 1e3, 4),
        "depth": np.array(depth),
    }
    shape = tuple(axis.size for axis in axes.values())
    fields = {"sound_speed": speed, "current_north": current, "current_east": -current}
    return xr.Dataset(
        {
            name: (tuple(axes), np.full(shape, value), {"units": "m s-1"})
            for name, value in fields.items()
        }
        | {"sea_floor_depth": (("north", "east"), np.full(shape[:2], 300.0))},
        coords=axes,
        attrs={"time": "2014-07-15T12:00:00", "title": "small"},
    )


@pytest.mark.parametrize("zone", [None, 2, -7])
def test_a_mission_starts_at_its_time_in_utc_for_any_time_zone(tiny, zone):
    time = dt.datetime(2014, 7, 15, 12, tzinfo=dt.UTC)
    time = (
        time.replace(tzinfo=None)
        if zone is None
        else time.astimezone(dt.timezone(dt.timedelta(hours=zone)))
    )
    assert mission_start(tiny(ocean={"time": time}).ocean) == np.datetime64("2014-07-15T12:00:00")


def test_the_ocean_is_linear_in_time_between_snapshots():
    snapshots = [local(1450.0, 0.1), local(1460.1, 0.3), local(1440.7, -0.7)]
    series = series_of(iter(snapshots), np.array([-600.0, 3000.0, 9000.0]))
    for time, snapshot in zip((-600.0, 3000.0, 9000.0), snapshots, strict=True):
        assert snapshot_at(series, time).identical(snapshot)
    for time in (-599.0, 0.0, 2999.0, 4000.0, 8999.9):
        now = snapshot_at(series, time)
        for name, values in (
            ("sound_speed", (1450.0, 1460.1, 1440.7)),
            ("current_east", (-0.1, -0.3, 0.7)),
        ):
            expected = np.interp(time, [-600.0, 3000.0, 9000.0], values)
            np.testing.assert_allclose(now[name], expected, rtol=1e-13)
        assert now.attrs == snapshots[0].attrs
        assert set(now.coords) == {"north", "east", "depth"}
    for time in (-601.0, 9000.1):
        with pytest.raises(StudyError, match="it covers -600 to 9000 s"):
            snapshot_at(series, time)


def test_snapshots_on_other_grids_are_refused():
    with pytest.raises(StudyError, match=r"local grids at .*2014-07-15T12:00:00.* differ"):
        series_of([local(1450.0), local(1450.0, depth=(0.0, 60.0, 400.0))], np.array([0.0, 1.0]))


def test_checksum_of_a_folder_tells_of_every_file_and_its_name(tmp_path):
    def store(folder, **files):
        for name, content in files.items():
            path = folder / name.replace("_", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return sha256(folder)

    one = store(tmp_path / "1", meta=b"x", c_0=b"ab", c_1=b"c")
    assert store(tmp_path / "2", c_1=b"c", c_0=b"ab", meta=b"x") == one
    others = [
        store(tmp_path / "3", meta=b"x", c_0=b"a", c_1=b"bc"),
        store(tmp_path / "4", meta=b"x", c_0=b"ab", c_2=b"c"),
        store(tmp_path / "5", meta=b"x", c_0=b"ab"),
    ]
    assert len({one, *others}) == 4


def written(folder, times):
    """Files of the same water, a part of the synthetic Beaufort Sea, one for each time."""
    ocean, files = open_ocean("synthetic:beaufort", window=WINDOW), []
    for time in times:
        files.append(folder / f"{np.datetime_as_string(time, unit='h')}.nc")
        write_netcdf(ocean.assign_coords(time=((), time, ocean["time"].attrs)), files[-1])
    return [str(file) for file in files]


def hours(*after):
    return [np.datetime64(EPOCH, "ns") + np.timedelta64(h, "h") for h in after]


def test_equal_snapshots_are_the_study_in_still_water(run_tiny, tmp_path):
    """
    Files of the same water at 12, 15 and 18 h: truth, rays and measurements to the last digit.
    """
    files = written(tmp_path, hours(0, 3, 6))
    still, varying = (
        run_tiny(study=ONE, conditions=CONDITIONS, acoustics={"currents": True}, ocean=ocean)
        for ocean in ({"source": files[:1]}, {"source": files, "time_varying": True})
    )
    for name in ("truth", "links", "arrivals", "measurements", "estimates"):
        assert_same(getattr(varying, name), getattr(still, name))
    assert varying.ocean.identical(still.ocean)
    assert varying.ray_picture.identical(still.ray_picture)
    assert varying.profile.identical(still.profile)
    assert set(varying.manifest["ocean"]["sha256"]) == set(files)
    assert varying.manifest["ocean"]["time_varying"]
    assert not still.manifest["ocean"]["time_varying"]
    again = open_run(varying.path)
    assert again.config == varying.config
    assert again.config.ocean.time_varying
    assert_same(again.noisy_measurements(0), still.noisy_measurements(0))


def test_files_that_end_before_the_mission_are_refused(tiny, tmp_path):
    config = tiny(ocean={"source": written(tmp_path, hours(0, 3)), "time_varying": True})
    with pytest.raises(OceanError, match=r"does not cover 2014-07-15T00:00 to 2014-07-15T04:00"):
        run_study(config, tmp_path / "run", workers=1)
    assert not (tmp_path / "run").exists()


MOVING = {
    "time_varying": True,
    "time": dt.datetime(2014, 7, 15, 13, 30),  # noqa: DTZ001  TOML's local time, taken as UTC
    "centre_lat": 74.8,
    "centre_lon": -136.95,
}
"""
Near the centre of a Pacific Winter Water eddy that moves 4 km a day to the south, from between two
snapshots on.
"""


@pytest.fixture(scope="module")
def moving_run(fly_tiny):
    """Four hours, which pass a snapshot."""
    return fly_tiny(ocean=MOVING, acoustics={"currents": True})


@pytest.fixture(scope="module")
def moving(moving_run):
    return moving_run[0]


@pytest.fixture(scope="module")
def moving_config(moving_run):
    return moving_run[1].config


@pytest.mark.slow
def test_the_series_encloses_the_mission_and_is_the_sources_own_water(moving_config, moving):
    section, ocean = moving_config.ocean, moving.ocean
    np.testing.assert_array_equal(ocean.series["time"], [-1.5 * HOUR, 1.5 * HOUR, 4.5 * HOUR])
    own = to_local(
        open_ocean("synthetic:beaufort", time="2014-07-15T18:00"),
        section.centre,
        section.half_extent,
    )
    for name in VARYING:
        np.testing.assert_array_equal(ocean.local_at(4.5 * HOUR)[name], own[name])
    assert ocean.local.attrs["time"] == "2014-07-15T12:00:00"
    medium, currents = (
        build_medium(ocean, moving_config.acoustics.interpolation),
        build_currents(ocean),
    )
    middle = 0.5 * (ocean.series["sound_speed"][0] + ocean.series["sound_speed"][1])
    np.testing.assert_allclose(medium(0.0).sound_speed, middle, rtol=1e-14)
    middle = 0.5 * (ocean.series["current_east"][1] + ocean.series["current_east"][2])
    np.testing.assert_allclose(currents(3.0 * HOUR).velocity[..., 1], middle, rtol=0, atol=1e-15)


def test_each_ping_of_a_study_is_ranged_in_the_water_of_its_time(moving_config, moving, as_stored):
    truth, links, found = moving.truth, moving.links, moving.arrivals.first()
    marks, medium = (
        moving.measurements.landmark_position,
        build_medium(moving.ocean, moving_config.acoustics.interpolation),
    )
    assert set(truth.time[links.sample]) == {HOUR, 2 * HOUR, 3 * HOUR, 4 * HOUR}
    changed = []
    for sample in set(links.sample):
        now, places = links.sample == sample, np.concatenate([truth.position[:, sample], marks])
        ends = places[links.first[now]], places[links.second[now]]
        own, early = (find_eigenrays(medium(t), *ends).first() for t in (truth.time[sample], 0.0))
        np.testing.assert_allclose(found.travel_time[now], own.travel_time, rtol=0, atol=1e-10)
        np.testing.assert_allclose(
            found.chord_travel_time[now], own.chord_travel_time, rtol=0, atol=1e-10
        )
        changed.append(np.nanmax(np.abs(own.travel_time - early.travel_time)))
    assert max(changed) > 1e-6  # s
    assert moving.picture["ray_arrives"].sum() > 0
    found = {"first": moving.arrivals.first(), "truth": moving.ranging_truth}
    as_stored(found | {"picture": moving.picture, "fleet": moving.truth.position})


def test_a_fleet_in_varying_water_ends_at_other_positions(moving_config, moving):
    m = moving_config.mission
    still = simulate(
        build_vehicles(moving_config.fleet),
        moving.ocean.local,
        duration=4.0 * HOUR,
        physics_step=m.physics_step_s,
        sampling_period=m.sampling_period_s,
    )
    floating = moving.truth.role == "float"
    away = np.linalg.norm(moving.truth.position - still.position, axis=-1).max(axis=-1)
    assert (away[floating] > 0.5).all(), away  # m; the eddy moves by 700 m in the four hours
    assert (away[~floating] == 0.0).all()


@pytest.mark.slow
def test_a_varying_belief_predicts_each_ping_at_its_time(run_tiny):
    """
    Without noise it leads to the truth; frozen at the start it does not; the same day taken again
    is the same.
    """
    beliefs = {
        "varying": {"kind": "exact", "time_varying": True},
        "frozen": {"kind": "exact"},
        "same-day": {"kind": "other-day", "days_earlier": 0.0, "time_varying": True},
    }
    estimators = [
        {"name": n, "range_model": {"kind": "eigenray", "belief": b}} for n, b in beliefs.items()
    ]
    run = run_tiny(
        study=ONE, conditions=[*CONDITIONS, *estimators], ocean=MOVING, acoustics={"currents": True}
    )
    factory = EstimatorFactory(run)
    o, off = run.measurements, {}
    for section in run.config.conditions[2:]:
        estimator = replace(
            factory.estimator(section, 0), initial=(run.truth.position, run.truth.quaternion)
        )
        found = solve_conditions(o, {"e": estimator})["e"]
        assert found.usable
        off[section.name] = np.abs(found.position - run.truth.position).max()
    assert off["varying"] < 1e-4
    assert off["frozen"] > 10.0 * off["varying"]
    at = run.estimates.condition.tolist().index
    same_day, varying = (run.estimates.position[at(n)] for n in ("same-day", "varying"))
    np.testing.assert_array_equal(same_day, varying)


def check_page_rays(run):
    """Rays on the page take as long as those that the study has found; how many of them."""
    rays, ends = (
        json.loads(mission_rays(RunResults(run))),
        PageLinks(RunResults(run), np.unique(run.measurements.range_sample)),
    )
    first, links = run.arrivals.first().travel_time, run.links
    for section in rays:
        sample, one, other = (
            int(of[section["link"]]) for of in (ends.sample, ends.first, ends.second)
        )
        here = (links.sample == sample) & (np.minimum(links.first, links.second) == one)
        (row,) = np.flatnonzero(here & (np.maximum(links.first, links.second) == other))
        np.testing.assert_allclose(section["time"][:1], first[row], atol=1e-6)
    return len(rays)


def test_rays_on_the_page_run_through_the_water_of_their_ping(run_tiny, tmp_path):
    files = written(tmp_path, hours(0, 3, 6))
    for file, degrees in zip(files[1:], (2.0, 4.0), strict=True):  # 2 degrees are 10 m/s, 7 ms/s
        with xr.open_dataset(file) as ocean, xr.set_options(keep_attrs=True):
            warmer = ocean.load().assign(water_temp=ocean["water_temp"] + degrees)
        write_netcdf(warmer, Path(file))
    run = run_tiny(
        study=ONE, conditions=["straight"], ocean={"source": files, "time_varying": True}
    )
    assert check_page_rays(run) > 3
    Path(files[1]).unlink()
    assert json.loads(mission_rays(RunResults(open_run(run.path)))) == []


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_a_medium_around_positions_has_the_same_travel_times(
    interpolation,
):
    axes = {
        "north": np.linspace(-90e3, 90e3, 91),
        "east": np.linspace(-150e3, 150e3, 151),
        "depth": np.array([0.0, 40.0, 100.0, 250.0, 500.0, 1000.0]),
    }
    rng = np.random.default_rng(8)
    profile = np.array([1448.0, 1444.0, 1450.0, 1453.0, 1457.0, 1464.0])
    speed = profile + rng.normal(0.0, 0.5, (91, 151, 6)) * np.array([1.0, 1.0, 0.5, 0.2, 0.1, 0.0])
    water = xr.Dataset(
        {
            "sound_speed": (tuple(axes), speed),
            "sea_floor_depth": (("north", "east"), 900.0 + rng.uniform(0.0, 90.0, (91, 151))),
        },
        coords=axes,
    )
    ocean = OceanFields(None, water)
    whole = Medium.from_dataset(water, interpolation=interpolation)
    for centre, columns in (((20e3, -60e3, 0.0), 57), ((87e3, 149e3, 0.0), 33)):
        ends = np.add(centre, [[0.0, -3e3, 60.0], [2.5e3, 800.0, 400.0]])
        part = medium_around(ocean, interpolation, "flat", 0.0, ends)
        assert part.north.size < columns > part.east.size
        times, expected = (find_eigenrays(m, ends[0], ends[1]).travel_time for m in (part, whole))
        assert expected.size
        np.testing.assert_allclose(times, expected, rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_rays_on_the_page_run_through_the_internal_tide_of_their_ping(run_tiny):
    tide = {"amplitude": 30.0, "period_h": 5.0, "wavelength": 20e3}
    run = run_tiny(study=ONE, conditions=["straight"], ocean={"internal_tide": tide})
    assert check_page_rays(run) > 3
