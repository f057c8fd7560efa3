"""
Command `mantaray export`: export a run to formats of other programs, or a study to the paper's
authors' program.
"""

from pathlib import Path
from typing import Annotated, Any

import typer

from pymantaray.cli.panels import OUTPUT
from pymantaray.cli.printing import printer
from pymantaray.errors import StudyError
from pymantaray.user_files import check_there

SHOWS_RESULTS = True

AUTHORS = "authors"
_UsageError: Any = typer.BadParameter.__base__  # typer does not export this class


def export(
    context: typer.Context,
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="Folder of a run; for kml and geojson also an atlas, or a folder of mantaray"
            " locate; or the word authors.",
        ),
    ],
    study: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="STUDY FOLDER",
            help="After authors: a run, preset or study file, and a new or empty folder for"
            " sim.json, environment.json and its arrays, which the paper's authors' program reads.",
            show_default=False,
        ),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="Format: tum, kitti, cf, csv, parquet, g2o, pyfg, rrd, mcap, bag, vtk, kml,"
            " geojson or mat.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="A new or empty folder; for rrd, mcap, kml, geojson and mat a new file.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    realization: Annotated[
        int, typer.Option("--realization", help="Index of the realization, from 0.")
    ] = 0,
) -> None:
    """
    Export one realization of a run to evo, pandas, g2o, PyFactorGraph, Rerun, Foxglove, ROS 2,
    ParaView, MATLAB or a map, or a study to its authors' program.
    """
    words = study or []
    if str(run) == AUTHORS and words:
        if len(words) != 2 or to is not None or out is not None:
            raise _UsageError("Usage: mantaray export authors STUDY FOLDER", context)
        from pymantaray.apps.export import export_authors

        folder, lines = export_authors(words[0], words[1])
        with printer() as printed:
            printed.notes(f"{words[0]}: {line}" for line in lines)
            printed.paths(folder)
        return
    if words:
        raise _UsageError(f"Got unexpected extra argument ({words[0]})", context)
    if to is None or out is None:
        raise _UsageError(f"Missing option '--{'to' if to is None else 'out'}'.", context)
    check_there(run, StudyError, "file or folder")
    from pymantaray.apps.export import export_run

    typer.echo(str(export_run(run, to, out, realization=realization)))


COMMANDS = {"export": export}
