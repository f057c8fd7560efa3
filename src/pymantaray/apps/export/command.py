"""Command `mantaray export`: export a run to formats of other programs."""

from pathlib import Path
from typing import Annotated

import typer

from pymantaray.cli.options import OUTPUT
from pymantaray.errors import StudyError
from pymantaray.user_files import check_there


def export(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="Folder of a run; for kml and geojson also an atlas, or a folder of mantaray"
            " locate.",
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="Format: tum, kitti, cf, csv, parquet, g2o, pyfg, rrd, mcap, bag, vtk, kml,"
            " geojson or mat.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="A new or empty folder; for rrd, mcap, kml, geojson and mat a new file.",
            rich_help_panel=OUTPUT,
        ),
    ],
    realization: Annotated[
        int, typer.Option("--realization", help="Index of the realization, from 0.")
    ] = 0,
) -> None:
    """
    Export one realization of a run to evo, pandas, g2o, PyFactorGraph, Rerun, Foxglove, ROS 2,
    ParaView, MATLAB or a map.
    """
    check_there(run, StudyError, "file or folder")
    from pymantaray.apps.export import export_run

    typer.echo(str(export_run(run, to, out, realization=realization)))


COMMANDS = {"export": export}
