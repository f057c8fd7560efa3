"""Command `mantaray export`: export a run to formats of other programs."""

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    to: Annotated[
        str, typer.Option("--to", help="Format: tum, kitti, cf, csv, parquet, g2o, pyfg, rrd, mcap or bag.")
    ],
    out: Annotated[Path, typer.Option("--out", help="A new or empty folder; for rrd and mcap a new file.")],
    realization: Annotated[int, typer.Option("--realization", help="Index of the realization, from 0.")] = 0,
) -> None:
    """Export one realization of a run to evo, pandas, g2o, PyFactorGraph, Rerun, Foxglove or ROS 2."""
    from pymantaray.study import export_run

    typer.echo(str(export_run(run, to, out, realization=realization)))
