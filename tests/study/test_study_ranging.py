"""Timing, currents and detection as a study configures them, from the file to the noisy measurements."""

import numpy as np
import pytest

from pymantaray.acoustics import WenzNoise
from pymantaray.estimation import read_pyfg
from pymantaray.records import RayStatus
from pymantaray.sensing import ClockModel, TwoWay
from pymantaray.study import open_run, parse_study, run_study
from pymantaray.study.assemble import build_clocks, build_currents, build_detector, build_ocean, build_timing

DETECTION = {"source_level_db": 160.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}


def run_of(tree, folder, **sections):
    tree["study"].update(conditions=["odometry", "refracted"], realizations=1)
    return run_study(parse_study(tree | sections, "tiny"), folder / "run", workers=1)


def test_sections_become_what_ranging_takes(tiny_tree):
    tree = tiny_tree | {
        "ranging": {"timing": "two-way", "turn_around_s": 0.5, "clock_skew_sigma": 1e-6},
        "acoustics": {"currents": True, "max_surface_bounces": 1, "max_bottom_bounces": 1},
        "detection": DETECTION | {"wind_speed": 12.0, "surface_loss": "coherent", "sediment": "silt"},
    }
    config = parse_study(tree)
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
def two_way_run(make_tiny_tree, tmp_path_factory):
    """Two-way with bad clocks and a sonar that misses some pings."""
    ranging = {
        "timing": "two-way",
        "turn_around_s": 2.0,
        "clock_offset_sigma": 10.0,
        "clock_skew_sigma": 1e-4,
    }
    return run_of(make_tiny_tree(), tmp_path_factory.mktemp("two_way"), ranging=ranging, detection=DETECTION)


@pytest.fixture(scope="module")
def one_way_run(make_tiny_tree, tmp_path_factory):
    """One-way in moving water with clocks that are a millisecond apart."""
    return run_of(
        make_tiny_tree(),
        tmp_path_factory.mktemp("one_way"),
        ranging={"clock_offset_sigma": 1e-3},
        acoustics={"currents": True},
    )


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
