"""Page, tables and figures of a replay: residuals, coverage, clocks and switching."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pymantaray.apps.replay import Replay
from pymantaray.jobs.progress import Progress
from pymantaray.pages.page import Card, Explorer, Page, origin_table, table_explorer, write_page
from pymantaray.plotting import style
from pymantaray.plotting.drawing import FigureSpec, Picture
from pymantaray.records import RayStatus
from pymantaray.records.digits import metres, show, signed_metres
from pymantaray.records.status import RAY_STATUS_WORDS

_MAX_PAIRS = 12  # panels of residuals over time
_BEYOND = 99.0  # percent of residuals that a histogram shows
# tables with a row per event or more, which are files beside the page
_LONG_TABLES = {
    "events": "Every event",
    "candidates": "Candidates",
    "followed": "Followed arrivals",
}
_STATUS_STYLES = {
    "ok": (style.BLUE, "predicted"),
    "leaked": ("#332288", RAY_STATUS_WORDS[RayStatus.LEAKED].label),
    "scattered": ("#AA4499", RAY_STATUS_WORDS[RayStatus.SCATTERED].label),
    "shadow": (style.ORANGE, RAY_STATUS_WORDS[RayStatus.SHADOW].label),
    "weak": (style.SKY, RAY_STATUS_WORDS[RayStatus.WEAK].label),
    "blocked": (style.GREEN, RAY_STATUS_WORDS[RayStatus.BLOCKED].label),
    "outside": (style.PINK, RAY_STATUS_WORDS[RayStatus.OUTSIDE].label),
    "unheard": (style.INK, "below the threshold"),
    "unresolved": (style.GREY, RAY_STATUS_WORDS[RayStatus.UNRESOLVED].label),
}


def write_replay(
    replay: Replay,
    out: str | Path | None = None,
    *,
    made_by: dict[str, Any] | None = None,
    messages: Callable[[str], str] = str,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> Path:
    """
    Write tables, figures and page of a replay into a new folder.

    Parameters
    ----------
    replay : Replay
        Events with predicted arrivals.
    out : str or pathlib.Path, optional
        New or empty folder. Default: a new folder in ``runs``.
    made_by : dict, optional
        Origin of the results, such as version and command, for ``replay.json`` and the page.
    messages : callable, optional
        Rewrites messages on the page for its readers; the command line writes its options instead
        of arguments. Default: as they are.
    formats : sequence of str
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, and
        for one column of a journal as ``84mm``; tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV), ``figures`` and
        ``replay.json``.

    Raises
    ------
    JobError
        If the folder is not empty or cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.replay`:

    >>> from pymantaray.apps.replay import write_replay
    >>> write_replay(replay, "replay").name
    'index.html'
    """
    record = {"rule": str(replay.rule), "window_s": replay.window, "seed": replay.seed} | (
        made_by or {}
    )
    page_of = partial(_page, replay, messages)
    return write_page(out, "replay", _figure_specs(replay), page_of, record, formats, progress)


def _page(
    replay: Replay,
    messages: Callable[[str], str],
    pictures: Sequence[Picture],
    record: dict[str, Any],
) -> Page:
    events = replay.events
    tables = replay.tables
    long_tables = {words: name for name, words in _LONG_TABLES.items() if name in tables}
    return Page(
        title="Replay of measured travel times",
        facts=[f"{len(events):,} events of {events['pair'].nunique()} pairs; rule {replay.rule}"],
        notes=[messages(line) for line in (*replay.notes, *replay.findings)],
        cards=_cards(replay),
        explorer=_explorer(events),
        pictures=pictures,
        tables=[table for name, table in tables.items() if name not in _LONG_TABLES],
        other_tables=[tables[name] for name in long_tables.values()],
        links={words: f"tables/{name}.csv" for words, name in long_tables.items()},
        origin=[origin_table(record, "Options", "replay.json")],
    )


def _explorer(events: pd.DataFrame) -> Explorer | None:
    """Residuals of events over time and distance."""
    count = events["surface_bounces"] + events["bottom_bounces"]
    noun = count.eq(1).map({True: " bounce", False: " bounces"}).fillna("")
    words = (count.astype("string") + noun).fillna("none predicted")
    if "not_modelled" in events:
        words = words.mask(events["not_modelled"], "not modelled")
    table = events.assign(time_h=events["time_s"] / 3600.0, bounces=words)
    return table_explorer(
        table,
        ["residual_m", "residual_s", "measured_s"],
        ["time_h", "distance_m", "pair"],
        ["bounces", "pair", "source", "receiver"],
        lines=False,
    )


def _cards(replay: Replay) -> list[Card]:
    """Cards of coverage, residuals and switching."""
    total = replay.summary.iloc[0]
    reasons = [
        f"{total[name]} {label}"
        for name, (_, label) in _STATUS_STYLES.items()
        if name in total.index
    ]
    size = (
        f"{metres(total['median_size_low_m'])} to {metres(total['median_size_high_m'])} over pairs"
    )
    n_near = int(replay.events["near_limit"].sum())
    switching = replay.switching.iloc[0]
    rate = "unobservable"
    independent = "residuals cannot separate candidates"
    if switching["steps"]:
        rate = f"{show(100.0 * switching['rate'])} %"
        independent = (
            f"{show(100.0 * switching['independent_rate'])} % if independent;"
            f" {switching['steps']:,} steps"
        )
    return [
        Card(
            "Predicted",
            f"{total['predicted']:,} of {total['events']:,}",
            ", ".join(reasons) or "all events",
        ),
        Card("Median size of the residual", metres(total["median_size_m"]), size),
        Card(
            "Median residual",
            signed_metres(total["median_m"]),
            "measured minus predicted, without correction of clocks",
        ),
        Card("Changes of candidate", rate, independent),
        Card(
            "Near a limit", f"{n_near:,} events", "a limit 1 dB higher or lower changes the arrival"
        ),
    ]


def _figure_specs(replay: Replay) -> list[FigureSpec]:
    header = f"{len(replay.events):,} events, rule {replay.rule}"
    return [
        FigureSpec.of_both_widths(
            "residual_range",
            "Residual of each event, measured minus predicted, over straight distance; colours are"
            " the bounces of the predicted arrival. Lines: median of each range class with its 95"
            " % interval over pairs.",
            partial(residuals_over_range, replay.events, replay.summary, header),
        ),
        FigureSpec.of_both_widths(
            "residual_time",
            f"Residuals over time of the {_MAX_PAIRS} pairs with most events; one colour per"
            " direction. A step between two levels is a change of candidate; a gap between the"
            " directions is twice the difference of the clocks.",
            partial(residuals_over_time, replay.events, header),
        ),
        FigureSpec.of_both_widths(
            "residual_histogram",
            "Distribution of residuals: of the predicted arrivals without correction, and of the"
            f" candidate nearest to each event with corrected clocks; the middle {_BEYOND:g} % of"
            " each.",
            partial(residual_histograms, replay.events, replay.taken, header),
        ),
        FigureSpec.of_both_widths(
            "coverage",
            "Events by range, depths and pair: share with a predicted arrival, and reasons for its"
            " absence.",
            partial(coverage_bars, replay.summary, header),
        ),
    ]


@style.styled
def residuals_over_range(
    events: pd.DataFrame, summary: pd.DataFrame, header: str, width: float = style.DOUBLE
) -> Figure:
    """Residuals against distance by bounces: all residuals, and their middle part."""
    figure, panels = style.panel_figure(width, header, 2, height=3.0, stacked=2.2, sharex=True)
    overview, middle = panels
    rows = events[events["residual_m"].notna()]
    if rows.empty:
        style.note(overview, "no event has a predicted arrival")
        style.note(middle, "no event has a predicted arrival")
        return figure
    # residuals by number of bounces in both panels
    bounces = (rows["surface_bounces"] + rows["bottom_bounces"]).fillna(0).astype(int)
    limit = float(np.percentile(rows["residual_m"].abs(), 90.0)) * 1.3
    colours = (style.BLUE, style.ORANGE, style.GREEN, style.PINK)
    for axes in (overview, middle):
        for number, colour in enumerate(colours):
            last = number == len(colours) - 1
            part = rows[bounces >= number] if last else rows[bounces == number]
            word = f"{number}{' or more' if last else ''} bounce{'' if number == 1 else 's'}"
            axes.plot(
                part["distance_m"] / 1e3,
                part["residual_m"],
                ".",
                color=colour,
                markersize=2.5,
                alpha=0.6,
                rasterized=True,
                label=f"{word} ({len(part):,})" if len(part) else "_",
            )
        axes.axhline(0.0, color=style.INK, linewidth=0.7, linestyle="--")
        axes.set_xlabel("Straight distance [km]")
    # medians by range, with their intervals
    groups = summary[(summary["by"] == "range") & (summary["predicted"] > 0)]
    ends = groups["group"].str.removesuffix(" km").str.split(" to ")  # [km]
    middles = [0.5 * sum(map(float, pair)) for pair in ends]
    spread = np.abs(
        groups[["median_low_m", "median_high_m"]].sub(groups["median_m"], axis=0).to_numpy().T
    )
    middle.errorbar(
        middles,
        groups["median_m"],
        np.nan_to_num(spread),
        fmt="_",
        color=style.INK,
        capsize=2.0,
        linewidth=1.0,
    )
    # limits, labels and legend
    middle.set_ylim(-limit, limit)
    for axes in panels if width == style.COLUMN else panels[:1]:
        axes.set_ylabel("Residual [m]")
    style.panel_title(overview, "a", "all events")
    style.panel_title(middle, "b", "middle nine tenths")
    style.common_legend(figure, overview.get_legend_handles_labels()[0], markerscale=3)
    return figure


@style.styled
def residuals_over_time(events: pd.DataFrame, header: str, width: float = style.DOUBLE) -> Figure:
    """Residuals of each pair against time."""
    # a panel for each of the pairs with most events
    rows = events[events["residual_s"].notna()]
    pairs = rows["pair"].value_counts(sort=True).index[:_MAX_PAIRS].sort_values()
    columns = 3 if width > style.COLUMN else 2
    lines = max(-(-len(pairs) // columns), 1)
    figure = style.new_figure(width, 0.5 + 1.35 * lines, header)
    panels = figure.subplots(lines, columns, sharex=True, squeeze=False)
    for axes in panels.flat[len(pairs) :]:
        axes.set_visible(False)
    # both directions of a pair
    hours = rows["time_s"] / 3600.0
    for axes, pair in zip(panels.flat, pairs, strict=False):
        part = rows[rows["pair"] == pair]
        first = min(part["source"].iloc[0], part["receiver"].iloc[0])
        for colour, way in (
            (style.BLUE, part["source"] == first),
            (style.ORANGE, part["source"] != first),
        ):
            index = part.index[way]
            axes.plot(
                hours[index], 1e3 * part["residual_s"][way], ".", color=colour, markersize=2.0
            )
        axes.axhline(0.0, color=style.INK, linewidth=0.5, linestyle="--")
        axes.set_title(style.plain(style.short(str(pair))), loc="left")
    # labels at the outer panels that are visible
    for axes in panels[:, 0]:
        axes.set_ylabel("Residual [ms]")
    for axes in panels[-1]:
        axes.set_xlabel("Time [h]")
    for column in range(columns):
        visible = [axes for axes in panels[:, column] if axes.get_visible()]
        if visible:
            visible[-1].set_xlabel("Time [h]")
            visible[-1].tick_params(labelbottom=True)
    # legend, or a note if there is nothing
    handles = [
        style.entry("from the first name", color=style.BLUE, marker=".", linestyle=""),
        style.entry("to the first name", color=style.ORANGE, marker=".", linestyle=""),
    ]
    if len(pairs):
        style.common_legend(figure, handles)
    else:
        panels[0, 0].set_visible(True)
        style.note(panels[0, 0], "no event has a predicted arrival")
    return figure


@style.styled
def residual_histograms(
    events: pd.DataFrame, taken: pd.DataFrame, header: str, width: float = style.DOUBLE
) -> Figure:
    """Histograms of the residuals of predicted arrivals and of selected candidates."""
    figure, (raw, clean) = style.panel_figure(width, header, 2, height=2.5, stacked=2.1)
    for axes, letter, words, values in (
        (raw, "a", "predicted arrival", 1e3 * events["residual_s"].dropna()),
        (
            clean,
            "b",
            "nearest candidate, clocks corrected",
            1e3 * taken["taken_residual_s"].dropna(),
        ),
    ):
        style.panel_title(axes, letter, words)
        axes.set_xlabel("Residual [ms]")
        axes.set_ylabel("Events in a bin")
        if values.empty:
            style.note(axes, "no event has a predicted arrival")
            continue
        ends = np.percentile(values, (0.5 * (100.0 - _BEYOND), 0.5 * (100.0 + _BEYOND)))
        axes.hist(values, bins=60, range=(float(ends[0]), float(ends[1]) + 1e-9), color=style.BLUE)
        axes.axvline(float(values.median()), color=style.ORANGE, linewidth=1.0, label="median")
        axes.axvline(0.0, color=style.INK, linewidth=0.7, linestyle="--", label="zero")
    if raw.get_legend_handles_labels()[0]:
        style.common_legend(figure, raw.get_legend_handles_labels()[0])
    return figure


@style.styled
def coverage_bars(summary: pd.DataFrame, header: str, width: float = style.DOUBLE) -> Figure:
    """Share of the events of each group with a predicted arrival, and reasons for its absence."""
    kinds = ("range", "depths", "pair")
    sizes = [min(int((summary["by"] == kind).sum()), 24) for kind in kinds]
    heights = [0.75 + 0.16 * max(size, 1) for size in sizes]
    figure, panels = style.panel_figure(
        width, header, 3, height=0.9 + 0.16 * max(sizes), stacked=heights
    )
    others = [name for name in _STATUS_STYLES if name in summary.columns]
    for axes, kind, letter in zip(panels, kinds, "abc", strict=True):
        part = summary[summary["by"] == kind].nlargest(24, "events").sort_index()
        start = np.zeros(len(part))
        positions = np.arange(len(part))
        for name in ("ok", *others):
            colour, label = _STATUS_STYLES[name]
            count = part[name] if name in part else part["events"] - part[others].sum(axis=1)
            share = 100.0 * (count / part["events"]).to_numpy(dtype=float)
            axes.barh(positions, share, left=start, height=0.75, color=colour, label=label)
            start += share
        axes.set_yticks(
            positions, [style.plain(style.short(str(name), 18)) for name in part["group"]]
        )
        axes.invert_yaxis()
        axes.set_xlim(0.0, 100.0)
        axes.set_xlabel("Share of events [%]")
        style.panel_title(axes, letter, f"by {kind}")
    style.common_legend(figure, panels[0].get_legend_handles_labels()[0])
    return figure
