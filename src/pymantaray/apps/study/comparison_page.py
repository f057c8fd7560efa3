"""
Comparison of two or more runs: differences of configurations, sound speed, range errors, dropouts
and position errors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from pymantaray.apps.study.comparison_figures import quantiles_by_run
from pymantaray.apps.study.figures.ranging import range_error_histogram
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.apps.study.figures.trajectory import ApePanel, pooled_ape
from pymantaray.apps.study.page import SYNTHETIC_NOTE, citation_of
from pymantaray.apps.study.store import open_run
from pymantaray.apps.study.tables import TABLES
from pymantaray.arrays import Array
from pymantaray.config.settings import key_heading
from pymantaray.errors import ReportError
from pymantaray.evaluation import ALL_LINKS
from pymantaray.evaluation.comparison import paired_interval
from pymantaray.jobs.progress import Progress
from pymantaray.pages.folder import PAGE, TABLES as TABLES_FOLDER
from pymantaray.pages.page import Explorer, Page, entries, table_explorer, write_page
from pymantaray.plotting.drawing import FigureSpec, Picture, with_source
from pymantaray.plotting.style import condition_label, shortened
from pymantaray.plotting.water import sound_speed_profiles
from pymantaray.records.csv_text import read_csv
from pymantaray.records.result_table import ResultTable

SUMMARY = (
    "configuration",
    "range_drop_category_compare",
    "range_error",
    "range_error_split",
    "ate_pooled",
    "ate_run_difference",
)
"""Tables that `mantaray study compare` prints."""
_FIRST = ("ate_run_difference", "configuration")
"""Tables at the top of the page."""
_MAX_DIFFERENCES = 20  # of configurations that are not folded
_NO_KEY = "–"  # of a configuration that has not the key
_CAPTIONS = {
    "configuration": "Differences of the configurations",
    "range_drop_category_compare": "Ranging failure rate by link category [%]",
    "range_error": "Signed range error, refracted minus straight",
    "range_error_split": "Mean of the range error and of its parts, all links",
    "ate_pooled": "Position error by condition, pooled over vehicles, times and realizations",
    "ate_run_difference": "Difference of the mean position error between runs, with 95 % intervals"
    " over realizations. Runs with one seed are paired by realization",
    "ping_error": TABLES["ping_error"].caption,
    "region": "Regions",
    "timing": TABLES["timing"].caption,
    "noise": TABLES["noise"].caption,
}
_TABLES_OF_PAPER = {
    "range_drop_category_compare": TABLES["dropouts"].paper,
    **{name: TABLES[name].paper for name in ("region", "timing", "noise")},
}
_FIGURES_OF_PAPER = {
    "ape_pooled": "Figure 7",
    "ape_pooled_linear": "Figure 8",
    "range_error": "Figure 6",
    "sound_speed": "Figure 4",
}
# figures that show one run, drawn for a few runs
_OF_EACH = ("ray_picture", "fleet_layout", "factor_graph")
# tables of one quantity; rows of the others differ in theirs
_ONE_QUANTITY = ("range_drop_category_compare", "range_error_split", "ate_run_difference")
# specification of a figure from its name, caption and drawing
_NewSpec = Callable[[str, str, Callable[[float], Figure]], FigureSpec]
_MAX_RUNS_BESIDE = 2  # runs whose distributions fit beside each other
_QUANTILES = "median (bar), mean (dot), quartiles (thick), 5 to 95 % (thin)"
_STATISTICS = {
    "ate_pooled": (
        "mean_m",
        "median_m",
        "rmse_m",
        "rmse_standard_error_m",
        "p25_m",
        "p75_m",
        "p95_m",
    ),
    "ping_error": (
        "rmse_m",
        "rmse_standard_error_m",
        "median_m",
        "from_straight_rmse_m",
        "from_straight_rmse_standard_error_m",
        "from_straight_median_m",
        "bound_rmse_m",
    ),
}
_COLUMNS = ["condition", "run", "baseline", "paired", "realizations", "mean_m", "baseline_mean_m"]


def write_comparison(
    run_dirs: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> Path:
    """
    Write tables, figures and a page that compare runs.

    Parameters
    ----------
    run_dirs : sequence of str or pathlib.Path
        Folders of two or more runs.
    out : str or pathlib.Path, optional
        New or empty folder for the comparison. Default: a folder in ``runs`` with the date in its
        name.
    formats : sequence of str
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, and
        for one column of a journal as ``84mm``; tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV) and ``figures`` (PNG and
        the additional formats).

    Raises
    ------
    MantaRayError
        If there are fewer than two folders, a folder is not a run, ``out`` is not empty, or a file
        cannot be written. No files remain then.

    Examples
    --------
    Continues the example of `pymantaray.apps.study`:

    >>> from pymantaray.apps.study import run_study, write_comparison
    >>> exact = load_study("quick", realizations=2, **hours, **{"noise.range_sigma": 0.1})
    >>> write_comparison([run.path, run_study(exact, "exact", workers=1).path], "both").name
    'index.html'
    """
    if len(run_dirs) < 2:
        raise ReportError(f"{len(run_dirs)} run to compare; give the folders of two or more")
    runs = by_name([RunResults(open_run(run_dir)) for run_dir in run_dirs])
    tables = comparison_tables(runs)
    return write_page(
        out,
        "comparison",
        comparison_figure_specs(runs),
        lambda pictures, _: _page(runs, tables, pictures),
        {},
        formats,
        progress,
    )


def by_name(results: Sequence[RunResults]) -> dict[str, RunResults]:
    """Runs by a unique name: the region, otherwise the study, otherwise the folder."""
    regions = [r.region for r in results]
    folders = [r.run.path.name for r in results]
    studies = [r.run.study.name for r in results]
    numbered = [f"{study} ({i + 1})" for i, study in enumerate(studies)]
    names = next(n for n in (regions, studies, folders, numbered) if len(set(n)) == len(n))
    return dict(zip(names, results, strict=True))


def comparison_tables(runs: Mapping[str, RunResults]) -> dict[str, ResultTable]:
    """Tables with one column per run, by name in the order of the page."""

    def of_all_links(table: str) -> dict[str, pd.DataFrame]:
        return {
            name: r.tables[table].frame.query("category == @ALL_LINKS") for name, r in runs.items()
        }

    dropouts = {
        f"{name} [%]": r.tables["dropouts"].frame.set_index("category") for name, r in runs.items()
    }
    errors = of_all_links("range_error")
    parts = {
        f"{name} [m]": t.set_index("part") for name, t in of_all_links("range_error_split").items()
    }
    regions = {name: r.tables["region"].frame.set_index("property") for name, r in runs.items()}
    frames = {
        "configuration": _differences(runs),
        "range_drop_category_compare": _side_by_side(
            {name: t["percent"] for name, t in dropouts.items()}, "link category", last=ALL_LINKS
        ),
        "range_error": _side_by_side(
            {name: t.drop(columns="category").iloc[0] for name, t in errors.items()}, "quantity"
        ),
        "range_error_split": _side_by_side(
            {name: t["mean_m"] for name, t in parts.items()}, "part"
        ),
        **(_error_tables(runs) if _all_solved(runs) else {}),
        "region": _side_by_side({name: t.iloc[:, 0] for name, t in regions.items()}, "property"),
        "timing": _settings(runs, "timing"),
        "noise": _settings(runs, "noise"),
    }
    return _result_tables(frames)


def read_comparison(folder: Path) -> dict[str, ResultTable]:
    """Read the tables of a comparison, by name in the order of the page."""
    files = {name: folder / TABLES_FOLDER / f"{name}.csv" for name in _CAPTIONS}
    return _result_tables({name: read_csv(file) for name, file in files.items() if file.is_file()})


def _result_tables(frames: Mapping[str, pd.DataFrame]) -> dict[str, ResultTable]:
    return {
        name: ResultTable(
            name,
            frames[name],
            caption,
            by_row=name not in _ONE_QUANTITY,
            folded=name == "configuration" and len(frames[name]) > _MAX_DIFFERENCES,
            paper=_TABLES_OF_PAPER.get(name, ""),
        )
        for name, caption in _CAPTIONS.items()
        if name in frames
    }


def _settings(runs: Mapping[str, RunResults], table: str) -> pd.DataFrame:
    """Values of settings with unit and meaning, one column per run."""
    tables = {name: r.tables[table].frame.set_index("key") for name, r in runs.items()}
    every = pd.concat(tables.values())
    words = every[~every.index.duplicated()][["unit", "meaning"]]
    table_of_runs = _side_by_side({name: t["value"] for name, t in tables.items()}, "key")
    return table_of_runs.merge(words, left_on="key", right_index=True)


def _differences(runs: Mapping[str, RunResults]) -> pd.DataFrame:
    """
    Keys of the configuration with different values, without name and description; keys of
    ``[study]`` are last.
    """
    settings = {
        name: dict(entries(_by_names(r.run.config.model_dump(mode="json"))))
        for name, r in runs.items()
    }
    words = ("study / name", "study / description")
    keys = dict.fromkeys(key for values in settings.values() for key in values if key not in words)
    rows = [
        [key.replace(" / ", "."), *(values.get(key, _NO_KEY) for values in settings.values())]
        for key in sorted(keys, key=lambda key: key.startswith("study / "))
    ]
    return pd.DataFrame([row for row in rows if len(set(row[1:])) > 1], columns=["key", *runs])


def _by_names(content: Any) -> Any:
    """Configuration whose lists of tables, such as vehicles, are mappings by name or number."""
    if isinstance(content, dict):
        return {key: _by_names(value) for key, value in content.items()}
    if isinstance(content, list) and content and all(isinstance(item, dict) for item in content):
        return {str(item.get("name", i + 1)): _by_names(item) for i, item in enumerate(content)}
    return content


def _all_solved(runs: Mapping[str, RunResults]) -> bool:
    """True if every run has estimates."""
    return all(r.run.study.solves for r in runs.values())


def _joint_errors(runs: Mapping[str, RunResults], table: str) -> pd.DataFrame:
    pooled = pd.concat(
        {name: r.tables[table].frame.set_index("condition") for name, r in runs.items()},
        axis=1,
        sort=False,
    )
    return pd.DataFrame(
        [
            {"condition": c, "quantity": s, **{name: pooled.loc[c, (name, s)] for name in runs}}
            for c in pooled.index
            for s in _STATISTICS[table]
        ]
    )


def _error_tables(runs: Mapping[str, RunResults]) -> dict[str, pd.DataFrame]:
    """Tables of position errors of runs that have estimates."""
    joint = {name: _joint_errors(runs, name) for name in _STATISTICS}
    return joint | {"ate_run_difference": run_differences(runs)}


def _error_distributions(
    runs: Mapping[str, RunResults], header: str, spec: _NewSpec
) -> tuple[list[FigureSpec], FigureSpec]:
    """Full distributions of position errors and of range errors, one panel for each run."""
    which = in_words(list(runs))

    def ape(name: str, scale: str, *, log: bool) -> FigureSpec:
        caption = (
            f"Absolute position error by ranging condition in {which}, {scale} scale; mean solid,"
            " quartiles dashed."
        )
        panels = [ApePanel(run, results.errors, log=log) for run, results in runs.items()]
        return spec(name, caption, lambda width: pooled_ape(panels, header, width=width))

    ranges = spec(
        "range_error",
        f"Signed range error, refracted minus straight, in {which}: mean (orange), zero"
        " (dashed) and fitted normal (black).",
        lambda width: range_error_histogram(
            [(name, results.ranges.total) for name, results in runs.items()], header, width=width
        ),
    )
    position = [
        ape("ape_pooled", "logarithmic", log=True),
        ape("ape_pooled_linear", "linear", log=False),
    ]
    return position, ranges


def _error_quantiles(
    runs: Mapping[str, RunResults], header: str, spec: _NewSpec
) -> tuple[list[FigureSpec], FigureSpec]:
    """Quantiles of position errors and of range errors, one row for each run."""
    which = in_words(list(runs))
    position = spec(
        "ape_pooled",
        f"Absolute position error by ranging condition in {which}: {_QUANTILES}.",
        lambda width: quantiles_by_run(
            _position_errors(runs), header, "Absolute position error [m]", log=True, width=width
        ),
    )
    ranges = spec(
        "range_error",
        f"Signed range error, refracted minus straight, and its two parts in {which}:"
        f" {_QUANTILES}.",
        lambda width: quantiles_by_run(
            {
                label: {name: getattr(r.ranges, part) for name, r in runs.items()}
                for label, part in (
                    ("total", "total"),
                    ("reference speed", "reference_speed"),
                    ("bending", "bending"),
                )
            },
            header,
            "Range error [m]",
            log=False,
            width=width,
        ),
    )
    return [position], ranges


def comparison_figure_specs(runs: Mapping[str, RunResults]) -> list[FigureSpec]:
    """Figures of several runs: full distributions of a few runs, quantiles of more."""
    runs = dict(zip(shortened(list(runs)), runs.values(), strict=True))
    header = joint_header(runs)
    which = in_words(list(runs))
    synthetic = any(results.synthetic for results in runs.values())
    few = len(runs) <= _MAX_RUNS_BESIDE

    def spec(name: str, caption: str, draw: Callable[[float], Figure]) -> FigureSpec:
        words = with_source(caption, synthetic=synthetic)
        return FigureSpec.of_both_widths(name, words, draw, _FIGURES_OF_PAPER[name] if few else "")

    draw_errors = _error_distributions if few else _error_quantiles
    position, ranges = draw_errors(runs, header, spec)
    return [
        *(position if _all_solved(runs) else []),
        ranges,
        spec(
            "sound_speed",
            f"Sound speed against depth in {which}: mean of each level over the domain (line),"
            " least to greatest (shaded).",
            lambda _: sound_speed_profiles(_profiles(runs), header),
        ),
        *(_of_each(runs) if few else []),
    ]


def _of_each(runs: Mapping[str, RunResults]) -> list[FigureSpec]:
    """Figures that show one run, for each run."""
    specs = {
        name: {p.name: p for p in run_figure_specs(r, of_mission=True) if p.name in _OF_EACH}
        for name, r in runs.items()
    }
    parts = [
        p
        for p in run_figure_specs(next(iter(runs.values())), of_mission=True)
        if p.name == "pipeline"
    ]
    return parts + [
        replace(of_run[figure], name=f"{figure}_{i}", caption=f"{name}. {of_run[figure].caption}")
        for figure in _OF_EACH
        for i, (name, of_run) in enumerate(specs.items(), 1)
        if figure in of_run
    ]


def _position_errors(runs: Mapping[str, RunResults]) -> dict[str, dict[str, Array]]:
    """Position errors by condition and run. [m]"""
    return {
        condition_label(c): {name: r.errors.get(c, np.empty(0)) for name, r in runs.items()}
        for c in dict.fromkeys(name for r in runs.values() for name in r.errors)
    }


def _profiles(runs: Mapping[str, RunResults]) -> list[tuple[str, xr.Dataset]]:
    """Profiles of the runs; runs with equal profiles share one."""
    groups: list[tuple[list[str], xr.Dataset]] = []
    for name, r in runs.items():
        same = next((names for names, profile in groups if profile.equals(r.run.profile)), None)
        if same is None:
            groups.append(([name], r.run.profile))
        else:
            same.append(name)
    return [
        (names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more", profile)
        for names, profile in groups
    ]


def in_words(names: Sequence[str]) -> str:
    """Names of a few runs, or the number of runs."""
    if len(names) > _MAX_RUNS_BESIDE:
        return f"{len(names)} runs"
    return " and ".join([*([", ".join(names[:-1])] if len(names) > 1 else []), names[-1]])


def joint_header(runs: Mapping[str, RunResults]) -> str:
    """Header of figures with several oceans, which marks the synthetic ones."""
    synthetic = [name for name in runs if runs[name].synthetic]
    which = in_words(list(runs))
    if len(synthetic) == len(runs):
        return f"{which}, synthetic oceans"
    return f"{which}; synthetic ocean: {in_words(synthetic)}" if synthetic else which


def _side_by_side(
    columns: Mapping[str, "pd.Series[float]"], key: str, last: str = ""
) -> pd.DataFrame:
    rows = list(dict.fromkeys(row for column in columns.values() for row in column.index))
    rows.sort(key=lambda row: row == last)
    table = pd.DataFrame({name: column.reindex(rows) for name, column in columns.items()})
    table.insert(0, key, rows)
    return table.reset_index(drop=True)


def _page(
    runs: Mapping[str, RunResults], tables: Mapping[str, ResultTable], pictures: Sequence[Picture]
) -> Page:
    synthetic = [name for name, r in runs.items() if r.synthetic]
    first = [tables[name] for name in _FIRST if name in tables]
    return Page(
        title=in_words(list(runs)),
        facts=[
            f"{name}: study {r.run.study.name}, {r.received:,} of {r.attempts:,} ranges received"
            for name, r in runs.items()
        ],
        notes=[f"{', '.join(synthetic)}: {SYNTHETIC_NOTE}"] if synthetic else [],
        links={f"Run {name}": _page_of(r) for name, r in runs.items()},
        first_tables=first,
        explorer=_explorer(runs, tables["configuration"].frame),
        pictures=[p for p in pictures if not _of_one(p)],
        more_pictures={"Mission of each run": _shared(runs, pictures)}
        if len(runs) <= _MAX_RUNS_BESIDE
        else None,
        tables=[table for name, table in tables.items() if name not in _FIRST],
        citation=citation_of(list(runs.values())),
        cite="Cite these runs",
    )


def _of_one(picture: Picture) -> bool:
    """True for a figure of one run's mission."""
    return picture.name.rpartition("_")[0] in _OF_EACH or picture.name == "pipeline"


def _shared(runs: Mapping[str, RunResults], pictures: Sequence[Picture]) -> list[Picture]:
    """Figures of the runs' missions; those of runs with the same figure are one."""
    same: dict[tuple[str, bytes], list[Picture]] = {}
    for picture in filter(_of_one, pictures):
        figure = picture.name.rpartition("_")[0]  # without the number of the run
        same.setdefault((figure, picture.files["png"]), []).append(picture)
    names = shortened(list(runs))
    shared = []
    for first, *others in same.values():
        caption = first.caption
        if others:
            which = in_words([names[int(p.name.rpartition("_")[2]) - 1] for p in (first, *others)])
            caption = f"{which}. {caption.removeprefix(f'{names[0]}. ')}"
        shared.append(first._replace(caption=caption))
    return shared


def _page_of(results: RunResults) -> Path:
    """Page of a run, or its folder if it has no page."""
    page = results.run.path / PAGE
    return page if page.is_file() else page.parent


def _explorer(runs: Mapping[str, RunResults], differences: pd.DataFrame) -> Explorer | None:
    """
    Interactive plot of the position errors of all runs over the differing keys of their
    configurations, by condition.

    Keys that some runs lack are omitted. A key with a different value in every run is equivalent to
    the name of the run.
    """
    if not _all_solved(runs):
        return None
    keys = differences.set_index("key").T
    keys = keys.loc[:, (keys != _NO_KEY).all()]
    frames = [
        r.tables["ate_pooled"].frame.assign(
            run=name, **{str(key): value for key, value in keys.loc[name].items()}
        )
        for name, r in runs.items()
    ]
    groups = [key for key in keys.columns if keys[key].nunique() < len(runs)]
    return table_explorer(
        pd.concat(frames, ignore_index=True),
        list(_STATISTICS["ate_pooled"]),
        ["run", *keys.columns],
        ["condition", "run", *groups],
        labels=key_heading,
    )


_COLUMNS += ["difference_m", "t_low_m", "t_high_m"]


def run_differences(runs: Mapping[str, RunResults]) -> pd.DataFrame:
    """
    Differences of the mean position error between each two runs, by condition.

    Two runs with one seed have the same noise in each realization. Their difference is then the
    mean over the realizations that both have, with Student's interval of paired samples. The
    interval of other runs is Welch's. ``realizations`` are those of ``run`` and of ``baseline``
    that the difference uses; intervals of fewer than two are NaN.
    """
    rows = []
    for baseline, name in combinations(runs, 2):
        one = runs[name]
        other = runs[baseline]
        paired = one.run.study.seed == other.run.study.seed
        for condition in [c for c in one.errors if c in other.errors]:
            pair = pd.concat([_of_realizations(r, condition) for r in (one, other)], axis=1)
            pair = pair.dropna() if paired else pair
            a, b = (pair[column].dropna().to_numpy() for column in pair)
            counts = str(a.size) if paired else f"{a.size} and {b.size}"
            means = (float(values.mean()) if values.size else np.nan for values in (a, b))
            keys = (condition, name, baseline, "yes" if paired else "no", counts)
            rows.append((*keys, *means, *_interval(a, b, paired=paired)))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _of_realizations(results: RunResults, condition: str) -> "pd.Series[float]":
    """Mean position error of each realization; NaN if its solve failed. [m]"""
    mean = results.errors[condition].mean(axis=(1, 2))
    return pd.Series(mean, index=results.run.estimates.realization)


def _interval(a: Array, b: Array, *, paired: bool) -> tuple[float, float, float]:
    """Difference of two means, and its 95 % confidence interval."""
    from scipy.stats import ttest_ind

    if not a.size or not b.size:
        return np.nan, np.nan, np.nan
    difference = float(a.mean() - b.mean())
    if paired:
        return difference, *paired_interval(a - b)
    if min(a.size, b.size) < 2:
        return difference, np.nan, np.nan
    low, high = ttest_ind(a, b, equal_var=False).confidence_interval()
    return difference, float(low), float(high)
