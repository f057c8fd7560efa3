"""Records: conversion, freezing, round trips through NetCDF, and every message."""

from dataclasses import FrozenInstanceError, dataclass, fields
from typing import ClassVar

import numpy as np
import pytest
import xarray as xr
from factories import make_arrivals
from refusals import refused

import pymantaray.acoustics.bellhop.output
import pymantaray.acoustics.loss
import pymantaray.sensing  # noqa: F401  whose records are among the kinds
from pymantaray.errors import RecordError
from pymantaray.estimation import FactorGraph
from pymantaray.records import Arrivals, Estimates, Measurements, RayStatus, Trajectories, read_netcdf
from pymantaray.records.base import Column, Record, column

# its tables are its own
KINDS = sorted({*Record.__subclasses__()} - {FactorGraph}, key=lambda kind: kind.kind)
FIXED = {"axis": 3, "quat": 4, "tangent": 6}
NAMES = ["A", "Zoë", "a longer name", "浮", "E"]


@dataclass(frozen=True, eq=False)
class Pair(Record):
    kind: ClassVar[str] = "pair"

    name: Column = column("item", "", "name", "U")
    size: Column = column("item", "m", "size")
    count: Column = column("item axis", "1", "count", "i2")


def pair(**changed):
    return Pair(**({"name": ["a", "b"], "size": [1, 2], "count": np.ones((2, 3))} | changed))


def filled(kind, empty=()):
    """Build a record of any kind with random columns; the dimensions named in `empty` have length 0."""
    rng = np.random.default_rng(0)
    sizes = dict(FIXED)
    columns = {}
    for f in fields(kind):
        shape = [sizes.setdefault(d, 0 if d in empty else 2 + len(sizes) % 3) for d in f.metadata["dims"]]
        dtype = f.metadata["dtype"]
        if dtype == "U":
            columns[f.name] = np.array(NAMES[: shape[0]], dtype=str)
        elif dtype.startswith("i"):
            columns[f.name] = rng.integers(-3, 100, shape)
        else:
            columns[f.name] = rng.standard_normal(shape)
            columns[f.name].flat[:1] = np.nan
    return kind(**columns)


def assert_equal(one, two):
    for f in fields(one):
        a, b = getattr(one, f.name), getattr(two, f.name)
        assert a.dtype.kind == b.dtype.kind
        if a.dtype.kind != "U":
            assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b, err_msg=f.name)


EMPTY = [
    (Measurements, ("landmark",)),
    (Measurements, ("fix", "range", "landmark", "attitude")),
    (Arrivals, ("arrival", "n_links")),
    (Estimates, ("landmark", "realization")),
]


@pytest.mark.parametrize(("kind", "empty"), [*((kind, ()) for kind in KINDS), *EMPTY])
def test_a_file_keeps_every_bit_and_says_what_it_holds_and_in_which_units(kind, empty, tmp_path):
    record = filled(kind, empty)
    for _ in range(2):  # saving again replaces
        record.save(tmp_path / "record.nc")
    assert_equal(kind.load(tmp_path / "record.nc"), record)
    assert [p.name for p in tmp_path.iterdir()] == ["record.nc"]
    data = read_netcdf(tmp_path / "record.nc", decode_times=False)
    assert data.attrs["mantaray_record"] == kind.kind
    for f in fields(kind):
        assert data[f.name].dims == f.metadata["dims"]
        assert data[f.name].attrs["long_name"] == f.metadata["long_name"]
        assert data[f.name].attrs.get("units", "") == f.metadata["units"]


def test_fields_are_converted_copied_and_frozen():
    size = np.array([1.0, 2.0])
    record = pair(size=size)
    size[0] = 99.0
    np.testing.assert_array_equal(record.size, [1.0, 2.0])
    assert record.size.dtype == np.float64
    assert record.count.dtype == np.int16
    with pytest.raises(ValueError, match="read-only"):
        record.size[0] = 5.0
    with pytest.raises(FrozenInstanceError):
        record.size = size


@pytest.mark.parametrize(("changed", "message"), [
    ({"size": ["one", "two"]}, "pair: size is not an array of type f8"),
    ({"size": [[1], [1, 2]]}, "pair: size is not an array of type f8"),
    ({"size": 1.0}, r"pair: size has shape \(\); needs dimensions \('item',\)"),
    ({"count": [1, 2]}, r"pair: count has shape \(2,\); needs dimensions \('item', 'axis'\)"),
    ({"size": [1, 2, 3]}, "pair: size has 3 along 'item', other fields have 2"),
    ({"count": np.full((2, 3), 40_000)}, "pair: count holds values that do not fit type i2"),
    ({"count": np.full((2, 3), np.nan)}, "pair: count holds values that do not fit type i2"),
    ({"count": np.full((2, 3), 0.5)}, "pair: count holds values that do not fit type i2"),
])  # fmt: skip
def test_bad_columns_are_refused_in_one_line(changed, message):
    refused(RecordError, message, pair, **changed)


@pytest.mark.parametrize("keep", [0, 10, 0.3, 0.7, 0.95])
def test_truncated_file(keep, tmp_path):
    path = tmp_path / "cut.nc"
    filled(Measurements).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: keep if isinstance(keep, int) else int(keep * len(content))])
    refused(RecordError, r"cut\.nc: not a readable NetCDF file", Measurements.load, path)


def test_file_damaged_inside(tmp_path):
    """The header opens, the data do not: compressed blocks are overwritten."""
    path = tmp_path / "bad.nc"
    encoding = {"size": {"zlib": True, "fletcher32": True, "chunksizes": (1000,)}}
    values = np.random.default_rng(0).standard_normal(100_000)
    xr.Dataset({"size": ("item", values)}, attrs={"mantaray_record": "pair"}).to_netcdf(
        path, engine="netcdf4", encoding=encoding
    )
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 50_000] = bytes(50_000)
    path.write_bytes(content)
    refused(RecordError, r"bad\.nc: not a readable NetCDF file", Pair.load, path)


def test_another_kind_of_file_or_data_set_is_refused(tmp_path):
    pair().save(tmp_path / "p.nc")
    with pytest.raises(RecordError, match=r"p\.nc: data set holds 'pair'; needs 'trajectories'"):
        Trajectories.load(tmp_path / "p.nc")
    refused(RecordError, "data set holds None; needs 'pair'", Pair.from_dataset, xr.Dataset())
    with pytest.raises(RecordError, match="pair: data set lacks name, count"):
        Pair.from_dataset(pair().to_dataset().drop_vars(["name", "count"]))


def test_first_arrival_of_each_link():
    vector = np.arange(9.0).reshape(3, 3)
    arrivals = make_arrivals(
        [1, 1, 2],
        [RayStatus.SHADOW, RayStatus.OK, RayStatus.OK],
        travel_time=[2.0, 2.5, 1.0],
        source_slowness=vector,
        receiver_slowness=-vector,
        chord_travel_time=[1, 2, 3],
    )
    first = arrivals.first()
    np.testing.assert_array_equal(first.travel_time, [np.nan, 2.0, 1.0])
    np.testing.assert_array_equal(first.source_slowness, [[np.nan] * 3, vector[0], vector[2]])
    np.testing.assert_array_equal(first.receiver_slowness, [[np.nan] * 3, -vector[0], -vector[2]])
    np.testing.assert_array_equal(first.status, arrivals.status)
    np.testing.assert_array_equal(first.chord_travel_time, [1, 2, 3])
