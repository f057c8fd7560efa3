"""Water from any source is the same water, and the same options mean the same."""

import pickle
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyproj
import pytest
import xarray as xr
from refusals import refused

from pymantaray import Water, load_study, open_water, open_waters
from pymantaray.acoustics import Absorption, Currents, Medium, find_eigenrays, thin_profile
from pymantaray.acoustics.ocean_fields import OceanFields, build_medium
from pymantaray.apps.atlas import Atlas
from pymantaray.apps.ranges import measure
from pymantaray.config import load_sound
from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.door.ocean import build_mission_ocean, open_start
from pymantaray.config.door.water import configuration_of, open_local
from pymantaray.config.estimators import ExactBelief
from pymantaray.config.sections import OceanSection
from pymantaray.errors import MantaRayError, OceanError, StudyError, WaterError
from pymantaray.ocean import cast_ocean, open_ocean, read_cast, to_local, with_ice
from pymantaray.records import RayStatus

HALF = 15e3
DEPTH = np.array([0.0, 40.0, 90.0, 200.0, 600.0])
SPEED = np.array([1436.0, 1435.0, 1442.0, 1447.0, 1455.0])
SOURCE, RECEIVER = (
    np.array([[0.0, 0.0, 30.0]] * 3),
    np.array([[4000.0, 0.0, 60.0], [0, 3000, 300], [-2e3, 1e3, 20]]),
)


@pytest.fixture(scope="module")
def fram():
    return open_ocean("synthetic:fram")


@pytest.fixture
def profile(tmp_path):
    rows = "\n".join(f"{z},{c}" for z, c in zip(DEPTH, SPEED, strict=True))
    path = tmp_path / "profile.csv"
    path.write_text(f"depth,sound_speed\n{rows}\n")
    return path


def times(water, bounces=0):
    arrivals = find_eigenrays(water.medium, SOURCE, RECEIVER, bounces, bounces)
    return arrivals.link, arrivals.travel_time


def test_every_source_of_one_ocean_is_the_same_water(fram, tmp_path, as_stored):
    fram.to_netcdf(tmp_path / "fram.nc")
    (tmp_path / "fram.toml").write_text('[ocean]\nsource = "fram.nc"\n')
    sources = [
        "synthetic:fram",
        [tmp_path / "fram.nc"],
        tmp_path / "fram.toml",
        fram,
    ]
    sources.append(load_sound(tmp_path / "fram.toml"))
    waters = [open_water(source, half_extent=HALF, ice=2.0) for source in sources]
    expected = Medium.from_dataset(with_ice(to_local(fram, half_extent=(HALF, HALF)), 2.0))
    for water in waters:
        np.testing.assert_array_equal(water.medium.field, expected.field)
        np.testing.assert_array_equal(water.medium.surface.depth, expected.surface.depth)
        assert water.frame is not None
        assert water.frame.latitude_deg == waters[0].frame.latitude_deg
    own = [[str(source) for source in water.record["ocean"]] for water in waters]
    file = [str(tmp_path / "fram.nc")]
    assert own == [["synthetic:fram"], file, file, ["memory:"], file]
    as_stored(waters[2], without="source|memory|title")


def test_blanks_around_names_of_variables_do_not_count():
    section = OceanSection(source=("own.nc",), names=("temp = sea_water_temperature [degC]",))
    assert section.standard_names == {"temp": "sea_water_temperature [degC]"}


def test_a_local_ocean_is_taken_as_it_is(fram, as_stored):
    local = to_local(fram, half_extent=(HALF, HALF))
    water = open_water(local, max_surface_bounces=2)
    np.testing.assert_array_equal(water.medium.field, Medium.from_dataset(local).field)
    assert water.reception.max_surface_bounces == 2
    assert open_water(local, ice=1.0).medium.surface.depth.max() == 1.0
    assert water.medium.earth is None
    sphere = open_local(local, earth="sphere")
    assert (sphere.medium.earth is not None, sphere.currents) == (True, None)
    options = {"detection": {"source_level_db": 170.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}}
    options |= {"interpolation": "linear", "earth": "sphere", "currents": "carry"}
    noted = local.assign_attrs(sound_speed_bound="bounded")
    water = open_local(noted, geographic=fram, **options)
    expected = Absorption.from_dataset(fram).db_per_km(SOURCE, 25e3)
    heard = water.reception.detector.absorption.db_per_km(SOURCE, 25e3)
    np.testing.assert_array_equal(heard, expected)
    assert water.notes == ("bounded",)
    assert water.start == fram["time"].values.astype("M8[s]").astype(str)
    assert (water.frame.latitude_deg, water.frame.longitude_deg) == (78.0, 0.0)
    as_stored(water, without="attrs")


def test_water_that_varies_has_its_instants(tiny):
    window = {"half_extent_north": 6e3, "half_extent_east": 6e3}
    config = tiny(ocean={"time_varying": True, **window}, mission={"duration_h": 4.0})
    ocean = build_mission_ocean(config).open()
    assert ocean.varies
    assert ocean.series["time"].values.tolist() == [0.0, 10_800.0, 21_600.0]
    one = ocean.series.isel(time=0, drop=True)
    np.testing.assert_array_equal(ocean.local["sound_speed"], one["sound_speed"])


def test_water_and_what_is_believed_vary_until_the_end_of_the_mission(fram, tiny, tmp_path):
    small = fram.isel(lat=slice(30, 36), lon=slice(100, 108))
    hours = [small["time"] + np.timedelta64(3 * k, "h") for k in range(4)]
    series = xr.concat([small.assign_coords(time=hour) for hour in hours], "time")
    series["time"].attrs = fram["time"].attrs
    series.to_netcdf(tmp_path / "series.nc")
    sides = dict.fromkeys(("centre_lat", "centre_lon", "half_extent_north", "half_extent_east"))
    source = {"source": str(tmp_path / "series.nc"), "time_varying": True}
    config = tiny(ocean=source | sides, mission={"duration_h": 4.0})
    water = open_water(config)
    assert water.span == (0.0, 21_600.0)
    assert water.record["interpolation"] == "smooth"
    assumed = Beliefs(SimpleNamespace(config=config)).varying(ExactBelief(kind="exact"))
    assert assumed.series["time"].values.tolist() == [0.0, 10_800.0, 21_600.0]


@pytest.mark.parametrize("source", ["a profile", "in memory"])
def test_varying_water_can_be_sent_to_a_process(tiny, profile, source):
    keys = {"bathymetry": 600.0, "internal_tide": {"amplitude": 5.0}}
    ocean = build_mission_ocean(tiny(ocean={"source": str(profile), **keys})).open()
    assert ocean.profile["mean"].values[0] == SPEED[0]
    if source == "in memory":
        ocean = OceanFields(None, ocean.local)
    assert ocean.varies
    medium_at = build_medium(ocean, "linear")
    there = sent(medium_at)(3600.0)
    np.testing.assert_array_equal(there.sound_speed, medium_at(3600.0).sound_speed)
    assert sent(ocean).profile.equals(ocean.profile)


def sent(value):
    return pickle.loads(pickle.dumps(value))


def test_a_profile_is_the_medium_that_is_made_of_it_by_hand(profile, as_stored):
    water = open_water(profile, bathymetry=700.0, ice=3.0)
    by_hand = Medium.from_profile(DEPTH, SPEED, bottom_depth=700.0, ice_draft=3.0)
    for mine, its in zip(times(water, 1), times(Water(by_hand), 1), strict=True):
        np.testing.assert_array_equal(mine, its)
    assert water.uniform
    assert water.span == (-np.inf, np.inf)
    assert water.frame is None
    assert water.record["bottom_depth_m"] == 700.0
    as_stored(water)
    rough = {"ice_slope_deg": 3.0, "ice_length": 30.0, "ice_draw": 4}
    assert rough.items() <= open_water(profile, bathymetry=700.0, ice=3.0, **rough).record.items()


def test_a_profile_with_sides_ends_there_and_is_the_same_inside(profile):
    bounded = open_water(profile, bathymetry=700.0, half_extent=3500.0)
    free = open_water(profile, bathymetry=700.0)
    inside, everywhere = (
        find_eigenrays(water.medium, SOURCE, RECEIVER).first() for water in (bounded, free)
    )
    assert [RayStatus(code).name for code in inside.status[:2]] == ["OUTSIDE", "OK"]
    np.testing.assert_allclose(
        inside.travel_time[1:], everywhere.travel_time[1:], rtol=0, atol=1e-9
    )


def test_a_raw_cast_is_thinned_as_by_hand(tmp_path, as_stored):
    z = np.arange(0.0, 301.0)
    c = 1450.0 + 0.05 * np.abs(z - 120.0)
    path = tmp_path / "raw.csv"
    path.write_text(
        "depth,sound_speed\n" + "\n".join(f"{a:.17g},{b:.17g}" for a, b in zip(z, c, strict=True))
    )
    by_default = open_water(path, bathymetry=400.0)
    np.testing.assert_array_equal(by_default.medium.depth, thin_profile(z, c, tolerance=0.02).depth)
    np.testing.assert_array_equal(open_water(path, bathymetry=400.0, thin=0.0).medium.depth, z)
    water = open_water(path, bathymetry=400.0, thin=0.01, interpolation="linear")
    kept = thin_profile(z, c, tolerance=0.01, interpolation="linear")
    np.testing.assert_array_equal(water.medium.depth, kept.depth)
    assert water.record["thinned"]["rms_change_m_s"] == kept.rms_change
    as_stored(water)


def test_several_casts_are_a_water_each(tmp_path, as_stored):
    path = tmp_path / "casts.csv"
    rows = [
        f"{name},2020-03-0{day}T12:00,{z},{c}"
        for name, day in (("A", 1), ("B", 2))
        for z, c in ((0, 1440), (90, 1450))
    ]
    path.write_text("station,time,depth,sound_speed\n" + "\n".join(rows) + "\n")
    waters = open_waters(path, bathymetry=100.0)
    assert [water.name for water in waters] == ["A", "B"]
    assert waters[1].time == np.datetime64("2020-03-02T12:00")
    refused(
        WaterError,
        r"contains 2 casts \(A, B\); only one is allowed",
        open_water,
        path,
        bathymetry=100.0,
    )
    as_stored(list(waters))


def test_one_depth_is_the_sea_floor_of_an_ocean_too(fram, as_stored):
    water = open_water(fram, half_extent=HALF, bathymetry=900.0)
    np.testing.assert_allclose(
        water.medium.bottom_depth([[0.0, 0.0], [9e3, -9e3]]), 900.0, rtol=0, atol=1e-9
    )
    assert open_water(fram, half_extent=HALF).medium.bed.depth.min() > 2000.0
    as_stored(water)


def test_a_map_lies_under_a_profile_about_its_centre(profile, fram, tmp_path, as_stored):
    """The maps have no values far from the domain."""
    level = xr.zeros_like(fram["water_temp"][0]).drop_vars(["depth", "time"])
    north, east = fram["lat"] - 79.0, fram["lon"] - 1.0
    level = level.where((abs(north) < 0.3) & (abs(east) < 1.5))
    for name, standard_name, values in (
        ("floor", "height_above_mean_sea_level", level - 500.0 - 0.1 * north),
        ("ice", "sea_ice_draft", level + 2.0 + 10.0 * abs(north)),
    ):
        values.attrs = {"standard_name": standard_name, "units": "m"}
        values.rename(name).to_netcdf(tmp_path / f"{name}.nc")
    options = {"bathymetry": tmp_path / "floor.nc", "half_extent": 20e3}
    refused(OceanError, "ocean.bathymetry is a map, which needs", open_water, profile, **options)
    water = open_water(profile, centre=(79.0, 1.0), **options)
    at_north = water.medium.bottom_depth([[15e3, 0.0]])[0]
    assert at_north == pytest.approx(500.0 + 0.1 * 15e3 / 111.7e3, abs=1e-3)
    assert water.frame.latitude_deg == 79.0
    as_stored(water)
    under = open_water(profile, centre=(79.0, 1.0), ice=tmp_path / "ice.nc", **options)
    draft = under.medium.surface.depth
    middle = len(draft) // 2
    expected = 2.0 + 10.0 * np.array([0.0, 20e3]) / 111.7e3
    np.testing.assert_allclose(draft[[middle, -1], middle], expected, rtol=0, atol=0.02)


def test_a_map_in_a_projection_lies_under_a_profile(profile, tmp_path):
    to_file = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3996", always_xy=True)
    x, y = to_file.transform(1.0, 79.0)
    axes = {"y": y + np.linspace(-20e3, 20e3, 9), "x": x + np.linspace(-20e3, 20e3, 9)}
    floor = xr.DataArray(np.full((9, 9), 500.0), axes, tuple(axes), "deptho")
    floor.attrs = {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}
    for axis in axes:
        floor[axis].attrs = {"standard_name": f"projection_{axis}_coordinate", "units": "m"}
    floor.to_netcdf(tmp_path / "floor.nc")
    place = {"centre": (79.0, 1.0), "half_extent": 5e3, "bathymetry_crs": "EPSG:3996"}
    water = open_water(profile, bathymetry=tmp_path / "floor.nc", **place)
    np.testing.assert_allclose(water.medium.bed.depth, 500.0)


@pytest.mark.parametrize("east", [5e3, 20e3])
def test_a_narrow_domain_has_the_nodes_of_a_map_along_it(profile, fram, tmp_path, east):
    """The middle of its north edge is beyond the corners, and a point of the map in between."""
    floor = xr.full_like(fram["water_temp"][0], 500.0).drop_vars(["depth", "time"])
    floor.attrs = {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}
    floor.rename("deptho").to_netcdf(tmp_path / "floor.nc")
    place = {"centre": (79.0, 1.0), "half_extent": (50.0, east)}
    bed = open_water(profile, bathymetry=tmp_path / "floor.nc", **place).medium.bed
    cell = 2.0 * east / (bed.depth.shape[1] - 1)
    assert cell == pytest.approx(np.radians(0.08) * 6.39e6 * np.cos(np.radians(79.0)), rel=0.05)


def test_currents_are_carried_on_request_only(fram, as_stored):
    assert open_water(fram, half_extent=HALF).currents is None
    carried = open_water(fram, half_extent=HALF, currents="carry").currents
    local = to_local(fram, half_extent=(HALF, HALF))
    np.testing.assert_array_equal(carried.velocity, Currents.from_dataset(local).velocity)
    as_stored(carried)


def test_an_unknown_option_names_the_nearest():
    refused(
        WaterError,
        "bathymtry: unknown option of water; did you mean bathymetry",
        open_water,
        "synthetic:fram",
        bathymtry=9.0,
    )
    refused(
        WaterError,
        "a medium allows no options; remove ice",
        open_water,
        Medium.from_profile(DEPTH, SPEED, bottom_depth=700.0),
        ice=1.0,
    )
    refused(
        MantaRayError,
        "ocean.thin .--thin. applies to a profile",
        open_water,
        "synthetic:fram",
        thin=0.1,
    )


def test_options_with_two_values_accept_text_with_units(as_stored):
    both = open_water("synthetic:fram", half_extent="10 km").at_start[0]
    sides = open_water("synthetic:fram", half_extent=("10 km", 10e3)).at_start[0]
    for medium in (both, sides):
        np.testing.assert_allclose([medium.north[-1], medium.east[-1]], 10e3)
    refused(
        WaterError,
        "centre is .79.0,.; allowed: latitude and longitude",
        open_water,
        "quick",
        centre=(79.0,),
    )
    refused(
        WaterError,
        "centre is 'x'; allowed: latitude and longitude",
        open_water,
        "quick",
        centre="x",
    )
    refused(
        MantaRayError,
        "half_extent_north: found '10 s'; allowed: a number of metres",
        open_water,
        "quick",
        half_extent=("10 s", 9e3),
    )
    as_stored([both, sides])


def test_no_cut_off_is_none_in_python_too(profile):
    def cut_off(**options):
        return open_water(profile, bathymetry=500.0, **options).reception.spreading_cutoff_db

    assert cut_off(spreading_cutoff_db="none") is cut_off(spreading_cutoff_db=None) is None
    assert cut_off() == 15.0


def test_ranges_in_a_preset_last_as_long_as_their_trajectories(as_stored):
    run = measure(poses(), "quick", 300.0)
    assert run.truth.time[-1] == 600.0
    assert np.unique(run.measurements.range_sample).size == 2
    as_stored(run.measurements)


def test_an_object_that_is_no_source_is_refused_with_the_types():
    water = open_water("synthetic:fram", half_extent=HALF)
    for call in (open_water, Atlas, lambda source: measure(poses(), source, 300.0)):
        refused(
            WaterError,
            "source is an opened Water; give the source that open_water had",
            call,
            water,
        )
        refused(WaterError, "source is of type int; it must be a name, a path", call, 3)
        refused(
            WaterError,
            "source has 2 data sets in a sequence; join them with xarray.merge",
            call,
            [xr.Dataset()] * 2,
        )
    two = [xr.Dataset()] * 2
    refused(
        StudyError,
        "ocean has 2 data sets in a sequence; join them with xarray.merge",
        load_study,
        "quick",
        ocean=two,
    )
    refused(
        StudyError,
        "ocean is of type Water; it must be a name, a path",
        load_study,
        "quick",
        ocean=water,
    )


def poses():
    return pd.DataFrame(
        {
            "time": [0.0, 600.0] * 2,
            "vehicle": ["A", "A", "B", "B"],
            "north": 0.0,
            "east": 0.0,
            "depth": 50.0,
        }
    )


@pytest.mark.parametrize(("salty", "options", "lacks"), [
    (False, {"centre": (78.0, 1.0), "bathymetry": 900.0}, "temperature and salinity"),
    (True, {"bathymetry": 900.0}, "position, which"),
    (True, {"centre": (78.0, 1.0), "bathymetry": "floor.nc"}, "sea bed of one depth"),
])  # fmt: skip
def test_a_profile_needs_all_of_an_ocean_for_a_grid(tmp_path, salty, options, lacks):
    table = pd.DataFrame({"depth": [0, 100, 300], "sound_speed": [1450.0, 1451.0, 1455.0]})
    if salty:
        table = table.assign(temperature=3.0, salinity=35.0)
    table.to_csv(tmp_path / "a.csv", index=False)
    section = configuration_of(tmp_path / "a.csv", options).ocean
    refused(OceanError, f"a.csv: the profile has no {lacks}", open_start, section)


def test_a_profile_on_a_grid_has_the_extent_of_a_cast(tmp_path):
    rows = "depth,temperature,salinity\n0,-1,30\n90,1,31\n300,0,34\n"
    (tmp_path / "cast.csv").write_text(rows)
    options = {"bathymetry": 350.0, "centre": (78.1, 3.2)}
    ocean = open_start(configuration_of(tmp_path / "cast.csv", options).ocean)
    cast = read_cast(tmp_path / "cast.csv", default_place=(78.1, 3.2))
    expected = cast_ocean(cast, bathymetry=350.0, below="constant")
    for axis in ("lat", "lon"):
        np.testing.assert_array_equal(ocean[axis], expected[axis])


def test_notes_of_a_reader_are_those_of_an_ocean_before_it_is_opened(fram, tmp_path):
    rows = ["depth,temperature,salinity", "0,2,30", "50,2,-9", "100,2,31", "200,2,32"]
    (tmp_path / "cast.csv").write_text("\n".join(["# lat 75, lon 1", *rows, ""]))
    small = fram.isel(lat=slice(30, 36), lon=slice(100, 108))
    small.assign_attrs(history="climatology, for July").to_netcdf(tmp_path / "fram.nc")

    def notes(name):
        return build_mission_ocean(configuration_of(tmp_path / name, {})).notes()

    assert [note.split(" with")[0] for note in notes("cast.csv")] == [
        "cast.csv: 1 of 4 rows dropped:"
    ]
    assert notes("fram.nc") == (f"{fram.attrs['title']}: climatology, for July",)
