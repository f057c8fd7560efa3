"""The door: outside `config`, functions take objects of the library, not sections."""

import ast
import dataclasses
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from sources import nodes_of

import pymantaray
from pymantaray import load_study
from pymantaray.acoustics import Absorption
from pymantaray.config.common import Section
from pymantaray.config.door import beliefs, range_models
from pymantaray.config.door.study import build_study
from pymantaray.config.estimators import AnyBelief, AnyRangeModel
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.sensing import PingSchedule, TwoWay

PACKAGE = Path(pymantaray.__file__).parent
OPEN_THE_DOOR = {
    "apps/authors/export.py: export_authors",
    "apps/study/command.py: run_and_report",
    "apps/study/references.py: citation",
    "apps/study/runner.py: run_study",
    "apps/sweep/definition.py: __init__",
}
"""Functions outside `config` that take a configuration."""


def sections():
    """Names of all sections of configurations, and of unions of them."""
    found, waiting = set(), [Section]
    while waiting:
        section = waiting.pop()
        found.add(section.__name__)
        waiting += [
            s for s in section.__subclasses__() if s.__module__.startswith("pymantaray.config")
        ]
    for file in (PACKAGE / "config").glob("*.py"):
        found |= set(re.findall(r"^(Any\w+) = Annotated", file.read_text(), re.MULTILINE))
    return found


def test_few_functions_outside_config_take_a_section():
    names = sections()
    assert {"OceanSection", "StudyConfig", "AnyBelief", "FloatVehicle"} <= names
    found = set()
    for file in PACKAGE.rglob("*.py"):
        if file.is_relative_to(PACKAGE / "config"):
            continue
        for node in nodes_of(file):
            if isinstance(node, ast.FunctionDef):
                a = node.args
                for arg in (*a.posonlyargs, *a.args, *a.kwonlyargs):
                    words = re.findall(r"\w+", ast.unparse(arg.annotation or ast.Constant("")))
                    if names & set(words) - {"Section"}:
                        found.add(f"{file.relative_to(PACKAGE)}: {node.name}")
    assert found == OPEN_THE_DOOR


def kinds_of(union):
    """Kinds of the sections of a union."""
    sections = get_args(get_args(union)[0])
    return {section.model_fields["kind"].annotation.__args__[0] for section in sections}


def test_each_kind_of_range_model_and_belief_has_a_builder():
    assert range_models.BUILDERS.keys() == kinds_of(AnyRangeModel)
    # an internal tide always varies, so it has no snapshot
    assert beliefs.BUILDERS.keys() == kinds_of(AnyBelief) - {"internal-tide"}


def test_a_study_has_the_values_of_its_configuration():
    config = load_study(
        "quick",
        **{
            "mission.ping_start_h": 2.0,
            "mission.gnss_depth": 0.5,
            "ranging.timing": "two-way",
            "ranging.turn_around_s": 0.25,
            "acoustics.cone_deg": 30.0,
            "acoustics.spreading_cutoff_db": "none",
            "study.seed": 7,
            "estimator.covariance_interval_h": 2.0,
        },
    )
    study = build_study(config)
    assert (study.name, study.seed, study.realizations) == (
        config.study.name, 7, config.study.realizations
    )  # fmt: skip
    assert study.duration == 3600.0 * config.mission.duration_h
    assert study.covariance_interval == 7200.0
    assert study.gnss_depth == 0.5
    interval = 3600.0 * config.mission.ping_interval_h
    assert study.schedule == PingSchedule(interval=interval, start=7200.0)
    assert study.sound.timing == TwoWay(turn_around=0.25)
    assert study.sound.options.cone == pytest.approx(np.pi / 6.0)
    assert study.sound.options.spreading_cutoff_db is None
    assert [v.name for v in study.fleet.vehicles] == [v.name for v in config.fleet.vehicles]
    assert [c.name for c in study.conditions] == [c.name for c in config.conditions]
    assert not study.detects
    assert study.ice_draws == 1
    own = {"ocean.ice": 2.0, "ocean.ice_slope_deg": 5.0, "ocean.ice_draw": "each"}
    assert build_study(load_study("quick", **own, **{"study.realizations": 3})).ice_draws == 3


def test_reception_has_the_absorption_of_the_water():
    modem = {"source_level_db": 190.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}
    study = build_study(load_study("quick", detection={**modem, "absorption": "thorp"}))
    without = study.sound.options.detector
    assert without.absorption is None
    detector = study.sound.reception(study.ocean.open()).detector
    for field in dataclasses.fields(without):
        if field.name != "absorption":
            assert getattr(detector, field.name) == getattr(without, field.name)
    frequency = 1e4
    at = np.array([[0.0, 0.0, 100.0]])
    np.testing.assert_array_equal(
        detector.absorption.db_per_km(at, frequency), Absorption.thorp().db_per_km(at, frequency)
    )


def test_existing_trajectories_are_read_when_they_are_needed(tmp_path):
    tree = load_study("quick").model_dump(exclude_none=True, exclude={"fleet"})
    file = tmp_path / "missing.csv"
    study = build_study(
        StudyConfig.model_validate({**tree, "fleet": {"trajectories": [str(file)]}})
    )
    assert study.fleet.vehicles == ()
    assert study.fleet.existing.files == (str(file),)
    with pytest.raises(StudyError, match=r"missing\.csv: cannot be read"):
        _ = study.fleet.names


def test_trajectories_of_a_study_have_the_axes_and_names_asked(tmp_path):
    tree = load_study("quick").model_dump(exclude_none=True, exclude={"fleet"})
    files = [str(tmp_path / f"{name}.tum") for name in ("glider", "other")]
    for file in files:  # time, east, north, up, and a body that faces east
        Path(file).write_text("0 1 2 -30 0 0 0 1\n60 1 2 -30 0 0 0 1\n")
    fleet = {"trajectories": files, "enu": True, "names": ["glider"]}
    study = build_study(StudyConfig.model_validate({**tree, "fleet": fleet}))
    assert study.fleet.names == ["glider"]
    (poses,) = study.fleet.existing.tracks.poses
    np.testing.assert_allclose(poses.place[0], [2.0, 1.0, 30.0])
    # a quarter turn from north to east, about the axis that points down
    np.testing.assert_allclose(poses.quaternion[0], np.sqrt([0.5, 0.0, 0.0, 0.5]), atol=1e-15)
