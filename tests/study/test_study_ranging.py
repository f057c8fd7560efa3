"""Timing, currents, detection and mistaken arrivals as a study configures them, from the file to noisy measurements."""

import numpy as np
import pytest

from pymantaray.acoustics import WenzNoise
from pymantaray.errors import StudyError
from pymantaray.estimation import read_pyfg
from pymantaray.records import RayStatus
from pymantaray.sensing import ClockModel, Picker, TwoWay
from pymantaray.study import open_run
from pymantaray.study.assemble import (
    build_clocks,
    build_currents,
    build_detector,
    build_ocean,
    build_picker,
    build_timing,
)
from pymantaray.study.config import RangingSection
from pymantaray.study.realization import solve_realizations

DETECTION = {"source_level_db": 160.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}


STUDY = {"conditions": ["odometry", "refracted"], "realizations": 1}
ERRING = {
    "study": {"conditions": ["refracted"], "realizations": 4},
    "acoustics": {"max_surface_bounces": 1, "max_bottom_bounces": 1},
    "ranging": {"mistaken": "first-detected"},
    "detection": DETECTION | {"source_level_db": 165.0},
}


def test_sections_become_what_ranging_takes(tiny):
    config = tiny(
        ranging={"timing": "two-way", "turn_around_s": 0.5, "clock_skew_sigma": 1e-6},
        acoustics={"currents": True, "max_surface_bounces": 1, "max_bottom_bounces": 1},
        detection=DETECTION | {"wind_speed": 12.0, "surface_loss": "coherent", "sediment": "silt"},
    )
    ocean = build_ocean(config.ocean, config.mission.duration_h * 3600.0)
    assert build_timing(config.ranging) == TwoWay(turn_around=0.5)
    assert build_clocks(config.ranging) == ClockModel(skew_sigma=1e-6)
    currents = build_currents(config, ocean)
    np.testing.assert_array_equal(currents.velocity[..., 0], ocean.local["current_north"].values)
    np.testing.assert_array_equal(currents.velocity[..., 1], ocean.local["current_east"].values)
    detector = build_detector(config, ocean)
    assert detector.sonar.noise == WenzNoise(wind_speed=12.0, shipping=0.5)
    assert (detector.surface.wind_speed, detector.surface.model) == (12.0, "coherent")
    assert detector.bottom is not None
    deep, shallow = detector.absorption.db_per_km(np.array([[0, 0, 2000.0], [0, 0, 10.0]]), 25e3)
    assert 0.5 < deep < shallow < 10.0  # dB/km; pressure takes absorption away


@pytest.fixture(scope="module")
def two_way_run(run_tiny):
    """Two-way with bad clocks and a sonar that misses some pings."""
    clocks = {"clock_offset_sigma": 10.0, "clock_skew_sigma": 1e-4}
    timing = {"timing": "two-way", "turn_around_s": 2.0}
    return run_tiny(study=STUDY, ranging=timing | clocks, detection=DETECTION)


@pytest.fixture(scope="module")
def one_way_run(run_tiny):
    """One-way in moving water with clocks that are a millisecond apart."""
    return run_tiny(study=STUDY, ranging={"clock_offset_sigma": 1e-3}, acoustics={"currents": True})


def test_two_way_ranges_move_with_the_vehicles_and_their_clocks_skew(two_way_run, tiny_run):
    one, two = tiny_run.measurements, two_way_run.measurements
    np.testing.assert_array_equal(two.straight_range, one.straight_range)
    np.testing.assert_array_equal(two.range_status, one.range_status)
    moved = np.abs(two.refracted_range - one.refracted_range)[two.range_status == RayStatus.OK]
    assert 0.05 < moved.max() < 20.0  # m: up to a metre a second for the 2 s and the way
    noisy, plain = (run.noisy_measurements(0) for run in (two_way_run, tiny_run))
    clocks = np.abs(noisy.straight_range - plain.straight_range)
    assert 0.05 < clocks.max() < 5.0  # m: 1e-4 of some kilometres; of the 10 s of offset nothing


def test_detection_drops_pings_by_chance_and_says_how_many(two_way_run):
    run, again = two_way_run, open_run(two_way_run.path)
    ok = run.measurements.range_status == RayStatus.OK
    np.testing.assert_array_equal(again.hearing.probability, run.hearing.probability)
    np.testing.assert_array_equal(np.isfinite(run.hearing.probability), ok)
    expected = run.manifest["outcome"]["expected_unheard"]
    assert expected == pytest.approx(np.sum(1.0 - run.hearing.probability[ok]))
    assert 1.0 < expected < ok.sum() - 1.0
    lost = again.noisy_measurements(0).range_status == RayStatus.UNHEARD
    assert 0 < lost.sum() < ok.sum()
    np.testing.assert_array_equal(run.noisy_measurements(0).range_status == RayStatus.UNHEARD, lost)
    graph, _ = read_pyfg(run.path / "pyfg" / "realization-0-refracted.pyfg")
    assert len(graph["range"]) == ok.sum() - lost.sum()
    assert np.isfinite(run.estimates.position[0]).all()


def test_one_way_clocks_make_pseudoranges(one_way_run, tiny_run):
    o = one_way_run.measurements
    np.testing.assert_array_equal(o.straight_range, tiny_run.measurements.straight_range)
    noisy, plain = (run.noisy_measurements(0) for run in (one_way_run, tiny_run))
    early = (noisy.straight_range - plain.straight_range) / o.transmitter_sound_speed  # s
    at_landmarks = {
        (int(i), round(e, 12))
        for i, j, e in zip(o.range_transmitter, o.range_receiver, early, strict=True)
        if j >= 4
    }
    assert len(at_landmarks) == 4  # landmarks keep true time, each vehicle has one clock, and its own
    assert max(abs(e) for _, e in at_landmarks) > 1e-4
    np.testing.assert_array_equal(noisy.depth, plain.depth)
    assert one_way_run.hearing is None


def test_currents_change_the_two_directions_by_opposite_amounts(one_way_run, tiny_run):
    o, still = one_way_run.measurements, tiny_run.measurements
    np.testing.assert_array_equal(o.range_status, still.range_status)
    change = one_way_run.ranging_truth.travel_time - tiny_run.ranging_truth.travel_time
    who = zip(o.range_sample, o.range_transmitter, o.range_receiver, strict=True)
    rows = {key: row for row, key in enumerate(who)}
    forth, back = np.array([(row, rows[k, j, i]) for (k, i, j), row in rows.items() if i < j < 4]).T
    heard = o.range_status[forth] == RayStatus.OK
    np.testing.assert_allclose(change[forth][heard], -change[back][heard], rtol=0, atol=2e-15)
    assert np.nanmax(np.abs(change)) * 1450.0 > 0.01  # m


def test_sections_become_a_picker(tiny):
    ranging = tiny(ranging={"mistaken": "first-detected", "below_strongest_db": 9.0}).ranging
    assert build_picker(ranging, None) == Picker("first-detected", below_strongest_db=9.0)
    assert build_picker(RangingSection(mistaken="strongest-detected"), None) == Picker("strongest-detected")
    assert build_picker(RangingSection(), None) is None


@pytest.fixture(scope="module")
def erring_run(run_tiny):
    return run_tiny(**ERRING)


def test_mistakes_are_counted_and_become_ranges(erring_run, tiny_run):
    run, o = erring_run, erring_run.measurements
    outcome = run.manifest["outcome"]
    drawn = [run.mistaken(r) for r in range(4)]
    expected = outcome["expected_mistaken"]
    assert 3.0 < expected < o.range_status.size
    spread = np.sqrt(expected)  # no more than independent attempts have
    assert abs(np.mean([m.sum() for m in drawn]) - expected) < 4.0 * spread / 2.0
    time = run.ranging_truth.travel_time
    np.testing.assert_array_equal(time, tiny_run.ranging_truth.travel_time)
    for realization, mistaken in enumerate(drawn):
        noisy = run.noisy_measurements(realization)
        assert (noisy.range_status[mistaken] == RayStatus.OK).all()
        right = (noisy.range_status == RayStatus.OK) & ~mistaken
        late = noisy.refracted_range - run.ranging_truth.refracted_range
        assert np.abs(late[right]).max() < 5.0  # the noise has a sigma of 1 m
        assert (late[mistaken & np.isfinite(late)] > -5.0).all()
        assert np.isfinite(noisy.refracted_range[mistaken]).all()
    lost = [np.count_nonzero(run.noisy_measurements(r).range_status == RayStatus.UNHEARD) for r in range(4)]
    assert np.mean(lost) == pytest.approx(outcome["expected_unheard"], rel=0.4)


def test_results_do_not_depend_on_the_number_of_workers(erring_run):
    by_two = solve_realizations(erring_run, 2, lambda _: None)
    stored = erring_run.estimates.position[0]
    for realization, solved in enumerate(by_two):
        position = solved.solutions["refracted"].position.astype(stored.dtype)
        np.testing.assert_array_equal(position, stored[realization])
    assert np.unique([erring_run.mistaken(r).sum() for r in range(4)]).size > 1


def test_without_mistakes_there_is_no_file_and_none_is_mistaken(tiny_run):
    assert tiny_run.candidates is None
    assert not (tiny_run.path / "candidates.nc").exists()
    assert not tiny_run.mistaken(0).any()
    assert "expected_mistaken" not in tiny_run.manifest["outcome"]
    with pytest.raises(StudyError, match="realization 2: the run has 0 to 1"):
        tiny_run.mistaken(2)
