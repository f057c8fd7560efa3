"""Sweep files: which studies they are, and what is refused before anything runs."""

import datetime as dt

import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.sweep import Sweep, load_sweep
from pymantaray.apps.sweep.definition import parse_sweep
from pymantaray.apps.sweep.keys import task_keys
from pymantaray.apps.sweep.plan import SweepPlan
from pymantaray.config import load_study, parse_study, study_toml
from pymantaray.config.door.study import build_study
from pymantaray.config.keys import with_key
from pymantaray.errors import SweepError

MODEM = {"source_level_db": 185.0, "frequency_hz": 25e3, "bandwidth_hz": 5e3}

FILE = """
base = "quick"
seeds = [1, 2]

[cross]
noise.range_sigma = [0.5, 1.0, 2.0]
"mission.ping_interval_h" = [2.0, 4.0]

[[zip]]
name = "region"
labels = ["Beaufort", "Fram"]
ocean = [
  { source = "synthetic:beaufort" },
  { source = "synthetic:fram" },
]
fleet.vehicles.B.target_depth = [100.0, 200]
"""


@pytest.fixture
def sweep(tmp_path):
    (tmp_path / "sweep.toml").write_text(FILE)
    return load_sweep(tmp_path / "sweep.toml")


def test_every_value_meets_every_other_and_the_last_axis_is_fastest(sweep):
    assert sweep.shape == (3, 2, 2, 2)
    assert len(sweep) == 24
    configs = [sweep.point(number) for number in range(24)]
    assert [c.study.seed for c in configs[:3]] == [1, 2, 1]
    assert [c.ocean.source for c in configs[1:3]] == [("synthetic:beaufort",), ("synthetic:fram",)]
    assert (
        len(
            {
                (c.noise.range_sigma, c.mission.ping_interval_h, c.ocean, c.study.seed)
                for c in configs
            }
        )
        == 24
    )
    fram = configs[2]
    assert fram.fleet.vehicles[1].target_depth == 200.0
    assert fram.fleet.vehicles[2] == load_study("quick").fleet.vehicles[2]


PLACED = {"name": "L", "lat": 73.55, "lon": -144.5, "depth": 100.0}


@pytest.mark.parametrize(
    "cross",
    [
        {"noise.range_sigma": [0.5, 1, "2 m"]},
        {"noise": [{"range_sigma": 2.0}, {"depth_sigma": 0.5}]},
        {"detection": [MODEM, MODEM | {"bandwidth_hz": 4e3}], "acoustics.max_surface_bounces": [1]},
        {"landmarks": [[PLACED]], "ocean.centre_lat": [73.4, 73.5]},
        {"conditions": [["odometry"], [{"name": "straight"}, {"name": "refracted"}]]},
        {"fleet.vehicles.B.target_depth": [100.0, 200.0], "study.seed": [1, 2]},
    ],
)
def test_a_point_is_the_study_of_its_own_tables(
    cross,
):
    base = load_study("quick")
    sweep = Sweep(base, cross=cross)
    plan = SweepPlan(sweep)
    for number in range(len(sweep)):
        tree = base.model_dump(exclude_none=True, exclude_unset=True)
        for k, axis in zip(sweep.place(number), sweep.axes, strict=True):
            tree = with_key(tree, axis.name, axis.values[axis.name][k])
        study = parse_study(tree)
        assert sweep.point(number) == study
        assert plan.keys[number] == task_keys(build_study(study), {})


def test_all_else_is_the_base(sweep):
    base = load_study("quick")
    changed = {"study", "ocean", "noise", "fleet", "mission"}
    point = sweep.point(23)
    assert point.model_dump(exclude=changed) == base.model_dump(exclude=changed)
    assert point.ocean.centre is None  # the whole section is another


def test_a_sweep_written_out_needs_nothing_else_and_is_the_same(tmp_path, as_stored):
    (tmp_path / "base.toml").write_text(study_toml(load_study("quick")))
    (tmp_path / "sweep.toml").write_text(FILE.replace('"quick"', '"base.toml"'))
    sweep = load_sweep(tmp_path / "sweep.toml")
    text = sweep.to_toml()
    as_stored(text)
    (tmp_path / "base.toml").unlink()
    again = parse_sweep(text, "again", tmp_path / "elsewhere")
    assert [axis.coordinates() for axis in again.axes] == [
        axis.coordinates() for axis in sweep.axes
    ]
    assert [again.point(n) for n in range(24)] == [sweep.point(n) for n in range(24)]


def test_all_that_python_can_give_is_kept_in_its_order(small, tmp_path):
    vehicles = small.model_dump(exclude_none=True)["fleet"]["vehicles"]
    modem = {"source_level_db": 170.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}
    sweep = Sweep(
        small,
        cross={"detection": [modem, None], "noise.range_sigma": np.array([1.0, 2.0])},
        zipped=[
            {
                "name": "fleet",
                "fleet.vehicles": [vehicles, vehicles[:1]],
                "mission.gnss_depth": (1.0, np.float64(2.0)),
                "study.realizations": [np.int64(1), np.int64(2)],
            },
            {"ocean.time": [dt.datetime(2014, 7, 15, 12), dt.datetime(2014, 7, 16)]},  # noqa: DTZ001
        ],
        seeds=range(3),
    )
    again = parse_sweep(sweep.to_toml(), "again", tmp_path)
    assert [axis.name for axis in again.axes] == [axis.name for axis in sweep.axes]
    assert [again.point(n) for n in range(len(again))] == [
        sweep.point(n) for n in range(len(sweep))
    ]
    assert len(again) == 48


def test_input_files_are_relative_to_the_sweep(tmp_path):
    text = 'base = "quick"\ncross.ocean = [{ source = "a.nc" }, { source = ["b.nc", "c.nc"] }]\n'
    (tmp_path / "sweep.toml").write_text(text)
    sweep = load_sweep(tmp_path / "sweep.toml")
    assert [sweep.point(n).ocean.files for n in (0, 1)] == [
        (str(tmp_path / "a.nc"),),
        (str(tmp_path / "b.nc"), str(tmp_path / "c.nc")),
    ]
    with pytest.raises(SweepError) as caught:
        SweepPlan(sweep)
    assert str(caught.value).splitlines() == [
        f"{tmp_path / 'a.nc'}: cannot be read: No such file or directory",
        f"{tmp_path / 'b.nc'}: cannot be read: No such file or directory",
    ]


def test_the_size_of_a_fleet_and_its_spacing_are_fields_too(small, as_stored):
    tree = {
        "kind": "waypoints",
        "name": "W",
        "north": 10.0,
        "east": -20.0,
        "depth": 5.0,
        "speed": 1.0,
    }
    vehicles = [
        *(v.model_dump(exclude_none=True) for v in small.fleet.vehicles),
        tree | {"points": [[4.0, 6.0, 8.0]]},
    ]
    sweep = Sweep(
        small, cross={"fleet.spacing": [0.5], "fleet.count": [1, 3], "fleet.vehicles": [vehicles]}
    )
    assert [len(sweep.point(n).fleet.vehicles) for n in (0, 1)] == [1, 3]
    before, after = small.fleet.vehicles[1], sweep.point(1).fleet.vehicles
    assert (after[1].north, after[1].east) == (0.5 * before.north, 0.5 * before.east)
    assert after[1].target_depth == before.target_depth
    assert (after[2].points, after[2].depth) == (((2.0, 3.0, 8.0),), 5.0)
    as_stored([sweep.point(n).model_dump(mode="json")["fleet"] for n in (0, 1)])


@pytest.mark.parametrize("none", [{}, None, "none"])
def test_none_takes_a_section_out(small, none):
    modem = {"source_level_db": 170.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}
    sweep = Sweep(small, cross={"detection": [modem, none]})
    assert [sweep.point(n).detection is None for n in (0, 1)] == [False, True]
    assert sweep.axes[0].coordinates()["detection"][1] == "none"


def test_of_many_bad_points_twenty_are_named_and_the_rest_is_counted(small):
    for bad, rest in ((20, []), (22, ["and 2 more"])):
        depths = [-1.0 - number for number in range(bad)]
        with pytest.raises(SweepError) as caught:
            SweepPlan(Sweep(small, cross={"mission.gnss_depth": depths}))
        lines = str(caught.value).splitlines()
        assert [line.partition(" (")[0] for line in lines] == [
            f"point {n}" for n in range(20)
        ] + rest


def test_a_bad_point_is_one_line_and_all_are_told_at_once(small):
    sweep = Sweep(
        small, cross={"noise.range_sigma": [1.0, -1.0, "x"], "mission.gnss_depth": [1.0, 2.0]}
    )
    with pytest.raises(SweepError) as caught:
        SweepPlan(sweep)
    assert str(caught.value).splitlines() == [
        f"point {number} (noise.range_sigma = {sigma}, mission.gnss_depth = {depth}):"
        f" noise.range_sigma: found {found}; allowed: {allowed}"
        for number, sigma, depth, found, allowed in (
            (2, -1.0, 1.0, "-1.0", "greater than 0"),
            (3, -1.0, 2.0, "-1.0", "greater than 0"),
            (
                4,
                "x",
                1.0,
                "'x'",
                'a number of metres, or text such as "2 km" (units mm, cm, m, km, nmi)',
            ),
            (
                5,
                "x",
                2.0,
                "'x'",
                'a number of metres, or text such as "2 km" (units mm, cm, m, km, nmi)',
            ),
        )
    ]


@pytest.mark.parametrize(
    ("field", "value", "line"),
    [
        (
            "noise.range_sgima",
            1.0,
            "`noise.range_sgima`: unknown key. Did you mean `noise.range_sigma`\\?",
        ),
        (
            "fleet.vehicles.Z.north",
            1.0,
            "`fleet.vehicles.Z.north`: no such entry. Entries of `fleet.vehicles`: A, B",
        ),
        (
            "fleet.vehicles.9.north",
            1.0,
            "`fleet.vehicles.9.north`: no such entry. Entries of `fleet.vehicles`: A, B",
        ),
        (
            "study.realizations.deeper",
            1.0,
            "`study.realizations.deeper`: `study.realizations` is 1, which has no keys; .*",
        ),
        ("fleet.count", 9, "fleet.count is 9; it must be from 1 to 2, the vehicles of the base"),
        ("fleet.count", "x", "fleet.count is x; it must be from 1 to 2, the vehicles of the base"),
        ("fleet.spacing", "x", "fleet.spacing is x; it must be a factor such as 0.5"),
    ],
)
def test_a_field_that_is_not_there_is_told_with_its_name(small, field, value, line):
    with pytest.raises(SweepError, match=rf"^point 0 \(.*\): {line}$"):
        SweepPlan(Sweep(small, cross={field: [value]}))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("base = [", "s.toml: not valid TOML: .*"),
        ("seeds = [1]", "s.toml: base: missing; give a preset or a study file"),
        (
            'base = "quik"',
            (
                "s.toml: base: found 'quik'; allowed: a file that ends in .toml, beaufort,"
                " .*, survey"
            ),
        ),
        (
            'base = "quick"\ncrossed = 1',
            "s.toml: crossed: unknown key; allowed: base, folder, cross, zip, seeds",
        ),
        ('base = "quick"\ncross = 1', "s.toml: cross: must be a table"),
        ('base = "quick"\nseeds = 1', "s.toml: seeds: must be a list"),
        ('base = "quick"\nzip = 1', r"s.toml: zip: must be tables \[\[zip\]\]"),
        (
            'base = "quick"\n[cross]\na.b = 1',
            "s.toml: a.b: found 1; it must be a list of at least one value",
        ),
        (
            'base = "quick"\n[cross]\na.b = []',
            r"s.toml: a.b: found \[\]; it must be a list of at least one value",
        ),
        (
            'base = "quick"\n[[zip]]\na = [1]\nb = [1, 2]',
            "s.toml: zip 1: lists have different lengths, a 1, b 2; give lists of equal length",
        ),
        (
            'base = "quick"\n[[zip]]\nname = "key"\nlabels = ["a"]\na.b = [1]',
            "s.toml: key is the name of another column of its tables; give another name",
        ),
        (
            'base = "quick"\n[[zip]]\nname = "x"',
            "s.toml: zip 1: fields, or the name of labels, are missing; .*",
        ),
        (
            'base = "quick"\nseeds = [1]\n[cross]\nstudy.seed = [1]',
            "s.toml: study.seed is given more than once; remove all but one",
        ),
    ],
)
def test_a_file_that_is_no_sweep_is_told_in_one_line(tmp_path, monkeypatch, text, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(SweepError, match=f"^{line}$"):
        load_sweep("s.toml")


def test_a_file_that_is_not_there_is_told_in_one_line():
    with pytest.raises(SweepError, match=r"^nowhere.toml: no such file; name an existing file$"):
        load_sweep("nowhere.toml")


def test_a_mission_is_as_long_as_the_trajectories_of_each_point(tmp_path):
    for name, last in (("short", 1800), ("long", 7200)):
        (tmp_path / f"{name}.csv").write_text(f"time,north,east,depth\n0,0,0,5\n{last},900,0,5\n")
    (tmp_path / "base.toml").write_text("""
[study]
name = "own"

[ocean]
source = "synthetic:beaufort"

[mission]
ping_interval_h = 0.25

[fleet]
trajectories = "short.csv"
""")
    files = [[str(tmp_path / f"{name}.csv")] for name in ("short", "long")]
    sweep = Sweep(tmp_path / "base.toml", cross={"fleet.trajectories": files})
    assert [sweep.point(n).mission.duration_h for n in (0, 1)] == [0.5, 2.0]


@pytest.mark.parametrize(
    "name", ["rmse_m", "rays_seconds", "condition", "a/b", "", "3rd", " a", "a ", "a\nb", 7]
)
def test_invalid_table_names_are_refused_before_anything_runs(name):
    zipped = [{"name": name, "noise.range_sigma": [1.0, 2.0]}]
    with pytest.raises(SweepError, match=r"^sweep: .*name") as caught:
        Sweep("quick", zipped=zipped)
    assert "\n" not in str(caught.value)


def test_a_sweep_has_a_hundred_fields_at_most(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(
        'base = "quick"\n[cross]\n' + "".join(f'"k.{k}" = [1]\n' for k in range(30_000))
    )
    refused(
        SweepError, "30,000 fields or lists of them; at most 100 can be crossed", load_sweep, path
    )
