"""
Laws that hold for every figure, and figures of the water and the fleet read back and compared with
what they were given.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.colors import to_hex, to_rgba_array
from matplotlib.contour import ContourSet
from refusals import refused

from pymantaray.apps.ocean import figures as ocean_plots
from pymantaray.apps.rays import write_ray_plot
from pymantaray.apps.study import open_run
from pymantaray.apps.study.comparison_page import comparison_figure_specs
from pymantaray.apps.study.figures import register as figures
from pymantaray.apps.study.figures.estimators import (
    consistency_over_time,
    error_and_consistency,
    unknowns_before_and_after,
)
from pymantaray.apps.study.figures.fleet import factor_graph, fleet_layout
from pymantaray.apps.study.figures.ranging import (
    dropout_map,
    range_error_histogram,
    range_error_split,
)
from pymantaray.apps.study.figures.register import RunResults, register, run_figure_specs
from pymantaray.apps.study.figures.trajectory import ApePanel, error_over_time, pooled_ape
from pymantaray.errors import ReportError
from pymantaray.ocean import synthetic_ocean
from pymantaray.plotting import style
from pymantaray.plotting.water import ray_picture, rays_of_links, sound_speed_profiles
from pymantaray.records import RayStatus

HEADER = "Test Sea, synthetic ocean"
NAME = "A long name " * 9
WITHOUT_UNIT = {
    "Ranges in a bin",
    "Vehicle",
    "NEES / degrees of freedom",
    "NIS / degrees of freedom",
}


def figures_of(results, other, tables):
    """All that are registered, of a run; comparisons with another; plots of an ocean."""
    truth, fixes, header = results.run.truth, results.fixes, results.header
    specs = [
        *run_figure_specs(results),
        *comparison_figure_specs({NAME: results, "b": other}),
    ]
    ocean = synthetic_ocean("fram").isel(lat=slice(0, 75, 3), lon=slice(0, 237, 4))
    return [spec.draw() for spec in specs] + [
        error_over_time(truth.time, truth.name.tolist(), results.errors, fixes, header),
        consistency_over_time(tables.consistency, header),
        error_and_consistency(tables.errors, tables.at_pings, tables.consistency, header),
        unknowns_before_and_after(tables.unknowns, header),
        ocean_plots.sound_speed_sections(ocean, (78.0, 0.0), header),
        ocean_plots.sound_speed_map(ocean, 100.0, header),
        ocean_plots.sea_floor_map(ocean, header),
    ]


@pytest.fixture(scope="module")
def every_figure(run, made_run, tables, tmp_path_factory):
    """Of a run with long names and many conditions."""
    conditions = (*style.CONDITION_COLOURS, *(f"estimator-{i}" for i in range(style.DISTINCT)))
    made = made_run(landmarks=2, lost=0.3, title=f"{NAME}(synthetic)", conditions=conditions)
    results = RunResults(open_run(made.write(tmp_path_factory.mktemp("long") / "run")))
    return figures_of(results, RunResults(run), tables)


@pytest.fixture(scope="module")
def small_figures(run, tables):
    """Of a run with three conditions."""
    return figures_of(RunResults(run), RunResults(run), tables)


@pytest.mark.slow
def test_every_figure_has_units_a_header_and_text_within_its_frame(look, every_figure):
    for figure in every_figure:
        renderer, frame = look.draw(figure).canvas.get_renderer(), figure.bbox.padded(1.0)
        assert figure.get_figwidth() in (style.COLUMN, style.DOUBLE)
        assert "synthetic ocean" in figure.get_suptitle()
        plane = [axes for axes in figure.axes if axes.name != "3d"]
        titles = [axes._left_title for axes in plane if axes.get_title(loc="left")]
        drawn = [*figure.texts, figure._suptitle, *figure.legends, *titles]
        labels = [figure.get_supxlabel(), figure.get_supylabel()]
        for axes in plane:
            low, high = sorted(axes.get_xlim())
            drawn += [axes.xaxis.label, axes.yaxis.label, *axes.texts]
            drawn += [t for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        for axes in (axes for axes in figure.axes if axes.name == "3d"):
            drawn += [axis.label for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        for axes in figure.axes:
            labels += [axes.get_xlabel(), axes.get_ylabel()]
        assert any(labels) or not any(axes.axison for axes in figure.axes)  # a diagram has none
        assert all("[" in label for label in labels if label and label not in WITHOUT_UNIT), labels
        for artist in drawn:
            box = artist.get_window_extent(renderer)
            inside = frame.containsx(box.x0) and frame.containsx(box.x1)
            assert box.width == 0.0 or (
                inside and frame.containsy(box.y0) and frame.containsy(box.y1)
            ), artist
        apart = [
            (a, a.get_window_extent(renderer)) for a in (figure._suptitle, *figure.legends, *titles)
        ]
        for i, (artist, box) in enumerate(apart):
            assert not any(box.overlaps(other) for _, other in apart[:i] if box.width), artist


@pytest.mark.slow
def test_every_header_has_the_whole_name_of_the_ocean(every_figure):
    name = NAME.strip()
    whole = [name in f.get_suptitle().replace("\n", " ") for f in every_figure]
    assert sum(whole) >= len(whole) - 9, "figures of a comparison shorten the names of runs"


def test_numbers_of_the_figures_of_a_run_stay(run, as_stored):
    drawn = {spec.name: spec.draw() for spec in run_figure_specs(RunResults(run))}
    of_other_tests = ("factor_graph", "fleet_layout", "pipeline", "range_error")
    as_stored({name: figure for name, figure in drawn.items() if name not in of_other_tests})
    as_stored({f"{n} size": f.get_size_inches() for n, f in drawn.items()}, name="sizes")


def looks_of(figure):
    """Colours, sizes and styles of all that is drawn, with the legends."""
    legends = [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]
    artists = [*figure.texts, *(a for k in legends for a in (*k.legend_handles, *k.get_texts()))]
    for axes in figure.axes:
        artists += [*axes.lines, *axes.patches, *axes.collections, *axes.texts, axes._left_title]
        artists += [axes.title, axes.xaxis.label, axes.yaxis.label]

    def of(key):
        return [getattr(a, f"get_{key}")() for a in artists if hasattr(a, f"get_{key}")]

    colours, numbers = "color edgecolor facecolor markerfacecolor", "fontsize linewidth markersize"
    words = "fontweight horizontalalignment linestyle marker verticalalignment visible"
    return {
        **{k: np.concatenate([to_rgba_array(c) for c in ([], *of(k))]) for k in colours.split()},
        **{k: np.concatenate([np.ravel(v) for v in ([], *of(k))]) for k in numbers.split()},
        **{k: Counter(str(v) for v in of(k) if not isinstance(v, list)) for k in words.split()},
        "size": figure.get_size_inches(),
        "order": of("zorder"),
        "places": [text.get_position() for text in figure.texts],
        "axes": [[*axes.get_position().bounds, axes.axison] for axes in figure.axes],
        "columns": [legend._ncols for legend in legends],
    }


def test_colours_sizes_and_styles_in_figures_stay(small_figures, as_stored):
    as_stored({f"figure {n}": looks_of(figure) for n, figure in enumerate(small_figures)})


def test_a_colour_of_sound_speed_is_the_same_in_every_figure(small_figures):
    maps = [
        mesh.get_cmap()
        for figure in small_figures
        for axes in figure.axes
        for mesh in axes.collections
        if any("Sound speed" in other.get_ylabel() for other in figure.axes)
        and isinstance(mesh, QuadMesh | ContourSet)
        and mesh.get_array() is not None
        and mesh.get_array().size > 300
    ]
    assert len(maps) >= 4
    assert all(colours is style.SOUND_SPEED for colours in maps)


def test_depth_has_one_unit_within_a_figure(small_figures):
    for figure in small_figures:
        labels = [
            label
            for axes in figure.axes
            for label in (axes.get_ylabel(), getattr(axes, "get_zlabel", str)())
        ]
        units = {label.partition("[")[2] for label in labels if "epth" in label}
        assert len(units) <= 1, labels


def test_a_registered_figure_is_in_the_report_at_its_place(run, monkeypatch):
    monkeypatch.setattr(figures, "_REGISTER", dict(figures._REGISTER))
    before = [spec.name for spec in run_figure_specs(RunResults(run))]
    draw = {"draw": lambda r: style.new_figure(style.COLUMN, 2.0, r.header)}
    for caption in ("First.", "Of {r.attempts:,} attempts."):  # a cell of a notebook runs again
        register("mine", place=-1, caption=caption, **draw)
    register("not_here", place=-2, caption="", needs=lambda r: "unknowns" in r.tables, **draw)
    specs = run_figure_specs(RunResults(run))
    assert [spec.name for spec in specs] == ["mine", *before]
    assert specs[0].caption == "Of 72 attempts. Synthetic ocean."
    assert specs[0].draw().get_suptitle() == "Test Sea, synthetic ocean, 2014-07-15 12:00 UTC"


def test_profiles_are_drawn_in_water_with_depth_downward(look, water):
    profile = water.profile
    figure = look.draw(sound_speed_profiles([("One", profile), ("Other", profile)], HEADER))
    whole, upper = figure.axes
    wet = profile["count"].values > 0
    np.testing.assert_array_equal(whole.lines[0].get_xdata(), profile["mean"].values[wet])
    np.testing.assert_array_equal(whole.lines[0].get_ydata(), profile["depth"].values[wet])
    assert whole.get_ylim() == (3000.0, 0.0)
    assert upper.get_ylim() == (500.0, 0.0)
    shade = whole.collections[0].get_paths()[0].vertices
    assert shade[:, 0].min() == profile["min"].values[wet].min()
    assert shade[:, 0].max() == profile["max"].values[wet].max()
    low, high = upper.get_xlim()
    assert low < 1437.0
    assert 1450.0 < high < 1470.0, "the upper panel must not stretch to speeds of the deep"


@pytest.mark.parametrize(
    ("arriving", "legend"), [(0, None), (1, "direct eigenray"), (2, "2 direct eigenrays")]
)
def test_the_ray_picture_draws_eigenrays_and_states_its_exaggeration(look, water, arriving, legend):
    rays = water.rays(arriving)
    figure = look.draw(ray_picture(rays, HEADER))
    axes = figure.axes[0]
    (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 0.0), (1.0, 1000.0)])  # 1 km each way
    stated = float(axes.get_title(loc="left").rpartition(" ")[2])
    assert stated == pytest.approx(abs(y1 - y0) / abs(x1 - x0), rel=0.05)  # two digits are shown
    assert "A to B, 8 h 00 min" in axes.get_title(loc="left")
    assert legend is None or legend in look.texts(figure)
    direct = look.markers(axes, style.ORANGE)
    fan = [line for line in axes.lines if line.get_linewidth() < 0.5]
    assert (len(direct), len(fan)) == (arriving, 3)
    for line, x, z in zip(direct, rays["ray_range"].values, rays["ray_depth"].values, strict=False):
        np.testing.assert_array_equal(line.get_ydata(), z)
        np.testing.assert_allclose(line.get_xdata(), x / 1e3)
        assert line.get_zorder() > max(other.get_zorder() for other in fan)
    chord = next(line for line in look.markers(axes, style.INK) if line.get_linestyle() == "--")
    np.testing.assert_allclose(chord.get_xydata(), [[0.0, 100.0], [6.0, 800.0]])


def test_rays_of_links_have_colours_by_their_reflections(look, water):
    kinds = {"direct": (0, 0), "surface": (1, 0), "bottom": (0, 2), "surface and bottom": (1, 1)}
    surface, bottom = np.array([*kinds.values(), *[(0, 0)] * 3]).T
    seen = water.rays(4).assign(
        ray_surface_bounces=("ray", surface),
        ray_bottom_bounces=("ray", bottom),
        ray_travel_time=("ray", np.arange(2.0, 9.0)),
    )
    silent = water.rays(0).assign_attrs(status="SHADOW")
    silent = silent.assign(sound_speed=silent["sound_speed"] + 30.0)
    figure = look.draw(rays_of_links([seen, silent], ["one", "other"], HEADER))
    one, other = figure.axes[:2]
    assert one.get_title(loc="left").startswith("one, first of 4 after 2 s, vertical")
    assert other.get_title(loc="left").startswith("other, no arrival (shadow), vertical")
    thick = [
        line for line in one.lines if line.get_linewidth() > 1.0 and len(line.get_xdata()) == 41
    ]
    assert (
        len({(line.get_color(), str(line.get_linestyle()), line.get_linewidth()) for line in thick})
        == 4
    )
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [*(f"{kind} eigenrays" for kind in kinds), "straight chord", "other rays"]
    assert one.collections[0].get_clim() == other.collections[0].get_clim()
    assert one.collections[0].get_clim()[1] > np.nanmax(one.collections[0].get_array())


def test_rays_are_drawn_into_png_or_pdf_only(tmp_path):
    refused(
        ReportError,
        "rays.svg: a figure must have the suffix .png or .pdf",
        write_ray_plot,
        [],
        tmp_path / "rays.svg",
        titles=[],
    )


def test_ray_picture_shows_the_ice_and_no_water_in_it(look, water):
    rays = water.rays()
    draft = 20.0 + 10.0 * np.sin(rays["range"].values / 1e3)
    axes = look.draw(ray_picture(rays.assign(sea_ice_draft=("range", draft)), HEADER)).axes[0]
    ice = next(c for c in axes.collections if to_hex(c.get_facecolor()[0]) == style.ICE)
    assert ice.get_paths()[0].vertices[:, 1].max() == pytest.approx(draft.max())
    speed = axes.collections[0].get_array()
    depths = np.linspace(*axes.get_ylim()[::-1], len(speed))
    np.testing.assert_array_equal(
        ~np.ma.getmaskarray(speed)[depths < 200.0], depths[depths < 200.0, None] >= draft
    )


def test_ray_picture_ends_above_a_sea_bed_that_is_far_below(look, water):
    rays = water.rays()
    deepest = max(rays["ray_depth"].values[0].max(), rays["chord_depth"].values.max())
    whole = ray_picture(rays, HEADER).axes[0].get_ylim()
    assert whole == (min(3.0 * deepest, rays["depth"].values[-1]), 0.0)
    shallow = rays.assign(
        ray_depth=rays["ray_depth"] / 10.0, chord_depth=rays["chord_depth"] / 10.0
    )
    axes = look.draw(ray_picture(shallow, HEADER)).axes[0]
    assert axes.get_ylim()[0] == pytest.approx(0.3 * deepest)
    speed = axes.collections[0].get_array()
    seen = rays["sound_speed"].where(rays["depth"] <= 0.3 * deepest, drop=True)
    assert speed.max() <= rays["sound_speed"].values.max()
    assert speed.min() == pytest.approx(float(seen.min()), abs=0.5)


def test_fleet_is_drawn_east_to_the_right(records, as_stored):
    truth = records.truth
    figure = fleet_layout(truth, records.measurements, HEADER)
    as_stored(figure)
    plan = figure.axes[0]
    for line, path in zip(plan.lines, truth.position, strict=False):
        np.testing.assert_allclose(line.get_xydata(), path[:, [1, 0]] / 1e3)
    np.testing.assert_allclose(
        plan.collections[0].get_offsets(), truth.position[:, 0, [1, 0]] / 1e3
    )


def test_each_vehicle_has_its_colour_and_no_name_covers_another(look, made_run):
    truth, measurements, _, _ = made_run(names=tuple("ABCDEFGHIJK"), landmarks=2).records()
    crowd = replace(truth, position=truth.position[:1] + 30.0 * np.arange(11)[:, None, None])
    for figure in (
        fleet_layout(crowd, measurements, HEADER),
        factor_graph(crowd, measurements, HEADER),
    ):
        renderer = look.draw(figure).canvas.get_renderer()
        for axes in figure.axes:
            boxes = [text.get_window_extent(renderer) for text in axes.texts]
            assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    plan = fleet_layout(crowd, measurements, HEADER).axes[0]
    assert sorted(text.get_text() for text in plan.texts) == sorted(
        [*"ABCDEFGHIJK", *measurements.landmark_name.tolist()]
    )
    assert len({to_hex(line.get_color()) for line in plan.lines[:11]}) == 11


def test_a_condition_has_one_colour_on_all_figures(tables):
    names = ["straight", "first", "second"]
    colours = {name: colour for name, (colour, _) in style.condition_looks(names).items()}
    rows = tables.consistency.assign(condition="second")
    figure = consistency_over_time(rows, HEADER, names)
    assert figure.legends[0].get_lines()[0].get_color() == colours["second"]
    panel = ApePanel("p", {name: np.ones((1, 1, 9)) for name in names}, log=True)
    ridges = pooled_ape([panel], HEADER).axes
    assert [axes.texts[0].get_color() for axes in ridges] == list(colours.values())


def test_the_page_begins_with_the_result(run):
    names = [spec.name for spec in run_figure_specs(RunResults(run))]
    first = ["refraction", "range_error", "range_error_split", "ape_pooled", "error_over_time"]
    assert names[0] == first[0]
    assert [name for name in names if name in (*first, "fleet_layout", "sound_speed")] == [
        *first,
        "fleet_layout",
        "sound_speed",
    ]


def test_range_edges_of_the_graph_join_the_true_places_of_both_ends(look, records, as_stored):
    truth, measurements = records.truth, records.measurements
    figure = factor_graph(truth, measurements, HEADER)
    as_stored(figure)
    edges = (
        next(c for c in figure.axes[0].collections if isinstance(c, LineCollection))._segments3d
        * 1e3
    )
    heard = np.flatnonzero(measurements.range_status == RayStatus.OK)
    assert len(edges) == heard.size
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=-1)
    np.testing.assert_allclose(length, records.ranging_truth.distance[heard])
    who, sample = measurements.range_transmitter[heard], measurements.range_sample[heard]
    np.testing.assert_allclose(edges[:, 0], truth.position[who, sample][:, [1, 0, 2]])
    assert f"{heard.size:,} range edges" in look.texts(figure)


@pytest.mark.slow
def test_empty_and_degenerate_data_are_drawn_with_a_word_why(look, made_run):
    truth, measurements, _, _ = made_run(names=("A",), pings=0).records()
    nothing, time = np.full(7, np.nan), truth.time
    lost, never = {"straight": np.full((2, 1, time.size), np.nan)}, np.zeros((1, time.size), bool)
    for figure, word in (
        (range_error_histogram([("x", nothing)], ""), "no range was received"),
        (range_error_histogram([("x", np.empty(0))], ""), "no range was received"),
        (range_error_histogram([("x", np.array([3.0]))], ""), "N = 1"),
        (range_error_histogram([("x", np.zeros(5))], ""), "N = 5"),
        (range_error_split(nothing, nothing, nothing, ""), "no range was received"),
        (
            dropout_map(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, "i1"), ""),
            "no range was attempted",
        ),
        (pooled_ape([ApePanel("p", {"straight": nothing}, log=True)], ""), "no usable solve"),
        (pooled_ape([ApePanel("p", {"straight": np.zeros(9)}, log=True)], ""), "mean 0.00 m"),
        (pooled_ape([ApePanel("p", {}, log=False)], ""), "p"),
        (fleet_layout(truth, measurements, ""), "A"),
        (factor_graph(truth, measurements, ""), "0 range edges"),
        (error_over_time(time, ["A"], lost, never, ""), "Straight"),
    ):
        look.draw(figure)
        assert word in look.texts(figure)
