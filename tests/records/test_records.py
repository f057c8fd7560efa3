"""Records: conversion, freezing, round trips through NetCDF, and every message."""

from dataclasses import FrozenInstanceError, dataclass, fields, replace
from typing import ClassVar

import numpy as np
import pytest
import xarray as xr
from factories import make_arrivals
from oracles import cf_errors
from refusals import refused

import pymantaray.acoustics.levels.loss
import pymantaray.apps.bellhop.output
import pymantaray.sensing  # noqa: F401  whose records are among the kinds
from pymantaray.errors import RecordError
from pymantaray.estimation import FactorGraph
from pymantaray.geometry import LocalFrame
from pymantaray.records import (
    Arrivals,
    Estimates,
    Measurements,
    PoseCovariances,
    RangingTruth,
    RayStatus,
    Trajectories,
    read_netcdf,
    write_netcdf,
)
from pymantaray.records.base import LABELS, Column, DatedRecord, Record, column

SUBCLASSES = {*Record.__subclasses__(), *DatedRecord.__subclasses__()} - {DatedRecord}
KINDS = sorted(  # a graph has tables of its own, a ping of the service has records
    (
        kind
        for kind in SUBCLASSES
        if kind is not FactorGraph and kind.__module__ != "pymantaray.apps.service.ranging_service"
    ),
    key=lambda kind: kind.kind,
)
START = np.datetime64("2014-07-15T12:00:00.250000")
NAMES = ["A", "Zoë", "a longer name", "浮", "E"]


@dataclass(frozen=True, eq=False)
class Pair(Record):
    kind: ClassVar[str] = "pair"

    name: Column = column("item", "", "name", "U", labels=True)
    size: Column = column("item", "m", "size")
    count: Column = column("item axis", "1", "count", "i2")


def pair(**changed):
    return Pair(**({"name": ["a", "b"], "size": [1, 2], "count": np.ones((2, 3))} | changed))


def filled(kind, empty=()):
    """
    Build a record of any kind with random columns; the dimensions named in `empty` have length 0.
    """
    rng = np.random.default_rng(0)
    sizes = {name: len(labels) for name, labels in LABELS.items()}
    columns = {"start": START} if issubclass(kind, DatedRecord) else {}
    if kind is Trajectories:
        columns["centre"] = 74.5, -140.0
    for f in kind._columns():
        shape = [
            sizes.setdefault(d.removesuffix("_column"), 0 if d in empty else 2 + len(sizes) % 3)
            for d in f.metadata["dims"]
        ]
        dtype = f.metadata["dtype"]
        if dtype == "U":
            columns[f.name] = np.array(NAMES[: shape[0]], dtype=str)
        elif dtype.kind == "i":
            columns[f.name] = rng.integers(-3, 100, shape)
        else:
            columns[f.name] = rng.standard_normal(shape)
            columns[f.name].flat[:1] = np.nan
    return kind(**columns)


def assert_equal(one, two):
    for f in fields(one):
        a, b = getattr(one, f.name), getattr(two, f.name)
        if f.name == "centre":
            assert a == b
            continue
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
def test_a_file_keeps_every_bit_and_names_its_content_and_units(kind, empty, tmp_path):
    record = filled(kind, empty)
    for _ in range(2):  # saving again replaces
        record.save(tmp_path / "record.nc")
    loaded = kind.load(tmp_path / "record.nc")
    for f in kind._columns():
        step, digits = f.metadata["step"], f.metadata["digits"]
        if step or digits:  # columns that a file holds with a stated precision
            own, other = getattr(record, f.name), getattr(loaded, f.name)
            scale = 0.5 * np.asarray(step) if step else 0.5 * 10.0 ** (1 - digits) * np.abs(other)
            assert (np.isnan(own) == np.isnan(other)).all()
            allowed = scale * (1.0 + 1e-6) + 1e-7 * (own.dtype == "f4")
            assert ((np.abs(own - other) <= allowed) | np.isnan(own)).all(), f.name
            loaded = replace(loaded, **{f.name: own})
    assert_equal(loaded, record)
    assert [p.name for p in tmp_path.iterdir()] == ["record.nc"]
    data = read_netcdf(tmp_path / "record.nc", decode_times=False)
    assert data.attrs["mantaray_record"] == kind.kind
    for f in kind._columns():
        name = f.metadata["dims"][0] if f.metadata["labels"] else f.name
        assert data[name].dims == f.metadata["dims"]
        assert data[name].attrs["long_name"] == f.metadata["long_name"]
        assert f.name == "time" or data[name].attrs.get("units", "") == f.metadata["units"]


def test_packed_columns_keep_large_values_and_unit_quaternions(tmp_path):
    """Values beyond 32 bits of steps stay as they are; rounded quaternions have length one."""
    own = filled(Estimates)
    turn = np.array([0.6, 0.0, -0.48, 0.64])
    small = replace(own, quaternion=np.broadcast_to(turn, own.quaternion.shape))
    small.save(tmp_path / "small.nc")
    read = Estimates.load(tmp_path / "small.nc").quaternion.astype(float)
    np.testing.assert_allclose(np.linalg.norm(read, axis=-1), 1.0, rtol=0, atol=2e-7)
    np.testing.assert_allclose(read, small.quaternion, rtol=0, atol=1e-5)
    far = replace(own, position=own.position + 1e7)
    far.save(tmp_path / "far.nc")
    np.testing.assert_array_equal(Estimates.load(tmp_path / "far.nc").position, far.position)
    with xr.open_dataset(tmp_path / "small.nc") as data:
        assert data.position.encoding["scale_factor"] == 2e-4
        assert data.position.encoding["dtype"] == np.int32


def test_long_variables_are_compressed_and_keep_every_bit(tmp_path):
    values = np.random.default_rng(1).normal(size=20000)
    time = np.datetime64("2024-01-01T00:00:00.123456789") + np.arange(20000) * np.timedelta64(
        1, "ns"
    )
    data = xr.Dataset({"x": ("t", np.round(values, 1)), "y": ("t", values)}, {"t": time})
    write_netcdf(data, tmp_path / "x.nc")
    assert (tmp_path / "x.nc").stat().st_size < 0.8 * data.nbytes
    read = read_netcdf(tmp_path / "x.nc")
    for name in data.variables:
        np.testing.assert_array_equal(read[name], data[name])
    write_netcdf(read, tmp_path / "again.nc")  # with the encoding of a file
    np.testing.assert_array_equal(read_netcdf(tmp_path / "again.nc")["y"], values)


def test_labels_flags_and_dates_are_what_xarray_selects_by(tmp_path):
    truth = replace(filled(Trajectories), name=["A", "B", "C"], time=[0.0, 200.0, 400.5, 600.0])
    truth.save(tmp_path / "truth.nc")
    with xr.open_dataset(tmp_path / "truth.nc") as data:
        down = data.position.sel(vehicle="B", axis="down", time="2014-07-15T12:06:40.75")
        assert down == truth.position[1, 2, 2]
        np.testing.assert_array_equal(
            data.quaternion.sel(vehicle="C", quat="w"), truth.quaternion[2, :, 0]
        )
        flags = dict(
            zip(data.status.flag_meanings.split(), data.status.flag_values.tolist(), strict=True)
        )
        assert flags == {"ACTIVE": 0, "GROUNDED": 1, "LEFT_DOMAIN": 2, "ABSENT": 3}
        assert data.status.flag_values.dtype == data.status.dtype
        north, east = LocalFrame(74.5, -140.0).to_local(data.latitude, data.longitude)
        np.testing.assert_allclose(
            np.stack([north, east], -1)[1:], truth.position[1:, :, :2], atol=1e-6
        )
        np.testing.assert_array_equal(
            Trajectories.from_dataset(data).time, truth.time
        )  # decoded, to a nanosecond
        assert Trajectories.from_dataset(data).start == START
    unsaved = truth.to_dataset()
    np.testing.assert_array_equal(unsaved.position.sel(vehicle="B"), truth.position[1])
    assert unsaved.time.attrs["units"] == "seconds since 2014-07-15T12:00:00.250000"


def test_a_mission_without_a_date_counts_from_its_start(tmp_path):
    truth = replace(filled(Trajectories), start=np.datetime64("NaT", "us"), centre=None)
    truth.save(tmp_path / "truth.nc")
    with xr.open_dataset(tmp_path / "truth.nc") as data:
        assert data.time.attrs == {"units": "s", "long_name": "time since the start of the mission"}
        np.testing.assert_array_equal(data.time, truth.time)
        assert "latitude" not in data.variables
    again = Trajectories.load(tmp_path / "truth.nc")
    assert np.isnat(again.start)
    assert again.centre is None


def test_rows_and_columns_of_covariances_have_the_same_labels():
    names, data = NAMES[:2], filled(PoseCovariances).to_dataset()
    assert data.vehicle_column.values.tolist() == data.vehicle.values.tolist() == names
    assert data.axis_column.values.tolist() == ["north", "east", "down"]
    pair = data.position_covariance.sel(
        vehicle=names[0], axis="north", vehicle_column=names[1], axis_column="down"
    )
    assert pair.dims == ("condition", "realization", "epoch")


def test_a_column_with_a_default_has_it_everywhere_and_is_in_files():
    true = RangingTruth([1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0])
    assert true.near_cutoff.tolist() == [0, 0]
    assert np.isnan(true.departure_angle).all()
    marked = RangingTruth([1.0], [2.0], [3.0], [4.0], [1])
    assert RangingTruth.from_dataset(marked.to_dataset()).near_cutoff.tolist() == [1]
    lacking = marked.to_dataset().drop_vars("near_cutoff")
    refused(RecordError, "no near_cutoff", RangingTruth.from_dataset, lacking)


def test_a_short_representation_counts_in_words():
    assert repr(filled(Measurements)) == (
        "<Measurements: 3 vehicles, 4 times, 2 edges, 3 fixes, 4 landmarks, 2 ranges, 3 attitudes,"
        " 4 DVL samples, 2 altitudes>"
    )
    assert repr(make_arrivals([0, 1], status=(0, 0))) == "<Arrivals: 2 arrivals, 2 links>"


def test_a_print_of_arrivals_says_why_links_have_none():
    some = make_arrivals([0, 3], status=(0, 1, 4, 0, 1))
    assert repr(some) == "<Arrivals: 2 arrivals, 5 links (2 shadow, 1 too weak)>"
    assert repr(some.first()) == "<FirstArrivals: 5 links (2 shadow, 1 too weak)>"
    assert repr(make_arrivals([], status=(3,))) == (
        "<Arrivals: 0 arrivals, 1 link (1 outside the domain)>"
    )


def test_times_in_another_unit_are_refused(tmp_path):
    data = filled(Trajectories).to_dataset()
    data["time"].attrs["units"] = "hours since 2014-07-15"
    data.to_netcdf(tmp_path / "hours.nc")
    refused(
        RecordError,
        r"hours\.nc: trajectories: time is in 'hours since 2014-07-15'; it must be in seconds"
        r" since the start",
        Trajectories.load,
        tmp_path / "hours.nc",
    )


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


def test_records_share_an_array_only_if_nobody_can_write_it(tmp_path):
    record = pair(size=np.array([1.0, 2.0]))
    assert np.shares_memory(replace(record, name=["a", "b"]).size, record.size)
    owner = np.array([0.0, 1.0, 2.0])
    view = owner[1:]
    view.setflags(write=False)  # the owner can still write it
    later = pair(size=view)
    owner[1:] = 99.0
    np.testing.assert_array_equal(later.size, [1.0, 2.0])
    buffer = bytearray(record.size.tobytes())
    view = np.frombuffer(buffer)
    view.setflags(write=False)
    later = pair(size=view)
    buffer[:] = bytes(len(buffer))
    np.testing.assert_array_equal(later.size, [1.0, 2.0])
    record.save(tmp_path / "pair.nc")
    with pytest.raises(ValueError, match="read-only"):
        Pair.load(tmp_path / "pair.nc").size[0] = 5.0


@pytest.mark.parametrize(("changed", "message"), [
    ({"size": ["one", "two"]}, "pair: size is not an array of type f8"),
    ({"size": [[1], [1, 2]]}, "pair: size is not an array of type f8"),
    ({"size": 1.0}, r"pair: size has shape \(\); it must have dimensions \('item',\)"),
    ({"count": [1, 2]}, (r"pair: count has shape \(2,\); it must have dimensions \('item',"
                        r" 'axis'\)")),
    ({"size": [1, 2, 3]}, "pair: size has length 3 along 'item'; it must be 2"),
    ({"count": np.ones((2, 2))}, "pair: count has length 2 along 'axis'; it must be 3"),
    ({"count": np.full((2, 3), 40_000)}, "pair: count has values that do not fit type i2"),
    ({"count": np.full((2, 3), np.nan)}, "pair: count has values that do not fit type i2"),
    ({"count": np.full((2, 3), 0.5)}, "pair: count has values that do not fit type i2"),
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
    with pytest.raises(
        RecordError, match=r"p\.nc: data set contains 'pair'; it must be 'trajectories'"
    ):
        Trajectories.load(tmp_path / "p.nc")
    refused(
        RecordError, "data set contains None; it must be 'pair'", Pair.from_dataset, xr.Dataset()
    )
    with pytest.raises(RecordError, match="pair: the data set has no name, count"):
        Pair.from_dataset(pair().to_dataset().drop_vars(["item", "count"]))


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


@pytest.mark.slow
def test_files_of_a_run_and_of_every_kind_of_record_comply_with_cf(tiny_run_folder, tmp_path):
    files = sorted(tiny_run_folder.glob("*.nc"))
    assert len(files) >= 9
    for kind in KINDS:
        data = filled(kind).to_dataset()
        for name in data.indexes:  # which have to rise
            if data[name].dtype.kind != "U":
                data[name] = data[name].copy(
                    data=np.arange(data.sizes[name], dtype=data[name].dtype)
                )
        files.append(tmp_path / f"{kind.kind}.nc")
        write_netcdf(data, files[-1])
    assert not cf_errors(files)
    xr.Dataset({"depth": ("x", [1.0], {"units": "fathom-ish"})}).to_netcdf(tmp_path / "wrong.nc")
    assert "fathom-ish" in cf_errors([tmp_path / "wrong.nc"])
