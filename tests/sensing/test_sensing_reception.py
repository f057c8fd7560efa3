"""Currents, multipath and detection on the way from rays to ranges, in water of constant sound speed."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import norm

from pymantaray.acoustics import Absorption, Currents, Medium, Sonar, find_eigenrays
from pymantaray.records import RayStatus
from pymantaray.sensing import Detector, Landmark, PingSchedule, TwoWay, measure_ranges

C = 1480.0
SCHEDULE = PingSchedule(800.0)
LANDMARKS = [Landmark("L1", (900.0, -900.0, 300.0)), Landmark("L2", (-1200.0, 0.0, 250.0))]
CURRENT = Currents.uniform(0.3, -0.4)
VELOCITY = np.array([0.3, -0.4, 0.0])
SONAR = Sonar(source_level_db=150.0, frequency_hz=25e3, bandwidth_hz=4e3, noise=45.0)


@pytest.fixture(scope="module")
def water():
    return Medium.from_profile([0.0, 1500.0, 4000.0], [C, C, C], bottom_depth=3000.0, interpolation="linear")


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("ABC")


def steps(truth, ranging):
    fixed = np.array([mark.position for mark in LANDMARKS])
    place = np.concatenate([truth.position, np.broadcast_to(fixed[:, None], (2, *truth.position.shape[1:]))])
    table = ranging.attempts
    return place[table.receiver, table.sample] - place[table.transmitter, table.sample]


def test_one_way_a_current_carries_the_sound_there_and_holds_it_up_on_the_way_back(truth, water):
    """Closed form of a constant current; what is of second order is below a millimetre."""
    ranging = measure_ranges(truth, LANDMARKS, water, SCHEDULE, currents=CURRENT)
    step = steps(truth, ranging)
    along, slower = step @ VELOCITY, C**2 - VELOCITY @ VELOCITY
    exact = (np.sqrt(along**2 + slower * np.einsum("ij,ij->i", step, step)) - along) / slower
    assert (ranging.status == RayStatus.OK).all()
    np.testing.assert_allclose(ranging.truth.travel_time, exact, rtol=0, atol=5e-7)
    assert np.abs(ranging.truth.refracted_range - ranging.truth.distance).max() > 0.3
    still = measure_ranges(truth, LANDMARKS, water, SCHEDULE)
    np.testing.assert_array_equal(ranging.arrivals.travel_time, still.arrivals.travel_time)


def test_two_way_the_current_cancels(truth, water):
    moving = measure_ranges(truth, LANDMARKS, water, SCHEDULE, currents=CURRENT, timing=TwoWay(1.0))
    still = measure_ranges(truth, LANDMARKS, water, SCHEDULE, timing=TwoWay(1.0))
    # of the delay u/c t what moves with the vehicles, v/c of it, does not cancel
    np.testing.assert_allclose(moving.truth.travel_time, still.truth.travel_time, rtol=0, atol=3e-7)


def test_blocks_of_links_change_nothing(truth, water, monkeypatch):
    options = {"currents": CURRENT, "detector": Detector(SONAR, absorption=Absorption.thorp())}
    whole = measure_ranges(truth, LANDMARKS, water, SCHEDULE, **options)
    monkeypatch.setattr("pymantaray.sensing.ranging._BLOCK", 4)
    parts = measure_ranges(truth, LANDMARKS, water, SCHEDULE, **options)
    np.testing.assert_array_equal(parts.truth.travel_time, whole.truth.travel_time)
    np.testing.assert_array_equal(parts.probability, whole.probability)


def test_probability_follows_the_sonar_equation_by_hand(truth, water):
    """Spherical spreading and Thorp's absorption in water without refraction."""
    thorp = Absorption.thorp()
    one = measure_ranges(truth, LANDMARKS, water, SCHEDULE, detector=Detector(SONAR, absorption=thorp))
    distance = np.linalg.norm(steps(truth, one), axis=-1)
    alpha = thorp.db_per_km(np.zeros((1, 3)), 25e3)[0]
    loss = 20.0 * np.log10(distance) + alpha * distance / 1e3
    excess = 150.0 - (45.0 + 10.0 * np.log10(4e3)) - 10.0 - loss
    np.testing.assert_allclose(one.probability, norm.cdf(excess / 6.0), rtol=1e-6)
    assert np.ptp(one.probability) > 0.1
    two = measure_ranges(
        truth, LANDMARKS, water, SCHEDULE, detector=Detector(SONAR, absorption=thorp), timing=TwoWay()
    )
    np.testing.assert_allclose(two.probability, one.probability**2, rtol=1e-12)


def test_a_link_without_an_arrival_has_no_probability(truth, water):
    buried = [Landmark("L1", (0.0, 0.0, 3100.0))]
    ranging = measure_ranges(truth, buried, water, SCHEDULE, detector=Detector(SONAR))
    np.testing.assert_array_equal(np.isnan(ranging.probability), ranging.status != RayStatus.OK)
    assert np.isnan(ranging.probability).any()


def test_without_a_detector_there_is_no_probability(truth, water):
    assert measure_ranges(truth, LANDMARKS, water, SCHEDULE).probability is None


@pytest.fixture(scope="module")
def ridged():
    """A ridge up to 150 m hides one side from the other, but not from a bounce at the surface."""
    north, east = np.array([-5e3, 1.9e3, 2e3, 2.1e3, 8e3]), np.array([-5e3, 5e3])
    bathymetry = np.full((5, 2), 1000.0)
    bathymetry[2] = 150.0
    return Medium.from_grid(
        north, east, [0.0, 2000.0], np.full((5, 2, 2), C), bathymetry=bathymetry, interpolation="linear"
    )


HIDDEN = Landmark("L1", (4000.0, 0.0, 250.0))


def test_by_direct_the_bounces_allowed_change_neither_times_nor_statuses(truth, ridged):
    bare = measure_ranges(truth, [HIDDEN], ridged, SCHEDULE)
    more = measure_ranges(truth, [HIDDEN], ridged, SCHEDULE, max_surface_bounces=1, max_bottom_bounces=1)
    assert more.arrivals.link.size > bare.arrivals.link.size
    assert set(bare.status) == {RayStatus.OK, RayStatus.BLOCKED}
    np.testing.assert_array_equal(more.status, bare.status)
    np.testing.assert_array_equal(more.truth.travel_time, bare.truth.travel_time)


def test_by_first_a_hidden_link_is_ranged_over_the_surface(truth, ridged):
    """The image of the landmark in the surface lies as high above it as the landmark lies below."""
    first = measure_ranges(truth, [HIDDEN], ridged, SCHEDULE, max_surface_bounces=1, arrival="first")
    hidden = first.attempts.receiver == 3
    at = truth.position[first.attempts.transmitter, first.attempts.sample][hidden]
    image = np.linalg.norm(at - HIDDEN.position * [1, 1, -1], axis=-1)
    heard = first.status[hidden] == RayStatus.OK
    assert heard.any()
    np.testing.assert_allclose(first.truth.travel_time[hidden][heard], image[heard] / C, rtol=0, atol=1e-9)


def test_strongest_goes_by_the_loss_of_the_detector(truth, water):
    """Water that absorbs 200 dB/km by the surface and nothing below it leaves the longer way over the sea bed."""
    upper = Absorption(lambda x, _frequency: np.where(x[:, 2] < 1500.0, 200.0, 0.0))
    ends = [Landmark("L1", (0.0, 3000.0, 2500.0))]
    station = replace(truth, position=np.broadcast_to([0.0, 0.0, 1400.0], truth.position.shape))
    options = {"max_surface_bounces": 1, "max_bottom_bounces": 1, "arrival": "strongest"}
    plain = measure_ranges(station, ends, water, SCHEDULE, **options)
    lossy = measure_ranges(
        station, ends, water, SCHEDULE, detector=Detector(SONAR, absorption=upper), **options
    )
    row = lossy.attempts.receiver == 3
    over_bed = np.hypot(3000.0, 2 * 3000.0 - 2500.0 - 1400.0)
    np.testing.assert_allclose(lossy.truth.travel_time[row], over_bed / C, rtol=0, atol=1e-9)
    assert (plain.truth.travel_time[row] != lossy.truth.travel_time[row]).all()


def test_a_direct_ray_that_is_not_among_the_arrivals_kept_is_ranged_on(truth, ridged, monkeypatch):
    """The solver keeps 64 arrivals a link; that they leave out the direct one takes hundreds of kilometres."""

    def without_direct_rays(*args, **options):
        found = find_eigenrays(*args, **options)
        if len(args) == 3:  # no bounces allowed
            return found
        kept = (found.surface_bounces > 0) | (found.bottom_bounces > 0)
        rows = {
            f.name: getattr(found, f.name)[kept] for f in fields(found) if f.metadata["dims"][0] == "arrival"
        }
        return replace(found, **rows)

    options = {"max_surface_bounces": 1, "currents": CURRENT, "detector": Detector(SONAR)}
    whole = measure_ranges(truth, [HIDDEN], ridged, SCHEDULE, **options)
    monkeypatch.setattr("pymantaray.sensing.ranging.find_eigenrays", without_direct_rays)
    short = measure_ranges(truth, [HIDDEN], ridged, SCHEDULE, **options)
    assert set(whole.status) == {RayStatus.OK, RayStatus.BLOCKED}
    np.testing.assert_array_equal(short.status, whole.status)
    np.testing.assert_array_equal(short.truth.travel_time, whole.truth.travel_time)
    np.testing.assert_array_equal(short.probability, whole.probability)
    np.testing.assert_array_equal(short.arrivals.travel_time, whole.arrivals.travel_time)
