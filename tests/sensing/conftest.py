"""Small fleets with known poses, and measurements of them."""

import numpy as np
import pytest

from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp
from pymantaray.records import RangingTruth, Trajectories
from pymantaray.sensing import Attempts, Landmark, NoiseModel, Ranging, assemble, attempts

PERIOD = 200.0  # s
LANDMARKS = (Landmark("L1", (900.0, -900.0, 300.0)), Landmark("L2", (-1200.0, 0.0, 50.0)))


def build_truth(names="ABC", n_time=13, seed=0):
    """
    Poses of a random walk with rotation, spread over 2 km.

    Each vehicle's path depends on its own name only, so that fleets can grow.
    """
    position, quaternion = [], []
    for name in names:
        rng = np.random.default_rng([seed, ord(name)])
        start = np.array([*rng.uniform(-1000, 1000, 2), 300.0])
        steps = rng.uniform(-20, 20, (n_time, 3)) * [1, 1, 0.3]
        position.append(start + np.cumsum(steps, axis=0))
        quaternion.append(quaternion_from_matrix(so3_exp(rng.uniform(-2, 2, (n_time, 3)))))
    return Trajectories(
        name=list(names),
        role=["float"] * len(names),
        time=PERIOD * np.arange(n_time),
        position=position,
        quaternion=quaternion,
        status=np.zeros((len(names), n_time)),
    )


def build_ranging(truth, landmarks=LANDMARKS, epochs=(4, 8, 12), bias=7.0):
    """
    Range every pair without acoustics: the refracted range is longer by `bias`, and NaN for A to C.

    Links and arrivals are those of no link, since nothing downstream reads them.
    """
    fixed = np.array([landmark.position for landmark in landmarks]).reshape(-1, 3)
    table = attempts(len(truth.name), len(fixed), np.array(epochs))
    fixed = np.broadcast_to(fixed[:, None], (len(fixed), truth.time.size, 3))
    place = np.concatenate([truth.position, fixed])
    distance = np.linalg.norm(
        place[table.transmitter, table.sample] - place[table.receiver, table.sample], axis=-1
    )
    dropout = (table.transmitter == 0) & (table.receiver == 2)
    return Ranging(
        attempts=Attempts(*table),
        status=dropout.astype(np.int8),
        truth=RangingTruth(
            distance=distance,
            sound_speed=np.full(distance.size, 1450.0),
            travel_time=(distance + np.where(dropout, np.nan, bias)) / 1450.0,
            chord_travel_time=distance / 1450.0,
        ),
        links=None,
        arrivals=None,
    )


@pytest.fixture(scope="session")
def make_truth():
    return build_truth


@pytest.fixture(scope="session")
def make_ranging_truth():
    return lambda names="ABC": build_ranging(build_truth(names)).truth


@pytest.fixture(scope="session")
def make_measurements():
    def make(names="ABC", n_time=13, noise=None, landmarks=LANDMARKS, gnss_depth=1.0, epochs=(4, 8, 12)):
        truth = build_truth(names, n_time)
        ranging = build_ranging(truth, landmarks, epochs)
        return assemble(truth, landmarks, ranging, noise or NoiseModel(), gnss_depth=gnss_depth)

    return make
