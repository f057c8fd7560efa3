"""
Latency and memory of the estimator on board, in a mission of 24 h with odometry at 10 Hz.

Run with ``python benchmarks/bench_onboard.py [--hours 24] [--lag 60]``. The vehicle is AUV `B` of
the preset `survey`. Its odometry has the noise of the preset, spread evenly over the steps; it has
a depth each second. Every 5 minutes it hears the beacon `A` and both landmarks, and one range of
five is delayed by 10 s. The range model is the eigenrays of the preset's ocean. Latencies are those
of one call and of the position after it: CPU time of the thread, and wall-clock time, which also
counts the other work of the machine. Memory is the resident set of the process, printed every 24th
of the mission.
"""

import argparse
import resource
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.ocean_fields import build_medium
from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
from pymantaray.config import load_study
from pymantaray.config.door.fleet import build_vehicles
from pymantaray.config.door.ocean import mission_ocean
from pymantaray.fleet import simulate
from pymantaray.geometry.se3 import matrix_from_quaternion, so3_log

RATE = 10  # odometry per second
PING, DELAY, EVERY = (
    300,
    10,
    5,
)  # s between pings, s of delay, and one of this number of ranges is delayed


class Flight(NamedTuple):
    """True positions at the samples, and the motion between them with its standard deviations."""

    position: np.ndarray
    start: np.ndarray
    step: np.ndarray
    sigma: np.ndarray


def fly(hours: float, rng: np.random.Generator) -> tuple[Flight, Medium, dict[str, np.ndarray]]:
    """
    Motion of AUV `B` with the noise of its odometry, the water, and the positions of beacon and
    landmarks.
    """
    config = load_study("survey")
    ocean = mission_ocean(config)
    vehicles = {vehicle.name: vehicle for vehicle in build_vehicles(config.fleet)}
    truth = simulate(
        [vehicles["B"]],
        ocean.drift,
        duration=3600.0 * hours,
        physics_step=1.0 / RATE,
        sampling_period=1.0 / RATE,
    )
    position, quaternion = truth.position[0], truth.quaternion[0]
    to_world = matrix_from_quaternion(quaternion)
    way = np.einsum("nji,nj->ni", to_world[:-1], np.diff(position, axis=0))
    turn = so3_log(np.swapaxes(to_world[:-1], 1, 2) @ to_world[1:])
    period, speed = (
        config.mission.sampling_period_s,
        float(np.median(np.linalg.norm(way, axis=1)) * RATE),
    )
    noise = config.noise.model.odometry_sigma(
        [1.0, 0.0, 0.0, 0.0], [[speed * period, 0.0, 0.0]], [0.0, period]
    )
    sigma = noise[0] / np.sqrt(period * RATE)
    step = np.hstack([way, turn]) + sigma[[3, 4, 5, 0, 1, 2]] * rng.standard_normal((len(way), 6))
    members = {
        mark.name: np.array([mark.north, mark.east, mark.depth]) for mark in config.landmarks
    }
    station = next(vehicle for vehicle in config.fleet.vehicles if vehicle.name == "A")
    members["A"] = np.array([station.north, station.east, station.depth])
    medium = build_medium(ocean, config.acoustics.interpolation, config.acoustics.earth)
    return Flight(position, quaternion[0], step, sigma), medium, members


def memory() -> float:
    """Resident memory of the process. [MB]"""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


class Clock:
    """
    Latencies of calls by kind, in arrays that are filled before the mission, so that they do not
    grow.
    """

    def __init__(self, estimator: OnlineEstimator, steps: int) -> None:
        self._estimator = estimator
        sizes = {"odometry": steps, "depth": steps // RATE, "range": steps, "late range": steps}
        self._times = {kind: np.full((n, 2), np.nan, dtype=np.float32) for kind, n in sizes.items()}
        self._number = dict.fromkeys(sizes, 0)

    def call(self, kind: str, method: str, *arguments: object) -> None:
        """Call the estimator, and ask for the position."""
        wall, cpu = time.perf_counter(), time.thread_time()
        getattr(self._estimator, f"add_{method}")(*arguments)
        self._estimator.position()
        spent = time.thread_time() - cpu, time.perf_counter() - wall
        self._times[kind][self._number[kind]] = spent
        self._number[kind] += 1

    def report(self) -> None:
        """Print median and 99 % of each kind, and the median of the first and of the last tenth."""
        for kind, times in self._times.items():
            ms = 1e3 * times[: self._number[kind]]
            tenth = max(len(ms) // 10, 1)
            ends = np.median(ms[:tenth, 0]), np.median(ms[-tenth:, 0])
            print(
                f"{kind:10} {len(ms):7d} calls, ms of CPU: median {np.median(ms[:, 0]):7.3f}, 99 %"
                f" {np.percentile(ms[:, 0], 99):7.3f}; median of the first tenth {ends[0]:.3f}, of"
                f" the last {ends[1]:.3f}; wall-clock ms: median {np.median(ms[:, 1]):7.3f}, 99 %"
                f" {np.percentile(ms[:, 1], 99):7.3f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--lag", type=float, default=60.0, help="length of the history in seconds")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    flight, medium, members = fly(options.hours, rng)
    beacons = {name: Beacon(place, 0.0 if name == "A" else 0.5) for name, place in members.items()}
    start = StartPose(flight.position[0], flight.start, [1e-4] * 3 + [0.1] * 3)
    estimator = OnlineEstimator(start, beacons, medium, lag=options.lag)
    n = len(flight.step)
    clock, used, late, number = Clock(estimator, n), [], [], 0
    begin = time.process_time()
    for k in range(1, n + 1):
        now, step = k / RATE, flight.step[k - 1]
        clock.call("odometry", "odometry", now, step[:3], step[3:], flight.sigma)
        if k % RATE == 0:
            clock.call(
                "depth", "depth", now, flight.position[k, 2] + 0.01 * rng.standard_normal(), 0.01
            )
        if k % (PING * RATE) == 0:
            for name, place in members.items():
                number += 1
                rays = find_eigenrays(medium, place[None], flight.position[k, None])
                if not rays.travel_time.size:
                    continue
                heard = now, name, rays.travel_time.min() + 7e-4 * rng.standard_normal(), 7e-4
                if number % EVERY == 0:
                    late.append((k + DELAY * RATE, heard))
                else:
                    clock.call("range", "range", *heard)
        while late and late[0][0] == k:
            clock.call("late range", "range", *late.pop(0)[1])
        if k % (n // 24) == 0:
            used.append(memory())
    clock.report()
    error = np.linalg.norm(estimator.position() - flight.position[-1])
    print("memory in MB: " + ", ".join(f"{megabytes:.1f}" for megabytes in used))
    counts = {name: count for name, count in estimator.counts().items() if count}
    print(
        f"{options.hours:g} h, history of {options.lag:g} s; {time.process_time() - begin:.0f} s of"
        f" CPU; error at the end {error:.2f} m; {counts}"
    )


if __name__ == "__main__":
    main()
