"""
Every key of a configuration: another legal value changes objects of the study, to stored numbers.
"""

from dataclasses import fields
from types import SimpleNamespace

import pytest
from every_key import changed_keys

from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.config.door.study import build_study
from pymantaray.jobs.keys import values_of


@pytest.fixture(scope="module")
def changes():
    """Every key with the objects of a study and those with another value of the key."""
    return [(name, objects(one), objects(other)) for name, one, other in changed_keys()]


def objects(config):
    """Values of all objects of a study, and of what an estimator has from common sections."""
    study = build_study(config)
    run = SimpleNamespace(
        config=config, truth=SimpleNamespace(position=[0.0], quaternion=[1.0]), ocean=None
    )
    section = next((c for c in config.conditions if c.name == "one"), None)
    own = {
        field.name: values_of(getattr(study, field.name))
        for field in fields(study)
        if field.name != "config"
    }
    if section is not None and section.range_model.kind == "transmitter" and not unknowns(config):
        one = EstimatorFactory(run).estimator("one", 0)
        own |= {"method": repr(one.method), "initial": one.initial}
    return own


def unknowns(config):
    return config.acoustics.earth != "flat" or any(c.estimates_more for c in config.conditions)


def differences(one, other):
    """What differs between two trees, by the keys that lead to it."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        pairs = {key: differences(one[key], other[key]) for key in one}
        return {key: found for key, found in pairs.items() if found is not None}
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return differences(*({str(k): v for k, v in enumerate(tree)} for tree in (one, other)))
    return None if one == other else other


def test_every_key_changes_an_object_of_the_study(changes):
    assert [name for name, one, other in changes if one == other] == []


def test_every_key_changes_what_it_is_stored_to_change(changes, as_stored):
    as_stored(
        {f"{k} {name}": differences(one, other) for k, (name, one, other) in enumerate(changes)}
    )
