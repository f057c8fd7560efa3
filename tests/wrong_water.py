"""
Made-up missions whose water the range model does not have: times of circular rays in a linear
profile, constant or with a tide, and a reflection in place of direct arrivals.
"""

import numpy as np
from oracles import direct_travel_time_linear_gradient

from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
from pymantaray.geometry.se3 import so3_exp

SPEED, MIDDLE = 1480.0, 60.0  # m/s; depth at which all profiles have it [m]
GRADIENT, TIDE = 0.08, 7200.0  # 1/s, standard deviation; s
BEACONS = {
    "B1": (900.0, -200.0, 40.0),
    "B2": (-300.0, 1100.0, 150.0),
    "B3": (-800.0, -700.0, 20.0),
    "B4": (600.0, -1000.0, 90.0),
}
DEPTH, STEP, PERIOD = 50.0, 5.0, 10.0  # m, and s of odometry and between pings
NOISE = 2e-4  # s
START = np.array([5e-4, 5e-4, 0.005, 3.0, 3.0, 0.1])
ODOMETRY = np.array([1e-5, 1e-5, 2e-4, 0.03, 0.03, 0.01])


def travel_time(place, position, gradient):
    """Time of the direct ray in a linear profile. [s]"""
    if abs(gradient) < 1e-9:
        return float(np.linalg.norm(position - place)) / SPEED
    return float(
        direct_travel_time_linear_gradient(
            place[None],
            position[None],
            sound_speed_surface=SPEED - gradient * MIDDLE,
            gradient=gradient,
        )[0]
    )


def estimator(**options):
    """Estimator with the beacons and a constant speed; `mission` draws the error of its start."""
    beacons = {name: Beacon(place) for name, place in BEACONS.items()}
    start = StartPose((0.0, 0.0, DEPTH), sigma=START)
    return OnlineEstimator(start, beacons, SPEED, **options)


def mission(estimators, kind, seed, *, hours=1.0):
    """
    Feed estimators with one mission, and return their horizontal errors [m] and their NEES with 3
    degrees of freedom, (n_estimators, n_pings) each.

    ``kind`` is ``right`` for the speed of the model, ``slight``, ``profile`` or ``tide`` for a
    gradient that is drawn, a tenth of it, or one that goes with a tide, and ``reflected`` for the
    right speed and a way whose arrival is reflected at the surface.
    """
    rng = np.random.default_rng(seed)
    first = START * rng.standard_normal(6)
    rotation = so3_exp(first[:3])
    position = np.array([0.0, 0.0, DEPTH]) + rotation @ first[3:]
    phase, gradient = rng.uniform(0.0, 2.0 * np.pi), GRADIENT * rng.standard_normal()
    gradient *= {"slight": 0.1, "profile": 1.0, "tide": 1.0}.get(kind, 0.0)
    errors, nees = [], []
    for k in range(1, round(3600.0 * hours / STEP) + 1):
        time = k * STEP
        turn = np.array([0.0, 0.0, np.pi / 40.0 if (k // 40) % 3 == 2 else 0.0])
        forward = np.array([1.2 * STEP, 0.0, 0.0])
        position, rotation = position + rotation @ forward, rotation @ so3_exp(turn)
        noise = ODOMETRY * rng.standard_normal(6)
        depth = position[2] + 0.05 * rng.standard_normal()
        for one in estimators:
            one.add_odometry(time, forward + noise[3:], turn + noise[:3], ODOMETRY)
            one.add_depth(time, depth, 0.05)
        if time % PERIOD:
            continue
        name, place = list(BEACONS.items())[round(time / PERIOD) % len(BEACONS)]
        is_reflected = kind == "reflected" and name == "B2"
        image = np.array(place) * [1.0, 1.0, -1.0 if is_reflected else 1.0]
        tide = np.cos(2.0 * np.pi * time / TIDE + phase) if kind == "tide" else 1.0
        measured = travel_time(image, position, gradient * tide) + NOISE * rng.standard_normal()
        for one in estimators:
            one.add_range(time, name, measured, NOISE)
        off = [one.position() - position for one in estimators]
        errors.append([np.hypot(*x[:2]) for x in off])
        pairs = zip(off, estimators, strict=True)
        nees.append([x @ np.linalg.solve(one.covariance(), x) for x, one in pairs])
    return np.transpose(errors), np.transpose(nees)
