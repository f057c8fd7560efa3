"""Command `mantaray export`: a run for other programs."""

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    to: Annotated[
        str, typer.Option("--to", help="tum, kitti, cf, csv, parquet, g2o, pyfg, rrd, mcap or bag.")
    ],
    out: Annotated[
        Path, typer.Option("--out", help="A new or empty folder; for rrd and mcap a file that is not there.")
    ],
    realization: Annotated[int, typer.Option("--realization", help="Which one, from 0.")] = 0,
) -> None:
    """Write a realization of a run for evo, pandas, g2o, PyFactorGraph, Rerun, Foxglove or ROS 2."""
    from pymantaray.study import export_run

    typer.echo(str(export_run(run, to, out, realization=realization)))
