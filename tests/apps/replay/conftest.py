"""A short campaign of known truth, made by the shipped example."""

import json
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

from pymantaray import open_waters
from pymantaray.apps.replay import read_events

EXAMPLE = Path(__file__).parents[3] / "examples" / "replay_campaign.py"


def campaign_of(folder, duration):
    """Folder of a campaign of so many seconds, its events, its waters and its truth."""
    example = runpy.run_path(str(EXAMPLE))
    example["main"].__globals__["DURATION"] = duration
    example["main"](str(folder))
    waters = open_waters(folder / "casts.csv", bathymetry=3000.0, max_surface_bounces=2)
    truth = json.loads((folder / "truth.json").read_text())
    return SimpleNamespace(
        folder=folder, events=read_events(folder / "events.csv"), waters=waters, truth=truth
    )


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """Nine minutes: 360 events."""
    return campaign_of(tmp_path_factory.mktemp("campaign"), 540.0)


@pytest.fixture(scope="session")
def short_campaign(tmp_path_factory):
    """Two minutes: 80 events."""
    return campaign_of(tmp_path_factory.mktemp("short"), 120.0)


@pytest.fixture(scope="session")
def make_campaign():
    return campaign_of
