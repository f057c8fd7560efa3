"""Dropout by chance: how often, by whose stream, and what an attempt that was not heard looks like."""

import numpy as np
import pytest

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import RayStatus
from pymantaray.sensing import Hearing, perturb


def hear(measurements, probability, realization=0):
    return perturb(measurements, root_seed=7, realization=realization, probability=probability)


def test_certain_attempts_are_heard_and_impossible_ones_are_not(make_measurements):
    o = make_measurements()
    plain = perturb(o, root_seed=7, realization=0)
    ones, zeros = np.ones(o.range_status.size), np.zeros(o.range_status.size)
    np.testing.assert_array_equal(hear(o, ones).range_status, o.range_status)
    np.testing.assert_array_equal(hear(o, ones).refracted_range, plain.refracted_range)
    silent = hear(o, zeros)
    ok = o.range_status == RayStatus.OK
    np.testing.assert_array_equal(silent.range_status, np.where(ok, RayStatus.UNHEARD, o.range_status))
    assert np.isnan(silent.refracted_range).all()
    for name in ("straight_range", "depth", "odometry_translation"):
        np.testing.assert_array_equal(getattr(silent, name), getattr(plain, name))


def test_the_share_of_heard_attempts_is_the_probability(make_measurements):
    o = make_measurements(epochs=range(1, 13))
    p = np.where(o.range_transmitter == 1, 0.3, 0.8)
    ok = o.range_status == RayStatus.OK
    heard = np.stack([hear(o, p, r).range_status[ok] == RayStatus.OK for r in range(60)])
    for value in (0.3, 0.8):
        chosen = heard[:, p[ok] == value]
        assert chosen.size > 2000
        assert abs(chosen.mean() - value) < 5 * np.sqrt(value * (1 - value) / chosen.size)
    by_pair = heard.reshape(60, -1)
    assert np.unique(by_pair, axis=0).shape[0] == 60  # realizations differ


def test_each_ordered_pair_draws_from_its_own_stream(make_measurements):
    o = make_measurements()
    heard = hear(o, np.full(o.range_status.size, 0.5), realization=3).range_status == RayStatus.OK
    names = [*o.name, *o.landmark_name]
    for i, j in ((0, 1), (1, 0), (2, 4)):
        rows = (o.range_transmitter == i) & (o.range_receiver == j)
        chance = stream(7, 3, "sensing", str(names[i]), "heard", str(names[j])).random(rows.sum())
        np.testing.assert_array_equal(heard[rows], chance < 0.5)


def test_a_higher_probability_only_adds_ranges(make_measurements):
    o = make_measurements(epochs=range(1, 13))
    p = np.full(o.range_status.size, 0.4)
    few, many = (hear(o, q).range_status == RayStatus.OK for q in (p, p + 0.3))
    assert few.sum() < many.sum()
    assert not np.any(few & ~many)


def test_another_vehicle_moves_no_draw(make_measurements):
    def by_name(names):
        o = make_measurements(names, epochs=range(1, 13))
        status = hear(o, np.full(o.range_status.size, 0.5)).range_status
        who = [*o.name, *o.landmark_name]
        return {
            (who[i], who[j], int(k)): int(s)
            for i, j, k, s in zip(o.range_transmitter, o.range_receiver, o.range_sample, status, strict=True)
            if {who[i], who[j]} != {"A", "C"}  # whom the fixture makes a dropout in one direction
        }

    few, many = by_name("ABC"), by_name("ABCD")
    assert few.items() <= {k: v for k, v in many.items() if k in few}.items()
    assert set(few.values()) == {RayStatus.OK, RayStatus.UNHEARD}


def test_probabilities_that_are_none_are_refused(make_measurements):
    o = make_measurements()
    with pytest.raises(SensingError, match=r"probability: shape \(2,\); 36 range attempts"):
        hear(o, [1.0, 1.0])
    p = np.ones(o.range_status.size)
    p[0] = 1.5
    with pytest.raises(
        SensingError, match=r"1 attempts with an arrival have none in 0 to 1, the first is 1\.5"
    ):
        hear(o, p)
    p[0] = np.nan
    with pytest.raises(SensingError, match="1 attempts"):
        hear(o, p)
    hear(o, np.where(o.range_status == RayStatus.OK, 1.0, np.nan))  # a dropout needs none


def test_probabilities_are_kept_on_disk(tmp_path):
    kept = Hearing(probability=[0.25, np.nan, 1.0])
    kept.save(tmp_path / "hearing.nc")
    np.testing.assert_array_equal(Hearing.load(tmp_path / "hearing.nc").probability, kept.probability)
