"""
Export of a study to the paper's authors' program: ``sim.json``, ``environment.json`` and its
arrays.
"""

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pymantaray.apps.authors.holds import DEPTH_GAIN, counted_steps, extra_steps
from pymantaray.apps.authors.simulation import LETTERS, REFLECTED
from pymantaray.apps.study.store import Run, open_run
from pymantaray.arrays import Array
from pymantaray.config.door.study import Study, build_study
from pymantaray.config.load import load_study
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import ExchangeError, WriteError
from pymantaray.fleet import ConstantTwist, Drifting, FloatCycle, StationKeeping, Vehicle
from pymantaray.jobs.folder import MANIFEST, staged_folder
from pymantaray.ocean.environment import (
    environment_arrays,
    is_environment,
    read_arrays,
    write_environment,
)
from pymantaray.sensing import OneWay

SIMULATION = "sim.json"
_BEAMS = 100  # of the authors' configurations
_MAX_BEAMS = 400
_SPREAD_DEG = 15.0
_GNSS_DEPTH = 0.1  # m, of the program


def export_authors(
    source: Run | StudyConfig | str | Path, folder: str | Path
) -> tuple[Path, tuple[str, ...]]:
    """
    Write the files with which the paper's authors' program simulates a study.

    Parameters
    ----------
    source : Run, StudyConfig, str or pathlib.Path
        A run or its folder, a study, a preset, or a study's file.
    folder : str or pathlib.Path
        A new or empty folder for ``sim.json``, ``environment.json`` and the folder ``environment``.
        Names in them are relative to it, so start the program there.

    Returns
    -------
    folder : pathlib.Path
        The folder.
    lines : tuple of str
        Notes of the readers of the study's files, and what the program does in another way.

    Raises
    ------
    ExchangeError
        If the program has no such vehicle, schedule or water.
    WriteError
        If a file cannot be written.

    Examples
    --------
    >>> from pymantaray import load_study
    >>> from pymantaray.apps.authors import export_authors
    >>> notes = export_authors(load_study("quick"), "files")
    >>> len(notes) > 0  # what the program does differently
    True
    """
    run = source if isinstance(source, Run) else None
    if isinstance(source, str | Path) and (Path(source) / MANIFEST).is_file():
        run = open_run(Path(source))
    if run is not None:
        study = run.study
    else:
        study = build_study(source if isinstance(source, StudyConfig) else load_study(str(source)))
    simulation = _simulation(study)
    arrays, notes = _environment(study, run)
    with staged_folder(folder) as (stage, final):
        try:
            write_environment(arrays, stage)
            (stage / SIMULATION).write_text(
                json.dumps(simulation, indent=1) + "\n", encoding="utf-8"
            )
        except OSError as error:
            raise WriteError(f"{final}: cannot be written: {error.strerror or error}") from None
    return final, (*notes, *_notes(study, arrays))


def _environment(
    study: Study, run: Run | None
) -> tuple[dict[str, dict[str, Array]], Sequence[str]]:
    """Arrays of the water, and notes; those of an ``environment.json`` are unchanged."""
    ocean = study.ocean
    changed = ocean.has_sea_floor or ocean.domain["half_extent"] is not None
    source = ocean.source[0]
    if is_environment(source) and not changed and (run is None or Path(source).is_file()):
        return read_arrays(source), ()
    if run is not None:
        return environment_arrays(run.ocean), run.notes
    opened = ocean.open(study.sound.interpolation)
    return environment_arrays(opened.local), opened.notes


def _simulation(study: Study) -> dict[str, Any]:
    """Content of ``sim.json``."""
    fleet = study.fleet
    search = study.sound.options
    noise = study.noise
    _check(study)
    period = fleet.sampling_period
    frequency = 1.0 / period
    spread = _SPREAD_DEG if search.cone is None else _digits(math.degrees(search.cone))
    # sensors of a sample have the frequency of the samples
    sensors = {
        "gt_freq_hz": frequency,
        "odom_freq_hz": frequency,
        "gps_freq_hz": frequency,
        "odom_noise_stddev": noise.odometry_translation_drift * period,
        "gps_xy_noise_stddev": noise.gnss_sigma,
        "gps_z_noise_stddev": noise.gnss_sigma,
    }
    if study.gnss_depth != _GNSS_DEPTH:  # only later versions of the program read this key
        sensors["gps_surface_range_meters"] = study.gnss_depth
    # variances of the graph that the program writes
    pfg: dict[str, Any] = {
        "use_ground_truth_odometry": True,
        "range_variance": _variance(noise.range_sigma),
        "odom_rotation_variance": _variance(noise.odometry_rotation_drift * period),
        "pose_prior_cov_diag": [_variance(noise.first_position_sigma)] * 3
        + [_variance(noise.first_rotation_sigma)] * 3,
    }
    if study.ranging.landmarks:
        pfg["landmark_prior_cov_diag"] = [_variance(noise.landmark_sigma)] * 3
    return {
        "run_name": study.name,
        "output_dir": "output",
        "env_config_file": "environment.json",
        "rng_seed": study.seed,
        "timing": {
            "end_time_hours": _digits(fleet.duration / 3600.0),
            "physics_dt": fleet.physics_step,
            "ping_interval_min": _digits(study.ranging.pings.interval / 60.0),
        },
        "acoustics": {
            "tof_mode": "one_way",
            "num_beams": _BEAMS,
            "max_beams": _MAX_BEAMS,
            "beam_spread_deg": spread,
            "allow_multipath": search.arrival in REFLECTED,
        },
        "sensors": sensors,
        "robots": [
            _robot(vehicle, fleet.physics_step, fleet.duration) for vehicle in fleet.vehicles
        ],
        "landmarks": [
            [east, north, depth]
            for north, east, depth in (mark.position.tolist() for mark in study.ranging.landmarks)
        ],
        "pfg": pfg,
    }


def _variance(sigma: float) -> float:
    """Square of a standard deviation, to 12 digits."""
    return _digits(sigma * sigma)


def _digits(value: float) -> float:
    """A value to 12 digits, without the last ones of a conversion of units."""
    return float(f"{value:.12g}")


def _check(study: Study) -> None:
    """Raise an error for what the program does not have."""
    name = study.name
    pings = study.ranging.pings
    count = len(study.fleet.vehicles)
    faults = {
        "fleet.trajectories: the program simulates its robots; give vehicles": (
            study.fleet.existing is not None
        ),
        f"fleet.vehicles: {count} vehicles; the program has {len(LETTERS)} at most": count
        > len(LETTERS),
        "mission.schedule: the program pings at one interval; remove it": pings.own is not None,
        "mission.ping_start_h: the program first pings after one interval; remove it": (
            pings.first not in (None, pings.interval)
        ),
        "ocean.time_varying: the water of the program is constant; set it to"
        " false": study.ocean.time_varying,
        "ocean.internal_tide: the water of the program is constant; remove"
        " it": study.ocean.has_tide,
        "ocean.ice: the program has no ice; remove it": study.ocean.has_ice,
    }
    for fault, is_there in faults.items():
        if is_there:
            raise ExchangeError(f"{name}: {fault}")


def _robot(vehicle: Vehicle, step: float, duration: float) -> dict[str, Any]:
    """Robot of the program that moves like a vehicle."""
    north, east, depth = map(float, vehicle.position)
    position = [east, north, depth]
    behaviour = vehicle.behaviour
    if isinstance(behaviour, StationKeeping):
        return {"type": "constant_vel", "position": position, "velocity": [0.0, 0.0, 0.0]}
    if isinstance(behaviour, ConstantTwist) and not (behaviour.current or any(behaviour.twist[:3])):
        forward, right, down = behaviour.twist[3:].tolist()
        cos = math.cos(vehicle.heading)
        sin = math.sin(vehicle.heading)
        velocity = [forward * sin + right * cos, forward * cos - right * sin, down]
        return {"type": "constant_vel", "position": position, "velocity": velocity}
    drift = {"type": "current_drift", "position": position}
    if isinstance(behaviour, Drifting) and behaviour.drogue_depth == behaviour.depth:
        # a surface hold that outlasts the mission
        return {
            **drift,
            "target_depth": depth + 1.0,
            "surface_depth": depth,
            "start_offset_seconds": duration + 1.0,
        }
    if isinstance(behaviour, FloatCycle):
        cycle = behaviour
        motion = cycle.target_depth, cycle.surface_depth, cycle.vertical_speed
        extra = extra_steps(depth, *motion, step, round(duration / step))
        return {
            **drift,
            "target_depth": cycle.target_depth,
            "hold_seconds": _hold(cycle.hold_depth_time, extra.depth, step, duration),
            "surface_hold_seconds": _hold(cycle.hold_surface_time, extra.surface, step, duration),
            "vertical_speed": cycle.vertical_speed,
            "surface_depth": cycle.surface_depth,
            "start_offset_seconds": _hold(cycle.start_delay, 0, step, duration)
            if cycle.start_delay
            else 0.0,
        }
    raise ExchangeError(
        f"vehicle {vehicle.name!r}: the program has no robot that moves like it; use floats,"
        " stations, drifting vehicles at the depth of their drogue, or a twist over ground without"
        " rotation"
    )


def _hold(seconds: float, extra: int | None, step: float, duration: float) -> float:
    """Hold of the program for one of a vehicle, to whole microseconds or half a step. [s]"""
    if seconds > duration or extra is None:
        return seconds
    steps = round(seconds / step) - extra
    nominal = max(round(steps * step, 6), 0.0)
    return nominal if counted_steps(nominal, step) <= steps else (steps - 0.5) * step


def _notes(study: Study, arrays: dict[str, dict[str, Array]]) -> Iterator[str]:
    """Differences between the study and the program, one line each."""
    noise = study.noise
    sound = study.sound
    if len(study.fleet.vehicles) > LETTERS.index("L"):
        yield "the program gives the 12th robot the letter L, which means a landmark in its graphs"
    if not isinstance(sound.timing, OneWay):
        yield (
            "ranging.timing is written as one_way, because the program gives twice the distance"
            " for two_way"
        )
    if any(
        (noise.odometry_rotation_fraction, noise.odometry_xy_fraction, noise.odometry_z_fraction)
    ):
        yield (
            "odometry noise is written without its fractions of the motion, which the program adds"
            " in Python"
        )
    if any(
        isinstance(v.behaviour, FloatCycle) and v.behaviour.depth_gain != DEPTH_GAIN
        for v in study.fleet.vehicles
    ):
        yield "depth_gain is not written: the program has 10 per second"
    if sound.currents or sound.earth != "flat" or study.detects:
        yield (
            "currents along rays, a spherical Earth and detection are not written: the program"
            " does not have them"
        )
    if study.gnss_depth != _GNSS_DEPTH:
        yield (
            "sensors.gps_surface_range_meters is written, which only later versions of the program"
            " read"
        )
    if any(mark.sigma is not None for mark in study.ranging.landmarks):
        yield "landmarks have one variance in the program, that of noise.landmark_sigma"
    if arrays["bathymetry"]["data"].min() <= 0.0 if "bathymetry" in arrays else False:
        yield "the water has land, at which the program stops"
