"""Estimators with straight lines on a spherical Earth."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.apps.study.realization import RealizationSolver
from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.estimation import (
    GraphSolver,
    IncrementalOptions,
    Method,
    RangeEndpoints,
    SolveOptions,
    solve_conditions,
)
from pymantaray.estimation.ranges.on_sphere import OnSphere
from pymantaray.records import SolveStatus


@pytest.fixture(scope="module")
def round_earth(fly_tiny):
    """
    Mission of one hour on a sphere, deep enough that distances in the flat frame are too long, and
    its run.
    """
    return fly_tiny(
        fleet={"vehicles": {"1": {"target_depth": 800.0}}},
        mission={"duration_h": 1.0},
        acoustics={"earth": "sphere"},
    )


def links_at_truth(flown):
    truth, m = flown[0].truth, flown[0].measurements
    marks = np.broadcast_to(
        m.landmark_position[:, None], (m.landmark_name.size, truth.time.size, 3)
    )
    everyone = np.concatenate([truth.position, marks])
    ends = [everyone[who, m.range_sample] for who in (m.range_transmitter, m.range_receiver)]
    return RangeEndpoints(m.time[m.range_sample], *ends, m.transmitter_sound_speed)


def chord(earth_radius, a, b):
    """
    Straight distance by vectors from the Earth's centre; the frame is a stereographic projection.
    """
    ends = []
    for place in (a, b):
        far = np.hypot(place[:, 0], place[:, 1])
        angle = 2.0 * np.arctan(far / (2.0 * earth_radius))
        unit = place[:, :2] / np.where(far > 0.0, far, 1.0)[:, None]
        r = earth_radius - place[:, 2]
        ends.append(
            np.column_stack([r[:, None] * np.sin(angle)[:, None] * unit, r * np.cos(angle)])
        )
    return np.linalg.norm(ends[1] - ends[0], axis=1)


def test_straight_lines_are_chords_through_the_earth(round_earth, as_stored):
    run, links = round_earth[1], links_at_truth(round_earth)
    radius = (
        6378137.0 * np.sqrt(1.0 - 0.00669438) / (1.0 - 0.00669438 * np.sin(np.radians(74.5)) ** 2)
    )
    expected = chord(radius, links.transmitter, links.receiver)
    np.testing.assert_allclose(run.measurements.straight_range, expected, atol=1e-5)
    flat = np.linalg.norm(links.receiver - links.transmitter, axis=1)
    assert np.abs(flat - expected).max() > 0.02
    factory = EstimatorFactory(run)
    sections = {c.name: c for c in run.config.conditions}
    for name in ("straight", "refracted", "straight-all"):
        model = factory.estimator(sections[name], 0).model
        prediction = model.predict(links)
        np.testing.assert_allclose(prediction.travel_time * links.sound_speed, expected, atol=1e-5)
        step = np.array([1.0, -2.0, 0.5])
        moved = model.predict(links._replace(receiver=links.receiver + step)).travel_time
        back = model.predict(links._replace(receiver=links.receiver - step)).travel_time
        change = prediction.receiver_gradient @ step
        np.testing.assert_allclose(0.5 * (moved - back), change, rtol=2e-3, atol=1e-9)
    as_stored({"m": run.measurements, "truth": run.ranging_truth}, without="odometry|gnss")


def test_graphs_on_a_sphere_are_solved(round_earth):
    result = RealizationSolver.of(round_earth[1]).solve(0)
    assert {one.status for one in result.solutions.values()} == {SolveStatus.OK}


@pytest.mark.parametrize(
    "method",
    [Method(incremental=True), Method(lag=1e6), Method(lag=1e6, incremental=True)],
    ids=["incremental", "fixed-lag", "incremental-fixed-lag"],
)
def test_on_line_solvers_use_the_chord_as_the_batch_does(round_earth, method):
    run = round_earth[1]
    m = run.noisy_measurements(0)
    # precise ranges, so that the shape of the Earth matters
    m = replace(
        m,
        range_sigma=np.full_like(m.range_sigma, 0.01),
        straight_range=run.measurements.straight_range,
    )
    batch = EstimatorFactory(run).estimator(
        {c.name: c for c in run.config.conditions}["straight"], 0
    )
    tight = IncrementalOptions(
        relinearize=1e-6, wildfire=1e-9, final_updates=50, end_tolerance=1e-2
    )
    solver = GraphSolver(SolveOptions(step_tolerance=1e-9, incremental=tight))
    estimators = {
        "batch": batch,
        "on line": replace(batch, method=method),
        "in the flat frame": replace(batch, model=None),
    }
    solved = solve_conditions(m, estimators, solver=solver)
    assert solved["on line"].usable
    online, flat = (
        np.linalg.norm(solved[name].position - solved["batch"].position, axis=-1).max()
        for name in ("on line", "in the flat frame")
    )
    assert flat > 0.02
    assert online < 0.05 * flat


def test_a_factory_gives_on_line_solvers_the_sphere(tiny, round_earth):
    sections = [
        {"name": "isam2", "ranges": "straight", "solver": "incremental"},
        {"name": "lag", "ranges": "straight", "solver": {"kind": "fixed-lag", "lag_h": 1.0}},
    ]
    factory = EstimatorFactory(round_earth[1])
    for section in tiny(conditions=sections).conditions:
        assert isinstance(factory.estimator(section, 0).model, OnSphere)


def test_a_flat_earth_has_no_such_model(fly_tiny):
    run = fly_tiny(mission={"duration_h": 1.0})[1]
    factory = EstimatorFactory(run)
    assert all(factory.estimator(c, 0).model is None for c in run.config.conditions)
