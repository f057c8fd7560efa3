"""Ranging in water that varies in time: every ping in the water of its own time, and nothing else changes."""

import weakref
from dataclasses import fields, replace

import numpy as np
import pytest

from pymantaray.acoustics import Absorption, Currents, Medium, Sonar
from pymantaray.records import RayStatus, VehicleStatus
from pymantaray.sensing import Detector, Landmark, PingSchedule, TwoWay, measure_ranges

SCHEDULE = PingSchedule(800.0)  # at 800, 1600 and 2400 s
PINGS = np.array([800.0, 1600.0, 2400.0])
LANDMARKS = [Landmark("L1", (900.0, -900.0, 300.0)), Landmark("L2", (-1200.0, 0.0, 250.0))]
SONAR = Sonar(source_level_db=150.0, frequency_hz=25e3, bandwidth_hz=4e3, noise=45.0)
DEPTH = np.array([0.0, 1500.0, 4000.0])


def uniform(speed):
    return Medium.from_profile(DEPTH, np.full(3, speed), bottom_depth=3000.0, interpolation="linear")


@pytest.fixture(scope="module")
def refracting():
    return Medium.from_profile(DEPTH, 1450.0 + 0.016 * DEPTH, bottom_depth=3000.0, interpolation="linear")


@pytest.fixture(scope="module")
def truth(make_truth):
    """Vehicle B stops between the first and the second ping."""
    truth = make_truth("ABCD")
    status = truth.status.copy()
    status[1, 6:] = VehicleStatus.GROUNDED
    return replace(truth, status=status)


def assert_same(one, other):
    for name, a, b in zip(one._fields, one, other, strict=True):
        if name in ("truth", "links", "arrivals"):
            pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)]
        else:
            pairs = list(zip(a, b, strict=True)) if name == "attempts" else [(a, b)]
        for x, y in pairs:
            np.testing.assert_array_equal(x, y, err_msg=name)


@pytest.mark.parametrize("timing", [{}, {"timing": TwoWay(0.0)}])
def test_travel_time_is_the_distance_over_the_sound_speed_of_the_ping(make_truth, timing):
    """Water that warms evenly; the vehicles' own motion is taken out by holding them."""
    truth = make_truth("ABC")
    truth = replace(truth, position=np.broadcast_to(truth.position[:, :1], truth.position.shape))

    def speed(t):
        return 1450.0 + 0.01 * np.asarray(t)

    ranging = measure_ranges(truth, LANDMARKS, lambda t: uniform(speed(t)), SCHEDULE, **timing)
    sent = truth.time[ranging.attempts.sample]
    assert set(sent) == set(PINGS)
    assert (ranging.status == RayStatus.OK).all()
    np.testing.assert_allclose(ranging.truth.travel_time, ranging.truth.distance / speed(sent), rtol=1e-12)
    np.testing.assert_allclose(
        ranging.truth.chord_travel_time, ranging.truth.distance / speed(sent), rtol=1e-12
    )
    np.testing.assert_allclose(ranging.truth.sound_speed, speed(sent), rtol=1e-15)
    np.testing.assert_allclose(ranging.truth.refracted_range, ranging.truth.distance, rtol=1e-12)
    links, time = ranging.links, ranging.arrivals.first().travel_time
    places = np.concatenate([truth.position[:, 0], [mark.position for mark in LANDMARKS]])
    distance = np.linalg.norm(places[links.first] - places[links.second], axis=-1)
    np.testing.assert_allclose(time, distance / speed(truth.time[links.sample]), rtol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_surface_bounces": 1, "arrival": "first"},
        {"currents": Currents.uniform(0.3, -0.4), "timing": TwoWay(1.0)},
        {"detector": Detector(SONAR, absorption=Absorption.thorp()), "max_surface_bounces": 1},
        {"currents": Currents.uniform(0.3, -0.4), "detector": Detector(SONAR)},
    ],
)
def test_water_that_is_always_the_same_is_still_water_to_the_last_digit(truth, refracting, options):
    still = measure_ranges(truth, LANDMARKS, refracting, SCHEDULE, **options)
    assert {RayStatus.OK, RayStatus.STOPPED} <= set(still.status)
    if "currents" in options:
        current = options["currents"]
        options = options | {"currents": lambda _: current}
    varying = measure_ranges(truth, LANDMARKS, lambda _: refracting, SCHEDULE, **options)
    assert (still.probability is None) == (varying.probability is None)
    assert_same(varying, still)


def test_each_ping_is_the_still_result_in_its_own_water(truth):
    """Rays, chords and sound speeds of a refracting medium that changes, silent pairs included."""

    def medium(t):
        speed = 1450.0 + (0.016 + 4e-6 * t) * DEPTH
        return Medium.from_profile(DEPTH, speed, bottom_depth=3000.0, interpolation="linear")

    varying = measure_ranges(truth, LANDMARKS, medium, SCHEDULE)
    for ping in PINGS:
        still = measure_ranges(truth, LANDMARKS, medium(ping), SCHEDULE)
        now = truth.time[still.attempts.sample] == ping
        np.testing.assert_array_equal(varying.status[now], still.status[now])
        for name in ("travel_time", "chord_travel_time", "sound_speed"):
            np.testing.assert_array_equal(getattr(varying.truth, name)[now], getattr(still.truth, name)[now])
        assert now.sum() == 4 * (3 + 2)


def test_the_current_is_that_of_the_ping(make_truth):
    """A current that turns from north to south between the pings, in water that stands still."""
    truth, c = make_truth("ABC"), 1480.0
    velocity = {800.0: 0.4, 1600.0: 0.0, 2400.0: -0.6}
    ranging = measure_ranges(
        truth, LANDMARKS, uniform(c), SCHEDULE, currents=lambda t: Currents.uniform(velocity[t], 0.0)
    )
    table = ranging.attempts
    fixed = np.array([mark.position for mark in LANDMARKS])
    place = np.concatenate([truth.position, np.broadcast_to(fixed[:, None], (2, *truth.position.shape[1:]))])
    step = place[table.receiver, table.sample] - place[table.transmitter, table.sample]
    north = np.array([velocity[t] for t in truth.time[table.sample]])
    first_order = ranging.truth.distance / c - north * step[:, 0] / c**2
    np.testing.assert_allclose(ranging.truth.travel_time, first_order, rtol=0, atol=1e-12)
    assert np.abs(ranging.truth.travel_time - ranging.truth.distance / c).max() > 1e-4


def test_media_are_made_once_a_ping_and_let_go_again(truth, refracting):
    made, asked = [], []

    def medium(t):
        assert not any(old() for old in made), "an earlier medium is still held"
        fresh = replace(refracting)
        made.append(weakref.ref(fresh))
        asked.append(t)
        return fresh

    measure_ranges(truth, LANDMARKS, medium, SCHEDULE, currents=Currents.uniform(0.1, 0.0), threads=1)
    assert asked == PINGS.tolist()


def test_result_does_not_depend_on_the_threads(truth, refracting):
    one, two = (measure_ranges(truth, LANDMARKS, lambda _: refracting, SCHEDULE, threads=n) for n in (1, 2))
    assert_same(one, two)


@pytest.mark.parametrize("options", [{}, {"detector": Detector(SONAR), "max_surface_bounces": 1}])
def test_progress_rises_to_the_number_of_pairs(truth, refracting, options):
    seen = []
    measure_ranges(truth, [], lambda _: refracting, SCHEDULE, progress=lambda *s: seen.append(s), **options)
    done, total = zip(*seen, strict=True)
    assert set(total) == {3 * 6}
    assert list(done) == sorted(done)
    assert done[-1] == 3 * 6
    assert {6, 12} <= set(done)


def test_one_vehicle_alone_ranges_nobody(make_truth, refracting):
    ranging = measure_ranges(make_truth("A"), [], lambda _: refracting, SCHEDULE)
    assert ranging.status.size == ranging.links.sample.size == 0
