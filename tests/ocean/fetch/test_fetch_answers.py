"""DAP answers: what pydap's server writes is read back; what anything else writes is refused, never believed."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from webob import Request

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.answers import decode_times, read_arrays, read_attributes, unpack

ADDRESS = "/data.dods?water_u%5B3:1:3%5D%5B0:1:1%5D%5B10:1:13%5D%5B4000:1:4004%5D,time%5B3:1:3%5D"


@pytest.fixture(scope="module")
def handler(ocean_server):
    return ocean_server.reanalysis().dap()


@pytest.fixture(scope="module")
def block(handler):
    return Request.blank(ADDRESS).get_response(handler).body


def test_a_block_is_read_with_its_maps(block, ocean_server):
    leaves = read_arrays(block)
    assert set(leaves) == {"water_u", "water_u.time", "water_u.depth", "water_u.lat", "water_u.lon", "time"}
    assert leaves["water_u"].dims == ("time", "depth", "lat", "lon")
    assert leaves["water_u"].values.shape == (1, 2, 4, 5)
    np.testing.assert_array_equal(leaves["water_u.depth"].values, [0.0, 2.0])
    assert decode_times(leaves["time"].values, "hours since 2000-01-01 00:00:00")[0] == np.datetime64(
        "2014-01-01T21"
    )


def test_attributes_are_read_with_their_numbers(handler):
    table = read_attributes(Request.blank("/data.das").get_response(handler).body)
    assert table["time"]["units"] == "hours since 2000-01-01 00:00:00"
    assert table["water_temp"]["_FillValue"] == -30000
    assert table["water_temp"]["scale_factor"] == pytest.approx(0.001)


# as THREDDS lays it out (https://docs.opendap.org, DAP 2): another order of spaces, Structure in place of Grid
THREDDS = b"""Dataset {
    Grid {
     ARRAY:
        Int16 water_u[time = 1][depth = 1][lat = 1][lon = 2];
     MAPS:
        Float64 time[time = 1];
        Float64 depth[depth = 1];
        Float64 lat[lat = 1];
        Float64 lon[lon = 2];
    } water_u;
} GLBy0.08/expt_93.0/uv3z;
\nData:\n"""


def test_thredds_layout_is_read():
    def array(values, dtype):
        return np.array([len(values)] * 2, ">u4").tobytes() + np.array(values, dtype).tobytes()

    body = THREDDS + array([250, -30000], ">i4") + array([168135.0], ">f8") + array([0.0], ">f8")
    body += array([73.0], ">f8") + array([-150.0, -149.92], ">f8")
    leaves = read_arrays(body)
    np.testing.assert_array_equal(leaves["water_u"].values.ravel(), [250, -30000])
    np.testing.assert_array_equal(leaves["water_u.lon"].values, [-150.0, -149.92])


@pytest.mark.parametrize("share", [0.0, 0.01, 0.2, 0.5, 0.9, 0.999])
def test_a_block_cut_anywhere_is_refused(block, share):
    with pytest.raises(OceanError):
        read_arrays(block[: int(share * len(block))])


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
def test_bytes_that_were_changed_never_change_the_shape_unseen(block, data):
    """Whatever is flipped: an error of any kind, or arrays of exactly the described sizes."""
    place = data.draw(st.integers(0, len(block) - 1))
    changed = block[:place] + bytes([data.draw(st.integers(0, 255))]) + block[place + 1 :]
    try:
        leaves = read_arrays(changed)
    except Exception:  # noqa: BLE001  the transport turns every one into a line and another attempt
        return
    assert sum(leaf.values.nbytes for leaf in leaves.values()) < len(block)


@given(st.binary(max_size=300))
@settings(max_examples=60, deadline=None)
def test_noise_is_refused(noise):
    for read in (read_arrays, read_attributes):
        with pytest.raises(OceanError):
            read(noise)


def test_a_huge_declared_size_takes_no_memory():
    body = (
        THREDDS.replace(b"lon = 2", b"lon = 4000000000").replace(b"lat = 1", b"lat = 4000000000") + b"\0" * 64
    )
    with pytest.raises(OceanError, match=r"wrong size|cut short"):
        read_arrays(body)


PACKED = {"scale_factor": 0.0010000000474974513, "add_offset": 20.0, "_FillValue": -30000}


def test_packing_is_decimal_and_every_fill_is_dry():
    np.testing.assert_array_equal(
        unpack("water_temp", np.array([-21623, 0, -30000]), PACKED), [-21623 * 0.001 + 20.0, 20.0, np.nan]
    )
    # unpacked by the server, fill value and all
    np.testing.assert_array_equal(
        unpack("water_u", np.array([0.5, -30.0, np.nan]), {}), [0.5, np.nan, np.nan]
    )
    np.testing.assert_array_equal(
        unpack("salinity", np.array([34.0, -10.0, 1e20]), {"missing_value": 1e20}), [34.0, np.nan, np.nan]
    )


@pytest.mark.parametrize(
    "attributes",
    [
        {"scale_factor": 0.0},
        {"scale_factor": float("nan")},
        {"standard_name": "sea_water_potential_temperature"},
    ],
)
def test_attributes_that_make_no_sense_are_refused(attributes):
    with pytest.raises(OceanError):
        unpack("water_temp", np.array([1]), attributes)


@pytest.mark.parametrize(
    ("units", "expected"),
    [
        ("hours since 2000-01-01 00:00:00", "2000-01-02T12:00:00"),
        ("hours since 2000-01-01", "2000-01-02T12:00:00"),
        ("hours since 2000-01-01 00:00:00.000 UTC", "2000-01-02T12:00:00"),
        ("days since 1999-12-31", "2000-02-05T00:00:00"),
    ],
)
def test_time_units_in_their_spellings(units, expected):
    assert decode_times(np.array([36.0]), units)[0] == np.datetime64(expected)


@pytest.mark.parametrize("units", ["", "hours since analysis", "metres", "hours since 2000-99-01"])
def test_units_that_are_no_time_are_refused(units):
    with pytest.raises(OceanError, match="time has units"):
        decode_times(np.array([1.0]), units)
    with pytest.raises(OceanError, match="no times"):
        decode_times(np.array([np.nan]), "hours since 2000-01-01")
