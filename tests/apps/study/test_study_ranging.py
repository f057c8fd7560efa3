"""
What a study says of timing, currents, detection, ice and mistaken arrivals reaches its
measurements.
"""

import time

import numpy as np
import pytest

from pymantaray.acoustics import Leakage, Medium, WenzNoise
from pymantaray.acoustics.ocean_fields import build_currents
from pymantaray.apps.study import open_run
from pymantaray.apps.study.realization import RealizationQueue, SolverInputs, start_solver
from pymantaray.config.door.ocean import build_ocean
from pymantaray.config.door.sound import build_picker, build_sound, build_timing
from pymantaray.errors import StudyError
from pymantaray.estimation import read_pyfg
from pymantaray.jobs.pool import ProcessPool, run_tasks
from pymantaray.records import RayStatus
from pymantaray.sensing import ClockModel, Picker, TwoWay, perturb

DETECTION = {"source_level_db": 160.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}


ONE = {"realizations": 1}
CONDITIONS = ["odometry", "refracted"]
ERRING = {
    "study": {"realizations": 4},
    "conditions": ["refracted"],
    "acoustics": {"max_surface_bounces": 1, "max_bottom_bounces": 1},
    "ranging": {"mistaken": "first-detected"},
    "detection": DETECTION | {"source_level_db": 165.0},
}


def test_sections_become_what_ranging_takes(tiny):
    config = tiny(
        ranging={"timing": "two-way", "turn_around_s": 0.5},
        noise={"clock_skew_sigma": 1e-6},
        acoustics={"currents": True, "max_surface_bounces": 1, "max_bottom_bounces": 1}
        | {"surface_loss": "coherent", "sediment": "silt"},
        detection=DETECTION | {"wind_speed": 12.0},
    )
    ocean = build_ocean(config.ocean, config.mission.duration_h * 3600.0)
    assert build_timing(config.ranging) == TwoWay(turn_around=0.5)
    assert config.noise.clocks == ClockModel(skew_sigma=1e-6)
    currents = build_currents(ocean)
    np.testing.assert_array_equal(currents.velocity[..., 0], ocean.local["current_north"].values)
    np.testing.assert_array_equal(currents.velocity[..., 1], ocean.local["current_east"].values)
    reception = build_sound(config).reception(ocean)
    detector = reception.detector
    assert detector.sonar.noise == WenzNoise(wind_speed=12.0, shipping=0.5)
    assert (detector.surface.wind_speed, detector.surface.model) == (12.0, "coherent")
    assert detector.bottom is not None
    assert reception.leakage is None
    leaky = DETECTION | {"leakage": True, "leakage_reach_m": 50.0, "scatter_db": 30.0}
    assert build_sound(tiny(detection=leaky)).options.leakage == Leakage(50.0, scatter_db=30.0)
    assert build_picker(config) is None
    early = tiny(ranging={"mistaken": "first-detected", "below_strongest_db": 9.0})
    assert build_picker(early) == Picker("first-detected", below_strongest_db=9.0)
    strongest = tiny(ranging={"mistaken": "strongest-detected"})
    assert build_picker(strongest) == Picker("strongest-detected")
    deep, shallow = detector.absorption.db_per_km(np.array([[0, 0, 2000.0], [0, 0, 10.0]]), 25e3)
    assert 0.5 < deep < shallow < 10.0  # dB/km; pressure takes absorption away


@pytest.fixture(scope="module")
def two_way(run_tiny):
    """Two-way with bad clocks and a sonar that misses some pings."""
    clocks = {"clock_offset_sigma": 10.0, "clock_skew_sigma": 1e-4}
    timing = {"timing": "two-way", "turn_around_s": 2.0}
    return run_tiny(
        study=ONE, conditions=CONDITIONS, ranging=timing, noise=clocks, detection=DETECTION
    )


@pytest.fixture(scope="module")
def one_way(fly_tiny):
    """One-way in moving water with clocks that are a millisecond apart."""
    return fly_tiny(
        study=ONE,
        conditions=CONDITIONS,
        noise={"clock_offset_sigma": 1e-3},
        acoustics={"currents": True},
    )[1]


@pytest.fixture(scope="module")
def erring(run_tiny):
    return run_tiny(**ERRING)


@pytest.mark.parametrize(("name", "options"), [
    ("two_way", {"timing": TwoWay(2.0), "clocks": ClockModel(10.0, 1e-4)}),
    ("one_way", {"clocks": ClockModel(1e-3)}),
    ("erring", {}),
])  # fmt: skip
def test_noise_is_that_of_sensing_with_what_the_sections_say(request, name, options):
    run = request.getfixturevalue(name)
    if run.candidates is not None:
        options = options | {"detection": run.candidates}
    elif run.hearing is not None:
        options = options | {"detection": run.hearing.probability}
    seed = {"root_seed": run.config.study.seed, "realization": 0}
    expected = perturb(run.measurements, **seed, **options, ranging_truth=run.ranging_truth)
    assert run.noisy_measurements(0).to_dataset().identical(expected.to_dataset())
    options |= {"ranging_truth": run.ranging_truth, "correlation_time": 1e5}
    lasting = perturb(run.measurements, **seed, **options).to_dataset()
    drawn = run.noise._replace(pick_correlation_time=1e5).noisy(0).to_dataset()
    assert drawn.identical(lasting)
    assert drawn.identical(expected.to_dataset()) == (run.candidates is None)


def test_two_way_ranges_move_with_the_vehicles_and_the_current(two_way, one_way, tiny_run):
    o = tiny_run.measurements
    still, moved, drifted = (run.ranging_truth.travel_time for run in (tiny_run, two_way, one_way))
    ok = o.range_status == RayStatus.OK
    # m: up to a metre a second for 2 s and the way
    assert 0.05 < 1450.0 * np.abs(moved - still)[ok].max() < 20.0
    rows = {
        key: row
        for row, key in enumerate(
            zip(o.range_sample, o.range_transmitter, o.range_receiver, strict=True)
        )
    }
    forth, back = np.array(
        [(row, rows[k, j, i]) for (k, i, j), row in rows.items() if i < j < 4 and ok[row]]
    ).T
    change = drifted - still
    np.testing.assert_allclose(change[forth], -change[back], rtol=0, atol=2e-15)
    assert np.nanmax(np.abs(change)) * 1450.0 > 0.01  # m
    assert one_way.hearing is None


def test_detection_drops_pings_by_chance_and_says_how_many(two_way):
    again, ok = open_run(two_way.path), two_way.measurements.range_status == RayStatus.OK
    np.testing.assert_array_equal(again.hearing.probability, two_way.hearing.probability)
    np.testing.assert_array_equal(np.isfinite(two_way.hearing.probability), ok)
    expected = two_way.manifest["outcome"]["expected_unheard"]
    assert expected == pytest.approx(np.sum(1.0 - two_way.hearing.probability[ok]))
    lost = again.noisy_measurements(0).range_status == RayStatus.UNHEARD
    assert 0 < lost.sum() < ok.sum()
    graph, _ = read_pyfg(two_way.path / "pyfg" / "realization-0-refracted.pyfg.gz")
    assert len(graph["range"]) == ok.sum() - lost.sum()
    assert np.isfinite(two_way.estimates.position[0]).all()


def test_loss_at_the_ice_counts_and_vehicles_have_no_fix_there(fly_tiny, tiny_run, as_stored):
    bounces = {"max_surface_bounces": 1, "arrival": "strongest"}
    alone = {
        "source_level_db": 185.0,
        "coherent": False,
    }  # a weaker reflection could interfere less
    modem = {"ocean": {"ice": 0.8}, "detection": DETECTION | alone}
    (loud, _), (quiet, _) = (
        fly_tiny(**modem, acoustics=bounces | {"ice_loss_db": loss}) for loss in (0.0, 60.0)
    )
    less = loud.hearing.probability - quiet.hearing.probability
    assert np.nanmin(less) > -1e-12
    assert np.nanmax(less) > 0.5
    assert tiny_run.measurements.gnss_vehicle.size
    assert (
        loud.measurements.gnss_vehicle.size == 0
    )  # though 0.8 m is shallower than the antenna reaches
    assert loud.truth.position[..., 2].min() >= 0.8
    assert (loud.truth.status == tiny_run.truth.status).all()
    np.testing.assert_array_equal(loud.picture["sea_ice_draft"], 0.8)
    as_stored({"loud": loud.hearing, "quiet": quiet.hearing, "picture": loud.picture})


@pytest.mark.slow
def test_mistakes_are_counted_for_any_number_of_workers(erring, tiny_run):
    drawn = [erring.mistaken(r) for r in range(4)]
    expected = erring.manifest["outcome"]["expected_mistaken"]
    assert 3.0 < expected < drawn[0].size
    assert abs(np.mean([m.sum() for m in drawn]) - expected) < 4.0 * np.sqrt(expected) / 2.0
    assert np.unique([m.sum() for m in drawn]).size > 1
    np.testing.assert_array_equal(
        erring.ranging_truth.travel_time, tiny_run.ranging_truth.travel_time
    )
    stored = erring.estimates.position[0]
    by_two = {}
    with ProcessPool(start_solver, 2) as pool:
        pool.give(SolverInputs.of(erring), erring.path)
        run_tasks(RealizationQueue(range(4), by_two.__setitem__), pool)
    for r, solved in by_two.items():
        np.testing.assert_allclose(  # a file holds positions in steps of 0.8 mm
            solved.solutions["refracted"].position, stored[r], rtol=0, atol=0.401e-3
        )
        noisy = erring.noisy_measurements(r)
        assert (noisy.range_status[drawn[r]] == RayStatus.OK).all()
        assert np.isfinite(noisy.refracted_range[drawn[r]]).all()


def test_without_mistakes_there_is_no_file_and_none_is_mistaken(tiny_run):
    assert tiny_run.candidates is None
    assert not (tiny_run.path / "candidates.nc").exists()
    assert not tiny_run.mistaken(0).any()
    assert "expected_mistaken" not in tiny_run.manifest["outcome"]
    with pytest.raises(StudyError, match="realization 2: the run has 0 to 1"):
        tiny_run.mistaken(2)


def test_a_velocity_log_works_near_the_floor_and_sharpens_estimates(tiny_run, run_tiny, as_stored):
    """
    Altitudes are those above the medium's own bottom; the reach lies between those of the fleet.
    """
    position = tiny_run.truth.position
    floor = Medium.from_dataset(tiny_run.ocean).bottom_depth(position.reshape(-1, 3))
    altitude = floor.reshape(position.shape[:2]) - position[..., 2]
    reach = float(np.median(altitude))
    run = run_tiny(noise={"dvl_sigma": 1e-3, "dvl_reach": reach})
    m, near = run.measurements, altitude <= reach
    expected = np.argwhere(near[:, :-1] & near[:, 1:])
    assert 0 < len(expected) < altitude.size
    np.testing.assert_array_equal(np.stack([m.dvl_vehicle, m.dvl_sample], axis=1), expected)
    unranged = tiny_run.covariances.condition.tolist().index("no-ranges")
    sharp, blunt = (
        np.trace(one.pose_covariance[unranged, 0, -1, :, 3:, 3:], axis1=-2, axis2=-1)
        for one in (run.covariances, tiny_run.covariances)
    )
    helped = np.unique(m.dvl_vehicle)
    assert (sharp[helped] < 0.9 * blunt[helped]).all()
    as_stored({"log": m, "tables": run.tables["ate_pooled"].frame}, without="log.(?!dvl)")


def test_numbers_of_noise_in_every_kind_of_ranging_stay(two_way, one_way, as_stored):
    for name, run in (("two-way", two_way), ("one-way", one_way)):
        found = {
            "noise": run.noisy_measurements(0),
            "truth": run.ranging_truth,
            "told": run.hearing,
        }
        as_stored(found, name=name, without="gnss|odometry|attitude")


def test_numbers_of_ranges_that_receivers_mistake_stay(erring, as_stored):
    names = ("dropouts", "range_error")
    tables = {name: erring.tables[name].frame for name in names}
    expected = {"outcome": erring.manifest["outcome"], "chance": erring.hearing}
    as_stored(tables | expected | {"mistaken": [erring.mistaken(r) for r in range(4)]})


class CountedSteps:
    """Steps of other work, and how often the next one was asked for."""

    def __init__(self, left):
        self.left, self.asked = left, 0

    def __iter__(self):
        return self

    def __next__(self):
        self.asked += 1
        self.left -= 1
        if self.left < 0:
            raise StopIteration
        time.sleep(1e-3)


def slow_task():
    return lambda task: time.sleep(0.3) or task


@pytest.mark.parametrize("count", [0, 5, 10**9])
def test_a_process_works_between_results_and_waits_without_work(count):
    """Two tasks take 0.3 s each, a step 1 ms; without steps left, the process only waits."""
    steps, done = CountedSteps(count), {}
    with ProcessPool(slow_task, 1) as pool:
        run_tasks(RealizationQueue(range(2), done.__setitem__), pool, meanwhile=steps)
    assert sorted(done) == [0, 1]
    if count > 5:
        assert steps.asked > 20
    else:
        assert count < steps.asked < count + 10
