"""
Two-way ranging: half a round trip of moving vehicles, against exact exchanges; clocks in the noise
stage.
"""

from dataclasses import replace

import numpy as np
import pytest
from factories import assert_same, range_fleet, trajectories
from oracles import direct_travel_time_linear_gradient

from pymantaray.acoustics import Medium
from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import RayStatus, VehicleStatus
from pymantaray.sensing import ClockModel, Clocks, Landmark, TwoWay, perturb
from pymantaray.sensing.timing import velocities

C0, GRADIENT = 1450.0, 0.016


def exchange(time, source, receiver, v_source, v_receiver, turn_around):
    """
    Half the round trip less the turn-around, by fixed-point iteration of each leg's own equation.
    """
    t1 = t2 = 0.0
    for _ in range(12):
        t1 = time(source, receiver + v_receiver * t1)
    answered = t1 + turn_around
    for _ in range(12):
        t2 = time(receiver + v_receiver * answered, source + v_source * (answered + t2))
    return 0.5 * (t1 + t2)


def neglected(a, b, v_a, v_b, turn_around):
    """
    Bound of the terms beyond first order: ``(v/c)^2 T`` and the curvature of travel time, a tenth
    to spare.
    """
    distance, speed = np.linalg.norm(b - a), np.linalg.norm(v_a) + np.linalg.norm(v_b)
    duration = 2.0 * distance / C0 + turn_around
    return 1.1 * ((speed / C0) ** 2 * duration + (speed * duration) ** 2 / (2.0 * distance * C0))


def in_gradient(a, b):
    return float(
        direct_travel_time_linear_gradient(a, b, sound_speed_surface=C0, gradient=GRADIENT)
    )


def fleet_in_motion(position, velocity):
    """Steady motion; the places are those at sample 4."""
    time = 200.0 * np.arange(-4, 9)
    return trajectories(np.asarray(position)[:, None] + velocity[:, None] * time[:, None])


@pytest.fixture(scope="module")
def water():
    depth = np.array([0.0, 1500.0, 4000.0])
    return Medium.from_profile(
        depth, C0 + GRADIENT * depth, bottom_depth=3900.0, interpolation="linear"
    )


PLACES = np.array([[0.0, 0, 300], [4000, 500, 900], [-1500, 2500, 600]])
SPEEDS = np.array([[0.4, 0.1, 0.3], [-0.5, 0.2, -0.2], [0.0, 0.0, 0.0]])
LANDMARK = Landmark("L1", (900.0, -2900.0, 300.0))


@pytest.mark.parametrize(("turn_around", "pace"), [(0.0, 1.0), (2.0, 1.0), (5.0, 0.0)])
def test_exchanges_are_those_of_moving_vehicles_in_refracting_water(water, turn_around, pace):
    """
    Against exact exchanges along circular arcs; motion is worth decimetres, what is neglected
    millimetres.
    """
    speeds = pace * SPEEDS
    truth = fleet_in_motion(PLACES, speeds)
    still = range_fleet(truth, [LANDMARK], water)
    moving = range_fleet(truth, [LANDMARK], water, timing=TwoWay(turn_around))
    ends = [*zip([*PLACES, LANDMARK.position], [*speeds, np.zeros(3)], strict=True)]
    for row in np.flatnonzero(moving.attempts.sample == 4):
        (a, v_a), (b, v_b) = (
            ends[who[row]] for who in (moving.attempts.transmitter, moving.attempts.receiver)
        )
        bound = neglected(a, b, v_a, v_b, turn_around)
        assert bound < 2e-5  # s; the motion itself is worth up to 4e-4
        exact = exchange(in_gradient, a, b, v_a, v_b, turn_around)
        assert moving.truth.travel_time[row] == pytest.approx(exact, rel=0, abs=bound + 1e-8)
    moved = np.abs(moving.truth.refracted_range - still.truth.refracted_range).max()
    assert moved > 0.5 if pace else moved < 1e-9
    np.testing.assert_array_equal(moving.truth.distance, still.truth.distance)


def test_vehicles_at_one_place_and_lost_links_keep_their_status(water):
    """
    Equal positions have no direction; a receiver in the sea bed has no arrival; a stopped vehicle
    is silent.
    """
    truth = fleet_in_motion([PLACES[0], PLACES[0], PLACES[1]], 0.0 * SPEEDS)
    status = np.zeros(truth.status.shape)
    status[2] = VehicleStatus.GROUNDED
    buried = Landmark("L1", (0.0, 0.0, 3950.0))
    r = range_fleet(replace(truth, status=status), [buried], water, timing=TwoWay(1.0))
    together = (r.attempts.transmitter < 2) & (r.attempts.receiver < 2)
    assert (r.status[together] == RayStatus.OK).all()
    np.testing.assert_array_equal(r.truth.travel_time[together], 0.0)
    assert set(r.status[~together]) == {RayStatus.OUTSIDE, RayStatus.STOPPED}
    assert np.isnan(r.truth.travel_time[~together]).all()


def test_velocity_is_that_after_the_ping_or_before_the_end(make_truth):
    truth = make_truth("AB", 5)
    found = velocities(truth, np.array([1, 4]))
    np.testing.assert_allclose(found[:, 0] * 200.0, truth.position[:, 2] - truth.position[:, 1])
    np.testing.assert_allclose(found[:, 1] * 200.0, truth.position[:, 4] - truth.position[:, 3])


OFFSET, SKEW = (
    np.array([2e-3, -1e-3, 5e-4, 0, 0]),
    np.array([1e-6, -2e-6, 3e-7, 0, 0]),
)  # A, B, C, L1, L2


def shifts(m, true, clocks, **options):
    """Metres that clocks add to both ranges of each attempt, and who, when and how far it went."""
    plain = perturb(m, root_seed=1, realization=0)
    timed = perturb(m, root_seed=1, realization=0, clocks=clocks, ranging_truth=true, **options)
    straight, refracted = (
        getattr(timed, f) - getattr(plain, f) for f in ("straight_range", "refracted_range")
    )
    heard = m.range_status == RayStatus.OK
    np.testing.assert_allclose(straight[heard], refracted[heard], rtol=0, atol=1e-9)
    assert np.isfinite(straight).all()  # dropouts too: "straight-all" uses them
    travel = np.where(np.isnan(true.travel_time), true.chord_travel_time, true.travel_time)
    return straight, m.range_transmitter, m.range_receiver, m.time[m.range_sample], travel


def test_one_way_a_range_is_off_by_the_difference_of_the_clocks(
    make_measurements, make_ranging_truth
):
    """
    The receiver's clock minus the transmitter's, each at its own instant; landmarks keep true time.
    """
    m, true = make_measurements(), make_ranging_truth()
    late, i, j, sent, travel = shifts(m, true, Clocks(offset=OFFSET[:3], skew=SKEW[:3]))
    expected = OFFSET[j] + SKEW[j] * (sent + travel) - OFFSET[i] - SKEW[i] * sent
    np.testing.assert_allclose(late, true.sound_speed * expected, rtol=0, atol=1e-9)


def test_two_way_the_offset_cancels_and_the_skew_scales_the_time(
    make_measurements, make_ranging_truth
):
    m, true, two_way = make_measurements(), make_ranging_truth(), {"timing": TwoWay(2.0)}
    late, *_ = shifts(m, true, Clocks(offset=1e3 * OFFSET[:3], skew=np.zeros(3)), **two_way)
    np.testing.assert_array_equal(late, 0.0)
    skew = 100.0 * SKEW
    late, i, j, _, travel = shifts(m, true, Clocks(offset=OFFSET[:3], skew=skew[:3]), **two_way)
    # on the clocks: the responder waits until 2 s have passed on its own, the initiator reads the
    # sum on its own
    exact = 0.5 * ((1 + skew[i]) * (2 * travel + 2.0 / (1 + skew[j])) - 2.0) - travel
    second_order = 1450.0 * (2e-4) ** 2 * 2.0  # m; skew squared times the turn-around
    np.testing.assert_allclose(late, true.sound_speed * exact, rtol=0, atol=second_order)
    assert np.abs(late).max() > 0.1


def test_a_link_out_of_the_water_has_a_finite_straight_pseudorange(
    make_measurements, make_ranging_truth
):
    m, true = make_measurements(), make_ranging_truth()
    nothing = np.full(m.range_status.size, np.nan)
    m = replace(
        m, range_status=np.full(nothing.size, RayStatus.OUTSIDE), transmitter_sound_speed=nothing
    )
    true = replace(true, sound_speed=nothing, chord_travel_time=nothing, travel_time=nothing)
    options = {"clocks": ClockModel(1e-3, 1e-6), "ranging_truth": true}
    assert np.isfinite(perturb(m, root_seed=1, realization=0, **options).straight_range).all()


def test_clocks_are_drawn_by_vehicle_and_move_nothing_else(make_measurements, make_ranging_truth):
    m, model = make_measurements(), ClockModel(offset_sigma=1e-3, skew_sigma=1e-6)
    plain = perturb(m, root_seed=5, realization=2)
    timed = perturb(m, root_seed=5, realization=2, clocks=model, ranging_truth=make_ranging_truth())
    assert_same(timed, plain, but=("straight_range", "refracted_range"))
    names = "ABCDEFGHIJ"
    for r in range(3):
        drawn = model.draw(names, root_seed=5, realization=r)
        units = np.array(
            [stream(5, r, "sensing", name, "clock").standard_normal(2) for name in names]
        )
        np.testing.assert_array_equal(
            np.stack([drawn.offset, drawn.skew], axis=1), units * [1e-3, 1e-6]
        )


IMPOSSIBLE = {
    "turn_around is -1; it must be finite and zero or positive": lambda: TwoWay(-1.0),
    "offset_sigma is nan; it must be finite": lambda: ClockModel(offset_sigma=np.nan),
    r"Clocks: skew: shape is \(2,\); it must be \(1,\)": lambda: Clocks(
        offset=[0.0], skew=[0.0, 1.0]
    ),
    "Clocks: offset: 1 of 1 values are not finite": lambda: Clocks(offset=[np.inf], skew=[0.0]),
}


@pytest.mark.parametrize("message", IMPOSSIBLE)
def test_impossible_clocks_and_schemes_are_refused(message):
    with pytest.raises(SensingError, match=message):
        IMPOSSIBLE[message]()


@pytest.mark.parametrize(("n", "true", "message"), [
    (2, True, "clocks of 2 vehicles; the measurements have 3"),
    (3, False, "clocks need true travel times"),
])  # fmt: skip
def test_clocks_that_do_not_fit_are_refused(
    make_measurements, make_ranging_truth, n, true, message
):
    clocks = Clocks(offset=[0] * n, skew=[0] * n)
    ranging_truth = make_ranging_truth() if true else None
    with pytest.raises(SensingError, match=message):
        perturb(
            make_measurements(),
            root_seed=1,
            realization=0,
            clocks=clocks,
            ranging_truth=ranging_truth,
        )
