"""
Command `mantaray ranges`: arrivals, ranges, dropouts and range errors of existing trajectories.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import (
    ArrivalOptions,
    FolderOptions,
    OceanOptions,
    Set,
    TableOptions,
    WaterOptions,
    changes_of,
    parse_duration,
)
from pymantaray.errors import SensingError


@dataclass(frozen=True)
class MissionOptions:
    """Schedule of pings, from exactly one source, and sampling and axes of the trajectories."""

    interval: Annotated[
        str | None,
        typer.Option(
            metavar="DURATION",
            help="Interval of pings of all vehicles.",
        ),
    ] = None
    slots: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...", help="Vehicles that ping in turn (TDMA), as A,B,C. Needs --slot."
        ),
    ] = None
    slot: Annotated[
        str | None,
        typer.Option(metavar="DURATION", help="Length of a slot. Needs --slots."),
    ] = None
    pings: Annotated[
        Path | None,
        typer.Option(
            callback=existing(),
            metavar="CSV",
            help="Table of pings: columns time, transmitter and optional receivers.",
        ),
    ] = None
    sampling: Annotated[
        str,
        typer.Option(
            metavar="DURATION",
            help="Time between poses, in addition to poses at pings.",
        ),
    ] = "200 s"
    enu: Annotated[
        bool,
        typer.Option(
            "--enu",
            help="TUM, EuRoC and KITTI files use ROS's axes: world east, north, up; body forward,"
            " left, up.",
        ),
    ] = False
    vehicles: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Vehicles of the files to use. Default: all."),
    ] = None

    @property
    def keys(self) -> dict[str, Any]:
        """Keys of a study's mission."""
        keys: dict[str, Any] = {"sampling_period_s": parse_duration("--sampling", self.sampling)}
        if [self.interval, self.slots, self.pings].count(None) != 2:
            raise SensingError(
                "schedule of pings: give exactly one of --interval, --slots with --slot, or --pings"
            )
        if (self.slots is None) != (self.slot is None):
            raise SensingError("--slots and --slot must be used together; give both")
        if self.interval is not None:
            return keys | {"ping_interval_h": parse_duration("--interval", self.interval) / 3600.0}
        if self.slots is not None and self.slot is not None:
            names = [name.strip() for name in self.slots.split(",")]
            slot = parse_duration("--slot", self.slot)
            return keys | {"schedule": {"kind": "slots", "slots": names, "slot_s": slot}}
        return keys | {"schedule": {"kind": "pings", "file": str(self.pings)}}


@with_options
def ranges(
    trajectories: Annotated[
        list[str],
        typer.Argument(
            callback=existing(),
            metavar="TRAJECTORIES",
            help="Tables (CSV, Parquet), TUM files, CF trajectories (NetCDF), ROS bags, GPX, or"
            " NMEA logs; see the how-to.",
            show_default=False,
        ),
    ],
    source: OceanOptions,
    water: WaterOptions,
    arrivals: ArrivalOptions,
    mission: MissionOptions,
    folder: FolderOptions,
    printing: TableOptions,
    changes: Set = None,
) -> None:
    """
    Compute ranges between existing trajectories through an ocean: data, tables, figures and a page
    in one folder.
    """
    from pymantaray.apps.ranges.ranging import ranges_config
    from pymantaray.apps.study.command import run_and_report
    from pymantaray.config.door.fleet import track_files
    from pymantaray.exchange.read import files_of

    files = files_of(trajectories)
    if not source.words:
        raise SensingError("no ocean; give --ocean or --profile")
    config = ranges_config(
        files,
        source.words,
        mission=mission.keys,
        enu=mission.enu,
        vehicles=[name.strip() for name in (mission.vehicles or "").split(",") if name.strip()],
        **water.keys,
        **arrivals.keys,
    ).with_(**changes_of(changes))
    existing = track_files(config.fleet)
    with printing.printer() as printed:
        printed.notes([] if existing is None else existing.tracks.notes)
        run_and_report(
            config, folder.out, printed, workers=1, formats=folder.formats, quiet=printing.quiet
        )


COMMANDS = {"ranges": ranges}
