"""
What each sensor measures without noise, how noisy it is believed to be, what is drawn, and that
nothing else moves a draw.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
from refusals import refused

from pymantaray.config.sections import NoiseSection
from pymantaray.errors import SensingError
from pymantaray.estimation import dead_reckon
from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_log, so3_exp
from pymantaray.sensing import Landmark, NoiseModel, perturb

NOISY = NoiseModel(odometry_rotation_drift=1e-4, first_rotation_sigma=0.02)


def test_composed_odometry_gives_the_truth_back(make_truth, make_measurements):
    """2,000 edges of a tumbling walk over kilometres, within a nanometre."""
    truth = make_truth(n_time=2001)
    position, quaternion = dead_reckon(make_measurements(n_time=2001))
    np.testing.assert_allclose(position, truth.position, rtol=0, atol=1e-9)
    turns = (matrix_from_quaternion(q) for q in (quaternion, truth.quaternion))
    np.testing.assert_allclose(*turns, rtol=0, atol=1e-12)


def test_gnss_fixes_exactly_while_shallow(make_truth, make_measurements):
    depth = np.sort(make_truth().position[..., 2].ravel())
    for limit, count in (
        (0.0, 0),
        (depth[7], 7),
        (np.nextafter(depth[7], np.inf), 8),
    ):  # 7: not that one itself
        m = make_measurements(gnss_depth=limit)
        assert m.gnss_vehicle.size == count
        np.testing.assert_array_equal(
            m.gnss_position, make_truth().position[m.gnss_vehicle, m.gnss_sample]
        )
        assert (m.gnss_position[:, 2] < limit).all()
    with pytest.raises(SensingError, match="gnss_depth is -1 m; it must be zero or positive"):
        make_measurements(gnss_depth=-1.0)


def test_composite_sigma_by_hand():
    """
    Each component of an edge's motion has its own error: 3, -4 and 12 m, a rotation vector in 200
    s, then rest for 100 s.
    """
    turn = np.array([0.1, -0.2, 0.0])
    rotation = quaternion_from_matrix(so3_exp([turn, np.zeros(3)]))
    edges = rotation, [[3.0, -4.0, 12.0], [0.0, 0.0, 0.0]], [0.0, 200.0, 300.0]
    first = [
        *np.sqrt((1e-6 * turn) ** 2 + (5e-7 * 200) ** 2),
        np.sqrt((0.05 * 3) ** 2 + (0.0125 * 200) ** 2),
        np.sqrt((0.05 * 4) ** 2 + (0.0125 * 200) ** 2),
        np.sqrt((0.001 * 12) ** 2 + (0.0125 * 200) ** 2),
    ]
    expected = [first, [5e-5, 5e-5, 5e-5, 1.25, 1.25, 1.25]]
    np.testing.assert_allclose(NoiseModel().odometry_sigma(*edges), expected, rtol=1e-12)
    shares = NoiseModel(
        odometry_rotation_fraction=0.1, odometry_rotation_drift=0.0, odometry_translation_drift=0.0
    )
    expected = [[0.01, 0.02, 0.0, 0.15, 0.2, 0.012], [0.0] * 6]
    np.testing.assert_allclose(shares.odometry_sigma(*edges), expected, rtol=1e-12, atol=1e-17)


def test_a_dive_gives_no_horizontal_error_by_its_fraction():
    """
    A float that descends 100 m in 200 s: 2.5 m on each axis, as at rest, except 0.1 m more in
    quadrature downward.
    """
    edge = [[1.0, 0.0, 0.0, 0.0]], [[0.0, 0.0, 100.0]], [0.0, 200.0]
    np.testing.assert_allclose(
        NoiseModel().odometry_sigma(*edge)[0, 3:], [2.5, 2.5, np.hypot(2.5, 0.1)], rtol=1e-12
    )


def test_defaults_are_those_of_a_configuration():
    assert NoiseSection().model == NoiseModel()


@pytest.mark.parametrize("name", [f.name for f in fields(NoiseModel)])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_impossible_noise_is_refused_in_one_line(name, value):
    with pytest.raises(
        SensingError, match=f"NoiseModel: {name} is .* finite and zero or positive$"
    ):
        NoiseModel(**{name: value})


def relative(base, noisy, rotation, translation):
    """Tangent vector xi with noisy = base * Exp(xi)."""
    r0, r1 = (matrix_from_quaternion(getattr(m, rotation)) for m in (base, noisy))
    inverse = np.swapaxes(r0, -1, -2)
    shift = getattr(noisy, translation) - getattr(base, translation)
    return se3_log(inverse @ r1, np.einsum("...ij,...j->...i", inverse, shift))


def assert_draws(drawn, expected):
    np.testing.assert_allclose(drawn, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("names", ["ABC", "DCBA"])
@pytest.mark.parametrize(("seed", "realization"), [(5, 2), (0, 0)])
def test_every_draw_is_a_normal_of_its_stream_times_its_sigma(
    make_measurements, names, seed, realization
):
    """
    So seeds and realizations are independent, and another vehicle, landmark, fix or dropout moves
    no draw.
    """
    clean = make_measurements(names, gnss_depth=301.0, epochs=range(1, 13))
    wide = np.broadcast_to([0.3, 0.4, 0.5, 2.0, 3.0, 4.0], clean.odometry_sigma.shape)
    clean = replace(clean, odometry_sigma=wide, first_sigma=wide[:, 0])
    noisy = perturb(clean, root_seed=seed, realization=realization)

    def draws(shape, *use):
        return stream(seed, realization, "sensing", *use).standard_normal(shape)

    odometry = relative(clean, noisy, "odometry_rotation", "odometry_translation")
    first = relative(clean, noisy, "first_quaternion", "first_position")
    fixes = (noisy.gnss_position - clean.gnss_position) / clean.gnss_sigma[:, None]
    assert 0 < fixes.shape[0] < clean.depth.size
    for a, name in enumerate(names):
        assert_draws(odometry[a], draws((12, 6), name, "odometry") * wide[a])
        assert_draws(first[a], draws(6, name, "first pose") * wide[a, 0])
        assert_draws(
            noisy.depth[a] - clean.depth[a], draws(13, name, "depth") * clean.depth_sigma[a]
        )
        own = clean.gnss_vehicle == a
        assert_draws(fixes[own], draws((13, 3), name, "gnss")[clean.gnss_sample[own]])
    surveys = noisy.landmark_position - clean.landmark_position
    for k, name in enumerate(clean.landmark_name):
        assert_draws(surveys[k], draws(3, name, "survey") * clean.landmark_sigma[k])
    straight, refracted = (
        getattr(noisy, name) - getattr(clean, name)
        for name in ("straight_range", "refracted_range")
    )
    participants = [*clean.name, *clean.landmark_name]
    for i, j in set(zip(clean.range_transmitter, clean.range_receiver, strict=True)):
        rows = (clean.range_transmitter == i) & (clean.range_receiver == j)
        draw = draws(12, participants[i], "range", participants[j]) * clean.range_sigma[rows]
        assert_draws(straight[rows], draw)
        assert_draws(refracted[rows], np.where(clean.range_status[rows] == 0, draw, np.nan))


def test_the_sigmas_are_those_of_the_model(make_measurements):
    m = make_measurements(noise=NOISY, gnss_depth=1e9)
    for sigma, expected in (
        (m.depth_sigma, 0.01),
        (m.gnss_sigma, 0.1),
        (m.range_sigma, 1.0),
        (m.landmark_sigma, 0.1),
    ):
        assert set(sigma) == {expected}
    np.testing.assert_array_equal(m.first_sigma, [[0.02] * 3 + [0.1] * 3] * 3)
    edges = m.odometry_rotation, m.odometry_translation, m.time
    np.testing.assert_array_equal(m.odometry_sigma, NOISY.odometry_sigma(*edges))


def test_a_landmark_may_have_a_survey_of_its_own(make_measurements, landmarks):
    """One that the fleet has to locate, beside one that GNSS has surveyed."""
    own = (*landmarks[:-1], replace(landmarks[-1], sigma=80.0))
    m, plain = make_measurements(landmarks=own), make_measurements()
    np.testing.assert_array_equal(m.landmark_sigma, [*plain.landmark_sigma[:-1], 80.0])
    np.testing.assert_array_equal(m.landmark_position, plain.landmark_position)
    refused(
        SensingError,
        "sigma is 0 m; it must be finite and positive",
        Landmark,
        "L",
        np.zeros(3),
        0.0,
    )
