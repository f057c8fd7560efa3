"""`mantaray serve`: ranges over HTTP until it is told to stop."""

import signal
from ipaddress import ip_address
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.cli.options import ArrivalOptions, Set, WaterOptions, changes_of, parse_duration, with_options
from pymantaray.cli.printing import LOG

if TYPE_CHECKING:
    from pymantaray.service import RangingService


@with_options
def serve(
    ocean: Annotated[
        list[str],
        typer.Argument(
            metavar="OCEAN|CONFIG",
            help="Ocean files, a profile or cast, synthetic:beaufort or synthetic:fram, a preset, or a TOML file with a study's"
            " sections ocean, acoustics, ranging and detection.",
        ),
    ],
    water: WaterOptions,
    arrivals: ArrivalOptions,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes one that is free.")] = 8642,
    host: Annotated[
        str, typer.Option(help="Address to listen at; by default only this machine reaches it.")
    ] = "127.0.0.1",
    workers: Annotated[
        int, typer.Option(min=0, help="Processes that pings are handed to; 0 works in the server's threads.")
    ] = 0,
    water_interval: Annotated[
        str,
        typer.Option(
            metavar="DURATION",
            help="Of an ocean that varies: how long its water is kept, in seconds or such as '5 min'; 0 for each ping's"
            " own.",
        ),
    ] = "0",
    changes: Set = None,
) -> None:
    """Answer pings by JSON over HTTP: who hears what when. End it with Ctrl-C."""
    from pymantaray.service import RangingService, make_server

    kept_s = parse_duration("--water-interval", water_interval, positive=False)
    options = water.keys | arrivals.keys | changes_of(changes)
    with RangingService(ocean, water_interval=kept_s, workers=workers, **options) as service:
        server = make_server(service, host, port)
        if not ip_address(server.effective_host).is_loopback:
            LOG.warning(
                "listening at %s: whoever reaches it can use it, there is no password", server.effective_host
            )
        typer.echo(_title(service))
        typer.echo(f"listening on http://{server.effective_host}:{server.effective_port}")
        number = _run(server)
    raise SystemExit(128 + number)


def _title(service: "RangingService") -> str:
    """Name of the water, and where it is."""
    local, frame = service.water.local, service.water.frame
    title = "medium" if local is None else str(local.attrs.get("title", "local ocean"))
    if frame is None:
        return title
    return f"{title}, about {frame.latitude_deg:g} N {frame.longitude_deg:g} E"


def _run(server: Any) -> int:
    """Serve until a signal to stop, and tell which; the server takes in the exception that it becomes."""
    stopped_by: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped_by.append(number)
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        server.run()
    finally:
        server.close()
    return stopped_by[0]
