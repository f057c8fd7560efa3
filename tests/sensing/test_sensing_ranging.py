"""
Ranges from the ray solver: both models, both directions, dropouts, silence, currents, detection,
water that varies.
"""

import weakref
from dataclasses import fields, replace

import numpy as np
import pytest
from factories import HIDDEN, range_fleet, ridged
from oracles import direct_travel_time_linear_gradient
from scipy.interpolate import CubicSpline
from scipy.stats import norm

from pymantaray.acoustics import (
    Absorption,
    Currents,
    Medium,
    Sonar,
    find_eigenrays,
)
from pymantaray.records import RayStatus, VehicleStatus
from pymantaray.records.base import Record
from pymantaray.sensing import Detector, Landmark, NoiseModel, OneWay, TwoWay, assemble

PINGS = np.array([800.0, 1600.0, 2400.0])  # s; samples 4, 8 and 12
C0, GRADIENT, BOTTOM = 1450.0, 0.016, 3000.0
DEPTH = np.array([0.0, 1500.0, 4000.0])
CURRENT = Currents.uniform(0.3, -0.4)
SONAR = Sonar(source_level_db=150.0, frequency_hz=25e3, bandwidth_hz=4e3, noise=45.0)


def profile(speed):
    speed = np.broadcast_to(speed, 3)
    return Medium.from_profile(DEPTH, speed, bottom_depth=BOTTOM, interpolation="linear")


STILL, REFRACTING, RIDGED = profile(C0), profile(C0 + GRADIENT * DEPTH), ridged()


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("ABCD")


@pytest.fixture(scope="module")
def few(make_truth):
    return make_truth("ABC")


@pytest.fixture(scope="module")
def ranging(truth, landmarks):
    return range_fleet(truth, landmarks, REFRACTING, threads=1)


def ends(truth, landmarks, table):
    """Places of the transmitter and the receiver of each attempt."""
    fixed = np.array([mark.position for mark in landmarks]).reshape(-1, 1, 3)
    place = np.concatenate([truth.position, np.tile(fixed, (1, truth.time.size, 1))])
    return place[table.transmitter, table.sample], place[table.receiver, table.sample]


def stopping(truth, rows, since=0):
    status = truth.status.copy()
    status[rows, since:] = VehicleStatus.GROUNDED
    return replace(truth, status=status)


def assert_same(one, other, what="ranging"):
    if isinstance(one, Record):
        one, other = ([getattr(r, f.name) for f in fields(r)] for r in (one, other))
    if isinstance(one, (list, tuple)):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, what)
    else:
        np.testing.assert_array_equal(one, other, err_msg=what)


def test_every_attempt_by_closed_form(truth, landmarks, ranging):
    """
    Travel time of the direct circular arc in a constant gradient, chord time along the straight
    line.
    """
    table, true = ranging.attempts, ranging.truth
    assert table.sample.size == 3 * 4 * (3 + 2)
    assert (ranging.status == RayStatus.OK).all()
    a, b = ends(truth, landmarks, table)
    distance, ca, cb = (
        np.linalg.norm(a - b, axis=1),
        C0 + GRADIENT * a[:, 2],
        C0 + GRADIENT * b[:, 2],
    )
    time = direct_travel_time_linear_gradient(a, b, sound_speed_surface=C0, gradient=GRADIENT)
    np.testing.assert_allclose(true.sound_speed, ca, rtol=1e-12)
    np.testing.assert_allclose(true.distance, distance, rtol=1e-14)
    np.testing.assert_allclose(true.travel_time, time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        true.chord_travel_time, distance * np.log(cb / ca) / (cb - ca), atol=1e-6
    )
    np.testing.assert_array_equal(true.refracted_range, true.sound_speed * true.travel_time)


@pytest.mark.parametrize("timing", [OneWay(), TwoWay(1.0)], ids=["one-way", "two-way"])
def test_the_angles_of_a_ping_are_tangents_of_its_circular_arc(truth, landmarks, timing):
    """
    The arc's centre lies where the sound speed, continued linearly, is zero; angles are in the
    direction of travel.
    """
    found = range_fleet(truth, landmarks, REFRACTING, timing=timing)
    a, b = ends(truth, landmarks, found.attempts)
    across = np.linalg.norm((b - a)[:, :2], axis=1)
    one, other = (end[:, 2] + C0 / GRADIENT for end in (a, b))  # depths below the centre
    middle = (across**2 + other**2 - one**2) / (2.0 * across)
    np.testing.assert_allclose(
        found.truth.departure_angle, np.arctan2(middle, one), rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(
        found.truth.arrival_angle, np.arctan2(middle - across, other), rtol=0, atol=1e-6
    )


def test_a_ping_that_no_ray_carries_has_no_angles(few):
    found = range_fleet(few, [HIDDEN], RIDGED)
    lost = found.status != RayStatus.OK
    assert lost.any()
    for angle in (found.truth.departure_angle, found.truth.arrival_angle):
        np.testing.assert_array_equal(np.isnan(angle), lost)


def test_links_are_the_unordered_pairs_in_order_of_the_arrivals(truth, landmarks, ranging):
    links, first = ranging.links, ranging.arrivals.first()
    assert links.sample.size == first.status.size == 3 * (6 + 4 * 2)
    assert (links.first < links.second).all()
    assert len(set(zip(links.sample, links.first, links.second, strict=True))) == links.sample.size
    fixed = np.tile([[mark.position] for mark in landmarks], (1, truth.time.size, 1))
    depth = np.concatenate([truth.position, fixed])[..., 2]
    for end, speed in (
        (links.first, first.source_sound_speed),
        (links.second, first.receiver_sound_speed),
    ):
        np.testing.assert_allclose(speed, C0 + GRADIENT * depth[end, links.sample], rtol=1e-12)


def test_a_stopped_vehicle_is_silent_and_the_others_are_not(truth, landmarks, ranging):
    """Vehicle B stops between the first and the second ping."""
    stopped = range_fleet(stopping(truth, 1, 6), landmarks, REFRACTING)
    table, links = stopped.attempts, stopped.links
    silent = ((table.transmitter == 1) | (table.receiver == 1)) & (table.sample > 6)
    assert silent.sum() == 2 * (3 + 3 + 2)
    np.testing.assert_array_equal(stopped.status, np.where(silent, RayStatus.STOPPED, RayStatus.OK))
    of_arrivals = ("travel_time", "departure_angle", "arrival_angle")
    lost = {name: np.where(silent, np.nan, getattr(ranging.truth, name)) for name in of_arrivals}
    assert_same(stopped.truth, replace(ranging.truth, **lost))
    assert not ((links.sample > 6) & ((links.first == 1) | (links.second == 1))).any()
    assert links.sample.size == stopped.arrivals.status.size == 3 * 14 - 2 * 5


def test_a_fleet_at_rest_is_silent_and_a_single_vehicle_has_no_range(truth, make_truth):
    stopped = range_fleet(stopping(truth, slice(None)), [], REFRACTING)
    assert (stopped.status == RayStatus.STOPPED).all()
    assert stopped.links.sample.size == stopped.arrivals.status.size == 0
    assert np.isfinite(stopped.truth.distance).all()
    for medium in (REFRACTING, lambda _: REFRACTING):
        alone = range_fleet(make_truth("A"), [], medium)
        assert alone.status.size == alone.links.sample.size == 0


def test_a_link_behind_a_ridge_is_a_dropout_with_its_chord(truth):
    wall = ridged(20.0, gradient=GRADIENT, bottom=BOTTOM)
    found = range_fleet(truth, [Landmark("L", (5000.0, 0.0, 300.0))], wall)
    hidden, true = found.attempts.receiver == 4, found.truth
    np.testing.assert_array_equal(found.status, np.where(hidden, RayStatus.BLOCKED, RayStatus.OK))
    np.testing.assert_array_equal(np.isnan(true.travel_time), hidden)
    at = truth.position[found.attempts.transmitter, found.attempts.sample]
    np.testing.assert_allclose(true.sound_speed, C0 + GRADIENT * at[:, 2], rtol=1e-12)
    distance = np.linalg.norm(at - [5000.0, 0.0, 300.0], axis=-1)[hidden]
    np.testing.assert_allclose(true.distance[hidden], distance, rtol=1e-14)
    mean = C0 + GRADIENT * 0.5 * (at[hidden, 2] + 300.0)
    np.testing.assert_allclose(true.chord_travel_time[hidden], distance / mean, rtol=1e-5)


def test_a_receiver_outside_the_water_hears_nothing_by_no_probability(few):
    buried = [Landmark("L", (0.0, 0.0, BOTTOM + 100.0))]
    found = range_fleet(few, buried, STILL, detector=Detector(SONAR))
    below = found.attempts.receiver == 3
    np.testing.assert_array_equal(found.status, np.where(below, RayStatus.OUTSIDE, RayStatus.OK))
    np.testing.assert_array_equal(np.isnan(found.truth.refracted_range), below)
    np.testing.assert_array_equal(np.isnan(found.probability), below)
    assert np.isfinite(found.truth.distance).all()


def test_cut_off_is_handed_to_the_solver(truth, landmarks):
    """
    No ray here is 10 dB stronger than spherical spreading, so a cut-off that asks for it leaves
    none.
    """
    strict = range_fleet(truth, landmarks, REFRACTING, spreading_cutoff_db=-10.0)
    assert (strict.status == RayStatus.WEAK).all()


def test_what_a_decibel_of_the_cutoff_decides_is_marked(few, landmarks):
    """
    By what is ranged on with cut-offs a decibel lower and higher, links of rays spread over some
    decibels.
    """
    curve = CubicSpline(
        [0.0, 60.0, 120.0, 400.0, 4000.0],
        [1450.0, 1462.0, 1448.0, 1455.0, 1510.0],
        bc_type="natural",
    )
    levels = np.concatenate([np.arange(0.0, 400.0, 20.0), np.arange(400.0, 4001.0, 200.0)])
    duct = Medium.from_profile(levels, curve(levels), bottom_depth=BOTTOM)
    marks = [Landmark(f"N{k}", (3e3 + 250.0 * k, 0.0, 90.0)) for k in range(12)]
    spread = few.position.copy()
    spread[:, :, 2] = np.linspace(30.0, 200.0, spread[..., 2].size).reshape(spread.shape[:2])
    fleet = replace(few, position=spread)
    by_cutoff = {
        db: range_fleet(fleet, marks, duct, spreading_cutoff_db=db) for db in (1.0, 2.0, 3.0)
    }
    times = [np.nan_to_num(by_cutoff[db].truth.travel_time, nan=-1.0) for db in (1.0, 2.0, 3.0)]
    expected = (times[0] != times[1]) | (times[2] != times[1])
    assert 3 < expected.sum() < expected.size - 3
    np.testing.assert_array_equal(by_cutoff[2.0].truth.near_cutoff, expected)
    off = range_fleet(fleet, marks, duct, spreading_cutoff_db=None)
    assert not off.truth.near_cutoff.any()


def test_assembled_measurements_hold_the_measured_ranges(truth, landmarks, ranging):
    m = assemble(truth, landmarks, ranging, NoiseModel())
    assert_same([m.range_sample, m.range_transmitter, m.range_receiver], list(ranging.attempts))
    true = ranging.truth
    assert_same(
        [m.range_status, m.straight_range, m.refracted_range, m.transmitter_sound_speed],
        [ranging.status, true.distance, true.refracted_range, true.sound_speed],
    )
    assert_same([m.depth, m.first_position], [truth.position[..., 2], truth.position[:, 0]])
    assert_same([m.landmark_position], [np.array([mark.position for mark in landmarks])])


def test_two_way_the_current_cancels(few, landmarks):
    """Of the delay u/c t what moves with the vehicles, v/c of it, does not cancel."""
    still, moving = (
        range_fleet(few, landmarks, STILL, currents=current, timing=TwoWay(1.0))
        for current in (None, CURRENT)
    )
    np.testing.assert_allclose(moving.truth.travel_time, still.truth.travel_time, rtol=0, atol=3e-7)


def test_probability_follows_the_sonar_equation_by_hand(few, landmarks):
    """
    Spherical spreading and Thorp's absorption in water without refraction; two-way both pings must
    be heard.
    """
    thorp = Absorption.thorp()
    one, two = (
        range_fleet(few, landmarks, STILL, detector=Detector(SONAR, absorption=thorp), **timing)
        for timing in ({}, {"timing": TwoWay()})
    )
    loss = 20.0 * np.log10(one.truth.distance)
    loss = loss + thorp.db_per_km(np.zeros((1, 3)), 25e3)[0] * one.truth.distance / 1e3
    excess = 150.0 - (45.0 + 10.0 * np.log10(4e3)) - 10.0 - loss
    np.testing.assert_allclose(one.probability, norm.cdf(excess / 6.0), rtol=1e-6)
    assert np.ptp(one.probability) > 0.1
    np.testing.assert_allclose(two.probability, one.probability**2, rtol=1e-12)


def test_allowed_bounces_do_not_change_ranges_of_the_direct_rule(few):
    bare = range_fleet(few, [HIDDEN], RIDGED)
    more = range_fleet(few, [HIDDEN], RIDGED, max_surface_bounces=1, max_bottom_bounces=1)
    assert more.arrivals.link.size > bare.arrivals.link.size
    assert set(bare.status) == {RayStatus.OK, RayStatus.BLOCKED}
    assert_same([more.status, more.truth], [bare.status, bare.truth])


def test_a_direct_ray_beyond_the_kept_arrivals_is_ranged_on(few, monkeypatch):
    """
    The solver keeps 64 arrivals a link; that they leave out the direct one takes hundreds of
    kilometres.
    """

    def without_direct_rays(*args, **options):
        found = find_eigenrays(*args, **options)
        if args[3:5] == (0, 0):  # no bounces allowed
            return found
        bounced = (found.surface_bounces > 0) | (found.bottom_bounces > 0)
        rows = [f.name for f in fields(found) if f.metadata["dims"][0] == "arrival"]
        return replace(found, **{name: getattr(found, name)[bounced] for name in rows})

    options = {"max_surface_bounces": 1, "currents": CURRENT, "detector": Detector(SONAR)}
    whole = range_fleet(few, [HIDDEN], RIDGED, **options)
    monkeypatch.setattr("pymantaray.sensing.transmission.find_eigenrays", without_direct_rays)
    assert_same(range_fleet(few, [HIDDEN], RIDGED, **options), whole)


def test_by_first_a_hidden_link_is_ranged_over_the_surface(few):
    """The image of the landmark in the surface lies as high above it as the landmark lies below."""
    first = range_fleet(few, [HIDDEN], RIDGED, max_surface_bounces=1, arrival="first")
    hidden = (first.attempts.receiver == 3) & (first.status == RayStatus.OK)
    at = few.position[first.attempts.transmitter, first.attempts.sample][hidden]
    assert hidden.any()
    image = np.linalg.norm(at - HIDDEN.position * [1, 1, -1], axis=-1)
    np.testing.assert_allclose(first.truth.travel_time[hidden], image / C0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("detector", [None, Detector(SONAR)])
def test_direct_or_first_adds_reflections_to_links_without_direct_ray(few, detector):
    """
    A link with a direct arrival has the same time as by ``direct``; a hidden one has the time by
    ``first``.
    """
    options = {"max_surface_bounces": 1, "detector": detector}
    either, direct, first = (
        range_fleet(few, [HIDDEN], RIDGED, arrival=rule, **options)
        for rule in ("direct-or-first", "direct", "first")
    )
    hidden = direct.status != RayStatus.OK
    assert hidden.any()
    assert not hidden.all()
    expected = np.where(hidden, first.truth.travel_time, direct.truth.travel_time)
    np.testing.assert_array_equal(either.truth.travel_time, expected)
    np.testing.assert_array_equal(either.status, np.where(hidden, first.status, direct.status))
    bare = range_fleet(few, [HIDDEN], RIDGED, arrival="direct-or-first")
    np.testing.assert_array_equal(
        bare.truth.travel_time, range_fleet(few, [HIDDEN], RIDGED).truth.travel_time
    )


@pytest.mark.slow
def test_strongest_goes_by_the_loss_of_the_detector(few):
    """
    Water that absorbs 200 dB/km by the surface and nothing below it leaves the longer way over the
    sea bed.
    """
    upper = Absorption(lambda x, _frequency: np.where(x[:, 2] < 1500.0, 200.0, 0.0))
    mark = [Landmark("L1", (0.0, 3000.0, 2500.0))]
    station = replace(few, position=np.broadcast_to([0.0, 0.0, 1400.0], few.position.shape))
    options = {"max_surface_bounces": 1, "max_bottom_bounces": 1, "arrival": "strongest"}
    plain, lossy = (
        range_fleet(station, mark, STILL, detector=detector, **options)
        for detector in (None, Detector(SONAR, absorption=upper))
    )
    row = lossy.attempts.receiver == 3
    over_bed = np.hypot(3000.0, 2 * BOTTOM - 2500.0 - 1400.0)
    np.testing.assert_allclose(lossy.truth.travel_time[row], over_bed / C0, rtol=0, atol=1e-9)
    assert (plain.truth.travel_time[row] != lossy.truth.travel_time[row]).all()


OPTIONS = [
    {},
    {"currents": CURRENT},
    {"timing": TwoWay(1.0), "currents": CURRENT},
    {"detector": Detector(SONAR), "max_surface_bounces": 1},
    {"arrival": "first", "max_surface_bounces": 1},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_constant_water_threads_and_blocks_change_no_digit(truth, landmarks, options, monkeypatch):
    stopped = stopping(truth, 1, 6)
    still = range_fleet(stopped, landmarks, REFRACTING, threads=2, **options)
    monkeypatch.setattr("pymantaray.sensing.transmission._BLOCK", 4)
    varying = dict(options)
    if "currents" in options:
        varying["currents"] = lambda _: CURRENT
    assert_same(range_fleet(stopped, landmarks, lambda _: REFRACTING, threads=1, **varying), still)


@pytest.mark.parametrize("timing", [OneWay(), TwoWay(1.0)], ids=["one-way", "two-way"])
def test_each_ping_is_the_still_result_in_its_own_water(truth, landmarks, timing):
    """Rays, chords and sound speeds of a refracting medium that changes, silent pairs included."""

    def medium(t):
        return profile(1450.0 + (0.016 + 4e-6 * t) * DEPTH)

    stopped = stopping(truth, 1, 6)
    varying = range_fleet(stopped, landmarks, medium, timing=timing)
    for ping in PINGS:
        still = range_fleet(stopped, landmarks, medium(ping), timing=timing)
        now = truth.time[still.attempts.sample] == ping
        assert now.sum() == 4 * (3 + 2)
        assert_same(varying.status[now], still.status[now])
        for name in ("travel_time", "chord_travel_time", "sound_speed"):
            assert_same(getattr(varying.truth, name)[now], getattr(still.truth, name)[now])


def test_the_current_is_that_of_the_ping(few, landmarks):
    """A current that turns from north to south between the pings, in water that stands still."""
    flow = dict(zip(PINGS, (0.4, 0.0, -0.6), strict=True))
    found = range_fleet(few, landmarks, STILL, currents=lambda t: Currents.uniform(flow[t], 0.0))
    step = np.subtract(*ends(few, landmarks, found.attempts)[::-1])
    north = np.array([flow[t] for t in few.time[found.attempts.sample]])
    first_order = found.truth.distance / C0 - north * step[:, 0] / C0**2
    np.testing.assert_allclose(found.truth.travel_time, first_order, rtol=0, atol=1e-12)
    assert np.abs(found.truth.travel_time - found.truth.distance / C0).max() > 1e-4


def test_media_are_made_once_a_ping_and_let_go_again(truth, landmarks):
    earlier, asked = [], []

    def medium(t):
        assert not any(old() for old in earlier), "an earlier medium is still held"
        fresh = replace(REFRACTING)
        earlier.append(weakref.ref(fresh))
        asked.append(t)
        return fresh

    range_fleet(truth, landmarks, medium, currents=CURRENT, threads=1)
    assert asked == PINGS.tolist()


@pytest.mark.parametrize(
    ("options", "stopped"), [*((o, 2) for o in OPTIONS), ({}, 0), ({}, 4)], ids=str
)
@pytest.mark.parametrize("varying", [False, True])
def test_progress_rises_to_the_number_of_pairs(truth, options, stopped, varying, monkeypatch):
    monkeypatch.setattr("pymantaray.sensing.transmission._BLOCK", 4)
    seen = []
    range_fleet(
        stopping(truth, slice(stopped)),
        [],
        (lambda _: REFRACTING) if varying else REFRACTING,
        progress=lambda *step: seen.append(step),
        threads=1,
        **options,
    )
    done, total = zip(*seen, strict=True)
    assert set(total) == {3 * 6}
    assert list(done) == sorted(done)
    assert done[-1] == 3 * 6
    assert not varying or {6, 12} <= set(done)
