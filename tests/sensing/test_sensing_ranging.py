"""Ranges from the ray solver: both models, both directions, dropouts and silence."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.acoustics import Medium
from pymantaray.records import RayStatus, VehicleStatus
from pymantaray.sensing import Landmark, Links, NoiseModel, PingSchedule, assemble, measure_ranges

LANDMARKS = [Landmark("L1", (900.0, -900.0, 300.0)), Landmark("L2", (-1200.0, 0.0, 250.0))]
SCHEDULE = PingSchedule(800.0)  # samples 4, 8, 12
C0, GRADIENT, BOTTOM = 1450.0, 0.016, 3000.0


def medium(gradient):
    depth = np.array([0.0, 1500.0, 4000.0])
    return Medium.from_profile(depth, C0 + gradient * depth, bottom_depth=BOTTOM, interpolation="linear")


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("ABCD")


@pytest.fixture(scope="module")
def ranging(truth):
    return measure_ranges(truth, LANDMARKS, medium(GRADIENT), SCHEDULE, threads=1)


def place(truth, participant, sample):
    if participant < len(truth.name):
        return truth.position[participant, sample]
    return LANDMARKS[participant - len(truth.name)].position


def test_refracted_range_is_the_straight_one_where_sound_speed_is_constant(truth):
    ranging = measure_ranges(truth, LANDMARKS, medium(0.0), SCHEDULE)
    assert (ranging.status == RayStatus.OK).all()
    np.testing.assert_allclose(ranging.truth.refracted_range, ranging.truth.distance, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(ranging.truth.sound_speed, C0)


def test_every_attempt_by_closed_form(truth, ranging):
    """Travel time of the direct circular arc in a constant gradient, chord time along the straight line."""
    table = ranging.attempts
    assert table.sample.size == 3 * 4 * (3 + 2)
    assert (ranging.status == RayStatus.OK).all()
    for row, (sample, i, j) in enumerate(zip(*table, strict=True)):
        a, b = place(truth, i, sample), place(truth, j, sample)
        distance = np.linalg.norm(a - b)
        ca, cb = C0 + GRADIENT * a[2], C0 + GRADIENT * b[2]
        time = 2 / GRADIENT * np.arcsinh(GRADIENT * distance / (2 * np.sqrt(ca * cb)))
        chord = distance * np.log(cb / ca) / (cb - ca)
        assert ranging.truth.sound_speed[row] == pytest.approx(ca, rel=1e-12)
        assert ranging.truth.distance[row] == pytest.approx(distance, rel=1e-14)
        assert ranging.truth.travel_time[row] == pytest.approx(time, rel=0, abs=1e-6)
        assert ranging.truth.chord_travel_time[row] == pytest.approx(chord, rel=0, abs=1e-6)
        assert (
            ranging.truth.refracted_range[row]
            == ranging.truth.sound_speed[row] * ranging.truth.travel_time[row]
        )


def test_both_directions_share_one_travel_time_but_not_the_sound_speed(ranging):
    table = ranging.attempts
    rows = {key: row for row, key in enumerate(zip(*table, strict=True))}
    pairs = [(row, rows[k, j, i]) for (k, i, j), row in rows.items() if i < j < 4]
    forth, back = np.array(pairs).T
    assert forth.size == 18
    np.testing.assert_array_equal(ranging.truth.travel_time[forth], ranging.truth.travel_time[back])
    assert (ranging.truth.refracted_range[forth] != ranging.truth.refracted_range[back]).all()


def test_links_are_the_unordered_pairs_row_by_row_those_of_the_arrivals(truth, ranging, tmp_path):
    links, first = ranging.links, ranging.arrivals.first()
    assert links.sample.size == first.status.size == 3 * (6 + 4 * 2)
    assert (links.first < links.second).all()
    keys = set(zip(links.sample.tolist(), links.first.tolist(), links.second.tolist(), strict=True))
    assert len(keys) == links.sample.size
    for row in range(links.sample.size):
        a = place(truth, links.first[row], links.sample[row])
        b = place(truth, links.second[row], links.sample[row])
        assert first.source_sound_speed[row] == pytest.approx(C0 + GRADIENT * a[2], rel=1e-12)
        assert first.receiver_sound_speed[row] == pytest.approx(C0 + GRADIENT * b[2], rel=1e-12)
    links.save(tmp_path / "links.nc")
    np.testing.assert_array_equal(Links.load(tmp_path / "links.nc").second, links.second)


def test_a_stopped_vehicle_is_silent_and_the_others_are_not(truth, ranging):
    """Vehicle B stops between the first and the second ping."""
    status = truth.status.copy()
    status[1, 6:] = VehicleStatus.GROUNDED
    stopped = measure_ranges(replace(truth, status=status), LANDMARKS, medium(GRADIENT), SCHEDULE)
    table = stopped.attempts
    silent = ((table.transmitter == 1) | (table.receiver == 1)) & (table.sample > 6)
    assert silent.sum() == 2 * (3 + 3 + 2)
    np.testing.assert_array_equal(stopped.status, np.where(silent, RayStatus.STOPPED, RayStatus.OK))
    expected = np.where(silent, np.nan, ranging.truth.travel_time)
    np.testing.assert_array_equal(stopped.truth.travel_time, expected)
    for name in ("distance", "sound_speed", "chord_travel_time"):
        np.testing.assert_array_equal(getattr(stopped.truth, name), getattr(ranging.truth, name))
    heard = ~((stopped.links.sample > 6) & ((stopped.links.first == 1) | (stopped.links.second == 1)))
    assert heard.all()
    assert stopped.links.sample.size == stopped.arrivals.status.size == 3 * 14 - 2 * 5


def test_a_whole_fleet_at_rest_is_silent(truth):
    at_rest = replace(truth, status=np.full(truth.status.shape, VehicleStatus.LEFT_DOMAIN))
    stopped = measure_ranges(at_rest, [], medium(GRADIENT), SCHEDULE)
    assert (stopped.status == RayStatus.STOPPED).all()
    assert stopped.links.sample.size == stopped.arrivals.status.size == 0
    assert np.isfinite(stopped.truth.distance).all()


def test_a_link_behind_a_ridge_is_a_dropout_with_its_chord_and_sound_speed(truth):
    """A ridge up to 20 m below the surface, at north 3 km, hides a landmark from the whole fleet."""
    north, east, depth = np.array([-5e3, 2.5e3, 3e3, 3.5e3, 8e3]), np.array([-5e3, 5e3]), np.array([0.0, 4e3])
    speed = np.broadcast_to(C0 + GRADIENT * depth, (5, 2, 2))
    bathymetry = np.full((5, 2), BOTTOM)
    bathymetry[2] = 20.0
    ridge = Medium.from_grid(north, east, depth, speed, bathymetry=bathymetry, interpolation="linear")
    ranging = measure_ranges(truth, [Landmark("L", (5000.0, 0.0, 300.0))], ridge, SCHEDULE)
    hidden = ranging.attempts.receiver == 4
    np.testing.assert_array_equal(ranging.status, np.where(hidden, RayStatus.BLOCKED, RayStatus.OK))
    np.testing.assert_array_equal(np.isnan(ranging.truth.travel_time), hidden)
    np.testing.assert_array_equal(np.isnan(ranging.truth.refracted_range), hidden)
    at = truth.position[ranging.attempts.transmitter, ranging.attempts.sample]
    np.testing.assert_allclose(ranging.truth.sound_speed, C0 + GRADIENT * at[:, 2], rtol=1e-12)
    distance = np.linalg.norm(at - [5000.0, 0.0, 300.0], axis=-1)[hidden]
    np.testing.assert_allclose(ranging.truth.distance[hidden], distance, rtol=1e-14)
    speed_sum = C0 + GRADIENT * at[hidden, 2] + C0 + GRADIENT * 300.0
    np.testing.assert_allclose(ranging.truth.chord_travel_time[hidden], 2 * distance / speed_sum, rtol=1e-5)


def test_a_receiver_outside_the_water_hears_nothing(truth):
    buried = [Landmark("L", (0.0, 0.0, BOTTOM + 100.0))]
    ranging = measure_ranges(truth, buried, medium(GRADIENT), SCHEDULE)
    buried_link = ranging.attempts.receiver == 4
    np.testing.assert_array_equal(ranging.status, np.where(buried_link, RayStatus.OUTSIDE, RayStatus.OK))
    np.testing.assert_array_equal(np.isnan(ranging.truth.refracted_range), buried_link)
    assert np.isfinite(ranging.truth.distance).all()


def test_cut_off_is_handed_to_the_solver(truth):
    """No ray here is 10 dB stronger than spherical spreading, so a cut-off that asks for it leaves none."""
    strict = measure_ranges(truth, LANDMARKS, medium(GRADIENT), SCHEDULE, spreading_cutoff_db=-10.0)
    assert (strict.status == RayStatus.WEAK).all()


def test_one_vehicle_alone_ranges_nobody(make_truth):
    ranging = measure_ranges(make_truth("A"), [], medium(GRADIENT), SCHEDULE)
    assert ranging.status.size == ranging.links.sample.size == 0


def test_assembled_measurements_hold_the_measured_ranges(truth, ranging, tmp_path):
    observed = assemble(truth, LANDMARKS, ranging, NoiseModel())
    np.testing.assert_array_equal(observed.refracted_range, ranging.truth.refracted_range)
    np.testing.assert_array_equal(observed.range_transmitter, ranging.attempts.transmitter)
    np.testing.assert_array_equal(observed.range_receiver, ranging.attempts.receiver)
    np.testing.assert_array_equal(observed.range_sample, ranging.attempts.sample)
    np.testing.assert_array_equal(observed.range_status, ranging.status)
    np.testing.assert_array_equal(observed.straight_range, ranging.truth.distance)
    np.testing.assert_array_equal(observed.transmitter_sound_speed, ranging.truth.sound_speed)
    np.testing.assert_array_equal(observed.depth, truth.position[..., 2])
    np.testing.assert_array_equal(observed.first_position, truth.position[:, 0])
    np.testing.assert_array_equal(observed.first_quaternion, truth.quaternion[:, 0])
    np.testing.assert_array_equal(observed.landmark_position, [m.position for m in LANDMARKS])
    observed.save(tmp_path / "measurements.nc")
    again = type(observed).load(tmp_path / "measurements.nc")
    np.testing.assert_array_equal(again.refracted_range, observed.refracted_range)
