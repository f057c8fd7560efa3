"""Old names of keys: read with a message, refused beside the new ones, listed on the migration page."""

import re
import warnings
from pathlib import Path

import pytest
from factories import TINY
from refusals import refused

from pymantaray.config import convert_study
from pymantaray.config.renamed import NEW_VALUES, RENAMED, new_key, with_new_names
from pymantaray.errors import StudyError
from pymantaray.study import load_sound, load_study, open_run, parse_study, study_toml
from pymantaray.sweep.definition import parse_sweep

LISTS = {"study.conditions": "conditions", "estimators": "conditions"}  # two former lists are one now
MIGRATION = Path(__file__).parents[2] / "docs" / "reference" / "migration.md"
OLD = """
[study]
name = "old"
conditions = ["odometry", "refracted"]

[ocean]
source = "synthetic:beaufort"
centre_latitude_deg = 74.5
centre_longitude_deg = -140.0
ice = 1.0

[acoustics]
spreading_cutoff_db = "off"
max_surface_bounces = 1
max_bottom_bounces = 1

[detection]
source_level_db = 185.0
frequency_hz = 25e3
bandwidth_hz = 5e3
surface_loss = "none"
ice_loss_db = 3.0
sediment = "sand"

[ranging]
clock_offset_sigma = 1e-3
clock_skew_sigma = 1e-6
mistaken = "off"

[estimator]
initialise = "dead-reckoning"

[[fleet.vehicles]]
name = "A"
kind = "station"
north = 0.0
east = 0.0

[[estimators]]
name = "e"
range_model = "eigenray"
belief = { kind = "file", path = "sea.nc" }
variance = "per-link"
uncertainty_rms = 1.0
uncertainty_horizontal_scale = 2e4
uncertainty_down_to = 300.0

[[estimators]]
name = "lag"
solver = "fixed-lag"
lag_h = 8.0

[[estimators]]
name = "one-speed"
range_model = "constant"
sound_speed = 1500.0
start = "dead-reckoning"

[[estimators]]
name = "water-too"
range_model = "eigenray"
belief = { kind = "mean" }
modes = { count = 2 }
"""


@pytest.fixture
def old(tmp_path):
    (tmp_path / "old.toml").write_text(OLD)
    return tmp_path / "old.toml"


def test_a_file_with_old_names_is_the_same_study_and_says_the_new_ones(old, tmp_path):
    with pytest.warns(FutureWarning, match="old.toml: ") as caught:
        config = load_study(old)
    assert config.ocean.centre == (74.5, -140.0)
    assert (config.noise.clock_offset_sigma, config.noise.clock_skew_sigma) == (1e-3, 1e-6)
    assert (config.acoustics.cutoff_db, config.ranging.mistaken) == (None, "none")
    assert (config.acoustics.ice_loss_db, config.acoustics.sediment) == (3.0, "sand")
    assert config.estimator.start == "dead-reckoning"
    assert config.conditions[2].belief.source == (str(tmp_path / "sea.nc"),)
    assert config.conditions[2].uncertainty == (1.0, 2e4, 300.0)
    assert config.conditions[3].solver.lag_h == 8.0
    assert config.conditions[4].range_model.sound_speed == 1500.0
    assert config.conditions[5].modes.count == 2
    # estimators started at the truth, whatever conditions did
    assert [c.start for c in config.conditions] == [None, None, "truth", "truth", "dead-reckoning", "truth"]
    messages = " ".join(str(message.message) for message in caught)
    for before, after in (RENAMED | LISTS).items():
        assert f"`{before}` is now `{after}`" in messages
    (tmp_path / "new.toml").write_text(study_toml(config))
    assert load_study(tmp_path / "new.toml") == config


def test_bases_dotted_keys_sweeps_and_sound_take_old_names(old):
    mine = old.with_name("mine.toml")
    mine.write_text(
        'base = "old.toml"\n[ocean]\ncentre_lat = 75.0\n[estimators.e]\nbelief.source = "own.nc"\n'
    )
    with pytest.warns(FutureWarning) as caught:
        config = load_study(
            mine, **{"ranging.clock_offset_sigma": "2 ms", "estimators.e.belief.path": "x.nc"}
        )
    assert any("centre_lat" in str(message.message) for message in caught)
    assert [c.name for c in config.conditions[:3]] == ["odometry", "refracted", "e"]
    assert (config.ocean.centre, config.noise.clock_offset_sigma) == ((75.0, -140.0), 2e-3)
    assert config.conditions[2].belief.source == (str(Path("x.nc").resolve()),)
    text = 'base = "quick"\ncross."estimator.initialise" = ["truth", "dead-reckoning"]\n'
    points = [parse_sweep(text, "s.toml", Path()).point(n).estimator.start for n in (0, 1)]
    assert points == ["truth", "dead-reckoning"]
    alone = old.with_name("alone.toml")
    alone.write_text('[ocean]\nsource = "sea.nc"\ncentre_latitude_deg = 1.0\ncentre_longitude_deg = 2.0\n')
    with pytest.warns(FutureWarning, match="centre_lat"):
        assert load_sound(alone).ocean.centre == (1.0, 2.0)


LANDMARK = '[[landmarks]]\nname = "L"\nnorth = "1 km"\neast = 0.0\ndepth = 9.0\n'


@pytest.mark.parametrize("text", [
    OLD,
    OLD.replace('conditions = ["odometry", "refracted"]', ""),
    'base = "estimators-fram"\n[estimators.eigenray]\nloss = "huber"\n' + LANDMARK,
    'base = "estimators-fram"\n[[estimators]]\nname = "mine"\nrange_sigma = 5.0\n',
    'base = "quick"\n[study]\nconditions = []\n',
], ids=["both", "estimators", "by name", "list", "none"])  # fmt: skip
def test_an_old_file_is_rewritten_with_the_new_names(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.warns(FutureWarning):
        config = load_study(file)
    file.write_text(convert_study(file))
    assert load_study(file) == config


def test_of_a_file_that_is_no_study_nothing_is_rewritten(tmp_path):
    sound = tmp_path / "sound.toml"
    sound.write_text('[ocean]\nsource = "sea.nc"\ncentre_latitude_deg = 1.0\ncentre_longitude_deg = 2.0\n')
    with pytest.warns(FutureWarning):
        assert "centre_lat = 1.0" in convert_study(sound)
    sound.write_text('[ocean]\nsource = "sea.nc"\nsauce = 3\n')
    refused(StudyError, r"sound.toml: `ocean.sauce`: unknown key", convert_study, sound)
    refused(StudyError, "nowhere.toml: no such file", convert_study, "nowhere.toml")


def test_an_old_name_beside_the_new_one_is_one_line(tiny):
    refused(
        StudyError,
        "`ocean.centre_latitude_deg` is the old name of `ocean.centre_lat`, and both are given",
        parse_study,
        {**TINY, "ocean": {**TINY["ocean"], "centre_latitude_deg": 3.0}},
    )


def test_a_run_folder_with_old_names_is_read_in_silence(old, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.toml").write_text(OLD)
    (tmp_path / "run" / "manifest.json").write_text('{"format": 2}')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = open_run(tmp_path / "run")
        assert run.config.ocean.centre == (74.5, -140.0)


def test_nothing_is_changed_in_place_and_new_names_stay_as_they_are():
    assert with_new_names(TINY, "tiny") == TINY
    tree = {"ranging": {"clock_offset_sigma": 1.0}, "noise": {"range_sigma": 2.0}}
    with pytest.warns(FutureWarning, match="clock_offset_sigma"):
        new = with_new_names(tree, "tree")
    assert new == {"ranging": {}, "noise": {"range_sigma": 2.0, "clock_offset_sigma": 1.0}}
    assert tree["ranging"] == {"clock_offset_sigma": 1.0}
    assert new_key("noise.range_sigma") == "noise.range_sigma"
    for what_is_no_study in ([], {"ocean": 5}, {"estimators": 3}, {"estimators": [1]}):
        assert with_new_names(what_is_no_study, "x") == what_is_no_study


def test_the_migration_page_lists_every_old_name_once():
    page = MIGRATION.read_text().partition("## Keys of a study file")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|$", page, re.MULTILINE)
    values = {
        f'{key} = "{a}"': f'{key} = "{b}"' for key, pairs in NEW_VALUES.items() for a, b in pairs.items()
    }
    assert dict(rows) == RENAMED | LISTS | values
    assert len(rows) == len(dict(rows))


def test_new_names_are_keys():
    for new in RENAMED.values():
        if "*" not in new:
            with pytest.raises(StudyError) as caught:
                load_study("quick", **{new: {"x": 1}})
            assert "unknown key" not in str(caught.value)


def names_of(tree):
    return [c.name for c in parse_study({**TINY, **tree}).conditions]


@pytest.mark.parametrize(("old", "expected"), [
    ({"study": {"name": "s"}, "estimators": [{"name": "e"}]}, ["odometry", "straight", "refracted", "e"]),
    ({"study": {"name": "s", "conditions": []}, "estimators": [{"name": "e"}]}, ["e"]),
    ({"study": {"name": "s", "conditions": []}}, []),
    ({"study": {"name": "s"}, "estimators": "none"}, ["odometry", "straight", "refracted"]),
    ({"study": {"name": "s"}, "conditions": ["odometry", {"name": "b"}], "estimators": {"e": {}}}, ["odometry", "b", "e"]),
    ({"study": {"name": "s"}, "conditions": ["odometry", {"name": "b"}], "estimators": [{"name": "e"}]}, ["odometry", "e"]),
    ({"study": {"name": "s", "conditions": ["straight"]}, "conditions": ["odometry", {"name": "b"}]}, ["straight", "b"]),
], ids=str)  # fmt: skip
def test_the_two_old_lists_are_one(old, expected):
    tree = {key: value for key, value in TINY.items() if key != "conditions"} | old
    with pytest.warns(FutureWarning, match="is now `conditions`"):
        config = parse_study(tree)
    assert [c.name for c in config.conditions] == expected
    assert parse_study(config.model_dump(exclude_none=True)) == config


def test_a_list_of_conditions_replaces_the_standard_one_and_tables_change_it():
    assert names_of({"conditions": ["odometry", {"name": "e"}]}) == ["odometry", "e"]
    tables = {"e": {"range_sigma": 5.0}, "straight": "none", "odometry": {"start": "dead-reckoning"}}
    config = parse_study({**TINY, "conditions": tables})
    assert [c.name for c in config.conditions] == ["odometry", "refracted", "e"]
    assert config.conditions[0].start == "dead-reckoning"
    assert names_of({"conditions": "none"}) == []


@pytest.mark.parametrize("odd", [3, "odd", [3], {"e": 3}])
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_odd_values_of_old_lists_are_refused(odd):
    for tree in ({"estimators": odd}, {"study": {"name": "s", "conditions": odd}}, {"conditions": odd}):
        with pytest.raises(StudyError):
            parse_study({**TINY, **tree})


def test_old_text_has_every_old_name():
    for old in RENAMED | LISTS:
        assert old.rpartition(".")[2] in OLD
