"""Small fleets with known poses, and measurements of them that need no acoustics."""

import numpy as np
import pytest
from factories import trajectories

from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp
from pymantaray.records import RangingTruth
from pymantaray.sensing import Landmark, NoiseModel, Ranging, assemble
from pymantaray.sensing.schedule import attempts

LANDMARKS = (Landmark("L1", (900.0, -900.0, 300.0)), Landmark("L2", (-1200.0, 0.0, 250.0)))


def build_truth(names="ABC", n_time=13, seed=0):
    """
    Random walks with rotation every 200 s, spread over 2 km; each depends on its vehicle's name
    alone.
    """
    position, quaternion = [], []
    for name in names:
        rng = np.random.default_rng([seed, ord(name)])
        start = np.array([*rng.uniform(-1000, 1000, 2), 300.0])
        steps = rng.uniform(-20, 20, (n_time, 3)) * [1, 1, 0.3]
        position.append(start + np.cumsum(steps, axis=0))
        quaternion.append(quaternion_from_matrix(so3_exp(rng.uniform(-2, 2, (n_time, 3)))))
    roles = ["float"] * len(names)
    return trajectories(
        np.array(position), names=list(names), roles=roles, quaternion=np.array(quaternion)
    )


def build_ranging(truth, landmarks=LANDMARKS, epochs=(4, 8, 12)):
    """Ranges of all pairs at 1450 m/s over ways 7 m longer than the chords; A does not reach C."""
    table = attempts(len(truth.name), len(landmarks), np.array(epochs))
    fixed = np.array([landmark.position for landmark in landmarks]).reshape(-1, 1, 3)
    place = np.concatenate([truth.position, np.tile(fixed, (1, truth.time.size, 1))])
    ends = (place[who, table.sample] for who in (table.transmitter, table.receiver))
    distance = np.linalg.norm(np.subtract(*ends), axis=-1)
    dropout = (table.transmitter == 0) & (table.receiver == 2)
    true = RangingTruth(
        distance=distance,
        sound_speed=np.full(distance.size, 1450.0),
        travel_time=(distance + np.where(dropout, np.nan, 7.0)) / 1450.0,
        chord_travel_time=distance / 1450.0,
    )
    return Ranging(
        table, dropout.astype(np.int8), true, links=None, arrivals=None, receptions=None, link=None
    )


@pytest.fixture(scope="session")
def make_truth():
    return build_truth


@pytest.fixture(scope="session")
def make_ranging_truth():
    return lambda names="ABC": build_ranging(build_truth(names)).truth


@pytest.fixture(scope="session")
def make_measurements():
    def make(
        names="ABC", n_time=13, noise=None, landmarks=LANDMARKS, gnss_depth=1.0, epochs=(4, 8, 12)
    ):
        truth = build_truth(names, n_time)
        ranging = build_ranging(truth, landmarks, epochs)
        return assemble(truth, landmarks, ranging, noise or NoiseModel(), gnss_depth=gnss_depth)

    return make


@pytest.fixture(scope="session")
def landmarks():
    return LANDMARKS
