"""
One law for every key of a configuration: another legal value changes the keys of exactly the stages
that read it.
"""

import hashlib

from every_key import changed_keys
from pydantic import BaseModel

from pymantaray.apps.sweep.keys import FLEET, OCEAN, POINT, RAYS, STAGES, task_keys
from pymantaray.config.common import Section
from pymantaray.config.door.fleet import build_fleet, build_pings
from pymantaray.config.door.ocean import build_mission_ocean
from pymantaray.config.door.sound import build_sound
from pymantaray.config.door.study import build_landmarks, build_study


class Names(dict):
    """Checksums of files by their names, which need not exist."""

    def __missing__(self, name):
        return hashlib.sha256(name.encode()).hexdigest()


def keys(study):
    return task_keys(study, Names())


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
                    build_landmarks(config),
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


def test_every_key_changes_the_keys_of_exactly_its_stages(monkeypatch):
    reads = Reads(monkeypatch)
    wrong = []
    for name, one, other in changed_keys():
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
