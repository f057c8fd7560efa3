"""Designs solve only the links that change, with the same results as alone."""

from dataclasses import fields

import numpy as np
import pytest
from factories import TINY

from pymantaray.apps.plan import DeploymentPlan
from pymantaray.apps.plan.definition import PlanSection
from pymantaray.apps.plan.evaluate import DesignEvaluator
from pymantaray.apps.plan.waters import Missions
from pymantaray.config import parse_study

MARKS = [
    {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0},
    {"name": "U", "north": -300.0, "east": 50.0, "depth": 20.0},
]
MORE = {
    "plain": {},
    "bounces and losses": {
        "acoustics": {"max_surface_bounces": 1, "max_bottom_bounces": 1, "arrival": "first"},
        "detection": {"frequency_hz": 12e3, "source_level_db": 180.0, "bandwidth_hz": 1e3},
    },
}


def plan_of(free, more="plain"):
    base = parse_study({**TINY, "landmarks": MARKS, **MORE[more]}, "tiny")
    return DeploymentPlan(base, PlanSection(free=free))


def assert_same(record, other, label):
    for f in fields(record):
        np.testing.assert_array_equal(
            getattr(record, f.name), getattr(other, f.name), err_msg=f"{label}: {f.name}"
        )


def distinct_ends(run):
    """
    Positions of both ends of each link; links between fixed participants repeat at every ping.
    """
    number = run.truth.name.size

    def place(who, sample):
        if who < number:
            return run.truth.position[who, sample].tolist()
        return run.measurements.landmark_position[who - number].tolist()

    links = zip(run.links.sample, run.links.first, run.links.second, strict=True)
    return {(*place(a, sample), *place(b, sample)) for sample, a, b in links}


@pytest.mark.parametrize("more", MORE)
def test_a_moved_landmark_solves_only_its_links(more, as_stored):
    plan = plan_of({"landmarks.T.depth": [5.0, 200.0]}, more)
    missions = Missions(plan)
    first, _ = missions.run({}, 0, None)
    whole = missions.links.solved
    assert whole == len(distinct_ends(first))
    moved = {"landmarks.T.depth": 200.0}
    second, _ = missions.run(moved, 0, None)
    own = distinct_ends(second) - distinct_ends(first)
    place = (MARKS[0]["north"], MARKS[0]["east"], 200.0)
    assert all(place in (ends[:3], ends[3:]) for ends in own)
    assert 0 < len(own) < whole
    assert missions.links.solved - whole == len(own)
    missions.run({}, 0, None)
    assert missions.links.solved - whole == len(own)
    alone, _ = Missions(plan).run(moved, 0, None)
    for name in ("truth", "links", "arrivals", "measurements", "ranging_truth"):
        assert_same(getattr(second, name), getattr(alone, name), name)
    if second.hearing is not None:
        assert_same(second.hearing, alone.hearing, "hearing")
    if more == "plain":
        as_stored([second.links, second.arrivals, second.measurements, second.hearing])


def test_scores_do_not_depend_on_the_designs_before(as_stored):
    plan = plan_of({"landmarks.T.depth": [5.0, 300.0]})
    evaluator = DesignEvaluator(plan)
    for depth in (5.0, 100.0):
        evaluator({"landmarks.T.depth": depth})
    design = {"landmarks.T.depth": 300.0}
    assert evaluator(design) == DesignEvaluator(plan)(design)
    assert evaluator.missions.links.solved > 0
    as_stored(evaluator(design))


def test_another_water_or_another_option_shares_no_link():
    plan = plan_of(
        {"acoustics.spreading_cutoff_db": [15.0, 10.0], "ocean.half_extent_north": [3000.0, 5000.0]}
    )
    missions = Missions(plan)
    missions.run({}, 0, None)
    count = missions.links.solved
    for k, design in enumerate(
        ({"acoustics.spreading_cutoff_db": 10.0}, {"ocean.half_extent_north": 5000.0})
    ):
        missions.run(design, 0, None)
        assert missions.links.solved == (k + 2) * count
