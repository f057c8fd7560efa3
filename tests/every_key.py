"""Every key of a configuration with another legal value, by the schema of the sections."""

import json
from collections.abc import Mapping

import numpy as np
from factories import TINY

from pymantaray.config import parse_study
from pymantaray.config.door.study import build_study
from pymantaray.config.keys import with_key
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import MantaRayError

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


def changed_keys():
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
