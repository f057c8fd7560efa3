"""
Small files that unpack to far more than a machine has: refused in a line, before memory or disk are
full.
"""

import resource
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import refused
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from pymantaray import read_trajectories
from pymantaray.errors import ExchangeError
from pymantaray.exchange import bag_sizes

KIND = "geometry_msgs/msg/PoseStamped"
MAX_MIB = 1500  # what refusing may add to a process


def refused_without_filling_the_memory(message, path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(ExchangeError, message, read_trajectories, path)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < MAX_MIB


def test_a_table_of_many_equal_rows_is_refused_by_its_number_of_rows(tmp_path, monkeypatch):
    n = 100_000
    table = pa.table({name: np.zeros(n) for name in ["time", "north", "east", "depth"]})
    pq.write_table(table, tmp_path / "m.parquet", compression="zstd")
    assert (tmp_path / "m.parquet").stat().st_size < 20_000
    monkeypatch.setattr("pymantaray.exchange.table.MAX_UNPACKED_BYTES", 1e6)
    line = (
        "m.parquet: 100,000 rows of 4 columns need 0.0032 GB unpacked; the limit is 0.001 GB;"
        " remove columns"
    )
    refused(ExchangeError, line, read_trajectories, tmp_path / "m.parquet")


def test_long_text_that_is_repeated_is_refused_by_its_length(tmp_path):
    """5,000 rows with a name of 1 MB each are 5 GB; the file has the name once."""
    n = 5000
    name = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(n, dtype="i4")), pa.array(["v" * 1_000_000])
    )
    numbers = {
        "time": np.arange(n) * 1.0,
        "north": np.arange(n) * 1.0,
        "east": np.zeros(n),
        "depth": np.ones(n),
    }
    with pq.ParquetWriter(
        tmp_path / "m.parquet", pa.table(numbers | {"vehicle": name}).schema, store_schema=False
    ) as file:
        file.write_table(pa.table(numbers | {"vehicle": name}))
    assert (tmp_path / "m.parquet").stat().st_size < 2e6
    refused_without_filling_the_memory(
        "text of vehicle needs 5 GB unpacked; the limit is 2 GB", tmp_path / "m.parquet"
    )


def pose(store, ros, time, frame):
    make = store.types
    stamp = make["builtin_interfaces/msg/Time"](sec=time, nanosec=0)
    header = make["std_msgs/msg/Header"](
        stamp=stamp, frame_id=frame, **({"seq": 0} if ros == 1 else {})
    )
    place = make["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    level = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    return make[KIND](header, make["geometry_msgs/msg/Pose"](place, level))


def bag_with(path, size, mode):
    """A bag, packed in one of the ways, whose poses have a frame with a name of so many bytes."""
    ros = 1 if mode in ("bz2", "lz4") else 2
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if ros == 1:
        writer = Writer1(path)
        writer.set_compression(Writer1.CompressionFormat[mode.upper()])
    else:
        plugin = StoragePlugin.MCAP if mode == "storage" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer as bag:
        connection = bag.add_connection("/a/pose", KIND, typestore=store)
        for time in range(3):
            message = pose(store, ros, time, "x" * size)
            bag.write(
                connection,
                time,
                (store.serialize_ros1 if ros == 1 else store.serialize_cdr)(message, KIND),
            )
    return path


LARGE = "a chunk or message has more than 1 MiB; write the bag with smaller chunks"


@pytest.mark.parametrize("mode", ["message", "storage", "file", "bz2", "lz4"])
def test_a_packed_message_or_chunk_is_unpacked_to_the_limit_alone(tmp_path, monkeypatch, mode):
    monkeypatch.setattr(bag_sizes, "MAX_CHUNK_BYTES", 2**20)
    end = ".bag" if mode in ("bz2", "lz4") else ""
    assert read_trajectories(bag_with(tmp_path / f"small{end}", 3, mode)).names == ["a"]
    refused_without_filling_the_memory(LARGE, bag_with(tmp_path / f"large{end}", 2**23, mode))


def test_a_packed_file_leaves_half_of_the_temporary_folder_free(tmp_path, monkeypatch):
    path = bag_with(tmp_path / "large", 2**23, "file")
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(bag_sizes.tempfile, "tempdir", str(tmp_path / "tmp"))
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(bag_sizes.shutil, "disk_usage", lambda _: usage._replace(free=2**21))
    refused(
        ExchangeError,
        "unpack to more than 0.00105 GB, half of the free space in .*; set TMPDIR",
        read_trajectories,
        path,
    )
    assert list((tmp_path / "tmp").iterdir()) == []


def test_more_poses_than_fit_into_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pymantaray.exchange.bag_sizes.MAX_POSES", 3)
    assert read_trajectories(bag_with(tmp_path / "three", 3, "message"))
    monkeypatch.setattr(bag_sizes, "MAX_POSES", 2)
    refused(
        ExchangeError,
        "three: more than 2 poses; remove topics",
        read_trajectories,
        tmp_path / "three",
    )


def test_an_index_of_other_chunks_is_refused(tmp_path):
    (path,) = bag_with(tmp_path / "bag", 3, "storage").glob("*.mcap")
    content = bytearray(path.read_bytes())
    start = content.index(b"\x06", 8)
    while content[start] != 8:  # the kind of a record of the index of chunks
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    content[start + 25] += 1
    path.write_bytes(content)
    refused(
        ExchangeError, "bag: the index of its chunks is wrong", read_trajectories, tmp_path / "bag"
    )
