"""
Receptions without a ray: a status of their own, a range if they are heard, and nothing unless it is
asked for.
"""

import numpy as np
import pytest
from factories import HIDDEN, assert_same, range_fleet, ridged
from refusals import refused

from pymantaray.acoustics import Currents, Leakage, Sonar
from pymantaray.errors import SensingError
from pymantaray.evaluation import dropout_table
from pymantaray.records import RayStatus
from pymantaray.records.status import ARRIVES
from pymantaray.sensing import (
    Detector,
    NoiseModel,
    OneWay,
    Picker,
    ReceptionOptions,
    SoundPath,
    TwoWay,
    assemble,
    find_candidates,
    find_receptions,
    perturb,
)

WATER = ridged(200.0, speed=1480.0)
LOUD = Detector(Sonar(source_level_db=190.0, frequency_hz=1e3, bandwidth_hz=500.0, noise=60.0))


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("AB")


def ranged(truth, leakage=None, detector=LOUD, **options):
    return range_fleet(truth, [HIDDEN], WATER, detector=detector, leakage=leakage, **options)


@pytest.fixture(scope="module")
def plain(truth):
    return ranged(truth)


@pytest.fixture(scope="module")
def leaky(truth):
    return ranged(truth, Leakage(reach=400.0))


def test_what_a_ridge_hides_leaks_and_nothing_else_changes(plain, leaky):
    hidden = np.flatnonzero(plain.status != RayStatus.OK)
    assert hidden.size >= 4
    assert (leaky.status[hidden] == RayStatus.LEAKED).all()
    seen = np.flatnonzero(plain.status == RayStatus.OK)
    for name in ("status", "probability"):
        np.testing.assert_array_equal(getattr(leaky, name)[seen], getattr(plain, name)[seen])
    np.testing.assert_array_equal(leaky.truth.travel_time[seen], plain.truth.travel_time[seen])
    assert_same(leaky.arrivals, plain.arrivals)  # sound that leaks is no eigenray
    rows = leaky.receptions.path == SoundPath.LEAKED
    assert np.unique(leaky.receptions.link[rows]).size * 2 == rows.sum()  # both directions
    assert (leaky.receptions.arrival[rows] == -1).all()
    assert (leaky.receptions.selected[rows] == 1).all()
    detour = leaky.truth.travel_time[hidden] * 1480.0 - leaky.truth.distance[hidden]
    assert ((detour > 0.0) & (detour < 30.0)).all()  # over a crest some 100 m above the chord
    assert ((leaky.probability[hidden] > 0.0) & (leaky.probability[hidden] <= 1.0)).all()


def test_what_is_heard_of_it_is_a_range_like_any_other(truth, leaky):
    m = assemble(truth, [HIDDEN], leaky, NoiseModel(range_sigma=1.0))
    leaked = m.range_status == RayStatus.LEAKED
    chance = np.where(leaked, 0.5, leaky.probability)
    noisy = [
        perturb(m, root_seed=1, realization=r, detection=chance).range_status for r in range(60)
    ]
    for status in noisy:
        assert set(status[leaked]) <= {RayStatus.OK, RayStatus.UNHEARD}
    share = np.mean([(status[leaked] == RayStatus.OK).mean() for status in noisy])
    assert share == pytest.approx(0.5, abs=4.0 * 0.5 / np.sqrt(60 * leaked.sum()))
    heard = perturb(m, root_seed=1, realization=0, detection=np.where(leaked, 1.0, chance))
    off = heard.refracted_range[leaked] - m.refracted_range[leaked]
    assert np.abs(off).max() < 5.0


def test_leaked_ranges_are_no_dropouts(truth, plain, leaky):
    tables = [
        dropout_table(assemble(truth, [HIDDEN], one, NoiseModel()), truth).iloc[-1]
        for one in (plain, leaky)
    ]
    assert tables[0]["dropouts"] > 0
    assert tables[1]["dropouts"] == 0
    assert tables[1]["leaked"] == tables[0]["dropouts"]
    assert "leaked" not in tables[0]


def test_a_floor_of_scattered_sound_has_its_own_status(truth, leaky):
    floor = ranged(truth, Leakage(reach=400.0, scatter_db=0.0))
    leaked = leaky.status == RayStatus.LEAKED
    assert (floor.status[leaked] == RayStatus.SCATTERED).all()
    assert (floor.probability[leaked] >= leaky.probability[leaked]).all()
    assert set(floor.status.tolist()) <= set(ARRIVES)


def test_two_ways_both_leak(truth, leaky):
    both = ranged(truth, Leakage(reach=400.0), timing=TwoWay(0.5))
    leaked = leaky.status == RayStatus.LEAKED
    np.testing.assert_array_equal(both.status, leaky.status)
    np.testing.assert_allclose(
        both.truth.travel_time[leaked], leaky.truth.travel_time[leaked], atol=1e-3
    )
    np.testing.assert_allclose(both.probability[leaked], leaky.probability[leaked] ** 2)


def test_no_sound_leaks_beyond_reach_or_without_a_frequency(truth, plain):
    near = ranged(truth, Leakage(reach=1.0))
    np.testing.assert_array_equal(near.status, plain.status)
    np.testing.assert_array_equal(near.truth.travel_time, plain.truth.travel_time)
    refused(
        SensingError, "leakage needs a detector", ranged, truth, Leakage(), None, timing=OneWay()
    )


def test_what_leaks_takes_as_long_from_either_end():
    source = np.array([[-2e3, 0.0, 260.0], [-1e3, 300.0, 240.0]])
    receiver = np.array([HIDDEN.position] * 2)
    reception = ReceptionOptions(detector=LOUD, leakage=Leakage(250.0))
    for currents in (None, Currents.uniform(0.5, 0.2)):
        one = find_receptions(source, receiver, WATER, reception, currents=currents)
        other = find_receptions(receiver, source, WATER, reception, currents=currents)
        assert (one.status == RayStatus.LEAKED).all()
        for name in ("travel_time", "loss_db", "probability"):
            np.testing.assert_array_equal(one.selected(name), other.selected(name)[::-1])
        for name, mirrored in (
            ("source_slowness", "receiver_slowness"),
            ("receiver_slowness", "source_slowness"),
        ):
            np.testing.assert_array_equal(one.selected(name), -other.selected(mirrored)[::-1])


@pytest.mark.parametrize("timing", [OneWay(), TwoWay(0.5)])
@pytest.mark.parametrize("currents", [None, Currents.uniform(0.3, -0.4)])
def test_what_leaks_stands_for_the_direct_arrival_where_receivers_err(truth, timing, currents):
    options = {"timing": timing, "currents": currents, "max_surface_bounces": 1}
    ranging = ranged(truth, Leakage(reach=400.0), **options)
    m = assemble(truth, [HIDDEN], ranging, NoiseModel(range_sigma=1.0))
    candidates = find_candidates(
        ranging, truth, Picker("first-detected", LOUD.sonar), timing=timing
    )
    leaked = np.flatnonzero(m.range_status == RayStatus.LEAKED)
    direct = np.flatnonzero(candidates.direct == 1)
    rows = direct[np.isin(candidates.attempt[direct], leaked)]
    np.testing.assert_array_equal(candidates.attempt[rows], leaked)
    np.testing.assert_array_equal(candidates.travel_time[rows], ranging.truth.travel_time[leaked])
    assert (
        np.bincount(candidates.attempt)[leaked].min() > 1
    )  # sound by the surface competes with it
    # what is heard of all candidates is heard of each alone, and one that is sure leaves nothing to
    # the others
    noisy = [
        perturb(m, root_seed=2, realization=r, timing=timing, detection=candidates)
        for r in range(10)
    ]
    for one in noisy:
        assert set(one.range_status.tolist()) <= {RayStatus.OK, RayStatus.UNHEARD}
    took = np.concatenate(
        [one.refracted_range[leaked] - m.refracted_range[leaked] for one in noisy]
    )
    by_leak = np.abs(took) < 6.0
    expected = np.tile(candidates.probability[rows], 10)
    assert by_leak.sum() == pytest.approx(
        expected.sum(), abs=4.0 * np.sqrt((expected * (1 - expected)).sum()) + 1.0
    )
    without = ranged(truth, **options)
    fewer = find_candidates(without, truth, Picker("first-detected", LOUD.sonar), timing=timing)
    assert candidates.attempt.size - fewer.attempt.size >= leaked.size
