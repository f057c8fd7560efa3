"""Formats one by one: NetCDF-3 against other readers, NetCDF-4 from its own process, zarr without pickles."""

import json
import os
import pickle
import time

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean
from pymantaray.ocean.files import open_stored
from pymantaray.ocean.hdf5 import Hdf5Process
from pymantaray.ocean.schema import with_history
from pymantaray.records import write_netcdf


@pytest.fixture(scope="module")
def reader():
    with Hdf5Process() as process:
        yield process


@pytest.fixture
def ocean(closed_form_ocean):
    made = closed_form_ocean(
        45.0,
        10.0,
        temperature=lambda z, lat, lon: 5.0 + 0.1 * lat - 0.01 * lon - 1e-3 * z,
        floor=lambda lat, _lon: np.where(lat > 45.0, 5.0, 400.0),
        n=(5, 6),
        depth=[0.0, 10.0, 200.0],
    )
    made["water_temp"].attrs["comment"] = "in situ, of course"
    return with_history(with_history(made, "made up"), "looked at")


def message_of(*args, **kwargs) -> str:
    with pytest.raises(OceanError) as caught:
        open_ocean(*args, **kwargs)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


def test_our_own_files_come_back_unchanged(tmp_path, ocean, beaufort_sea):
    write_netcdf(ocean, tmp_path / "own.nc")
    back = open_ocean(tmp_path / "own.nc")
    xr.testing.assert_identical(back, ocean)
    assert back.attrs["history"].splitlines() == ["made up", "looked at"]
    assert isinstance(back.attrs["synthetic"], int)
    write_netcdf(back, tmp_path / "twice.nc")
    xr.testing.assert_identical(open_ocean(tmp_path / "twice.nc"), ocean)
    write_netcdf(beaufort_sea, tmp_path / "sea.nc")
    part = open_ocean(tmp_path / "sea.nc", window=(74.0, 75.0, -141.0, -139.0))
    xr.testing.assert_identical(part, open_ocean("synthetic:beaufort", window=(74.0, 75.0, -141.0, -139.0)))
    assert part.sizes["lat"] == 26


def test_our_own_files_that_are_not_valid_are_refused(tmp_path, ocean):
    warm = ocean.assign(water_temp=ocean["water_temp"] + 273.15)
    warm["water_temp"].attrs = ocean["water_temp"].attrs
    write_netcdf(warm, tmp_path / "warm.nc")
    assert "warm.nc: ocean: water_temp spans" in message_of(tmp_path / "warm.nc")


@given(
    n=st.lists(st.integers(1, 4), min_size=1, max_size=4),
    dtype=st.sampled_from(["i1", ">i2", ">i4", ">f4", ">f8"]),
    record=st.booleans(),
    second=st.booleans(),
    version=st.sampled_from([1, 2]),
    data=st.data(),
)
@settings(max_examples=60, deadline=None)
def test_netcdf3_says_what_scipy_s_reader_says(
    tmp_path_factory, reader, n, dtype, record, second, version, data
):
    path = tmp_path_factory.mktemp("nc3") / "a.nc"
    rng = np.random.default_rng(0)
    values = (100.0 * rng.standard_normal(n)).astype(dtype)
    dims = [f"d{i}" for i in range(len(n))]
    with netcdf_file(path, "w", version=version) as file:
        for i, (dim, size) in enumerate(zip(dims, n, strict=True)):
            file.createDimension(dim, None if record and i == 0 else size)
        file.createVariable("x", np.dtype(dtype), dims)[:] = values
        file.variables["x"].units = "m"
        file.variables["x"].numbers = np.array([1, 2], ">i4")
        if second:  # records of several variables lie between one another
            file.createVariable("y", np.dtype("i1"), dims[:1])[:] = np.arange(n[0])
    key = {}
    for dim, size in zip(dims, n, strict=True):
        start = data.draw(st.integers(0, size - 1))
        key[dim] = slice(start, data.draw(st.integers(start + 1, size)))
    stored = open_stored(path, reader)
    assert stored.variables["x"].attrs == {"units": "m", "numbers": [1, 2]}
    expected = values[tuple(key[d] for d in dims)].astype(float)
    np.testing.assert_array_equal(stored.values("x", key), expected)
    if second:
        np.testing.assert_array_equal(stored.values("y"), np.arange(n[0]))


@pytest.mark.parametrize("kind", ["NETCDF4", "NETCDF4_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA"])
@pytest.mark.parametrize("packed", [True, False], ids=["packed", "plain"])
def test_all_kinds_of_netcdf_say_the_same(tmp_path, ocean, kind, packed):
    chunks = {"zlib": True, "chunksizes": (2, 2, 3)} if kind.startswith("NETCDF4") else {}
    pack = (
        {"dtype": "int16", "scale_factor": 0.001, "add_offset": 20.0, "_FillValue": -30000} if packed else {}
    )
    made = ocean.drop_attrs(deep=False).drop_vars("time").assign_coords(time=ocean["time"])
    made.to_netcdf(
        tmp_path / "a.nc",
        engine="netcdf4",
        format=kind,
        encoding={v: {**chunks, **pack} for v in ocean.data_vars},
    )
    back = open_ocean(tmp_path / "a.nc")
    for name in ocean.data_vars:
        np.testing.assert_allclose(back[name], ocean[name], atol=6e-4 if packed else 0.0, rtol=0)


@pytest.mark.parametrize("version", [2, 3])
def test_zarr_folders_open_by_window_and_time(tmp_path, ocean, version):
    pytest.importorskip("zarr")
    other = ocean.assign_coords(time=ocean["time"] + np.timedelta64(3, "h")) + 0.0
    other = other.assign(water_temp=ocean["water_temp"] + 1.0)
    both = xr.concat([ocean, other], "time").drop_attrs()
    for name in ocean.variables:
        both[name].attrs = {
            k: v for k, v in ocean[name].attrs.items() if k in ("standard_name", "units", "positive")
        }
    pack = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -30000}
    both.to_zarr(tmp_path / "o.zarr", zarr_format=version, encoding={"water_u": pack}, consolidated=False)
    back = open_ocean(tmp_path / "o.zarr", time="2020-01-01T03:00", window=(44.95, 45.1, 9.85, 10.3))
    inside = ocean.sel(lat=back["lat"], lon=back["lon"])
    assert back.sizes["lat"] < ocean.sizes["lat"]
    np.testing.assert_array_equal(back["water_temp"], inside["water_temp"] + 1.0)
    np.testing.assert_allclose(back["water_u"], inside["water_u"], atol=6e-4)
    assert "2 times" in message_of(tmp_path / "o.zarr")


class Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_a_zarr_folder_that_would_unpickle_is_refused_untouched(tmp_path, ocean):
    pytest.importorskip("zarr")
    numcodecs = pytest.importorskip("numcodecs")
    ocean.drop_attrs().to_zarr(tmp_path / "o.zarr", zarr_format=2, consolidated=False)
    trap = np.array([Trap(tmp_path / "sprung")] * 5, dtype=object)
    folder = tmp_path / "o.zarr" / "lat"
    pickled = numcodecs.Pickle()
    (folder / "0").write_bytes(pickled.encode(trap))
    metadata = json.loads((folder / ".zarray").read_text())
    metadata |= {"filters": [pickled.get_config()], "compressor": None}
    (folder / ".zarray").write_text(json.dumps(metadata))
    assert "lat is coded by pickle" in message_of(tmp_path / "o.zarr")
    assert not (tmp_path / "sprung").exists()
    pickle.loads((folder / "0").read_bytes())  # the trap is one
    assert (tmp_path / "sprung").exists()


def test_zarr_metadata_that_are_damaged_are_refused(tmp_path, ocean):
    pytest.importorskip("zarr")
    ocean.drop_attrs().to_zarr(tmp_path / "o.zarr", zarr_format=3, consolidated=False)
    path = tmp_path / "o.zarr" / "lon" / "zarr.json"
    whole = json.loads(path.read_text())
    for change in (
        {"shape": [10**15]},
        {"shape": "many"},
        {"data_type": "object"},
        {"codecs": [{"name": "exec"}]},
    ):
        path.write_text(json.dumps({**whole, **change}))
        assert message_of(tmp_path / "o.zarr")
    path.write_text("{" * 5000)
    assert "cannot be read as zarr" in message_of(tmp_path / "o.zarr")
    (tmp_path / "empty").mkdir()
    assert "no zarr group" in message_of(tmp_path / "empty")


def test_addresses_are_not_files():
    assert "mantaray ocean fetch" in message_of("https://tds.hycom.org/thredds/dodsC/GLBy0.08/expt_93.0")


def test_the_process_that_reads_is_ended_and_started_again(tmp_path, ocean):
    write_netcdf(ocean, tmp_path / "own.nc")
    with Hdf5Process() as process:
        first = open_stored(tmp_path / "own.nc", process)
        child = process._child
        child.kill()
        child.wait()
        with pytest.raises(OceanError, match="crashed, hung or ran out of memory"):
            first.values("water_temp")
        np.testing.assert_array_equal(first.values("water_temp"), ocean["water_temp"])
        child = process._child
    assert child.poll() is not None


@pytest.mark.parametrize("kind", ["netcdf4", "scipy"])
def test_the_paper_s_region_opens_fast(tmp_path, beaufort_sea, kind):
    pack = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -30000}
    packed = {
        v: {**pack, "add_offset": 20.0 * (v in ("water_temp", "salinity"))} for v in beaufort_sea.data_vars
    }
    if kind == "netcdf4":
        packed = {v: {**e, "zlib": True, "complevel": 1} for v, e in packed.items()}
    beaufort_sea.to_netcdf(tmp_path / "sea.nc", engine=kind, encoding=packed)
    begin = time.perf_counter()
    opened = open_ocean(tmp_path / "sea.nc")
    seconds = time.perf_counter() - begin
    assert dict(opened.sizes) == {"depth": 40, "lat": 76, "lon": 251}
    assert seconds < 2.0
