"""Figures for both widths of a journal: size of letters, overlaps, and text outside the frame."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import water as profile
from figure_text import cut_off, overlaps, smallest_exponent, smallest_letter
from made_up_atlas import made_atlas

from pymantaray.acoustics import Medium, find_eigenrays, plot_arrivals
from pymantaray.apps.atlas.figures import (
    CONVENTION_WORDS,
    error_maps,
    error_series,
    safety_maps,
    share_maps,
)
from pymantaray.apps.locate import PlanOptions, write_location_page
from pymantaray.apps.locate.page import plan_figure
from pymantaray.apps.locate.plan import plan_survey
from pymantaray.apps.ocean.figures import sea_floor_map, sound_speed_map, sound_speed_sections
from pymantaray.apps.plan import write_plan_page
from pymantaray.apps.plan.figures import time_figure
from pymantaray.apps.plan.page import shown_designs
from pymantaray.apps.replay import write_replay
from pymantaray.apps.study import open_run
from pymantaray.apps.study.comparison_page import comparison_figure_specs
from pymantaray.apps.study.figures.estimators import (
    error_and_consistency,
    unknowns_before_and_after,
)
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.ocean import synthetic_ocean
from pymantaray.plotting import style
from pymantaray.plotting.water import rays_of_links

WIDTHS = (style.COLUMN, style.DOUBLE)
HEADER = "Test Sea, synthetic ocean, 2014-07-15 12:00 UTC"


def assert_readable(figure, name):
    """
    Letters of six points or more, exponents of five, no text on another, and all of it within the
    figure.
    """
    assert np.isclose(figure.get_figwidth(), WIDTHS).any(), name
    assert smallest_letter(figure) >= 6.0, name
    assert smallest_exponent(figure) >= 5.0, name
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


def test_figures_of_a_plan_are_readable_at_both_widths(both, made_plan, tmp_path):
    both(4, write_plan_page, made_plan, tmp_path / "page")


def test_errors_of_designs_far_above_zero_fill_their_panel(made_plan):
    details = shown_designs(made_plan)
    assert time_figure(details, HEADER).axes[0].get_ylim()[0] == 0.0
    far = {
        name: replace(detail, error_m=detail.error_m + 60.0, worst_m=detail.worst_m + 60.0)
        for name, detail in details.items()
    }
    low, high = time_figure(far, HEADER).axes[0].get_ylim()
    errors = np.concatenate([detail.error_m for detail in far.values()])
    assert np.nanmax(errors) - np.nanmin(errors) > 0.6 * (high - low)


def test_figures_of_located_nodes_are_readable_at_both_widths(both, made_location, tmp_path):
    both(3, write_location_page, made_location, tmp_path / "page")


def test_figures_of_a_replay_are_readable_at_both_widths(both, made_replay, tmp_path):
    both(4, write_replay, made_replay, tmp_path / "page")


def check_widths(draw, name):
    """A figure of a function of its width, for both widths; a high map is always narrow."""
    for width in WIDTHS:
        figure = draw(width)
        assert figure.get_figwidth() <= width
        assert_readable(figure, f"{name} of {width:.1f} in")


def test_figures_of_estimators_are_readable_at_both_widths(tables):
    check_widths(
        lambda width: error_and_consistency(
            tables.errors, tables.at_pings, tables.consistency, HEADER, width=width
        ),
        "estimators",
    )
    check_widths(
        lambda width: unknowns_before_and_after(tables.unknowns, HEADER, width=width), "unknowns"
    )


MAPS = {
    "safe": lambda atlas, width: safety_maps(
        atlas,
        [(f"{km} km, speed at the transmitter", 0, k) for k, km in enumerate((2, 5, 10))],
        width,
    ),
    "conventions": lambda atlas, width: safety_maps(
        atlas,
        [(f"5 km, {words}", k, 1) for k, words in enumerate(CONVENTION_WORDS.values())],
        width,
    ),
    "error": lambda atlas, width: error_maps(atlas, 0, 1, width),
    "share": lambda atlas, width: share_maps(atlas, 0, 1, width),
    "series": lambda atlas, width: error_series(atlas, 1, (78.1, -1.9), width),
}


@pytest.mark.parametrize("name", MAPS)
def test_figures_of_an_atlas_are_readable_at_both_widths(name):
    atlas = made_atlas(times=4)
    high = atlas.assign_coords(lon=-2.0 + 0.7 * np.arange(5), lat=70.0 + 0.5 * np.arange(4))
    for each in (atlas, high):
        check_widths(lambda width: MAPS[name](each, width), name)  # noqa: B023  called at once


OCEANS = {
    "wide": {"lat": slice(0, 75, 3), "lon": slice(0, 237, 4)},
    "high": {"lat": slice(0, 75, 3), "lon": slice(0, 60, 4)},
}


@pytest.mark.parametrize("shape", OCEANS)
def test_figures_of_an_ocean_are_readable_at_both_widths(shape):
    ocean = synthetic_ocean("fram").isel(OCEANS[shape])
    place = (float(ocean["lat"].mean()), float(ocean["lon"].mean()))
    check_widths(lambda width: sound_speed_sections(ocean, place, HEADER, width=width), "sections")
    check_widths(lambda width: sound_speed_map(ocean, 90.0, HEADER, width=width), "map")
    check_widths(lambda width: sea_floor_map(ocean, HEADER, width=width), "sea floor")


def test_rays_of_links_are_readable_at_both_widths(water):
    rays = water.rays(2)
    surface = ("ray", np.array([0, 1, 0, 0, 0]))
    rays = rays.assign(ray_surface_bounces=surface, ray_travel_time=("ray", np.arange(2.0, 7.0)))
    titles = ["mooring west to float 1", "mooring west to float 2"]
    check_widths(lambda width: rays_of_links([rays, rays], titles, HEADER, width=width), "rays")


def test_arrivals_of_a_link_are_readable_in_one_column():
    medium = Medium.from_profile([0.0, 200.0], [1480.0, 1484.0], bottom_depth=200.0)
    ends = [0.0, 0.0, 40.0], [900.0, 0.0, 110.0]
    arrivals = find_eigenrays(medium, *ends, max_surface_bounces=1, max_bottom_bounces=1)
    assert arrivals.link.size > 3
    axes = plot_arrivals(arrivals, one_column=True)
    assert axes.figure.get_figwidth() == style.COLUMN
    axes.figure.canvas.draw()
    assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1
    assert_readable(axes.figure, "arrivals")


def test_the_figure_of_a_survey_plan_is_readable():
    plan = plan_survey(profile(), PlanOptions(1500.0), np.linspace(200.0, 4000.0, 6), pings=30)
    assert_readable(plan_figure(plan), "plan of a survey")
