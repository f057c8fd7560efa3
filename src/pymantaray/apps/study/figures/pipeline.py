"""
Diagram of the stages of a study and the records that pass between them, from the signatures of the
code.
"""

from collections.abc import Callable, Sequence
from dataclasses import is_dataclass
from functools import partial
from textwrap import fill
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path
from matplotlib.transforms import Bbox

from pymantaray.acoustics.ocean_fields import build_medium
from pymantaray.apps.study.figures.register import both_widths, register
from pymantaray.apps.study.mission import range_fleet, simulate_fleet
from pymantaray.config.door.ocean import mission_ocean
from pymantaray.estimation import collect_estimates, solve_conditions
from pymantaray.evaluation import error_table, range_error_table
from pymantaray.plotting import style
from pymantaray.sensing import assemble, perturb

STAGES: tuple[tuple[str, str, Callable[..., Any]], ...] = (
    ("ocean", "model, casts or synthetic", mission_ocean),
    ("fleet", "drift, dive and drive", simulate_fleet),
    ("water", "smooth field for rays", build_medium),
    ("acoustics", "eigenrays and travel times", range_fleet),
    ("sensing", "measurements without noise", assemble),
    ("evaluation", "range errors, failures", range_error_table),
    ("sensing", "noise of each realization", perturb),
    ("estimation", "factor graph for each condition", solve_conditions),
    ("estimation", "estimates of all realizations", collect_estimates),
    ("evaluation", "position error", error_table),
)
"""Stages of a study in order: folder, description, and function."""
_SIZE = (0.80, 0.66)  # of a box, in columns and rows
_TURNED_ROW = 0.72  # height of a row of stages in one column [in]
_CLEARANCE = 0.04  # between an arrow and a box that it passes
_ARROW: dict[str, Any] = {
    "color": style.GREY,
    "linewidth": 0.7,
    "shrinkA": 0.0,
    "shrinkB": 0.0,
    "zorder": 2,
}
_COLOURS = {
    "ocean": "#cfe8f6", "water": "#cfe8f6", "fleet": "#d5efe4", "acoustics": "#fbe0d0",
    "sensing": "#fdf3cf", "estimation": "#e6def3", "evaluation": "#f6dbe9",
}  # fmt: skip


class Flow(NamedTuple):
    """A record that passes from one stage to another."""

    source: int
    target: int
    record: str


def flows(functions: Sequence[Callable[..., Any]]) -> list[Flow]:
    """
    Records that pass between stages: each argument of a function, from the last function before it
    that returns this type.

    A function returns its annotated type and the records in this type.
    """
    makers: dict[type, int] = {}
    found = []
    for target, function in enumerate(functions):
        hints = dict(get_type_hints(function))
        made = records_of(hints.pop("return"))
        taken = dict.fromkeys(record for hint in hints.values() for record in records_of(hint))
        found += [
            Flow(makers[record], target, record.__name__) for record in taken if record in makers
        ]
        makers |= dict.fromkeys(made, target)
        held = [
            r
            for record in made
            for hint in get_type_hints(record).values()
            for r in records_of(hint)
        ]
        makers = dict.fromkeys(held, target) | makers
    return found


def records_of(hint: Any) -> list[type]:
    """Data classes and named tuples of this package that an annotation names."""
    inner = [record for part in get_args(hint) for record in records_of(part)]
    own = (
        isinstance(hint, type)
        and hint.__module__.startswith("pymantaray.")
        and (is_dataclass(hint) or issubclass(hint, tuple))
    )
    return [hint, *inner] if own else inner


def columns(count: int, between: Sequence[Flow]) -> list[int]:
    """Column of each stage: one to the right of the last stage from which it takes a record."""
    places: list[int] = []
    for stage in range(count):
        places.append(1 + max((places[f.source] for f in between if f.target == stage), default=-1))
    return places


@style.styled
def pipeline(header: str, *, width: float = style.DOUBLE) -> Figure:
    """
    Diagram with stages in columns, and one arrow for each record between two stages.

    For one column of a journal, the stages are in rows, and the arrows point downward.
    """
    between = flows([function for *_, function in STAGES])
    column = columns(len(STAGES), between)
    spots = [(x, column[:i].count(x) - (column.count(x) - 1) / 2.0) for i, x in enumerate(column)]
    turned = width == style.COLUMN
    figure = style.new_figure(
        width, 0.2 + _TURNED_ROW * (max(column) + 1) if turned else 2.6, header
    )
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xticks=[], yticks=[])
    paths = []
    for source, target in dict.fromkeys((flow.source, flow.target) for flow in between):
        others = [spot for k, spot in enumerate(spots) if k not in (source, target)]
        path = route(spots[source], spots[target], others)
        paths.append(Path(np.asarray(path.vertices)[:, ::-1], path.codes) if turned else path)
        axes.add_patch(
            FancyArrowPatch(path=paths[-1], arrowstyle="-|>", mutation_scale=8, **_ARROW)
        )
    extent = Bbox.union([path.get_extents() for path in paths])
    low, high = (extent.x0, extent.x1) if turned else (extent.y0, extent.y1)
    along = (-0.5, max(column) + 0.5)
    beside = (max(high, 0.85) + 0.05, min(low, -0.85) - 0.05)
    if turned:
        axes.set(xlim=beside[::-1], ylim=along[::-1])
    else:
        axes.set(xlim=along, ylim=beside)
    for spot, (folder, words, function) in zip(spots, STAGES, strict=True):
        made = " ".join(
            record.__name__ for record in records_of(get_type_hints(function)["return"])[:1]
        )
        # draw the box of a stage: folder, description, and the record that it returns
        x, y = spot[::-1] if turned else spot
        across, down = _SIZE[::-1] if turned else _SIZE
        box = FancyBboxPatch(
            (x - across / 2.0, y - down / 2.0),
            across,
            down,
            boxstyle="round,pad=0,rounding_size=0.06",
            facecolor=_COLOURS[folder],
            edgecolor=style.INK,
            linewidth=0.7,
            zorder=3,
        )
        axes.add_patch(box)
        write = partial(axes.text, x, ha="center", va="center", zorder=4, fontsize=6.0)
        step, letters = (0.28, 20) if turned else (0.23, 14)
        write(y - step + 0.01, folder, fontweight="bold")
        write(y, fill(words, letters))
        write(y + step + 0.01, made, color=style.GREY, fontstyle="italic")
    return figure


def route(
    source: tuple[float, float], target: tuple[float, float], others: Sequence[tuple[float, float]]
) -> Path:
    """Arrow between two boxes: a straight line, or a curve above or below the other boxes."""
    half = _SIZE[0] / 2.0
    rise = _SIZE[1] / 2.0
    straight = Path([(source[0] + half, source[1]), (target[0] - half, target[1])])
    if not crosses(straight, others):
        return straight
    side = -1.0 if source[1] + target[1] <= 0.0 else 1.0
    start = (source[0] + half / 2.0, source[1] + side * rise)
    end = (target[0] - half / 2.0, target[1] + side * rise)
    nearest = max(side * source[1], side * target[1]) + rise + 0.15
    for reach in np.arange(nearest, nearest + 4.0, 0.1):
        bend = [start, (start[0], side * reach), (end[0], side * reach), end]
        curve = Path(bend, [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])
        if not crosses(curve, others):
            break
    return curve


def crosses(path: Path, boxes: Sequence[tuple[float, float]]) -> bool:
    """True if a path passes through a box or touches it."""
    size = np.array(_SIZE) + 2.0 * _CLEARANCE
    return any(
        path.intersects_bbox(Bbox.from_bounds(*(np.array(spot) - size / 2.0), *size), filled=False)
        for spot in boxes
    )


register(
    "pipeline",
    place=120,
    of_mission=True,
    paper="Figure 3",
    caption="Stages of a study with their folders in the package; arrows are the records (italic)"
    " that pass between them.",
    **both_widths(lambda r, width: pipeline(r.header, width=width)),
)
