"""Commands of `mantaray study`; they import modules when they run, which keeps the help fast."""

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import (
    OUTPUT,
    ArrivalOptions,
    Commands,
    Formats,
    Json,
    OceanOptions,
    Quiet,
    RunGroup,
    Set,
    TableOptions,
    To,
    WaterOptions,
    changes_of,
    format_names,
)
from pymantaray.cli.output import (
    EXIT_UNUSABLE,
    STARTED,
    duration,
    progress_bars,
    resumable,
    write_new,
)
from pymantaray.cli.printing import LOG, Printer, printer
from pymantaray.pages.folder import PAGE

if TYPE_CHECKING:
    import pandas as pd

    from pymantaray.apps.study import Run
    from pymantaray.config import StudyConfig

app = Commands(cls=RunGroup, help="Run, show and compare studies.")

_WIDE_DB = 60.0  # cut-off that includes rays far into shadows
_MAX_NAMED_RUNS = 2  # runs whose names fit above the columns of a table

Out = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Folder for the results; must be new or empty.",
        rich_help_panel=OUTPUT,
    ),
]
Open = Annotated[
    bool, typer.Option("--open", help="Open the page in the browser.", rich_help_panel=OUTPUT)
]


def _presets(incomplete: str) -> list[str]:
    """
    Return the presets that begin with a text, for shell completion; without any, shells complete
    files.
    """
    from pymantaray.config.load import preset_names

    return [name for name in preset_names() if name.startswith(incomplete)]


RunFolder = Annotated[
    Path,
    typer.Argument(callback=existing("folder"), metavar="RUN", help="Folder of a run."),
]
Name = Annotated[str, typer.Argument(metavar="NAME", help="A preset.", autocompletion=_presets)]
NameOrFile = Annotated[
    str,
    typer.Argument(metavar="NAME|FILE", help="A preset, or a TOML file.", autocompletion=_presets),
]


@app.command("list")
def list_command(as_json: Json = False) -> None:
    """List the presets."""
    from pymantaray.config import list_presets

    presets = list_presets()
    width = max(map(len, presets))
    with printer(as_json=as_json) as out:
        for name, description in presets.items():
            out.line(f"{name:<{width}} {description}")
        out.add(presets=[{"name": name, "description": text} for name, text in presets.items()])


@app.command()
def show(study: NameOrFile, changes: Set = None, as_json: Json = False) -> None:
    """
    Print all keys of a preset or a file with their descriptions; keys at their defaults are
    commented out.
    """
    from pymantaray.config import load_study
    from pymantaray.config.door.fleet import with_tracks
    from pymantaray.config.text import commented_toml

    config = with_tracks(load_study(study, **changes_of(changes)))
    with printer(as_json=as_json) as out:
        out.line(commented_toml(config).removesuffix("\n"), **config.model_dump(mode="json"))


@app.command()
def init(
    name: Name = "quick",
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write.")] = Path(
        "study.toml"
    ),
    changes: Set = None,
) -> None:
    """Write a preset with all its keys to a file for editing."""
    from pymantaray.config import starter_text

    write_new(file, starter_text(name, **changes_of(changes)))
    typer.echo(f"{file}: written from preset {name}; edit it, then: mantaray study run {file}")


@app.command()
def cite(
    study: NameOrFile,
    bibtex: Annotated[bool, typer.Option("--bibtex", help="As BibTeX.")] = False,
    changes: Set = None,
) -> None:
    """List the publications that a study relies on."""
    from pymantaray.apps.study import citation
    from pymantaray.config import load_study

    references = citation(load_study(study, **changes_of(changes)))
    typer.echo(references.bibtex if bibtex else references, nl=not bibtex)


@dataclass(frozen=True)
class RunOptions:
    """Folder, realizations and figures of a run."""

    out: Out = None
    realizations: Annotated[int | None, typer.Option(help="Number of noise realizations.")] = None
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes that solve realizations.")
    ] = None
    no_figures: Annotated[
        bool,
        typer.Option(
            "--no-figures",
            help="Data only: no tables and figures.",
            rich_help_panel=OUTPUT,
        ),
    ] = False
    formats: Formats = ""
    open_page: Open = False

    def __post_init__(self) -> None:
        if self.open_page and self.no_figures:
            raise typer.BadParameter(
                "--no-figures writes no page to open; remove one of the two options",
                param_hint="--open",
            )


@app.command()
@with_options
def run(
    study: NameOrFile,
    source: OceanOptions,
    water: WaterOptions,
    arrivals: ArrivalOptions,
    how: RunOptions,
    printing: TableOptions,
    changes: Set = None,
) -> None:
    """Run a study, and write data, tables and figures to one folder."""
    from pymantaray.config import load_study
    from pymantaray.config.load import dotted_keys

    keys = dotted_keys(water.keys | arrivals.keys) | changes_of(changes)
    config = load_study(study, realizations=how.realizations, ocean=source.words or None, **keys)
    with printing.printer() as printed:
        folder = run_and_report(
            config,
            how.out,
            printed,
            workers=how.workers,
            figures=not how.no_figures,
            formats=how.formats,
            quiet=printing.quiet,
        )
    if how.open_page:
        _open(folder / PAGE)


def _how_to_resume(out: Path | None) -> str:
    """Words about the parts of an interrupted run that are saved."""
    if out is None:
        return "nothing is saved; a run with --out NAME resumes with the same command"
    saved = out.with_name(f"{out.name}.unfinished")
    if saved.is_dir():
        return f"the same command resumes from {saved}"
    return "nothing is saved in the first half minute; the same command starts again"


def run_and_report(
    config: "StudyConfig",
    out: Path | None,
    printed: Printer,
    *,
    workers: int | None,
    figures: bool = True,
    formats: str,
    quiet: bool,
) -> Path:
    """
    Run a study, make its report, print a summary, and return the folder.

    If other processes solve its realizations, this one begins the report meanwhile.

    The exit status is 1 if a figure of another package fails.
    """
    from pymantaray.apps.study import run_study
    from pymantaray.apps.study.report import StudyReport

    report = StudyReport(formats=format_names(formats)) if figures else None
    # stages of a study, in order
    solving = ["realizations"] if config.solves else []
    drawing = ["report"] if figures else []
    with progress_bars(
        quiet=quiet, stages=["ocean", "fleet", "rays", *solving, "files", *drawing]
    ) as progress:
        with resumable(lambda: _how_to_resume(out)):
            results = run_study(
                config,
                out,
                workers=workers,
                progress=progress,
                mission_ready=None if report is None else report.begin,
            )
        complete = perf_counter()
        failures: list[str] = []
        if report is not None:
            try:
                failures = report.write(results, progress)
            except BaseException:
                typer.echo(
                    "the data are complete; write their report with: mantaray study report"
                    f" {results.path}",
                    err=True,
                )
                raise
    _print_summary(printed, results)
    what = "report" if figures else "tables"
    _print_cost(printed, results, what, perf_counter() - complete)
    if figures:
        printed.line(f"page: {results.path / PAGE}", page=results.path / PAGE)
    printed.paths(folder=results.path)
    _end_with(failures)
    return results.path


def _end_with(failures: list[str]) -> None:
    """Log the figures that are missing in a report; with any, the exit status is 1."""
    for line in failures:
        LOG.error(line)
    if failures:
        raise typer.Exit(EXIT_UNUSABLE)


@app.command()
def report(
    folder: RunFolder,
    formats: Formats = "",
    open_page: Open = False,
    quiet: Quiet = False,
) -> None:
    """Regenerate tables, figures and page of a run, or complete those of an interrupted run."""
    from pymantaray.apps.study.report import report_of

    with progress_bars(quiet=quiet) as progress:
        page, failures = report_of(folder, formats=format_names(formats), progress=progress)
    typer.echo(str(page))
    if open_page:
        _open(page)
    _end_with(failures)


@app.command()
def tables(
    folder: RunFolder,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Tables, such as ate_pooled. Default: a summary.",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
    to: To = "text",
) -> None:
    """Print tables of a run, with the numbers of its report."""
    from pymantaray.apps.study import open_run
    from pymantaray.errors import StudyError

    run = open_run(folder)
    for name in names or ():
        if name not in run.tables:
            raise StudyError(f"{folder}: no table {name!r}; allowed: {', '.join(run.tables)}")
    with printer(as_json=as_json, to=to) as printed:
        for table in [run.tables[name] for name in names] if names else run.summary:
            printed.table(table)


@app.command()
def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            callback=existing("folder"), metavar="RUN", help="Folders of at least two runs."
        ),
    ],
    out: Out = None,
    formats: Formats = "",
    open_page: Open = False,
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """
    Compare runs: differences of their configurations, tables, figures and a page in one folder.
    """
    from pymantaray.apps.study import write_comparison

    with progress_bars(quiet=quiet) as progress:
        page = write_comparison(runs, out, formats=format_names(formats), progress=progress)
    with printer(as_json=as_json, quiet=quiet, to=to) as printed:
        text = to == "text" and not as_json
        _print_comparison(printed, page.parent, numbered=text and len(runs) > _MAX_NAMED_RUNS)
        printed.paths(page=page)
    if open_page:
        _open(page)


def _open(page: Path) -> None:
    """Open a page in the browser; log a warning without a browser."""
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        LOG.warning("no browser to open %s", page)


def _print_cost(out: Printer, run: "Run", last: str, took: float) -> None:
    """
    Print the time that the user waited, that of each stage and of the last one after the run, and
    the peak memory.
    """
    stages = run.manifest["seconds"]
    stages = {**stages, last: round(stages.get(last, 0.0) + took, 3)}
    total = round(perf_counter() - STARTED, 3)
    seconds = {"start": round(total - sum(stages.values()), 3), **stages}
    memory = run.manifest["peak_memory_mib"]
    parts = ", ".join(f"{stage} {duration(value)}" for stage, value in seconds.items())
    workers = run.manifest["machine"]["workers"]
    each = (
        f", {memory['largest_worker']:.0f} MiB in each of {workers} workers" if workers > 1 else ""
    )
    out.line(
        f"took {duration(total)} ({parts}) and at most {memory['main']:.0f} MiB of memory{each}",
        seconds=seconds,
        peak_memory_mib=memory,
    )


def _print_summary(out: Printer, run: "Run") -> None:
    """
    Print dropouts, range errors and trajectory errors, and warn of failed solves and stopped
    vehicles.
    """
    from pymantaray.records.digits import counted

    study = run.study
    hours = study.duration / 3600.0
    vehicles = int(run.truth.name.size)
    fleet = counted(vehicles, "vehicle")
    count = f", {counted(study.realizations, 'realization')}"
    water = "synthetic ocean" if run.synthetic else "ocean from files"
    out.line(
        f"\n{study.name}: {hours:g} h, {fleet}{count if study.solves else ''}, {water}",
        study=study.name,
        duration_h=hours,
        vehicles=vehicles,
        realizations=study.realizations if run.study.solves else 0,
        synthetic_ocean=run.synthetic,
    )
    for table in run.summary:
        out.table(table)
        if table.name == "dropouts":
            _print_causes(out, table.frame, study.sound.options.spreading_cutoff_db)
    apart = {name: max(values) for name, values in run.manifest.get("from_batch_m", {}).items()}
    for name, distance in apart.items():
        out.line(
            f"{name}: GTSAM's positions differ from those of the batch solver by at most"
            f" {distance:.2g} m"
        )
    out.add(from_batch_m=apart)
    out.notes(run.notes)
    out.warn(_warnings(run))


def _print_causes(out: Printer, dropouts: "pd.DataFrame", cutoff_db: float | None) -> None:
    """Print the causes of lost ranges, most frequent first, and a remedy for weak ones."""
    from pymantaray.evaluation import ALL_LINKS
    from pymantaray.records.status import ARRIVES, RAY_STATUS_WORDS, RayStatus

    lost = dropouts[dropouts["category"] == ALL_LINKS].to_dict("records")[0]
    counts = {
        words.label: lost[status.name.lower()]
        for status, words in RAY_STATUS_WORDS.items()
        if status not in ARRIVES and lost[status.name.lower()]
    }
    if counts:
        causes = sorted(counts, key=lambda word: -counts[word])
        listed = ", ".join(f"{counts[word]} {word}" for word in causes)
        out.line(f"{lost['dropouts']} of {lost['attempts']} lost: {listed}")
    weak = lost[RayStatus.WEAK.name.lower()]
    if weak and cutoff_db is not None and cutoff_db < _WIDE_DB:
        out.line(
            f"{100.0 * weak / lost['attempts']:.2g} % too weak: spreading loss more than"
            f" {cutoff_db:g} dB above spherical; `--cutoff-db {_WIDE_DB:g}` includes all within"
            f" {_WIDE_DB:g} dB"
        )


def _print_comparison(out: Printer, folder: Path, *, numbered: bool) -> None:
    """Print the tables of a comparison, with numbers instead of names of runs above columns."""
    from pymantaray.apps.study.comparison_page import SUMMARY, read_comparison

    tables = read_comparison(folder)
    names = tables["configuration"].frame.columns[1:]
    out.add(runs=names)
    numbers = {name: str(k + 1) for k, name in enumerate(names) if numbered}
    for name, number in numbers.items():
        out.line(f"{number}: {name}")
    for name in SUMMARY:
        if name == "configuration" and tables[name].frame.empty:
            out.line("The configurations have the same values.\n")
        elif name in tables:  # runs of ranges alone have no position errors
            out.table(replace(tables[name], frame=tables[name].frame.rename(columns=numbers)))


def _warnings(run: "Run") -> list[str]:
    """
    Warnings about failed solves, stopped vehicles and incomplete searches.
    """
    from pymantaray.records.status import SOLVE_STATUS_WORDS, SolveStatus

    outcome = run.manifest["outcome"]
    lines = [
        f"vehicle {name} stopped after {stop['time_s'] / 3600.0:.1f} h: {stop['status']}"
        for name, stop in outcome["stopped_vehicles"].items()
    ]
    lines += run.arrivals.incomplete_note()
    by_kind: dict[tuple[str, str], list[int]] = {}
    for solve in outcome["unhealthy_solves"]:
        by_kind.setdefault((solve["condition"], solve["status"]), []).append(solve["realization"])
    for (condition, status), which in by_kind.items():
        count = f"{len(which)} of {run.study.realizations} solves"
        listed = ", ".join(map(str, which))
        words = SOLVE_STATUS_WORDS.get(SolveStatus[status])
        meaning = "" if words is None else f" ({words.meaning}; {words.advice})"
        lines.append(f"condition {condition}: {count} {status}, realizations {listed}{meaning}")
    return lines


COMMANDS = {"study": app}
