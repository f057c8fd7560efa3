"""Command `mantaray replay`: compare measured with predicted travel times."""

import math
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.apps.replay.options import PredictionOptions
from pymantaray.apps.replay.rules import DEFAULT_RULE
from pymantaray.cli.groups import Fields, existing, quantity, with_options
from pymantaray.cli.options import (
    ArrivalOptions,
    FolderOptions,
    Set,
    SourceOptions,
    TableOptions,
    WaterOptions,
    changes_of,
    format_names,
    parse_duration,
)
from pymantaray.cli.output import EXIT_UNUSABLE
from pymantaray.cli.printing import LOG, Printer, in_options

if TYPE_CHECKING:
    import pandas as pd

    from pymantaray.apps.replay import Replay
    from pymantaray.apps.replay.events import Events
    from pymantaray.sensing.water import Water

_MAX_NODES = 12


@dataclass(frozen=True)
class ComparisonOptions:
    """Detection, clocks and nodes of a comparison."""

    rule: Annotated[
        str,
        typer.Option(
            metavar="RULE",
            help="Rule of detection: first, strongest, within:DB, threshold or persist:MINUTES"
            " (the arrival of the previous reception).",
        ),
    ] = DEFAULT_RULE
    detection: Annotated[
        Path | None,
        typer.Option(
            callback=existing(),
            metavar="FILE.toml",
            help="TOML file with a study's section detection, for levels, and losses in its"
            " section acoustics.",
        ),
    ] = None
    window: Annotated[
        str,
        typer.Option(
            metavar="DURATION",
            help="Maximum time between paired events (both directions, and successive ones).",
        ),
    ] = "60 s"
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="NODE", help="Node with the reference clock. Default: the mean of all clocks."
        ),
    ] = None
    nodes: Annotated[
        Path | None,
        typer.Option(
            callback=existing(),
            metavar="CSV",
            help="Table of fixed nodes, such as tables/nodes.csv of mantaray locate.",
        ),
    ] = None
    smooth_positions: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Smooth the horizontal positions of all nodes as random walks with drift; give the"
            " error of a measured position.",
        ),
    ] = None
    clock_drift: Annotated[
        bool,
        typer.Option("--clock-drift", help="Fit a constant rate of each clock besides its offset."),
    ] = False


@with_options
def replay(
    events: Annotated[
        Path,
        typer.Argument(
            callback=existing(),
            metavar="EVENTS.csv",
            help="Columns time, source, receiver, source_lat, source_lon, source_depth (or _north,"
            " _east in metres), the same for the receiver, travel_time in seconds; optional sigma,"
            " cast and level_db.",
            show_default=False,
        ),
    ],
    source: SourceOptions,
    water: WaterOptions,
    search: ArrivalOptions,
    comparing: ComparisonOptions,
    prediction: Annotated[
        PredictionOptions,
        Fields(
            "draws",
            "position_sigma",
            "sound_speed_sigma",
            wind_speed="--wind",
            learn="--learn[=causal]",
        ),
    ],
    folder: FolderOptions,
    printing: TableOptions,
    *,
    changes: Set = None,
) -> None:
    """Compare measured with predicted one-way travel times."""
    from pymantaray.apps.replay import read_events, replay_events, smooth_positions, write_replay
    from pymantaray.apps.replay.compare import checked_rule
    from pymantaray.cli.output import progress_bars
    from pymantaray.cli.water import search_record, water_notes
    from pymantaray.config.load import sound_sections
    from pymantaray.version import __version__

    # events, rule and waters
    window_s = parse_duration("--window", comparing.window, positive=False)
    event_data = read_events(events, comparing.nodes)
    rule = checked_rule(event_data, comparing.rule, prediction, window_s, comparing.reference)
    positions = None
    if comparing.smooth_positions is not None:
        event_data, positions = smooth_positions(event_data, comparing.smooth_positions)
    sections = {} if comparing.detection is None else sound_sections(comparing.detection)
    waters, earth = _waters_on_earth(
        event_data, source, water, search, sections=sections, changes=changes_of(changes)
    )
    sources = [one.record | ({"cast": one.name} if one.uniform else {}) for one in waters]
    notes = [
        *event_data.notes,
        *dict.fromkeys(note for water_of in waters for note in water_notes(water_of)),
        *earth,
    ]
    # predict the events and write the folder
    with progress_bars(quiet=printing.quiet) as report:
        result = replay_events(
            event_data,
            waters,
            rule,
            options=prediction,
            window=window_s,
            reference=comparing.reference,
            progress=None if report is None else partial(report, "events"),
        )
        result = replace(
            result,
            notes=(*notes, *result.notes),
            clock_drift=comparing.clock_drift,
            positions=positions,
        )
        record: dict[str, Any] = {"mantaray": __version__, "events": str(events), "water": sources}
        record |= {
            "search": search_record(waters[0]),
            "prediction": asdict(prediction),
            "detection": None if comparing.detection is None else str(comparing.detection),
            "smooth_positions_m": comparing.smooth_positions,
            "clock_drift": comparing.clock_drift,
        }
        page = write_replay(
            result,
            folder.out,
            made_by=record,
            messages=in_options,
            formats=format_names(folder.formats),
            progress=report,
        )
    with printing.printer() as printer:
        _print_result(printer, result, page)
        _exit_if_unexplained(events, result)


def _waters_on_earth(
    events: "Events",
    source: SourceOptions,
    options: WaterOptions,
    search: ArrivalOptions,
    **keys: Any,
) -> "tuple[list[Water], list[str]]":
    """
    Waters of the options, by default on a sphere if positions are geographic, and a note.

    Their depths are below the sea surface.
    """
    import numpy as np

    from pymantaray.cli.water import load_waters

    if not events.geographic or options.earth == "flat":
        return load_waters(source, options, search, **keys), []
    latitude = float(np.median(events.source_position[:, 0]))
    waters = load_waters(source, replace(options, earth=None), search, **keys)
    on_sphere = [water.on_sphere(latitude) for water in waters]
    return on_sphere, ["Earth: sphere, because positions are geographic"]


def _print_result(out: Printer, result: "Replay", page: Path) -> None:
    out.notes(result.notes)
    for finding in result.findings:
        out.line(finding)
    # status of the events
    counts = result.events["status"].value_counts()
    out.line(
        f"{len(result.events)} events: " + ", ".join(f"{n} {word}" for word, n in counts.items()),
        findings=list(result.findings),
        unexplained=result.unexplained,
        rule=str(result.rule),
        statuses=dict(counts.items()),
        clocks=result.clocks,
        switching=result.switching,
    )
    # tables, and the standard error due to the draws
    out.table(result.brief_summary)
    tables = result.tables
    learned = ("horizons", "error_sizes") if "error_sizes" in tables else ()
    for name in ("coverage", *learned):
        if name in tables:
            out.table(tables[name])
    if "draws" in result.more:
        draws = result.more["draws"]
        out.line(f"median without learning: {_median_words(draws.iloc[0])}", draws=draws)
    # clocks, unless there are many
    clocks = result.clocks.dropna(subset=["offset_s", "standard_error_s"])
    values = clocks[["node", "offset_s", "standard_error_s"]].to_numpy()
    offsets = [f"{node} {1e3 * offset:+.3f} ± {1e3 * error:.3f}" for node, offset, error in values]
    if 0 < len(offsets) <= _MAX_NODES:
        out.line(f"clocks [ms]: {', '.join(offsets)}")
    # changes between candidates
    switching = result.switching.iloc[0]
    if switching["steps"]:
        out.line(
            f"candidates change in {switching['rate']:.3f} of {switching['steps']} steps of"
            f" {switching['step_s']:.0f} s, {switching['independent_rate']:.3f} if independent:"
            f" correlation time {switching['correlation_s']:.0f} s"
        )
    out.paths(page=page)


def _median_words(draws: "pd.Series[float]") -> str:
    """Median of the residuals with its standard error due to the draws."""
    median, error = draws["median_size_m"], draws["median_error_m"]
    if not math.isfinite(error):
        return "infinite with some draws, because half of the events or more have no prediction"
    return (
        f"{median:.3f} ± {error:.3f} m (standard error due to {draws['draws']:.0f} draws,"
        f" {100.0 * error / median:.0f} %)"
    )


def _exit_if_unexplained(events: Path, result: "Replay") -> None:
    """End with the status of an unusable result if the predictions explain nothing."""
    if result.unexplained is not None:
        LOG.error("%s: not explained: %s", events, result.unexplained)
        raise typer.Exit(EXIT_UNUSABLE)


COMMANDS = {"replay": replay}
