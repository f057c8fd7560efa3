"""
One law for every key of a configuration: another legal value changes the objects of the study and
the keys of exactly the stages that read it.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from factories import TINY
from pydantic import BaseModel

from pymantaray.apps.sweep.keys import FLEET, OCEAN, POINT, RAYS, STAGES, task_keys
from pymantaray.config import parse_study
from pymantaray.config.build.estimators import EstimatorFactory
from pymantaray.config.build.fleet import build_fleet, build_pings
from pymantaray.config.build.ocean import build_mission_ocean
from pymantaray.config.build.sound import build_sound
from pymantaray.config.build.study import build_study
from pymantaray.config.common import Section
from pymantaray.config.keys import with_key
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import MantaRayError
from pymantaray.jobs.keys import values_of

SCHEMA = StudyConfig.model_json_schema()
MODEM = {"source_level_db": 190.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}
PERTURBED = {"kind": "perturbed", "rms": 1.0, "horizontal_scale": 5e4}
RAYS_OF = {"kind": "eigenray", "belief": {"kind": "exact"}}
ATTITUDE = {"noise.attitude_tilt_sigma": 0.01, "noise.attitude_heading_sigma": 0.02}
VARYING = {"ocean.time_varying": True, "ocean.time": "2014-07-15T12:00:00"}
BASE = {
    **TINY,
    "conditions": [{"name": "one"}],
    "mission": {**TINY["mission"], "sampling_period_s": 100.0},
}
PARTNERS = {
    # reflections, levels and ice have effects together
    "OceanSection.ice_slope_deg": {"ocean.ice": 2.0},
    "OceanSection.ice_draw": {"ocean.ice": 2.0, "ocean.ice_slope_deg": 5.0},
    "AcousticsSection.surface_loss": {"detection": MODEM, "acoustics.max_surface_bounces": 1},
    "AcousticsSection.sediment": {"detection": MODEM, "acoustics.max_bottom_bounces": 1},
    "AcousticsSection.ice_loss_db": {
        "detection": MODEM,
        "acoustics.max_surface_bounces": 1,
        "ocean.ice": 2.0,
    },
    "DetectionSection.leakage_reach_m": {"detection.leakage": True},
    "DetectionSection.scatter_db": {"detection.leakage": True},
    # one of a pair of numbers is not allowed
    "OceanSection.centre_lat": {"ocean.centre_lon": -140.0},
    "RayVariance.rms": {"conditions.one.variance.horizontal_scale": 1e4},
    # sensors with several levels
    "NoiseSection.attitude_tilt_sigma": ATTITUDE,
    "NoiseSection.attitude_heading_sigma": ATTITUDE,
    "NoiseSection.attitude_heading_bias_sigma": ATTITUDE,
    "NoiseSection.dvl_bias_sigma": {"noise.dvl_sigma": 0.01},
    "NoiseSection.dvl_beam_loss": {"noise.dvl_sigma": 0.01},
    "NoiseSection.altimeter_bias_sigma": {"noise.altimeter_sigma": 0.1},
    # rules that need a choice
    "RangingSection.turn_around_s": {"ranging.timing": "two-way"},
    "RangingSection.mistaken": {"detection": MODEM},
    "RangingSection.below_strongest_db": {
        "ranging.mistaken": "first-detected",
        "ranging.below_strongest_db": 12.0,
    },
    "RangingSection.mistaken_correlation_s": {
        "detection": MODEM,
        "ranging.mistaken": "first-detected",
    },
    "ConditionSection.links": {"conditions.one.ranges": "straight"},
    "ModesSection.down_to": {"conditions.one.range_model.modes.rms": 1.0},
    "RayVariance.kind": {"conditions.one.range_model": {"kind": "eigenray", "belief": PERTURBED}},
    "ConstantRangeModel.belief": {
        "conditions.one.range_model": {"kind": "constant", "belief": {"kind": "mean"}}
    },
    "ExactBelief.time_varying": VARYING | {"conditions.one.range_model": RAYS_OF},
    "OtherDayBelief.time_varying": VARYING
    | {
        "conditions.one.range_model": {
            "kind": "eigenray",
            "belief": {"kind": "other-day", "days_earlier": 1.0},
        }
    },
    "ConditionSection.clocks": {"noise.clock_offset_sigma": 0.1},
    "ConditionSection.variance": {
        "conditions.one.range_model": {"kind": "eigenray", "belief": PERTURBED}
    },
}
"""Other keys with which a key can have another value, or with which it has an effect."""
OTHER = {
    "OceanSection.names": ["temp=sea_water_temperature"],
    "OceanSection.source": ["synthetic:fram"],
    "OceanSection.time": "2014-07-16T12:00:00",
    "MissionSection.sampling_period_s": 50.0,
    "MissionSection.physics_step_s": 0.5,
    "StudySection.name": "other",
    "FileBelief.source": ["other.nc"],
}
"""Values that no rule of the generator finds, because keys have formats or ratios."""
COMPLETE = {
    "ConstantRangeModel": {"sound_speed": 1450.0},
    "CastBelief": {"north": 0.0, "east": 0.0},
    "RayVariance": {"rms": 1.0, "horizontal_scale": 1e4},
}
"""Keys of which a section needs one or two, so none is required."""
SKIPPED = {
    "MissionSection.sensors": "sensors of installed packages only, see test_other_packages.py",
    "FleetSection.trajectories": "files are read, see the test of files below",
    "FleetSection.enu": "only for files",
    "FleetSection.names": "only for files",
    "StationVehicle.kind": "fixed",
}


def resolved(schema):
    """Schema behind a reference."""
    while "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def branches(schema):
    """Alternatives of a schema."""
    schema = resolved(schema)
    for name in ("anyOf", "oneOf"):
        if name in schema:
            return [inner for one in schema[name] for inner in branches(one)]
    return [schema]


def minimal(schema):
    """Tree of a section with its required keys only."""
    tree = {
        key: next(others(schema["properties"][key], None)) for key in schema.get("required", ())
    }
    return tree | COMPLETE.get(schema["title"], {})


def others(schema, value):
    """Values that a key may have instead of one, by its schema."""
    for branch in branches(schema):
        kind = branch.get("type")
        found = []
        if "const" in branch:
            found = [branch["const"]]
        elif "enum" in branch:
            found = branch["enum"]
        elif kind == "boolean":
            found = [True, False]
        elif kind in ("number", "integer"):
            found = numbers(branch, value)
        elif kind == "string":
            found = (
                ["2014-07-15T18:00:00"]
                if branch.get("format")
                else ["other", "another", "other=other"]
            )
        elif kind == "array":
            found = arrays(branch, value)
        elif kind == "object" and "properties" in branch:
            found = [minimal(branch)]
        for one in found:
            if one != value and not (kind == "object" and value and fits(branch, value)):
                yield one


ENDS = (("Min", -1), ("Max", 1))


def numbers(schema, value):
    """Numbers within the limits of a schema."""
    known = isinstance(value, int | float) and not isinstance(value, bool)
    whole = schema["type"] == "integer"
    near = [2 * value, value + 1, value - 1] if known else []
    near += [] if whole or not known else [0.5 * value, value + 0.25]
    for number in [*near, 1, 2, *([] if whole else [0.5, 0.25])]:
        low, high = (schema.get(f"exclusive{end}imum", sign * np.inf) for end, sign in ENDS)
        least, most = (schema.get(f"{end.lower()}imum", sign * np.inf) for end, sign in ENDS)
        if least <= number <= most and low < number < high:
            yield number if whole else float(number)


def arrays(schema, value):
    """Lists with another first element, one element more, or one less."""
    items = schema.get("prefixItems")
    if items is None:
        first = next(iter(value), None) if value else None
        for one in others(schema["items"], first):
            yield [one, *(value or [])[1:]]
            yield [*(value or []), one]
        if value:
            yield value[:-1]
        return
    value = value or [next(others(item, None)) for item in items]
    yield value
    yield [next(others(items[0], value[0])), *value[1:]]


def plain(config):
    """JSON tree of a configuration without the keys that have no value."""
    return config.model_dump(mode="json", exclude_none=True)


class Walk:
    """Each key of a configuration once, with a tree that has it and one with another value."""

    def __init__(self):
        self.seen = set()
        self.stuck = []

    def section(self, schema, tree, path):
        """Changes of the keys of a section at a path of a tree."""
        schema = resolved(schema)
        for key, inner in schema["properties"].items():
            name = f"{schema['title']}.{key}"
            if name in self.seen or name in SKIPPED or "const" in inner:
                continue
            self.seen.add(name)
            base = tree
            for partner, value in PARTNERS.get(name, {}).items():
                base = with_key(base, partner, value)
            yield from self.key(name, inner, base, [*path, key])

    def key(self, name, schema, tree, path):
        """One change of a key, and those of the keys below it."""
        tree = plain(parse_study(tree))
        value = at(tree, path)
        candidates = [OTHER[name]] if name in OTHER else others(schema, value)
        found = False
        for other in candidates:
            changed = legal(with_key(tree, ".".join(map(str, path)), other))
            if changed is None or same(changed, tree):
                continue
            if not found:
                yield name, tree, changed
            found = True
            yield from self.below(schema, changed, path)
        if not found and not is_container(schema):
            self.stuck.append(name)
        yield from self.below(schema, tree, path)

    def below(self, schema, tree, path):
        """Changes of the keys below a key that is a section or a list of sections."""
        value = at(tree, path)
        for branch in branches(schema):
            if branch.get("type") == "array" and isinstance(value, list):
                inner = branch.get("items", {})
                for place, one in enumerate(value):
                    if isinstance(one, Mapping):
                        for member in branches(inner):
                            if fits(member, one):
                                yield from self.section(member, tree, [*path, place])
            elif isinstance(value, Mapping) and "properties" in branch and fits(branch, value):
                yield from self.section(branch, tree, path)


def is_container(schema):
    """True if a key has no value of its own: a section, without another kind of it."""
    return all("properties" in branch for branch in branches(schema))


def fits(schema, value):
    """True if a value is the member of a union with this schema."""
    kind = schema["properties"].get("kind", {})
    return "kind" not in value or value["kind"] in kind.get("enum", [kind.get("const")])


def at(tree, path):
    """Value at a path of a tree; None without one."""
    for part in path:
        tree = tree.get(part) if isinstance(tree, Mapping) else tree[part]
        if tree is None:
            return None
    return tree


def legal(tree):
    """JSON tree of the configuration of a tree; None if it is not one."""
    try:
        config = parse_study(tree)
        build_study(config)
        return plain(config)
    except MantaRayError:
        return None


def same(one, other):
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


class Names(dict):
    """Checksums of files by their names, which need not exist."""

    def __missing__(self, name):
        return hashlib.sha256(name.encode()).hexdigest()


def keys(study):
    return task_keys(study, Names())


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


class Reads:
    """Keys of sections that are read while the part of a study for each stage is built."""

    def __init__(self, monkeypatch):
        self.now = set()
        names = {name: set(cls.model_fields) for name, cls in all_sections().items()}

        def read(section, name):
            if name in names.get(type(section).__name__, ()):
                self.now.add(f"{type(section).__name__}.{name}")
            return object.__getattribute__(section, name)

        monkeypatch.setattr(Section, "__getattribute__", read, raising=False)

    def of(self, config):
        """Keys by stage; a part that holds a section may read all of it."""
        out = {}
        self.now = set()
        for stage, build in (
            (OCEAN, lambda: build_mission_ocean(config)),
            (FLEET, lambda: build_fleet(config)),
            (
                RAYS,
                lambda: (
                    [mark.build() for mark in config.landmarks],
                    build_pings(config),
                    build_sound(config),
                ),
            ),
        ):
            part = build()
            self.hold(part)
            out[stage] = set(self.now)
        return out

    def hold(self, part):
        for one in vars(part).values() if hasattr(part, "__dataclass_fields__") else part:
            if isinstance(one, BaseModel):
                self.now |= held(one)
            elif hasattr(one, "__dataclass_fields__"):
                self.hold(one)


def held(section):
    """All keys of a section and of the sections in it."""
    out = set()
    for name, value in dict(section).items():
        out.add(f"{type(section).__name__}.{name}")
        if isinstance(value, BaseModel):
            out |= held(value)
    return out


def all_sections():
    found, waiting = {}, [Section]
    while waiting:
        section = waiting.pop()
        found[section.__name__] = section
        waiting += section.__subclasses__()
    return found


@pytest.fixture(scope="module")
def changes():
    """Every key with a configuration and the same with another value of the key."""
    walk = Walk()
    found = list(walk.section(SCHEMA, plain(parse_study(BASE)), []))
    every = {
        f"{name}.{key}"
        for name, schema in SCHEMA["$defs"].items()
        for key, inner in schema["properties"].items()
        if "const" not in inner
    }
    assert not walk.stuck, "no other legal value was found"
    assert every - walk.seen - set(SKIPPED) == set()
    return [(name, parse_study(one), parse_study(two)) for name, one, two in found]


def test_every_key_changes_an_object_of_the_study(changes):
    assert [name for name, one, other in changes if objects(one) == objects(other)] == []


def test_every_key_changes_the_keys_of_exactly_its_stages(changes, monkeypatch):
    reads = Reads(monkeypatch)
    wrong = []
    for name, one, other in changes:
        before, after = (keys(build_study(config)) for config in (one, other))
        read, read_too = reads.of(one), reads.of(other)
        for stage in STAGES:
            expected = name in read[stage] | read_too[stage]
            if (before[stage] != after[stage]) != expected:
                wrong.append((name, stage, "not read" if not expected else "same key"))
        if (before[POINT] == after[POINT]) != (name in TITLES):
            wrong.append((name, POINT))
    assert wrong == []


TITLES = {"StudySection.name", "StudySection.description"}
