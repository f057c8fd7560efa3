"""
Attempts to make MantaRay run foreign code, hang, fill memory or disk, or end without one clear
line.

Each class is a generator of attempts, which are commands in a folder that the attempt has prepared.
They run one by one in forked processes with limits of time and memory, on a run, oceans and tables
that are made once.

    python tests/attacks.py [CLASS ...] [--log FILE]

prints the faults and a count by class; `tests/test_attacks.py` does the same. To add a class write
a generator of `Attempt` and decorate it by `attack`.
"""

import argparse
import http.client
import itertools
import json
import os
import random
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

TIME_LIMIT = 300.0  # s
MEMORY_LIMIT = 3 * 2**20  # KiB, resident
SPRUNG = "sprung"
CLASSES: dict[str, Callable[["Material"], Iterator["Attempt"]]] = {}


@dataclass
class Attempt:
    """A command, what is made of its folder before, and what is looked at afterwards."""

    name: str
    words: list[str]
    prepare: Callable[[Path], object] = lambda _folder: None
    codes: tuple[int, ...] = (0, 1, 2)
    outputs: tuple[str, ...] = ()  # that must not be there after a failure
    limits: dict[int, int] = field(default_factory=dict)
    call: Callable[[Path], str] | None = None  # in place of the command; tells a fault or nothing


def attack(generator):
    """Add a class of attempts by the name of its generator."""
    CLASSES[generator.__name__] = generator
    return generator


class Material:
    """A run folder, oceans, a table of links and one of trajectories, made once."""

    def __init__(self, folder: Path) -> None:
        from factories import TINY

        from pymantaray.apps.study import run_study
        from pymantaray.config import parse_study
        from pymantaray.ocean import open_ocean
        from pymantaray.records.writing import write_netcdf

        self.folder = folder
        run_study(parse_study(TINY, "tiny"), folder / "run", workers=1)
        ocean = open_ocean("synthetic:fram", window=(77.9, 78.1, -0.4, 0.4))
        write_netcdf(ocean, folder / "ocean.nc")
        plain = ocean.drop_attrs()
        for kind in (2, 3):
            plain.to_zarr(folder / f"ocean{kind}.zarr", zarr_format=kind, consolidated=False)
        self.links = (
            "source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth\n"
        )
        self.links += "0,0,50,1000,200,80\n0,0,50,-900,100,120\n"
        rows = [
            f"{60 * k},{who},{10 * k + away},{5 * k},50"
            for k in range(20)
            for who, away in (("A", 0), ("B", 800))
        ]
        self.mission = "time,vehicle,north,east,depth\n" + "\n".join(rows) + "\n"


def run_one(attempt: Attempt, material: Material) -> str:
    """Fault of an attempt, empty if it ended as it should."""
    with tempfile.TemporaryDirectory(dir=material.folder) as own:
        folder = Path(own)
        attempt.prepare(folder)
        before = set(map(str, folder.rglob("*")))
        reading, writing = os.pipe()
        pid = os.fork()
        if pid == 0:
            _child(attempt, folder, writing)
        os.close(writing)
        code, memory = _wait(pid)
        with os.fdopen(reading, "rb") as pipe:
            piped = pipe.read() if attempt.limits else b""
        if piped:
            (folder / ".err").write_bytes(piped)
        said = (folder / ".err").read_text(errors="replace") if (folder / ".err").exists() else ""
        faults = []
        if code is None:
            faults.append(f"hangs for {TIME_LIMIT:g} s")
        elif code not in attempt.codes:
            faults.append(
                f"ends with {code}: {said[-200:]!r}" if attempt.call else f"ends with {code}"
            )
        if memory > MEMORY_LIMIT:
            faults.append(f"takes {memory / 2**20:.1f} GiB")
        if "Traceback" in said:
            faults.append("traceback: " + said.strip().splitlines()[-1][:200])
        errors = [line for line in said.splitlines() if line.startswith("error: ")]
        if (
            code == 2
            and not errors
            and attempt.call is None
            and not (folder / ".out").stat().st_size
        ):
            faults.append(f"no line that says why: {said[:200]!r}")
        if (
            any(words in said for words in ("; see mantaray ", "No such option"))
            and attempt.call is None
        ):
            faults.append(f"a wrong command: {said[:200]!r}")  # of this script
        if len(errors) > 5:
            faults.append(f"{len(errors)} error lines")
        if any(not line.isprintable() for line in errors):
            faults.append("an error line that is not printable")
        if (folder / SPRUNG).exists():
            faults.append("foreign code ran")
        after = {
            path
            for path in map(str, folder.rglob("*"))
            if not Path(path).name.startswith((".err", ".out"))
        }
        new = {
            path
            for path in after - before
            if Path(path).name not in attempt.outputs or code not in (0, 1)
        }
        half = [
            path for path in new if path.endswith(".part") or Path(path).name in attempt.outputs
        ]
        if half and code not in (0, 1):
            faults.append(f"half written: {', '.join(Path(path).name for path in half)}")
        return "; ".join(faults)


def _child(attempt: Attempt, folder: Path, pipe: int) -> None:
    """Run an attempt in this process, which ends with it."""
    code = 70
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        for number, name in ((1, ".out"), (2, ".err")):
            file = os.open(name, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600)
            os.dup2(pipe if attempt.limits else file, number)  # limits of files hold for these too
        sys.stdout, sys.stderr = (os.fdopen(os.dup(n), "w", errors="replace") for n in (1, 2))
        for what, most in attempt.limits.items():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            sys.dont_write_bytecode = (
                True  # of which the first bytes would be left to other processes
            )
            resource.setrlimit(what, (most, most))
        if attempt.call is not None:
            fault = attempt.call(folder)
            code = 0 if not fault else 3
            sys.stderr.write(fault)
        else:
            from pymantaray.cli.main import main

            main(attempt.words)
            code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(bool(end.code))
    except BaseException:  # noqa: BLE001  a fault, which is told
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code or 0)


def _wait(pid: int) -> tuple[int | None, int]:
    """Exit code of a process, None if it had to be killed, and its largest memory. [KiB]"""
    end = time.monotonic() + TIME_LIMIT
    while time.monotonic() < end:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), usage.ru_maxrss
        time.sleep(0.005)
    os.killpg(pid, signal.SIGKILL)
    os.wait4(pid, 0)
    return None, 0


def damages(content: bytes, seed: int) -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Ways to spoil a file of some content."""
    rng = random.Random(seed)
    yield "empty", lambda path: path.write_bytes(b"")
    yield "cut", lambda path: path.write_bytes(content[: len(content) // 2])
    flipped = bytearray(content)
    for _ in range(8):
        flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    yield "flipped", lambda path: path.write_bytes(bytes(flipped))
    yield "a list", lambda path: path.write_bytes(b"[]")
    yield "binary", lambda path: path.write_bytes(rng.randbytes(300))

    def as_folder(path):
        path.unlink()
        path.mkdir()

    def as_loop(path):
        path.unlink()
        path.symlink_to(path.name)

    yield "a folder", as_folder
    yield "a loop of links", as_loop


@attack
def damaged_runs(material):
    """Each file of a run folder spoiled in each way, and the run shown or exported."""
    commands = itertools.cycle(
        [["study", "show", "run"], ["export", "run", "--to", "tum", "--out", "out"]]
    )
    run = material.folder / "run"
    files = sorted(
        path
        for path in run.rglob("*")
        if path.is_file() and path.suffix in (".nc", ".json", ".toml", ".csv", ".pyfg")
    )
    for seed, file in enumerate(files):
        name = file.relative_to(run)
        if name.parts[0] == "tables":
            continue
        for kind, spoil in damages(file.read_bytes(), seed):

            def prepare(folder, name=name, spoil=spoil):
                shutil.copytree(run, folder / "run")
                spoil(folder / "run" / name)

            yield Attempt(f"{name} {kind}", next(commands), prepare, outputs=("out",))


@attack
def damaged_oceans(material):
    """Oceans that are cut or changed anywhere."""
    content = (material.folder / "ocean.nc").read_bytes()
    rng = random.Random(1)
    for k in range(60):
        spoilt = bytearray(content if k % 2 else content[: rng.randrange(len(content))])
        for _ in range(rng.choice([1, 10, 1000])):
            if spoilt:
                spoilt[rng.randrange(len(spoilt) if k % 3 else min(len(spoilt), 8192))] = (
                    rng.randrange(256)
                )
        yield Attempt(
            f"ocean {k}",
            ["ocean", "show", "sea.nc"]
            if k % 2
            else ["ocean", "perturb", "sea.nc", "out.nc", "--method", "mean"],
            lambda folder, spoilt=bytes(spoilt): (folder / "sea.nc").write_bytes(spoilt),
            outputs=("out.nc",),
        )


class Trap:
    """Makes a file when it is unpickled."""

    def __reduce__(self):
        return open, (SPRUNG, "w")


@attack
def hostile_zarr(material):
    """
    Codecs that run code by every spelling and place, damaged metadata, links, chunks that fill the
    memory.
    """
    import pickle

    names = [
        "pickle",
        "numcodecs.pickle",
        "Pickle",
        "exec",
        "json2",
        "msgpack2",
        "pymantaray",
        "os:system",
        "",
        None,
        3,
        ["pickle"],
        {"id": "pickle"},
    ]
    places = {
        2: [lambda c: {"compressor": {"id": c}}, lambda c: {"filters": [{"id": c}]},
            lambda c: {"filters": [{"id": "delta", "dtype": "f8"}, {"id": c}]}],
        3: [
            lambda c: {"codecs": [{"name": c}]},
            lambda c: {"codecs": [{"name": "bytes"}, {"name": c}]},
            lambda c: {"codecs": [{"name": "sharding_indexed",
                                   "configuration": {"chunk_shape": [1], "codecs": [{"name": c}],
                                       "index_codecs": []}}]},
        ],
    }  # fmt: skip
    spellings = [
        lambda t: t.encode(),
        lambda t: t.replace("pickle", "\\u0070ickle").encode(),
        lambda t: t.encode("utf-16"),
    ]
    for kind, name in itertools.product((2, 3), names):
        for k, place in enumerate(places[kind]):
            spelling = spellings[(k + len(str(name))) % 3]

            def prepare(folder, kind=kind, place=place, spelling=spelling, name=name):
                shutil.copytree(material.folder / f"ocean{kind}.zarr", folder / "o.zarr")
                file = folder / "o.zarr" / "lat" / (".zarray" if kind == 2 else "zarr.json")
                file.write_bytes(spelling(json.dumps(json.loads(file.read_bytes()) | place(name))))
                chunk = folder / "o.zarr" / "lat" / ("0" if kind == 2 else "c/0")
                chunk.write_bytes(pickle.dumps(np.array([Trap()] * 4, dtype=object)))

            yield Attempt(
                f"format {kind} codec {name!r} {k}",
                ["ocean", "perturb", "o.zarr", "out.nc", "--method", "mean"],
                prepare,
                (2,),
                ("out.nc",),
            )
    for kind, size in itertools.product((2, 3), (10**9, 10**12, 2**63, -5, 0)):

        def large(folder, kind=kind, size=size):
            shutil.copytree(material.folder / f"ocean{kind}.zarr", folder / "o.zarr")
            file = folder / "o.zarr" / "lat" / (".zarray" if kind == 2 else "zarr.json")
            own = (
                {"chunks": [size]}
                if kind == 2
                else {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [size]}}}
            )
            file.write_text(json.dumps(json.loads(file.read_bytes()) | own))

        yield Attempt(f"format {kind} chunk of {size}", ["ocean", "show", "o.zarr"], large, (2,))
    for kind, text in itertools.product(
        (2, 3),
        ["", "{", "[]", "null", "3", "{" * 5000, "[" * 90000, '{"shape": [1e999]}', "\0" * 50],
    ):

        def damaged(folder, kind=kind, text=text):
            shutil.copytree(material.folder / f"ocean{kind}.zarr", folder / "o.zarr")
            (folder / "o.zarr" / "lat" / (".zarray" if kind == 2 else "zarr.json")).write_text(text)

        yield Attempt(
            f"format {kind} metadata {text[:10]!r}", ["ocean", "show", "o.zarr"], damaged, (2,)
        )


@attack
def bombs(material):
    """
    Small files that unpack to a lot: Parquet, bags, chunks of NetCDF; and tables that are large or
    strange.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    words = [
        "ranges",
        "m.parquet",
        "--ocean",
        "synthetic:fram",
        "--interval",
        "5 min",
        "--out",
        "out",
    ]
    for n, columns, text in itertools.product((2 * 10**5, 10**6), (60, 150), (0, 10**6)):

        def parquet(folder, n=n, columns=columns, text=text):
            number = pa.DictionaryArray.from_arrays(
                pa.array(np.zeros(n, dtype="i1")), pa.array([0.0])
            )
            own = dict.fromkeys(
                ["time", "north", "east", "depth", *map(str, range(columns))], number
            )
            if text:
                own["vehicle"] = pa.DictionaryArray.from_arrays(
                    pa.array(np.zeros(n, dtype="i1")), pa.array(["v" * text])
                )
            table = pa.table(own)
            with pq.ParquetWriter(
                folder / "m.parquet", table.schema, store_schema=False, compression="zstd"
            ) as file:
                for _ in range(2):
                    file.write_table(table, row_group_size=n)

        yield Attempt(f"parquet {n} x {columns}, text of {text}", words, parquet, (2,), ("out",))
    for mode, size in itertools.product(
        ("message", "storage", "file", "bz2", "lz4"), (3 * 2**27, 2**20)
    ):

        def bag(folder, mode=mode, size=size):
            _bag(folder / ("m.bag" if mode in ("bz2", "lz4") else "m"), size, mode)

        name = "m.bag" if mode in ("bz2", "lz4") else "m"
        limited = [
            "ranges",
            name,
            "--ocean",
            "synthetic:fram",
            "--interval",
            "5 min",
            "--out",
            "out",
        ]
        yield Attempt(f"bag by {mode}, {size} bytes", limited, bag, (2,), ("out",))
    for size in (3 * 10**8, 4 * 10**8):

        def netcdf(folder, size=size):
            import netCDF4

            with netCDF4.Dataset(folder / "sea.nc", "w") as data:
                data.createDimension("x", None)
                data.createVariable("water_temp", "f8", ("x",), zlib=True, chunksizes=(size,))

        yield Attempt(f"NetCDF chunk of {size}", ["ocean", "show", "sea.nc"], netcdf, (2,))
    for text in (
        "a,b\n" * 10**6,
        "time," * 10**5,
        "\0" * 10**6,
        '"' * 10**6,
        "time,lat,lon,depth\n" + "1e999,1,1,1\n" * 9,
        "time\n1\n",
        "=,+,-\n@,=,+\n",
    ):
        yield Attempt(
            f"table {text[:12]!r}",
            ["ranges", "m.csv", "--ocean", "synthetic:fram", "--interval", "60", "--out", "out"],
            lambda f, t=text: (f / "m.csv").write_text(t),
            (2,),
            ("out",),
        )


def _bag(path, size, mode):
    """A packed bag of three poses, whose frame has a name of so many bytes."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros, kind = 1 if mode in ("bz2", "lz4") else 2, "geometry_msgs/msg/PoseStamped"
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if ros == 1:
        writer = Writer1(path)
        writer.set_compression(Writer1.CompressionFormat[mode.upper()])
    else:
        writer = Writer2(
            path,
            version=9,
            storage_plugin=StoragePlugin.MCAP if mode == "storage" else StoragePlugin.SQLITE3,
        )
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    make = store.types
    with writer as bag:
        connection = bag.add_connection("/a/pose", kind, typestore=store)
        stamp = make["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
        header = make["std_msgs/msg/Header"](
            stamp=stamp, frame_id="x" * size, **({"seq": 0} if ros == 1 else {})
        )
        pose = make["geometry_msgs/msg/Pose"](
            make["geometry_msgs/msg/Point"](1.0, 2.0, 3.0),
            make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        )
        bag.write(
            connection,
            1,
            (store.serialize_ros1 if ros == 1 else store.serialize_cdr)(
                make[kind](header, pose), kind
            ),
        )


@attack
def full_disks(material):
    """Files that may not grow beyond some size, as on a full disk, and devices that are full."""
    commands = {
        "perturb": ["ocean", "perturb", "sea.nc", "out.nc", "--method", "mean"],
        "times": ["rays", "times", "links.csv", "out.csv", "--ocean", "sea.nc"],
        "export": ["export", "run", "--to", "csv", "--out", "out"],
        "export cf": ["export", "run", "--to", "cf", "--out", "out"],
    }

    def prepare(folder):
        shutil.copytree(material.folder / "run", folder / "run")
        shutil.copy(material.folder / "ocean.nc", folder / "sea.nc")
        (folder / "links.csv").write_text(material.links)

    for (name, words), size in itertools.product(
        commands.items(), (0, 1, 100, 1000, 4096, 10000, 20000)
    ):
        yield Attempt(
            f"{name} in {size} bytes",
            words,
            prepare,
            (0, 2),
            ("out", "out.nc", "out.csv"),
            {resource.RLIMIT_FSIZE: size},
        )
    for place in ("/dev/full", "/proc/out.nc", "/dev/null/x.nc", "/no/such/out.nc"):
        yield Attempt(
            f"perturb to {place}",
            ["ocean", "perturb", "sea.nc", place, "--force", "--method", "mean"],
            prepare,
            (2,),
        )


@attack
def other_folders(material):
    """Working folders with modules by the names of those that Python and its packages import."""
    modules = [
        "pickle",
        "struct",
        "json",
        "numpy",
        "pymantaray",
        "re",
        "os",
        "io",
        "signal",
        "queue",
        "threading",
        "typing",
        "xarray",
        "numba",
        "random",
        "site",
        "encodings",
        "copyreg",
        "sitecustomize",
        "usercustomize",
    ]
    script = (
        "import sys; sys.argv[0] = 'mantaray'\n"
        "from pymantaray.jobs.processes import Workers\n"
        "from attacks import start\n"
        "with Workers(start, 1) as workers: print(workers.submit(21).result())\n"
    )
    for module in modules:

        def call(folder, module=module):
            (folder / f"{module}.py").write_text(f"open({SPRUNG!r}, 'w')\nraise SystemExit(9)\n")
            here = str(Path(__file__).parent)
            done = subprocess.run(
                [sys.executable, "-P", "-c", script],
                env=os.environ | {"PYTHONPATH": here},
                capture_output=True,
                text=True,
                check=False,
            )
            return "" if done.stdout == "42\n" else f"said {done.stdout!r} {done.stderr[-200:]!r}"

        yield Attempt(f"{module}.py", [], call=call, codes=(0,))


def start():
    """Task of a worker of `other_folders`."""
    return lambda number: 2 * number


@attack
def signals(material):
    """
    Ctrl-C and requests to stop at any moment, imports and writing included; kill -9 leaves no
    output that looks whole.
    """
    main = (
        "from pymantaray.__main__ import main; import sys; print('ready', file=sys.stderr,"
        " flush=True); main()"
    )
    words = [
        "ranges",
        "m.csv",
        "--ocean",
        "synthetic:fram",
        "--interval",
        "60",
        "--out",
        "out",
        "--quiet",
    ]
    for k, number in enumerate([signal.SIGINT, signal.SIGTERM, signal.SIGKILL] * 8):

        def call(folder, k=k, number=number):
            (folder / "m.csv").write_text(material.mission)
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", main, *words], stderr=subprocess.PIPE, text=True
            )
            process.stderr.readline()  # until then Python starts, whose own affair a signal is
            time.sleep(0.05 + 0.3 * k)
            process.send_signal(number)
            _, said = process.communicate(timeout=TIME_LIMIT)
            whole = (folder / "out" / "manifest.json").exists()
            faults = []
            if process.returncode not in (
                0,
                130,
                143,
                -signal.SIGKILL,
                -signal.SIGTERM,
                -signal.SIGINT,
            ):
                faults.append(f"ends with {process.returncode}")
            if "Traceback" in said:
                faults.append(said.strip().splitlines()[-1])
            if (folder / "out").exists() and not whole:
                faults.append("half written: out")
            if number != signal.SIGKILL and [
                p for p in folder.iterdir() if p.name.endswith(".part")
            ]:
                faults.append("a temporary file is left")
            return "; ".join(faults)

        yield Attempt(f"{number.name} after {0.05 + 0.3 * k:.2f} s", [], call=call, codes=(0,))


@attack
def connections(material):
    """
    Requests to one server that are no HTTP, no JSON, no ping, too many, too slow or of other sites.
    """
    server = _Server(material)
    try:
        rng = random.Random(3)
        here = {"north": 0.0, "east": 0.0, "depth": 50.0}
        good = json.dumps({"time": 0.0, "source": here, "receivers": [here | {"north": 900.0}]})
        for k in range(60):
            body = bytearray(good.encode())
            for _ in range(rng.choice([1, 3, 20])):
                body[rng.randrange(len(body))] = rng.randrange(256)
            text = (
                b"POST /ping HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
                b"Content-Length: %d\r\n\r\n" % len(body)
            )
            yield Attempt(
                f"body {k}", [], call=lambda _, t=text + bytes(body): server.fault(t), codes=(0,)
            )
        for k in range(40):
            head = bytearray(
                b"POST /ping HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
                b"Content-Length: 0\r\n\r\n"
            )
            for _ in range(rng.choice([1, 3, 20])):
                head[rng.randrange(len(head) - 4)] = rng.randrange(256)
            yield Attempt(
                f"head {k}",
                [],
                call=lambda _, t=bytes(head): server.fault(t, may_close=True),
                codes=(0,),
            )
        for head in (
            "Host: evil.example",
            "Host: localhost\r\nOrigin: http://evil.example",
            "Host: localhost\r\nOrigin: null",
            "Host: 127.0.0.1.evil",
        ):
            text = (
                f"POST /ping HTTP/1.1\r\n{head}\r\nConnection: close\r\nContent-Length:"
                f" {len(good)}\r\n\r\n{good}"
            )
            yield Attempt(
                head[-30:],
                [],
                call=lambda _, t=text: server.fault(t.encode(), status=403),
                codes=(0,),
            )
        for count in (98, 150, 400):
            yield Attempt(
                f"{count} idle connections",
                [],
                call=lambda _, n=count: server.beside(n, b""),
                codes=(0,),
            )
            yield Attempt(
                f"{count} slow headers",
                [],
                call=lambda _, n=count: server.beside(n, b"GET / HTTP/1.1\r\nX:"),
                codes=(0,),
            )
            yield Attempt(
                f"{count} slow bodies",
                [],
                call=lambda _, n=count: server.beside(
                    n, b"POST /ping HTTP/1.1\r\nContent-Length: 99\r\n\r\n{"
                ),
                codes=(0,),
            )
        for k in range(10):
            yield Attempt(
                f"worker killed {k}", [], call=lambda _: server.without_worker(good), codes=(0,)
            )
    finally:
        server.end()


class _Server:
    """A server by the command, with a worker, on loopback."""

    def __init__(self, material):
        main = "from pymantaray.cli.main import main; main()"
        words = ["serve", str(material.folder / "ocean.nc"), "--port", "0", "--workers", "1"]
        self._log = (material.folder / "server.log").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", main, *words],
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        line = " "
        while line and "listening" not in line:
            line = self.process.stdout.readline()
        self.port = int(line.rpartition(":")[2])

    def end(self):
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=60)
        self._log.seek(0)
        said = self._log.read()
        self._log.close()
        if "Traceback" in said:
            sys.stderr.write(f"server: {said[-600:]}\n")

    def answers(self):
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        client.request("GET", "/")
        status = client.getresponse().status
        client.close()
        return status == 200

    def fault(self, text, *, status=None, may_close=False):
        with socket.create_connection(("127.0.0.1", self.port), timeout=60) as line:
            line.sendall(text)
            line.shutdown(socket.SHUT_WR)
            said = b"".join(iter(lambda: line.recv(65536), b"")).decode("latin-1")
        if not said and may_close:
            return "" if self.answers() else "server is gone"
        head, _, body = said.partition("\r\n\r\n")
        match = re.match(r"HTTP/1\.[01] (\d+) ", head)
        if not match or (int(match[1]) >= 500 and int(match[1]) != 501):
            return f"answer {head[:60]!r}"
        if status not in (None, int(match[1])):
            return f"status {match[1]}"
        answer = json.loads(body.encode("latin-1"))
        if int(match[1]) >= 400 and not (
            list(answer) == ["error"]
            and answer["error"].isprintable()
            and len(answer["error"]) <= 480
        ):
            return f"answer {body[:100]!r}"
        return "" if self.answers() else "server is gone"

    def beside(self, count, start):
        held = [
            socket.create_connection(("127.0.0.1", self.port), timeout=60) for _ in range(count)
        ]
        for line in held:
            try:
                line.sendall(start)
            except OSError:
                continue  # it was closed for another
        fault = "" if self.answers() else "not answered"
        for line in held:
            line.close()
        return fault

    def without_worker(self, good):
        children = (
            Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        )
        for child in children:
            os.kill(int(child), signal.SIGKILL)
        text = (
            "POST /ping HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length:"
            f" {len(good)}\r\n\r\n{good}"
        )
        return self.fault(text.encode(), status=200)


@attack
def secrets(material):
    """Passwords and tokens in every argument of every command, of which none is repeated."""
    secret = "XSECRETX"
    addresses = [
        f"https://ann:{secret}@nowhere.invalid/x.nc",
        f"https://nowhere.invalid/x.nc?token={secret}",
        f"s3://ann:{secret}@bucket/x",
    ]
    commands = [
        "ocean check {}",
        "ocean show {}",
        "ocean perturb {} out.nc --method mean",
        "rays times links.csv out.csv --ocean {}",
        "ranges m.csv --out out --interval 60 --ocean {}",
        "replay {}",
        "graph show {}",
        "study run {}",
        "study show {}",
        "sweep run {} --out out",
        "sweep status {}",
        "serve {}",
        "export {} --to tum",
        "{}",
    ]
    for command, address in itertools.product(commands, addresses):

        def call(folder, command=command, address=address):
            from pymantaray.cli.main import main

            try:
                main(command.format(address).split())
            except SystemExit as end:
                code = end.code
            sys.stdout.flush()
            sys.stderr.flush()
            said = (folder / ".out").read_text() + (folder / ".err").read_text()
            return (
                "repeats a secret" if secret in said else "" if code == 2 else f"ends with {code}"
            )

        yield Attempt(f"{command} {address}", [], call=call, codes=(0,))


def run_classes(names, folder, every, log):
    """One in every few attempts of some classes, one by one; counts and faults by class."""
    import pymantaray.cli.main  # noqa: F401  so that forked processes have it

    material = Material(folder)
    counts, faults = {}, []
    for name in names:
        began, counts[name] = time.monotonic(), 0
        for attempt in itertools.islice(CLASSES[name](material), 0, None, every):
            counts[name] += 1
            fault = run_one(attempt, material)
            log(f"{name}: {attempt.name}: {fault or 'as it should'}")
            if fault:
                faults.append(f"{name}: {attempt.name}: {fault}")
        log(f"{name}: {counts[name]} attempts in {time.monotonic() - began:.0f} s")
    return counts, faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().partition("\n")[0])
    parser.add_argument("classes", nargs="*", default=list(CLASSES), metavar="CLASS")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one attempt in N")
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        (options.log or Path(os.devnull)).open("w") as file,
    ):
        counts, faults = run_classes(
            options.classes,
            Path(folder),
            options.every,
            lambda line: print(line, file=file, flush=True),
        )
    for fault in faults:
        print(fault)
    for name, count in counts.items():
        print(
            f"{name:16} {count:4} attempts,"
            f" {sum(fault.startswith(f'{name}: ') for fault in faults)} faults"
        )
    print(f"{'all':16} {sum(counts.values()):4} attempts, {len(faults)} faults")
    raise SystemExit(bool(faults))


if __name__ == "__main__":
    main()
