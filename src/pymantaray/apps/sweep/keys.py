"""Keys of tasks: hashes of everything that their results depend on."""

from collections.abc import Callable, Mapping

from pymantaray.config.door.fleet import MissionFleet
from pymantaray.config.door.ocean import MissionOcean
from pymantaray.config.door.study import MissionRanging, Study
from pymantaray.entry_points import extension_keys
from pymantaray.jobs.keys import digest, values_of

OCEAN = "ocean"
FLEET = "fleet"
RAYS = "rays"
POINT = "point"
STAGES = (OCEAN, FLEET, RAYS)
"""Stages in order; points with equal keys of a stage share it."""
_TITLES = ("name", "description")  # of a study; no result depends on them


_PART: dict[str, Callable[[Study], MissionOcean | MissionFleet | MissionRanging]] = {
    OCEAN: lambda study: study.ocean,
    FLEET: lambda study: study.fleet,
    RAYS: lambda study: study.ranging,
}
"""Part of a study that a stage reads in addition to the results of the stages before it."""


def task_keys(study: Study, checksums: Mapping[str, str]) -> dict[str, str]:
    """
    Keys of a study's stages, from the parts that they read, and of its point, from all keys of its
    configuration and the entry points in use; each with the checksums of its input files.
    """
    out = dict[str, str]()
    before = ""
    for stage in STAGES:
        part = _PART[stage](study)
        before = digest(
            stage, [before, values_of(part)], {file: checksums[file] for file in part.files}
        )
        out[stage] = before
    own = {key: value for key, value in study.tree["study"].items() if key not in _TITLES}
    point = [{**study.tree, "study": own}, extension_keys(study.sensors)]
    out[POINT] = digest(POINT, point, {file: checksums[file] for file in study.files})
    return out
