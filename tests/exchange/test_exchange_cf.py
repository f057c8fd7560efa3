"""
CF trajectories in the layouts of the conventions, of OceanGliders, IMOS and Argo, as xarray writes
them.
"""

import gsw
import numpy as np
import pytest
import xarray as xr
from refusals import refused
from scipy.spatial.transform import Rotation

from pymantaray import read_trajectories
from pymantaray.errors import ExchangeError

COUNTS = {"sg123": 5, "sg124": 3}
TIME = np.array([0.0, 60.0, 120.0, 180.0, 240.0])
EPOCH = np.datetime64("2021-03-04T05:06:07", "ns")


def place(k):
    """Latitude, longitude and depth of a glider at its times, all different."""
    n = list(COUNTS.values())[k]
    return (
        70.0 + k + 1e-3 * np.arange(n),
        -20.0 - k - 2e-3 * np.arange(n),
        10.0 + 3.0 * np.arange(n) + k,
    )


def variables(dims, lat, lon, depth, time, **more):
    attrs = {
        "lat": {"standard_name": "latitude", "units": "degrees_north"},
        "lon": {"standard_name": "longitude", "units": "degrees_east"},
        "depth": {"standard_name": "depth", "units": "m", "positive": "down"},
        "time": {"standard_name": "time", "units": "seconds since 2021-03-04 05:06:07"},
    }
    values = {"lat": lat, "lon": lon, "depth": depth, "time": time}
    return xr.Dataset({name: (dims, v, attrs[name]) for name, v in values.items()} | more)


def trajectory_id():
    return ("trajectory", list(COUNTS), {"cf_role": "trajectory_id"})


def flat():
    return [np.concatenate([place(k)[axis] for k in (0, 1)]) for axis in range(3)] + [
        np.concatenate([TIME[:n] for n in COUNTS.values()])
    ]


def contiguous():
    return variables(
        "obs", *flat(), trajectory=trajectory_id(),
        rowSize=("trajectory", np.array([5, 3], dtype="i4"), {"sample_dimension": "obs"}),
    )  # fmt: skip


def indexed():
    order = np.array([5, 0, 1, 6, 2, 3, 7, 4])  # as they came in
    columns = [column[order] for column in flat()]
    index = np.array([0] * 5 + [1] * 3, dtype="i4")[order]
    return variables(
        "obs", *columns, trajectory=trajectory_id(),
        trajectoryIndex=("obs", index, {"instance_dimension": "trajectory"}),
    )  # fmt: skip


def padded(column):
    out, start = np.full((2, 5), np.nan), 0
    for k, n in enumerate(COUNTS.values()):
        out[k, :n] = column[start : start + n]
        start += n
    return out


def incomplete():
    return variables(("trajectory", "obs"), *map(padded, flat()), trajectory=trajectory_id())


def orthogonal():
    data = variables(("trajectory", "obs"), *map(padded, flat()), trajectory=trajectory_id())
    return data.assign(time=("obs", TIME, data["time"].attrs))


def by_row():
    names = np.repeat(list(COUNTS), list(COUNTS.values()))
    return variables("row", *flat(), trajectory=("row", names, {"cf_role": "trajectory_id"}))


@pytest.mark.parametrize("layout", [contiguous, indexed, incomplete, orthogonal, by_row])
def test_every_layout_of_the_conventions_gives_the_same_trajectories(layout, tmp_path, as_stored):
    layout().assign_attrs(featureType="trajectory", Conventions="CF-1.11").to_netcdf(
        tmp_path / "g.nc"
    )
    tracks = read_trajectories(tmp_path / "g.nc")
    assert (tracks.names, tracks.start, tracks.geodetic) == (list(COUNTS), EPOCH, True)
    for k, own in enumerate(tracks.poses):
        np.testing.assert_array_equal(own.time, TIME[: len(own.time)])
        np.testing.assert_array_equal(own.place, np.column_stack(place(k)))
        assert own.quaternion is None
    as_stored(tracks)


def test_an_oceangliders_file_pressure_flags_and_gaps(tmp_path, as_stored):
    """
    OG1: one glider along N_MEASUREMENTS, pressure, quality flags, places of fixes under other names
    too.
    """
    lat, lon, _ = place(0)
    pressure = np.array([5.0, 50.0, 9999.0, 150.0, 200.0])
    flags = np.array([1, 1, 4, 2, 1], dtype="i1")
    dim = "N_MEASUREMENTS"
    xr.Dataset(
        {
            "LATITUDE": (dim, np.where(np.arange(5) == 1, np.nan, lat),
                         {"standard_name": "latitude", "units": "degrees_north",
                          "ancillary_variables": "LATITUDE_QC"}),
            "LATITUDE_QC": (dim, np.ones(5, dtype="i1"), {"standard_name": "latitude status_flag"}),
            "LONGITUDE": (dim, lon, {"standard_name": "longitude", "units": "degrees_east"}),
            "LATITUDE_GPS": ("N_FIXES", [0.0],
                             {"standard_name": "latitude", "units": "degrees_north"}),
            "LONGITUDE_GPS": ("N_FIXES", [0.0],
                              {"standard_name": "longitude", "units": "degrees_east"}),
            "TIME_GPS": ("N_FIXES", [0.0], {"standard_name": "time", "units": "seconds since"
                                                                              " 1970-01-01"}),
            "TIME": (dim, EPOCH + (TIME * 1e9).astype("timedelta64[ns]"),
                     {"standard_name": "time"}),
            "PRES": (dim, pressure, {"standard_name": "sea_water_pressure", "units": "dbar",
                                     "ancillary_variables": "PRES_QC"}),
            "PRES_QC": (dim, flags, {"standard_name": "sea_water_pressure status_flag"}),
            "TRAJECTORY": ((), "sea007_20210304", {"cf_role": "trajectory_id"}),
        },
        attrs={"featureType": "trajectory", "Conventions": "CF-1.10,ACDD-1.3,OG-1.0"},
    ).to_netcdf(tmp_path / "og1.nc", encoding={"TIME": {"units": "seconds since"
                                                                 " 1970-01-01T00:00:00Z",
                                                                 "dtype": "f8"}})  # fmt: skip
    tracks = read_trajectories(tmp_path / "og1.nc")
    (own,) = tracks.poses
    assert own.name == "sea007_20210304"
    np.testing.assert_allclose(own.time, TIME, atol=1e-6)
    np.testing.assert_allclose(
        own.place[:, 0], lat, atol=1e-12
    )  # the gap is on the line between its neighbours
    depth = -gsw.z_from_p(np.array([5.0, 50.0, 150.0, 200.0]), lat[[0, 1, 3, 4]])
    np.testing.assert_allclose(own.place[[0, 1, 3, 4], 2], depth, rtol=1e-12)
    assert own.place[2, 2] == pytest.approx(
        -gsw.z_from_p(100.0, lat[2])
    )  # and so is the flagged pressure
    assert any("1 values of PRES rejected by quality flags" in note for note in tracks.notes)
    assert any("depth from PRES by TEOS-10" in note for note in tracks.notes)
    as_stored(tracks)


def test_an_imos_file_days_since_1950_and_quality_control(tmp_path, as_stored):
    """IMOS: dimension TIME, DEPTH beside PRES, flags called _quality_control, times in days."""
    lat, lon, depth = place(0)
    days = 26000.0 + TIME / 86400.0
    flag = ("TIME", np.array([1, 1, 1, 1, 3], dtype="i1"), {"standard_name": "depth status_flag"})
    xr.Dataset(
        {
            "LATITUDE": ("TIME", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "LONGITUDE": ("TIME", lon, {"standard_name": "longitude", "units": "degrees_east"}),
            "DEPTH": ("TIME", depth, {"standard_name": "depth", "units": "m", "positive": "down"}),
            "DEPTH_quality_control": flag,
            "PRES": ("TIME", depth * 1.01,
                     {"standard_name": "sea_water_pressure", "units": "dbar"}),
            "PLATFORM": ((), 1, {"trans_system_id": "Irridium"}),
        },
        coords={"TIME": ("TIME", days, {"standard_name": "time", 
                                  "units": "days since 1950-01-01T00:00:00Z"})},
        attrs={"featureType": "trajectory", "Conventions": "CF-1.6,IMOS-1.4"},
    ).to_netcdf(tmp_path / "IMOS_ANFOG_SG154.nc")  # fmt: skip
    tracks = read_trajectories(tmp_path / "IMOS_ANFOG_SG154.nc")
    (own,) = tracks.poses
    assert own.name == "IMOS_ANFOG_SG154"
    assert tracks.start == np.datetime64("1950-01-01", "ns") + np.timedelta64(26000, "D")
    np.testing.assert_array_equal(
        own.place[:, 2], depth[:4]
    )  # the flagged one is the last: nothing beyond it
    np.testing.assert_allclose(
        own.time, TIME[:4], atol=1e-5
    )  # a double of days is half a microsecond
    as_stored(tracks)


def test_an_argo_trajectory_has_surface_fixes_and_pressures_between(tmp_path, as_stored):
    """
    Argo's Rtraj files: characters for names and flags, 999999 and 99999 where nothing is known.
    """
    n = 6
    juld = np.array([26000.0, 26000.1, 26000.2, 999999.0, 26000.3, 26000.4])
    lat = np.array([70.0, 99999.0, 99999.0, 99999.0, 99999.0, 70.4])
    pres = np.array([0.0, 500.0, 1000.0, 700.0, 400.0, 99999.0], dtype="f4")
    xr.Dataset(
        {
            "PLATFORM_NUMBER": ("one", np.array([b"6901234 "]), {}, {"char_dim_name": "STRING8"}),
            "JULD": ("N_MEASUREMENT", juld, {
                "standard_name": "time", "units": "days since 1950-01-01 00:00:00 UTC",
                "_FillValue": 999999.0}),
            "LATITUDE": ("N_MEASUREMENT", lat, {
                "standard_name": "latitude", "units": "degree_north", "_FillValue": 99999.0}),
            "LONGITUDE": ("N_MEASUREMENT", np.where(lat < 90, -20.0, lat), {
                "standard_name": "longitude", "units": "degree_east", "_FillValue": 99999.0}),
            "POSITION_QC": ("N_MEASUREMENT", np.array(list("1    1"), dtype="S1")),
            "PRES": ("N_MEASUREMENT", pres, {
                "standard_name": "sea_water_pressure", "units": "decibar",
                "_FillValue": np.float32(99999.0)}),
            "PRES_QC": ("N_MEASUREMENT", np.array(list("114111"), dtype="S1")),
        }
    ).to_netcdf(tmp_path / "6901234_Rtraj.nc")  # fmt: skip
    tracks = read_trajectories(tmp_path / "6901234_Rtraj.nc")
    (own,) = tracks.poses
    assert own.name == "6901234"
    # the last fix is after the last pressure, and the bad pressure is on the line between its
    # neighbours
    np.testing.assert_allclose(own.time, [0.0, 8640.0, 17280.0, 25920.0], atol=1e-4)
    np.testing.assert_allclose(own.place[:, 0], [70.0, 70.1, 70.2, 70.3], atol=1e-6)
    np.testing.assert_allclose(own.place[[1, 3], 2], -gsw.z_from_p([500.0, 400.0], 70.2), rtol=1e-5)
    assert any(
        "rows dropped: no time, or outside the valid positions" in note for note in tracks.notes
    )
    assert n - own.time.size == 2
    as_stored(tracks)


def test_attitudes_have_standard_names_and_gaps_turn_the_short_way(tmp_path, as_stored):
    data = contiguous()
    heading = np.array([350.0, np.nan, 10.0, 20.0, 30.0, 90.0, 80.0, 70.0])
    data["HEADING"] = "obs", heading, {"standard_name": "platform_orientation", "units": "degree"}
    data["PITCH"] = (
        "obs",
        np.full(8, -0.4),
        {"standard_name": "platform_pitch_fore_up", "units": "rad"},
    )
    data.to_netcdf(tmp_path / "g.nc")
    one, other = read_trajectories(tmp_path / "g.nc").poses
    expected = [np.radians(h) for h in ([350.0, 0.0, 10.0, 20.0, 30.0], [90.0, 80.0, 70.0])]
    for own, headings in zip((one, other), expected, strict=True):
        turn = Rotation.from_quat(own.quaternion, scalar_first=True).as_euler("ZYX")
        np.testing.assert_allclose(np.exp(1j * turn[:, 0]), np.exp(1j * headings), atol=1e-12)
        np.testing.assert_allclose(
            turn[:, 1:], np.tile([-0.4, 0.0], (len(headings), 1)), atol=1e-12
        )
    as_stored(own)


def test_a_gap_over_the_antimeridian_is_filled_on_the_short_way(tmp_path, as_stored):
    lon = np.array([179.9, np.nan, -179.9])
    variables("obs", np.full(3, 60.0), lon, np.full(3, 5.0), TIME[:3]).to_netcdf(tmp_path / "g.nc")
    (own,) = read_trajectories(tmp_path / "g.nc").poses
    np.testing.assert_allclose(own.place[:, 1] % 360.0, [179.9, 180.0, 180.1])
    as_stored(own)


def test_a_drifter_without_depth_is_at_the_surface(tmp_path, as_stored):
    drifter = contiguous().drop_vars("depth")
    drifter.to_netcdf(tmp_path / "drifter.nc")
    tracks = read_trajectories(tmp_path / "drifter.nc")
    assert tracks.poses[0].place[:, 2].max() == 0.0
    assert any(
        "no depth and no pressure; depth set to the surface" in note for note in tracks.notes
    )
    up = contiguous()
    up["depth"] = (
        "obs",
        -up["depth"].values / 1000.0,
        {"standard_name": "depth", "units": "km", "positive": "up"},
    )
    up.to_netcdf(tmp_path / "up.nc")
    np.testing.assert_allclose(
        read_trajectories(tmp_path / "up.nc").poses[1].place[:, 2], place(1)[2]
    )
    as_stored(tracks)


def test_the_truth_of_a_study_is_read_as_trajectories(tiny_run_folder, as_stored):
    from pymantaray import LocalFrame
    from pymantaray.apps.study import open_run

    truth = open_run(tiny_run_folder).truth
    tracks = read_trajectories(tiny_run_folder / "truth.nc")
    again = tracks.at(truth.time, LocalFrame(74.5, -140.0))
    np.testing.assert_array_equal(again.position, truth.position)
    np.testing.assert_array_equal(again.quaternion, truth.quaternion)
    assert tracks.names == truth.name.tolist()
    as_stored(tracks)


def without_units():
    data = contiguous()
    del data["time"].attrs["units"]
    return data


def nowhere():
    data = contiguous()
    data["lat"][:] = np.nan
    return data


BAD = {
    "no variable with standard_name time; a trajectory needs": (
        lambda: contiguous().drop_vars("time")
    ),
    "rowSize declares 9 rows, but obs has 8": lambda: contiguous().assign(
        rowSize=("trajectory", [5, 4], {"sample_dimension": "obs"})),
    "time, latitude and longitude have no common dimension": lambda: contiguous().assign(
        lon=("other", [1.0, 2.0], {"standard_name": "longitude"})),
    "time has units ''; it needs units such as 'seconds since": without_units,
    "no trajectory with two valid positions and times": nowhere,
    "unit 'furlong' of|furlong": lambda: contiguous().assign(
        depth=("obs", np.ones(8), {"standard_name": "depth", "units": "furlong"})),
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_a_data_set_without_a_trajectory_is_refused_in_one_line(message, tmp_path):
    BAD[message]().to_netcdf(tmp_path / "bad.nc")
    refused(ExchangeError, message, lambda: read_trajectories(tmp_path / "bad.nc"))


def test_a_damaged_file_is_refused_in_one_line(tmp_path):
    contiguous().to_netcdf(tmp_path / "good.nc")
    content = (tmp_path / "good.nc").read_bytes()
    (tmp_path / "cut.nc").write_bytes(content[: len(content) // 2])
    refused(ExchangeError, "cut.nc: cannot be read", lambda: read_trajectories(tmp_path / "cut.nc"))
    (tmp_path / "page.nc").write_text("<html>not found</html>")
    refused(
        ExchangeError,
        "page.nc: neither NetCDF-3 nor NetCDF-4",
        lambda: read_trajectories(tmp_path / "page.nc"),
    )
