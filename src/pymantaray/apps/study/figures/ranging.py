"""Effect of refraction on ranges: distribution of the error, its two parts, and dropouts."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from pymantaray.apps.study.figures.register import both_widths, range_ends, register
from pymantaray.arrays import Array
from pymantaray.plotting import style
from pymantaray.records import RayStatus
from pymantaray.records.status import RAY_STATUS_WORDS

_MAX_NAME_LETTERS = 16  # letters of a name
_MIN_COUNT = 0.6  # where logarithmic axes of counts begin, so that a single one shows
_STATUS_LOOK = {
    RayStatus.SHADOW: (style.ORANGE, "o"),
    RayStatus.WEAK: (style.BLUE, "s"),
    RayStatus.BLOCKED: (style.GREEN, "^"),
    RayStatus.OUTSIDE: (style.PINK, "D"),
    RayStatus.STOPPED: (style.SKY, "v"),
    RayStatus.UNHEARD: (style.INK, "x"),
    RayStatus.UNRESOLVED: (style.INK, "+"),
    RayStatus.LEAKED: (style.GREY, "o"),
    RayStatus.SCATTERED: (style.GREY, "^"),
}


@style.styled
def range_error_histogram(
    errors: Sequence[tuple[str, Array]], header: str, *, width: float = style.DOUBLE
) -> Figure:
    """Signed range error, refracted minus straight, with its mean, zero and the fitted normal."""
    narrow = width == style.COLUMN
    shape, height = ((2 * len(errors), 1), 3.5) if narrow else ((len(errors), 2), 2.05)
    figure = style.new_figure(width, 0.55 + height * len(errors), header)
    rows = figure.subplots(*shape, squeeze=False, sharex=True).reshape(-1, 2)
    for i, ((name, values), (linear, log)) in enumerate(zip(errors, rows, strict=True)):
        received = draw_range_errors(linear, values)
        draw_range_errors(log, values, log=True)
        log.set_ylabel("")
        words = [style.short(name), _moments(received)]
        same = "the same, logarithmic count"
        if len(name) > _MAX_NAME_LETTERS and not narrow:  # no room for both above one panel
            same = words.pop()
        style.panel_title(linear, style.letter(2 * i), style.plain(": ".join(words)))
        style.panel_title(log, style.letter(2 * i + 1), same)
    for axes in rows.flat[: -1 if narrow else -2]:
        axes.set_xlabel("")
    style.common_legend(figure, rows[0, 0].get_legend_handles_labels()[0])
    return figure


@style.styled
def range_error_split(
    distance: Array,
    reference_speed: Array,
    bending: Array,
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """The two parts of the range error, against distance and as distributions."""
    if width == style.COLUMN:
        figure = style.new_figure(width, 4.4, header)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 0.8))
        both, counts, alone = map(figure.add_subplot, (grid[0, 0], grid[0, 1], grid[1, :]))
    else:
        figure = style.new_figure(width, 2.7, header)
        both, counts, alone = figure.subplots(1, 3, width_ratios=(1.25, 0.8, 1.25))
    counts.sharey(both)
    # parts of the received ranges
    received = np.isfinite(distance) & np.isfinite(reference_speed) & np.isfinite(bending)
    km = distance[received] / 1e3
    points: dict[str, Any] = {"markersize": 1.6, "alpha": 0.5, "rasterized": True}
    parts = (
        ("reference speed", reference_speed[received], style.BLUE),
        ("bending", bending[received], style.ORANGE),
    )
    style.panel_title(both, "a", "parts of the range error")
    style.panel_title(counts, "b", "distributions")
    style.panel_title(alone, "c", "bending alone")
    if km.size:
        edges = _edges(np.concatenate([values for _, values, _ in parts]))
        for label, values, colour in parts:
            both.plot(km, values, ".", color=colour, label=label, **points)
            counts.stairs(
                np.histogram(values, edges)[0],
                edges,
                orientation="horizontal",
                baseline=_MIN_COUNT,
                fill=True,
                color=colour,
                alpha=0.6,
            )
        counts.set_xscale("log")
        style.short_numbers(counts.xaxis)
        counts.set_xlim(_MIN_COUNT)
        alone.plot(km, bending[received], ".", color=style.ORANGE, **points)
        both.set_xlim(0.0)
        alone.set_xlim(0.0)
        both.legend(loc="best", markerscale=4, handletextpad=0.1, borderaxespad=0.1)
    else:
        style.note(both, "no range was received")
    # zero line and labels
    for axes in (both, counts, alone):
        axes.axhline(0.0, color=style.INK, linewidth=0.7, linestyle="--")
    both.set_ylabel("Part of the error [m]")
    alone.set_ylabel("Bending [m]")
    counts.tick_params(labelleft=False)
    counts.set_xlabel("Ranges in a bin")
    for axes in (both, alone):
        axes.set_xlabel("Straight distance [km]")
    return figure


@style.styled
def dropout_map(
    transmitter: Array,
    receiver: Array,
    status: NDArray[np.int8],
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """Dropouts by cause: attempts by distance, depth difference and the depths of both ends."""
    figure, places = style.panel_figure(width, header, 2, height=3.0, stacked=2.5)
    km = np.linalg.norm(receiver - transmitter, axis=-1) / 1e3
    look: dict[str, Any] = {"alpha": 0.8, "markeredgewidth": 0.0, "rasterized": True}
    ends = np.sort(np.stack([transmitter[:, 2], receiver[:, 2]]), axis=0)
    coordinates = ((km, ends[1] - ends[0]), (ends[0], ends[1]))
    for axes, (x, y) in zip(places, coordinates, strict=True):
        ok = status == RayStatus.OK
        axes.plot(
            x[ok],
            y[ok],
            ".",
            color=style.PALE,
            markersize=2,
            rasterized=True,
            label=f"received ({ok.sum():,})",
        )
        for member, (colour, marker) in _STATUS_LOOK.items():
            chosen = status == member
            if chosen.any():
                text = f"{RAY_STATUS_WORDS[member].label} ({chosen.sum():,})"
                axes.plot(
                    x[chosen], y[chosen], marker, color=colour, markersize=2.6, label=text, **look
                )
        if not status.size:
            style.note(axes, "no range was attempted")
    distance, depths = places
    distance.set(xlabel="Straight distance [km]", ylabel="Depth difference [m]")
    depths.set(xlabel="Depth of the shallower end [m]", ylabel="Depth of the deeper end [m]")
    depths.invert_yaxis()
    style.panel_title(distance, "a", "attempts by distance")
    style.panel_title(depths, "b", "attempts by depth")
    if status.size:
        handles = distance.get_legend_handles_labels()[0]
        style.common_legend(figure, handles, markerscale=1.8, handletextpad=0.1)
    return figure


def _moments(errors: Array) -> str:
    if not errors.size:
        return "no range was received"
    text = f"N = {errors.size:,}, mean {errors.mean():+.2f} m, sd {_spread(errors):.2f} m"
    return text.replace("-", "−")


def _spread(errors: Array) -> float:
    """Standard deviation as in the table, 0 for a single value."""
    return float(errors.std(ddof=1)) if errors.size > 1 else 0.0


def _edges(values: Array) -> Array:
    """Edges of bins of equal width that contain all values, with zero in the middle of one bin."""
    reach = max(float(np.abs(values).max(initial=0.0)), 1e-6)
    count = int(np.clip(4.0 * np.sqrt(values.size), 11, 121)) // 2
    width = reach / (count + 0.5) * (1.0 + 1e-9)
    return np.asarray(width * (np.arange(2 * count + 2) - count - 0.5), dtype=float)


def draw_range_errors(axes: Axes, values: Array, *, log: bool = False) -> Array:
    """
    Draw the histogram of range errors, with zero, mean and the fitted normal; return the finite
    errors.
    """
    errors = values[np.isfinite(values)]
    axes.set(xlabel="Range error, refracted − straight [m]", ylabel="Ranges in a bin")
    _draw_histogram(axes, errors)
    if log:
        axes.set_yscale("log")
        style.short_numbers(axes.yaxis)
        axes.set_ylim(_MIN_COUNT)
    return errors


def _draw_histogram(axes: Axes, errors: Array) -> None:
    axes.axvline(0.0, color=style.INK, linewidth=0.8, linestyle="--", label="zero")
    if not errors.size:
        axes.set_xlim(-1.0, 1.0)
        style.note(axes, "no range was received")
        return
    edges = _edges(errors)
    axes.stairs(np.histogram(errors, edges)[0], edges, fill=True, color=style.SKY, label="ranges")
    mean = float(errors.mean())
    sd = _spread(errors)
    if sd > 0.0:
        x = np.linspace(edges[0], edges[-1], 601)
        scale = errors.size * (edges[1] - edges[0]) / (sd * np.sqrt(2.0 * np.pi))
        axes.plot(
            x,
            scale * np.exp(-0.5 * ((x - mean) / sd) ** 2),
            color=style.INK,
            linewidth=1.0,
            label="fitted normal",
        )
    axes.axvline(mean, color=style.ORANGE, linewidth=1.2, label="mean")
    axes.yaxis.set_major_formatter(ScalarFormatter())


register(
    "range_error",
    place=10,
    paper="Figure 6",
    of_mission=True,
    caption="Signed range error, refracted minus straight, of {r.received:,} ranges: mean"
    " (orange), zero (dashed) and fitted normal (black), with linear and logarithmic counts.",
    **both_widths(
        lambda r, width: range_error_histogram([(r.region, r.ranges.total)], r.header, width=width)
    ),
)
register(
    "range_error_split",
    place=20,
    of_mission=True,
    caption="Exact split of the range error: (a, b) the part due to the reference speed, because"
    " the sound speed at the transmitter differs from the mean along the path, and the part due to"
    " the bending of the ray; (c) bending at a finer scale.",
    **both_widths(
        lambda r, width: range_error_split(
            r.run.ranging_truth.distance,
            r.ranges.reference_speed,
            r.ranges.bending,
            r.header,
            width=width,
        )
    ),
)
register(
    "dropouts",
    place=70,
    of_mission=True,
    caption="All {r.attempts:,} range attempts by (a) distance and depth difference and (b) the"
    " depths of both ends; colours of dropouts are their causes.",
    **both_widths(
        lambda r, width: dropout_map(
            *range_ends(r.run.truth, r.run.measurements),
            r.run.measurements.range_status,
            r.header,
            width=width,
        )
    ),
)
