"""Page of a run."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pymantaray.apps.study.explore import explorer
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.mission import earth_note
from pymantaray.apps.study.references import MANTARAY
from pymantaray.evaluation import ALL_LINKS
from pymantaray.jobs.run_folder import CONFIG, without_checksums
from pymantaray.pages.page import Card, Explorer, Page, origin_table
from pymantaray.plotting.style import clock, condition_label
from pymantaray.records import SolveStatus
from pymantaray.records.digits import counted, metres, signed_metres
from pymantaray.records.glossary import GLOSSARY, glossary_lines
from pymantaray.records.result_table import ResultTable
from pymantaray.records.status import SOLVE_STATUS_WORDS

SYNTHETIC_NOTE = (
    "The ocean of this study is synthetic: it is composed of published water masses, not of"
    " measurements or a forecast. The results are valid for such an ocean, not for the real ocean"
    " on a day."
)
_CONDITIONS = {
    "odometry": "noisy odometry, integrated from the first pose",
    "straight": "factor graph of the fleet; ranges are straight distances plus noise",
    "refracted": "same graph, noise and links; ranges are those of a modem: travel time times the"
    " sound speed at the transmitter",
    "straight-all": "straight ranges of all attempts, without dropouts",
    "no-ranges": "the graph without ranges",
}


def run_page(results: RunResults, rays: str) -> Page:
    """Page of a run without its figures; ``rays`` is the result of `mission_rays`."""
    run = results.run
    study = run.study
    hours = study.duration / 3600.0
    mission = f"{results.region}: {counted(run.truth.name.size, 'vehicle')}, {hours:g} h"
    if study.solves:
        mission += f", {counted(study.realizations, 'noise realization')}"
    return Page(
        title=study.name,
        facts=[mission],
        description=study.description,
        notes=[*([SYNTHETIC_NOTE] if results.synthetic else []), *warnings_of(results)],
        cards=headlines(results),
        question="What did refraction do?",
        lead="refraction",
        long=True,
        words=_words(results),
        explorer=Explorer("pymantaray.apps.study/run", explorer(results, rays)),
        tables=list(results.tables.values()),
        links={"Configuration": "config.toml"},
        made=_provenance(results),
        origin=[origin_table(without_checksums(run.manifest), "Manifest", "manifest.json")],
        citation=citation_of([results]),
        references=run.manifest.get("references", []),
    )


def _provenance(results: RunResults) -> list[str]:
    """Version, water, seed, time and command of the run, and the command that repeats it."""
    manifest = results.run.manifest
    time = str(results.run.ocean.attrs.get("time", ""))
    version = manifest["versions"].get("pymantaray")
    made = manifest.get("made")
    facts = [f"MantaRay {version}"] if version else []
    facts += [f"water of {time[:16].replace('T', ' ')} UTC"] if time else []
    facts.append(f"seed {results.run.study.seed}")
    if made is not None:  # by a version that says so
        began = f"{made['began'][:16].replace('T', ' ')} UTC"
        facts.append(f"made {began} in {sum(manifest['seconds'].values()):.0f} s")
    lines = [", ".join(facts)]
    if made is not None and made["command"]:
        lines.append(f"Command: {made['command']}")
    return [*lines, "Repeat with: mantaray study run config.toml"]


def _words(results: RunResults) -> list[str]:
    """Conditions of the run and terms of its tables, each with its meaning."""
    tables = results.tables
    causes = tables["dropouts"].frame.set_index("category").loc[ALL_LINKS]
    used = [str(name) for name in causes.index if name in GLOSSARY and causes[name] > 0]
    used += ["reference speed", "bending"]
    if not results.run.study.solves:
        return glossary_lines(used)
    lines = [
        f"{condition_label(name)}: {_CONDITIONS[name]}."
        for name in results.errors
        if name in _CONDITIONS
    ]
    used += ["NEES"] if "consistency" in tables else []
    used += (
        ["lower bound", "efficiency"]
        if tables["ping_error"].frame["bound_rmse_m"].notna().any()
        else []
    )
    return [*lines, *glossary_lines(used)]


def citation_of(runs: Sequence[RunResults]) -> tuple[str, str]:
    """
    Citation of runs, as text and as BibTeX: the program, its versions, and what repeats the runs.
    """
    words = " ".join(
        f"Study {study}, made with MantaRay, {how}." for study, how in map(_made, runs)
    )
    versions = dict.fromkeys(_version(r) for r in runs)
    years = sorted({_began(r)[:4] for r in runs} - {""})
    note = "; ".join(
        f"{how.partition(' on ')[0]}; study {study}" for study, how in map(_made, runs)
    )
    # a page contains no address
    fields = {name: value for name, value in MANTARAY.fields.items() if name != "url"}
    fields |= {"version": ", ".join(versions), "note": note}
    fields |= {"year": years[-1]} if years else {}
    return words, replace(MANTARAY, fields=fields).bibtex


def _version(results: RunResults) -> str:
    return str(results.run.manifest["versions"].get("pymantaray", "unknown"))


def _began(results: RunResults) -> str:
    """Day on which a run began; empty if it does not say so."""
    return str((results.run.manifest.get("made") or {}).get("began", ""))[:10]


def _made(results: RunResults) -> tuple[str, str]:
    """Study with seed and configuration of a run, and version and day of its program."""
    run = results.run
    commit = run.manifest["versions"].get("git_commit")
    digest = run.manifest["files"][CONFIG][:12]
    study = f"{run.study.name}, seed {run.study.seed}, configuration {digest}"
    which = f"version {_version(results)}" + (f", commit {commit[:12]}" if commit else "")
    day = _began(results)
    return f"{study} (SHA-256 of config.toml)", f"{which}{f' on {day}' if day else ''}"


def headlines(results: RunResults) -> list[Card]:
    """
    Cards of a run: first the three that answer what refraction did, to ranges, links and positions.
    """
    tables = results.tables
    drop = _row(tables["dropouts"], category=ALL_LINKS)
    total = _row(tables["range_error"], category=ALL_LINKS)
    bending = _row(tables["range_error_split"], category=ALL_LINKS, part="bending")
    ends = [signed_metres(total[f"p{percent}_m"]) for percent in (1, 99)]
    lost = f"{drop['percent']:.1f} % dropouts" if drop["attempts"] else "no attempts"
    shadow = f"; {drop['shadow']:,} in shadow zones, without a direct ray" if drop["shadow"] else ""
    mean_bending = signed_metres(bending["mean_m"])
    cards = [
        Card(
            "Range error from refraction",
            f"{signed_metres(total['mean_m'])} mean, {metres(total['sd_m'])} sd",
            f"range minus straight distance; 1 % to 99 %: {' to '.join(ends)}",
        ),
        Card("Ranges lost", f"{drop['dropouts']:,} of {drop['attempts']:,}", lost + shadow),
        Card(
            "Mean bending", mean_bending, "the remaining range error is due to the reference speed"
        ),
    ]
    if not results.run.study.solves:
        return cards
    first, *others = [*_difference_cards(tables), *_error_cards(tables)]
    return [*cards[:2], first, *others, cards[2]]


def _difference_cards(tables: Mapping[str, ResultTable]) -> list[Card]:
    """Card of the first difference between conditions, refracted minus straight if both exist."""
    mean = tables["ate_pooled"].frame.set_index("condition")["mean_m"]
    cards = []
    for row in tables["ate_difference"].frame.head(1).to_dict("records"):
        ends = [row[f"bootstrap_{end}_m"] for end in ("low", "high")]
        interval = (
            f"; {' to '.join(map(signed_metres, ends))} (95 %)" if np.isfinite(ends).all() else ""
        )
        names = row["condition"], row["baseline"]
        difference = f"{names[0]} minus {names[1]}".capitalize()
        if names == ("refracted", "straight"):
            difference = "Position error from refraction"
        values = " and ".join(f"{metres(mean[n])} with {condition_label(n).lower()}" for n in names)
        cards.append(
            Card(
                difference,
                signed_metres(row["pooled_difference_m"]),
                f"mean over all poses: {values}{interval}",
            )
        )
    return cards


def _error_cards(tables: Mapping[str, ResultTable]) -> list[Card]:
    """Cards of the position errors of each condition."""
    cards = []
    at_pings = tables["ping_error"].frame.set_index("condition")
    for row in tables["ate_pooled"].frame.to_dict("records"):
        what = f"Position error, {condition_label(row['condition']).lower()}"
        pings = at_pings.loc[row["condition"]].to_dict()
        remark = f"mean; RMSE {_rmse(row)}; RMSE under water at pings {_rmse(pings)}"
        cards.append(Card(what, metres(row["mean_m"]), remark))
    return cards


def _rmse(row: Mapping[Hashable, Any]) -> str:
    """RMSE of a row with its standard error, if it has one."""
    error = row["rmse_standard_error_m"]
    return metres(row["rmse_m"]) + (f" ± {metres(error)}" if np.isfinite(error) else "")


def warnings_of(results: RunResults) -> list[str]:
    """Warnings about unhealthy solves, stopped vehicles and a flat Earth, one line each."""
    none = pd.DataFrame(columns=["condition", "status"])
    solves = results.tables["solves"].frame if "solves" in results.tables else none
    lines = []
    for (condition, status), part in solves[solves["status"] != "OK"].groupby(
        ["condition", "status"]
    ):
        every = int((solves["condition"] == condition).sum())
        words = SOLVE_STATUS_WORDS.get(SolveStatus[str(status)])
        meaning = "" if words is None else f" ({words.meaning}; {words.advice})"
        lines.append(
            f"Condition {condition}: {len(part)} of {every} solves have status {status}{meaning}."
        )
    for name, (stop, time) in results.run.truth.stops.items():
        lines.append(f"Vehicle {name} stopped after {clock(time / 3600.0)}: {stop.name}.")
    lines += results.run.notes
    if note := earth_note(results.run.study, results.run.truth, results.run.ranging_truth):
        lines.append(note)
    return lines


def _row(table: ResultTable, **where: str) -> dict[str, Any]:
    """Row of a table with these values."""
    frame = table.frame
    (row,) = frame[
        np.logical_and.reduce([frame[key] == value for key, value in where.items()])
    ].to_dict("records")
    return {str(key): value for key, value in row.items()}
