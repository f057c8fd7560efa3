"""The noise stage: what it draws, how much, and that nothing else moves a draw."""

from dataclasses import fields

import numpy as np
import pytest
from scipy import stats

from pymantaray.geometry.se3 import matrix_from_quaternion, se3_log
from pymantaray.sensing import Landmark, NoiseModel, perturb

SILENT = NoiseModel(**{f.name: 0.0 for f in fields(NoiseModel)})
NOISY = NoiseModel(odometry_rotation_drift=1e-4, first_rotation_sigma=0.02)


def relative(base, noisy, rotation, translation):
    """Tangent vector xi with noisy = base * Exp(xi)."""
    r0, r1 = matrix_from_quaternion(getattr(base, rotation)), matrix_from_quaternion(getattr(noisy, rotation))
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
    base = make_measurements(noise=NOISY, gnss_depth=1e9)
    assert set(base.depth_sigma) == {0.01}
    assert set(base.gnss_sigma) == {0.10}
    assert set(base.range_sigma) == {1.0}
    assert set(base.landmark_sigma) == {0.1}
    np.testing.assert_array_equal(base.first_sigma, [[0.02] * 3 + [0.1] * 3] * 3)
    expected = NOISY.odometry_sigma(base.odometry_rotation, base.odometry_translation, base.time)
    np.testing.assert_array_equal(base.odometry_sigma, expected)


def test_realizations_and_seeds_are_independent_and_repeatable(make_measurements):
    base = make_measurements()
    one = perturb(base, root_seed=1, realization=0)
    np.testing.assert_array_equal(one.depth, perturb(base, root_seed=1, realization=0).depth)
    for seed, realization in ((1, 1), (2, 0)):
        other = perturb(base, root_seed=seed, realization=realization)
        for f in ("depth", "odometry_translation", "straight_range", "first_position", "landmark_position"):
            assert not np.any(getattr(other, f) == getattr(one, f)), f


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
    heard = base.range_status == 0
    straight = noisy.straight_range - base.straight_range
    refracted = noisy.refracted_range - base.refracted_range
    np.testing.assert_allclose(straight[heard], refracted[heard], rtol=0, atol=1e-10)
    assert np.isnan(noisy.refracted_range[~heard]).all()
    assert (~heard).sum() == 3
    assert np.unique(np.round(straight, 9)).size == straight.size  # one draw per attempt, dropouts too


def test_a_dropout_elsewhere_moves_no_range_draw(make_measurements):
    base = make_measurements()
    noisy = perturb(base, root_seed=3, realization=4)
    status = np.ones_like(base.range_status)
    muted = type(base)(**{f.name: getattr(base, f.name) for f in fields(base)} | {"range_status": status})
    again = perturb(muted, root_seed=3, realization=4)
    np.testing.assert_array_equal(again.straight_range, noisy.straight_range)


def test_truth_only_columns_stay_as_they_were(make_measurements):
    base = make_measurements()
    noisy = perturb(base, root_seed=3, realization=4)
    for name in ("transmitter_sound_speed", "time", "odometry_sigma"):
        np.testing.assert_array_equal(getattr(noisy, name), getattr(base, name))


@pytest.mark.parametrize("more", ["ABCD", "DCBA"])
def test_another_vehicle_moves_no_draw(make_measurements, more):
    few, many = make_measurements("ABC", gnss_depth=1e9), make_measurements(more, gnss_depth=1e9)
    noisy_few = perturb(few, root_seed=5, realization=2)
    noisy_many = perturb(many, root_seed=5, realization=2)
    row = [more.index(name) for name in "ABC"]
    for name in ("odometry_rotation", "odometry_translation", "depth", "first_position", "first_quaternion"):
        np.testing.assert_array_equal(getattr(noisy_many, name)[row], getattr(noisy_few, name))
    assert ranges_by_name(noisy_few).items() <= ranges_by_name(noisy_many).items()
    assert fixes_by_name(noisy_few).items() <= fixes_by_name(noisy_many).items()
    np.testing.assert_array_equal(noisy_many.landmark_position, noisy_few.landmark_position)


def test_another_landmark_moves_no_draw(make_measurements):
    few = make_measurements(landmarks=[Landmark("L1", (1, 2, 3))])
    many = make_measurements(landmarks=[Landmark("new", (7, 8, 9)), Landmark("L1", (1, 2, 3))])
    noisy_few, noisy_many = (perturb(o, root_seed=5, realization=2) for o in (few, many))
    assert ranges_by_name(noisy_few).items() <= ranges_by_name(noisy_many).items()
    np.testing.assert_array_equal(noisy_many.landmark_position[1], noisy_few.landmark_position[0])
    np.testing.assert_array_equal(noisy_many.depth, noisy_few.depth)


def test_more_or_fewer_fixes_move_no_draw(make_measurements):
    all_fixes = make_measurements(gnss_depth=1e9)
    some_fixes = make_measurements(gnss_depth=float(np.median(all_fixes.depth)))
    every, some = (perturb(o, root_seed=5, realization=2) for o in (all_fixes, some_fixes))
    assert 0 < some.gnss_agent.size < every.gnss_agent.size
    assert fixes_by_name(some).items() <= fixes_by_name(every).items()
    np.testing.assert_array_equal(some.depth, every.depth)


def ranges_by_name(o):
    names = [*o.name, *o.landmark_name]
    return {
        (names[i], names[j], int(k)): float(r)
        for i, j, k, r in zip(
            o.range_transmitter, o.range_receiver, o.range_sample, o.straight_range, strict=True
        )
    }


def fixes_by_name(o):
    return {
        (o.name[i], int(k)): tuple(p)
        for i, k, p in zip(o.gnss_agent, o.gnss_sample, o.gnss_position, strict=True)
    }
