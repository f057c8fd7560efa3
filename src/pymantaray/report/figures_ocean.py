"""The water of a run: sound-speed profiles of one or more regions, and rays through one section."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pymantaray.report import style
from pymantaray.report.figures import Results, register
from pymantaray.study.store import RAY_PICTURE

_UPPER = 500.0  # m; depth of the upper panel of the profiles
_BELOW = 3.0  # how far down the picture goes at least, in depths of the deepest end or eigenray
_LEAST_DEPTH = 100.0  # m
_ROWS = 300  # of the colour image
_FAN: dict[str, Any] = {"color": "#565656", "linewidth": 0.35, "alpha": 0.8, "zorder": 3}
_CHORD: dict[str, Any] = {"color": style.INK, "linestyle": (0, (4, 2)), "linewidth": 1.1}
_REGION_COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PINK)
_REGION_LINES = ("-", (0, (5, 1.5)), (0, (1, 1)), "-.")


@style.styled
def sound_speed_profiles(profiles: Sequence[tuple[str, xr.Dataset]], header: str) -> Figure:
    """Mean sound speed of each region against depth, between its least and its greatest."""
    figure = style.new_figure(style.COLUMN, 3.0, header)
    whole, upper = figure.subplots(1, 2)
    deepest = 0.0
    for i, (name, profile) in enumerate(profiles):
        wet = profile["count"].values > 0
        depth, mean, low, high = (profile[key].values[wet] for key in ("depth", "mean", "min", "max"))
        deepest = max(deepest, float(depth.max(initial=0.0)))
        colour, line = _REGION_COLOURS[i % 4], _REGION_LINES[i % 4]
        for axes in (whole, upper):
            axes.fill_betweenx(depth, low, high, color=colour, alpha=0.22, linewidth=0.0)
            axes.plot(mean, depth, color=colour, linestyle=line, label=style.plain(style.short(name)))
    limit = min(_UPPER, deepest) or 1.0
    whole.set_ylim(deepest or 1.0, 0.0)
    upper.set_ylim(limit, 0.0)
    _fit_speed_axis(upper, [profile for _, profile in profiles], limit)
    whole.set_ylabel("Depth [m]")
    for axes, letter, text in ((whole, "a", "all depths"), (upper, "b", f"upper {limit:.0f} m")):
        style.panel_title(axes, letter, text)
        axes.set_xlabel("Sound speed [m/s]")
        axes.locator_params(axis="x", nbins=4)
    if len(profiles) > 1:
        whole.legend(loc="lower left", handlelength=2.2, borderaxespad=0.2)
    return figure


@style.styled
def ray_picture(picture: xr.Dataset, header: str) -> Figure:
    """Vertical section along one link: sound speed, sea bed, a fan of rays, eigenrays and the chord."""
    figure = style.new_figure(style.DOUBLE, 3.0, header)
    axes = figure.subplots()
    axes.grid(visible=False)
    km = picture["range"].values / 1e3
    depth, floor = picture["depth"].values, picture["sea_floor_depth"].values
    lowest = _lowest_shown(picture)
    rows = np.linspace(depth[0], lowest, _ROWS)
    speed = np.stack([np.interp(rows, depth, column) for column in picture["sound_speed"].values], axis=1)
    ice = picture["sea_ice_draft"].values if "sea_ice_draft" in picture else np.zeros(km.size)
    speed = np.where((rows[:, None] <= floor) & (rows[:, None] >= ice), speed, np.nan)
    mesh = axes.pcolormesh(km, rows, speed, cmap=style.SOUND_SPEED, shading="nearest", rasterized=True)
    figure.colorbar(mesh, ax=axes, label="Sound speed [m/s]", pad=0.015, aspect=30)
    axes.fill_between(km, floor, max(depth[-1], floor.max()) * 2.0, color=style.BED, linewidth=0.0, zorder=2)
    axes.plot(km, floor, color=style.SHORE, linewidth=0.8, zorder=2)
    if ice.any():
        axes.fill_between(km, 0.0, ice, color=style.ICE, linewidth=0.0, zorder=2)
        axes.plot(km, ice, color=style.GREY, linewidth=0.8, zorder=2)

    arrives = picture["ray_arrives"].values.astype(bool)
    for hit, x, z in zip(arrives, picture["ray_range"].values, picture["ray_depth"].values, strict=True):
        look: dict[str, Any] = {"color": style.ORANGE, "linewidth": 1.8, "zorder": 4} if hit else _FAN
        axes.plot(x / 1e3, z, **look)
    chord, ends = picture["chord_range"].values / 1e3, picture["chord_depth"].values
    axes.plot(chord, ends, zorder=5, **_CHORD)
    axes.plot(
        chord, ends, "o", color="white", markeredgecolor=style.INK, markersize=4.5, zorder=6, clip_on=False
    )
    source, receiver = (str(picture.attrs.get(key, key)) for key in ("source", "receiver"))
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "linewidth": 0.0}
    words: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontweight": "bold", "bbox": box}
    for x, z, text, ha in zip(chord, ends, (source, receiver), ("left", "right"), strict=True):
        offset = (8 if ha == "left" else -8, 10 if z > 0.7 * lowest else -10)
        axes.annotate(style.plain(text), (x, z), offset, ha=ha, zorder=7, **words)
    axes.set_xlim(km[0], km[-1])
    axes.set_ylim(lowest, depth[0])
    axes.set_xlabel("Horizontal range [km]")
    axes.set_ylabel("Depth [m]")
    handles = _ray_handles(count=int(arrives.sum()), fan=bool((~arrives).any()))
    style.common_legend(figure, handles, handlelength=2.4)
    hour = f", {float(picture.attrs['time_h']):g} h" if "time_h" in picture.attrs else ""
    link = style.plain(f"{source} to {receiver}{hour}")
    axes.set_title(link, loc="left")
    style.freeze_layout(figure)  # which must be known to measure the exaggeration
    panel = axes.get_window_extent()
    exaggeration = (panel.height / max(lowest - depth[0], 1e-9)) / (
        panel.width / max((km[-1] - km[0]) * 1e3, 1e-9)
    )
    axes.set_title(f"{link}, vertical exaggeration {exaggeration:.2g}", loc="left")
    return figure


def _caption_of_rays(results: Results) -> str:
    ice = results.run.ray_picture.get("sea_ice_draft")
    cover = " ice (white)," if ice is not None and ice.any() else ""
    return (
        f"Sound on the link that bends most: sound speed (blue),{cover} sea bed (brown, where it is not far below),"
        " direct eigenrays (orange), the straight chord (dashed) and other rays from the same source (grey)."
    )


def _lowest_shown(picture: xr.Dataset) -> float:
    """Where the picture ends: below the sea bed, or below what it is about where the sea bed is far from that."""
    depth = picture["depth"].values
    hits = picture["ray_depth"].values[picture["ray_arrives"].values.astype(bool)]
    deepest = max(float(np.nanmax(picture["chord_depth"].values)), float(np.nanmax(hits, initial=0.0)))
    return min(max(_BELOW * deepest, _LEAST_DEPTH), float(depth[-1]))


def _ray_handles(*, count: int, fan: bool) -> list[Line2D]:
    eigenray = style.entry(
        "direct eigenray" if count == 1 else f"{count} direct eigenrays", color=style.ORANGE, linewidth=1.8
    )
    other = style.entry("other rays", color=_FAN["color"], linewidth=0.6)
    return [
        *([eigenray] if count else []),
        style.entry("straight chord", **_CHORD),
        *([other] if fan else []),
    ]


def _fit_speed_axis(axes: Axes, profiles: Sequence[xr.Dataset], limit: float) -> None:
    """Limit sound speed to what the panel's depths show."""
    shown = [p.sel(depth=slice(0.0, limit)) for p in profiles]
    low = [float(np.nanmin(p["min"].values)) for p in shown if np.isfinite(p["min"].values).any()]
    high = [float(np.nanmax(p["max"].values)) for p in shown if np.isfinite(p["max"].values).any()]
    if low:
        margin = 0.05 * max(max(high) - min(low), 1.0)
        axes.set_xlim(min(low) - margin, max(high) + margin)


register(
    "sound_speed",
    place=100,
    of_mission=True,
    caption="Sound speed against depth over the whole region: mean of each level (line), least to greatest (shaded);"
    " (a) all depths, (b) the upper part.",
    draw=lambda r: sound_speed_profiles([(r.region, r.run.profile)], r.header),
)
register(
    "ray_picture",
    place=110,
    of_mission=True,
    caption=_caption_of_rays,
    draw=lambda r: ray_picture(r.run.ray_picture, r.header),
    needs=lambda r: (r.run.path / RAY_PICTURE).is_file(),
)
