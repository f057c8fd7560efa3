"""A made-up run, plan and survey for figures and pages."""

import pytest
from campaigns import make_campaign, survey_of, water as profile
from factories import TINY
from made_up_run import look, made_replay, made_run, records, run, run_folder, tables, water

from pymantaray.apps.locate import LocateOptions, locate
from pymantaray.apps.plan import DeploymentPlan, PlanSection, search_designs
from pymantaray.config import parse_study

__all__ = ["look", "made_replay", "made_run", "records", "run", "run_folder", "tables", "water"]


@pytest.fixture(scope="session")
def made_plan():
    """Six designs in two waters, with depths of a receiver and times between pings."""
    receiver = {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0, "sigma": 2.0}
    section = PlanSection(
        free={"landmarks.T.depth": [5.0, 150.0, 300.0], "mission.ping_interval_h": [1.0, 2.0]},
        objectives=("error", "cost"),
        costs={"ping": 1.0},
        oceans=({}, {"centre_lat": 74.0}),
        lost_of="T",
    )
    plan = DeploymentPlan(parse_study({**TINY, "landmarks": [receiver]}, "tiny"), section)
    return search_designs(plan, workers=1)


@pytest.fixture(scope="session")
def made_location():
    """A node of a made-up survey, whose sound speed varies over time."""
    survey = survey_of(make_campaign(1, pings=40), sigma=1e-4)
    options = LocateOptions(earth="flat", speed_model="time", correlation="none")
    return locate(survey, profile(), options)
