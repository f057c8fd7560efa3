"""Two runs side by side: sound speed, range errors, dropouts and position errors of both."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
import pandas as pd

from pymantaray.evaluation import ALL_LINKS
from pymantaray.report.figures import Plate
from pymantaray.report.figures_ocean import sound_speed_profiles
from pymantaray.report.figures_ranging import range_error_histogram
from pymantaray.report.figures_trajectory import ApePanel, pooled_ape
from pymantaray.report.findings import Findings, gather
from pymantaray.report.html import document, figure_html, heading, readable, table_html
from pymantaray.report.page import SYNTHETIC_NOTE
from pymantaray.report.tables import write_table, write_text
from pymantaray.report.write import PAGE, STAGE, Progress, draw_plates, silent
from pymantaray.study.store import TABLES, Run, open_run, staged_folder

_CAPTIONS = {
    "range_drop_category_compare": "Ranging failure rate by link category [%]",
    "range_error": "Signed range error, refracted minus straight",
    "range_error_split": "Mean of the range error and of its parts, all links",
    "ate_pooled": "Position error by condition, pooled over vehicles, times and realizations",
    "region": "Regions",
}


def write_comparison(
    run_dir_a: str | Path,
    run_dir_b: str | Path,
    out: str | Path | None = None,
    *,
    progress: Progress | None = None,
) -> Path:
    """
    Write tables, figures and page that set two runs side by side.

    Parameters
    ----------
    run_dir_a, run_dir_b : str or pathlib.Path
        Folders of the runs.
    out : str or pathlib.Path, optional
        Folder for the comparison, new or empty.
    progress : callable, optional
        Called with ``"report"``, the parts done and the parts there are.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``; beside it ``tables`` (CSV) and ``figures`` (PNG and PDF).

    Raises
    ------
    MantaRayError
        If a folder is no run, ``out`` is not free, or nothing can be written; then nothing is left behind.
    """
    report = progress or silent
    report(STAGE, 0, 1)
    runs = [open_run(run_dir_a), open_run(run_dir_b)]
    found = [gather(run) for run in runs]
    names = distinct_names(runs, [f.region for f in found])
    tables = comparison_tables(found, names)
    plates = comparison_plates(found, names)
    with staged_folder(out, "comparison") as (folder, place):
        for key, table in tables.items():
            write_table(table, folder / TABLES / f"{key}.csv")
        draw_plates(plates, folder, report)
        write_text(_page(found, names, tables, plates), folder / PAGE)
    return place / PAGE


def distinct_names(runs: Sequence[Run], regions: Sequence[str]) -> list[str]:
    """
    Names that tell runs apart: their regions, else their studies, else their folders.

    Parameters
    ----------
    runs : sequence of Run
    regions : sequence of str
        Name of each run's ocean.

    Returns
    -------
    list of str
    """
    studies = [run.config.study.name for run in runs]
    for names in (list(regions), studies, [run.path.name for run in runs]):
        if len(set(names)) == len(names):
            return names
    return [f"{study} ({i + 1})" for i, study in enumerate(studies)]


def comparison_tables(found: Sequence[Findings], names: Sequence[str]) -> dict[str, pd.DataFrame]:
    """
    Tables of several runs, one column of numbers each.

    Parameters
    ----------
    found : sequence of Findings
    names : sequence of str
        Of the runs, all different.

    Returns
    -------
    dict of str to pandas.DataFrame
        ``range_drop_category_compare`` is the paper's table of dropouts: a row for each link category,
        percentages. The others have a row for each quantity and its unit.
    """
    per_run = {name: f.tables for name, f in zip(names, found, strict=True)}
    every = [t["range_error"].query("category == @ALL_LINKS") for t in per_run.values()]
    split = [t["range_error_split"].query("category == @ALL_LINKS") for t in per_run.values()]
    errors = pd.concat(
        {n: t["ate_pooled"].set_index("condition") for n, t in per_run.items()}, axis=1, sort=False
    )
    conditions = errors.index.to_list()
    statistics = ["mean_m", "median_m", "rmse_m", "p25_m", "p75_m", "p95_m"]
    regions = [t["region"].set_index("property").iloc[:, 0] for t in per_run.values()]
    return {
        "range_drop_category_compare": _side_by_side(
            [t["dropouts"].set_index("category")["percent"] for t in per_run.values()],
            [f"{name} [%]" for name in names],
            "link category",
            last=ALL_LINKS,
        ),
        "range_error": _side_by_side([e.drop(columns="category").iloc[0] for e in every], names, "quantity"),
        "range_error_split": _side_by_side(
            [s.set_index("part")["mean_m"] for s in split], [f"{name} [m]" for name in names], "part"
        ),
        "ate_pooled": pd.DataFrame(
            [
                {"condition": c, "quantity": s, **{n: errors.loc[c, (n, s)] for n in names}}
                for c in conditions
                for s in statistics
            ]
        ),
        "region": _side_by_side(regions, names, "property"),
    }


def comparison_plates(found: Sequence[Findings], names: Sequence[str]) -> list[Plate]:
    """
    Figures of several runs.

    Parameters
    ----------
    found : sequence of Findings
    names : sequence of str
        Of the runs, all different.

    Returns
    -------
    list of Plate
    """
    pairs = list(zip(names, found, strict=True))
    header, made_up = joint_header(found, names), any(f.synthetic for f in found)
    which = " and ".join(names)
    means = "mean solid, quartiles dashed"
    plates = [
        (
            "sound_speed",
            (
                f"Sound speed against depth in {which}: mean of each level over the whole region (line), least to"
                " greatest (shaded)."
            ),
            lambda: sound_speed_profiles([(n, f.run.profile) for n, f in pairs], header),
        ),
        (
            "range_error",
            (
                f"Signed range error, refracted minus straight, in {which}: mean (orange), zero (dashed) and fitted"
                " normal (black)."
            ),
            lambda: range_error_histogram([(n, f.ranges.total) for n, f in pairs], header),
        ),
        (
            "ape_pooled",
            f"Absolute position error by ranging condition in {which}, logarithmic scale; {means}.",
            lambda: pooled_ape([ApePanel(n, f.errors, log=True) for n, f in pairs], header),
        ),
        (
            "ape_pooled_linear",
            f"Absolute position error by ranging condition in {which}, linear scale; {means}.",
            lambda: pooled_ape([ApePanel(n, f.errors, log=False) for n, f in pairs], header),
        ),
    ]
    return [Plate(name, caption, draw, made_up) for name, caption, draw in plates]


def joint_header(found: Sequence[Findings], names: Sequence[str]) -> str:
    """
    Line on top of figures that show several oceans.

    Parameters
    ----------
    found : sequence of Findings
    names : sequence of str
        Of the runs.

    Returns
    -------
    str
        Says which of the oceans are synthetic.
    """
    made_up = [name for name, f in zip(names, found, strict=True) if f.synthetic]
    if not made_up:
        return " and ".join(names)
    if len(made_up) == len(names):
        return f"{' and '.join(names)}, synthetic oceans"
    return f"{' and '.join(names)}; synthetic ocean: {', '.join(made_up)}"


def _side_by_side(
    columns: Sequence["pd.Series[float]"], names: Sequence[str], key: str, last: str = ""
) -> pd.DataFrame:
    rows = list(dict.fromkeys(row for column in columns for row in column.index))
    rows.sort(key=lambda row: row == last)
    table = pd.DataFrame({name: column.reindex(rows) for name, column in zip(names, columns, strict=True)})
    table.insert(0, key, rows)
    return table.reset_index(drop=True)


def _page(
    found: Sequence[Findings], names: Sequence[str], tables: dict[str, pd.DataFrame], plates: Sequence[Plate]
) -> str:
    title = " and ".join(names)
    body = [f"<h1>{escape(title)}</h1>"]
    for name, f in zip(names, found, strict=True):
        attempts = f.run.measurements.range_status.size
        heard = int(np.isfinite(f.ranges.total).sum())
        text = f"{name}: study {f.run.config.study.name}, {heard:,} of {attempts:,} ranges heard"
        body.append(f'<p class="soft">{escape(text)}</p>')
    if any(f.synthetic for f in found):
        which = ", ".join(n for n, f in zip(names, found, strict=True) if f.synthetic)
        body.append(f'<p class="note">{escape(f"{which}: {SYNTHETIC_NOTE}")}</p>')
    body += ["<h2>Tables</h2>"]
    for key, caption in _CAPTIONS.items():
        table = tables[key]
        if "quantity" in table:
            table = table.assign(quantity=table["quantity"].map(heading))
        if key == "region":
            table = readable(table)
        body.append(table_html(table, caption, f"tables/{key}.csv"))
    body += ["<h2>Figures</h2>", *(figure_html(plate.name, plate.full_caption) for plate in plates)]
    return document(f"{title}, MantaRay", body)
