"""Drawings of water: sound-speed profiles of one or more regions, and rays through sections."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.plotting import style

_BELOW = 3.0  # how far down the picture goes at least, in depths of the deepest end or eigenray
UPPER_DEPTH = 500.0  # m; depth of the upper panels of profiles and sections
_MIN_DEPTH = 100.0  # m
_ROWS = 300  # of the colour image
_FAN: dict[str, Any] = {"color": "#565656", "linewidth": 0.35, "alpha": 0.8, "zorder": 3}
RAY_KINDS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("direct", {"color": style.ORANGE, "linewidth": 1.8}),
    ("surface", {"color": "#332288", "linewidth": 1.3, "linestyle": (0, (6, 1.2))}),
    ("bottom", {"color": "#117733", "linewidth": 1.3, "linestyle": (0, (5, 1, 1.2, 1))}),
    ("surface and bottom", {"color": "#882255", "linewidth": 1.1, "linestyle": (0, (1.6, 1))}),
)
"""Names and line styles of eigenrays by their reflections; colours after Okabe and Ito, and Tol."""
_CHORD: dict[str, Any] = {"color": style.INK, "linestyle": (0, (4, 2)), "linewidth": 1.1}
_REGION_LINES = ("-", (0, (5, 1.5)), (0, (1, 1)), "-.")


@style.styled
def sound_speed_profiles(profiles: Sequence[tuple[str, xr.Dataset]], header: str) -> Figure:
    """Sound speed of each region against depth: mean, minimum and maximum."""
    several = len(profiles) > 1
    figure = style.new_figure(style.COLUMN, 3.0 + 0.14 * several * len(profiles), header)
    whole, upper = figure.subplots(1, 2)
    deepest = 0.0
    colours = style.vehicle_colours(len(profiles))
    for i, (name, profile) in enumerate(profiles):
        for axes in (whole, upper):
            reach = draw_profile(axes, profile, name, colours[i], line=_REGION_LINES[i % 4])
        deepest = max(deepest, reach)
    limit = min(UPPER_DEPTH, deepest) or 1.0
    whole.set_ylim(deepest or 1.0, 0.0)
    upper.set_ylim(limit, 0.0)
    _fit_speed_axis(upper, [profile for _, profile in profiles], limit)
    whole.set_ylabel("Depth [m]")
    for axes, letter, text in ((whole, "a", "all depths"), (upper, "b", f"upper {limit:.0f} m")):
        style.panel_title(axes, letter, text)
        axes.set_xlabel("Sound speed [m/s]")
        axes.locator_params(axis="x", nbins=4)
    if several:
        figure.legend(
            handles=whole.get_lines(), loc="outside lower left", ncols=1, handlelength=2.2
        )
    return figure


def draw_profile(
    axes: Axes, profile: xr.Dataset, name: str, colour: str, *, line: Any = "-"
) -> float:
    """Draw mean, minimum and maximum sound speed against depth; return the greatest depth. [m]"""
    wet = profile["count"].values > 0
    depth, mean, low, high = (profile[key].values[wet] for key in ("depth", "mean", "min", "max"))
    axes.fill_betweenx(depth, low, high, color=colour, alpha=0.22, linewidth=0.0)
    axes.plot(mean, depth, color=colour, linestyle=line, label=style.plain(style.short(name)))
    return float(depth.max(initial=0.0))


@style.styled
def ray_picture(picture: xr.Dataset, header: str, *, width: float = style.DOUBLE) -> Figure:
    """
    Vertical section along one link: sound speed, sea bed, a fan of rays, eigenrays and the chord.
    """
    hour = f", {style.clock(float(picture.attrs['time_h']))}" if "time_h" in picture.attrs else ""
    source, receiver = _names(picture)
    return _ray_pictures([picture], [f"{source} to {receiver}{hour}"], header, width)


@style.styled
def rays_of_links(
    pictures: Sequence[xr.Dataset],
    titles: Sequence[str],
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """
    `ray_picture` of several links below each other, with one scale of sound speed; titles give the
    time of the first arrival.
    """
    return _ray_pictures(
        pictures,
        [f"{title}, {_outcome(p)}" for title, p in zip(titles, pictures, strict=True)],
        header,
        width,
    )


def _ray_pictures(
    pictures: Sequence[xr.Dataset], titles: Sequence[str], header: str, width: float
) -> Figure:
    used = [
        kind
        for kind in range(len(RAY_KINDS))
        if any((_eigenray_kinds(p) == kind).any() for p in pictures)
    ]
    fan = any((picture["ray_arrives"] == 0).any() for picture in pictures)
    handles = _ray_handles(pictures, used, fan=fan)
    narrow = width == style.COLUMN
    below = 0.5 if narrow else 0.14 * style.legend_lines(len(handles))
    height = 0.55 + below + (2.45 if len(pictures) == 1 else 2.05 * len(pictures))
    figure = style.new_figure(width, height, header)
    panels = figure.subplots(len(pictures), 1, squeeze=False)[:, 0]
    water = [_water_shown(picture) for picture in pictures]
    low, high = (
        f([f(np.append(c[np.isfinite(c)], np.nan)) for *_, c in water])
        for f in (np.nanmin, np.nanmax)
    )
    for axes, picture, (lowest, rows, speed) in zip(panels, pictures, water, strict=True):
        km = picture["range"].values / 1e3
        axes.grid(visible=False)
        look: dict[str, Any] = {"cmap": style.SOUND_SPEED, "shading": "nearest", "rasterized": True}
        mesh = axes.pcolormesh(km, rows, speed, vmin=low, vmax=high, **look)
        _draw_boundaries(axes, picture)
        _draw_rays(axes, picture)
        _draw_ends(axes, picture, lowest)
        axes.set(xlim=(km[0], km[-1]), ylim=(lowest, rows[0]), ylabel="Depth [m]")
    panels[-1].set_xlabel("Horizontal range [km]")
    bar = {"location": "bottom", "pad": 0.02} if narrow else {"pad": 0.015}
    figure.colorbar(mesh, ax=panels.tolist(), label="Sound speed [m/s]", aspect=30, **bar)
    style.common_legend(figure, handles, handlelength=2.4)
    # the exaggeration is known after the layout, in which its words have room
    words = [f"{style.plain(title)}, vertical exaggeration" for title in titles]
    for axes, title in zip(panels, words, strict=True):
        axes.set_title(style.fitting(axes, f"{title} 0.00"), loc="left")
    style.freeze_layout(figure)
    for axes, title in zip(panels, words, strict=True):
        axes.set_title(style.fitting(axes, f"{title} {_exaggeration(axes):.2g}"), loc="left")
    return figure


def _water_shown(picture: xr.Dataset) -> tuple[float, Array, Array]:
    """Lower edge and depths of a picture, and sound speed (depth, range); NaN outside the water."""
    depth = picture["depth"].values
    floor = picture["sea_floor_depth"].values
    lowest = _lowest_shown(picture)
    rows = np.linspace(depth[0], lowest, _ROWS)
    speed = np.stack(
        [np.interp(rows, depth, column) for column in picture["sound_speed"].values], axis=1
    )
    wet = (rows[:, None] <= floor) & (rows[:, None] >= _ice_of(picture))
    return lowest, rows, np.where(wet, speed, np.nan)


def _ice_of(picture: xr.Dataset) -> Array:
    if "sea_ice_draft" not in picture:
        return np.zeros(picture.sizes["range"])
    return np.asarray(picture["sea_ice_draft"].values)


def _draw_boundaries(axes: Axes, picture: xr.Dataset) -> None:
    """Draw sea bed and ice."""
    km = picture["range"].values / 1e3
    floor = picture["sea_floor_depth"].values
    ice = _ice_of(picture)
    deepest = max(float(picture["depth"].values[-1]), floor.max()) * 2.0
    axes.fill_between(km, floor, deepest, color=style.BED, linewidth=0.0, zorder=2)
    axes.plot(km, floor, color=style.SHORE, linewidth=0.8, zorder=2)
    if ice.any():
        axes.fill_between(km, 0.0, ice, color=style.ICE, linewidth=0.0, zorder=2)
        axes.plot(km, ice, color=style.GREY, linewidth=0.8, zorder=2)


def _draw_rays(axes: Axes, picture: xr.Dataset) -> None:
    """Draw the fan in grey, and eigenrays by their kinds with the earliest on top."""
    arrives = picture["ray_arrives"].values.astype(bool)
    kinds = _kinds(picture)
    rows = zip(
        arrives, kinds, picture["ray_range"].values, picture["ray_depth"].values, strict=True
    )
    for i, (hit, kind, x, z) in enumerate(rows):
        look: dict[str, Any] = {**RAY_KINDS[kind][1], "zorder": 5.0 - 1e-3 * i} if hit else _FAN
        axes.plot(x / 1e3, z, **look)


def _draw_ends(axes: Axes, picture: xr.Dataset, lowest: float) -> None:
    """Draw the chord and the names of its ends."""
    chord = picture["chord_range"].values / 1e3
    ends = picture["chord_depth"].values
    axes.plot(chord, ends, zorder=6, **_CHORD)
    axes.plot(
        chord,
        ends,
        "o",
        color="white",
        markeredgecolor=style.INK,
        markersize=4.5,
        zorder=7,
        clip_on=False,
    )
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "linewidth": 0.0}
    words: dict[str, Any] = {
        "textcoords": "offset points",
        "va": "center",
        "fontweight": "bold",
        "bbox": box,
    }
    for x, z, text, ha in zip(chord, ends, _names(picture), ("left", "right"), strict=True):
        offset = (8 if ha == "left" else -8, 10 if z > 0.7 * lowest else -10)
        axes.annotate(style.plain(text), (x, z), offset, ha=ha, zorder=8, **words)


def _exaggeration(axes: Axes) -> float:
    """Vertical exaggeration."""
    panel, (left, right), (lowest, top) = axes.get_window_extent(), axes.get_xlim(), axes.get_ylim()
    return (panel.height / max(lowest - top, 1e-9)) / (
        panel.width / max((right - left) * 1e3, 1e-9)
    )


def _names(picture: xr.Dataset) -> tuple[str, str]:
    """Names of source and receiver."""
    return str(picture.attrs.get("source", "source")), str(
        picture.attrs.get("receiver", "receiver")
    )


def _kinds(picture: xr.Dataset) -> NDArray[np.intp]:
    """Row of `RAY_KINDS` of each ray."""
    by_surface, by_bed = (
        picture[f"ray_{where}_bounces"].values > 0 for where in ("surface", "bottom")
    )
    return np.asarray(by_surface + 2 * by_bed, dtype=np.intp)


def _eigenray_kinds(picture: xr.Dataset) -> NDArray[np.intp]:
    return np.asarray(_kinds(picture)[picture["ray_arrives"].values.astype(bool)])


def _outcome(picture: xr.Dataset) -> str:
    """Time of the first arrival of a link, or the reason for its absence."""
    count = int(picture["ray_arrives"].sum())
    if not count:
        return f"no arrival ({str(picture.attrs['status']).lower()})"
    first = float(picture["ray_travel_time"][0])
    return f"{first:.5g} s" if count == 1 else f"first of {count} after {first:.5g} s"


def _lowest_shown(picture: xr.Dataset) -> float:
    """
    Lower edge of the picture: below the sea bed, or below its content if the sea bed is much
    deeper.
    """
    depth = picture["depth"].values
    hits = picture["ray_depth"].values[picture["ray_arrives"].values.astype(bool)]
    deepest = max(
        float(np.nanmax(picture["chord_depth"].values)), float(np.nanmax(hits, initial=0.0))
    )
    return min(max(_BELOW * deepest, _MIN_DEPTH), float(depth[-1]))


def _ray_handles(pictures: Sequence[xr.Dataset], used: Sequence[int], *, fan: bool) -> list[Line2D]:
    """Legend of eigenrays (with their numbers for a single picture), chord and fan."""
    handles = []
    for kind in used:
        word, look = RAY_KINDS[kind]
        count = sum(int((_eigenray_kinds(picture) == kind).sum()) for picture in pictures)
        few = f"{word} eigenray" if count == 1 else f"{count} {word} eigenrays"
        label = few if len(pictures) == 1 else f"{word} eigenrays"
        handles.append(style.entry(label, **look))
    handles.append(style.entry("straight chord", **_CHORD))
    return [
        *handles,
        *([style.entry("other rays", color=_FAN["color"], linewidth=0.6)] if fan else []),
    ]


def _fit_speed_axis(axes: Axes, profiles: Sequence[xr.Dataset], limit: float) -> None:
    """Limit the axis of sound speed to the values at the depths of a panel."""
    shown = [p.sel(depth=slice(0.0, limit)) for p in profiles]
    low = [float(np.nanmin(p["min"].values)) for p in shown if np.isfinite(p["min"].values).any()]
    high = [float(np.nanmax(p["max"].values)) for p in shown if np.isfinite(p["max"].values).any()]
    if low:
        margin = 0.05 * max(max(high) - min(low), 1.0)
        axes.set_xlim(min(low) - margin, max(high) + margin)
