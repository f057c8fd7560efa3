"""What each sensor measures without noise, how noisy it is believed to be, what is drawn, and that nothing else moves a draw."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_exp, se3_log, so3_exp
from pymantaray.sensing import Landmark, NoiseModel, perturb
from pymantaray.study.config import NoiseSection

SILENT = NoiseModel(**{f.name: 0.0 for f in fields(NoiseModel)})
NOISY = NoiseModel(odometry_rotation_drift=1e-4, first_rotation_sigma=0.02)


def test_composed_odometry_gives_the_truth_back(make_truth, make_measurements):
    """2,000 edges of a tumbling walk over kilometres, within a nanometre."""
    truth, m = make_truth(n_time=2001), make_measurements(n_time=2001)
    turns = matrix_from_quaternion(m.odometry_rotation)
    assert turns.shape == (3, 2000, 3, 3)
    for agent in range(3):
        place, turned = truth.position[agent, 0], matrix_from_quaternion(truth.quaternion[agent, 0])
        for edge in range(2000):
            place = place + turned @ m.odometry_translation[agent, edge]
            turned = turned @ turns[agent, edge]
            np.testing.assert_allclose(place, truth.position[agent, edge + 1], rtol=0, atol=1e-9)
        last = matrix_from_quaternion(truth.quaternion[agent, -1])
        np.testing.assert_allclose(turned, last, rtol=0, atol=1e-12)


def test_gnss_fixes_exactly_while_shallow(make_truth, make_measurements):
    depth = np.sort(make_truth().position[..., 2].ravel())
    for limit, count in (
        (0.0, 0),
        (depth[7], 7),
        (np.nextafter(depth[7], np.inf), 8),
    ):  # 7: not that one itself
        m = make_measurements(gnss_depth=limit)
        assert m.gnss_agent.size == count
        np.testing.assert_array_equal(m.gnss_position, make_truth().position[m.gnss_agent, m.gnss_sample])
        assert (m.gnss_position[:, 2] < limit).all()
    with pytest.raises(SensingError, match="gnss_depth is -1 m; it must be zero or positive"):
        make_measurements(gnss_depth=-1.0)


def test_composite_sigma_by_hand():
    """An edge of length 3-4-12 -> 13 m with a turn of 0.2 rad in 200 s, then one at rest for 100 s."""
    rotation = quaternion_from_matrix(so3_exp([[0.0, 0.0, 0.2], [0.0, 0.0, 0.0]]))
    edges = rotation, [[3.0, 4.0, 12.0], [0.0, 0.0, 0.0]], [0.0, 200.0, 300.0]
    turn = np.sqrt((1e-6 * 0.2) ** 2 + (5e-7 * 200) ** 2)
    xy = np.sqrt((0.05 * 13) ** 2 + (0.0125 * 200) ** 2)
    z = np.sqrt((0.001 * 13) ** 2 + (0.0125 * 200) ** 2)
    expected = [[turn, turn, turn, xy, xy, z], [5e-5, 5e-5, 5e-5, 1.25, 1.25, 1.25]]
    np.testing.assert_allclose(NoiseModel().odometry_sigma(*edges), expected, rtol=1e-12)
    shares = NoiseModel(
        odometry_rotation_fraction=0.1, odometry_rotation_drift=0.0, odometry_translation_drift=0.0
    )
    expected = [[0.02, 0.02, 0.02, 0.65, 0.65, 0.013], [0.0] * 6]
    np.testing.assert_allclose(shares.odometry_sigma(*edges), expected, rtol=1e-12)


def test_defaults_are_the_papers_table_and_those_of_a_configuration():
    noise = NoiseModel()
    assert (noise.range_sigma, noise.depth_sigma, noise.gnss_sigma) == (1.0, 0.01, 0.10)
    assert (noise.odometry_rotation_fraction, noise.odometry_rotation_drift) == (1e-6, 5e-7)
    assert (noise.odometry_xy_fraction, noise.odometry_z_fraction) == (0.05, 0.001)
    assert noise.odometry_translation_drift == 0.0125
    assert NoiseModel(**NoiseSection().model_dump()) == noise


@pytest.mark.parametrize("name", [f.name for f in fields(NoiseModel)])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_impossible_noise_is_refused_in_one_line(name, value):
    with pytest.raises(SensingError, match=f"NoiseModel: {name} is .* finite and zero or positive$"):
        NoiseModel(**{name: value})


def relative(base, noisy, rotation, translation):
    """Tangent vector xi with noisy = base * Exp(xi)."""
    r0, r1 = (matrix_from_quaternion(getattr(m, rotation)) for m in (base, noisy))
    inverse = np.swapaxes(r0, -1, -2)
    shift = getattr(noisy, translation) - getattr(base, translation)
    return se3_log(inverse @ r1, np.einsum("...ij,...j->...i", inverse, shift))


def draws(base, noisy):
    """Give every draw of a realization in units of its sigma, by sensor."""
    return {
        "odometry": relative(base, noisy, "odometry_rotation", "odometry_translation") / base.odometry_sigma,
        "first": relative(base, noisy, "first_quaternion", "first_position") / base.first_sigma,
        "depth": (noisy.depth - base.depth) / base.depth_sigma[:, None],
        "gnss": (noisy.gnss_position - base.gnss_position) / base.gnss_sigma[:, None],
        "survey": (noisy.landmark_position - base.landmark_position) / base.landmark_sigma[:, None],
        "range": (noisy.straight_range - base.straight_range) / base.range_sigma,
    }


def assert_standard_normal(values, name):
    """Mean and variance within their two-sided 1e-4 bounds, for independent standard normal draws."""
    n = values.size
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], n) / n
    assert low < np.mean(values**2) < high, name
    assert abs(values.mean()) < stats.norm.ppf(1 - 5e-5) / np.sqrt(n), name


def test_every_sensor_has_its_own_variance(make_measurements):
    """Enough realizations for 3,000 draws or more of each component."""
    base = make_measurements(n_time=101, noise=NOISY, gnss_depth=1e9, epochs=range(10, 101, 10))
    total = [draws(base, perturb(base, root_seed=11, realization=r)) for r in range(60)]
    for name in total[0]:
        values = np.stack([one[name] for one in total])
        assert_standard_normal(values, name)
        if name in ("odometry", "first"):
            for component in range(6):
                assert_standard_normal(values[..., component], f"{name} {component}")


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


def test_poses_are_perturbed_from_the_right(make_measurements):
    """T Exp(xi), with xi the draw times its sigma; large turns tell left from right."""
    clean = make_measurements()
    wide = np.broadcast_to([0.3, 0.4, 0.5, 2.0, 3.0, 4.0], clean.odometry_sigma.shape)
    clean = replace(clean, odometry_sigma=wide, first_sigma=wide[:, 0])
    noisy = perturb(clean, root_seed=5, realization=2)

    def matrices(rotation, translation):
        out = np.zeros((*translation.shape[:-1], 4, 4))
        out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = rotation, translation, 1.0
        return out

    for use, q, t, sigma in (
        ("odometry", "odometry_rotation", "odometry_translation", clean.odometry_sigma),
        ("first pose", "first_quaternion", "first_position", clean.first_sigma),
    ):
        before, after = (
            matrices(matrix_from_quaternion(getattr(m, q)), getattr(m, t)) for m in (clean, noisy)
        )
        for a, name in enumerate(clean.name):
            xi = stream(5, 2, "sensing", str(name), use).standard_normal(sigma[a].shape) * sigma[a]
            step = matrices(*se3_exp(xi))
            np.testing.assert_allclose(after[a], before[a] @ step, rtol=0, atol=1e-10)
            assert np.abs(after[a] - step @ before[a]).max() > 0.1  # from the left it would be something else


def test_realizations_and_seeds_are_independent_and_repeatable(make_measurements):
    base = make_measurements()
    one, again, *others = (
        perturb(base, root_seed=seed, realization=r) for seed, r in ((1, 0), (1, 0), (1, 1), (2, 0))
    )
    np.testing.assert_array_equal(one.depth, again.depth)
    for other in others:
        for name in (
            "depth",
            "odometry_translation",
            "straight_range",
            "first_position",
            "landmark_position",
        ):
            assert not np.any(getattr(other, name) == getattr(one, name)), name


def test_zero_sigma_is_zero_noise(make_measurements):
    base = make_measurements(noise=SILENT, gnss_depth=1e9)
    noisy = perturb(base, root_seed=1, realization=0)
    for f in fields(base):
        one, two = getattr(noisy, f.name), getattr(base, f.name)
        if one.dtype.kind == "f":
            np.testing.assert_allclose(one, two, rtol=0, atol=1e-15, err_msg=f.name)
        else:
            np.testing.assert_array_equal(one, two, err_msg=f.name)


def test_straight_and_refracted_share_each_draw_and_dropouts_have_one(make_measurements):
    base = make_measurements()
    noisy = perturb(base, root_seed=3, realization=4)
    straight, refracted = (
        getattr(noisy, name) - getattr(base, name) for name in ("straight_range", "refracted_range")
    )
    heard = base.range_status == 0
    np.testing.assert_allclose(straight[heard], refracted[heard], rtol=0, atol=1e-10)
    assert np.isnan(refracted[~heard]).all()
    assert (~heard).sum() == 3
    assert np.unique(np.round(straight, 9)).size == straight.size  # one draw per attempt, dropouts too
    muted = replace(base, range_status=np.ones_like(base.range_status))
    again = perturb(muted, root_seed=3, realization=4)
    np.testing.assert_array_equal(again.straight_range, noisy.straight_range)


def named(m):
    """Ranges and fixes by the names of who measured them and when."""
    names = [*m.name, *m.landmark_name]
    ranges = zip(m.range_transmitter, m.range_receiver, m.range_sample, m.straight_range, strict=True)
    fixes = zip(m.gnss_agent, m.gnss_sample, m.gnss_position, strict=True)
    return {(names[i], names[j], int(k)): float(r) for i, j, k, r in ranges} | {
        (names[i], int(k)): tuple(p) for i, k, p in fixes
    }


@pytest.mark.parametrize("more", ["ABCD", "DCBA"])
def test_another_vehicle_moves_no_draw(make_measurements, more):
    few, many = (
        perturb(make_measurements(names, gnss_depth=1e9), root_seed=5, realization=2)
        for names in ("ABC", more)
    )
    row = [more.index(name) for name in "ABC"]
    for name in ("odometry_rotation", "odometry_translation", "depth", "first_position", "first_quaternion"):
        np.testing.assert_array_equal(getattr(many, name)[row], getattr(few, name))
    assert named(few).items() <= named(many).items()
    np.testing.assert_array_equal(many.landmark_position, few.landmark_position)


def test_another_landmark_or_fix_moves_no_draw(make_measurements):
    mark, new = Landmark("L1", (1, 2, 3)), Landmark("new", (7, 8, 9))
    some = float(np.median(make_measurements().depth))
    few, many = (
        perturb(make_measurements(landmarks=marks, gnss_depth=limit), root_seed=5, realization=2)
        for marks, limit in (([mark], some), ([new, mark], 1e9))
    )
    assert 0 < few.gnss_agent.size < many.gnss_agent.size
    assert named(few).items() <= named(many).items()
    np.testing.assert_array_equal(many.landmark_position[1], few.landmark_position[0])
    np.testing.assert_array_equal(many.depth, few.depth)
