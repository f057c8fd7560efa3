"""Figures for both widths of a journal: size of letters, overlaps, and text outside the frame."""

import numpy as np
import pytest
from campaigns import make_campaign, survey_of, water as profile
from factories import TINY
from figure_text import cut_off, overlaps, smallest_letter

from pymantaray.apps.locate import LocateOptions, locate, write_location_page
from pymantaray.apps.plan import DeploymentPlan, PlanSection, search_designs, write_plan_page
from pymantaray.apps.replay import write_replay
from pymantaray.apps.study import open_run
from pymantaray.apps.study.comparison_page import comparison_figure_specs
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.config import parse_study
from pymantaray.plotting import style

WIDTHS = (style.COLUMN, style.DOUBLE)


def assert_readable(figure, name):
    """Letters of six points or more, no text on another, and all of it within the figure."""
    assert np.isclose(figure.get_figwidth(), WIDTHS).any(), name
    assert smallest_letter(figure) >= 6.0, name
    assert overlaps(figure) == [], name
    assert cut_off(figure) == [], name


def check_specs(specs):
    """Figures of a report at their own width and for one column."""
    assert specs
    for spec in specs:
        assert spec.column is not None, spec.name
        narrow = spec.column()
        assert narrow.get_figwidth() == pytest.approx(84.0 / 25.4), spec.name
        assert_readable(narrow, f"{spec.name} in one column")
        assert_readable(spec.draw(), spec.name)


def test_every_figure_of_a_run_is_readable_at_both_widths(run):
    specs = run_figure_specs(RunResults(run))
    assert len(specs) >= 12
    check_specs(specs)


def test_figures_of_two_runs_are_readable_at_both_widths(run):
    results = RunResults(run)
    check_specs(comparison_figure_specs({"Beaufort Sea": results, "Fram Strait": results}))


def test_figures_of_many_runs_are_readable_at_both_widths(run):
    results = RunResults(run)
    check_specs(comparison_figure_specs({f"run of day {day}": results for day in range(5)}))


@pytest.mark.slow
def test_figures_with_long_names_are_readable_at_both_widths(made_run, tmp_path):
    more = (f"estimator-{i}" for i in range(style.DISTINCT))
    made = made_run(
        names=tuple(f"a vehicle with number {i}" for i in range(6)),
        landmarks=2,
        lost=0.3,
        title="A long name of a sea that nobody knows (synthetic)",
        conditions=(*style.CONDITION_COLOURS, *more),
    )
    check_specs(run_figure_specs(RunResults(open_run(made.write(tmp_path / "run")))))


@pytest.fixture
def both(drawn, columns):
    """Checks figures that a function draws of its pages, for both widths."""

    def check(count, write, *arguments):
        write(*arguments, formats=["84mm"])
        narrow = {id(figure): figure for figure in columns}.values()
        assert (len(drawn.figures), len(narrow)) == (count, count)
        assert {figure.get_figwidth() for figure in narrow} == {style.COLUMN}
        for figure in (*drawn.figures, *narrow):
            assert_readable(figure, figure.get_suptitle())

    return check


def test_figures_of_a_plan_are_readable_at_both_widths(both, tmp_path):
    receiver = {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0, "sigma": 2.0}
    section = PlanSection(
        free={"landmarks.T.depth": [5.0, 150.0, 300.0], "mission.ping_interval_h": [1.0, 2.0]},
        objectives=("error", "cost"),
        costs={"ping": 1.0},
        oceans=({}, {"centre_lat": 74.0}),
        lost_of="T",
    )
    plan = DeploymentPlan(parse_study({**TINY, "landmarks": [receiver]}, "tiny"), section)
    both(4, write_plan_page, search_designs(plan, workers=1), tmp_path / "page")


def test_figures_of_located_nodes_are_readable_at_both_widths(both, tmp_path):
    survey = survey_of(make_campaign(1, pings=40), sigma=1e-4)
    located = locate(survey, profile(), LocateOptions(speed_model="time", correlation="none"))
    both(3, write_location_page, located, tmp_path / "page")


def test_figures_of_a_replay_are_readable_at_both_widths(both, made_replay, tmp_path):
    both(4, write_replay, made_replay, tmp_path / "page")
