"""
Page of a plan: front, map, errors over time and lost links of the best designs, and all designs.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pymantaray.apps.plan import PlanResults, figures
from pymantaray.apps.plan.detail import DesignDetail, detail_of
from pymantaray.apps.plan.results import mean_score
from pymantaray.apps.study.page import SYNTHETIC_NOTE
from pymantaray.config.settings import key_heading
from pymantaray.jobs.progress import Progress
from pymantaray.pages.page import Card, Page, origin_table, table_explorer, write_page
from pymantaray.plotting import style
from pymantaray.plotting.drawing import FigureSpec, Picture, with_source
from pymantaray.records.digits import counted, show
from pymantaray.records.result_table import ResultTable

_MAX_OTHERS = 3  # designs of the front beside the best one
_FEW_VALUES = 12  # of a key that can divide designs into series


def write_plan_page(
    results: PlanResults,
    out: str | Path | None = None,
    *,
    made_by: dict[str, Any] | None = None,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> Path:
    """
    Write page, tables, figures and the best design of a plan into a new folder.

    Parameters
    ----------
    results : PlanResults
        Evaluated designs, from `pymantaray.apps.plan.search_designs`.
    out : str or pathlib.Path, optional
        New or empty folder. Default: a new folder in ``runs``.
    made_by : dict, optional
        Origin of the results, such as version and command, for ``plan.json`` and the page.
    formats : sequence of str
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, and
        for one column of a journal as ``84mm``; tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV), ``figures`` and
        ``plan.json``.

    Raises
    ------
    JobError
        If the folder is not empty or cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.plan`:

    >>> from pymantaray.apps.plan import write_plan_page
    >>> write_plan_page(results, "plan").name
    'index.html'
    """
    section = results.plan.section.model_dump(mode="json", exclude_none=True)
    record = (made_by or {}) | {"plan": section}
    details = shown_designs(results)
    page_of = partial(_page, results, details)
    return write_page(
        out, "plan", _figure_specs(results, details), page_of, record, formats, progress
    )


def shown_designs(results: PlanResults) -> dict[str, DesignDetail]:
    """
    Details of the best design, the study as it is, and other designs of the front with the smallest
    first objectives, by name.
    """
    plan = results.plan
    best = results.best
    details = {f"Best: {_words(results.designs[best])}": detail_of(plan, results.designs[best])}
    if not any(one.failure for one in results.base):
        details[figures.AS_IT_IS] = detail_of(plan, {})
    loss = results.losses(plan.section.ranked_by)[:, 0]
    others = [int(k) for k in np.argsort(loss) if results.front[k] and k != best][:_MAX_OTHERS]
    return details | {
        _words(results.designs[k]): detail_of(plan, results.designs[k]) for k in others
    }


def _words(design: Mapping[str, Any]) -> str:
    """Values of a design, with the last parts of its keys."""
    return ", ".join(
        f"{key.rpartition('.')[2]} {value:g}"
        if isinstance(value, int | float)
        else f"{key.rpartition('.')[2]} {value}"
        for key, value in design.items()
    )


def _page(
    results: PlanResults,
    details: Mapping[str, DesignDetail],
    pictures: Sequence[Picture],
    record: dict[str, Any],
) -> Page:
    plan = results.plan
    synthetic = any(style.is_synthetic(detail.ocean) for detail in details.values())
    failed = results.frame.loc[results.frame["status"] != "OK", "status"].value_counts()
    table = results.table
    near = results.frame.loc[results.near].sort_values("error_m", kind="stable")
    objective = results.plan.section.objectives[0].replace("_", " ")
    caption = f"Near-optimal designs: {objective} within 10 % of the best"
    frame = figures.pair_frame(details)
    words = {name: f"{name} [%]" for name in details}
    return Page(
        title=f"Plan of {plan.base.study.name}",
        facts=[_fact(results)],
        description=" ".join(results.sentences),
        notes=[
            *([SYNTHETIC_NOTE] if synthetic else []),
            *results.notes,
            *(f"{counted(count, 'design')} failed: {line}" for line, count in failed.items()),
        ],
        cards=_cards(results),
        first_tables=[
            ResultTable("near_optimal", near, caption, columns=table.brief, words=table.words)
        ],
        explorer=_explorer(results),
        pictures=pictures,
        tables=[
            results.table,
            ResultTable(
                "lost_by_pair",
                frame,
                "Expected share of lost ranges of each pair",
                words=words,
                folded=True,
            ),
            _time_table(details),
        ],
        origin=[origin_table(record, "Options", "plan.json")],
    )


def _fact(results: PlanResults) -> str:
    plan = results.plan
    waters = counted(len(plan.waters), "water")
    of = "all vehicles" if plan.section.error_of is None else f"vehicle {plan.section.error_of}"
    return (
        f"{counted(len(results.designs), 'design')} in {waters}, condition {plan.condition},"
        f" position errors of {of}, objectives:"
        f" {', '.join(plan.section.objectives).replace('_', ' ')}"
    )


def _cards(results: PlanResults) -> list[Card]:
    """Cards of the best design and its scores, compared with the study as it is."""
    best = results.scores[results.best]
    base = results.base
    cards = [
        Card(key, f"{value:g}" if isinstance(value, int | float) else str(value), "best design")
        for key, value in results.designs[results.best].items()
    ][:4]
    for name, words, unit in (
        ("error_m", "95 % position error", " m"),
        ("lost_percent", "Lost ranges", " %"),
        ("heard_by_two_percent", "Pings that two receivers hear", " %"),
        ("cost", "Cost", ""),
    ):
        if name != "cost" or any(one.cost for one in (*best, *base)):
            before = mean_score(base, name)
            remark = (
                f"{show(before)}{unit} in the study as it is"
                if np.isfinite(before)
                else "the study as it is fails"
            )
            cards.append(Card(words, f"{show(mean_score(best, name))}{unit}", remark))
    return cards


def _explorer(results: PlanResults) -> Any:
    frame = results.frame
    numbers = [
        str(name)
        for name in frame
        if frame[name].dtype.kind == "f" and name not in results.plan.keys
    ]
    few = [key for key in results.plan.keys if frame[key].astype(str).nunique() <= _FEW_VALUES]
    across = [
        *results.plan.keys,
        *(name for name in ("cost", "lost_percent") if frame[name].nunique() > 1),
    ]
    # the key across is not the first choice
    each = ["front", *few] if len(results.plan.keys) == 1 else [*few[1:], *few[:1], "front"]
    return table_explorer(
        frame,
        numbers,
        across,
        each,
        lines=len(results.plan.keys) == 1 and not results.plan.ranges,
        labels=key_heading,
    )


def _time_table(details: Mapping[str, DesignDetail]) -> ResultTable:
    parts = [
        pd.DataFrame(
            {"design": name, "time_h": d.hours, "error_m": d.error_m, "worst_error_m": d.worst_m}
        )
        for name, d in details.items()
    ]
    words = {"error_m": "95 % error [m]", "worst_error_m": "95 % error, worst water [m]"}
    frame = pd.concat(parts, ignore_index=True)
    return ResultTable(
        "error_over_time", frame, "95 % position error over time", words=words, folded=True
    )


def _figure_specs(results: PlanResults, details: Mapping[str, DesignDetail]) -> list[FigureSpec]:
    best = next(iter(details.values()))
    header = style.ocean_header(best.ocean)
    synthetic = style.is_synthetic(best.ocean)
    against = {"cost": "cost", "lost_percent": "lost ranges"}.get(
        figures.other_objective(results), "pings that two receivers hear"
    )
    captions = {
        "front": f"95 % position error of each design against {against}. No other design is better"
        " in both than those on the front (blue). Designs with a circle have an error within 10 %"
        " of the smallest.",
        "map": "Mission of the best design: (a) start positions, tracks and landmarks (triangles)"
        " in plan, (b) depths. White marks are participants that other designs have at another"
        " place, in (b) at the right end.",
        "error_over_time": "95 % of the position errors of the vehicles that count are below the"
        " line"
        + (
            ", mean over the waters; shaded up to the water with the largest error."
            if len(results.base) > 1
            else "."
        ),
        "lost_by_pair": "Expected share of lost ranges of each pair of participants, both"
        " directions together. Empty: no attempts.",
    }
    drawings: dict[str, Callable[[float], Figure]] = {
        "front": partial(figures.front_figure, results, header),
        "map": partial(figures.map_figure, details, header),
        "error_over_time": partial(figures.time_figure, details, header),
        "lost_by_pair": partial(figures.pairs_figure, details, header),
    }
    return [
        FigureSpec.of_both_widths(name, with_source(captions[name], synthetic=synthetic), d)
        for name, d in drawings.items()
    ]
