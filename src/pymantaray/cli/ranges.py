"""Command `mantaray ranges`: arrivals, ranges, dropouts and range errors of existing trajectories."""

from pathlib import Path
from typing import Annotated, Any

import typer

from pymantaray.cli.options import (
    ArrivalOptions,
    Formats,
    Json,
    OceanOptions,
    Quiet,
    Set,
    To,
    WaterOptions,
    changes_of,
    parse_duration,
    with_options,
)
from pymantaray.cli.printing import printer
from pymantaray.errors import SensingError


@with_options
def ranges(
    trajectories: Annotated[
        list[str],
        typer.Argument(
            metavar="TRAJECTORIES...",
            help="Tables (CSV, Parquet), TUM files, CF trajectories (NetCDF) or ROS bags; see the how-to.",
            show_default=False,
        ),
    ],
    source: OceanOptions,
    water: WaterOptions,
    arrivals: ArrivalOptions,
    out: Annotated[Path, typer.Option("--out", help="New or empty folder for the results.")],
    interval: Annotated[
        str | None,
        typer.Option(
            "--interval",
            metavar="DURATION",
            help="Interval of pings of all vehicles: seconds, or text such as '5 min'.",
        ),
    ] = None,
    slots: Annotated[
        str | None,
        typer.Option("--slots", metavar="A,B,...", help="Vehicles that ping in turn (TDMA). Needs --slot."),
    ] = None,
    slot: Annotated[
        str | None,
        typer.Option(
            "--slot", metavar="DURATION", help="Length of a slot, as for --interval. Needs --slots."
        ),
    ] = None,
    pings: Annotated[
        Path | None,
        typer.Option(
            "--pings",
            metavar="CSV",
            help="Table of pings: columns time, transmitter and optional receivers.",
        ),
    ] = None,
    sampling: Annotated[
        str,
        typer.Option(
            "--sampling",
            metavar="DURATION",
            help="Time between poses, as for --interval, in addition to poses at pings.",
        ),
    ] = "200 s",
    enu: Annotated[
        bool,
        typer.Option(
            "--enu", help="TUM files use ROS's axes: world east, north, up; body forward, left, up."
        ),
    ] = False,
    changes: Set = None,
    formats: Formats = "",
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """Compute ranges between existing trajectories through an ocean: data, tables, figures and a page in one folder."""
    from pymantaray.cli.study import run_and_report
    from pymantaray.exchange.read import files_of
    from pymantaray.study.ranges import ranges_config

    files = files_of(trajectories)
    if not source.words:
        raise SensingError("no ocean; give --ocean or --profile")
    config = ranges_config(
        files,
        source.words,
        mission={
            "sampling_period_s": parse_duration("--sampling", sampling),
            **_schedule(interval, slots, slot, pings),
        },
        enu=enu,
        **water.keys,
        **arrivals.keys,
    ).with_(**changes_of(changes))
    with printer(as_json=as_json, quiet=quiet, to=to) as printed:
        run_and_report(config, out, printed, workers=1, figures=True, formats=formats, quiet=quiet)


def _schedule(
    interval: str | None, slots: str | None, slot: str | None, pings: Path | None
) -> dict[str, Any]:
    """Keys of a study's mission for the schedule of pings, from one of the options."""
    if [interval, slots, pings].count(None) != 2:
        raise SensingError(
            "schedule of pings: give exactly one of --interval, --slots with --slot, or --pings"
        )
    if (slots is None) != (slot is None):
        raise SensingError("--slots and --slot must be used together; give both")
    if interval is not None:
        return {"ping_interval_h": parse_duration("--interval", interval) / 3600.0}
    if slots is not None and slot is not None:
        names = [name.strip() for name in slots.split(",")]
        return {"schedule": {"kind": "slots", "slots": names, "slot_s": parse_duration("--slot", slot)}}
    return {"schedule": {"kind": "pings", "file": str(pings)}}
