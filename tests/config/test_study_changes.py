"""A study changed: by a base, by dotted keys, from Python and from the command line."""

import tomllib
from pathlib import Path

import pytest
from refusals import refused

from pymantaray.config import load, load_sound, load_study, parse_study, preset_text
from pymantaray.config.keys import merged, parse_changes, with_key
from pymantaray.errors import StudyError


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def tree_of(config):
    return config.model_dump(exclude={"study": {"name", "description"}})


def test_a_file_with_a_base_is_the_base_but_for_its_keys(write):
    mine = load_study(write("mine.toml", 'base = "fram"\n[noise]\nrange_sigma = 2.0\n'))
    assert tree_of(mine) == tree_of(load_study("fram", **{"noise.range_sigma": 2.0}))
    assert (mine.study.name, mine.study.description) == ("mine", "mine.toml, based on fram")


def test_bases_chain_and_the_nearest_key_holds(write):
    write("a.toml", 'base = "quick"\n[noise]\nrange_sigma = 2.0\ndepth_sigma = 3.0\n')
    write("sub/b.toml", 'base = "../a.toml"\n[noise]\nrange_sigma = 4.0\n[study]\nname = "b2"\n')
    config = load_study(write("sub/c.toml", 'base = "b.toml"\n[study]\ndescription = "C"\n'))
    assert (config.noise.range_sigma, config.noise.depth_sigma, config.mission.duration_h) == (
        4.0,
        3.0,
        24.0,
    )
    assert (config.study.name, config.study.description) == ("c", "C")


def test_files_are_relative_to_the_file_that_names_them(write, tmp_path, monkeypatch):
    write(
        "sea/base.toml",
        'base = "quick"\n[ocean]\nsource = ["a.nc", "b.nc"]\nbathymetry = "floor.nc"\n',
    )
    mine = write("mine.toml", 'base = "sea/base.toml"\n[ocean]\nbathymetry = "own.nc"\n')
    sources = tuple(str(tmp_path / "sea" / name) for name in ("a.nc", "b.nc"))
    assert load_study(mine).ocean.files == (*sources, str(tmp_path / "own.nc"))
    monkeypatch.chdir(tmp_path / "sea")
    changed = load_study(mine, **{"ocean.bathymetry": "here.nc"})
    assert changed.ocean.files == (*sources, str(tmp_path / "sea" / "here.nc"))
    assert changed.with_(**{"ocean.source": "c.nc"}).ocean.source == (
        str(tmp_path / "sea" / "c.nc"),
    )
    assert type(changed.ocean.bathymetry) is str


def test_entries_of_a_list_are_changed_added_and_taken_out_by_name(write):
    config = load_study(
        write("mine.toml", """
base = "estimators-beaufort"
[fleet.vehicles]
B.target_depth = 111.0
C = "none"
[conditions]
"5-at-50-km".range_model.belief.rms = 2.0
straight = "none"
mine = { range_model = { kind = "constant", sound_speed = 1440.0 } }
""")
    )  # fmt: skip
    base = load_study("estimators-beaufort")
    names = [v.name for v in base.fleet.vehicles]
    assert [v.name for v in config.fleet.vehicles] == [name for name in names if name != "C"]
    assert config.fleet.vehicles[1].target_depth == 111.0
    assert config.fleet.vehicles[2:] == base.fleet.vehicles[3:]
    by_name = {c.name: c for c in config.conditions}
    assert by_name["5-at-50-km"].belief.rms == 2.0
    assert by_name["5-at-50-km"].belief.horizontal_scale == 5e4
    assert config.conditions[-1].range_model.sound_speed == 1440.0
    assert len(config.conditions) == len(base.conditions)
    assert "straight" not in by_name


def test_a_list_replaces_a_list_and_another_kind_its_table(write):
    config = load_study(
        write("mine.toml", """
base = "estimators-beaufort"
[[fleet.vehicles]]
name = "Z"
kind = "station"
north = 0.0
east = 0.0
[conditions.eigenray-2]
range_model.belief = { kind = "mean" }
""")
    )  # fmt: skip
    assert [v.name for v in config.fleet.vehicles] == ["Z"]
    assert {c.name: c.belief for c in config.conditions}["eigenray-2"].model_dump() == {
        "kind": "mean"
    }


def test_none_takes_out_what_the_base_has(write):
    loud = (
        "[detection]\nsource_level_db = 185.0\nfrequency_hz = 25e3\nbandwidth_hz = 5e3\nshipping ="
        " 0.2\n"
    )
    base = write("loud.toml", f'base = "quick"\n{loud}')
    assert load_study(base).detection.shipping == 0.2
    config = load_study(
        base, **{"detection.shipping": "none", "detection.noise_spectral_level_db": 40.0}
    )
    assert config.detection.shipping is None
    assert (
        load_study(write("quiet.toml", 'base = "loud.toml"\ndetection = "none"\n')).detection
        is None
    )
    assert config.with_(detection="none").detection is None
    assert load_study("survey", landmarks="none").landmarks == ()


@pytest.mark.parametrize(("files", "line"), [
    ({"a": 'base = "b.toml"', "b": 'base = "a.toml"'},
     "base: a.toml -> b.toml -> a.toml is a circle; remove one"),
    ({"a": 'base = "a.toml"'}, "base: a.toml -> a.toml is a circle"),
    ({"a": 'base = "beufort"'}, ("base: found 'beufort'; did you mean beaufort\\? allowed: a file"
                                " that ends in .toml, beaufort, ")),
    ({"a": "base = 3"}, "base: found '3'; allowed: a file"),
    ({"a": 'base = "gone.toml"'}, "base: .*gone.toml: no such file"),
    ({"a": 'base = "quick"\n[fleet.vehicles]\nZ = 3'},
     "`fleet.vehicles.Z`: no such entry. Entries of `fleet.vehicles`: A, B, C, "),
    ({"a": 'base = "quick"\n[noise]\nrnge_sigma = 1.0'},
     "a.toml: `noise.rnge_sigma`: unknown key. Did you mean `noise.range_sigma`\\?$"),
])  # fmt: skip
def test_bases_that_are_none_are_one_line(write, files, line):
    for name, text in files.items():
        path = write(f"{name}.toml", text)
    refused(StudyError, line, load_study, path.parent / "a.toml")


@pytest.mark.parametrize(("changes", "line"), [
    ({"noise.rnge_sigma": 2.0},
     "`noise.rnge_sigma`: unknown key. Did you mean `noise.range_sigma`\\?$"),
    ({"ocean.max_bottom_bounces": 2}, ("`ocean.max_bottom_bounces`: unknown key. Did you mean"
                                      " `acoustics.max_bottom_bounces`\\?")),
    ({"nois.range_sigma": 2.0}, "`nois`: unknown key. Did you mean `noise`\\?"),
    ({"realisations": 2}, "`realisations`: unknown key. Did you mean `study.realizations`\\?"),
    ({"range_sigma": 2.0}, "`range_sigma`: unknown key. Did you mean `noise.range_sigma`\\?"),
    ({"noise.qqq": 2.0}, "`noise.qqq`: unknown key. Allowed: altimeter_bias_sigma, "),
    ({"noise.range_sigma": -2.0}, "noise.range_sigma: found -2.0; allowed: greater than 0"),
    ({"noise.range_sigma.x": 1},
     "`noise.range_sigma.x`: `noise.range_sigma` is 1.0, which has no keys"),
    ({"fleet.vehicles.Z.north": 1.0},
     "`fleet.vehicles.Z.north`: no such entry. Entries of `fleet.vehicles`: A, B, "),
    ({"mission": 5}, "mission: found 5; allowed: a table"),
])  # fmt: skip
def test_a_change_that_is_not_allowed_is_one_line(changes, line):
    refused(StudyError, line, load_study, "quick", **changes)
    refused(StudyError, line, load_study("quick").with_, **changes)


def test_a_changed_study_says_what_is_changed_and_keeps_the_rest():
    quick = load_study("quick")
    changed = load_study(
        "quick", realizations=5, **{"noise.range_sigma": 2, "ocean.time_varying": True}
    )
    assert changed.study.description == (
        "quick with 5 realizations and noise.range_sigma = 2 and ocean.time_varying = true"
    )
    assert (
        quick.with_(**{"noise.range_sigma": 2.0}).study.description
        == "quick with noise.range_sigma = 2.0"
    )
    twice = quick.with_(**{"noise.range_sigma": 2.0}).with_(**{"noise.depth_sigma": 1.0})
    assert (
        twice.study.description == "quick with noise.range_sigma = 2.0 and noise.depth_sigma = 1.0"
    )
    assert quick.with_(**{"study.description": "mine"}).study.description == "mine"
    same = {"study": quick.study, "noise": quick.noise}
    assert twice.model_copy(update=same) == quick
    assert quick.with_() == quick
    refused(StudyError, "study.name: missing", quick.with_, study={"realizations": 2})
    assert quick.noise.range_sigma == 1.0


def test_duration_stays_unset_where_trajectories_give_it(tmp_path):
    (tmp_path / "own.csv").write_text("time,north,east,depth\n0,0,0,5\n1800,900,0,5\n")
    tree = {
        "study": {"name": "own"},
        "ocean": {"source": "synthetic:fram"},
        "fleet": {"trajectories": "own.csv"},
    }
    config = parse_study(tree, folder=tmp_path).with_(**{"noise.range_sigma": 2.0})
    assert "duration_h" not in config.mission.model_fields_set


def test_sections_of_sound_are_changed_too(write):
    alone = write("alone.toml", 'base = "fram"\n[ocean]\nsource = "sea.nc"\n')
    assert load_sound(alone, **{"acoustics.arrival": "first"}).acoustics.arrival == "first"
    bare = write("bare.toml", '[ocean]\nsource = "sea.nc"\n')
    assert load_sound(bare, **{"acoustics.max_bottom_bounces": 2}).acoustics.max_bottom_bounces == 2
    refused(StudyError, "`noise`: unknown key", load_sound, bare, **{"noise.range_sigma": 2.0})
    refused(StudyError, "`study`: unknown key", load_sound(bare).with_, **{"study.seed": 2})
    loud = write(
        "loud.toml",
        "[detection]\nsource_level_db = 185.0\nfrequency_hz = 25e3\nbandwidth_hz = 5e3\n",
    )
    keys = load.sound_sections(loud)
    assert keys == {
        "detection": {"source_level_db": 185.0, "frequency_hz": 25e3, "bandwidth_hz": 5e3}
    }


def test_assignments_are_toml_values_and_else_text():
    words = [
        "a=2",
        "b=2.0",
        "c=true",
        "d=[1, 2]",
        "e=synthetic:fram",
        'f="x"',
        "g = none ",
        "h={ kind = 'mean' }",
        "i=2014-07-15",
    ]
    changes = parse_changes(words)
    assert list(changes.values())[:-1] == [
        2,
        2.0,
        True,
        [1, 2],
        "synthetic:fram",
        "x",
        "none",
        {"kind": "mean"},
    ]
    assert changes["i"].year == 2014
    for bad in (["a"], ["=2"], ["a=1", "a=2"]):
        refused(StudyError, f"{bad[-1]}: ", parse_changes, bad)


def test_trees_are_not_changed_in_place():
    tree = {"a": {"b": [{"name": "x.y", "c": 1}]}}
    assert with_key(tree, "a.b.x.y.c", 2) == {"a": {"b": [{"name": "x.y", "c": 2}]}}
    assert merged(tree, {"a": {"b": {"x.y": {"c": 2}}}}) == {"a": {"b": [{"name": "x.y", "c": 2}]}}
    assert tree == {"a": {"b": [{"name": "x.y", "c": 1}]}}


def test_presets_hold_what_differs_from_their_base_alone():
    """Taking any key out of a preset with a base changes the study."""
    folder = Path(load.__file__).parent / "presets"
    for file in sorted(folder.glob("*.toml")):
        tree = tomllib.loads(file.read_text())
        if "base" not in tree:
            continue
        whole = load_study(file)
        for section, keys in tree.items():
            for key in keys if isinstance(keys, dict) else ():
                less = {**tree, section: {k: v for k, v in keys.items() if k != key}}
                try:
                    assert parse_study(less, file.stem, folder) != whole, (file.name, section, key)
                except StudyError:
                    continue


def test_text_of_a_preset_has_all_keys_with_what_they_mean():
    text = preset_text("fram")
    assert parse_study(tomllib.loads(text)) == load_study("fram")
    assert "range_sigma = 1.0  # Standard deviation of a range" in text
    assert "#time_varying = false  # " in text
