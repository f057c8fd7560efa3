"""
Time from the command to the first answer: compilation of the kernels, imports, and messages that
need neither.

Run with ``python benchmarks/bench_start.py``. Kernels are compiled in a fresh process into a cache
folder of its own, so that the installed one is left alone; the same process again takes them from
there. Commands run several times: median and largest. CPU seconds of the child processes, which
other work on the machine disturbs less than wall time.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

KERNELS = """
import json, sys, time
sys.path.insert(0, FOLDER)
parts, since = {}, time.process_time()
def took(name):
    global since
    parts[name] = time.process_time() - since
    since = time.process_time()
import numpy as np, xarray as xr
from pymantaray.acoustics import Medium, find_eigenrays, ray_picture, trace_paths
from pymantaray.fleet import ConstantTwist, FloatCycle, Vehicle, Waypoints, simulate
import bench_solve
took("imports")
medium = Medium.from_profile([0.0, 100.0, 4000.0], [1500.0, 1490.0, 1550.0], bottom_depth=3000.0)
ends = [0.0, 0.0, 10.0], [1000.0, 0.0, 20.0]
arrivals = find_eigenrays(medium, *ends)
took("direct rays")
find_eigenrays(medium, *ends, 2, 2)
took("reflected rays")
trace_paths(medium, *ends, arrivals)
ray_picture(medium, *ends, fan_angles=[0.1])
took("paths and sections")
axes = {"north": [-5e3, 5e3], "east": [-5e3, 5e3], "depth": [0.0, 500.0]}
still = xr.Dataset(
    {"current_north": (tuple(axes), np.zeros((2, 2, 2))),
     "current_east": (tuple(axes), np.zeros((2, 2, 2))),
     "sea_floor_depth": (("north", "east"), np.full((2, 2), 400.0))}, coords=axes)
moving = still.expand_dims(time=[0.0, 100.0])
moving["sea_floor_depth"] = still.sea_floor_depth
for water in (still, moving):
    route = Waypoints(((0.0, 0.0, 10.0),), 1.0, 0.5, 10.0)
    ways = FloatCycle(100.0, 60.0), ConstantTwist((0.0,) * 6), route
    fleet = [Vehicle(f"V{i}", (0.0, 0.0, 5.0), way) for i, way in enumerate(ways)]
    simulate(fleet, water, duration=100.0, physics_step=1.0, sampling_period=50.0)
took("fleet")
position, rotation = bench_solve.fleet(np.random.default_rng(0), turn=0.0, n_times=80)
quaternion = bench_solve.quaternion_from_matrix(rotation)
measured = bench_solve.observe(position, rotation, np.random.default_rng(0))
bench_solve.solve_conditions(measured, bench_solve.CONDITIONS, (position, quaternion))
took("solves")
print(json.dumps(parts))
"""
COMMAND = "import sys; from pymantaray.cli.main import main; sys.exit(main())"
COMMANDS = {
    "mantaray --help": ["--help"],
    "mantaray study list": ["study", "list"],
    "mantaray study run nosuch": ["study", "run", "nosuch"],
    "mantaray study run of a bad file": ["study", "run", "bad.toml"],
}


def child(arguments: list[str], folder: str, **environment: str) -> tuple[str, float, float]:
    """Run Python on arguments; what it printed, and its CPU and wall seconds."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if "Traceback" in done.stderr:
        raise SystemExit(done.stderr)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def measure_kernels() -> dict[str, dict[str, float]]:
    """
    CPU seconds of each part from an empty cache and from a full one, and CPU and wall seconds of
    the whole process.
    """
    figures = {}
    with tempfile.TemporaryDirectory() as cache:
        for label in ("from an empty cache", "from a full cache"):
            printed, cpu, wall = child(
                ["-c", KERNELS.replace("FOLDER", repr(str(Path(__file__).parent)))],
                cache,
                NUMBA_CACHE_DIR=cache,
            )
            figures[label] = {**json.loads(printed), "process": cpu, "process, wall": wall}
    return figures


def measure_commands(runs: int) -> dict[str, list[tuple[float, float]]]:
    """CPU and wall seconds of commands that only have something to say, of each run."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bad.toml").write_text("[mission\n")
        for words in COMMANDS.values():  # byte code is compiled once
            child(["-c", COMMAND, *words], folder)
        return {
            name: [child(["-c", COMMAND, *words], folder)[1:] for _ in range(runs)]
            for name, words in COMMANDS.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    for label, parts in measure_kernels().items():
        print(f"kernels {label}: " + ", ".join(f"{name} {s:.2f} s" for name, s in parts.items()))
    for name, seconds in measure_commands(options.runs).items():
        cpu, wall = ([pair[k] for pair in seconds] for k in (0, 1))
        print(
            f"{name}: {statistics.median(cpu):.2f} s of CPU ({max(cpu):.2f}), wall"
            f" {statistics.median(wall):.2f} s"
        )


if __name__ == "__main__":
    main()
