"""
Every figure that the project promises: what was measured, beside what, and the goal.

Run with ``python benchmarks/all_rows.py [NUMBER ...]``, all rows or some; ``--list`` shows them,
``--quick`` leaves out those that take minutes. Each row is printed by one of the other benchmarks,
which run one after another, once for all rows they have; a row shows what they print of it, medians
of several runs, and its peer where it has one. A benchmark whose data or peer is not here says so.
CPU time counts; wall times beside it hold for a machine with nothing else to do.
"""

import argparse
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).parent


class Row(NamedTuple):
    """
    A work, its goal, the benchmark that measures it, and the lines to show of it, all if empty.
    """

    work: str
    goal: str
    benchmark: str
    lines: str = ""
    minutes: bool = False


ROWS = (
    Row(
        "messages that need no science",
        "0.7 s for a study; 0.4 s for lists and help",
        "bench_start.py",
        "^mantaray",
    ),
    Row("first call in a fresh install", "5 s; 10 s for all kernels", "bench_start.py", "^kernels"),
    Row(
        "smooth links of 0.5 to 12 km in the reference's duct",
        "in one call 12 thousandths of a sort, 0.7 ms with both ends at 50 m or above; no link"
        " above 3 ms",
        "bench_tail.py",
        "^duct|^sort",
    ),
    Row(
        "links in the Gulf Stream: at random, and without a direct ray",
        "100 thousandths of a sort; 2 ms",
        "bench_tail.py",
        "^gulf",
    ),
    Row(
        "Beaufort 3-D preset, a link",
        "150 us",
        "bench_links.py --threads 1 --media arctic-3d fram-3d",
        "3d",
    ),
    Row(
        "linear media beside Bellhop",
        "1,500 times",
        "compare_reference.py",
        "linear|Bellhop|absolute",
    ),
    Row(
        "one-dimensional media beside Bellhop; an in-process 2-D one took 13 to 26 ms a link"
        " elsewhere",
        "100 times",
        "compare_reference.py",
        r"^\| (medium|[abcd]_)",
    ),
    Row(
        "1,000 vehicles, one ping, 499,500 pairs",
        "60 s",
        "bench_links.py --runs 1 --vehicles 1000 --media arctic-3d",
        "3d",
        True,
    ),
    Row("raw cast, 2 km links, 7 surface bounces", "2 ms", "bench_tail.py", "^cast"),
    Row(
        "a link under a draw of rough ice, by range and reflections",
        "20 ms to 3 km, 200 ms to 10 km",
        "bench_rough.py",
        "^rough ice",
    ),
    Row(
        "surveys in drifting water: 95 % regions that contain the node, halves",
        "0.92 to 0.98; mean chi-square 3",
        "bench_drift.py --surveys 100",
        "",
        True,
    ),
    Row("report of quick", "5 s", "bench_study.py quick", "", True),
    Row(
        "full Beaufort study, warm",
        "10 s",
        "bench_study.py beaufort",
        r"^(stage|all|\w+ +\d)",
        True,
    ),
    Row(
        "the same from an empty cache of kernels",
        "40 s",
        "bench_study.py --fresh beaufort",
        r"^(stage|all|\w+ +\d)",
        True,
    ),
    Row(
        "a realization of all estimators, Fram Strait",
        "25 s",
        "bench_study.py estimators-fram --set study.realizations=1",
        "^(stage|all|realizations)",
        True,
    ),
    Row("one solve beside plain GTSAM", "0.5 times", "bench_solve.py"),
    Row(
        "both regions, 25 x 2 solves; one realization of each",
        "70 s; 3 s",
        "bench_solve.py --realizations 1 --regions",
        "regions|beaufort|fram",
        True,
    ),
    Row("opening an ocean", "3 s, 500 MB", "bench_ocean.py"),
    Row("kinematics of the fleet", "none", "bench_kinematics.py"),
    Row("range models and joint estimation", "none", "bench_range_models.py", "", True),
    Row("robust estimation", "none", "bench_robust.py", "", True),
    Row(
        "a solve of a million poses: CPU [s], peak memory [MiB]",
        "8 s",
        "complexity.py --point poses 1000010",
    ),
    Row(
        "a ping of 11 vehicles in a simulator's loop; four clients and two workers",
        "10 ms; 600 pings/s",
        "bench_service.py",
        "1 x 10",
        True,
    ),
    Row("a point of a sweep on Dask", "1.5 ms", "bench_sweep.py dask"),
    Row("a sweep beside its studies", "none", "bench_sweep.py overhead sharing scaling", "", True),
    Row(
        "a column of an atlas, all of a region's",
        "40 (Beaufort) and 100 (Fram) columns a second",
        "bench_atlas.py columns",
        "columns a second",
    ),
)


@cache
def printed(benchmark: str) -> tuple[str, float, float]:
    """What a benchmark prints, and the CPU and wall seconds that it takes."""
    script, *arguments = benchmark.split()
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, HERE / script, *arguments],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    text = (
        done.stdout
        if done.returncode == 0
        else done.stdout + f"failed: {done.stderr.strip()[-300:]}"
    )
    return text, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def print_row(number: int, row: Row) -> None:
    text, cpu, wall = printed(row.benchmark)
    print(
        f"\n{number}. {row.work}; goal: {row.goal}\n   {row.benchmark} ({cpu:.0f} s of CPU,"
        f" {wall:.0f} s)"
    )
    for line in text.splitlines():
        if line.strip() and re.search(f"{row.lines}|^failed|^nothing|^no reference", line):
            print(f"   | {line}")
    sys.stdout.flush()


def machine() -> str:
    """Processor, load and versions, and the time of a fixed work."""
    described = Path("/proc/cpuinfo").read_text() if sys.platform == "linux" else ""
    names = re.findall(r"^model name\s*: (.*)$", described, re.MULTILINE)
    numbers, seconds = np.random.default_rng(0).random(1_000_000), []
    for _ in range(9):
        start = time.process_time()
        np.sort(numbers)
        seconds.append(time.process_time() - start)
    return (
        f"{names[0] if names else platform.processor()}, {os.cpu_count()} processors, load"
        f" {os.getloadavg()[0]:.1f}; Python {platform.python_version()}, NumPy {np.__version__};"
        f" sorting a million numbers takes {1e3 * statistics.median(seconds):.1f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("rows", nargs="*", type=int, metavar="NUMBER")
    parser.add_argument("--list", action="store_true", help="show the rows only")
    parser.add_argument("--quick", action="store_true", help="leave out what takes minutes")
    options = parser.parse_args()
    if not options.list:
        print(machine())
    for number, row in enumerate(ROWS, start=1):
        if (options.rows and number not in options.rows) or (options.quick and row.minutes):
            continue
        if options.list:
            print(f"{number:2}  {row.work}; goal: {row.goal}; {row.benchmark}")
        else:
            print_row(number, row)
    if not options.list:
        print(f"\n{machine()}")


if __name__ == "__main__":
    main()
