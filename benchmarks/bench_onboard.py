"""Latency and memory of the estimator on board, in a mission of 24 h with odometry at 10 Hz.

Run with ``python benchmarks/bench_onboard.py [--hours 24] [--lag 60]``. The vehicle has a depth each second and hears a beacon each 20 s,
one ping in five is delayed by 10 s. Latencies are wall-clock times of one call and of the position after it; memory is that of the process.
"""

import argparse
import resource
import time

import numpy as np

from pymantaray.online import Beacon, OnlineEstimator, StartPose

RATE, SPEED, TURN = 10, 1.5, 0.01  # 1/s, m/s, rad/s
BEACONS = {"B1": Beacon((300.0, 0.0, 20.0)), "B2": Beacon((0.0, 400.0, 20.0))}
SIGMA = np.array([1e-5, 1e-5, 1e-5, 0.005, 0.005, 0.005])


def memory() -> float:
    """Largest memory of the process so far. [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def position_at(seconds: float) -> np.ndarray:
    """True position on a circle."""
    angle, radius = TURN * seconds, SPEED / TURN
    return np.array([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), 50.0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--lag", type=float, default=60.0, help="length of the history in seconds")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    estimator = OnlineEstimator(StartPose((0.0, 0.0, 50.0)), BEACONS, 1500.0, lag=options.lag)
    latency: dict[str, list[float]] = {"odometry": [], "depth": [], "range": [], "late range": []}
    late: list[tuple[int, tuple]] = []

    def timed(kind: str, call: str, *arguments: object) -> None:
        begin = time.perf_counter()
        getattr(estimator, f"add_{call}")(*arguments)
        estimator.position()
        latency[kind].append(time.perf_counter() - begin)

    n, chord = round(options.hours * 3600 * RATE), SPEED / RATE
    way, turn = np.array([chord, 0.5 * chord * TURN / RATE, 0.0]), np.array([0.0, 0.0, TURN / RATE])
    begin, used = time.process_time(), []
    for k in range(1, n + 1):
        now = k / RATE
        noise = SIGMA * rng.standard_normal(6)
        timed("odometry", "odometry", now, way + noise[3:], turn + noise[:3], SIGMA)
        if k % RATE == 0:
            timed("depth", "depth", now, 50.0 + 0.1 * rng.standard_normal(), 0.1)
        if k % (20 * RATE) == 0:
            name = ("B1", "B2")[k // (20 * RATE) % 2]
            distance = np.linalg.norm(position_at(now) - np.asarray(BEACONS[name].position))
            heard = (now, name, distance / 1500.0 + 2e-4 * rng.standard_normal(), 2e-4)
            if k % (100 * RATE) == 0:
                late.append((k + 10 * RATE, heard))
            else:
                timed("range", "range", *heard)
        if late and late[0][0] == k:
            timed("late range", "range", *late.pop(0)[1])
        if k in (n // 24, n):
            used.append(memory())
    for kind, seconds in latency.items():
        ms = 1e3 * np.array(seconds)
        print(
            f"{kind:10} {ms.size:7d} calls: median {np.median(ms):7.3f} ms, 99 % {np.percentile(ms, 99):7.3f} ms"
        )
    error = np.linalg.norm(estimator.position() - position_at(n / RATE))
    print(
        f"memory {used[0]:.1f} MB after 1/24 of the mission, {used[-1]:.1f} MB at its end; history of {options.lag:g} s"
    )
    print(f"{time.process_time() - begin:.0f} s of CPU; error at the end {error:.2f} m; {estimator.counts()}")


if __name__ == "__main__":
    main()
