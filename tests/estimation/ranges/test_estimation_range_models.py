"""Range models against closed forms, quadrature and finite differences."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from oracles import direct_travel_time_linear_gradient
from scipy.integrate import quad

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    ConstantSpeed,
    MeanSlowness,
    RangeEndpoints,
    RangeModel,
    TransmitterSpeed,
)

DUCT = MeanSlowness(
    [0.0, 50.0, 100.0, 400.0, 1000.0, 3000.0], [1440.0, 1447.0, 1436.0, 1461.0, 1463.0, 1492.0]
)
MODELS = [ConstantSpeed(1480.0), TransmitterSpeed(), DUCT]
places = st.tuples(st.floats(-5e3, 5e3), st.floats(-5e3, 5e3), st.floats(0.0, 2900.0))


def links_between(a, b, speed=1450.0):
    a, b = np.atleast_2d(a, b)
    return RangeEndpoints(np.zeros(len(a)), a, b, np.broadcast_to(speed, len(a)))


def test_one_speed_gives_distance_over_it():
    links = links_between([[0, 0, 0], [0, 0, 10]], [[300, 400, 0], [0, 0, 1460]], [1500.0, 1450.0])
    for model, seconds in (
        (ConstantSpeed(1500.0), [1 / 3, 1450 / 1500]),
        (TransmitterSpeed(), [1 / 3, 1.0]),
    ):
        np.testing.assert_allclose(model.predict(links).travel_time, seconds, rtol=1e-15)


@given(places, places)
@settings(max_examples=40)
def test_mean_slowness_is_the_chord_integral(a, b):
    a, b = np.array(a), np.array(b)
    knots = [(z - a[2]) / (b[2] - a[2]) for z in DUCT.depth] if abs(b[2] - a[2]) > 1.0 else []

    def slowness(t):
        return 1.0 / np.interp(a[2] + t * (b[2] - a[2]), DUCT.depth, DUCT.sound_speed)

    edges = [0.0, *sorted(t for t in knots if 0.0 < t < 1.0), 1.0]
    mean = sum(quad(slowness, *edge, epsrel=1e-12)[0] for edge in pairwise(edges))
    expected = np.linalg.norm(b - a) * mean
    assert DUCT.predict(links_between(a, b)).travel_time[0] == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )


def test_vertical_links_are_exact_and_others_never_too_early():
    c0, g = 1450.0, 0.017
    model = MeanSlowness([0.0, 5000.0], [c0, c0 + 5000.0 * g])
    a = np.array([[0.0, 0.0, 20.0]] * 3)
    b = np.array([[0.0, 0.0, 2500.0], [4000.0, 0.0, 900.0], [9000.0, 3000.0, 20.0]])
    ray = direct_travel_time_linear_gradient(a, b, sound_speed_surface=c0, gradient=g)
    late = 1450.0 * (model.predict(links_between(a, b)).travel_time - ray)
    assert abs(late[0]) < 1e-9  # m
    assert (late[1:] > 1e-3).all()
    level = g**2 * 9486.8**3 / 24 / c0**2  # to leading order
    assert late[2] == pytest.approx(level, rel=0.02)


def test_beyond_its_levels_a_profile_stays_as_it_ends():
    model = MeanSlowness([100.0, 200.0], [1450.0, 1460.0])
    time = model.predict(
        links_between([[0, 0, 0], [0, 0, 300]], [[0, 0, 100], [0, 0, 500]])
    ).travel_time
    np.testing.assert_allclose(time, [100 / 1450, 200 / 1460], rtol=1e-14)


@pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)
def test_gradients_are_those_of_finite_differences(model):
    rng = np.random.default_rng(1)
    a, b = (rng.uniform([-4e3, -4e3, 5], [4e3, 4e3, 2900], (40, 3)) for _ in range(2))
    a[:5, 2] = b[:5, 2] = 223.0  # level chords, away from a kink
    found = model.predict(links_between(a, b))
    step = 0.05
    for k in range(3):
        e = np.eye(3)[k] * step
        for moved, gradient in (
            (True, found.transmitter_gradient),
            (False, found.receiver_gradient),
        ):
            ends = ((a + s * e * moved, b + s * e * (not moved)) for s in (1, -1))
            ahead, behind = (model.predict(links_between(*end)).travel_time for end in ends)
            slope = (ahead - behind) / (2 * step)
            np.testing.assert_allclose(gradient[:, k], slope, rtol=0, atol=3e-9)  # of 7e-4 s/m


@given(places, places)
@settings(max_examples=30)
def test_mean_slowness_is_reciprocal(a, b):
    there, back = DUCT.predict(links_between(a, b)), DUCT.predict(links_between(b, a))
    assert there.travel_time[0] == pytest.approx(back.travel_time[0], rel=1e-12)
    np.testing.assert_allclose(
        there.receiver_gradient, back.transmitter_gradient, rtol=0, atol=1e-12
    )


def test_nearly_level_chords_join_level_ones():
    down = np.array([-0.0101, -0.0099, -1e-10, 0.0, 1e-10, 0.0099, 0.0101])
    a = np.tile([0.0, 0.0, 50.0], (down.size, 1))  # on a kink
    b = a + np.array([8000.0, 0.0, 0.0]) + down[:, None] * [0, 0, 1]
    found = DUCT.predict(links_between(a, b))
    assert np.isfinite(found.receiver_gradient).all()
    assert (
        1450.0 * np.ptp(found.travel_time) < 1e-2
    )  # m, over 2 cm of depth in a gradient of 0.2 per second


@pytest.mark.parametrize(("make", "message"), [
    (lambda: ConstantSpeed(0.0), "sound speed 0.0 m/s"),
    (lambda: MeanSlowness([0.0], [1500.0]), "at least two increasing"),
    (lambda: MeanSlowness([0.0, 0.0], [1500.0, 1500.0]), "increasing depths"),
    (lambda: MeanSlowness([0.0, 10.0], [1500.0, -1.0]), "sound speed -1 m/s"),
])  # fmt: skip
def test_impossible_models_are_refused(make, message):
    with pytest.raises(EstimationError, match=message):
        make()


def test_a_range_model_needs_a_prediction_alone():
    class Chord(RangeModel):
        def predict(self, links):
            return ConstantSpeed(1500.0).predict(links)

    with pytest.raises(TypeError, match="predict"):
        RangeModel()
    model = Chord()
    assert model.speed(np.array([1490.0])) is None
    assert model.amplitude_sigma.size == 0
    assert model.adjusted(np.empty(0)) is model
    assert not model.needs_sound_speed
    assert TransmitterSpeed().needs_sound_speed
