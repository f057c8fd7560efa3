"""
Atlases of files: every column where it belongs, the same whoever computes it and in whatever
pieces, nothing computed twice.
"""

import os
import subprocess
import sys
from contextlib import suppress
from functools import partial

import cf_xarray  # noqa: F401  the accessor .cf
import factories
import numpy as np
import pytest
import xarray as xr
from oracles import cf_errors
from refusals import refused

from pymantaray.apps.atlas import (
    Atlas,
    AtlasLinks,
    blocks,
    open_atlas,
    plan,
    run_atlas,
    runner,
    safety_table,
)
from pymantaray.apps.atlas.blocks import EDGE, LAND, WATER, column_errors, medium_at
from pymantaray.apps.atlas.plan import instants_between
from pymantaray.errors import AtlasError, JobError, OceanError, WriteError
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.records import RayStatus

ZLIB = b"\x78\x5e"  # first bytes of a compressed chunk


@pytest.fixture(scope="module")
def coarse(file, links, tmp_path_factory):
    """Atlas of every twentieth column; not to be written to."""
    path = tmp_path_factory.mktemp("coarse") / "atlas.nc"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "open_pool", factories.pool_here)
        return run_atlas(Atlas(file, links, every=20), path)


@pytest.fixture(scope="module")
def two_blocks(ocean, file, links, tmp_path_factory):
    """Content of the atlas of twelve columns in two blocks."""
    path = tmp_path_factory.mktemp("two") / "whole.nc"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "open_pool", factories.pool_here)
        patch.setattr(plan, "_COLUMNS", 3)
        return run_atlas(Atlas(file, links, window=_window(ocean, 10, 11, 10, 15)), path)


@pytest.fixture
def here(monkeypatch):
    """Do blocks in this process, and count them."""
    done = []

    def open_counting(work, *_):
        def run(block):
            done.append(block.key)
            return work(block)

        return factories.pool_here(run)

    monkeypatch.setattr(runner, "open_pool", open_counting)
    return done


def test_every_column_is_where_it_belongs(here, ocean, file, links, content, tiles, tmp_path):
    atlas = Atlas(file, links, every=9, window=_window(ocean, 4, 31, 0, 51))
    own = content(run_atlas(atlas, tmp_path / "atlas.nc"))
    assert atlas.shape == (1, 4, 6)
    assert len(here) == 4
    np.testing.assert_array_equal(own["lat"], ocean["lat"][4::9])
    np.testing.assert_array_equal(own["lon"], ocean["lon"][4::9])
    status = own["column_status"].values[0]
    expected = np.full((4, 6), WATER)
    expected[-1] = EDGE  # the last row: nothing lies beyond
    expected[2, 3] = EDGE
    expected[~np.isfinite(ocean["water_temp"][0, 4::9, 4::9].values)] = LAND
    np.testing.assert_array_equal(status, expected)
    for i, j in ((0, 0), (1, 4), (2, 5)):
        place = float(own["lat"][i]), float(own["lon"][j])
        alone = column_errors(medium_at(GridPoints.of(ocean), place, links), links)
        for name, values in alone._asdict().items():
            np.testing.assert_array_equal(own[name].values[0, i, j], values.astype(own[name].dtype))


def test_land_and_edge_are_told_apart(here, ocean, file, links, content, tmp_path):
    own = content(
        run_atlas(
            Atlas(file, links, every=1, window=_window(ocean, 0, 2, 24, 30)), tmp_path / "a.nc"
        )
    )
    assert (own["column_status"].values[0, 0] == EDGE).all()  # 3 km do not fit beside the first row
    own = content(
        run_atlas(Atlas(file, links, window=_window(ocean, 20, 22, 24, 27)), tmp_path / "b.nc")
    )
    np.testing.assert_array_equal(own["column_status"].values[0], [[WATER, WATER, LAND, LAND]] * 3)
    for name in ("range_error", "no_direct_path", "safe_distance"):
        assert np.isnan(own[name].values[0, :, 2:]).all()


def _window(ocean, south, north, west, east):
    """Window of rows and columns, both included."""
    lat, lon = ocean["lat"].values, ocean["lon"].values
    return lat[south] - 1e-3, lat[north] + 1e-3, lon[west] - 1e-3, lon[east] + 1e-3


def test_two_halves_joined_are_the_whole(
    here, ocean, file, links, content, two_blocks, tiles, tmp_path
):
    whole = content(two_blocks)
    halves = [
        content(
            run_atlas(
                Atlas(file, links, window=_window(ocean, 10, 11, *part)), tmp_path / f"{part[0]}.nc"
            )
        )
        for part in ((10, 11), (12, 15))
    ]
    joined = xr.concat(halves, "lon", data_vars="minimal", coords="minimal")
    for name in whole.data_vars:
        if "lat" in whole[name].dims and "lon" in whole[name].dims:
            np.testing.assert_array_equal(whole[name], joined[name], err_msg=name)
    np.testing.assert_array_equal(whole["lon"], joined["lon"])


@pytest.mark.slow
def test_workers_and_tiles_change_no_digit(
    ocean, file, links, content, tiles, monkeypatch, tmp_path
):
    atlas = Atlas(file, links, window=_window(ocean, 10, 11, 10, 15))
    workers = run_atlas(atlas, tmp_path / "workers.nc", workers=2)
    monkeypatch.setattr(runner, "open_pool", factories.pool_here)
    alone = run_atlas(atlas, tmp_path / "alone.nc")
    assert workers.read_bytes() == alone.read_bytes()
    monkeypatch.setattr(plan, "_COLUMNS", 50)
    other = Atlas(file, links, window=_window(ocean, 10, 11, 10, 15))
    assert len(other.blocks) == 1
    one, two = content(alone), content(run_atlas(other, tmp_path / "other.nc"))
    assert one.drop_attrs(deep=False).identical(two.drop_attrs(deep=False))


def test_a_finished_block_is_not_computed_again(
    here, ocean, file, links, two_blocks, tiles, tmp_path
):
    atlas, out = Atlas(file, links, window=_window(ocean, 10, 11, 10, 15)), tmp_path / "atlas.nc"
    whole = two_blocks.read_bytes()

    class StopError(Exception):
        pass

    def stop(done, _failed, _total):
        if done == 1:
            raise StopError

    with pytest.raises(StopError):
        run_atlas(atlas, out, progress=stop)
    assert len(here) == 1
    assert not out.exists()
    told = []
    assert run_atlas(atlas, out, progress=lambda *counts: told.append(counts)).read_bytes() == whole
    assert len(here) == len(set(here)) == len(atlas.blocks) == 2
    assert told[0] == (1, 0, 2)
    assert [path.name for path in tmp_path.iterdir()] == ["atlas.nc"]
    run_atlas(atlas, out)  # there already
    assert len(here) == 2


def test_blocks_left_by_a_stop_at_the_end_are_removed(
    here, ocean, file, links, monkeypatch, tmp_path
):
    atlas, out = Atlas(file, links, every=20), tmp_path / "atlas.nc"
    with monkeypatch.context() as patch:
        patch.setattr(runner, "_clear", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run_atlas(atlas, out)
    marker = tmp_path / "atlas.nc.blocks" / "atlas.json"
    own = marker.read_bytes()
    marker.write_bytes(b"of another atlas")
    run_atlas(atlas, out)
    assert marker.parent.is_dir()
    marker.write_bytes(own)
    run_atlas(atlas, out)
    assert [path.name for path in tmp_path.iterdir()] == ["atlas.nc"]


@pytest.mark.parametrize("name", ["lat", "range_error"])
def test_a_damaged_number_of_an_atlas_is_one_line(coarse, tmp_path, name):
    """A coordinate, which is not compressed, or a variable, which is."""
    out = tmp_path / "atlas.nc"
    content = bytearray(coarse.read_bytes())
    with open_atlas(coarse) as atlas:
        number = atlas["lat"].values[-1:].tobytes()
    place = content.index(number) if name == "lat" else content.index(ZLIB) + 20
    content[place] ^= 1
    out.write_bytes(bytes(content))
    line = (
        "not a readable NetCDF file: NetCDF: " if name == "lat" else r"damaged: \w+ cannot be read"
    )
    refused(AtlasError, f"atlas.nc: {line}", open_atlas, out)


def test_a_block_under_the_name_of_another_is_computed_again(
    here, ocean, file, links, two_blocks, tiles, tmp_path, monkeypatch
):
    atlas, out = Atlas(file, links, window=_window(ocean, 10, 11, 10, 15)), tmp_path / "atlas.nc"
    whole = two_blocks.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(runner, "write_atlas", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run_atlas(atlas, out)
    one, other = (tmp_path / "atlas.nc.blocks" / "blocks").iterdir()
    one.write_bytes(other.read_bytes())
    refused(AtlasError, "a damaged block was removed; run the atlas again", run_atlas, atlas, out)
    other.unlink()
    other.symlink_to(other)
    assert run_atlas(atlas, out).read_bytes() == whole


def test_a_file_of_something_else_is_left_alone(here, file, links, tmp_path):
    out = tmp_path / "atlas.nc"
    out.write_text("thesis")
    atlas = Atlas(file, links, every=20)
    refused(
        WriteError,
        "already exists, from another atlas or version of the code; give another name or"
        " `force=True`",
        run_atlas,
        atlas,
        out,
    )
    assert out.read_text() == "thesis"
    run_atlas(atlas, out, force=True)
    other = Atlas(file, links, every=21)
    refused(WriteError, "already exists, from another atlas", run_atlas, other, out)
    (tmp_path / "b.nc.blocks").mkdir()
    (tmp_path / "b.nc.blocks" / "thesis.tex").write_text("x")
    refused(
        JobError,
        "this folder is not empty and has no atlas; give a new",
        run_atlas,
        atlas,
        tmp_path / "b.nc",
    )


def test_an_ocean_whose_content_has_changed_is_another_atlas(here, ocean, links, tmp_path):
    path = tmp_path / "ocean.nc"
    ocean.to_netcdf(path)
    before = Atlas(path, links, every=20)
    assert before.key == Atlas(path, links, every=20).key
    keys = {block.key for block in before.blocks}
    warmer = ocean.copy(deep=True)
    warmer["water_temp"] += 1.0
    warmer.to_netcdf(path)
    assert not keys & {block.key for block in Atlas(path, links, every=20).blocks}


def test_a_block_that_fails_is_told_when_the_others_are_done(
    here, ocean, links, tiles, monkeypatch, tmp_path
):
    path = tmp_path / "ocean.nc"
    sick = ocean.copy(deep=True)
    sick["water_temp"][3, 10, 8] = 99.0
    sick.to_netcdf(path)
    monkeypatch.setattr("pymantaray.apps.atlas.blocks.SPLINE", 1)
    monkeypatch.setattr(plan, "_GRID_MARGIN", 3)
    atlas = Atlas(path, links, window=_window(ocean, 10, 10, 8, 16))
    refused(
        AtlasError,
        "2 of 3 blocks failed, the first with: ocean: values .water_temp.: 1 of .* outside",
        run_atlas,
        atlas,
        tmp_path / "atlas.nc",
    )
    assert len(here) == 3
    left = list((tmp_path / "atlas.nc.blocks" / "blocks").iterdir())
    assert sum(file.suffix == ".npz" for file in left) == 1
    assert not (tmp_path / "atlas.nc").exists()


def test_a_damaged_block_is_removed_and_told(
    here, ocean, file, links, tiles, monkeypatch, tmp_path
):
    atlas, out = Atlas(file, links, window=_window(ocean, 10, 11, 10, 15)), tmp_path / "atlas.nc"
    with monkeypatch.context() as patch:
        patch.setattr(
            runner, "write_atlas", lambda *_, **__: (_ for _ in ()).throw(WriteError("full"))
        )
        refused(WriteError, "^full$", run_atlas, atlas, out)
    block = next((tmp_path / "atlas.nc.blocks" / "blocks").glob("*.npz"))
    block.write_bytes(block.read_bytes()[:-100])
    refused(
        AtlasError,
        "a damaged block was removed; run the atlas again",
        run_atlas,
        atlas,
        out,
    )
    assert len(here) == 2
    assert open_atlas(run_atlas(atlas, out)).attrs["atlas_key"] == atlas.key
    assert len(here) == 3


def test_workers_that_write_elsewhere_are_noticed(file, links, monkeypatch, tmp_path):
    away = blocks.run_block
    monkeypatch.setattr(
        runner,
        "open_pool",
        lambda *_: factories.pool_here(partial(away, str(tmp_path / "away"))),
    )
    atlas = Atlas(file, links, every=20)
    refused(
        JobError,
        "all workers must have access to this folder",
        run_atlas,
        atlas,
        tmp_path / "a.nc",
    )


def test_an_atlas_through_time_has_a_series_at_every_place(
    here, ocean, days, links, content, tmp_path, as_stored
):
    window = _window(ocean, 12, 12, 12, 13)
    times = instants_between(days, "2014-07-15", "2014-07-18")
    assert times.size == 3
    own = content(run_atlas(Atlas(days, links, window=window, times=times), tmp_path / "all.nc"))
    as_stored(own, without="_key")
    assert own["worst_range_error"].dims[:3] == ("time", "lat", "lon")
    for day in (0, 2):
        atlas = Atlas(days[day], links, window=window)
        alone = content(run_atlas(atlas, tmp_path / f"{day}.nc"))
        for name in ("range_error", "link_status", "safe_distance"):
            np.testing.assert_array_equal(own[name].isel(time=day), alone[name].isel(time=0))
        assert own["time"][day] == alone["time"][0]
    assert (np.diff(own["range_error"].values, axis=0) != 0.0).any()  # the water differs
    assert instants_between(days, "2014-07-15", "2014-07-18", 48.0).size == 2
    assert instants_between("synthetic:fram", "2014-07-15", "2014-07-18").size == 4
    refused(
        AtlasError, "the ocean has no time from", instants_between, days, "2015-01-01", "2015-02-01"
    )
    for source in (days, "synthetic:fram"):
        span = instants_between, source, "2014-07-18", "2014-07-15"
        refused(AtlasError, "the last is before the first", *span)
        for step in (0.0, -4.0, np.nan):
            refused(AtlasError, "it must be at least one second", *span[:2], *span[:1:-1], step)
    # each instant reads its own file alone
    assert [block.files for block in Atlas(days, links, window=window, times=times).blocks] == [
        (str(path),) for path in days
    ]


def test_a_sea_floor_of_its_own_is_taken(here, ocean, file, links, content, tmp_path):
    lat, lon = np.arange(77.0, 79.0, 0.02), np.arange(-2.5, 3.0, 0.04)
    floor = xr.Dataset({"elevation": (("lat", "lon"), np.full((lat.size, lon.size), -150.0))})
    floor = floor.assign_coords(
        lat=("lat", lat, ocean["lat"].attrs), lon=("lon", lon, ocean["lon"].attrs)
    )
    floor["elevation"].attrs = {"units": "m", "standard_name": "height_above_mean_sea_level"}
    floor.to_netcdf(tmp_path / "floor.nc")
    atlas = Atlas(
        file, links, window=_window(ocean, 12, 12, 12, 13), bathymetry=tmp_path / "floor.nc"
    )
    own = content(run_atlas(atlas, tmp_path / "atlas.nc"))
    assert (own["link_status"].isel(pair=1) == RayStatus.OUTSIDE).all()  # at 300 m
    assert (own["link_status"].isel(pair=0, distance=0) == RayStatus.OK).all()
    assert np.isnan(own["no_direct_path"].isel(pair=1)).all()


def test_a_window_across_the_seam_equals_any_other(
    here, ocean, links, content, tmp_path, as_stored
):
    """
    The same water on a grid that goes around the Earth, counted from 0 to 360, its seam amid the
    columns.
    """
    lon = np.arange(0.0, 360.0, 4.0)
    wide = ocean.isel(lon=slice(0, 45)).assign_coords(
        lon=("lon", lon[:45] - 88.0, ocean["lon"].attrs)
    )
    other = ocean.isel(lon=slice(0, 45)).assign_coords(
        lon=("lon", lon[:45] + 92.0, ocean["lon"].attrs)
    )
    around = xr.concat([wide, other], "lon", data_vars="all", coords="minimal", join="override")
    around["lon"].attrs = ocean["lon"].attrs
    shifted = around.assign_coords(
        lon=("lon", around["lon"].values % 360.0, ocean["lon"].attrs)
    ).sortby("lon")
    paths = {}
    for name, dataset in (("around", around), ("shifted", shifted)):
        paths[name] = tmp_path / f"{name}-ocean.nc"
        dataset.to_netcdf(paths[name])
    far = AtlasLinks(pairs=((20.0, 100.0),), distances=(1_000.0,), bearings=2)
    south, north = float(ocean["lat"][12]) - 1e-3, float(ocean["lat"][13]) + 1e-3
    one, two = (
        content(
            run_atlas(Atlas(path, far, window=(south, north, -5.0, 5.0)), tmp_path / f"{name}.nc")
        )
        for name, path in paths.items()
    )
    np.testing.assert_array_equal(one["lon"], [-4.0, 0.0, 4.0])
    np.testing.assert_array_equal(two["lon"], one["lon"])
    np.testing.assert_array_equal(two["lon_bounds"], one["lon_bounds"])
    assert np.isfinite(one["range_error"]).all()
    np.testing.assert_array_equal(one["range_error"], two["range_error"])
    as_stored({"errors": one["range_error"], "bounds": one["lon_bounds"]})


def test_the_file_is_cf(coarse, content, as_stored):
    assert not cf_errors([coarse])
    own = content(coarse)
    as_stored(own, without="_key")
    assert own.attrs["Conventions"] == "CF-1.11"
    assert own["convention"].values.tolist() == [
        "transmitter",
        "receiver",
        "mean",
        "chord",
        "nominal",
    ]
    for name in ("latitude", "longitude", "time"):
        assert own.cf[name].ndim == 1
    np.testing.assert_allclose(own.cf.get_bounds("latitude").mean("bound"), own["lat"])
    assert np.ptp(own["lon_bounds"].values[0]) == pytest.approx(20 * 0.08)
    assert list(own.cf.standard_names["depth"]) == ["receiver_depth", "transmitter_depth"]
    for variable in own.data_vars.values():
        assert "units" in variable.attrs or variable.name.endswith("_bounds")
        if "flag_values" in variable.attrs:
            flags = variable.attrs["flag_values"]
            assert len(variable.attrs["flag_meanings"].split()) == flags.size
            assert np.isin(variable.values, flags).all()
    assert own["transmitter_depth"].values.tolist() == [20.0, 300.0]
    assert set(own["range_error"].coords) >= {
        "transmitter_depth",
        "receiver_depth",
        "distance",
        "bearing",
    }


def test_the_table_counts_places(here, ocean, file, links, content, tmp_path, as_stored):
    own = content(
        run_atlas(Atlas(file, links, window=_window(ocean, 12, 15, 12, 15)), tmp_path / "atlas.nc")
    )
    table = safety_table(own).set_index(["convention", "distance_m"])
    as_stored(table)
    worst = own["worst_range_error"].sel(convention="mean", distance=3000.0).max("pair").values
    row = table.loc["mean", 3000.0]
    assert row["safe_to_1m_percent"] == 100.0 * np.mean(worst <= 1.0)
    assert row["median_m"] == pytest.approx(np.median(worst))
    lost = (own["link_status"].sel(distance=3000.0) != 0).mean()
    assert row["no_direct_path_percent"] == pytest.approx(100.0 * float(lost))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"every": 0}, AtlasError, "every is 0; it must be at least 1"),
        ({"every": 500}, AtlasError, "no column remains: every is 500 for 32 x 52 grid points"),
        ({"times": []}, AtlasError, "times is empty; give at least one"),
        ({"window": (10.0, 11.0, 0.0, 1.0)}, OceanError, "atlas: no grid point in the window"),
        (
            {"times": ["2020-01-01"]},
            AtlasError,
            "time 2020-01-01T00:00: not in the ocean, which has 1 from 2014",
        ),
    ],
)
def test_what_cannot_be_is_refused(file, options, error, message):
    refused(error, message, Atlas, file, **options)


def test_what_is_no_atlas_is_refused(file, tmp_path):
    refused(
        AtlasError,
        "not an atlas of this version; compute one with mantaray atlas run",
        open_atlas,
        file,
    )
    refused(
        AtlasError,
        "missing.nc: no such file",
        open_atlas,
        tmp_path / "missing.nc",
    )


RUN = """
import sys
from pymantaray.apps.atlas import Atlas, AtlasLinks, plan, run_atlas
plan._COLUMNS = 1
links = AtlasLinks(pairs=((20.0, 100.0), (300.0, 300.0)), distances=(1_000.0, 3_000.0), bearings=3)
run_atlas(Atlas(sys.argv[1], links, every=3), sys.argv[2], workers=1)
"""


BASIN = """
import resource, sys
from pymantaray.apps.atlas import Atlas, AtlasLinks, run_atlas
links = AtlasLinks(pairs=((20.0, 100.0),), distances=(1_000.0,), bearings=1)
run_atlas(Atlas(sys.argv[1], links, every=int(sys.argv[2])), sys.argv[3], workers=1)
own = next(line for line in open("/proc/self/status") if line.startswith("VmHWM:"))
print(int(own.split()[1]) // 1024, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)
"""


def packed(path, ocean, rows, columns):
    """
    File with a number of grid points, packed in 16 bits as in HYCOM, with one profile everywhere.
    """
    profile = ocean.isel(lat=25, lon=20)
    data = xr.Dataset(
        coords={
            "time": ocean["time"],
            "depth": ocean["depth"],
            "lat": ("lat", 20.0 + 0.04 * np.arange(rows), ocean["lat"].attrs),
            "lon": ("lon", 0.04 * np.arange(columns), ocean["lon"].attrs),
        }
    )
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        column = (
            np.nan_to_num((profile[name].values - 20.0) / 1e-3, nan=-30_000.0).round().astype("i2")
        )
        values = np.broadcast_to(column[:, None, None], (column.size, rows, columns))
        attrs = ocean[name].attrs | {
            "scale_factor": 1e-3,
            "add_offset": 20.0,
            "_FillValue": np.int16(-30_000),
        }
        data[name] = ("depth", "lat", "lon"), values, attrs
    data.to_netcdf(
        path, engine="netcdf4", encoding={name: {"zlib": True} for name in data.data_vars}
    )
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its peak is read from /proc")
def test_a_basin_takes_no_more_memory_than_a_bay(ocean, tmp_path):
    peaks = {}
    for name, rows, columns, every in (("bay", 120, 160, 40), ("basin", 800, 1200, 200)):
        file = packed(tmp_path / f"{name}-ocean.nc", ocean, rows, columns)
        words = [sys.executable, "-c", BASIN, file, str(every), tmp_path / f"{name}.nc"]
        printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        peaks[name] = [int(word) for word in printed.split()]  # MiB of parent and worker
    points = 800 * 1200 * ocean.sizes["depth"]
    assert points * 8 > 200 * 2**20  # one variable of the basin, unpacked
    for bay, basin in zip(peaks["bay"], peaks["basin"], strict=True):
        assert basin < bay + 100, peaks
    with open_atlas(tmp_path / "basin.nc") as whole:
        assert dict(whole.sizes) | {"lat": 4, "lon": 6} == dict(whole.sizes)
        assert np.isfinite(whole["range_error"]).all()


def begin(file, out):
    return subprocess.Popen([sys.executable, "-c", RUN, file, out], stderr=subprocess.PIPE)


def interrupt(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_loses_nothing(file, links, tmp_path):
    disk = tmp_path / "disk"
    with factories.small_disk(disk, "256k") as remount:
        filler = disk / "filler"
        filler.write_bytes(bytes(200 << 10))
        atlas = Atlas(file, links, every=4)
        with pytest.raises(WriteError, match=r"No space left on device$"):
            run_atlas(atlas, disk / "atlas.nc", workers=1)
        assert not (disk / "atlas.nc").exists()
        filler.unlink()
        remount("size=8m")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(runner, "write_atlas", interrupt)
            with pytest.raises(KeyboardInterrupt):
                run_atlas(atlas, disk / "atlas.nc", workers=1)
        with suppress(OSError):
            filler.write_bytes(
                bytes(8 << 20)
            )  # all that is left of the disk, all blocks being done
        os.truncate(filler, filler.stat().st_size - (32 << 10))
        with pytest.raises(
            WriteError, match=r"atlas.nc: cannot be written: No space left on device$"
        ):
            run_atlas(atlas, disk / "atlas.nc", workers=1)
        assert sorted(path.name for path in disk.iterdir()) == ["atlas.nc.blocks", "filler"]
        filler.unlink()
        run_atlas(atlas, disk / "atlas.nc", workers=1)
        assert [path.name for path in disk.iterdir()] == ["atlas.nc"]
