"""Damaged and hostile files end in one line or in a valid ocean: no crash, no hang, bounded memory."""

import importlib.util
import json
import os
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

WORKER = Path(__file__).with_name("fuzz_worker.py")
spec = importlib.util.spec_from_file_location("fuzz_worker", WORKER)
worker = importlib.util.module_from_spec(spec)
spec.loader.exec_module(worker)


@pytest.fixture
def ocean(closed_form_ocean):
    return closed_form_ocean(
        45.0,
        10.0,
        temperature=lambda z, lat, _lon: 5.0 + 0.1 * lat - 1e-3 * z,
        n=(6, 7),
        depth=[0.0, 10.0, 50.0],
    )


@pytest.fixture
def files(tmp_path, ocean):
    """One small data set in the formats that differ most inside."""
    steps = ocean.expand_dims("time")
    pack = {"dtype": "int16", "scale_factor": 0.001, "add_offset": 20.0, "_FillValue": -30000}
    chunks = {**pack, "zlib": True, "fletcher32": True, "chunksizes": (1, 2, 3, 3)}
    packed = dict.fromkeys(ocean.data_vars, pack)
    steps.to_netcdf(tmp_path / "classic.nc", engine="scipy", encoding=packed, unlimited_dims=["time"])
    steps.to_netcdf(tmp_path / "wide.nc", engine="netcdf4", format="NETCDF3_64BIT_DATA")
    ocean.to_netcdf(tmp_path / "own.nc", engine="netcdf4")
    steps.to_netcdf(
        tmp_path / "packed.nc",
        engine="netcdf4",
        encoding=dict.fromkeys(ocean.data_vars, chunks),
        unlimited_dims=["time"],
    )
    return {name: tmp_path / f"{name}.nc" for name in ("classic", "wide", "own", "packed")}


def fuzz(tmp_path, files, names, first, count):
    folder = tmp_path / "mutants"
    folder.mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, WORKER, folder, str(first), str(count), *(files[n] for n in names)],
        capture_output=True,
        text=True,
        timeout=120 + 5 * count,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    tally = json.loads(done.stdout)
    assert tally["valid"] + tally["refused"] == count
    assert tally["refused"] > 0
    return tally


def test_a_few_damaged_netcdf3_files(tmp_path, files):
    assert fuzz(tmp_path, files, ("classic", "wide"), 0, 150)["valid"] > 0


def test_a_few_damaged_netcdf4_files(tmp_path, files):
    fuzz(tmp_path, files, ("own", "packed"), 0, 6)


@pytest.mark.slow
def test_thousands_of_damaged_netcdf3_files(tmp_path, files):
    fuzz(tmp_path, files, ("classic", "wide"), 10_000, 6000)


@pytest.mark.slow
def test_thousands_of_damaged_netcdf4_files(tmp_path, files):
    fuzz(tmp_path, files, ("own", "packed"), 20_000, 2000)


@pytest.mark.parametrize("name", ["classic", "wide", "own", "packed"])
def test_files_cut_anywhere_are_refused(tmp_path, files, name):
    whole = files[name].read_bytes()
    for share in (0.0, 0.02, 0.5, 0.95):
        cut = tmp_path / "cut.nc"
        cut.write_bytes(whole[: int(share * len(whole))])
        assert worker.outcome(cut, cut.stat().st_size) == "refused", share


def _bytes(data, old, new):
    assert data.count(old) >= 1
    return data.replace(old, new)


HOSTILE = {
    "dimension of 2^31 in the header": lambda d: _bytes(
        d, b"\0\0\0\x03lat\0\0\0\0\x06", b"\0\0\0\x03lat\0\x7f\xff\xff\xff"
    ),
    "2^32 records less one": lambda d: d[:4] + b"\xff\xff\xff\xff" + d[8:],
    "2^31 records": lambda d: d[:4] + b"\x80\0\0\0" + d[8:],
    "2^31 dimensions": lambda d: d[:12] + b"\x7f\xff\xff\xff" + d[16:],
    "another format": lambda d: b"CDF\x05" + d[4:],
    "a name of a gigabyte": lambda d: _bytes(d, b"\0\0\0\x03lat\0", b"\x40\0\0\0lat\0"),
    "a line break in a name": lambda d: _bytes(d, b"salinity", b"sal\n\x1b[1m"),
}


@pytest.mark.parametrize("case", HOSTILE, ids=str)
def test_hostile_netcdf3_headers_are_refused(tmp_path, files, case):
    path = tmp_path / "hostile.nc"
    path.write_bytes(HOSTILE[case](files["classic"].read_bytes()))
    # so many records that the file would have to be longer, except where the count means "to its end"
    expected = "valid" if "less one" in case else "refused"
    assert worker.outcome(path, path.stat().st_size) == expected


STRANGE = {
    "strings for numbers": lambda o: o.assign(water_temp=o["water_temp"].astype(str)),
    "a string axis": lambda o: o.assign_coords(lat=[f"{v:g}N" for v in o["lat"].values]),
    "an axis that is not finite": lambda o: o.assign_coords(lon=o["lon"] * np.nan),
    "an infinite axis": lambda o: o.assign_coords(depth=[0.0, 10.0, np.inf]),
    "no points": lambda o: o.isel(lat=slice(0, 0)),
    "no levels": lambda o: o.isel(depth=slice(0, 0)),
    "no times": lambda o: o.expand_dims("time").isel(time=slice(0, 0)),
    "nothing but attributes": lambda o: o[[]],
    "units of another quantity": lambda o: o.assign(water_temp=o["water_temp"].assign_attrs(units="m")),
    "units that are a number": lambda o: o.assign(water_u=o["water_u"].assign_attrs(units=3)),
    "a standard_name that is a list": lambda o: o.rename(salinity="s").assign(
        s=o["salinity"].rename("s").assign_attrs(standard_name=[1, 2])
    ),
    "values beyond numbers": lambda o: o.assign(salinity=o["salinity"] * 1e300),
    "scale of text": lambda o: o.assign(salinity=o["salinity"].assign_attrs(scale_factor="0.1")),
    "infinite scale": lambda o: o.assign(salinity=o["salinity"].assign_attrs(scale_factor=np.inf)),
    "scale of zero": lambda o: o.assign(water_temp=o["water_temp"].assign_attrs(scale_factor=0.0)),
    "time beyond years": lambda o: o.assign_coords(time=((), 1e300, {"units": "days since 2000-01-01"})),
    "time since never": lambda o: o.assign_coords(time=((), 1.0, {"units": "days since never"})),
    "time of text": lambda o: o.assign_coords(time="yesterday"),
}
STAYS_VALID = {"scale of text", "infinite scale", "scale of zero"}


@pytest.mark.parametrize("case", STRANGE, ids=str)
def test_strange_data_sets_are_refused_in_one_line(tmp_path, ocean, case):
    path = tmp_path / "strange.nc"
    strange = STRANGE[case](ocean)
    for name in strange.variables:
        if "scale_factor" not in strange[name].attrs:
            strange[name].attrs.pop("_FillValue", None)
    strange.to_netcdf(path, engine="netcdf4")
    expected = "valid" if case in STAYS_VALID else "refused"
    assert worker.outcome(path, path.stat().st_size) == expected


def test_a_small_netcdf4_file_that_declares_much_is_refused_before_it_is_read(tmp_path, ocean):
    netCDF4 = pytest.importorskip("netCDF4")
    for chunks in ((1, 100, 100), (20, 10_000, 10_000)):
        path = tmp_path / "huge.nc"
        with netCDF4.Dataset(path, "w") as file:
            for name, n in (("depth", 1000), ("lat", 10_000), ("lon", 10_000)):
                file.createDimension(name, n)
                axis = file.createVariable(name, "f8", (name,))
                axis.units = {"depth": "m", "lat": "degrees_north", "lon": "degrees_east"}[name]
                axis[:] = np.linspace(0.0, 80.0, n)
            file.createVariable("time", "f8", ()).units = "days since 2000-01-01"
            file["time"][...] = 1.0
            for name in ocean.data_vars:
                field = file.createVariable(name, "i2", ("depth", "lat", "lon"), chunksizes=chunks, zlib=True)
                field.units = ocean[name].attrs["units"]
        size = path.stat().st_size
        assert size < 5e6
        assert worker.outcome(path, size) == "refused"
        # the chunks of 4 GB cannot be read by a window either; the others can, and are not there
        assert worker.outcome(path, size, window=(1.0, 1.1, 1.0, 1.1)) == "refused"


def outcome_in_a_process_of_its_own(path, size):
    """What opening did, and the highest memory of a process that did nothing else. [bytes]"""
    code = (
        "import importlib.util, sys;"
        f"s = importlib.util.spec_from_file_location('w', {str(WORKER)!r}); w = importlib.util.module_from_spec(s);"
        f"s.loader.exec_module(w); print(w.outcome({str(path)!r}, {size}), w.peak_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    result, peak = done.stdout.split()
    return result, int(peak)


def test_a_block_that_inflates_a_thousandfold_stays_within_its_memory(tmp_path, ocean):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "bomb.nc"
    ocean.expand_dims("time").to_netcdf(
        path, engine="netcdf4", encoding={v: {"zlib": True} for v in ocean.data_vars}
    )
    packer = zlib.compressobj(9)
    first, again = (packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    bomb = first + 127 * again + packer.flush()  # 2 GiB of zeros
    assert len(zlib.decompressobj().decompress(bomb, 1 << 26)) == 1 << 26
    with h5py.File(path, "r+") as file:
        file["water_temp"].id.write_direct_chunk((0, 0, 0, 0), bomb)
    size = path.stat().st_size
    assert size < 3e6
    result, peak = outcome_in_a_process_of_its_own(path, size)
    assert result == "refused"
    assert peak < 1 << 30  # the bomb is twice that


def test_a_field_that_compresses_well_is_read_up_to_the_bound(tmp_path):
    """The largest memory that an honest small file can ask for; the bound that the reference page states."""
    n = {"depth": 20, "lat": 400, "lon": 600}  # 38 MB of numbers each, in a file of a few hundred kilobytes
    shape = tuple(n.values())
    units = {"water_temp": "degC", "salinity": "1", "water_u": "m s-1", "water_v": "m s-1"}
    data = xr.Dataset(
        {k: (tuple(n), np.broadcast_to(np.float32(4.0), shape), {"units": u}) for k, u in units.items()},
        coords={
            "depth": ("depth", np.arange(20.0), {"units": "m"}),
            "lat": ("lat", np.linspace(0, 40, 400)),
            "lon": ("lon", np.linspace(0, 60, 600)),
            "time": np.datetime64("2020-01-01", "ns"),
        },
    )
    path = tmp_path / "even.nc"
    data.to_netcdf(path, engine="netcdf4", encoding={v: {"zlib": True} for v in units})
    del data
    size = path.stat().st_size
    result, peak = outcome_in_a_process_of_its_own(path, size)
    assert result == "valid"
    assert peak > 4 * 8 * np.prod(shape)  # it measures something
