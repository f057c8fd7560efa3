"""Old names of keys: read with a message, refused beside the new ones, listed on the migration page."""

import re
import warnings
from pathlib import Path

import pytest
from factories import TINY
from refusals import refused

from pymantaray.config.renamed import NEW_VALUES, RENAMED, new_key, with_new_names
from pymantaray.errors import StudyError
from pymantaray.study import load_sound, load_study, open_run, parse_study, study_toml
from pymantaray.sweep.definition import parse_sweep

MIGRATION = Path(__file__).parents[2] / "docs" / "reference" / "migration.md"
OLD = """
[study]
name = "old"

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
    assert config.estimators[0].belief.source == (str(tmp_path / "sea.nc"),)
    assert config.estimators[0].uncertainty == (1.0, 2e4, 300.0)
    assert config.estimators[1].solver.lag_h == 8.0
    (message,) = caught
    for before, after in RENAMED.items():
        assert f"`{before}` is now `{after}`" in str(message.message)
    (tmp_path / "new.toml").write_text(study_toml(config))
    assert load_study(tmp_path / "new.toml") == config


def test_bases_dotted_keys_sweeps_and_sound_take_old_names(old):
    mine = old.with_name("mine.toml")
    mine.write_text(
        'base = "old.toml"\n[ocean]\ncentre_lat = 75.0\n[estimators.e]\nbelief.source = "own.nc"\n'
    )
    with pytest.warns(FutureWarning, match="centre_lat"):
        config = load_study(
            mine, **{"ranging.clock_offset_sigma": "2 ms", "estimators.e.belief.path": "x.nc"}
        )
    assert (config.ocean.centre, config.noise.clock_offset_sigma) == ((75.0, -140.0), 2e-3)
    assert config.estimators[0].belief.source == (str(Path("x.nc").resolve()),)
    text = 'base = "quick"\ncross."estimator.initialise" = ["truth", "dead-reckoning"]\n'
    points = [parse_sweep(text, "s.toml", Path()).point(n).estimator.start for n in (0, 1)]
    assert points == ["truth", "dead-reckoning"]
    alone = old.with_name("alone.toml")
    alone.write_text('[ocean]\nsource = "sea.nc"\ncentre_latitude_deg = 1.0\ncentre_longitude_deg = 2.0\n')
    with pytest.warns(FutureWarning, match="centre_lat"):
        assert load_sound(alone).ocean.centre == (1.0, 2.0)


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
    rows = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|$", MIGRATION.read_text(), re.MULTILINE)
    values = {
        f'{key} = "{a}"': f'{key} = "{b}"' for key, pairs in NEW_VALUES.items() for a, b in pairs.items()
    }
    assert dict(rows) == RENAMED | values
    assert len(rows) == len(dict(rows))


def test_new_names_are_keys():
    for new in RENAMED.values():
        if "*" not in new:
            with pytest.raises(StudyError) as caught:
                load_study("quick", **{new: {"x": 1}})
            assert "unknown key" not in str(caught.value)


def test_old_text_has_every_old_name():
    for old in RENAMED:
        assert old.rpartition(".")[2] in OLD
