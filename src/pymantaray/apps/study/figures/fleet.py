"""Layout of the vehicles in plan and in depth, and their factor graph."""

from collections.abc import Callable
from itertools import takewhile
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

from pymantaray.apps.study.figures.register import both_widths, range_ends, register
from pymantaray.arrays import Array
from pymantaray.plotting import style
from pymantaray.records import Measurements, Trajectories
from pymantaray.records.status import ARRIVES

_ENU = [1, 0, 2]  # a figure has east to the right; depth stays positive down
_SHALLOWEST = 0.05  # km; depth of the axes where nobody dives
_MAX_NAME_LETTERS = 6  # letters; longer names cover each other
_LETTER = 0.058  # of a key below a figure: width of a letter and of a mark, a line's height [in]
_WORDS = 56  # letters of a line of words below the factor graph
_KEY_MARK = 0.42
_KEY_LINE = 0.16
# directions from a mark to its name
_WAYS = np.array([(1, 1), (1, 0), (1, -1), (-1, 1), (-1, 0), (-1, -1), (0, 1), (0, -1)])
_LABEL_DISTANCES = (3.0, 9.0, 16.0, 24.0)  # points
_NAME: dict[str, Any] = {
    "fontsize": 6.5,
    "fontweight": "bold",
    "color": style.INK,
    "va": "bottom",
    "zorder": 9,
    "path_effects": style.halo(),
}
_MAX_VERTICES = 600  # of a chain in three dimensions, where every vertex costs


class _Layout(NamedTuple):
    """Size of a figure of a fleet [in], and places of its panels and of the title of the second."""

    width: float
    height: float
    plan: tuple[float, float, float, float]
    solid: tuple[float, float, float, float]
    time: tuple[float, float, float, float]
    title: tuple[float, float]


_BESIDE = _Layout(
    style.DOUBLE,
    4.6,
    (0.075, 0.47, 0.40, 0.45),
    (0.50, 0.40, 0.44, 0.54),
    (0.075, 0.09, 0.90, 0.24),
    (0.55, 0.9335),
)
_BELOW = _Layout(
    style.COLUMN,
    7.6,
    (0.165, 0.70, 0.785, 0.25),
    (-0.04, 0.245, 0.92, 0.36),
    (0.18, 0.06, 0.77, 0.15),
    (0.15, 0.62),
)


@style.styled
def fleet_layout(
    truth: Trajectories,
    measurements: Measurements,
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """
    Fleet in plan, in depth over time, and in three dimensions; for one column of a journal, with
    the panels below each other.
    """
    layout = _BELOW if width == style.COLUMN else _BESIDE
    colours = style.vehicle_colours(truth.name.size)
    key = _key(truth, measurements, colours)
    figure, place = _figure_with_key(layout.width, layout.height, header, key)
    plan = figure.add_axes(place(*layout.plan))
    solid = figure.add_axes(place(*layout.solid), projection="3d")
    time = figure.add_axes(place(*layout.time))
    draw_plan(plan, truth, measurements, colours)
    assert isinstance(solid, Axes3D)
    deepest = truth.position[:, :, 2].max(axis=1) / 1e3
    feet = truth.position[:, 0] / 1e3
    feet[:, 2] = deepest
    for i, colour in enumerate(colours):
        start = truth.position[i, 0] / 1e3
        foot = feet[i]
        _line(solid, np.stack([start, foot]), color=colour, linewidth=0.6, linestyle=":")
        _line(solid, truth.position[i] / 1e3, color=colour, linewidth=0.7)
        solid.plot(*foot[_ENU, None], "o", color=colour, markersize=3.2)
    _finish(solid, truth, measurements, feet)
    draw_depths(time, truth, colours)
    style.panel_title(plan, "a", "plan")
    figure.text(*place(*layout.title)[:2], "(b) start, greatest depth and track", fontsize=7.5)
    style.panel_title(time, "c", "depth")
    return figure


@style.styled
def factor_graph(
    truth: Trajectories, measurements: Measurements, header: str, *, one_ping: bool = False
) -> Figure:
    """
    Factor graph in three dimensions: coloured chains of poses, one per vehicle, and grey ranges.

    With ``one_ping``, only the ranges of the ping that has most are drawn, as lines that a reader
    can tell apart.
    """
    colours = style.vehicle_colours(truth.name.size)
    figure, place = _figure_with_key(style.COLUMN, 3.1, header, _key(truth, measurements, colours))
    axes = figure.add_axes(place(-0.045, 0.1, 0.93, 0.83), projection="3d")
    assert isinstance(axes, Axes3D)
    received = np.isin(measurements.range_status, ARRIVES)
    words = f"{truth.position.shape[0] * truth.position.shape[1]:,} poses,"
    words += f" {received.sum():,} range edges"
    if one_ping and received.any():
        ping = np.bincount(measurements.range_sample[received]).argmax()
        received &= measurements.range_sample == ping
        hour = style.clock(float(truth.time[ping]) / 3600.0)
        words += f"; {received.sum():,} of them, at {hour}, are shown"
        words = "\n".join(wrap(words, _WORDS))
    edges = np.stack(range_ends(truth, measurements), axis=1)[received]
    if len(edges):
        alpha = float(np.clip(600 / len(edges), 0.08, 0.5))
        lines = edges[..., _ENU] / 1e3
        axes.add_collection3d(
            Line3DCollection(lines, colors="#8a8a8a", linewidths=0.25, alpha=alpha, rasterized=True)
        )
    for path, colour in zip(truth.position / 1e3, colours, strict=True):
        _line(axes, path, color=colour, linewidth=0.5 if one_ping else 1.3)
    starts = truth.position[:, 0] / 1e3
    for start, colour in zip(starts, colours, strict=True):
        axes.plot(
            *start[_ENU, None], "o", color=colour, markersize=3.4, markeredgecolor="white", zorder=8
        )
    _finish(axes, truth, measurements, starts)
    figure.text(*place(0.5, 0.02)[:2], words, ha="center", fontsize=6.5, color=style.GREY)
    return figure


def _key(truth: Trajectories, measurements: Measurements, colours: list[str]) -> list[Line2D]:
    """Legend of the marks of vehicles and landmarks that are not their names."""
    vehicles = zip(_marks(truth.name), truth.name.tolist(), colours, strict=True)
    landmarks = zip(
        _marks(measurements.landmark_name, "L"), measurements.landmark_name.tolist(), strict=True
    )
    looks = [(mark, name, {"color": colour, "marker": "o"}) for mark, name, colour in vehicles]
    looks += [(mark, name, {"color": style.INK, "marker": "^"}) for mark, name in landmarks]
    return [
        style.entry(
            style.plain(f"{mark}: {style.short(name)}"), linestyle="none", markersize=3.6, **look
        )
        for mark, name, look in looks
        if mark != name
    ]


def _figure_with_key(
    width: float, height: float, header: str, key: list[Line2D]
) -> tuple[Figure, Callable[..., tuple[float, float, float, float]]]:
    """
    Figure with a key below its panels, and a function that places a panel above it; all lengths in
    inches.
    """
    longest = max((len(str(entry.get_label())) for entry in key), default=0)
    columns = max(1, int(width / (_LETTER * longest + _KEY_MARK)))
    room = _KEY_LINE * -(-len(key) // columns)
    figure = style.new_figure(width, height + room, header, layout=None)
    if key:
        style.common_legend(
            figure, key, loc="lower center", ncols=min(columns, len(key)), handletextpad=0.2
        )

    def place(
        left: float, low: float, wide: float = 0.0, high: float = 0.0
    ) -> tuple[float, float, float, float]:
        whole = figure.get_figheight()  # with the lines of the header
        return left, (low * height + room) / whole, wide, high * height / whole

    return figure, place


def draw_plan(
    axes: Axes, truth: Trajectories, measurements: Measurements, colours: list[str]
) -> None:
    """Draw tracks and landmarks from above, with names at the start positions."""
    starts = truth.position[:, 0, :2] / 1e3
    for path, colour in zip(truth.position[:, :, :2] / 1e3, colours, strict=True):
        axes.plot(path[:, 1], path[:, 0], color=colour, linewidth=0.9)
    axes.scatter(
        starts[:, 1], starts[:, 0], c=colours, s=16, edgecolors=style.INK, linewidths=0.5, zorder=3
    )
    places = measurements.landmark_position[:, :2] / 1e3
    axes.plot(places[:, 1], places[:, 0], "^", color=style.INK, markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set(xlabel="East [km]", ylabel="North [km]")
    _write_names(axes, np.concatenate([starts, places])[:, ::-1], _all_marks(truth, measurements))


def draw_depths(axes: Axes, truth: Trajectories, colours: list[str]) -> None:
    """Draw depths of vehicles against time, downward."""
    hours = truth.time / 3600.0
    for path, colour in zip(truth.position[:, :, 2], colours, strict=True):
        axes.plot(hours, path, color=colour, linewidth=0.9)
    deepest = float(truth.position[:, :, 2].max())
    axes.set(
        ylim=(1.06 * max(deepest, 1.0), -0.04 * deepest),
        xlim=(hours[0], hours[-1]),
        xlabel="Time [h]",
        ylabel="Depth [m]",
    )


def _line(axes: Axes3D, path: Array, **look: object) -> None:
    step = max(1, -(-len(path) // _MAX_VERTICES))
    vertices = path[np.unique(np.append(np.arange(0, len(path), step), len(path) - 1))]
    axes.plot(*vertices[:, _ENU].T, **look)


def _marks(names: Array, letter: str = "") -> list[str]:
    """
    Labels at the markers: names, without their common prefix if they are long, or numbers if they
    are still too long.
    """
    marks: list[str] = names.tolist()
    if max(map(len, marks), default=0) > _MAX_NAME_LETTERS and len(marks) > 1:
        common = len(
            list(takewhile(lambda letters: len(set(letters)) == 1, zip(*marks, strict=False)))
        )
        marks = [name[common:] or name for name in marks]
    if max(map(len, marks), default=0) > _MAX_NAME_LETTERS:
        marks = [f"{letter}{i}" for i in range(1, len(marks) + 1)]
    return marks


def _all_marks(truth: Trajectories, measurements: Measurements) -> list[str]:
    """Labels at the markers of vehicles and landmarks."""
    return [*_marks(truth.name), *_marks(measurements.landmark_name, "L")]


def _write_names(axes: Axes, places: Array, names: list[str]) -> None:
    """
    Write names next to points (n, 2) in data coordinates, each on the side with the smallest
    overlap.
    """
    figure = axes.figure
    assert isinstance(figure, Figure)
    axes.apply_aspect()
    dots = axes.transData.transform(places)
    per_point = figure.dpi / 72.0
    # rectangles of markers, then of names too
    covered = np.stack([dots - 2.0 * per_point, dots + 2.0 * per_point], axis=1)
    for name, place, dot in zip(names, places, dots, strict=True):
        text = axes.annotate(style.plain(name), place, (0, 0), textcoords="offset points", **_NAME)
        box = text.get_window_extent()
        size = np.array([box.width, box.height])
        low = np.concatenate(
            [dot + r * per_point * _WAYS + 0.5 * (_WAYS - 1) * size for r in _LABEL_DISTANCES]
        )
        common = np.minimum(covered[:, 1], (low + size)[:, None]) - np.maximum(
            covered[:, 0], low[:, None]
        )
        best = low[np.argmin(np.prod(np.maximum(common, 0.0), axis=-1).sum(axis=1))]
        text.set_position((best - dot) / per_point)
        covered = np.concatenate([covered, [[best, best + size]]])


def _finish(axes: Axes3D, truth: Trajectories, measurements: Measurements, marks: Array) -> None:
    """
    Draw landmarks and names, and set axes with depth downward and equal scales of north and east.
    """
    places = measurements.landmark_position / 1e3
    for place in places:
        axes.plot(*place[_ENU, None], "^", color=style.INK, markersize=4)
    points = np.concatenate([truth.position.reshape(-1, 3) / 1e3, places])
    low = points.min(axis=0)
    high = points.max(axis=0)
    span = np.maximum(1.08 * (high - low), [0.5 * (high - low)[:2].max()] * 2 + [1e-3])
    span[:2] = np.maximum(span[:2], 1e-2)
    middle = 0.5 * (low + high)
    axes.set(
        xlim=(middle[1] - 0.5 * span[1], middle[1] + 0.5 * span[1]),
        ylim=(middle[0] - 0.5 * span[0], middle[0] + 0.5 * span[0]),
        zlim=(max(float(high[2]), _SHALLOWEST) * 1.02, 0.0),
    )
    widest = span[:2].max()
    axes.set_box_aspect((span[1] / widest, span[0] / widest, 0.55), zoom=1.12)
    axes.view_init(elev=22.0, azim=-58.0)
    axes.tick_params(pad=-2.5, labelsize=6.0)
    axes.zaxis.set_tick_params(pad=-1.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = -7.0
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
    for axis, share in zip("xyz", (*span[[1, 0]] / widest, 1.0), strict=True):
        axes.locator_params(axis=axis, nbins=max(2, round(5 * share)))
    axes.set(xlabel="East [km]", ylabel="North [km]", zlabel="Depth [m]")
    axes.zaxis.set_major_formatter(FuncFormatter(lambda km, _: f"{1e3 * km:g}"))  # as in (c)
    axes.apply_aspect()
    x, y, _ = proj_transform(*np.concatenate([marks, places])[:, _ENU].T, axes.get_proj())
    _write_names(axes, np.stack([x, y], axis=1), _all_marks(truth, measurements))


register(
    "fleet_layout",
    place=80,
    paper="Figure 5",
    of_mission=True,
    caption="Fleet layout: (a) start positions and drift in plan, (b) start (dotted line downward"
    " to the vehicle's greatest depth) and track, (c) depth against time. Each vehicle has one"
    " colour in all figures of the fleet; names that are too long for the plan are numbered, with"
    " a key below.",
    **both_widths(
        lambda r, width: fleet_layout(r.run.truth, r.run.measurements, r.header, width=width)
    ),
)
register(
    "factor_graph",
    place=90,
    paper="Figure 2B",
    of_mission=True,
    caption="Factor graph at the true positions: chains of poses coloured by vehicle, the"
    " {r.received:,} received ranges in grey.",
    draw=lambda r: factor_graph(r.run.truth, r.run.measurements, r.header),
    column=lambda r: factor_graph(r.run.truth, r.run.measurements, r.header, one_ping=True),
    needs=lambda r: r.run.study.solves,
)
