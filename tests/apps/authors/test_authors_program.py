"""Configurations of the paper's authors' program as studies, and studies for that program."""

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from authors_files import FLOOR, arrays, simulation, write_environment, write_simulation
from refusals import refused
from scipy.interpolate import RegularGridInterpolator
from trilinear_fan import first_direct_time

from pymantaray import load_study
from pymantaray.apps.authors import export_authors, import_authors
from pymantaray.apps.study import run_study
from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.apps.study.store import run_in_memory
from pymantaray.config.door.fleet import build_vehicles
from pymantaray.config.door.study import build_study
from pymantaray.config.text import commented_toml
from pymantaray.errors import ExchangeError, MantaRayError, OceanError, StudyError
from pymantaray.ocean.environment import read_arrays
from pymantaray.records import RayStatus

RUN = Path(__file__).parents[4] / "shared" / "data" / "authors"


def study_of(path):
    """Study of a configuration of the program."""
    return import_authors(path)[0]


def study_file(folder):
    """File of the study of a configuration of the program."""
    path = folder / "two.toml"
    path.write_text(commented_toml(study_of(write_simulation(folder))))
    return path


def mission_of(config):
    return simulate_mission(build_study(config), Stopwatch(), lambda *_: None)


def test_every_value_has_its_place(tmp_path):
    config = study_of(write_simulation(tmp_path))
    a, b = config.fleet.vehicles
    assert (a.kind, a.north, a.east, a.depth, a.target_depth) == (
        "float",
        -700.0,
        500.0,
        0.01,
        300.0,
    )
    assert (a.hold_depth_h, a.hold_surface_h) == ((1200.0 + 0.5) / 3600.0, (600.0 + 0.5) / 3600.0)
    assert b.twist == (0.0, 0.0, 0.0, 0.2, -0.3, 0.01)  # north, east, down
    mark = config.landmarks[0]
    assert (mark.name, mark.north, mark.east, mark.depth) == ("L0", 1500.0, -1000.0, 400.0)
    mission = config.mission
    assert (mission.duration_h, mission.physics_step_s, mission.ping_interval_h) == (2.0, 0.5, 0.5)
    assert (mission.sampling_period_s, mission.gnss_depth) == (100.0, 0.1)
    noise = config.noise.model
    assert (noise.range_sigma, noise.gnss_sigma) == (2.0, 0.2)
    assert (noise.first_position_sigma, noise.first_rotation_sigma) == pytest.approx((0.1, 0.01))
    assert noise.landmark_sigma == pytest.approx(0.2)
    assert noise.odometry_translation_drift * 100.0 == pytest.approx(0.02)  # of an edge of 100 s
    assert noise.odometry_rotation_drift * 100.0 == pytest.approx(1e-3)
    assert config.acoustics.interpolation == "linear"
    assert config.study.seed == 3
    assert [config.study.name, *config.ocean.source] == ["two", str(tmp_path / "environment.json")]


def test_keys_without_meaning_are_named(tmp_path):
    _, lines = import_authors(write_simulation(tmp_path))
    unused = next(line for line in lines if line.startswith("without meaning here: "))
    for key in (
        "output_dir",
        "bellhop_memory_mib",
        "acoustics.num_beams",
        "sensors.gps_z_noise_stddev",
    ):
        assert key in unused
    assert "timing.physics_dt" not in unused


def test_a_float_moves_as_in_the_program(tmp_path):
    """
    Depths from the rules of the program: down at once, a hold that counts from the step after the
    arrival, up.

    299.99 m at 0.5 m/s are 600 steps of 0.5 s twice, so 1200 steps: arrival at 600 s, ascent after
    1200.5 s.
    """
    depth = mission_of(study_of(write_simulation(tmp_path))).truth.position[0, :, 2]
    assert depth[:7] == pytest.approx(
        [0.01, 50.01, 100.01, 150.01, 200.01, 250.01, 300.0], abs=1e-9
    )
    assert depth[18] == pytest.approx(300.0)
    assert depth[19] == pytest.approx(300.0 - 0.5 * (1900.0 - 1800.5), abs=0.02)


def program_depths(robot, step, samples, steps_per_sample):
    """
    Depths of a float by the program's rules, step by step: it finds that it has arrived, counts its
    hold, and then moves.
    """
    depth, hold, down = robot["position"][2], robot.get("start_offset_seconds", 0.0), False
    holding, elapsed = hold > 0.0, 0.0
    down = not holding  # the first hold is one at the surface
    out = [depth]
    for _ in range(samples):
        for _ in range(steps_per_sample):
            goal = robot["target_depth"] if down else robot["surface_depth"]
            if holding:
                elapsed += step
                if elapsed >= hold:
                    holding, down = False, not down
            elif (depth >= goal) if down else (depth <= goal):
                holding, elapsed = True, 0.0
                hold = robot["hold_seconds"] if down else robot["surface_hold_seconds"]
            else:
                speed = robot["vertical_speed"]
                depth += step * min(max(10.0 * (goal - depth), -speed), speed)
        out.append(depth)
    return np.array(out)


@pytest.mark.parametrize(
    "step",
    [0.125, *(pytest.param(step, marks=pytest.mark.slow) for step in (0.05, 0.1, 0.2, 1.0))],
)
@pytest.mark.parametrize(
    "keys",
    [
        {"target_depth": 50.0, "hold_seconds": 60.0, "surface_hold_seconds": 60.0},
        {"target_depth": 77.7, "hold_seconds": 500.0, "surface_hold_seconds": 0.0,
         "start_offset_seconds": 1800.0},
        {"target_depth": 300.3, "hold_seconds": 1800.0, "surface_hold_seconds": 3600.0,
         "surface_depth": 0.3},
        {"target_depth": 120.0, "hold_seconds": 90.0, "surface_hold_seconds": 33.3,
         "vertical_speed": 0.13},
    ],
)  # fmt: skip
def test_floats_keep_the_depths_of_the_program_over_many_cycles(step, keys, tmp_path):
    """
    One step more in each hold would move a float by metres in 8 h; it stops at its depth and the
    program within a step beyond.
    """
    tree = simulation()
    robot = {
        "type": "current_drift",
        "position": [0.0, 0.0, 0.01],
        "vertical_speed": 0.5,
        "surface_depth": 0.01,
        **keys,
    }
    tree["timing"] = {"end_time_hours": 8.0, "physics_dt": step, "ping_interval_min": 30.0}
    tree["robots"] = [robot, tree["robots"][1]]
    ours = mission_of(study_of(write_simulation(tmp_path, tree))).truth.position[0, :, 2]
    theirs = program_depths(robot, step, 288, round(100.0 / step))
    np.testing.assert_allclose(
        ours,
        theirs,
        rtol=0,
        atol=2.0 * step * robot["vertical_speed"] + 1e-5,
        err_msg=str(ours - theirs),
    )


@pytest.mark.parametrize("step", [1e-5, 1e-300])
def test_steps_that_no_mission_takes_are_refused(step, tmp_path):
    tree = simulation()
    tree["timing"] |= {"physics_dt": step, "end_time_hours": 168.0}
    line = f"timing.physics_dt is {step:g} s, .* steps in 168 h; allowed: at most 1e.08 steps"
    refused(StudyError, line, import_authors, write_simulation(tmp_path, tree))


def test_a_first_hold_is_at_the_start_depth(tmp_path):
    tree = simulation()
    tree["robots"][0] |= {"position": [0.0, 0.0, 40.0], "start_offset_seconds": 300.0}
    depth = mission_of(study_of(write_simulation(tmp_path, tree))).truth.position[0, :, 2]
    assert depth[:5] == pytest.approx([40.0, 40.0, 40.0, 40.0, 90.0], abs=1e-9)


def test_two_way_ranges_are_distances(tmp_path):
    tree = simulation()
    tree["acoustics"]["tof_mode"] = "two_way"
    config, lines = import_authors(write_simulation(tmp_path, tree))
    assert any("two_way: the program gives twice the distance" in line for line in lines)
    mission = mission_of(config)
    m, truth = mission.measurements, mission.ranging_truth
    np.testing.assert_allclose(m.refracted_range, truth.distance, rtol=0.02)


def test_poses_contain_pings_that_the_program_ties_to_earlier_ones(tmp_path):
    tree = simulation()
    tree["timing"] |= {"ping_interval_min": 25.0, "end_time_hours": 2.5}  # 1500 s, 9000 s
    for key in ("gt_freq_hz", "odom_freq_hz", "gps_freq_hz"):
        tree["sensors"][key] = 0.001
    config, lines = import_authors(write_simulation(tmp_path, tree))
    assert config.mission.sampling_period_s == 500.0
    assert any("ties ranges to earlier poses" in line for line in lines)
    # two edges of 500 s have the variance of one of 1000 s
    assert 2.0 * (config.noise.model.odometry_translation_drift * 500.0) ** 2 == pytest.approx(
        0.02**2
    )


def test_a_fleet_of_twelve_has_a_line(tmp_path):
    tree = simulation()
    tree["robots"] = [{**tree["robots"][0], "position": [100.0 * i, 0.0, 0.01]} for i in range(12)]
    config, lines = import_authors(write_simulation(tmp_path, tree))
    assert config.fleet.vehicles[11].name == "L"
    assert any("12th robot the letter L" in line for line in lines)
    tree["robots"] = [tree["robots"][0]] * 27
    refused(
        StudyError,
        "robots: found 27 entries; allowed: 26 or less",
        import_authors,
        write_simulation(tmp_path, tree),
    )


def test_multipath_takes_reflections_only_without_a_direct_arrival(tmp_path):
    tree = simulation()
    tree["acoustics"]["allow_multipath"] = True
    acoustics = study_of(write_simulation(tmp_path, tree)).acoustics
    assert acoustics.arrival == "direct-or-first"
    assert acoustics.max_surface_bounces > 0


def test_depths_that_the_program_does_not_reach_have_a_line(tmp_path):
    tree = simulation()
    tree["robots"][0]["target_depth"] = 1950.0
    _, lines = import_authors(write_simulation(tmp_path, tree))
    assert any("target_depth 1950 m is outside the water, z 0 to 1900 m" in line for line in lines)
    tree = simulation()
    tree["timing"]["physics_dt"] = 0.05
    _, lines = import_authors(write_simulation(tmp_path, tree))
    assert any("physics_dt is 0.05 s, and the program" in line for line in lines)
    tree["timing"]["physics_dt"] = 1.0
    _, lines = import_authors(write_simulation(tmp_path, tree))
    assert any("the program passes a depth by up to 0.5 m" in line for line in lines)


def test_a_float_outside_the_grid_of_the_current_has_a_line(tmp_path):
    path = write_simulation(tmp_path)
    for key, part, line in (
        ("x", slice(2, None), "x 0 to 9000 m"),
        ("z", slice(0, 3), "z 0 to 200 m"),
    ):
        sections = arrays()
        current = sections["current"]
        where = tuple(part if axis == key else slice(None) for axis in "xyz")
        shape = tuple(current[axis].size for axis in "xyz")
        current |= {name: current[name].reshape(shape)[where] for name in "uv"} | {
            key: current[key][part]
        }
        write_environment(tmp_path, sections)
        tree = simulation()
        tree["robots"][0]["position"] = [-500.0, 0.0, 0.01] if key == "x" else [500.0, 0.0, 0.01]
        path.write_text(json.dumps(tree))
        _, lines = import_authors(path)
        assert any(
            f"robots[0]: it leaves the grid of the current, {line}" in said for said in lines
        ), lines


def test_whole_numbers_may_have_a_point(tmp_path):
    tree = simulation() | {"rng_seed": 3.0}
    tree["acoustics"]["num_beams"] = 100.0
    assert study_of(write_simulation(tmp_path, tree)).study.seed == 3
    refused(
        StudyError,
        "rng_seed: found 3.5",
        import_authors,
        write_simulation(tmp_path, tree | {"rng_seed": 3.5}),
    )


REFUSED = {
    "`acoustics.beam_spred_deg`: unknown key. Did you mean `acoustics.beam_spread_deg`": (
        lambda t: t["acoustics"].update(beam_spred_deg=15)
    ),
    "`robot`: unknown key. Did you mean `robots`": lambda t: t.update(robot=[]),
    r"robots\[0\]: `depth`: unknown key": lambda t: t["robots"][0].update(depth=3.0),
    r"robots\[1\].type: found 'constant_speed'; allowed: 'constant_vel' or 'current_drift'": (
        lambda t: t["robots"][1].update(type="constant_speed")
    ),
    r"robots\[1\]: velocity: missing": lambda t: t["robots"][1].pop("velocity"),
    "env_config_file: missing": lambda t: t.pop("env_config_file"),
    "env_config_file: no file": lambda t: t.update(env_config_file="none.json"),
    "acoustics.tof_mode: found 'oneway'": lambda t: t["acoustics"].update(tof_mode="oneway"),
    "max_beams is 50, less than num_beams, 100": lambda t: t["acoustics"].update(max_beams=50),
    "dry_run is true": lambda t: t["acoustics"].update(dry_run=True),
    "sensors.odom_freq_hz is 3 Hz, 1.5 times the frequency of steps": (
        lambda t: t["sensors"].update(odom_freq_hz=3.0)
    ),
    "sensors.gt_freq_hz is 0.03 Hz": lambda t: t["sensors"].update(gt_freq_hz=0.03),
    r"vertical_speed: found -0.5; allowed: greater than 0": (
        lambda t: t["robots"][0].update(vertical_speed=-0.5)
    ),
    "target_depth is 0.005 m; it must be greater than surface_depth": (
        lambda t: t["robots"][0].update(target_depth=0.005)
    ),
    r"landmarks\[0\]: position 20000, 0, 50 is outside the grid, x -9000 to 9000 m": (
        lambda t: t.update(landmarks=[[2e4, 0.0, 50.0]])
    ),
    r"landmarks\[0\]: position 0, 0, 1950 is outside the water, z 0 to 1900 m": lambda t: t.update(
        landmarks=[[0.0, 0.0, 1950.0]]
    ),
    r"robots\[1\]: position .* outside the grid": (
        lambda t: t["robots"][1].update(position=[0.0, -9e3, 5.0])
    ),
    "would give odometry to wrong poses": lambda t: (
        t["sensors"].update(odom_freq_hz=0.02),
        t["pfg"].update(use_ground_truth_odometry=False),
    ),
    "timing.ping_interval_min is 150 min, longer than end_time_hours, 2 h": (
        lambda t: t["timing"].update(ping_interval_min=150)
    ),
    "range_variance: found 0": lambda t: t["pfg"].update(range_variance=0),
}  # fmt: skip


@pytest.mark.parametrize("line", REFUSED)
def test_what_the_program_refuses_or_cannot_use_is_refused(line, tmp_path):
    tree = simulation()
    REFUSED[line](tree)
    refused(MantaRayError, line, import_authors, write_simulation(tmp_path, tree))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("{", "not valid JSON"),
        ('{"a": 1, "a": 2}', "key 'a' occurs twice"),
        ("[1]", "found list; it must be a table"),
        ('{"rng_seed": NaN}', "NaN is not a number of JSON"),
        ("[" * 100_000, "not valid JSON"),
    ],
)
def test_what_is_no_configuration_is_refused(text, line, tmp_path):
    (tmp_path / "sim.json").write_text(text)
    refused(StudyError, line, import_authors, tmp_path / "sim.json")


def test_files_of_a_configuration_are_regular(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    refused(StudyError, "pipe.json: not a regular file", import_authors, tmp_path / "pipe.json")
    for name in ("/dev/zero", str(tmp_path / "pipe.json"), str(tmp_path)):
        path = write_simulation(tmp_path, simulation() | {"env_config_file": name})
        refused(MantaRayError, "not a regular file|is a folder", import_authors, path)
    for name in ("n" * 5000, "a\0b"):
        path = write_simulation(tmp_path, simulation() | {"env_config_file": name})
        refused(StudyError, "env_config_file: no file", import_authors, path)


def test_land_and_robots_that_leave_have_a_line(tmp_path):
    tree = simulation()
    tree["robots"][1]["velocity"] = [2.0, 0.0, 0.0]
    path = write_simulation(tmp_path, tree)
    land = arrays()
    land["bathymetry"]["data"][0, 0] = -2.5
    land["ssp"]["data"][0, 0] = np.nan
    write_environment(tmp_path, land)
    config, lines = import_authors(path)
    assert any("the water has land, at which the program stops" in line for line in lines)
    assert any("robots[1]: its last position is outside the grid" in line for line in lines)
    assert mission_of(config).truth.status[1, -1] != 0


def test_beliefs_about_water_in_metres(tmp_path):
    """
    With the file of the true water, the estimate is that of the exact water; in other water it is
    not.
    """
    study_file(tmp_path)
    model = "range_model = {{ kind = 'eigenray', belief = {} }}"
    beliefs = {
        "exact": "'exact'",
        "file": "{ kind = 'file', source = 'environment.json' }",
        "mean": "'mean'",
        "cast": "'cast'",
        "offset": "{ kind = 'offset', sound_speed = [1.0] }",
        "numerics": "{ kind = 'numerics', every_level = 2 }",
    }
    text = 'base = "two.toml"\n[study]\nrealizations = 1\n'
    text += "".join(
        f"[conditions.{name}]\n{model.format(belief)}\n" for name, belief in beliefs.items()
    )
    (tmp_path / "mine.toml").write_text(text)
    run = run_study(load_study(tmp_path / "mine.toml"), tmp_path / "run", workers=1)
    position = {
        name: run.estimates.position[run.estimates.condition.tolist().index(name)]
        for name in beliefs
    }
    np.testing.assert_array_equal(position["file"], position["exact"])
    # a cast at the middle of the grid, and its mean, lack only the gradients along x and y
    cost = dict(zip(run.estimates.condition.tolist(), run.estimates.final_cost[:, 0], strict=True))
    for name in ("mean", "cast", "numerics"):
        assert cost[name] != cost["exact"], name
        assert np.abs(position[name] - position["exact"]).max() < 20.0, name
    assert np.abs(position["offset"] - position["exact"]).max() > 0.5


@pytest.mark.parametrize(
    "belief",
    [
        "{ kind = 'perturbed', rms = 1.0, horizontal_scale = 5e3, down_to = 300.0 }",
        "{ kind = 'other-day', days_earlier = 5.0 }",
        "{ kind = 'numerics', equation = 'unesco' }",
        "{ kind = 'cast', down_to = 100.0 }",
    ],
)
def test_beliefs_that_need_temperature_are_refused_in_water_in_metres(belief, tmp_path):
    study_file(tmp_path)
    text = (
        f"base = 'two.toml'\n[conditions.one]\nrange_model = {{ kind = 'eigenray', belief ="
        f" {belief} }}\n"
    )
    (tmp_path / "mine.toml").write_text(text)
    config = load_study(tmp_path / "mine.toml")
    refused(OceanError, "water in metres has no", run_study, config, tmp_path / "run", workers=1)


def test_a_toml_file_can_change_a_configuration_of_the_program(tmp_path):
    study_file(tmp_path)
    (tmp_path / "mine.toml").write_text('base = "two.toml"\n[mission]\nduration_h = 1.0\n')
    config = load_study(tmp_path / "mine.toml")
    assert (config.mission.duration_h, config.fleet.vehicles[0].name) == (1.0, "A")


def test_exported_files_define_the_same_study(tmp_path):
    path = write_simulation(tmp_path)
    folder, _ = export_authors(study_of(path), tmp_path / "out")
    again, first = study_of(folder / "sim.json"), study_of(path)
    for section in ("study", "mission", "acoustics", "ranging", "noise", "fleet", "landmarks"):
        assert getattr(again, section) == getattr(first, section), section
    ours, theirs = read_arrays(folder / "environment.json"), arrays()
    for section, fields in theirs.items():
        for key, values in fields.items():
            np.testing.assert_array_equal(ours[section][key], values)


def test_water_that_a_study_changes_is_exported_as_changed(tmp_path):
    path = write_simulation(tmp_path)
    smaller = {"ocean.half_extent_north": 3000.0, "ocean.half_extent_east": 3000.0}
    for k, change in enumerate([{"ocean.bathymetry": FLOOR - 300.0}, smaller]):
        folder, _ = export_authors(study_of(path).with_(**change), tmp_path / str(k))
        ours = read_arrays(folder / "environment.json")["bathymetry"]
        np.testing.assert_allclose(ours["data"], change.get("ocean.bathymetry", FLOOR))
        assert (ours["x"][0] > -9e3) == (change is smaller)


def test_a_run_is_exported_as_its_files_or_without_them(tmp_path):
    path = write_simulation(tmp_path)
    theirs = arrays()
    axes = {"x": np.array([-9e3, 9e3]), "y": np.array([-8e3, 8e3]), "z": np.array([0.0, 2e3])}
    theirs["current"] = axes | dict.fromkeys("uv", np.zeros((2, 2, 2)))
    write_environment(tmp_path, theirs)
    config = study_of(path).with_(**{"mission.duration_h": 0.5})
    run = run_in_memory(build_study(config), mission_of(config))
    files, _ = export_authors(run, tmp_path / "files")
    (tmp_path / "environment.json").unlink()
    none, _ = export_authors(run, tmp_path / "none")
    same, ours = (read_arrays(folder / "environment.json") for folder in (files, none))
    assert same["current"]["z"].tolist() == [0.0, 2e3]
    levels = theirs["ssp"]["z"].size
    np.testing.assert_allclose(ours["ssp"]["data"][..., :levels], theirs["ssp"]["data"])
    assert ours["current"]["z"].size >= levels, "on the grid of the run"


def test_a_preset_becomes_files_of_the_program(tmp_path):
    """The 12th vehicle is a landmark's letter there, but the quick study has eleven."""
    config = load_study("quick", **{"mission.duration_h": 4.0})
    folder, _ = export_authors(config, tmp_path / "out")
    robots = json.loads((folder / "sim.json").read_text())["robots"]
    assert len(robots) == len(config.fleet.vehicles)
    for robot, vehicle in zip(robots, build_vehicles(config.fleet), strict=True):
        east, north, depth = robot["position"]
        assert [north, east, depth] == vehicle.position.tolist()
    again = study_of(folder / "sim.json")
    a, b = (mission_of(c).truth.position for c in (config, again))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)  # the same water on the same grid


UNKNOWN = {
    "the program has no robot that moves like it": {
        "fleet": {"vehicles": [{"name": "A", "kind": "waypoints", "north": 0.0, "east": 0.0,
                                "depth": 5.0,
                                "points": [[100.0, 0.0, 5.0]], "speed": 1.0}]}
    },
    "mission.schedule: the program pings at one interval": {
        "mission.schedule": {"kind": "slots", "slots": ["A"], "slot_s": 400.0}
    },
    "ocean.ice: the program has no ice": {"ocean.ice": 2.0},
    "ocean.time_varying: the water of the program is constant": {"ocean.time_varying": True},
}  # fmt: skip


@pytest.mark.parametrize("line", UNKNOWN)
def test_what_the_program_does_not_have_is_not_exported(line, tmp_path):
    refused(
        ExchangeError, line, export_authors, load_study("quick", **UNKNOWN[line]), tmp_path / "out"
    )
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def imported():
    if not (RUN / "sim.json").is_file():
        pytest.skip(f"no {RUN}")
    return mission_of(study_of(RUN / "sim.json"))


def test_the_run_has_the_same_poses(imported):
    """
    A hold with one step more or less would move a float by 0.4 or 0.5 m where it rises or dives
    after it.
    """
    for k, path in enumerate(imported.truth.position):
        theirs = np.loadtxt(
            RUN / "output" / f"robot_{k}_{k}_GroundTruthPose.csv",
            delimiter=",",
            skiprows=1,
            usecols=(0, 1, 2, 3),
        )
        np.testing.assert_array_equal(theirs[:, 0], imported.truth.time)
        np.testing.assert_allclose(path[:, [1, 0]], theirs[:, 1:3], rtol=0, atol=0.05)
        np.testing.assert_allclose(path[:, 2], theirs[:, 3], rtol=0, atol=0.1)


def test_the_run_has_the_same_factors(imported):
    words = Counter(
        line.split()[0] for line in (RUN / "output" / "output.pfg").read_text().splitlines()
    )
    m = imported.measurements
    assert m.depth.size == words["VERTEX_SE3:QUAT"]
    assert m.odometry_sigma.shape[0] * m.odometry_sigma.shape[1] == words["EDGE_SE3:QUAT"]
    assert m.gnss_vehicle.size + m.name.size == words["VERTEX_SE3:QUAT:PRIOR"]
    assert m.landmark_name.size == words["VERTEX_XYZ:PRIOR"]


@pytest.fixture(scope="module")
def compared(imported):
    """Range of ours and of theirs by sample, transmitter and receiver."""
    m, time = imported.measurements, imported.truth.time
    names = [*m.name.tolist(), *m.landmark_name.tolist()]
    lines = (line.split() for line in (RUN / "output" / "output.pfg").read_text().splitlines())
    theirs = {
        (float(f[1]), *(end if end[0] == "L" else end[0] for end in f[2:4])): float(f[4])
        for f in lines
        if f[0] == "EDGE_RANGE"
    }
    rows = np.flatnonzero(m.range_status == RayStatus.OK)
    ends = m.range_sample[rows], m.range_transmitter[rows], m.range_receiver[rows]
    ours = {
        (float(time[s]), names[a], names[b]): r
        for s, a, b, r in zip(*ends, m.refracted_range[rows], strict=True)
    }
    assert ours.keys() == theirs.keys()
    return {key: (ours[key], theirs[key]) for key in ours}


def test_the_run_has_the_same_ranges(compared):
    """
    Six ranges of theirs are shorter: their beams pass the receiver by tens of metres, and carry
    their own travel time.
    """
    assert len(compared) == 70
    later = np.array([ours - theirs for ours, theirs in compared.values()])
    assert np.count_nonzero(np.abs(later) < 0.1) == 64
    assert np.abs(np.median(later)) < 0.03
    beyond = later[np.abs(later) >= 0.1]
    assert np.all((beyond > 0.3) & (beyond < 6.0))


@pytest.mark.slow
def test_an_independent_fan_has_our_ranges_where_theirs_differ(imported, compared):
    """The steps of the fan do not end at the levels, where the gradient jumps: centimetres."""
    speed = read_arrays(RUN / "environment.json")["ssp"]
    axes = speed["x"], speed["y"], speed["z"]
    m, time = imported.measurements, imported.truth.time

    def place(name, at):
        if name in m.landmark_name:
            return np.array(json.loads((RUN / "sim.json").read_text())["landmarks"][int(name[1:])])
        row = m.name.tolist().index(name)
        return imported.truth.position[row, np.searchsorted(time, at)][[1, 0, 2]]

    differ = [key for key, (ours, theirs) in compared.items() if abs(ours - theirs) > 0.1]
    assert len(differ) == 6
    for at, transmitter, receiver in differ[::3]:
        source = place(transmitter, at)
        c = RegularGridInterpolator(axes, speed["data"])(source)[0]
        fan = c * first_direct_time(axes, speed["data"], source, place(receiver, at))
        assert abs(fan - compared[at, transmitter, receiver][0]) < 0.02, (
            at,
            transmitter,
            receiver,
            fan,
        )


def test_the_run_is_exported_byte_by_byte(tmp_path):
    if not (RUN / "sim.json").is_file():
        pytest.skip(f"no {RUN}")
    folder, _ = export_authors(study_of(RUN / "sim.json"), tmp_path / "out")
    for path in RUN.glob("environment/**/*.npy"):
        assert (folder / path.relative_to(RUN)).read_bytes() == path.read_bytes()
