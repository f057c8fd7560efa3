"""
Reading of a ``sim.json`` of the paper's authors' program as the nested dictionaries of a study.
"""

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, model_validator

from pymantaray.apps.authors.holds import DEPTH_GAIN, Holds, counted_steps, extra_steps
from pymantaray.arrays import Array
from pymantaray.config.checks import NAME, checked
from pymantaray.config.common import NonNegativeFloat, PositiveFloat, Section, located
from pymantaray.config.keys import Tree
from pymantaray.config.load import parse_study
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import OceanError, StudyError, errors_as
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.ocean.environment import find_file, read_arrays, read_environment, read_json
from pymantaray.ocean.metres import ocean_in_metres
from pymantaray.user_files import exists, shown

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""Letters of the program's robots."""
_LANDMARK_LETTER = LETTERS.index("L")
_ENDLESS = 1e12  # s
_MAX_STEPS = 1e8  # of a mission
_LARGE_STEP = 0.1  # m; a float of the program stops up to one step beyond its depth
REFLECTED = ("first", "direct-or-first")
"""Arrivals that may have reflections."""
_MULTIPATH_BOUNCES = 3  # of each boundary; weaker arrivals do not come first

Position = Annotated[tuple[float, float, float], Field(strict=False)]


def _whole(value: Any) -> Any:
    """Whole number that a file writes with a point."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Count = Annotated[int, Field(ge=1), BeforeValidator(_whole)]


class Timing(Section):
    """Section ``timing``."""

    end_time_hours: PositiveFloat = 8.0
    """Duration. [h]"""
    physics_dt: PositiveFloat = 0.1
    """Step of the motion. [s]"""
    ping_interval_min: PositiveFloat = 30.0
    """Interval of pings; the first is after one interval. [min]"""
    bounds_check_interval_sec: PositiveFloat = 100.0
    """Interval of the check that robots are in the grid. [s]"""


class Acoustics(Section):
    """Section ``acoustics``."""

    tof_mode: Literal["one_way", "two_way"] = "one_way"
    """Travel times."""
    num_beams: Count = 80
    """First number of beams."""
    max_beams: Count = 180
    """Last number of beams."""
    beam_spread_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0
    """Half-angle of the fan in azimuth and elevation. [degrees]"""
    allow_multipath: bool = False
    """True if the first arrival with reflections replaces a missing direct one."""
    debug_range_error_pct: NonNegativeFloat = 0.0
    """Range error above which the program writes files for debugging. [%]"""
    dry_run: bool = False
    """True if ranges are straight distances."""

    @model_validator(mode="after")
    def _has_beams(self) -> Self:
        if self.max_beams < self.num_beams:
            raise ValueError(
                f"max_beams is {self.max_beams}, less than num_beams, {self.num_beams}: the program"
                " then traces no ray; increase max_beams"
            )
        if self.dry_run:
            raise ValueError(
                "dry_run is true: ranges would be straight distances; remove it to trace rays"
            )
        return self


class Sensors(Section):
    """Section ``sensors``."""

    gt_freq_hz: PositiveFloat = 0.01
    """Frequency of poses. [Hz]"""
    odom_freq_hz: PositiveFloat = 0.01
    """Frequency of odometry. [Hz]"""
    gps_freq_hz: PositiveFloat = 0.5
    """Frequency of GNSS fixes. [Hz]"""
    odom_noise_stddev: PositiveFloat = 0.01
    """Standard deviation of each axis of an odometry edge. [m]"""
    gps_xy_noise_stddev: PositiveFloat = 0.5
    """Standard deviation of each horizontal axis of a fix. [m]"""
    gps_z_noise_stddev: NonNegativeFloat = 2.0
    """Standard deviation of the depth of a fix. [m]"""
    gps_surface_range_meters: PositiveFloat = 0.1
    """Depth above which robots have fixes. [m]"""


class ConstantVelocity(Section):
    """Robot with a constant velocity in the world."""

    position: Position
    """East, north, depth. [m]"""
    velocity: Position
    """East, north, down. [m/s]"""


class CurrentDrift(Section):
    """Float that drifts with the current."""

    position: Position
    """East, north, depth. [m]"""
    target_depth: NonNegativeFloat = 50.0
    """Depth of the lower hold. [m]"""
    hold_seconds: NonNegativeFloat = 60.0
    """Time at the target depth. [s]"""
    surface_hold_seconds: NonNegativeFloat = 60.0
    """Time at the surface. [s]"""
    vertical_speed: PositiveFloat = 0.5
    """Limit of the vertical speed. [m/s]"""
    surface_depth: NonNegativeFloat = 0.01
    """Depth of the surface hold. [m]"""
    start_offset_seconds: NonNegativeFloat = 0.0
    """Length of the first surface hold; without it the dive begins at once. [s]"""

    @model_validator(mode="after")
    def _goes_down(self) -> Self:
        if self.target_depth <= self.surface_depth:
            raise ValueError(
                f"target_depth is {self.target_depth:g} m; it must be greater than surface_depth,"
                f" {self.surface_depth:g} m"
            )
        if self.position[2] > self.target_depth:
            raise ValueError(
                f"position has depth {self.position[2]:g} m, below target_depth,"
                f" {self.target_depth:g} m; increase the target"
            )
        return self


class Pfg(Section):
    """Section ``pfg``."""

    use_ground_truth_odometry: bool = True
    """True if odometry edges have no noise."""
    range_variance: PositiveFloat = 1.0
    """Variance of a range. [m2]"""
    odom_rotation_variance: PositiveFloat = 1e-8
    """Variance of each axis of the rotation of an odometry edge. [rad2]"""
    gps_rotation_variance: PositiveFloat = 1e6
    """Variance of the rotation of a GNSS prior. [rad2]"""
    pose_prior_cov_diag: (
        Annotated[tuple[NonNegativeFloat, ...], Field(min_length=6, max_length=6, strict=False)]
        | None
    ) = None
    """Variances of the first pose, translation before rotation. [m2, rad2]"""
    landmark_prior_cov_diag: (
        Annotated[tuple[NonNegativeFloat, ...], Field(min_length=3, max_length=3, strict=False)]
        | None
    ) = None
    """Variances of a landmark's position. [m2]"""


class Simulation(Section):
    """Content of a ``sim.json`` without its robots."""

    output_dir: str
    """Folder of the output."""
    env_config_file: Annotated[str, Field(min_length=1)]
    """Water."""
    run_name: Annotated[str, Field(min_length=1)] = "sim"
    """Name."""
    rng_seed: Annotated[int, Field(ge=0), BeforeValidator(_whole)] = 10020
    """Seed of the sensors' noise."""
    bellhop_memory_mib: Count = 80
    """Memory of Bellhop. [MiB]"""
    timing: Timing = Timing()
    """Durations and periods."""
    acoustics: Acoustics = Acoustics()
    """Beams."""
    sensors: Sensors = Sensors()
    """Frequencies and noise of sensors."""
    robots: Annotated[
        tuple[dict[str, Any], ...], Field(min_length=1, max_length=len(LETTERS), strict=False)
    ]
    """Vehicles."""
    landmarks: Annotated[tuple[Position, ...], Field(strict=False)] = ()
    """Positions of landmarks."""
    pfg: Pfg = Pfg()
    """Variances."""


_ROBOTS: dict[str, type[ConstantVelocity | CurrentDrift]] = {
    "constant_vel": ConstantVelocity,
    "current_drift": CurrentDrift,
}
WITHOUT_MEANING = {
    "output_dir": "give the folder of a run with out",
    "bellhop_memory_mib": "no Bellhop",
    "timing.bounds_check_interval_sec": "checked in every step",
    "acoustics.num_beams": "eigenrays are exact",
    "acoustics.max_beams": "eigenrays are exact",
    "acoustics.debug_range_error_pct": "all rays are in the run",
    "sensors.gps_z_noise_stddev": "the depth sensor measures depth",
    "pfg.gps_rotation_variance": "fixes have no rotation",
    "pfg.use_ground_truth_odometry": "each realization has noise",
}
"""Keys without meaning in a study, and why."""


def import_authors(file: str | Path) -> tuple[StudyConfig, tuple[str, ...]]:
    """
    Read a ``sim.json`` of the paper's authors' program as a study.

    Parameters
    ----------
    file : str or pathlib.Path

    Returns
    -------
    config : StudyConfig
        As from `load_study`.
    lines : tuple of str
        Differences from the program, and keys without meaning in a study, one line each.

    Raises
    ------
    StudyError
        If a key is unknown, or the program refuses a value or cannot use it.
    OceanError
        If the water cannot be read.

    Examples
    --------
    >>> from pymantaray import load_study
    >>> from pymantaray.apps.authors import export_authors, import_authors
    >>> _ = export_authors(load_study("quick"), "files")
    >>> config, differences = import_authors("files/sim.json")
    >>> config.mission.duration_h
    24.0
    """
    path = Path(file)
    with errors_as(StudyError, OceanError):
        content = read_json(path)
    label = str(file)
    simulation = checked(Simulation, content, label, path.parent)
    robots = [_robot(robot, f"{label}: robots[{i}]") for i, robot in enumerate(simulation.robots)]
    period = _sampling_period(simulation, label)
    environment = find_file(simulation.env_config_file, path)
    if not exists(environment):
        raise StudyError(
            f"{label}: env_config_file: no file {shown(environment)}; correct the name"
        )
    lines = [
        *_notes(simulation, period),
        *_float_notes(simulation, robots),
        *_water_notes(simulation, robots, environment, label),
    ]
    tree = _study(simulation, robots, period, environment, path)
    unused = [f"{key} ({why})" for key, why in WITHOUT_MEANING.items() if _is_given(content, key)]
    if unused:
        lines.append(f"without meaning here: {'; '.join(unused)}")
    return parse_study(dict(located(tree, path.parent)), label), tuple(lines)


def _is_given(content: Any, key: str) -> bool:
    for part in key.split("."):
        if not isinstance(content, dict) or part not in content:
            return False
        content = content[part]
    return True


def _robot(robot: dict[str, Any], label: str) -> ConstantVelocity | CurrentDrift:
    kind = robot.get("type")
    if kind not in _ROBOTS:
        found = f"found {kind!r}" if "type" in robot else "missing"
        raise StudyError(f"{label}.type: {found}; allowed: {' or '.join(map(repr, _ROBOTS))}")
    return checked(
        _ROBOTS[kind], {key: value for key, value in robot.items() if key != "type"}, label, None
    )


def _fraction(value: float) -> Fraction:
    """Decimal fraction of a number, without its binary error."""
    return Fraction(repr(value))


def _sampling_period(simulation: Simulation, label: str) -> float:
    """Longest period of samples that contains poses, pings and the end. [s]"""
    timing = simulation.timing
    sensors = simulation.sensors
    step = _fraction(timing.physics_dt)
    duration = 3600.0 * timing.end_time_hours
    # times and frequencies that cannot be used
    if duration > _MAX_STEPS * timing.physics_dt:
        raise StudyError(
            f"{label}: timing.physics_dt is {timing.physics_dt:g} s,"
            f" {duration / timing.physics_dt:.1e} steps in {timing.end_time_hours:g} h; allowed: at"
            f" most {_MAX_STEPS:.0e} steps, so at least {duration / _MAX_STEPS:.1g} s"
        )
    if timing.ping_interval_min > 60.0 * timing.end_time_hours:
        raise StudyError(
            f"{label}: timing.ping_interval_min is {timing.ping_interval_min:g} min, longer than"
            f" end_time_hours, {timing.end_time_hours:g} h: there would be no ping; shorten it"
        )
    for key in ("gt_freq_hz", "odom_freq_hz", "gps_freq_hz"):
        steps = 1 / (_fraction(getattr(sensors, key)) * step)
        if steps < 1 or steps.denominator != 1:
            raise StudyError(
                f"{label}: sensors.{key} is {getattr(sensors, key):g} Hz, {float(1 / steps):g}"
                " times the frequency of steps, 1 / timing.physics_dt; the program refuses it; use"
                f" a whole fraction of {float(1 / step):g} Hz"
            )
    if sensors.gt_freq_hz != sensors.odom_freq_hz and not simulation.pfg.use_ground_truth_odometry:
        raise StudyError(
            f"{label}: sensors.odom_freq_hz is {sensors.odom_freq_hz:g} Hz and gt_freq_hz"
            f" {sensors.gt_freq_hz:g} Hz: the program would give odometry to wrong poses; use one"
            " frequency"
        )
    # greatest common divisor of the periods
    periods = (
        1 / _fraction(sensors.gt_freq_hz),
        60 * _fraction(timing.ping_interval_min),
        3600 * _fraction(timing.end_time_hours),
    )
    scale = math.lcm(*(value.denominator for value in periods))
    period = Fraction(math.gcd(*(int(value * scale) for value in periods)), scale)
    if (period / step).denominator != 1:
        raise StudyError(
            f"{label}: timing: ping_interval_min and end_time_hours have no common period with"
            f" gt_freq_hz that is a multiple of physics_dt, {timing.physics_dt:g} s; change one of"
            " them"
        )
    return float(period)


def _notes(simulation: Simulation, period: float) -> Iterator[str]:
    """Values that the program treats wrongly, and differences."""
    sensors = simulation.sensors
    acoustics = simulation.acoustics
    robots = simulation.robots
    if acoustics.tof_mode == "two_way":
        yield (
            "acoustics.tof_mode is two_way: the program gives twice the distance; here the range"
            " is the distance"
        )
    if len(robots) > _LANDMARK_LETTER:
        yield (
            "robots: the program gives the 12th robot the letter L, which means a landmark; here"
            " it is a vehicle"
        )
    poses = 1.0 / sensors.gt_freq_hz
    if not math.isclose(poses, period):
        yield (
            f"timing: poses every {poses:g} s do not contain all pings and the end, so the program"
            f" ties ranges to earlier poses; here poses are every {period:g} s"
        )
    for key in ("odom_freq_hz", "gps_freq_hz"):
        own = 1.0 / getattr(sensors, key)
        if not math.isclose(own, period):
            yield f"sensors.{key}: every {own:g} s; here at the poses, every {period:g} s"
    for key, rows in (
        ("pose_prior_cov_diag", "first poses"),
        ("landmark_prior_cov_diag", "landmarks"),
    ):
        variances = getattr(simulation.pfg, key)
        if variances is None and (key.startswith("pose") or simulation.landmarks):
            wrong = "writes variances of 0" if key.startswith("pose") else "writes no prior"
            yield f"pfg.{key}: missing, and the program {wrong}; here {rows} have the default noise"
        elif variances is not None and any(
            len(set(variances[k : k + 3])) > 1 for k in range(0, len(variances), 3)
        ):
            yield f"pfg.{key}: axes differ; their mean is used, as PyFactorGraph does"


def _float_notes(
    simulation: Simulation, robots: list[ConstantVelocity | CurrentDrift]
) -> Iterator[str]:
    """Depths at which floats of the program stop elsewhere, or which they never reach."""
    step = simulation.timing.physics_dt
    for i, robot in enumerate(robots):
        if isinstance(robot, CurrentDrift):
            if None in float_steps(robot, simulation.timing):
                yield (
                    f"robots[{i}]: physics_dt is {step:g} s, and the program, which slows down"
                    " below 0.1 s, never reaches one of its depths and stays there; so does this"
                    " study"
                )
            elif robot.vertical_speed * step > _LARGE_STEP:
                yield (
                    f"robots[{i}]: the program passes a depth by up to"
                    f" {robot.vertical_speed * step:g} m; here the robot stops at it"
                )


class _WaterVolume(NamedTuple):
    """Horizontal limits of the program's water [m], and its sea floor."""

    x: tuple[float, float]
    y: tuple[float, float]
    bed: BoundarySurface

    def fault(self, position: tuple[float, float, float]) -> str | None:
        """Limit that a position x, y, z exceeds, for messages; None if it is in the water."""
        x, y, z = position
        if not (self.x[0] <= x <= self.x[1] and self.y[0] <= y <= self.y[1]):
            return (
                f"outside the grid, x {self.x[0]:g} to {self.x[1]:g} m and y {self.y[0]:g} to"
                f" {self.y[1]:g} m"
            )
        floor = float(self.bed.depth_at([y, x])[0])
        if not 0.0 <= z <= floor:
            return f"outside the water, z 0 to {floor:g} m there"
        return None


def _water_notes(
    simulation: Simulation,
    robots: list[ConstantVelocity | CurrentDrift],
    environment: Path,
    label: str,
) -> Iterator[str]:
    """Check positions in the grid; yield what the program cannot do in it."""
    data = read_environment(environment)
    local = ocean_in_metres(data, environment.name)
    bed = BoundarySurface.from_dataset(local, "sea_floor_depth", OceanError)
    east, north = (data[name].values[[0, -1]].tolist() for name in ("east", "north"))
    water = _WaterVolume(tuple(east), tuple(north), bed)
    for name, positions in (
        ("landmarks", simulation.landmarks),
        ("robots", [r.position for r in robots]),
    ):
        for i, position in enumerate(positions):
            if (where := water.fault(position)) is not None:
                raise StudyError(
                    f"{label}: {name}[{i}]: position {position[0]:g}, {position[1]:g},"
                    f" {position[2]:g} is {where}; move it"
                )
    if water.bed.depth.min() <= 0.0:
        yield f"{environment.name}: the water has land, at which the program stops"
    seconds = 3600.0 * simulation.timing.end_time_hours
    current = read_arrays(environment).get("current")
    for i, robot in enumerate(robots):
        if isinstance(robot, CurrentDrift):
            for note in _drift_notes(robot, water, current):
                yield f"robots[{i}]: {note}"
            continue
        x, y, z = (p + seconds * v for p, v in zip(robot.position, robot.velocity, strict=True))
        if (where := water.fault((x, y, z))) is not None:
            yield (
                f"robots[{i}]: its last position is {where}; the program stops there, here only"
                " the robot does"
            )


def _drift_notes(
    robot: CurrentDrift, water: _WaterVolume, current: dict[str, Array] | None
) -> Iterator[str]:
    """Positions of a drifting robot outside the water or outside the grid of its current."""
    x, y, z = robot.position
    if (where := water.fault((x, y, robot.target_depth))) is not None:
        yield (
            f"target_depth {robot.target_depth:g} m is {where}; here the robot stops at the sea"
            " floor"
        )
    if current is None:
        yield "the water has no current; here the robot is at rest horizontally"
        return
    outside = [
        f"{key} {current[key][0]:g} to {current[key][-1]:g} m"
        for key, low, high in (("x", x, x), ("y", y, y), ("z", z, robot.target_depth))
        if not current[key][0] <= low <= high <= current[key][-1]
    ]
    if outside:
        yield (
            f"it leaves the grid of the current, {', '.join(outside)}, where the program writes"
            " nothing; here the current at the edge is used"
        )


def _study(
    simulation: Simulation,
    robots: list[ConstantVelocity | CurrentDrift],
    period: float,
    environment: Path,
    path: Path,
) -> Tree:
    """Nested dictionaries of a study."""
    timing = simulation.timing
    acoustics = simulation.acoustics
    reflections = {"arrival": REFLECTED[1]} | dict.fromkeys(
        ("max_surface_bounces", "max_bottom_bounces"), _MULTIPATH_BOUNCES
    )
    return {
        "study": {
            "name": _name(simulation.run_name),
            "description": f"Imported from {path.name} of the paper's authors' program",
            "seed": simulation.rng_seed,
        },
        "ocean": {"source": [str(environment)]},
        "mission": {
            "duration_h": timing.end_time_hours,
            "physics_step_s": timing.physics_dt,
            "sampling_period_s": period,
            "ping_interval_h": timing.ping_interval_min / 60.0,
            "gnss_depth": simulation.sensors.gps_surface_range_meters,
        },
        "acoustics": {
            "interpolation": "linear",
            "spreading_cutoff_db": "none",
            "cone_deg": acoustics.beam_spread_deg,
            **(reflections if acoustics.allow_multipath else {}),
        },
        "ranging": {"timing": acoustics.tof_mode.replace("_", "-")},
        "noise": _noise(simulation.sensors, simulation.pfg, period),
        "fleet": {
            "vehicles": [
                _vehicle(robot, name, timing) for robot, name in zip(robots, LETTERS, strict=False)
            ]
        },
        "landmarks": [
            {"name": f"L{i}", "north": north, "east": east, "depth": depth}
            for i, (east, north, depth) in enumerate(simulation.landmarks)
        ],
    }


def _noise(sensors: Sensors, pfg: Pfg, period: float) -> Tree:
    """Standard deviations of a study from the program's sensors and variances."""
    # edges between poses of the study have a part of the variance of an edge of the program
    per_edge = math.sqrt(period * sensors.gt_freq_hz) / period
    noise: Tree = {
        "range_sigma": math.sqrt(pfg.range_variance),
        "gnss_sigma": sensors.gps_xy_noise_stddev,
        "odometry_rotation_fraction": 0.0,
        "odometry_rotation_drift": math.sqrt(pfg.odom_rotation_variance) * per_edge,
        "odometry_xy_fraction": 0.0,
        "odometry_z_fraction": 0.0,
        "odometry_translation_drift": sensors.odom_noise_stddev * per_edge,
    }
    pose = pfg.pose_prior_cov_diag
    priors = {
        "first_position_sigma": pose,
        "landmark_sigma": pfg.landmark_prior_cov_diag,
        "first_rotation_sigma": None if pose is None else pose[3:],
    }
    return noise | {
        key: math.sqrt(sum(variances[:3]) / 3.0)
        for key, variances in priors.items()
        if variances is not None
    }


def _name(run_name: str) -> str:
    """Name of a study from that of a run."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", run_name).lstrip("._-")
    return name if re.match(NAME, name) else "sim"


def float_steps(robot: CurrentDrift, timing: Timing) -> Holds:
    """Steps of holds beyond those that the program counts."""
    limit = round(3600.0 * timing.end_time_hours / timing.physics_dt)
    cycle = robot.target_depth, robot.surface_depth, robot.vertical_speed
    return extra_steps(robot.position[2], *cycle, timing.physics_dt, limit)


def _vehicle(robot: ConstantVelocity | CurrentDrift, name: str, timing: Timing) -> Tree:
    """Nested dictionaries of a vehicle."""
    east, north, depth = robot.position
    placed: Tree = {"name": name, "north": north, "east": east, "depth": depth}
    if isinstance(robot, ConstantVelocity):
        v_east, v_north, v_down = robot.velocity
        return {"kind": "twist", **placed, "twist": [0.0, 0.0, 0.0, v_north, v_east, v_down]}
    step = timing.physics_dt
    duration = 3600.0 * timing.end_time_hours
    extra = float_steps(robot, timing)

    def hours(seconds: float, more: int | None) -> float:
        if seconds > duration:  # it never ends
            return min(seconds, _ENDLESS) / 3600.0
        if more is None:
            return (duration + seconds) / 3600.0
        return (counted_steps(seconds, step) + more) * step / 3600.0

    return {
        "kind": "float",
        **placed,
        "target_depth": robot.target_depth,
        "start_delay_h": hours(robot.start_offset_seconds, 0)
        if robot.start_offset_seconds
        else 0.0,
        "hold_depth_h": hours(robot.hold_seconds, extra.depth),
        "hold_surface_h": hours(robot.surface_hold_seconds, extra.surface),
        "vertical_speed": robot.vertical_speed,
        "surface_depth": robot.surface_depth,
        "depth_gain": DEPTH_GAIN,
    }
