"""Configuration: the paper's tables, strictness at every level, and one clear line for each fault."""

import itertools
import math
import tomllib

import pytest

from pymantaray.errors import StudyError
from pymantaray.study import list_presets, load_study, parse_study, preset_text, study_toml
from pymantaray.study.config import FloatVehicle, StationVehicle

PAPER_TARGETS = {
    "G": 250, "B": 500, "D": 750, "I": 1000, "K": 1250, "F": 1500, "J": 1750, "C": 2000, "E": 2250, "H": 2500,
}  # fmt: skip


@pytest.fixture
def quick():
    return tomllib.loads(preset_text("quick"))


def refusal(tree):
    with pytest.raises(StudyError) as caught:
        parse_study(tree, "my.toml")
    return str(caught.value)


@pytest.mark.parametrize("name", ["beaufort", "fram"])
def test_presets_hold_the_papers_tables(name):
    config = load_study(name)
    mission, noise, floats = config.mission, config.noise, config.fleet.floats
    assert (mission.duration_h, mission.physics_step_s) == (168, 0.125)
    assert (mission.sampling_period_s, mission.ping_interval_h) == (200, 4)
    assert (floats.hold_depth_h, floats.hold_surface_h, floats.vertical_speed) == (24, 1, 0.5)
    assert config.study.realizations == 25
    assert (noise.range_sigma, noise.depth_sigma, noise.gnss_sigma) == (1.0, 0.01, 0.10)
    assert (noise.odometry_rotation_fraction, noise.odometry_rotation_drift) == (1e-6, 5e-7)
    assert (noise.odometry_xy_fraction, noise.odometry_z_fraction) == (0.05, 0.001)
    assert noise.odometry_translation_drift == 0.0125
    targets = {v.name: v.target_depth for v in config.fleet.vehicles if isinstance(v, FloatVehicle)}
    assert targets == PAPER_TARGETS
    assert [v.name for v in config.fleet.vehicles if isinstance(v, StationVehicle)] == ["A"]


def test_paper_presets_differ_in_nothing_but_the_region():
    beaufort, fram = load_study("beaufort"), load_study("fram")
    same = {"study": beaufort.study, "ocean": beaufort.ocean}
    assert fram.model_copy(update=same) == beaufort
    assert (beaufort.ocean.centre, fram.ocean.centre) == ((74.5, -140.0), (78.0, 0.0))


def test_grid_spans_2_to_12_km_around_the_station_keeper():
    places = {v.name: (v.north, v.east) for v in load_study("beaufort").fleet.vehicles}
    distances = [math.dist(a, b) for a, b in itertools.combinations(places.values(), 2)]
    assert len(distances) == 55
    assert min(distances) == 2000
    assert max(distances) == 12000
    for axis in (0, 1):
        assert math.fsum(place[axis] for place in places.values()) == places["A"][axis] == 0


def test_defaults_are_the_presets_values():
    """What a file leaves out is what the paper has, so a bare file is a study of the paper's kind."""
    full = load_study("beaufort")
    tree = tomllib.loads(preset_text("beaufort"))
    for section in ("mission", "noise", "acoustics", "estimator"):
        del tree[section]
    del tree["fleet"]["floats"]
    for key in ("seed", "realizations", "conditions"):
        del tree["study"][key]
    assert parse_study(tree) == full


@pytest.mark.parametrize("name", list_presets())
def test_resolved_configuration_reads_back_equal(name):
    config = load_study(name)
    assert parse_study(tomllib.loads(study_toml(config))) == config


@pytest.mark.parametrize("section", ["study", "ocean", "mission", "acoustics", "noise", "estimator", "fleet"])
def test_unknown_key_is_refused_at_every_level(quick, section):
    quick[section]["surprise"] = 1
    line = refusal(quick)
    assert line.startswith(f"my.toml: {section}.surprise: unknown key")
    assert "\n" not in line


def test_unknown_key_suggests_the_nearest(quick):
    quick["fleet"]["vehicles"][1]["target_dept"] = 3.0
    assert "fleet.vehicles[1].target_dept: unknown key; did you mean target_depth?" in refusal(quick)


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (("study", "realizations"), 0, "study.realizations: found 0; allowed: 1 or more"),
        (("study", "seed"), -1, "study.seed: found -1; allowed: 0 or more"),
        (("study", "conditions"), ["curved"], "study.conditions[0]: found 'curved'; allowed: 'odometry', "),
        (("study", "conditions"), ["straight", "straight"], "conditions must differ; found straight more than once"),
        (("study", "conditions"), [], "study.conditions: found 0 entries; allowed: at least 1"),
        (("study", "name"), "a/b", "study.name: found 'a/b'; allowed: text that matches"),
        (("fleet", "vehicles", 1, "target_depth"), -5.0, "vehicles[1].target_depth: found -5.0; allowed: 0 or more"),
        (("fleet", "vehicles", 1, "kind"), "boat", "fleet.vehicles[1].kind: found 'boat'; allowed: 'float', "),
        (("fleet", "vehicles", 1, "name"), "A", "vehicle names must differ; found A more than once"),
        (("fleet", "vehicles", 1, "name"), "L", "fleet.vehicles[1].name: found 'L'; allowed: text that matches"),
        (("mission", "ping_interval_h"), 0.1, "ping_interval_h is 360 s; it must be a whole multiple of"),
        (("mission", "physics_step_s"), 0.3, "sampling_period_s is 200 s; it must be a whole multiple of"),
        (("mission", "duration_h"), 2.0, "duration_h is 7200 s; it must not be less than ping_interval_h"),
        (("noise", "range_sigma"), 0.0, "noise.range_sigma: found 0.0; allowed: greater than 0"),
        (("noise", "range_sigma"), math.inf, "noise.range_sigma: found inf"),
        (("noise", "range_sigma"), "1", "noise.range_sigma: found '1'"),
        (("study", "realizations"), 2.5, "study.realizations: found 2.5"),
        (("ocean", "source"), [], "ocean.source: found 0 entries"),
        (("ocean", "half_extent_north"), 1e4, "half_extent_north and half_extent_east must be given together"),
    ],
)  # fmt: skip
def test_each_bad_value_is_one_line_with_place_found_and_allowed(quick, path, value, expected):
    *parents, last = path
    node = quick
    for key in parents:
        node = node[key]
    node[last] = value
    line = refusal(quick)
    assert "\n" not in line
    assert line.startswith("my.toml: ")
    assert expected in line


def test_several_faults_are_several_lines(quick):
    quick["study"]["realizations"] = 0
    del quick["ocean"]["source"]
    lines = refusal(quick).splitlines()
    assert len(lines) == 2
    assert lines[1] == "my.toml: ocean.source: missing; it has no default"


def test_configuration_is_frozen():
    config = load_study("quick")
    with pytest.raises(ValueError, match="frozen"):
        config.study.realizations = 5


def test_unknown_preset_lists_those_there_are():
    with pytest.raises(
        StudyError,
        match=r"no preset 'fast'; there are beaufort, estimators-beaufort, estimators-fram, fram, quick, survey",
    ):
        load_study("fast")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "mine.toml: cannot be read: No such file"),
        (b"\xff", "mine.toml: cannot be read: not UTF-8 text"),
        (b"[study\n", "mine.toml: not valid TOML: Expected"),
        (
            b"a = " + b"[" * 3000 + b"]" * 3000,
            "mine.toml: not valid TOML: a number is too long, or tables are nested",
        ),
        (b"a = " + b"9" * 5000, "mine.toml: not valid TOML: a number is too long, or tables are nested"),
        (b".".join([b"a"] * 3000) + b" = 1", "mine.toml: a: unknown key"),
        (b"[study]\nname = " + b"[" * 90 + b"]" * 90, "mine.toml: study.name: found [[[[[[[...]]]]]]]"),
        (b'[study]\nname = "' + b"/" * 9999 + b'"', "mine.toml: study.name: found '///////"),
        (b"[study]\nseed = -" + b"9" * 4000, "mine.toml: study.seed: found -99999"),
    ],
    ids=[
        "none",
        "not UTF-8",
        "broken",
        "nested",
        "long number",
        "long key",
        "nested value",
        "long text",
        "long value",
    ],
)
def test_files_that_are_no_configuration_are_named_in_short_lines(tmp_path, content, expected):
    if content is not None:
        (tmp_path / "mine.toml").write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_study(tmp_path / "mine.toml")
    assert expected in str(caught.value)
    assert max(len(line.replace(str(tmp_path), "")) for line in str(caught.value).splitlines()) < 250


def test_names_that_no_file_can_have_and_files_without_an_end_are_refused(quick):
    with pytest.raises(StudyError, match=r"'a\\x00\.toml': cannot be read: embedded null"):
        load_study("a\0.toml")
    with pytest.raises(StudyError, match="/dev/zero: cannot be read: more than"):
        load_study("/dev/zero")
    quick["ocean"]["source"] = ["a\0.nc"]
    assert r"ocean.source[0]: found 'a\x00.nc', which no file can be named" in refusal(quick)


def test_configuration_prints_as_one_short_line():
    config = load_study("quick")
    assert str(config) == repr(config)
    assert repr(config) == (
        "<StudyConfig quick: 11 vehicles, 24 h, 3 realizations, ocean synthetic:beaufort>"
    )


def test_ocean_files_are_relative_to_the_configuration(tmp_path):
    tree = preset_text("quick").replace('"synthetic:beaufort"', '["a.nc", "/abs/b.nc"]')
    (tmp_path / "mine.toml").write_text(tree)
    config = load_study(tmp_path / "mine.toml")
    assert config.ocean.files == (str(tmp_path / "a.nc"), "/abs/b.nc")


def test_ocean_files_of_a_parsed_tree_are_relative_to_the_working_folder(quick, tmp_path, monkeypatch):
    """Whoever reads the configuration in the run's folder has to find them."""
    monkeypatch.chdir(tmp_path)
    quick["ocean"].update(source=["a.nc", "/abs/b.nc"], bathymetry="c.nc")
    config = parse_study(quick)
    assert config.ocean.files == (str(tmp_path / "a.nc"), "/abs/b.nc", str(tmp_path / "c.nc"))
    assert parse_study(tomllib.loads(study_toml(config)), folder=tmp_path / "elsewhere") == config


def test_overrides_replace_realizations_and_ocean(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = load_study("quick", realizations=7, ocean=["x.nc"])
    assert config.study.realizations == 7
    assert config.ocean.files == (str(tmp_path / "x.nc"),)
    with pytest.raises(StudyError, match=r"quick: study\.realizations: found 0; allowed: 1 or more"):
        load_study("quick", realizations=0)
