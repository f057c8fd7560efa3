"""Progress of ranging: it rises, and ends where it should, whatever is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.acoustics import Currents, Medium, Sonar
from pymantaray.records import VehicleStatus
from pymantaray.sensing import Detector, PingSchedule, measure_ranges

SCHEDULE = PingSchedule(800.0)
PAIRS = 3 * 10  # five vehicles, three pings
SONAR = Sonar(source_level_db=150.0, frequency_hz=25e3, bandwidth_hz=4e3, noise=45.0)


@pytest.fixture(scope="module")
def water():
    depth = np.array([0.0, 1500.0, 4000.0])
    return Medium.from_profile(depth, 1450.0 + 0.016 * depth, bottom_depth=3000.0, interpolation="linear")


def steps(truth, water, **options):
    seen = []
    measure_ranges(truth, [], water, SCHEDULE, progress=lambda *step: seen.append(step), **options)
    return seen


@pytest.mark.parametrize("stopped", [0, 2, 5])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"currents": Currents.uniform(0.2, 0.1)},
        {"detector": Detector(SONAR), "max_surface_bounces": 1},
        {"max_surface_bounces": 1, "arrival": "first"},
    ],
)
def test_progress_rises_to_the_number_of_pairs(make_truth, water, monkeypatch, options, stopped):
    monkeypatch.setattr("pymantaray.sensing.ranging._BLOCK", 4)
    truth = make_truth("ABCDE")
    status = truth.status.copy()
    status[:stopped] = VehicleStatus.GROUNDED
    seen = steps(replace(truth, status=status), water, threads=1, **options)
    done, total = zip(*seen, strict=True)
    assert set(total) == {PAIRS}
    assert list(done) == sorted(done)
    assert done[-1] == PAIRS
    assert len(set(done)) > 1


def test_following_rays_is_half_of_the_work(make_truth, water, monkeypatch):
    monkeypatch.setattr("pymantaray.sensing.ranging._BLOCK", 10)
    done = [done for done, _ in steps(make_truth("ABCDE"), water, currents=Currents.uniform(0.2, 0.1))]
    assert {15, 20, 25, 30} <= set(done)


def test_one_vehicle_alone_has_nothing_to_count(make_truth, water):
    assert all(step == (0, 0) for step in steps(make_truth("A"), water))
