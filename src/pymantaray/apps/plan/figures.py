"""
Figures of a plan: front of designs, map of the best designs, error over time and lost links of each
pair.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymantaray.apps.plan import PlanResults
from pymantaray.apps.plan.detail import DesignDetail, Pair
from pymantaray.apps.plan.results import pareto_front
from pymantaray.apps.study.figures.fleet import draw_depths, draw_plan
from pymantaray.arrays import Array
from pymantaray.plotting import style
from pymantaray.records.result_table import heading

AS_IT_IS = "Study as it is"
_MAX_NUMBERS = 14  # participants of a matrix with a number in each cell
_NAME_LETTERS = 44  # of a design in a legend
_FROM_ZERO = 0.4  # least error over the upper end of its axis, above which the axis is without zero
# legend of designs, whose names are long
_BELOW: dict[str, Any] = {"loc": "outside lower center", "ncols": 2}
_BEST: dict[str, Any] = {
    "marker": "*",
    "color": style.ORANGE,
    "markersize": 9.0,
    "markeredgecolor": style.INK,
}
_SIGNS = "osD^v"


def other_objective(results: PlanResults) -> str:
    """
    Column of the horizontal axis of the front: costs if there are any, otherwise the next
    objective, otherwise lost links.
    """
    if results.frame["cost"].gt(0.0).any():
        return "cost"
    columns = [
        "heard_by_two_percent" if o == "heard_by_two" else "lost_percent"
        for o in results.plan.section.objectives
        if o in ("lost", "heard_by_two")
    ]
    return columns[0] if columns else "lost_percent"


@style.styled
def front_figure(results: PlanResults, header: str, width: float = style.DOUBLE) -> Figure:
    """
    Error of all designs against cost or lost links, with the front and the near-optimal designs.
    """
    several = len(results.base) > 1
    figure, panels = style.panel_figure(
        width, header, 1 + several, height=3.0, stacked=2.4, sharey=True
    )
    x = other_objective(results)
    for axes, before, words, letter in zip(
        panels,
        ("", "worst_"),
        ("mean of the waters", "worst tenth of the waters"),
        "ab",
        strict=False,
    ):
        _draw_front(axes, results, f"{before}{x}", f"{before}error_m")
        axes.set_xlabel(heading(x))
        if several:
            style.panel_title(axes, letter, words)
    panels[0].set_ylabel("95 % position error [m]")
    entries = [
        style.entry("design", marker="o", color=style.SKY, linestyle="none", markersize=4.0),
        style.entry("front", color=style.BLUE),
        style.entry(
            "error within 10 %",
            marker="o",
            color=style.GREEN,
            markerfacecolor="white",
            linestyle="none",
            markersize=6.5,
        ),
        style.entry("best", linestyle="none", **_BEST),
        style.entry("as it is", marker="x", color=style.INK, linestyle="none"),
    ]
    style.common_legend(figure, entries)
    return figure


def _draw_front(axes: Axes, results: PlanResults, x: str, y: str) -> None:
    values = results.frame[[x, y]].to_numpy(dtype=float)
    usable = np.isfinite(values).all(axis=1)
    if not usable.any():
        style.note(axes, "no design with a result")
        return
    sign = -1.0 if "heard" in x else 1.0
    front = np.flatnonzero(pareto_front(values * [sign, 1.0]))
    front = front[np.argsort(values[front, 0])]
    error = values[:, 1]
    near = usable & (error <= 1.1 * np.nanmin(np.where(usable, error, np.nan)))
    axes.plot(
        *values[front].T,
        color=style.BLUE,
        drawstyle="steps-post" if sign > 0 else "steps-pre",
        zorder=1,
    )
    axes.plot(*values[near].T, "o", color=style.GREEN, markerfacecolor="white", markersize=6.5)
    axes.plot(*values[usable].T, "o", color=style.SKY, markersize=4.0)
    axes.plot(*values[front].T, "o", color=style.BLUE, markersize=4.0)
    axes.plot(*values[results.best], linestyle="none", zorder=5, **_BEST)
    base = results.base_row
    # visible behind the best design
    axes.plot(base[x], base[y], "x", color=style.INK, markersize=9.0, zorder=4)
    axes.margins(0.08)


@style.styled
def map_figure(
    details: Mapping[str, DesignDetail], header: str, width: float = style.DOUBLE
) -> Figure:
    """
    Mission of the best design in plan and depth, with the landmarks and stations of the other
    designs.
    """
    (_, best), *others = details.items()
    places = _moved(best, [detail for _, detail in others])
    keyed = any(len(points) for points in places)
    # two panels, with room for the legend
    if width == style.COLUMN:
        room = 0.15 * sum(len(points) > 0 for points in places)  # for the legend [in]
        figure = style.new_figure(width, 5.6 + room, header, layout=None)
        high = figure.get_figheight()
        rows = ((2.95 + room, 2.3), (0.5 + room, 1.8))  # lower edges and heights [in]
        plan, depth = (figure.add_axes((0.16, y / high, 0.8, h / high)) for y, h in rows)
    else:
        figure = style.new_figure(width, 3.4, header, layout=None)
        low = 0.26 if keyed else 0.14  # room for the legend
        plan, depth = (figure.add_axes((left, low, 0.4, 0.87 - low)) for left in (0.08, 0.58))
    # mission and landmarks of the best design
    colours = style.vehicle_colours(best.truth.name.size)
    draw_plan(plan, best.truth, best.measurements, colours)
    draw_depths(depth, best.truth, colours)
    for z in best.measurements.landmark_position[:, 2]:
        depth.axhline(z, color=style.INK, linestyle="--", linewidth=0.9)
    # landmarks and stations of the other designs
    for sign, points in zip(_SIGNS, places, strict=False):
        look: dict[str, Any] = {
            "color": style.GREY,
            "markerfacecolor": "white",
            "linestyle": "none",
            "markersize": 4.0,
        }
        plan.plot(points[:, 1] / 1e3, points[:, 0] / 1e3, marker=sign, zorder=4, **look)
        depth.plot(
            np.full(len(points), best.hours[-1]), points[:, 2], marker=sign, clip_on=False, **look
        )
    # limits that contain all depths
    deepest = max(
        [
            depth.get_ylim()[0],
            *(1.06 * p[:, 2].max() for p in places if len(p)),
            *(1.06 * best.measurements.landmark_position[:, 2]),
        ]
    )
    depth.set_ylim(deepest, -0.04 * deepest)
    style.panel_title(plan, "a", "plan")
    style.panel_title(depth, "b", "depth; landmarks dashed")
    # legend of the other designs
    entries = [
        style.entry(
            style.plain(style.short(name, _NAME_LETTERS)),
            marker=sign,
            color=style.GREY,
            markerfacecolor="white",
            linestyle="none",
            markersize=4.0,
        )
        for sign, (name, _), points in zip(_SIGNS, others, places, strict=False)
        if len(points)
    ]
    if entries:
        style.common_legend(figure, entries, loc="lower center", ncols=2)
    return figure


def _moved(best: DesignDetail, others: Sequence[DesignDetail]) -> list[Array]:
    """
    Start positions of participants of other designs that the best design has not, shape (n, 3) for
    each design.
    """
    known = _places(best)
    moved = []
    for other in others:
        rows = [
            place
            for name, place in _places(other).items()
            if not np.allclose(known.get(name, np.nan), place)
        ]
        moved.append(np.array(rows).reshape(-1, 3))
    return moved


def _places(detail: DesignDetail) -> dict[str, Array]:
    landmarks = detail.measurements
    starts = dict(zip(detail.truth.name.tolist(), detail.truth.position[:, 0], strict=True))
    return starts | dict(
        zip(landmarks.landmark_name.tolist(), landmarks.landmark_position, strict=True)
    )


@style.styled
def time_figure(
    details: Mapping[str, DesignDetail], header: str, width: float = style.DOUBLE
) -> Figure:
    """
    95 % position error of a few designs over time; shaded up to the water with the largest error.
    """
    figure, (axes,) = style.panel_figure(width, header, 1, height=2.9, stacked=2.3)
    widths = np.linspace(2.7, 0.9, len(details))  # a curve does not hide another on its place
    # colours of designs: orange for the best, grey for the study as it is
    names = list(details)
    more = iter((style.BLUE, style.GREEN, style.PINK, style.SKY))
    looks = zip(
        [
            style.ORANGE if k == 0 else style.GREY if name == AS_IT_IS else next(more)
            for k, name in enumerate(names)
        ],
        widths,
        details.items(),
        strict=True,
    )
    for colour, line_width, (name, detail) in looks:
        axes.plot(
            detail.hours,
            detail.error_m,
            linewidth=line_width,
            marker="o",
            markersize=2.5,
            color=colour,
            label=style.plain(style.short(name, _NAME_LETTERS)),
        )
        if np.nanmax(detail.worst_m - detail.error_m, initial=0.0) > 0.0:
            axes.fill_between(
                detail.hours,
                detail.error_m,
                detail.worst_m,
                color=colour,
                alpha=0.15,
                linewidth=0.0,
            )
    least = min(float(np.nanmin(detail.error_m, initial=np.inf)) for detail in details.values())
    if least < _FROM_ZERO * axes.get_ylim()[1]:  # otherwise most of the panel would be empty
        axes.set_ylim(bottom=0.0)
    axes.set(xlabel="Time [h]", ylabel="95 % position error [m]")
    style.common_legend(figure, axes.get_legend_handles_labels()[0], **_BELOW)
    return figure


@style.styled
def pairs_figure(
    details: Mapping[str, DesignDetail], header: str, width: float = style.DOUBLE
) -> Figure:
    """
    Share of lost ranges of each pair of participants in the best design and in the study as it is.
    """
    (name, best), *others = details.items()
    shown = [(name, best), *(pair for pair in others if pair[0] == AS_IT_IS)]
    figure, panels = style.panel_figure(width, header, len(shown), height=3.4, stacked=3.0)
    for k, (axes, (words, detail)) in enumerate(zip(panels, shown, strict=True)):
        image = _draw_pairs(axes, detail)
        style.panel_title(axes, style.letter(k), style.plain(style.short(words)))
    bar: dict[str, Any] = {"shrink": 0.8}
    if width == style.COLUMN:
        bar |= {"location": "bottom", "fraction": 0.04, "aspect": 30}
    figure.colorbar(image, ax=panels, label="Lost ranges [%]", **bar)
    return figure


def _draw_pairs(axes: Axes, detail: DesignDetail) -> Any:
    names = list(_places(detail))
    matrix = np.full((len(names), len(names)), np.nan)
    for (a, b), lost in detail.lost_percent.items():
        matrix[names.index(a), names.index(b)] = matrix[names.index(b), names.index(a)] = lost
    image = axes.imshow(matrix, vmin=0.0, vmax=100.0, cmap="Blues")
    axes.grid(visible=False)
    if len(names) <= _MAX_NUMBERS:
        for (i, j), lost in np.ndenumerate(matrix):
            if np.isfinite(lost):
                axes.text(
                    j,
                    i,
                    f"{lost:.0f}",
                    ha="center",
                    va="center",
                    fontsize=6.0,
                    color="white" if lost > 50.0 else style.INK,
                )
    labels = [style.plain(name) for name in style.shortened(names, 8)]
    axes.set_xticks(
        range(len(names)), labels, rotation=90 if max(map(len, labels)) > 2 else 0, fontsize=6.0
    )
    axes.set_yticks(range(len(names)), labels, fontsize=6.0)
    axes.tick_params(length=0.0)
    return image


def pair_frame(details: Mapping[str, DesignDetail]) -> pd.DataFrame:
    """Share of lost ranges of each pair in all shown designs, one column per design. [%]"""
    pairs: dict[Pair, None] = dict.fromkeys(
        pair for d in details.values() for pair in d.lost_percent
    )
    rows = [
        {
            "pair": " to ".join(pair),
            **{name: d.lost_percent.get(pair, np.nan) for name, d in details.items()},
        }
        for pair in pairs
    ]
    return pd.DataFrame(rows, columns=["pair", *details])
