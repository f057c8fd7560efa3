"""
Formats one by one: NetCDF-3, NetCDF-4 and zarr say the same; what is cut, damaged or strange gets
one line.
"""

import json
import os
import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pymantaray.ocean import check_ocean, open_ocean, with_history
from pymantaray.records.writing import write_netcdf

PACKING = {"dtype": "int16", "scale_factor": 0.001, "add_offset": 20.0, "_FillValue": -30000}
NETCDF = {"classic": "NETCDF3_64BIT", "wide": "NETCDF3_64BIT_DATA", "hdf5": "NETCDF4"}


@pytest.fixture
def ocean(closed_form_ocean):
    ocean = closed_form_ocean(
        45.0,
        10.0,
        temperature=lambda z, lat, lon: 5.0 + 0.1 * lat - 0.01 * lon - 1e-3 * z,
        floor=lambda lat, _lon: np.where(lat > 45.0, 5.0, 400.0),
        n=(5, 6),
        depth=[0.0, 10.0, 200.0],
    )
    ocean["water_temp"].attrs["comment"] = "in situ, of course"
    return with_history(with_history(ocean, "built"), "looked at")


def test_our_own_files_come_back_unchanged(tmp_path, ocean, as_stored):
    write_netcdf(ocean, tmp_path / "own.nc")
    back = open_ocean(tmp_path / "own.nc")
    xr.testing.assert_identical(back, ocean)
    assert back.attrs["history"].splitlines() == ["built", "looked at"]
    assert isinstance(back.attrs["synthetic"], int)
    write_netcdf(back, tmp_path / "twice.nc")
    xr.testing.assert_identical(open_ocean(tmp_path / "twice.nc"), ocean)
    as_stored(back)


def test_our_own_files_that_are_not_valid_are_refused(tmp_path, ocean, message_of):
    write_netcdf(
        ocean.assign(water_temp=ocean["water_temp"].copy(data=ocean["water_temp"] + 273.15)),
        tmp_path / "warm.nc",
    )
    assert "warm.nc: ocean: values (water_temp): " in message_of(tmp_path / "warm.nc")


@pytest.mark.parametrize("kind", [*NETCDF, "zarr 2", "zarr 3"])
@pytest.mark.parametrize("packed", [True, False], ids=["packed", "plain"])
def test_all_kinds_of_files_open_by_time_and_window_and_say_the_same(
    tmp_path, ocean, kind, packed, message_of, as_stored
):
    other = ocean.assign(water_temp=ocean["water_temp"].copy(data=ocean["water_temp"] + 1.0))
    other = other.assign_coords(time=ocean["time"] + np.timedelta64(3, "h"))
    both, path = xr.concat([ocean, other], "time").drop_attrs(deep=False), tmp_path / "a"
    options = {"encoding": dict.fromkeys(ocean.data_vars, PACKING if packed else {})}
    if kind in NETCDF:
        if kind == "hdf5":
            options["encoding"] = {
                n: e | {"zlib": True, "chunksizes": (1, 2, 2, 3)}
                for n, e in options["encoding"].items()
            }
        both.to_netcdf(path, engine="netcdf4", format=NETCDF[kind], **options)
    else:
        pytest.importorskip("zarr")
        both.to_zarr(path, zarr_format=int(kind[-1]), consolidated=False, **options)
    assert "2 times" in message_of(path)
    whole = open_ocean(path, time="2020-01-01T03:00")
    for name in ocean.data_vars:
        np.testing.assert_allclose(whole[name], other[name], atol=6e-4 if packed else 0.0, rtol=0)
    part = open_ocean(path, time="2020-01-01T03:00", window=(44.95, 45.1, 9.85, 10.3))
    assert part.sizes["lat"] < ocean.sizes["lat"]
    xr.testing.assert_equal(part, whole.sel(lat=part["lat"], lon=part["lon"]))
    as_stored(part)


@pytest.mark.parametrize("kind", NETCDF)
@pytest.mark.parametrize("records", [True, False])
def test_files_cut_anywhere_are_refused(tmp_path, ocean, kind, records, message_of):
    wide = ocean.interp(lat=np.linspace(44.93, 45.07, 20), lon=np.linspace(9.9, 10.1, 30))
    steps = wide.expand_dims("time") if records else wide
    whole, cut = tmp_path / "whole.nc", tmp_path / "cut.nc"
    steps.to_netcdf(
        whole, engine="netcdf4", format=NETCDF[kind], unlimited_dims=["time"] if records else None
    )
    assert open_ocean(whole).sizes["depth"] == 3
    for share in (0.0, 0.02, 0.5, 0.9, 0.99):
        cut.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
        assert "cut.nc: " in message_of(cut), share


class Trap:
    """Leaves a folder behind when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


SPELLINGS = {
    "plain": lambda text: text.encode(),
    "escaped": lambda text: text.replace("pickle", "\\u0070ickle").encode(),
    "escaped key": lambda text: (
        text.replace('"id"', '"\\u0069d"').replace("filters", "f\\u0069lters").encode()
    ),
    "another encoding": lambda text: text.encode("utf-16"),
    "a key twice": lambda text: text.replace('"filters"', '"filters": null, "filters"').encode(),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize("behind", ["", "link"])
def test_a_zarr_folder_that_would_unpickle_is_refused_untouched(
    tmp_path, ocean, message_of, spelling, behind
):
    pytest.importorskip("zarr")
    numcodecs = pytest.importorskip("numcodecs")
    ocean.drop_attrs().to_zarr(tmp_path / "o.zarr", zarr_format=2, consolidated=False)
    folder, pickled = tmp_path / "o.zarr" / "lat", numcodecs.Pickle()
    (folder / "0").write_bytes(
        pickled.encode(np.array([Trap(tmp_path / "sprung")] * 5, dtype=object))
    )
    metadata = json.loads((folder / ".zarray").read_text())
    metadata |= {"filters": [pickled.get_config()], "compressor": None}
    (folder / ".zarray").write_bytes(SPELLINGS[spelling](json.dumps(metadata)))
    if behind:
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
    assert "o.zarr: lat: codec 'pickle' is not allowed" in message_of(tmp_path / "o.zarr")
    assert not (tmp_path / "sprung").exists()
    pickle.loads((folder / "0").read_bytes())
    assert (tmp_path / "sprung").exists(), "the trap is none"


INNER = {
    "name": "sharding_indexed",
    "configuration": {"chunk_shape": [1], "codecs": [{"name": "numcodecs.pickle"}]},
}
HOSTILE = {
    "codec": (".zarray", lambda m: m | {"compressor": {"id": "pickle", "protocol": 5}}),
    "a plugin's codec": (".zarray", lambda m: m | {"filters": [{"id": "mine"}]}),
    "two names": (".zarray", lambda m: m | {"filters": [{"id": "delta", "name": "pickle"}]}),
    "a name that is a list": (".zarray", lambda m: m | {"filters": [{"id": ["pickle"]}]}),
    "consolidated": (".zmetadata",
                     lambda _: {"metadata": {"lat/.zarray": {"filters": [{"id": "pickle"}]}}}),
    "format 3": ("zarr.json", lambda m: m | {"codecs": [{"name": "numcodecs.pickle"}]}),
    "format 3 by name alone": (
        ("zarr.json", lambda m: m | {"codecs": ["bytes", "numcodecs.pickle"]})
    ),
    "a shard's codec": ("zarr.json", lambda m: m | {"codecs": [INNER]}),
    "a shard's index": ("zarr.json",
        lambda m: m | {"codecs": [INNER | {"configuration": {"index_codecs": [{"name": "x"}]}}]}),
    "consolidated in format 3": ("../zarr.json", lambda m: m | {
        "consolidated_metadata": {"metadata": {"lat": {"codecs": [{"name": "pickle"}]}}}}),
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE)
def test_codecs_that_are_not_on_the_list_are_refused(tmp_path, ocean, message_of, case):
    pytest.importorskip("zarr")
    name, change = HOSTILE[case]
    ocean.drop_attrs().to_zarr(
        tmp_path / "o.zarr", zarr_format=3 if "json" in name else 2, consolidated=False
    )
    file = tmp_path / "o.zarr" / "lat" / name
    file.write_text(json.dumps(change(json.loads(file.read_text()) if file.exists() else {})))
    assert re.search(
        "codec .* is not allowed because it could execute data", message_of(tmp_path / "o.zarr")
    )


@pytest.mark.parametrize("kind", [2, 3])
def test_usual_codecs_are_read_and_attributes_may_say_anything(tmp_path, ocean, kind):
    zarr = pytest.importorskip("zarr")
    numcodecs = pytest.importorskip("numcodecs")
    codecs = {
        2: {"compressors": numcodecs.Zlib(4), "filters": [numcodecs.Shuffle(8)]},
        3: {"compressors": zarr.codecs.ZstdCodec(), "chunks": (3, 2, 3), "shards": (3, 6, 6)},
    }
    ocean["salinity"].attrs["codecs"] = "pickle"
    encoding = dict.fromkeys(("water_temp", "salinity"), codecs[kind])
    ocean.to_zarr(tmp_path / "o.zarr", zarr_format=kind, consolidated=kind == 2, encoding=encoding)
    np.testing.assert_array_equal(open_ocean(tmp_path / "o.zarr")["salinity"], ocean["salinity"])


@pytest.mark.parametrize("kind", [2, 3])
def test_a_huge_chunk_is_refused_by_its_declared_size(tmp_path, ocean, message_of, kind):
    pytest.importorskip("zarr")
    ocean.drop_attrs().to_zarr(tmp_path / "o.zarr", zarr_format=kind, consolidated=False)
    file = tmp_path / "o.zarr" / "lat" / (".zarray" if kind == 2 else "zarr.json")
    metadata = json.loads(file.read_text())
    large = {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [10**9]}}}
    file.write_text(json.dumps(metadata | ({"chunks": [10**9]} if kind == 2 else large)))
    assert "lat: a chunk unpacks to 8.0 GB; the limit is 2 GB" in message_of(tmp_path / "o.zarr")


def test_zarr_metadata_that_are_damaged_are_refused(tmp_path, ocean, message_of):
    pytest.importorskip("zarr")
    ocean.drop_attrs().to_zarr(tmp_path / "o.zarr", zarr_format=3, consolidated=False)
    path = tmp_path / "o.zarr" / "lon" / "zarr.json"
    whole = json.loads(path.read_text())
    many, unknown = whole | {"shape": "many"}, whole | {"codecs": [{"name": "exec"}]}
    for text, line in (
        (json.dumps(many), "cannot be read"),
        (json.dumps(unknown), "'exec' is not allowed"),
        ("{" * 5000, "cannot be read"),
    ):
        path.write_text(text)
        assert line in message_of(tmp_path / "o.zarr")
    (tmp_path / "empty").mkdir()
    assert "not a zarr group" in message_of(tmp_path / "empty")


def with_attribute(name, **attrs):
    return lambda o: o.assign({name: o[name].assign_attrs(**attrs)})


def with_time(value, units):
    return lambda o: o.assign_coords(time=((), value, {"units": units}))


STRANGE = {
    "strings for numbers": lambda o: o.assign(water_temp=o["water_temp"].astype(str)),
    "a string axis": lambda o: o.assign_coords(lat=[f"{v:g}N" for v in o["lat"].values]),
    "an axis that is not finite": lambda o: o.assign_coords(lon=o["lon"] * np.nan),
    "an infinite axis": lambda o: o.assign_coords(depth=[0.0, 10.0, np.inf]),
    "no points": lambda o: o.isel(lat=slice(0, 0)),
    "no levels": lambda o: o.isel(depth=slice(0, 0)),
    "no times": lambda o: o.expand_dims("time").isel(time=slice(0, 0)),
    "nothing but attributes": lambda o: o[[]],
    "units that are a number": with_attribute("water_u", units=3),
    "a standard_name that is a list": (
        lambda o: with_attribute("s", standard_name=[1, 2])(o.rename(salinity="s"))
    ),
    "values beyond numbers": lambda o: o.assign(salinity=o["salinity"] * 1e300),
    "infinite scale": with_attribute("salinity", scale_factor=np.inf),
    "time beyond years": with_time(1e300, "days since 2000-01-01"),
    "time since never": with_time(1.0, "days since never"),
    "time of text": lambda o: o.assign_coords(time="yesterday"),
}  # fmt: skip


@pytest.mark.parametrize("case", STRANGE)
def test_strange_data_sets_are_refused_in_one_line(tmp_path, ocean, case, message_of):
    STRANGE[case](ocean).to_netcdf(tmp_path / "strange.nc", engine="netcdf4")
    assert message_of(tmp_path / "strange.nc").startswith("strange.nc: ")


@pytest.mark.parametrize(("attribute", "value", "words"), [
    ("scale_factor", 0.0, ("salinity: scale_factor is 0, so all values would be equal; correct the"
                          " attribute")),
    ("scale_factor", np.nan, ("salinity: scale_factor is 'nan'; it must be one finite number;"
                             " correct the attribute")),
    ("scale_factor", [1.0, 2.0],
     "salinity: scale_factor is '[1. 2.]'; it must be one finite number"),
    ("scale_factor", "a tenth",
     "salinity: scale_factor is 'a tenth'; it must be one finite number"),
    ("add_offset", np.inf, "salinity: add_offset is 'inf'; it must be one finite number"),
])  # fmt: skip
def test_packing_that_makes_no_values_is_refused_by_its_name(
    tmp_path, ocean, message_of, attribute, value, words, as_stored
):
    with_attribute("salinity", **{attribute: value})(ocean).to_netcdf(
        tmp_path / "packed.nc", engine="netcdf4"
    )
    assert message_of(tmp_path / "packed.nc").startswith(f"packed.nc: {words}")
    (finding,) = check_ocean(tmp_path / "packed.nc")
    assert words in str(finding)
    as_stored(finding)


@pytest.mark.parametrize("name", ["title", "source", "history", "institution"])
def test_an_attribute_that_is_a_list_is_no_text_and_harms_nothing(tmp_path, ocean, name, as_stored):
    ocean.assign_attrs({name: [1, 2, 3]}).to_netcdf(tmp_path / "listed.nc", engine="netcdf4")
    back = open_ocean(tmp_path / "listed.nc")
    xr.testing.assert_equal(back, ocean)
    assert back.attrs["source"]
    as_stored(back)


def test_a_list_in_the_place_of_a_flag_is_not_taken_for_one(tmp_path, ocean, message_of):
    ocean.assign_attrs(synthetic=[1, 2, 3]).to_netcdf(tmp_path / "listed.nc", engine="netcdf4")
    assert "attribute (synthetic): array([1, 2, 3]); allowed 0 or 1" in message_of(
        tmp_path / "listed.nc"
    )


@pytest.mark.slow
def test_a_field_that_compresses_well_is_read_whatever_its_size(tmp_path, closed_form_ocean):
    """More than 64 MiB of numbers for each variable in a file of some hundred kilobytes."""
    ocean = closed_form_ocean(
        30.0, 10.0, temperature=lambda *_: 4.0, n=(600, 600), depth=np.arange(24.0)
    )
    ocean.to_netcdf(
        tmp_path / "even.nc",
        engine="netcdf4",
        encoding={n: {"zlib": True} for n in ocean.data_vars},
    )
    assert (tmp_path / "even.nc").stat().st_size < 2e6
    assert open_ocean(tmp_path / "even.nc").sizes == ocean.sizes


def test_more_than_the_machine_holds_is_refused_with_the_remedy(
    tmp_path, ocean, monkeypatch, message_of
):
    write_netcdf(ocean, tmp_path / "own.nc")
    monkeypatch.setattr("pymantaray.ocean.files.MEMORY_SHARE", 1e-12)
    assert "read a window" in message_of(tmp_path / "own.nc")


def test_threads_open_files_at_the_same_time(tmp_path, ocean):
    """The C library behind netCDF4 holds one state for all threads."""
    paths = [tmp_path / f"{i}.nc" for i in range(4)]
    for i, path in enumerate(paths):
        write_netcdf(ocean.assign_attrs(title=f"ocean {i}"), path)
    with ThreadPoolExecutor(8) as pool:
        titles = [o.attrs["title"] for o in pool.map(open_ocean, paths * 3)]
    assert titles == [f"ocean {i}" for i in range(4)] * 3


def test_addresses_are_not_files_and_their_passwords_are_not_told(message_of, as_stored):
    message = message_of("https://user:secret@tds.hycom.org/thredds/dodsC/GLBy0.08/expt_93.0")
    assert "https://tds.hycom.org/thredds" in message
    assert "mantaray ocean fetch" in message
    for address in ("http://user:secret@[::1/x", Path("/here/https:/user:secret@host/x")):
        (finding,) = check_ocean(address)
        assert "a URL" in finding.value
        assert "secret" not in finding.value
    as_stored(finding)
