"""The page of one run: what was found, its figures and tables, and what it was made with."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.evaluation import ALL_LINKS
from pymantaray.records import VehicleStatus
from pymantaray.report.figures import Plate
from pymantaray.report.findings import Findings
from pymantaray.report.html import cards_html, document, figure_html, readable, show, signed, table_html
from pymantaray.report.labels import condition_label

SYNTHETIC_NOTE = (
    "The ocean of this study is synthetic: it is made from published water masses, not from measurements or a"
    " forecast of the day. Its numbers say what such an ocean does, not what the real one did."
)
CAPTIONS = {
    "ate_pooled": "Position error by condition, pooled over vehicles, times and realizations",
    "ate_difference": "Difference of position error between conditions, 95 % intervals over realizations",
    "consistency": "Consistency: sums over realizations of NEES and of range innovations by their degrees of freedom,"
    " and at how many epochs they are inside their 95 % bounds",
    "unknowns": "Sound-speed modes and clocks: standard deviation before and after, the share of the prior variance that"
    " the measurements took away, and the errors",
    "dropouts": "Range attempts and dropouts by kind of link, and their causes",
    "range_error": "Signed range error, refracted minus straight, by kind of link",
    "range_error_split": "Range error split into reference speed and bending",
    "region": "Region",
    "ate_per_agent": "Position error by condition and vehicle",
    "ate_per_realization": "Position error by condition and realization",
    "consistency_per_epoch": "Consistency at each epoch",
    "consistency_per_agent": "Consistency of each vehicle at each epoch",
    "coverage": "Share of position errors within 1 and 3 sigma, with binomial bounds",
    "unknowns_directions": "Combinations of modes and clocks that the measurements see, from best to least",
    "solves": "Health of each solve",
}
_SHOWN = {  # where the CSV file has more columns than fit on a page
    "ate_pooled": "condition failed_solves mean_m median_m rmse_m p5_m p25_m p75_m p95_m max_m",
    "ate_difference": "condition baseline statistic realizations pooled_difference_m bootstrap_low_m"
    " bootstrap_high_m",
    "ate_per_agent": "condition agent mean_m median_m rmse_m p5_m p25_m p75_m p95_m max_m",
    "ate_per_realization": "condition realization mean_m median_m rmse_m p5_m p25_m p75_m p95_m max_m",
    "range_error": "category n mean_m sd_m skewness excess_kurtosis p1_m p5_m p95_m p99_m min_m max_m"
    " percent_beyond_3_sigma",
}
_MEANING = {"OVER_CHI_SQUARE": " (converged, but the cost is not what the noise lets one expect)"}
_FOLDED = {
    "ate_per_agent",
    "ate_per_realization",
    "consistency_per_epoch",
    "consistency_per_agent",
    "coverage",
    "unknowns_directions",
    "solves",
}


def run_page(found: Findings, plates: Sequence[Plate]) -> str:
    """
    Page of a run, to be read offline beside its folders ``figures`` and ``tables``.

    Parameters
    ----------
    found : Findings
    plates : sequence of Plate
        Figures that were saved.

    Returns
    -------
    str
        HTML.
    """
    config = found.run.config
    name = config.study.name
    mission = (
        f"{found.region}: {len(config.fleet.vehicles)} vehicles, {config.mission.duration_h:g} h,"
        f" {config.study.realizations} noise realization{'' if config.study.realizations == 1 else 's'}"
    )
    body = [f"<h1>{escape(name)}</h1>", f'<p class="soft">{escape(mission)}</p>']
    if config.study.description:
        body.append(f"<p>{escape(config.study.description)}</p>")
    if found.synthetic:
        body.append(f'<p class="note">{escape(SYNTHETIC_NOTE)}</p>')
    body += [f'<p class="note">{escape(line)}</p>' for line in troubles(found)]
    body += [cards_html(headlines(found)), "<h2>Figures</h2>"]
    body += [figure_html(plate.name, plate.full_caption) for plate in plates]
    body.append("<h2>Tables</h2>")
    for key, caption in CAPTIONS.items():
        if key not in found.tables:  # a run without covariances
            continue
        table = found.tables[key]
        shown = table[_SHOWN[key].split()] if key in _SHOWN else readable(table)
        body.append(table_html(shown, caption, f"tables/{key}.csv", folded=key in _FOLDED))
    body.append("<h2>How it was made</h2>")
    body.append(table_html(_flat(found.run.manifest), "Manifest", "manifest.json"))
    body.append('<p><a href="config.toml">Configuration</a></p>')
    return document(f"{name}, MantaRay", body)


def headlines(found: Findings) -> list[tuple[str, str, str]]:
    """
    Numbers that the page opens with.

    Parameters
    ----------
    found : Findings

    Returns
    -------
    list of tuple of str
        What it is, its value, and a remark.
    """
    tables = found.tables
    drop = _row(tables["dropouts"], category=ALL_LINKS)
    total = _row(tables["range_error"], category=ALL_LINKS)
    bending = _row(tables["range_error_split"], category=ALL_LINKS, part="bending")
    heard = drop["attempts"] - drop["dropouts"]
    dropouts = f"{drop['percent']:.1f} % dropouts" if drop["attempts"] else "no attempts"
    cards = [
        ("Ranges heard", f"{heard:,} of {drop['attempts']:,}", dropouts),
        (
            "Mean range error",
            signed(total["mean_m"], "m"),
            f"sd {show(total['sd_m'])} m; 1 % to 99 %: {show(total['p1_m'])} to {show(total['p99_m'])} m",
        ),
        (
            "Mean bending",
            signed(bending["mean_m"], "m"),
            "the rest of the range error is reference speed",
        ),
    ]
    for row in tables["ate_pooled"].to_dict("records"):
        cards.append(
            (
                f"Position error, {condition_label(row['condition']).lower()}",
                "–" if np.isnan(row["mean_m"]) else f"{row['mean_m']:.2f} m",
                f"mean; RMSE {show(row['rmse_m'])} m",
            )
        )
    difference = tables["ate_difference"]
    if len(difference):
        first = difference.iloc[0]
        interval = (
            f"{signed(first['bootstrap_low_m'], 'm')} to {signed(first['bootstrap_high_m'], 'm')} (95 %)"
        )
        cards.append(
            (
                f"{first['condition']} minus {first['baseline']}".capitalize(),
                signed(first["pooled_difference_m"], "m"),
                f"mean position error; {interval}",
            )
        )
    return cards


def troubles(found: Findings) -> list[str]:
    """
    What a reader must know before trusting the numbers.

    Parameters
    ----------
    found : Findings

    Returns
    -------
    list of str
        One line for each condition with unhealthy solves and each vehicle that stopped.
    """
    solves, truth = found.tables["solves"], found.run.truth
    lines = []
    for (condition, status), part in solves[solves["status"] != "OK"].groupby(["condition", "status"]):
        every = int((solves["condition"] == condition).sum())
        lines.append(
            f"Condition {condition}: {len(part)} of {every} solves have status {status}{_MEANING.get(str(status), '')}."
        )
    for name, row in zip(truth.name, truth.status, strict=True):
        if row[-1] != VehicleStatus.ACTIVE:
            hours = truth.time[np.argmax(row != VehicleStatus.ACTIVE)] / 3600.0
            lines.append(f"Vehicle {name} stopped after {hours:.1f} h: {VehicleStatus(int(row[-1])).name}.")
    return lines


def _row(table: pd.DataFrame, **where: str) -> dict[str, Any]:
    for row in table.to_dict("records"):
        if all(row[key] == value for key, value in where.items()):
            return {str(key): value for key, value in row.items()}
    raise AssertionError(f"no row with {where}")


def _flat(content: dict[str, Any], path: str = "") -> pd.DataFrame:
    rows: list[tuple[str, str]] = []

    def walk(value: Any, key: str) -> None:
        if isinstance(value, dict) and value:
            for name, item in value.items():
                walk(item, f"{key} / {name}" if key else str(name))
        elif isinstance(value, list):
            rows.append((key, ", ".join(str(item) for item in value) or "none"))
        else:
            rows.append((key, "none" if value in (None, {}) else str(value)))

    walk(content, path)
    return pd.DataFrame(rows, columns=["entry", "value"])
