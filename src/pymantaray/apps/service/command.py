"""Command `mantaray serve`: ranging service over HTTP."""

import signal
from ipaddress import ip_address
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import ArrivalOptions, Set, WaterOptions, changes_of, parse_duration
from pymantaray.cli.printing import LOG, printer
from pymantaray.records.stops import handled

if TYPE_CHECKING:
    from pymantaray.apps.service import RangingService


@with_options
def serve(
    ocean: Annotated[
        list[str],
        typer.Argument(
            callback=existing(),
            metavar="OCEAN|CONFIG",
            help="Ocean files, a profile or cast, synthetic:beaufort or synthetic:fram, a preset,"
            " or a TOML file with a study's sections ocean, acoustics, ranging and detection.",
        ),
    ],
    water: WaterOptions,
    arrivals: ArrivalOptions,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port; 0 selects a free port.")
    ] = 8642,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to listen at. The default is accessible from this machine only.",
        ),
    ] = "127.0.0.1",
    workers: Annotated[
        int, typer.Option(min=0, help="Number of worker processes; 0 for the server's threads.")
    ] = 0,
    water_interval: Annotated[
        str,
        typer.Option(
            metavar="DURATION",
            help="Update interval of a time-varying ocean; 0 to update for each ping.",
        ),
    ] = "0",
    changes: Set = None,
) -> None:
    """Answer pings with receptions as JSON over HTTP. Ctrl-C stops the server."""
    from pymantaray.apps.service import RangingService, make_server
    from pymantaray.cli.water import water_notes

    kept_s = parse_duration("--water-interval", water_interval, positive=False)
    options = water.keys | arrivals.keys | changes_of(changes)
    with RangingService(ocean, water_interval=kept_s, workers=workers, **options) as service:
        server = make_server(service, host, port)
        if not ip_address(server.effective_host).is_loopback:
            LOG.warning(
                "listening at %s without a password: anyone who can access it can use it",
                server.effective_host,
            )
        with printer() as printed:
            printed.notes(water_notes(service.water))
            printed.line(_title(service))
            printed.line(f"listening on http://{server.effective_host}:{server.effective_port}")
        number = _run(server)
    raise SystemExit(128 + number)


def _title(service: "RangingService") -> str:
    """Name and place of the water."""
    local = service.water.local
    frame = service.water.frame
    title = "medium" if local is None else str(local.attrs.get("title", "local ocean"))
    if frame is None:
        return title
    from pymantaray.ocean.schema import latitude, longitude

    return f"{title}, around {latitude(frame.latitude_deg)}, {longitude(frame.longitude_deg)}"


def _run(server: Any) -> int:
    """
    Serve until a signal stops the server; return the signal. The server catches the exception of
    the signal.
    """
    stopped_by: list[int] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        stopped_by.append(number)
        handled.set()
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        server.run()
    finally:
        server.close()
    return stopped_by[0]


COMMANDS = {"serve": serve}
