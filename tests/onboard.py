"""
Calls that feed an estimator on board: a mission with odometry at 10 Hz, or the measurements of a
fleet.
"""

import numpy as np

from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
from pymantaray.geometry.se3 import matrix_from_quaternion, so3_exp, so3_log
from pymantaray.records.status import ARRIVES

SPEED = 1500.0  # m/s
START = StartPose((0.0, 0.0, 50.0), sigma=[0.001, 0.001, 0.01, 5.0, 5.0, 0.5])
BEACONS = {"north": Beacon((900.0, 100.0, 20.0)), "east": Beacon((-100.0, 800.0, 30.0), 1.0)}
STEP_SIGMA = [1e-4] * 3 + [0.005] * 3


def feed(estimator, calls):
    """Outcomes of calls ``(method, arguments, options)``."""
    return [
        getattr(estimator, f"add_{name}")(*arguments, **options)
        for name, arguments, options in calls
    ]


def mission(seconds=60.0, *, period=0.1, seed=1):
    """
    Calls of a vehicle that turns slowly, with depths each second and pings every 7.03 s, and its
    true positions by time.
    """
    rng = np.random.default_rng(seed)
    calls, truth, rotation, position = [], {}, np.eye(3), np.array([0.0, 0.0, 50.0])
    way, turn = np.array([1.5, 0.0, 0.02]) * period, np.array([0.0, 0.0, 0.02]) * period
    pings = np.arange(3.5, seconds - 1.0, 7.03)
    for k in range(round(seconds / period)):
        begin, end = k * period, (k + 1) * period
        for ping in pings[(pings > begin) & (pings <= end)]:
            here = position + (ping - begin) / period * rotation @ way
            for name, beacon in BEACONS.items():
                time = np.linalg.norm(here - beacon.position) / SPEED + 2e-4 * rng.standard_normal()
                calls.append(("range", (float(ping), name, float(time), 2e-4), {}))
        position, rotation = position + rotation @ way, rotation @ so3_exp(turn)
        noise = np.array(STEP_SIGMA) * rng.standard_normal(6)
        calls.append(("odometry", (end, way + noise[3:], turn + noise[:3], STEP_SIGMA), {}))
        if k % 10 == 9:
            calls.append(("depth", (end, position[2] + 0.05 * rng.standard_normal(), 0.05), {}))
        truth[end] = position
    return calls, truth


def fleet_estimator(o, ranges, **options):
    """Estimator with the priors of a fleet's measurements."""
    priors = zip(o.first_position, o.first_quaternion, o.first_sigma, strict=True)
    surveys = zip(o.landmark_position, o.landmark_sigma, strict=True)
    return OnlineEstimator(
        {str(name): StartPose(*prior) for name, prior in zip(o.name, priors, strict=True)},
        {str(name): Beacon(*survey) for name, survey in zip(o.landmark_name, surveys, strict=True)},
        ranges,
        start=float(o.time[0]),
        **options,
    )


def fleet_calls(o, distance):
    """
    Calls with all measurements of a fleet in the order of time; ``distance`` is the column of the
    ranges.
    """
    calls, names = [], [str(name) for name in (*o.name, *o.landmark_name)]
    rotation = so3_log(matrix_from_quaternion(o.odometry_rotation))
    for k, time in enumerate(o.time.tolist()):
        for v, vehicle in enumerate(o.name):
            own = {"vehicle": str(vehicle)}
            if k:
                step = (
                    o.odometry_translation[v, k - 1],
                    rotation[v, k - 1],
                    o.odometry_sigma[v, k - 1],
                )
                calls.append(("odometry", (time, *step), own))
            calls.append(("depth", (time, o.depth[v, k], o.depth_sigma[v]), own))
    for v, k, place, sigma in zip(
        o.gnss_vehicle, o.gnss_sample, o.gnss_position, o.gnss_sigma, strict=True
    ):
        calls.append(("fix", (float(o.time[k]), place, sigma), {"vehicle": names[v]}))
    for row in np.flatnonzero(np.isin(o.range_status, ARRIVES)):
        ends = int(o.range_transmitter[row]), int(o.range_receiver[row])
        source, vehicle = ends if ends[1] < o.name.size else ends[::-1]  # a distance is symmetric
        speed = float(o.transmitter_sound_speed[row])
        time = float(o.time[o.range_sample[row]])
        measured = getattr(o, distance)[row] / speed, o.range_sigma[row] / speed
        calls.append(
            (
                "range",
                (time, names[source], *measured),
                {"vehicle": names[vehicle], "sound_speed": speed},
            )
        )
    return sorted(calls, key=lambda call: call[1][0])
