"""
Time the ranging service: latency and throughput of pings in a process and over HTTP, and memory
under many requests.

Run with ``python benchmarks/bench_service.py``. The ocean is the synthetic Beaufort Sea in full,
places are drawn in 10 km x 10 km and the upper 900 m, or are those of the paper's fleet: 11
vehicles are 1 ping x 10 receivers, a crowd is 1 x 1,000. Each line has the CPU time of a ping,
which other work on the machine disturbs less, the median and the 99th percentile of its wall time,
and pings a second by the wall. Over HTTP there is one client with one connection, or several at a
time.

``--requests N`` sends N requests instead: good, malformed and oversized ones in random order, from
4 clients, and prints the server's memory as they go (100,000 in the figures of the docs).
"""

import argparse
import http.client
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from all_rows import machine
from bench_links import GRID, TARGETS

from pymantaray.apps.service import RangingService
from pymantaray.apps.service.server import MAX_BYTES
from pymantaray.config import SoundConfig
from pymantaray.config.parse import parse

STILL = {"ocean": {"source": "synthetic:beaufort"}}
LOUD = STILL | {
    "acoustics": {"max_surface_bounces": 2, "currents": True},
    "ranging": {"timing": "two-way", "turn_around_s": 0.1},
    "detection": {"source_level_db": 185.0, "frequency_hz": 25e3, "bandwidth_hz": 5e3},
}
VARYING = {
    "ocean": {"source": "synthetic:beaufort", "time_varying": True},
    "mission": {"duration_h": 24.0},
}
CLIENTS = 4
Place = tuple[np.ndarray, np.ndarray]


def sound(tree: dict[str, object]) -> SoundConfig:
    return parse(SoundConfig, tree, "benchmark", None)


def places(n_pings: int, n_receivers: int) -> list[Place]:
    rng = np.random.default_rng(0)
    low, high = (-5e3, -5e3, 1.0), (5e3, 5e3, 900.0)
    return [
        (rng.uniform(low, high), rng.uniform(low, high, (n_receivers, 3))) for _ in range(n_pings)
    ]


def fleet(n_pings: int) -> list[Place]:
    """The paper's 11 vehicles as `bench_links` places them, one of which pings."""
    rng, pings = np.random.default_rng(0), []
    for k in range(n_pings):
        depth = np.where(rng.random(len(GRID)) < 0.1, 0.5, TARGETS)
        place = np.column_stack([GRID + rng.normal(0.0, 2e3, GRID.shape), depth])
        sender = k % len(GRID)
        pings.append((place[sender], np.delete(place, sender, axis=0)))
    return pings


def report(what: str, walls: list[float], cpu: str, together: float) -> None:
    """
    Print a line: times of single pings, CPU time, and pings a second where all took so long. [s]
    """
    print(
        f"{what:<56} {len(walls):4d} pings: CPU {cpu}; wall median"
        f" {1e3 * statistics.median(walls):7.2f}, p99 {1e3 * np.percentile(walls, 99):7.2f} ms,"
        f" {len(walls) / together:6.1f} pings/s"
    )


def one_by_one(what: str, ping: Callable[[Place], object], pings: list[Place]) -> None:
    """Time pings of this process, one after the other, each with its CPU time."""
    walls, cpus, begin = [], [], time.perf_counter()
    for place in pings:
        wall, cpu = time.perf_counter(), time.process_time()
        ping(place)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    mean, median, p99 = (
        1e3 * f(cpus) for f in (np.mean, np.median, lambda x: np.percentile(x, 99))
    )
    report(
        what,
        walls,
        f"mean {mean:7.2f}, median {median:7.2f}, p99 {p99:7.2f} ms",
        time.perf_counter() - begin,
    )


def together(
    what: str,
    ping: Callable[[Place], object],
    pings: list[Place],
    cpu: Callable[[], float],
    clients: int,
) -> None:
    """Time pings of several clients at a time, with the CPU time of whoever works."""

    def one(place: Place) -> float:
        begin = time.perf_counter()
        ping(place)
        return time.perf_counter() - begin

    begin, before = time.perf_counter(), cpu()
    with ThreadPoolExecutor(clients) as pool:
        walls = list(pool.map(one, pings))
    mean = 1e3 * (cpu() - before) / len(pings)
    report(what, walls, f"mean {mean:7.2f} ms", time.perf_counter() - begin)


def in_process() -> None:
    for name, tree, pings in (
        ("1 x 1", STILL, places(500, 1)),
        ("1 x 10", STILL, places(500, 10)),
        ("1 x 10, the paper's fleet", STILL, fleet(500)),
        ("1 x 1,000", STILL, places(10, 1000)),
        ("1 x 10, bounces, currents, sonar, two-way", LOUD, places(100, 10)),
    ):
        service = RangingService(sound(tree))
        one_by_one(f"in the process: {name}", lambda p, s=service: s.ping(0.0, *p), pings)
    varying = sound(VARYING)
    for name, interval, n_pings in (
        ("each its own water", 0.0, 20),
        ("water of 600 s", 600.0, 500),
    ):
        service = RangingService(varying, water_interval=interval)
        clock = iter(np.linspace(0.0, 3600.0, n_pings))
        one_by_one(
            f"in the process: 1 x 10, varying, {name}",
            lambda p, s=service, c=clock: s.ping(next(c), *p),
            places(n_pings, 10),
        )
    with RangingService(sound(STILL), workers=2) as service:
        pings = places(500, 10)
        what = f"2 processes, {CLIENTS} threads ask: 1 x 10 (CPU of who asks)"
        together(what, lambda p: service.ping(0.0, *p), pings, time.process_time, CLIENTS)


@contextmanager
def serving(*words: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Server of the Beaufort Sea, and its port."""
    command = [
        sys.executable,
        "-c",
        "from pymantaray.cli.main import main; main()",
        "serve",
        "synthetic:beaufort",
    ]
    process = subprocess.Popen([*command, "--port", "0", *words], stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline() and process.stdout.readline()
        yield process, int(line.rpartition(":")[2])
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def cpu_of(process: subprocess.Popen[str]) -> float:
    """CPU time of a process and its descendants; NaN where there is no /proc. [s]"""
    pids, stats = [str(process.pid)], []
    try:
        while pids:
            pid = pids.pop()
            pids += Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
            stats.append(Path(f"/proc/{pid}/stat").read_text())
    except OSError:
        return np.nan
    ticks = sum(sum(map(int, stat.rpartition(")")[2].split()[11:15])) for stat in stats)
    return ticks / os.sysconf("SC_CLK_TCK")


def body_of(place: Place) -> bytes:
    ends = [
        dict(zip(("north", "east", "depth"), p.tolist(), strict=True))
        for p in (place[0], *place[1])
    ]
    return json.dumps({"time": 0.0, "source": ends[0], "receivers": ends[1:]}).encode()


def ask(connection: http.client.HTTPConnection, body: bytes) -> int:
    connection.request("POST", "/ping", body)
    response = connection.getresponse()
    response.read()
    return response.status


def over_http() -> None:
    for n_receivers, n_pings, clients, workers in (
        (10, 500, 1, 0),
        (10, 500, CLIENTS, 0),
        (10, 500, CLIENTS, 2),
        (1000, 10, 1, 0),
    ):
        with serving("--workers", str(workers)) as (process, port):
            free = [http.client.HTTPConnection("127.0.0.1", port) for _ in range(clients)]
            pings = [(body_of(p), None) for p in places(n_pings, n_receivers)]

            def ping(
                place: tuple[bytes, None], free: list[http.client.HTTPConnection] = free
            ) -> None:
                connection = free.pop()
                ask(connection, place[0])
                free.append(connection)

            what = (
                f"HTTP, clients {clients}, workers {workers}: 1 x {n_receivers:,} (CPU of the"
                " server)"
            )
            together(what, ping, pings, lambda p=process: cpu_of(p), clients)


def many_requests(n: int) -> None:
    """Send good, malformed and oversized requests, and print memory as they go."""
    good = [body_of(p) for p in places(200, 3)]
    dice, begin = random.Random(0), time.perf_counter()
    cut = [body[: dice.randrange(len(body))] for body in good]
    wrong = [body.replace(b"north", b"nord", 1) for body in good[:20]] + [
        b"NaN",
        b"\xff\xfe",
        b"[" * 10_000,
    ]
    oversized = [b" " * (MAX_BYTES + 1)]
    with serving() as (process, port), ThreadPoolExecutor(CLIENTS) as pool:
        statuses: Counter[int] = Counter()

        def send(seed: int) -> Counter[int]:
            dice, counts = random.Random(seed), Counter[int]()
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
            for _ in range(n // (10 * CLIENTS)):
                kind = dice.choices((good, cut, wrong, oversized), (80, 10, 10, 0.1))[0]
                counts[ask(connection, dice.choice(kind))] += 1
            connection.close()
            return counts

        for part in range(10):
            for counts in pool.map(send, range(CLIENTS * part, CLIENTS * (part + 1))):
                statuses += counts
            rss = subprocess.run(
                ["ps", "-o", "rss=", "-p", str(process.pid)],
                capture_output=True,
                text=True,
                check=True,
            )
            answered = ", ".join(
                f"{count:,} of {status}" for status, count in sorted(statuses.items())
            )
            print(
                f"{statuses.total():7,} requests after {time.perf_counter() - begin:6.0f} s,"
                f" server's CPU {cpu_of(process):6.0f} s, memory {int(rss.stdout) / 1024:6.1f} MB;"
                f" {answered}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=0)
    n = parser.parse_args().requests
    print(machine())
    if n:
        many_requests(n)
        return
    in_process()
    over_http()
    print(machine())


if __name__ == "__main__":
    main()
