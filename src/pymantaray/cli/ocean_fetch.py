"""Commands of `mantaray ocean fetch`: download HYCOM and GLORYS12 by place and time."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli.options import Commands, Force, Quiet, parse_duration, parse_pair
from pymantaray.cli.printing import LOG

if TYPE_CHECKING:
    from pymantaray.ocean.fetch import FetchResult

app = Commands(help="Download an ocean by place and time.")

Lat = Annotated[str, typer.Option("--lat", metavar="SOUTH,NORTH", help="Latitudes, in degrees.")]
Lon = Annotated[
    str,
    typer.Option(
        "--lon", metavar="WEST,EAST", help="Longitudes in any convention; 170,-170 crosses the antimeridian."
    ),
]
Time = Annotated[str, typer.Option("--time", help="Instant (UTC), such as 2014-07-15T12.")]
Out = Annotated[Path, typer.Option("--out", metavar="FILE", help="NetCDF file to write.")]
Servers = Annotated[
    str | None,
    typer.Option(
        "--servers",
        metavar="FILE|URL",
        help="TOML file of servers, or the address of an OPeNDAP root. Default: MANTARAY_OCEAN_SERVERS.",
    ),
]


@app.command()
def hycom(
    lat: Lat,
    lon: Lon,
    time: Time,
    out: Out,
    nearest: Annotated[
        bool,
        typer.Option("--nearest", help="Use the nearest time step if the requested one does not exist."),
    ] = False,
    experiment: Annotated[
        str | None,
        typer.Option("--experiment", help="Name of an experiment. Default: the preferred one for the time."),
    ] = None,
    servers: Servers = None,
    time_limit: Annotated[
        str,
        typer.Option(
            "--time-limit",
            metavar="DURATION",
            help="Time limit of the download: seconds, or text such as '30 min'.",
        ),
    ] = "30 min",
    attempts: Annotated[
        int, typer.Option("--attempts", min=1, help="Maximum number of attempts per request.")
    ] = 4,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Download a window of HYCOM at one time and write it as a valid ocean."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.ocean.fetch import Limits, fetch_hycom

    with progress_bars(quiet=quiet) as progress:
        fetched = fetch_hycom(
            parse_pair("--lat", lat),
            parse_pair("--lon", lon),
            time,
            out,
            servers=servers,
            experiment=experiment,
            nearest=nearest,
            limits=Limits(total_s=parse_duration("--time-limit", time_limit), attempts=attempts),
            overwrite=force,
            progress=progress,
        )
    _tell(fetched)


@app.command()
def copernicus(
    lat: Lat,
    lon: Lon,
    time: Time,
    out: Out,
    product: Annotated[
        str | None,
        typer.Option("--product", help="Name of a product. Default: the first that covers the time."),
    ] = None,
    servers: Servers = None,
    force: Force = False,
) -> None:
    """Download a window of a GLORYS12 daily mean as a valid ocean; needs an account of Copernicus Marine."""
    from pymantaray.ocean.fetch import fetch_copernicus

    fetched = fetch_copernicus(
        parse_pair("--lat", lat),
        parse_pair("--lon", lon),
        time,
        out,
        product=product,
        servers=servers,
        overwrite=force,
    )
    _tell(fetched)


def _tell(fetched: "FetchResult") -> None:
    for remark in fetched.remarks:
        LOG.warning(remark)
    LOG.info("%s: %d requests", fetched.title, fetched.requests)
    typer.echo(str(fetched.path))
