"""The page of a run: what is told of it, and numbers and tables as people read them; the templates lay it out."""

import gzip
import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from pymantaray.config.sections import StudyConfig
from pymantaray.evaluation import ALL_LINKS
from pymantaray.records import SolveStatus
from pymantaray.records.status import SOLVE_STATUS_WORDS
from pymantaray.report.explore import explorer
from pymantaray.report.figures import Results
from pymantaray.report.glossary import GLOSSARY, explained, meaning
from pymantaray.report.style import clock, condition_label
from pymantaray.report.tables import TABLES
from pymantaray.study.store import CONFIG

SYNTHETIC_NOTE = (
    "The ocean of this study is synthetic: it is made from published water masses, not from measurements or a"
    " forecast of the day. Its numbers say what such an ocean does, not what the real one did."
)
_UNITS = {"_m": " [m]", "_s": " [s]", "_h": " [h]", "_deg": " [deg]", "_percent": " [%]"}
_WORDS = {
    "n": "N",
    "sd_m": "sd [m]",
    "rmse_m": "RMSE [m]",
    "p1_m": "1 % [m]",
    "p5_m": "5 % [m]",
    "p25_m": "25 % [m]",
    "p75_m": "75 % [m]",
    "p95_m": "95 % [m]",
    "p99_m": "99 % [m]",
    "from_straight_rmse_m": "RMSE from straight [m]",
    "from_straight_median_m": "median from straight [m]",
    "rmse_standard_error_m": "standard error of RMSE [m]",
    "bound_rmse_m": "lower bound of RMSE [m]",
    "efficiency": "efficiency, (bound / RMSE)²",
    "percent": "share [%]",
    "percent_beyond_3_sigma": "> 3 sigma [%]",
}
_CONDITIONS = {
    "odometry": "the noisy odometry, composed from the first pose",
    "straight": "the fleet's factor graph with straight distances plus noise as ranges",
    "refracted": "the same graph, noise and links with ranges as a modem reports them: travel time times the sound speed"
    " at the transmitter",
    "straight-all": "straight ranges of all attempts, none of them lost",
    "no-ranges": "the graph without ranges",
}
_LONG = 40  # characters of a cell that may be broken
_LARGE, _HUGE = 1e5, 1e7  # from here on numbers have no decimals, and an exponent
_MOST_ROWS = 500  # of a table on the page


class Picture(NamedTuple):
    """A figure that was drawn: size on the page [px], files by kind, signs, colours and words of its legend, counterpart in the paper."""

    name: str
    caption: str
    width: int
    height: int
    files: Mapping[str, bytes]
    legend: Sequence[tuple[str, str, str]] = ()
    paper: str = ""


class ShownTable(NamedTuple):
    """A table as a template writes it; a cell is its text and its class of the style sheet, a head has its meaning too."""

    caption: str
    file: str
    kind: str
    folded: bool
    head: list[tuple[str, str, str]]
    rows: list[list[tuple[str, str]]]
    paper: str = ""


def render(template: str, **content: Any) -> str:
    """Page of a template in ``templates``; everything put into it is escaped."""
    loader = PackageLoader("pymantaray.report", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["base64"] = lambda content: b64encode(content).decode()
    environment.filters["packed"] = lambda text: b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()
    environment.globals["plotly"] = get_plotlyjs
    return environment.get_template(template).render(content) + "\n"


def run_page(results: Results, pictures: Sequence[Picture], rays: str) -> str:
    """Page of a run, whole by itself; it links to the files in ``figures`` and ``tables`` beside it."""
    config = results.run.config
    mission = f"{results.region}: {results.run.truth.name.size} vehicles, {config.mission.duration_h:g} h"
    if config.solves:
        count = config.study.realizations
        mission += f", {count} noise realization{'' if count == 1 else 's'}"
    manifest = pd.DataFrame(entries(results.run.manifest), columns=["entry", "value"])
    return render(
        "run.html",
        title=config.study.name,
        facts=[mission, *_provenance(results)],
        description=config.study.description,
        notes=[*([SYNTHETIC_NOTE] if results.synthetic else []), *troubles(results)],
        cards=headlines(results),
        words=_words(results),
        explorer=explorer(results, rays),
        pictures=pictures,
        run_tables=list(shown_tables(results).values()),
        origin=[show_table(manifest, "Manifest", "manifest.json")],
        citation=_citation(results),
        references=results.run.manifest.get("references", []),
    )


def shown_tables(results: Results) -> dict[str, ShownTable]:
    """Tables of the page of a run by their names, in its order."""
    shown = {}
    for name, frame in results.tables.items():
        table = TABLES[name]
        if name == "region":
            frame = numbers_from_text(frame)
        columns = frame[table.columns.split()] if table.columns else frame
        shown[name] = show_table(
            columns,
            table.caption,
            f"tables/{name}.csv",
            folded=table.folded,
            words=table.words,
            by_row=table.by_row,
        )._replace(paper=table.paper)
    return shown


def _provenance(results: Results) -> list[str]:
    """What made the run, which water, when, for how long and by which command; and how it is made again."""
    manifest, time = results.run.manifest, str(results.run.ocean.attrs.get("time", ""))
    version, made = manifest["versions"].get("pymantaray"), manifest.get("made")
    facts = [f"MantaRay {version}"] if version else []
    facts += [f"water of {time[:16].replace('T', ' ')} UTC"] if time else []
    facts.append(f"seed {results.run.config.study.seed}")
    if made is not None:  # by a version that says so
        began = f"{made['began'][:16].replace('T', ' ')} UTC"
        facts.append(f"made {began} in {sum(manifest['seconds'].values()):.0f} s")
    lines = [", ".join(facts)]
    if made is not None and made["command"]:
        lines.append(f"Command: {made['command']}")
    return [*lines, "Again with: mantaray study run config.toml"]


def _words(results: Results) -> list[str]:
    """Conditions of the run and words of its tables, each with its meaning."""
    tables = results.tables
    causes = tables["dropouts"].set_index("category").loc[ALL_LINKS]
    used = [str(name) for name in causes.index if name in GLOSSARY and causes[name] > 0]
    used += ["reference speed", "bending"]
    if not results.run.config.solves:
        return explained(used)
    lines = [
        f"{condition_label(name)}: {_CONDITIONS[name]}." for name in results.errors if name in _CONDITIONS
    ]
    used += ["NEES"] if "consistency" in tables else []
    used += ["lower bound", "efficiency"] if tables["ping_error"]["bound_rmse_m"].notna().any() else []
    return [*lines, *explained(used)]


def _citation(results: Results) -> tuple[str, str]:
    """How a paper cites the run, in words and as BibTeX: the program, its version, and what makes the run again."""
    run, manifest = results.run, results.run.manifest
    versions = manifest["versions"]
    version, commit = versions.get("pymantaray", "unknown"), versions.get("git_commit")
    made = str((manifest.get("made") or {}).get("began", ""))[:10]
    study, seed = run.config.study.name, run.config.study.seed
    which = f"version {version}" + (f", commit {commit[:12]}" if commit else "")
    digest = sha256((run.path / CONFIG).read_bytes()).hexdigest()[:12]
    words = f"Study {study}, seed {seed}, configuration {digest} (SHA-256 of config.toml), made with MantaRay, {which}"
    note = f"{which}; study {study}, seed {seed}, configuration {digest}"
    lines = ["@software{mantaray,", "  author = {{The MantaRay developers}},"]
    lines += ["  title = {MantaRay: what the real ocean does to acoustic ranges between vehicles},"]
    lines += [f"  year = {{{made[:4]}}},"] if made else []
    lines += [f"  version = {{{version}}},", f"  note = {{{note.replace('_', chr(92) + '_')}}}", "}"]
    return f"{words}{f' on {made}' if made else ''}.", "\n".join(lines)


def headlines(results: Results) -> list[tuple[str, str, str]]:
    """Numbers that the page opens with: what it is, its value, and a remark."""
    tables = results.tables
    drop = _row(tables["dropouts"], category=ALL_LINKS)
    total = _row(tables["range_error"], category=ALL_LINKS)
    bending = _row(tables["range_error_split"], category=ALL_LINKS, part="bending")
    dropouts = f"{drop['percent']:.1f} % dropouts" if drop["attempts"] else "no attempts"
    ends = [signed_metres(total[f"p{percent}_m"]) for percent in (1, 99)]
    spread = f"sd {metres(total['sd_m'])}; 1 % to 99 %: {' to '.join(ends)}"
    cards = [
        ("Ranges heard", f"{results.heard:,} of {results.attempts:,}", dropouts),
        ("Mean range error", signed_metres(total["mean_m"]), spread),
        ("Mean bending", signed_metres(bending["mean_m"]), "the rest of the range error is reference speed"),
    ]
    if results.run.config.solves:
        cards += _error_cards(tables)
    return cards


def _error_cards(tables: Mapping[str, pd.DataFrame]) -> list[tuple[str, str, str]]:
    """What was estimated, among the numbers that the page opens with."""
    cards, at_pings = [], tables["ping_error"].set_index("condition")["rmse_m"]
    for row in tables["ate_pooled"].to_dict("records"):
        what = f"Position error, {condition_label(row['condition']).lower()}"
        rmse = metres(row["rmse_m"])
        remark = f"mean; RMSE {rmse}; RMSE under water at pings {metres(at_pings[row['condition']])}"
        cards.append((what, metres(row["mean_m"]), remark))
    for row in tables["ate_difference"].head(1).to_dict("records"):
        ends = [row[f"bootstrap_{end}_m"] for end in ("low", "high")]
        interval = f"; {' to '.join(map(signed_metres, ends))} (95 %)" if np.isfinite(ends).all() else ""
        what = f"{row['condition']} minus {row['baseline']}".capitalize()
        cards.append((what, signed_metres(row["pooled_difference_m"]), f"mean position error{interval}"))
    return cards


def troubles(results: Results) -> list[str]:
    """What a reader must know before trusting the numbers: unhealthy solves and vehicles that stopped, a line each."""
    solves, lines = results.tables.get("solves", pd.DataFrame(columns=["condition", "status"])), []
    for (condition, status), part in solves[solves["status"] != "OK"].groupby(["condition", "status"]):
        every = int((solves["condition"] == condition).sum())
        words = SOLVE_STATUS_WORDS.get(SolveStatus[str(status)])
        meaning = "" if words is None else f" ({words.meaning}; {words.advice})"
        lines.append(f"Condition {condition}: {len(part)} of {every} solves have status {status}{meaning}.")
    for name, (stop, time) in results.run.truth.stops.items():
        lines.append(f"Vehicle {name} stopped after {clock(time / 3600.0)}: {stop.name}.")
    return lines


def show_table(
    table: pd.DataFrame,
    caption: str,
    file: str,
    *,
    folded: bool = False,
    words: Mapping[str, str] = MappingProxyType({}),
    by_row: bool = False,
) -> ShownTable:
    """
    Table for a template, without its index and cut to the rows that a page has room for; ``file`` is what it links to.

    ``words`` are heads of columns that mean something else in other tables. The numbers of a column have the same decimals; those of
    a row do with ``by_row``, for tables whose rows are quantities.
    """
    if len(table) > _MOST_ROWS:
        caption = f"{caption.removesuffix('.')}: the first {_MOST_ROWS} of {len(table):,} rows"
        table = table.head(_MOST_ROWS)
    marks = ["number" if pd.api.types.is_numeric_dtype(table[column]) else "" for column in table.columns]

    cells = table.astype(object).to_numpy()
    texts = cells.copy()
    lines, sources = (texts, cells) if by_row else (texts.T, cells.T)
    decimals = [None] * len(lines) if by_row else _decimals_of_columns(table)
    for line, values, digits in zip(lines, sources, decimals, strict=True):
        line[:] = show_alike(values.tolist(), digits)

    def cell(text: str, mark: str) -> tuple[str, str]:
        return text, "long" if not mark and len(text) > _LONG else mark

    return ShownTable(
        caption,
        file,
        file.rpartition(".")[2].upper(),
        folded,
        [
            (words.get(str(column), heading(str(column))), mark, meaning(str(column)))
            for column, mark in zip(table.columns, marks, strict=True)
        ],
        [[cell(text, mark) for text, mark in zip(row, marks, strict=True)] for row in texts.tolist()],
    )


def heading(column: str) -> str:
    """Head of a column for people, its unit in brackets; a key of a configuration as it is written there."""
    if column in _WORDS:
        return _WORDS[column]
    if "." in column:
        return column + _unit_of_key(column)
    for ending, unit in _UNITS.items():
        if column.endswith(ending):
            return column.removesuffix(ending).replace("_", " ") + unit
    return column.replace("_", " ")


def _unit_of_key(key: str) -> str:
    """Unit of a key of a configuration's section in brackets, with which its description ends; empty if it has none."""
    section, _, name = key.partition(".")
    model = StudyConfig.model_fields[section].annotation if section in StudyConfig.model_fields else None
    field = getattr(model, "model_fields", {}).get(name)
    unit = re.search(r" \[[^][]+\]$", field.description or "") if field else None
    return unit[0] if unit else ""


def show_alike(values: Sequence[Any], decimals: int | None = None) -> list[str]:
    """Values of one quantity: numbers that are not all whole have the same decimals, by default two or more, if each then shows a digit."""
    numbers = _numbers(values)
    decimals = _decimals(numbers) if decimals is None else decimals
    if len(numbers) < 2 or decimals is None or not _all_show(numbers, decimals):
        return [show(value) for value in values]
    return [
        f"{value:,.{decimals}f}".replace("-", "−") if len(_numbers([value])) else show(value)
        for value in values
    ]


def _numbers(values: Sequence[Any]) -> NDArray[np.float64]:
    """Those of values that are floating-point numbers and finite."""
    return np.array([v for v in values if isinstance(v, float | np.floating) and np.isfinite(v)], dtype=float)


def _decimals(numbers: NDArray[np.float64]) -> int | None:
    """Decimals with which the largest of some numbers has four digits, at least two unless all are whole; None if they are huge or all 0."""
    largest = float(np.abs(numbers).max(initial=0.0))
    if not 0.0 < largest < _HUGE:
        return None
    if largest >= _LARGE or (numbers == np.round(numbers)).all():
        return 0
    return max(2, 3 - int(np.floor(np.log10(largest))))


def _all_show(numbers: NDArray[np.float64], decimals: int) -> bool:
    """Whether each number but 0 keeps a digit."""
    sizes = np.abs(numbers[numbers != 0.0])
    return bool((sizes >= 0.5 * 10.0**-decimals).all())


def _decimals_of_columns(table: pd.DataFrame) -> list[int | None]:
    """Decimals of each column: those in one unit have the same if all their numbers then show a digit."""
    columns = [str(column) for column in table.columns]
    units = [next((ending for ending in _UNITS if column.endswith(ending)), column) for column in columns]
    numbers = [_numbers(table.iloc[:, k].tolist()) for k in range(len(columns))]
    shared = {}
    for unit in set(units):
        pooled = np.concatenate([part for part, own in zip(numbers, units, strict=True) if own == unit])
        decimals = _decimals(pooled)
        shared[unit] = decimals if decimals is not None and _all_show(pooled, decimals) else None
    return [shared[unit] for unit in units]


def show(value: Any) -> str:
    """Value of a cell: four digits for a measured number, all of them for a count, a dash for a missing value."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{int(value):,}".replace("-", "−")
    if not isinstance(value, float | np.floating):
        return str(value)
    size = abs(float(value))
    if np.isnan(size):
        return "–"
    if size == 0.0 or 1e-3 <= size < 1e4:
        text = f"{value:.4g}"
    else:
        text = f"{value:,.0f}" if 1e4 <= size < 1e7 else f"{value:.3e}"
    return text.replace("-", "−")


def metres(value: float) -> str:
    """Number with its unit and as many digits as `signed_metres` gives, a dash for a missing value."""
    return f"{value:,.2f} m".replace("-", "−") if np.isfinite(value) else "–"


def signed_metres(value: float) -> str:
    """Number with its sign and unit, a dash for a missing value."""
    return f"{value:+.2f} m".replace("-", "−") if np.isfinite(value) else "–"


def numbers_from_text(table: pd.DataFrame) -> pd.DataFrame:
    """Turn text that is a number into that number, so that it is shown as one; for tables that mix both."""

    def number(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        for kind in (int, float):
            try:
                return kind(value)
            except ValueError:
                continue
        return value

    return table.astype(object).map(number)


def _row(table: pd.DataFrame, **where: str) -> dict[str, Any]:
    """The row of a table that has given values."""
    (row,) = table[np.logical_and.reduce([table[key] == value for key, value in where.items()])].to_dict(
        "records"
    )
    return {str(key): value for key, value in row.items()}


def entries(content: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Entries of nested dictionaries, each by the way to it."""
    if isinstance(content, dict) and content:
        for name, item in content.items():
            yield from entries(item, f"{path} / {name}" if path else str(name))
    elif isinstance(content, list):
        texts = [str(item) for item in content]
        yield path, ("\n" if any(", " in text for text in texts) else ", ").join(texts) or "none"
    else:
        yield path, "none" if content in (None, {}) else str(content)
