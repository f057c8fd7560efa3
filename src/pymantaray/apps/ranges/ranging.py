"""Ranges between vehicles with existing trajectories: a study without estimators."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from pymantaray.acoustics import Medium
from pymantaray.apps.study.manifest import Stopwatch, centre_note
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.apps.study.store import Run, run_in_memory
from pymantaray.config.common import IN_MEMORY
from pymantaray.config.door.fleet import with_tracks
from pymantaray.config.door.study import build_study
from pymantaray.config.door.water import Source as WaterSource, source_words
from pymantaray.config.keys import with_key
from pymantaray.config.load import dotted_keys, load_sound, names_configuration, parse_study
from pymantaray.config.mission import keys_of_schedule
from pymantaray.config.sections import SoundConfig, StudyConfig
from pymantaray.errors import StudyError
from pymantaray.exchange import Tracks, read_trajectories
from pymantaray.exchange.read import Source
from pymantaray.jobs.progress import Progress
from pymantaray.records import Trajectories
from pymantaray.sensing import PingSchedule, Schedule


def measure(
    trajectories: Source | Tracks | Trajectories,
    ocean: WaterSource | Mapping[str, Any],
    schedule: float | Schedule,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Run:
    """
    Return ranges through an ocean between vehicles with known trajectories.

    Parameters
    ----------
    trajectories : str, pathlib.Path, sequence of them, pandas.DataFrame, Tracks or Trajectories
        Files or a data frame as for `read_trajectories`, its result, or poses in the local frame at
        common times.
    ocean : str, pathlib.Path, sequence of them, xarray.Dataset, SoundConfig or dict
        Any source of `pymantaray.open_water`, or the section ``[ocean]`` of a study. The centre of
        the frame is the first that exists of: the option, the centre in the files of the
        trajectories, the middle of their latitudes and longitudes, the middle of the ocean (with a
        warning).
    schedule : float or Schedule
        Interval between pings of all vehicles [s], a `PingSchedule`, `SlotSchedule` or `PingList`.
        Time counts from the earliest pose of any vehicle.
    progress : callable, optional
        Called with the name of a stage, the number of its finished parts and the total.
    **options
        Options of `pymantaray.open_water`, such as ``ice=1.5`` and ``max_surface_bounces=2``, and
        sections of a study as in its TOML file: ``acoustics``, ``ranging``, ``detection``,
        ``landmarks``, ``noise``, ``mission`` (``sampling_period_s``, 200 by default; poses at pings
        are added), ``study`` (``seed``).

    Returns
    -------
    Run
        Run in memory without estimates. It has ``truth``, ``arrivals``, ``links``,
        ``measurements``, ``ranging_truth``, ``ocean`` and `Run.noisy_measurements`.

    Raises
    ------
    MantaRayError
        If a file, the ocean, a schedule or a section is not valid.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.apps.ranges import measure
    >>> sea = {"source": "synthetic:fram", "centre_lat": 78.0, "centre_lon": 0.0}
    >>> run = measure(truth, sea, 600.0)
    >>> print(run.ranging_truth.travel_time.round(4))
    [1.4026 1.4026]
    """
    if not isinstance(schedule, Schedule):
        schedule = PingSchedule(float(schedule))
    if isinstance(trajectories, Trajectories):
        trajectories = Tracks.of_record(trajectories)
    elif not isinstance(trajectories, Tracks):
        trajectories = read_trajectories(trajectories)
    mission = dict(options.pop("mission", {}))
    mission |= keys_of_schedule(schedule)
    files = list(dict.fromkeys(p.file for p in trajectories.poses))
    config = ranges_config(files, ocean, mission=mission, **options)
    study = build_study(with_tracks(config, trajectories))
    out = simulate_mission(
        study,
        Stopwatch(),
        progress or (lambda *_: None),
        tracks=trajectories,
        schedule=schedule,
        data=ocean if isinstance(ocean, xr.Dataset) else None,
    )
    note = centre_note(study.ocean.centre, out.ocean.local.attrs, trajectories)
    if note:
        logging.getLogger(__name__).warning(note)
    return run_in_memory(study, out)


def ranges_config(
    trajectories: Sequence[str | Path],
    ocean: WaterSource | Mapping[str, Any],
    *,
    enu: bool = False,
    vehicles: Sequence[str] = (),
    **options: Any,
) -> StudyConfig:
    """
    Configuration of a study of ranges only, for trajectories in files, see `measure`; ``mantaray
    ranges`` runs it.
    """
    sections = {
        name: options.pop(name) for name in list(options) if name in StudyConfig.model_fields
    }
    tree = _water_tree(ocean)
    for name, section in sections.items():
        tree[name] = {**tree.get(name, {}), **section} if isinstance(section, Mapping) else section
    # vehicles do not drift, and no current carries sound
    if not tree.get("acoustics", {}).get("currents"):
        tree["ocean"] = {"currents": "rest", **tree["ocean"]}
    tree["study"] = {"name": "ranges", **sections.get("study", {})}
    tree["conditions"] = []
    files = [str(path) for path in trajectories]
    tree["fleet"] = {"trajectories": files, "enu": enu, "names": list(vehicles)}
    for key, value in dotted_keys(options).items():
        tree = with_key(tree, key, value)
    return parse_study(tree, "ranges")


def _water_tree(ocean: WaterSource | Mapping[str, Any]) -> dict[str, Any]:
    """Sections of a study that describe the water."""
    if isinstance(ocean, Mapping) and not isinstance(ocean, xr.Dataset):
        return {"ocean": dict(ocean)}
    if isinstance(ocean, xr.Dataset):
        words = [IN_MEMORY]
    elif isinstance(ocean, SoundConfig):
        return _water_sections(ocean.model_dump(exclude_none=True, exclude_unset=True))
    elif isinstance(ocean, Medium):
        raise StudyError(
            "measure: a medium has no grid for vehicles; give a local ocean, or an ocean"
        )
    else:
        words = source_words(ocean)
        if names_configuration(words):
            config = load_sound(words[0])
            return _water_sections(config.model_dump(exclude_none=True, exclude_unset=True))
    return {"ocean": {"source": words}}


def _water_sections(tree: dict[str, Any]) -> dict[str, Any]:
    """
    Sections of a configuration for the water; trajectories and a schedule of their own replace
    those of its mission.
    """
    replaced = ("duration_h", "ping_interval_h", "ping_start_h", "schedule")
    tree["mission"] = {
        key: value for key, value in tree.get("mission", {}).items() if key not in replaced
    }
    return {name: tree[name] for name in SoundConfig.model_fields if name in tree}
