"""What refraction does to ranges: the error's distribution, its two parts, and who is not heard."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from pymantaray.records import RayStatus
from pymantaray.report.labels import plain, short
from pymantaray.report.style import (
    BLUE,
    DOUBLE,
    GREEN,
    INK,
    ORANGE,
    PALE,
    PINK,
    SKY,
    common_legend,
    new_figure,
    note,
    panel_title,
    styled,
)

Array = NDArray[np.float64]
_LEAST_COUNT = 0.6  # where logarithmic axes of counts begin, so that a single one shows
_STATUS_LOOK = {
    RayStatus.SHADOW: (ORANGE, "o", "shadow"),
    RayStatus.WEAK: (BLUE, "s", "too weak"),
    RayStatus.BLOCKED: (GREEN, "^", "blocked by the bottom"),
    RayStatus.OUTSIDE: (PINK, "D", "outside the domain"),
    RayStatus.STOPPED: (SKY, "v", "vehicle stopped"),
    RayStatus.UNHEARD: (INK, "x", "not heard"),
    RayStatus.UNRESOLVED: (INK, "+", "search cut short"),
}


@styled
def range_error_histogram(errors: Sequence[tuple[str, Array]], header: str) -> Figure:
    """
    Signed range error, refracted minus straight, with its mean, zero and the fitted normal.

    Parameters
    ----------
    errors : sequence of tuple of str and ndarray
        Name of each region and its range errors, NaN for dropouts. One row of panels each. [m]
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
        Counts on a linear scale on the left, on a logarithmic one, which shows the tails, on the right.
    """
    figure = new_figure(DOUBLE, 0.55 + 2.05 * len(errors), header)
    rows = figure.subplots(len(errors), 2, squeeze=False, sharex=True)
    for i, ((name, given), (linear, log)) in enumerate(zip(errors, rows, strict=True)):
        found = given[np.isfinite(given)]
        _histogram(linear, found)
        _histogram(log, found)
        log.set_yscale("log")
        log.set_ylim(_LEAST_COUNT)
        linear.set_ylabel("Ranges in a bin")
        panel_title(linear, "abcdefgh"[2 * i], plain(_moments(name, found)))
        panel_title(log, "abcdefgh"[2 * i + 1], "the same, logarithmic count")
    for axes in rows[-1]:
        axes.set_xlabel("Range error, refracted − straight [m]")
    common_legend(figure, rows[0, 0].get_legend_handles_labels()[0])
    return figure


@styled
def range_error_split(distance: Array, reference_speed: Array, bending: Array, header: str) -> Figure:
    """
    Range error's two parts, against distance and as distributions.

    Parameters
    ----------
    distance, reference_speed, bending : ndarray, shape (n_ranges,)
        Straight distance and the parts of the error; rows with NaN are left out. [m]
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
        Both parts at one scale, their distributions on the same axis, and bending at its own scale.
    """
    figure = new_figure(DOUBLE, 2.7, header)
    both, counts, alone = figure.subplots(1, 3, width_ratios=(1.25, 0.8, 1.25))
    counts.sharey(both)
    found = np.isfinite(distance) & np.isfinite(reference_speed) & np.isfinite(bending)
    km = distance[found] / 1e3
    parts = (
        ("reference speed", reference_speed[found], BLUE),
        ("bending", bending[found], ORANGE),
    )
    panel_title(both, "a", "parts of the range error")
    panel_title(counts, "b", "distributions")
    panel_title(alone, "c", "bending alone")
    if km.size:
        edges = _edges(np.concatenate([values for _, values, _ in parts]))
        for label, values, colour in parts:
            both.plot(km, values, ".", color=colour, markersize=1.6, alpha=0.5, rasterized=True, label=label)
            counts.stairs(
                np.histogram(values, edges)[0],
                edges,
                orientation="horizontal",
                baseline=_LEAST_COUNT,
                fill=True,
                color=colour,
                alpha=0.6,
            )
        counts.set_xscale("log")
        counts.set_xlim(_LEAST_COUNT)
        alone.plot(km, bending[found], ".", color=ORANGE, markersize=1.6, alpha=0.5, rasterized=True)
        both.set_xlim(0.0)
        alone.set_xlim(0.0)
        both.legend(loc="best", markerscale=4, handletextpad=0.1, borderaxespad=0.1)
    else:
        note(both, "no range was heard")
    for axes in (both, counts, alone):
        axes.axhline(0.0, color=INK, linewidth=0.7, linestyle="--")
    both.set_ylabel("Part of the error [m]")
    alone.set_ylabel("Bending [m]")
    counts.tick_params(labelleft=False)
    counts.set_xlabel("Ranges in a bin")
    for axes in (both, alone):
        axes.set_xlabel("Straight distance [km]")
    return figure


@styled
def dropout_map(transmitter: Array, receiver: Array, status: NDArray[np.int8], header: str) -> Figure:
    """
    Who is not heard, and why: attempts by distance, depth difference and the depths of both ends.

    Parameters
    ----------
    transmitter, receiver : ndarray, shape (n_ranges, 3)
        True positions of the ends. [m]
    status : ndarray of int, shape (n_ranges,)
        `RayStatus` of each attempt.
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(DOUBLE, 3.0, header)
    places = figure.subplots(1, 2)
    km = np.linalg.norm(receiver - transmitter, axis=-1) / 1e3
    ends = np.sort(np.stack([transmitter[:, 2], receiver[:, 2]]), axis=0)
    coordinates = ((km, ends[1] - ends[0]), (ends[0], ends[1]))
    for axes, (x, y) in zip(places, coordinates, strict=True):
        ok = status == RayStatus.OK
        axes.plot(x[ok], y[ok], ".", color=PALE, markersize=2, rasterized=True, label=f"heard ({ok.sum():,})")
        for member, (colour, marker, label) in _STATUS_LOOK.items():
            chosen = status == member
            if chosen.any():
                axes.plot(
                    x[chosen],
                    y[chosen],
                    marker,
                    color=colour,
                    markersize=2.6,
                    alpha=0.8,
                    markeredgewidth=0.0,
                    rasterized=True,
                    label=f"{label} ({chosen.sum():,})",
                )
        if not status.size:
            note(axes, "no range was attempted")
    distance, depths = places
    distance.set_xlabel("Straight distance [km]")
    distance.set_ylabel("Depth difference [m]")
    depths.set_xlabel("Depth of the shallower end [m]")
    depths.set_ylabel("Depth of the deeper end [m]")
    depths.invert_yaxis()
    panel_title(distance, "a", "attempts by distance")
    panel_title(depths, "b", "attempts by depth")
    if status.size:
        handles = distance.get_legend_handles_labels()[0]
        common_legend(figure, handles, markerscale=1.8, handletextpad=0.1)
    return figure


def _moments(name: str, found: Array) -> str:
    if not found.size:
        return f"{short(name)}: no range was heard"
    return (
        f"{short(name)}: N = {found.size:,}, mean {found.mean():+.2f} m, sd {_spread(found):.2f} m".replace(
            "-", "−"
        )
    )


def _spread(found: Array) -> float:
    """Standard deviation as in the table, 0 for a single value."""
    return float(found.std(ddof=1)) if found.size > 1 else 0.0


def _edges(values: Array) -> Array:
    """Edges of bins of equal width, with zero at the middle of one, that hold all values."""
    reach = max(float(np.abs(values).max(initial=0.0)), 1e-6)
    count = int(np.clip(4.0 * np.sqrt(values.size), 11, 121)) // 2
    width = reach / (count + 0.5) * (1.0 + 1e-9)
    return np.asarray(width * (np.arange(2 * count + 2) - count - 0.5), dtype=float)


def _histogram(axes: Axes, found: Array) -> None:
    axes.axvline(0.0, color=INK, linewidth=0.8, linestyle="--", label="zero")
    if not found.size:
        axes.set_xlim(-1.0, 1.0)
        note(axes, "no range was heard")
        return
    edges = _edges(found)
    axes.stairs(np.histogram(found, edges)[0], edges, fill=True, color=SKY, label="ranges")
    mean, sd = float(found.mean()), _spread(found)
    if sd > 0.0:
        x = np.linspace(edges[0], edges[-1], 601)
        scale = found.size * (edges[1] - edges[0]) / (sd * np.sqrt(2.0 * np.pi))
        axes.plot(
            x, scale * np.exp(-0.5 * ((x - mean) / sd) ** 2), color=INK, linewidth=1.0, label="fitted normal"
        )
    axes.axvline(mean, color=ORANGE, linewidth=1.2, label="mean")
    axes.yaxis.set_major_formatter(ScalarFormatter())
