"""
Dropout by chance: how often, by whose stream, and what an attempt that was not heard looks like.
"""

import numpy as np
import pytest
from factories import assert_same

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import RayStatus
from pymantaray.sensing import perturb


def hear(measurements, probability, realization=3):
    return perturb(measurements, root_seed=7, realization=realization, detection=probability)


def test_each_ordered_pair_draws_from_its_own_stream_once_an_attempt(make_measurements):
    """So a higher probability only adds ranges, and another vehicle moves no draw."""
    m = make_measurements(epochs=range(1, 13))
    p = np.where(m.range_transmitter == 1, 0.3, 0.8)
    heard, names = hear(m, p).range_status == RayStatus.OK, [*m.name, *m.landmark_name]
    pairs = np.stack([m.range_transmitter, m.range_receiver])
    for i, j in np.unique(pairs, axis=1).T:
        rows = (pairs[0] == i) & (pairs[1] == j)
        chance = stream(7, 3, "sensing", str(names[i]), "heard", str(names[j])).random(rows.sum())
        expected = (chance < p[rows]) & (m.range_status[rows] == RayStatus.OK)
        np.testing.assert_array_equal(heard[rows], expected)
    assert 0 < heard.sum() < np.count_nonzero(m.range_status == RayStatus.OK)


def test_what_is_not_heard_is_unheard_and_nothing_else_changes(make_measurements):
    m = make_measurements()
    ok = m.range_status == RayStatus.OK
    plain = perturb(m, root_seed=7, realization=3)
    for name, hidden in (("range_status", RayStatus.UNHEARD), ("refracted_range", np.nan)):
        certain, impossible = (getattr(hear(m, np.full(ok.size, p)), name) for p in (1.0, 0.0))
        np.testing.assert_array_equal(certain, getattr(plain, name))
        np.testing.assert_array_equal(impossible, np.where(ok, hidden, getattr(plain, name)))
    silent = hear(m, np.zeros(ok.size))
    assert_same(silent, plain, but=("range_status", "refracted_range"))


def test_probabilities_that_are_none_are_refused(make_measurements):
    m = make_measurements()
    ok = m.range_status == RayStatus.OK
    with pytest.raises(SensingError, match=r"probability: shape \(2,\); 36 range attempts"):
        hear(m, [1.0, 1.0])
    for value in (1.5, np.nan):
        with pytest.raises(
            SensingError,
            match=f"1 attempts with .* have one outside 0 to 1, the first is {value:g}",
        ):
            hear(m, np.where(np.arange(ok.size) == 0, value, 1.0))
    hear(m, np.where(ok, 1.0, np.nan))  # a dropout needs none
