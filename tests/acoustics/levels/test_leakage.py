"""
Sound where no ray goes: Airy's law beside its own integral, the edge's beside Fresnel's, and where
both are used.
"""

import numpy as np
import pytest
from factories import HIDDEN, ridged
from refusals import refused
from scipy.integrate import quad
from scipy.special import ai_zeros, airy, fresnel, hankel1e

from pymantaray.acoustics import Leakage, Medium, find_eigenrays, find_leaks, trace_fan
from pymantaray.acoustics.levels.creeping import creep_along_surface
from pymantaray.acoustics.levels.leakage import airy_spreading_db, knife_edge_db
from pymantaray.errors import AcousticsError

HZ = 1000.0


def wave(distance, width):
    """
    Field of a fold at a distance on its dark side: the integral of cos(t^3 / 3 + x t) over t, along
    a way on which it decays.
    """
    x, turn = distance / width, np.exp(1j * np.pi / 6.0)

    def integrand(t):
        z = t * turn
        return (np.exp(1j * (z**3 / 3.0 + x * z)) * turn).real

    return quad(integrand, 0.0, 60.0, limit=400)[0]


@pytest.mark.parametrize("width", [0.7, 2.5, 13.0])
@pytest.mark.parametrize("distance", [0.0, 1.0, 5.0, 20.0])
def test_airy_s_level_is_that_of_the_fold_s_own_integral(width, distance):
    """
    Two rays of equal intensity, far inside, beat to four times one of them: there the integral is
    calibrated.
    """
    if distance / width > 8.0:
        return
    x = np.linspace(-12.0, -11.0, 60)  # more than half a beat
    crest = np.max([wave(k * width, width) ** 2 * np.sqrt(-k) for k in x])
    one = (
        0.25 * crest / np.sqrt(2.0 / width)
    )  # intensity of one ray 2 m inside, by the law of distance^-1/2
    phase = 4.0 / 3.0 * (2.0 / width) ** 1.5
    level = airy_spreading_db(distance, phase, np.zeros(2))
    assert -level == pytest.approx(10.0 * np.log10(wave(distance, width) ** 2 / one), abs=0.1)


def test_the_level_by_airy_is_finite_and_falls_with_frequency():
    phase = 4.0 / 3.0 * (2.0 / 2.5) ** 1.5
    deep = [airy_spreading_db(m, phase, np.zeros(2)) for m in (10.0, 100.0, 1000.0)]
    assert np.isfinite(deep).all()
    assert np.diff(deep).min() > 100.0
    assert airy_spreading_db(20.0, 10.0 * phase, np.zeros(2)) > airy_spreading_db(
        20.0, phase, np.zeros(2)
    )


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.5, 1.0, 2.4, 8.0])
def test_the_edge_s_level_is_fresnel_s(nu):
    """
    The field behind a half plane, |0.5 - C + i (0.5 - S)| / sqrt(2): the formula is within 0.3 dB
    of it.
    """
    s, c = fresnel(nu)
    exact = -20.0 * np.log10(np.hypot(0.5 - c, 0.5 - s) / np.sqrt(2.0))
    assert knife_edge_db(nu) == pytest.approx(exact, abs=0.3)


def test_behind_a_ridge_sound_comes_by_its_crest():
    """
    Crest at 150 m half-way, ends at 250 m, 4 km apart: 2 x hypot(2000, 100) m, and 6 dB at the
    border.
    """
    source, receiver = np.array([[0.0, 0.0, 250.0]]), np.array([HIDDEN.position])
    water = ridged(speed=1450.0)
    assert not find_eigenrays(water, source, receiver).link.size
    leaks = find_leaks(water, source, receiver, Leakage(reach=250.0), HZ)
    assert leaks.link.tolist() == [0]
    assert leaks.place[0, 2] == pytest.approx(50.0, abs=2.5)
    time = leaks.arrivals.travel_time[0] + leaks.shift[0]
    assert time == pytest.approx(2.0 * np.hypot(2000.0, 100.0) / 1450.0, abs=2e-4)
    nu = 200.0 * np.sqrt(2.0 * HZ / (1450.0 * 4000.0))
    assert leaks.arrivals.spreading_db[0] == pytest.approx(knife_edge_db(nu), abs=0.2)
    lower = find_leaks(water, source, receiver, Leakage(reach=250.0), 0.1 * HZ)
    assert lower.arrivals.spreading_db[0] < leaks.arrivals.spreading_db[0] - 5.0
    assert not find_leaks(water, source, receiver, Leakage(reach=100.0), HZ).link.size


def airy_modes(speed, gradient, depth, distance, hz):
    """
    Pressure re 1 m of the sum of creeping modes below a pressure-release surface where 1 / c^2 is
    linear in depth.
    """
    k, rotation = 2.0 * np.pi * hz / speed, np.exp(-1j * np.pi / 3.0)
    beta = (2.0 * k * k * gradient / speed) ** (1.0 / 3.0)
    root = ai_zeros(40)[0]
    across = airy(root + beta * depth * rotation)[0] / airy(root)[1]
    along = np.sqrt(k * k - beta**2 * root * np.conj(rotation))
    waves = hankel1e(0, along * distance) * np.exp(1j * along * distance)
    return 1j * np.pi * beta * rotation * np.sum(across**2 * waves)


@pytest.mark.parametrize(
    "hz", [*(pytest.param(hz, marks=pytest.mark.slow) for hz in (250.0, 500.0)), 1000.0]
)
def test_creeping_sound_equals_the_sum_of_all_modes_from_either_end(hz):
    """
    Airy functions are exact where 1 / c^2 is linear.

    The bounds are the error of the model's step in depth: 0.10 dB and 32 us are the largest
    differences here. The first mode alone, of which an earlier test had the rate of decay, differs
    from the sum by up to 0.15 dB over the 500 m between these receivers.
    """
    speed, gradient, depth = 1460.0, 0.15, 20.0
    levels = np.append(np.arange(0.0, 60.0, 0.25), np.arange(60.0, 501.0, 2.0))
    profile = speed / np.sqrt(1.0 + 2.0 * gradient * levels / speed)
    water = Medium.from_profile(levels, profile, bottom_depth=500.0, interpolation="linear")
    graze = 2.0 * np.sqrt(2.0 * speed / gradient * depth)  # of two arcs, within 0.1 %
    source, small = np.array([0.0, 0.0, depth]), 1e-4 * hz
    for distance in (graze + 500.0, graze + 1000.0):
        end = np.array([distance, 0.0, depth])
        creep = creep_along_surface(water, source, end, hz)
        modes = [
            airy_modes(speed, gradient, depth, distance, f) for f in (hz - small, hz, hz + small)
        ]
        level = -20.0 * np.log10(abs(modes[1]) * distance)
        assert creep.spreading_db == pytest.approx(level, abs=0.15)
        turn = np.angle(modes[2] / modes[0] * np.exp(-4j * np.pi * small * distance / speed))
        time = distance / speed + turn / (4.0 * np.pi * small)
        assert creep.travel_time == pytest.approx(time, abs=4e-5)
        assert creep_along_surface(water, end, source, hz).spreading_db == pytest.approx(
            creep.spreading_db
        )


def test_no_sound_creeps_to_lit_places_or_below_water_without_rays():
    water = Medium.from_profile(
        [0.0, 500.0], [1460.0, 1385.0], bottom_depth=500.0, interpolation="linear"
    )
    source, graze = np.array([0.0, 0.0, 20.0]), 2.0 * np.sqrt(2.0 * 1460.0 / 0.15 * 20.0)
    assert creep_along_surface(water, source, np.array([0.9 * graze, 0.0, 20.0]), HZ) is None
    assert creep_along_surface(ridged(), source, np.array([graze + 500.0, 0.0, 20.0]), HZ) is None


def test_creeping_under_ice_equals_creeping_under_less_water():
    draft, depth, down = 12.0, 20.0, np.array([0.0, 0.0, 1.0])
    levels, speed = np.array([0.0, 500.0]), [1460.0, 1385.0]
    water = Medium.from_profile(levels, speed, bottom_depth=500.0, interpolation="linear")
    iced = Medium.from_profile(
        [0.0, *(levels + draft)],
        [1500.0, *speed],  # what would be in the place of the ice is of no account
        bottom_depth=500.0 + draft,
        interpolation="linear",
        ice_draft=draft,
    )
    ends = depth * down, np.array([2500.0, 0.0, depth])
    under_ice = creep_along_surface(iced, *(end + draft * down for end in ends), HZ)
    assert under_ice == pytest.approx(creep_along_surface(water, *ends, HZ), rel=1e-9)


def test_scattered_sound_is_a_floor():
    source, receiver = np.array([[0.0, 0.0, 250.0]]), np.array([HIDDEN.position])
    for floor, scattered in ((10.0, True), (60.0, False)):
        leaks = find_leaks(ridged(), source, receiver, Leakage(reach=250.0, scatter_db=floor), HZ)
        assert leaks.scattered.tolist() == [scattered]
        assert leaks.arrivals.spreading_db[0] <= floor


def munk():
    """
    The deep sea's channel: from 300 m, at 25 km, rays reach no depth above 3.2 km; two of a fold
    end there.
    """
    z = np.arange(0.0, 5001.0, 25.0)
    eta = 2.0 * (z - 1300.0) / 1300.0
    return Medium.from_profile(
        z, 1500.0 * (1.0 + 0.00737 * (eta - 1.0 + np.exp(-eta))), bottom_depth=5000.0
    )


@pytest.fixture(scope="module")
def fold():
    """
    Medium, source, range, and depth, vertical slowness and launch angle along a fan about the fold.
    """
    water, source, far = munk(), np.array([0.0, 0.0, 300.0]), 25e3
    pair = find_eigenrays(water, source, [far, 0.0, 3260.0], spreading_cutoff_db=None).launch_angle
    angle = np.linspace(pair.min(), pair.max(), 81)
    paths = trace_fan(water, source, 0.0, angle, far, tolerance=1e-5)
    last = np.append(np.flatnonzero(np.diff(paths.arrival)), paths.arrival.size - 1)
    return water, source, far, angle, paths.position[last, 2], paths.slowness[last, 2]


@pytest.mark.parametrize("hz", [200.0, 800.0])
def test_beyond_a_caustic_width_time_and_level_are_those_of_the_fan(fold, hz):
    """
    l^3 = z'' / (2 omega^2 p'^2), by derivatives of depth z and vertical slowness p by the launch
    angle.
    """
    water, source, far, angle, depth, slowness = fold
    omega, middle = 2.0 * np.pi * hz, int(np.argmin(depth))
    assert 10 < middle < angle.size - 10
    curve = np.polynomial.Polynomial.fit(angle - angle[middle], depth, 4).convert().coef
    rate = np.polynomial.Polynomial.fit(angle - angle[middle], slowness, 3).convert().coef[1]
    width = (2.0 * curve[2] / (2.0 * omega**2 * rate**2)) ** (1.0 / 3.0)
    edge = depth.min()
    rays = find_eigenrays(water, source, [far, 0.0, edge + 2.0], spreading_cutoff_db=None)
    assert rays.link.size == 2
    apart = float(np.diff(rays.travel_time)[0])
    assert 2.0 * (0.75 * omega * apart) ** (-2.0 / 3.0) == pytest.approx(width, rel=0.05)
    receiver = np.array([[far, 0.0, edge - 1.5 * width]])
    leaks = find_leaks(water, source[None], receiver, Leakage(), hz)
    assert leaks.place[0, 2] == pytest.approx(edge, abs=0.1)
    level = airy_spreading_db(1.5 * width, omega * apart, rays.spreading_db)
    assert leaks.arrivals.spreading_db[0] == pytest.approx(level, abs=0.5)
    time = leaks.arrivals.travel_time[0] + leaks.shift[0]
    late = slowness[middle] * (2.0 + 1.5 * width)
    assert time == pytest.approx(rays.travel_time.mean() - late, abs=2e-5)


def test_leaks_do_not_depend_on_threads_and_leave_lit_links_to_rays():
    source = np.tile([0.0, 0.0, 250.0], (3, 1))
    receiver = np.array([HIDDEN.position, [4000.0, 0.0, 200.0], [4000.0, 0.0, 240.0]])
    one, four = (
        find_leaks(ridged(), source, receiver, Leakage(250.0), HZ, threads=n) for n in (1, 4)
    )
    np.testing.assert_array_equal(one.arrivals.spreading_db, four.arrivals.spreading_db)
    assert not find_leaks(ridged(), source[:0], receiver[:0], Leakage(), HZ).link.size


@pytest.mark.parametrize(
    ("message", "values"),
    [("reach is 0 m", {"reach": 0.0}), ("scatter_db is -3 dB", {"scatter_db": -3.0})],
)
def test_what_is_no_leakage_is_refused(message, values):
    refused(AcousticsError, message, Leakage, **values)
