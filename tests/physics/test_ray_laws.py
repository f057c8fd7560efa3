"""Laws that every ray obeys: Snell, Fermat, reciprocity, eikonal gradients, invariances."""

import numpy as np
import pytest
from scipy.integrate import RK45

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics._kernels import step
from pymantaray.records import RayStatus


def test_slowness_has_the_length_of_the_slowness_of_sound(front, links):
    source, receiver = links(150, 1)
    a = find_eigenrays(front, source, receiver)
    for vector, speed in (
        (a.source_slowness, a.source_sound_speed),
        (a.receiver_slowness, a.receiver_sound_speed),
    ):
        np.testing.assert_allclose(np.linalg.norm(vector, axis=1) * speed[a.link], 1.0, atol=1e-9)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_horizontal_slowness_is_constant_where_the_ocean_is_uniform(interpolation, links, arctic):
    """Snell: the ray parameter is the same at both ends, and no ray leaves its vertical plane."""
    medium = Medium.from_profile(*arctic, bottom_depth=3000.0, interpolation=interpolation)
    source, receiver = links(150, 2)
    a = find_eigenrays(medium, source, receiver, tolerance=1e-5)
    assert len(a.link) > 130
    horizontal = np.linalg.norm(a.source_slowness[:, :2], axis=1)
    np.testing.assert_allclose(a.source_slowness[:, :2], a.receiver_slowness[:, :2], rtol=0, atol=1e-10)
    cosine = np.cos(a.launch_angle) / a.source_sound_speed[a.link]
    np.testing.assert_allclose(horizontal, cosine, rtol=1e-12)


def test_earliest_arrival_is_never_later_than_the_straight_chord(front, links):
    """Fermat, for links in open water: the earliest of all paths beats the straight one."""
    source, receiver = links(300, 3)
    source[:, 2], receiver[:, 2] = 1200.0, np.linspace(600.0, 2000.0, 300)
    first = find_eigenrays(front, source, receiver).first()
    ok = first.status == RayStatus.OK
    assert ok.sum() > 290
    bending = first.travel_time - first.chord_travel_time
    assert np.nanmax(bending[ok]) < 1e-9, np.nanmax(bending)
    assert np.nanmin(bending[ok]) < -1e-6  # and rays do bend


def test_travel_time_is_reciprocal_when_both_ways_are_solved(front, links):
    source, receiver = links(400, 4)
    there = find_eigenrays(front, source, receiver, canonical=False).first()
    back = find_eigenrays(front, receiver, source, canonical=False).first()
    both = (there.status == RayStatus.OK) & (back.status == RayStatus.OK)
    assert both.sum() > 350
    assert np.count_nonzero((there.status == 0) != (back.status == 0)) <= 2  # at the cut-off
    difference = np.abs(there.travel_time - back.travel_time)[both]
    assert np.percentile(difference, 99) < 0.1e-6, np.percentile(difference, 99)
    np.testing.assert_allclose(there.source_slowness[both], -back.receiver_slowness[both], rtol=0, atol=2e-8)
    canonical = [
        find_eigenrays(front, *pair).first().travel_time for pair in ((source, receiver), (receiver, source))
    ]
    assert np.array_equal(*canonical, equal_nan=True)


def sorted_rows(arrivals, *names):
    """Columns of the arrivals in the order of link and travel time."""
    order = np.lexsort((arrivals.travel_time, arrivals.link))
    return [getattr(arrivals, name)[order] for name in names]


def test_time_reversal_exchanges_and_turns_the_angles_of_every_arrival(front, links):
    source, receiver = links(150, 14)
    there = find_eigenrays(front, source, receiver, canonical=False, tolerance=1e-5)
    back = find_eigenrays(front, receiver, source, canonical=False, tolerance=1e-5)
    counts = [np.bincount(a.link, minlength=150) for a in (there, back)]
    same = counts[0] == counts[1]
    assert same.sum() >= 147  # the rest at the cut-off
    names = ("link", "travel_time", "launch_angle", "arrival_angle", "spreading_db", "turning_points")
    one, two = ([c[same[a.link]] for c in sorted_rows(a, *names)] for a in (there, back))
    assert np.array_equal(one[0], two[0])
    np.testing.assert_allclose(one[1], two[1], rtol=0, atol=1e-7)
    angle = np.concatenate([np.abs(one[2] + two[3]), np.abs(one[3] + two[2])])
    assert np.median(angle) < 1e-8, np.median(angle)
    assert np.percentile(angle, 98) < 1e-5, np.percentile(angle, 98)
    assert np.percentile(np.abs(one[4] - two[4]), 98) < 0.05  # dB
    assert np.mean(one[5] == two[5]) > 0.98


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_azimuth_and_place_do_not_matter_where_the_ocean_is_uniform(interpolation, arctic):
    medium = Medium.from_profile(*arctic, bottom_depth=3000.0, interpolation=interpolation)
    rng = np.random.default_rng(15)
    n = 40
    distance, bearing = rng.uniform(300.0, 8e3, n), rng.uniform(0.0, 2 * np.pi, n)
    z0, z1 = rng.uniform(5.0, 800.0, (2, n))
    zero = np.zeros(n)
    source = np.column_stack([zero, zero, z0])
    plain = find_eigenrays(medium, source, np.column_stack([distance, zero, z1]))
    corner = rng.uniform(-1e5, 1e5, (n, 2))
    step = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])
    moved = find_eigenrays(medium, np.column_stack([corner, z0]), np.column_stack([corner + step, z1]))
    assert np.array_equal(plain.link, moved.link)
    np.testing.assert_allclose(moved.travel_time, plain.travel_time, rtol=0, atol=1e-9)
    at = bearing[plain.link]
    flat = plain.source_slowness[:, 0]
    turned = np.column_stack([flat * np.cos(at), flat * np.sin(at), plain.source_slowness[:, 2]])
    np.testing.assert_allclose(moved.source_slowness, turned, rtol=0, atol=5e-9)


@pytest.mark.filterwarnings("ignore:.*more eigenrays:RuntimeWarning")  # coarse tolerances make rays up
@pytest.mark.parametrize("kind", ["profile", "front"])
def test_time_error_is_of_first_order_in_the_tolerance_or_better(kind, front, arctic, links):
    medium = front if kind == "front" else Medium.from_profile(*arctic, bottom_depth=3000.0)
    source, receiver = links(80, 16)
    exact = find_eigenrays(medium, source, receiver, tolerance=1e-8)
    tolerances = 10.0 ** -np.arange(1.0, 6.0)
    errors = []
    for tolerance in tolerances:
        found = find_eigenrays(medium, source, receiver, tolerance=tolerance)
        gap = [
            np.min(np.abs(found.travel_time[found.link == i] - t), initial=np.inf)
            for i, t in zip(exact.link, exact.travel_time, strict=True)
        ]
        errors.append(np.percentile(gap, 90))
    order = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert order > 0.7, (order, errors)
    assert errors[2] < 3e-8, errors  # s, at the default tolerance


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_slowness_is_the_gradient_of_travel_time(interpolation, links, front_medium):
    """Eikonal: dt/dx_receiver = slowness there, dt/dx_source = minus slowness there."""
    medium = front_medium(interpolation)
    source, receiver = links(40, 5)
    source[:, 2] += 3.7  # off the levels
    receiver[:, 2] += 2.3
    middle = find_eigenrays(medium, source, receiver, tolerance=1e-6)
    simple = np.bincount(middle.link, minlength=40) == 1
    first = middle.first()
    h = 0.5  # m
    for axis in range(3):
        for end, vector, sign in ((0, first.source_slowness, -1.0), (1, first.receiver_slowness, 1.0)):
            times = []
            for direction in (1.0, -1.0):
                ends = [source.copy(), receiver.copy()]
                ends[end][:, axis] += direction * h
                times.append(find_eigenrays(medium, *ends, tolerance=1e-6).first().travel_time)
            slope = sign * (times[0] - times[1]) / (2 * h)
            error = np.abs(slope - vector[:, axis])[simple]
            assert np.nanmedian(error) < 2e-10, (axis, end, np.nanmedian(error))
            assert np.nanpercentile(error, 90) < 2e-8, (axis, end, np.nanpercentile(error, 90))


def test_turning_and_shifting_the_ocean_turns_and_shifts_the_rays(front, links):
    """A quarter turn maps (north, east) to (east, -north); the axes are reversed to keep them increasing."""
    source, receiver = links(80, 6)
    plain = find_eigenrays(front, source, receiver)
    times = plain.first().travel_time
    turned = Medium.from_grid(
        front.east + 500.0,
        -front.north[::-1] + 9000.0,
        front.depth,
        np.swapaxes(front.sound_speed, 0, 1)[:, ::-1],
        bathymetry=np.swapaxes(front.bathymetry, 0, 1)[:, ::-1],
    )
    ends = [np.column_stack([p[:, 1] + 500.0, 9000.0 - p[:, 0], p[:, 2]]) for p in (source, receiver)]
    moved = find_eigenrays(turned, *ends)
    again = moved.first().travel_time
    np.testing.assert_allclose(again, times, rtol=0, atol=1e-8)  # level links: another canonical end
    slant = (source[:, 2] != receiver[:, 2])[plain.link]
    assert np.array_equal(moved.link[(source[:, 2] != receiver[:, 2])[moved.link]], plain.link[slant])
    for name in ("source_slowness", "receiver_slowness"):
        old = getattr(plain, name)[slant]
        new = getattr(moved, name)[(source[:, 2] != receiver[:, 2])[moved.link]]
        expected = np.column_stack([old[:, 1], -old[:, 0], old[:, 2]])
        assert np.percentile(np.abs(new - expected), 98) < 1e-9, name


def test_result_does_not_depend_on_threads_or_on_the_other_links(front, links):
    source, receiver = links(200, 8)
    one = find_eigenrays(front, source, receiver, threads=1)
    two = find_eigenrays(front, source, receiver, threads=2)
    assert np.array_equal(one.travel_time, two.travel_time)
    alone = find_eigenrays(front, source[70:71], receiver[70:71])
    assert np.array_equal(alone.travel_time, one.travel_time[one.link == 70])


def test_integrator_has_the_coefficients_of_dormand_and_prince():
    for row, theirs in zip(step.A[1:6], RK45.A[1:], strict=True):
        np.testing.assert_allclose(row[: len(theirs)], theirs, rtol=1e-15)
        assert not row[len(theirs) :].any()
    np.testing.assert_allclose(step.A[6], RK45.B, rtol=1e-15)
    np.testing.assert_allclose(step.C[:6], RK45.C, rtol=1e-15)
    np.testing.assert_allclose(
        [step.E1, 0.0, step.E3, step.E4, step.E5, step.E6, step.E7], -RK45.E, rtol=1e-13
    )
