"""Ranges between vehicles that moved elsewhere: a study that estimates nothing."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pymantaray.config.load import parse_study
from pymantaray.config.sections import StudyConfig
from pymantaray.exchange import Tracks, read_trajectories
from pymantaray.jobs.progress import Progress
from pymantaray.records import Trajectories
from pymantaray.sensing import PingSchedule, Schedule, SlotSchedule
from pymantaray.study.manifest import Stopwatch
from pymantaray.study.mission import simulate_mission
from pymantaray.study.store import Run, run_in_memory
from pymantaray.study.tracks import with_tracks

Source = str | Path | Sequence[str | Path]


def measure(
    trajectories: Source | Tracks | Trajectories,
    ocean: Source | Mapping[str, Any],
    schedule: float | Schedule,
    *,
    progress: Progress | None = None,
    **sections: Any,
) -> Run:
    """
    Ranges between vehicles whose trajectories are known, through an ocean.

    Parameters
    ----------
    trajectories : str, pathlib.Path, sequence of them, Tracks or Trajectories
        Files as `read_trajectories` takes them, what it returned, or poses in the local frame at common times.
    ocean : str, pathlib.Path, sequence of them, or dict
        Files, or the name of a synthetic ocean; or the section ``[ocean]`` of a study. The frame's centre is the middle of
        the trajectories where they have latitudes and longitudes, else that of the ocean, unless the section gives it.
    schedule : float or Schedule
        Interval at which all vehicles ping [s], a `PingSchedule`, `SlotSchedule` or `PingList`. Time counts from the first
        pose of all.
    progress : callable, optional
        Told the name of a stage, how many of its parts are done, and how many there are.
    **sections
        Further sections of a study, as its TOML file has them: ``acoustics``, ``ranging``, ``detection``, ``landmarks``,
        ``noise``, ``mission`` (``sampling_period_s``, 200 by default; poses at pings are added), ``study`` (``seed``).

    Returns
    -------
    Run
        In memory, without estimates: ``truth``, ``arrivals``, ``links``, ``measurements``, ``ranging_truth``, ``ocean``,
        and `Run.noisy_measurements`.

    Raises
    ------
    MantaRayError
        If a file, the ocean, a schedule or a section is not what it has to be; one line.

    Examples
    --------
    >>> from pymantaray import measure, range_error_table
    >>> run = measure("mission.csv", "synthetic:beaufort", 600.0)  # doctest: +SKIP
    >>> range_error_table(run.measurements, run.ranging_truth, run.truth)  # doctest: +SKIP
    """
    if not isinstance(schedule, Schedule):
        schedule = PingSchedule(float(schedule))
    if isinstance(trajectories, Trajectories):
        trajectories = Tracks.of_record(trajectories)
    elif not isinstance(trajectories, Tracks):
        trajectories = read_trajectories(trajectories)
    mission = dict(sections.pop("mission", {}))
    if isinstance(schedule, SlotSchedule):
        slots = {"slots": list(schedule.slots), "slot_s": schedule.slot, "start_s": schedule.start}
        mission["schedule"] = {"kind": "slots", **slots}
    elif isinstance(schedule, PingSchedule):
        mission["ping_interval_h"] = schedule.interval / 3600.0
    files = list(dict.fromkeys(p.file for p in trajectories.poses))
    config = with_tracks(ranges_config(files, ocean, mission=mission, **sections), trajectories)
    out = simulate_mission(
        config, Stopwatch(), progress or (lambda *_: None), tracks=trajectories, schedule=schedule
    )
    return run_in_memory(config, out)


def ranges_config(
    trajectories: Sequence[str | Path],
    ocean: Source | Mapping[str, Any],
    *,
    enu: bool = False,
    **sections: Any,
) -> StudyConfig:
    """Study of the ranges alone of trajectories in files, see `measure`; ``mantaray ranges`` runs it."""
    if not isinstance(ocean, Mapping):
        ocean = {"source": [str(one) for one in ([ocean] if isinstance(ocean, str | Path) else ocean)]}
    study = {"name": "ranges", "conditions": [], **sections.pop("study", {})}
    fleet = {"trajectories": [str(path) for path in trajectories], "enu": enu}
    return parse_study({"study": study, "ocean": dict(ocean), "fleet": fleet, **sections}, "ranges")
