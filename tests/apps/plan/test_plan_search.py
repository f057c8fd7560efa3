"""Plans: what is refused before anything runs, the search, and the files of its results."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w
from factories import TINY
from refusals import refused

from pymantaray.apps.plan import DeploymentPlan, load_plan, search_designs
from pymantaray.apps.plan.definition import PlanSection
from pymantaray.apps.plan.evaluate import Scores
from pymantaray.apps.plan.results import PlanResults, difference
from pymantaray.cli.main import main
from pymantaray.config import load_study, parse_study
from pymantaray.errors import PlanError, StudyError, WriteError

MADE = r"made|origin|citation|links|references|height|width"  # of a page
LANDMARK = {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0}


def write(folder, **plan):
    path = folder / "mission.toml"
    path.write_text(tomli_w.dumps({**TINY, "landmarks": [LANDMARK], "plan": plan}))
    return path


def test_free_keys_have_values_counts_or_limits(tmp_path):
    file = write(
        tmp_path,
        free={
            "landmarks": {"T": {"depth": {"from": 5.0, "to": 25.0, "count": 3}}},
            "mission.ping_interval_h": [1.0, 2.0],
            "noise.range_sigma": {"from": 1.0, "to": 2.0},
        },
    )
    plan = load_plan(file)
    assert plan.lists == {
        "landmarks.T.depth": [5.0, 15.0, 25.0],
        "mission.ping_interval_h": [1.0, 2.0],
    }
    assert plan.ranges == {"noise.range_sigma": (1.0, 2.0)}
    assert plan.size == 6
    assert plan.keys[0] == "mission.ping_interval_h"  # in the order of the file
    assert plan.lists_at(1) == {"landmarks.T.depth": 15.0, "mission.ping_interval_h": 1.0}
    assert plan.study(plan.lists_at(5)).landmarks[0].depth == 25.0


def test_a_study_is_the_same_with_and_without_a_plan(tmp_path):
    file = write(tmp_path, free={"landmarks.T.depth": [1.0]})
    plain = tmp_path / "plain.toml"
    plain.write_text(tomli_w.dumps({**TINY, "landmarks": [LANDMARK]}))
    assert load_study(file) == load_study(plain)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({}, "plan.free"),
        (
            {"free": {"landmarks.T.depth": 5.0}},
            r"plan.free: landmarks.T.depth: found 5.0; give a list",
        ),
        ({"free": {"landmarks.T.depth": []}}, "give a list"),
        ({"free": {"landmarks.T.depth": {"from": 5, "to": 1}}}, "from below to"),
        ({"free": {"landmarks.T.depth": {"from": 1, "to": 5, "count": 1}}}, "2 or more"),
        ({"free": {"landmarks.T.depth": {"from": 1, "to": 5, "step": 1}}}, "step: unknown key"),
        ({"free": {"landmarks.U.depth": [5.0]}}, "no such entry"),
        ({"free": {"landmarks.T.depth": {"from": -5, "to": 5}}}, "depth"),
        ({"free": {"noise.rnge_sigma": [1.0]}}, "rnge_sigma"),
        (
            {"free": {"landmarks.T.depth": [1.0]}, "condition": "best"},
            "plan.condition: found 'best'; allowed:",
        ),
        (
            {"free": {"landmarks.T.depth": [1.0]}, "lost_of": "Z"},
            "plan.lost_of: found 'Z'; allowed: .*T",
        ),
        ({"free": {"landmarks.T.depth": [1.0]}, "objectives": ["speed"]}, "objectives"),
        (
            {"free": {"landmarks.T.depth": {"from": 1, "to": 5}}, "evaluations": 9},
            "plan.evaluations: found 9; the search of 1 range needs at least 10",
        ),
        ({"free": {"landmarks.T.depth": [1.0]}, "oceans": [{"sourcex": "x"}]}, "sourcex"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_in_one_line(plan, message, tmp_path):
    file = write(tmp_path, **plan)
    refused((PlanError, StudyError), message, load_plan, file)


def test_a_file_without_a_plan_is_refused(tmp_path):
    file = tmp_path / "mission.toml"
    file.write_text('base = "quick"\n')
    refused(PlanError, r"has no section \[plan\]; add one", load_plan, file)
    file.write_text('base = "quick"\nplan = 3\n')
    refused(StudyError, "plan: found 3; allowed: a table", load_plan, file)


@pytest.mark.slow
def test_a_search_over_a_range_finds_the_smallest_sigma_and_repeats(tmp_path):
    file = write(
        tmp_path,
        free={"noise.range_sigma": {"from": 0.5, "to": 20.0}},
        objectives=["error"],
        condition="straight",
        evaluations=12,
    )
    first, second = (search_designs(load_plan(file), workers=n) for n in (1, 2))
    assert first.designs == second.designs
    assert first.frame.equals(second.frame)
    assert len(first.designs) <= 12 + 1
    values = [design["noise.range_sigma"] for design in first.designs]
    assert values[first.best] == min(values)
    assert min(values) < 1.5


def test_designs_on_dask_are_those_of_this_machine(tmp_path):
    pytest.importorskip("distributed")
    from dask_cluster import client_here

    plan = load_plan(write(tmp_path, free={"landmarks.T.depth": [5.0, 100.0, 300.0]}))
    here = search_designs(plan, workers=1)
    with client_here(2) as client:
        pd.testing.assert_frame_equal(
            search_designs(plan, client=client).frame, here.frame, check_exact=True
        )


def test_the_best_design_is_a_study_that_runs(tmp_path, capsys, monkeypatch, as_stored):
    monkeypatch.chdir(tmp_path)
    write(
        tmp_path,
        free={"landmarks.T.depth": [300.0], "mission.ping_interval_h": [2.0, 1.0]},
        objectives=["error", "lost"],
        oceans=[{}, {"source": "synthetic:fram", "centre_lat": 78.0, "centre_lon": 0.0}],
        lost_of="T",
    )
    (tmp_path / "out").mkdir()
    with pytest.raises(SystemExit) as stop:
        main(
            [
                "plan",
                "mission.toml",
                "--out",
                "out/best.toml",
                "--table",
                "t.csv",
                "--json",
                "--workers",
                "1",
            ]
        )
    assert stop.value.code == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["landmarks.T.depth"] for row in told["designs"]] == [300.0, 300.0]
    assert all(row["worst_error_m"] >= row["error_m"] for row in told["designs"])
    best = load_study(tmp_path / "out" / "best.toml")
    expected = load_plan("mission.toml").study(told["best"])
    assert best.model_dump(exclude={"study"}) == expected.model_dump(exclude={"study"})
    assert (
        (tmp_path / "t.csv")
        .read_text()
        .startswith("landmarks.T.depth,mission.ping_interval_h,error_m")
    )
    assert any(sentence.startswith("T loses") for sentence in told["sentences"])
    results = search_designs(load_plan("mission.toml"), workers=1)
    refused(WriteError, "exists", results.write_best, tmp_path / "out" / "best.toml")
    as_stored(told)
    as_stored((tmp_path / "out" / "best.toml").read_text(), name="study")


def test_sentences_compare_scores_with_their_digits_and_one_unit(tmp_path):
    plan = load_plan(write(tmp_path, free={"landmarks.T.depth": [5.0]}))
    best = Scores(error_m=30.04, lost_percent=3.29, heard_by_two_percent=100.0, cost=28132.0)
    base = Scores(error_m=32.13, lost_percent=2.27, heard_by_two_percent=100.0, cost=28033.5)
    sentences = PlanResults(plan, [{"landmarks.T.depth": 5.0}], [[best]], [base]).sentences
    assert sentences[1:] == [
        "95 % of the position errors of all vehicles are below 30 m instead of 32.1 m.",
        "All links lose 3.29 % of the ranges instead of 2.27 %.",
        "At least two receivers hear 100 % of the pings.",
        "The deployment costs 28,132 instead of 28,033.5.",
    ]


def test_notes_are_of_the_water_its_interpolation_and_the_tracks(tmp_path):
    (tmp_path / "cast.csv").write_text(
        "depth,sound_speed\n5,1440\n100,1445\n100.01,1475\n500,1500\n"
    )
    (tmp_path / "track.csv").write_text("time,north,east,depth\n0,0,0,9\n900,9,0,9\n900,9,0,9\n")
    tree = TINY | {
        "ocean": {"source": str(tmp_path / "cast.csv"), "bathymetry": 500.0},
        "fleet": {"trajectories": [str(tmp_path / "track.csv")]},
        "mission": {"ping_interval_h": 0.1},
    }
    section = PlanSection(free={"noise.range_sigma": [1.0]})
    plan = DeploymentPlan(parse_study(tree, "tiny"), section)
    notes = PlanResults(plan, [{}], [[Scores()]], [Scores()]).notes
    assert [note.removeprefix(f"{tmp_path}/").split(": ")[0] for note in notes] == [
        "cast.csv",
        "sound speed changes by 30 m/s between 100 and 100.01 m depth",
        "between 0 and 99.99 m the sound speed is linear",
        "between 100.02 and 500 m the sound speed is linear",
        "track.csv",
    ]


def test_changes_between_trees_name_entries():
    old = {"a": {"b": 1, "c": 2}, "v": [{"name": "A", "z": 1}, {"name": "B", "z": 1}], "k": [1, 2]}
    new = {"a": {"b": 1}, "v": [{"name": "A", "z": 1}, {"name": "B", "z": 3}], "k": [1, 3]}
    assert difference(old, new) == {"a": {"c": "none"}, "v": {"B": {"z": 3}}, "k": [1, 3]}
    assert difference(old, {**old, "v": old["v"][:1]}) == {"v": [{"name": "A", "z": 1}]}
    assert np.all([difference(tree, tree) == {} for tree in (old, new)])


def test_every_option_reaches_the_search(reached, mantaray, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = write(tmp_path, free={"landmarks.T.depth": [5.0, 300.0]})
    words = ("plan", file, "--set", "noise.range_sigma=2.5", "--set", "mission.duration_h=6")
    words += ("--workers", 3, "--scheduler", "tcp://there:8786")
    assert reached("pymantaray.apps.plan.load_plan", *words)[0] == file
    given = reached("pymantaray.apps.plan.search_designs", *words, without="^0")
    plan = given[0]
    assert (given["workers"], given["client"]) == (3, "tcp://there:8786")
    assert (plan.base.noise.range_sigma, plan.base.mission.duration_h) == (2.5, 6.0)
    monkeypatch.setattr(
        "pymantaray.apps.plan.search_designs",
        lambda plan, **_: PlanResults(
            plan,
            [plan.lists_at(k) for k in (0, 1)],
            [[Scores(error_m=e, lost_percent=1.0 + e)] for e in (9.0, 7.0)],
            [Scores(error_m=8.0, lost_percent=2.0)],
        ),
    )
    monkeypatch.setattr(PlanResults, "notes", ["of the ocean"])
    out = ("--out", "best.toml", "--table", "t.csv", "--page", "page")
    pages = []
    monkeypatch.setattr(
        "pymantaray.apps.plan.write_plan_page",
        lambda *given: pages.append(given) or given[1] / "index.html",
    )
    done = mantaray(*words, *out, "--json")
    told = json.loads(done.out)
    assert [told[name] for name in ("study", "csv", "page")] == [
        "best.toml",
        "t.csv",
        "page/index.html",
    ]
    assert (pages[0][0].plan.base, pages[0][1]) == (plan.base, Path("page"))
    assert (told["best"], told["notes"]) == ({"landmarks.T.depth": 300.0}, ["of the ocean"])
    assert (tmp_path / "t.csv").read_text().splitlines()[1].startswith("300.0,7.0,")
    for name in ("best.toml", "t.csv"):
        refused = mantaray(*words, *out[:4])
        assert refused.err == f"error: {name}: already exists; give another name or --force\n"
        given = reached("pymantaray.apps.plan.results.PlanResults.write_best",
                        *words, *out, "--force", without="^0")  # fmt: skip
        assert (given[1], given["replace"]) == (Path("best.toml"), True)
        assert mantaray(*words, *out, "--force").code == 0
        (tmp_path / "best.toml").unlink()
    reached("pymantaray.cli.options.printer", *words, "--json", "--quiet", "--to", "latex")


def test_a_quiet_search_shows_no_progress(reached, tmp_path):
    file = write(tmp_path, free={"landmarks.T.depth": [5.0]})
    given = reached("pymantaray.apps.plan.search_designs", "plan", file, "-q", without="^0")
    assert (given["workers"], given["progress"]) == (None, None)


@pytest.mark.parametrize("names", [("file",), ("folder", "mine")])
def test_a_page_of_a_plan_needs_a_new_folder(mantaray, tmp_path, names):
    file = write(tmp_path, free={"landmarks.T.depth": [5.0]})
    page = tmp_path / names[0]
    page.mkdir() if names[1:] else page.touch()
    for name in names[1:]:
        (page / name).touch()
    done = mantaray("plan", file, "--page", page)
    assert done.err == f"error: {page}: already exists; give a new or empty folder\n"


def test_a_command_with_a_bad_output_computes_nothing(tmp_path, capsys):
    file = write(tmp_path, free={"landmarks.T.depth": [300.0]})
    for out, message in ((file, "is the input"), (tmp_path / "best.csv", "must end in .toml")):
        with pytest.raises(SystemExit) as stop:
            main(["plan", str(file), "--out", str(out), "--force"])
        assert stop.value.code == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        assert message in lines[0]


def test_the_page_has_the_front_the_map_and_the_sentences(drawn, tmp_path, as_stored):
    from pymantaray.apps.plan import write_plan_page

    free = {"landmarks.T.depth": [5.0, 300.0]}
    found = search_designs(load_plan(write(tmp_path, free=free, lost_of="T")), workers=1)
    failed = [Scores(failure="no vehicle is under water")] * len(found.plan.waters)
    results = PlanResults(
        found.plan,
        [*found.designs, *({"landmarks.T.depth": depth} for depth in (310.0, 320.0))],
        [*found.scores, failed, failed],
        found.base,
    )
    page = write_plan_page(results, tmp_path / "page")
    text = page.read_text()
    assert "2 designs failed: no vehicle is under water" in text
    for name in ("front", "map", "error_over_time", "lost_by_pair"):
        assert f'id="{name}"' in text
        assert (page.parent / "figures" / f"{name}.png").is_file()
    for name in ("designs", "near_optimal", "lost_by_pair", "error_over_time"):
        assert (page.parent / "tables" / f"{name}.csv").stat().st_size > 20
    assert all(sentence in text for sentence in results.sentences if "'" not in sentence)
    as_stored(drawn, without=MADE)
    (origin,) = drawn.pages[0].origin
    assert (origin.caption, origin.file) == ("Options", "plan.json")
    assert ["plan / lost_of", "T"] in origin.frame.to_numpy().tolist()
    as_stored(json.loads(drawn.pages[0].explorer.data), name="explorer")
    as_stored([figure.get_size_inches() for figure in drawn.figures], name="sizes")


def test_the_map_fills_its_figure(tmp_path, as_stored):
    from pymantaray.apps.plan.detail import detail_of
    from pymantaray.apps.plan.figures import map_figure

    plan = load_plan(write(tmp_path, free={"landmarks.T.depth": [5.0, 300.0]}))
    details = {
        f"T at {depth:g} m": detail_of(plan, {"landmarks.T.depth": depth}) for depth in (5.0, 300.0)
    }
    for shown in (details, {"one": details["T at 5 m"]}):
        figure = map_figure(shown, "Test Sea")
        figure.canvas.draw()
        assert [axes.get_position().width >= 0.35 for axes in figure.axes] == [True, True]
        assert all(axes.get_position().height >= 0.5 for axes in figure.axes)
    as_stored(figure)
