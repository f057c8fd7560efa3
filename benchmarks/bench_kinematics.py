"""Time the fleet's kinematics at the paper's size: 168 h, 11 vehicles, steps of 0.125 s.

Run with ``python benchmarks/bench_kinematics.py``. The ocean and the fleet are those of the preset.
"""

import statistics
import time

from pymantaray.config import load_study
from pymantaray.config.door.fleet import build_vehicles
from pymantaray.fleet import simulate
from pymantaray.ocean import open_ocean, to_local


def main() -> None:
    config = load_study("beaufort")
    ocean = to_local(open_ocean("synthetic:beaufort"))
    fleet = build_vehicles(config.fleet)
    seconds = []
    for _ in range(6):
        start = time.perf_counter()
        truth = simulate(
            fleet, ocean, duration=168 * 3600.0, physics_step=0.125, sampling_period=200.0
        )
        seconds.append(time.perf_counter() - start)
    print(
        f"{truth.position.shape[0]} vehicles, {168 * 3600 * 8:,} steps each: first call"
        f" {seconds[0]:.2f} s, then {statistics.median(seconds[1:]):.2f} s ({min(seconds[1:]):.2f}"
        f" to {max(seconds[1:]):.2f})"
    )


if __name__ == "__main__":
    main()
