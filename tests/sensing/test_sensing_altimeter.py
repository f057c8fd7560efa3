"""Depths from altitudes: truth, reach, noise and bias, and the factors that a graph has of them."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import EstimationError, SensingError
from pymantaray.estimation import build_graph
from pymantaray.estimation.graph.graph import GraphValues
from pymantaray.estimation.graph.pyfg import write_pyfg
from pymantaray.geometry import stream
from pymantaray.records import RangingTruth
from pymantaray.sensing import NoiseModel, Ranging, assemble, perturb
from pymantaray.sensing.schedule import Attempts


@pytest.fixture(scope="module")
def fleet(make_truth):
    return make_truth("AB")


def measured(truth, altitude=0.0, **levels):
    none = np.empty(0, dtype=int)
    truths = RangingTruth(*np.empty((4, 0)))
    ranging = Ranging(
        Attempts(none, none, none),
        none.astype(np.int8),
        truths,
        links=None,
        arrivals=None,
        receptions=None,
        link=none,
    )
    return assemble(truth, [], ranging, NoiseModel(**levels), altitude=altitude)


def test_without_a_level_there_is_no_sensor_and_beyond_reach_no_depth(fleet):
    assert measured(fleet).altimeter_vehicle.size == 0
    altitude = np.full(fleet.status.shape, 99.0)
    altitude[1, 5] = 101.0
    some = measured(fleet, altitude, altimeter_sigma=0.05)
    rows = list(zip(some.altimeter_vehicle.tolist(), some.altimeter_sample.tolist(), strict=True))
    assert (1, 5) not in rows
    assert len(rows) == altitude.size - 1
    expected = fleet.position[some.altimeter_vehicle, some.altimeter_sample, 2]
    np.testing.assert_array_equal(some.altimeter_depth, expected)


def test_noise_and_bias_are_draws_of_their_own_streams(fleet):
    exact = measured(fleet, altimeter_sigma=0.05, altimeter_bias_sigma=2.0)
    noisy = perturb(exact, root_seed=3, realization=2)
    for vehicle, name in enumerate("AB"):
        n = fleet.time.size
        noise = 0.05 * stream(3, 2, "sensing", name, "altimeter").standard_normal(n)
        bias = 2.0 * stream(3, 2, "sensing", name, "altimeter bias").standard_normal(1)
        error = (noisy.altimeter_depth - exact.altimeter_depth)[exact.altimeter_vehicle == vehicle]
        np.testing.assert_allclose(error, noise + bias, rtol=0, atol=1e-12)


def test_a_graph_has_them_as_depths_that_text_cannot_hold(fleet, tmp_path):
    exact = measured(fleet, altimeter_sigma=0.05)
    graph = build_graph(exact, None)
    factors = graph["altimeter"]
    n = fleet.time.size
    poses = exact.altimeter_vehicle * n + exact.altimeter_sample
    np.testing.assert_array_equal(factors.subject, poses)
    np.testing.assert_array_equal(factors.column("depth"), fleet.position.reshape(-1, 3)[poses, 2])
    np.testing.assert_allclose(factors.variance, 0.05**2)
    values = GraphValues(
        fleet.position.reshape(-1, 3), fleet.quaternion.reshape(-1, 4), np.empty((0, 3))
    )
    line = f"cannot hold {poses.size} altimeter depths"
    refused(EstimationError, line, write_pyfg, graph, tmp_path / "a.pyfg", initial=values)


def test_a_bias_without_a_sensor_is_refused():
    refused(
        SensingError, "bias sigma is 1 m without a sensor", NoiseModel, altimeter_bias_sigma=1.0
    )
