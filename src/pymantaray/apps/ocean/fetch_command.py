"""Commands of `mantaray ocean fetch`: download HYCOM and GLORYS12 by place and time."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.cli.groups import Fields, quantities, with_options
from pymantaray.cli.options import OUTPUT, Commands, Force, Quiet
from pymantaray.cli.printing import LOG
from pymantaray.ocean.fetch.limits import FetchLimits

if TYPE_CHECKING:
    from pymantaray.ocean.fetch import FetchResult

app = Commands(help="Download an ocean by place and time.")


@dataclass(frozen=True, kw_only=True)
class WindowOptions:
    """Window and instant of a download, its servers and its file."""

    lat: Annotated[
        Any,
        typer.Option(
            parser=quantities("deg", 2),
            metavar="SOUTH,NORTH",
            help="Two latitudes in degrees, separated by a comma.",
        ),
    ]
    lon: Annotated[
        Any,
        typer.Option(
            parser=quantities("deg", 2),
            metavar="WEST,EAST",
            help="Longitudes in any convention; 170,-170 crosses the antimeridian.",
        ),
    ]
    time: Annotated[str, typer.Option(metavar="TIME", help="Instant (UTC), such as 2014-07-15T12.")]
    out: Annotated[
        Path,
        typer.Option(metavar="FILE", help="NetCDF file to write.", rich_help_panel=OUTPUT),
    ]
    servers: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|URL",
            help="TOML file of servers, or the address of an OPeNDAP root. Default:"
            " MANTARAY_OCEAN_SERVERS.",
        ),
    ] = None


@app.command()
@with_options
def hycom(
    window: WindowOptions,
    limits: Annotated[FetchLimits, Fields("attempts", total_s="--time-limit")],
    nearest: Annotated[
        bool,
        typer.Option(
            "--nearest", help="Use the nearest time step if the requested one does not exist."
        ),
    ] = False,
    experiment: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Name of an experiment. Default: the preferred one for the time."
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Download a window of HYCOM at one time and write it as a valid ocean."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.ocean.fetch import fetch_hycom

    with progress_bars(quiet=quiet) as progress:
        fetched = fetch_hycom(
            **asdict(window),
            experiment=experiment,
            nearest=nearest,
            limits=limits,
            overwrite=force,
            progress=progress,
        )
    _log_notes(fetched)


@app.command()
@with_options
def copernicus(
    window: WindowOptions,
    product: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Name of a product. Default: the first that covers the time."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """
    Download a window of a GLORYS12 daily mean as a valid ocean; needs an account of Copernicus
    Marine.
    """
    from pymantaray.ocean.fetch import fetch_copernicus

    _log_notes(fetch_copernicus(**asdict(window), product=product, overwrite=force))


def _log_notes(fetched: "FetchResult") -> None:
    for remark in fetched.remarks:
        LOG.warning(remark)
    LOG.info("%s: %d requests", fetched.title, fetched.requests)
    typer.echo(str(fetched.path))
