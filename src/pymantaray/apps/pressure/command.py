"""Command `mantaray pressure`: sea pressure at a depth."""

from typing import Annotated

import typer

from pymantaray.cli.options import Json
from pymantaray.cli.printing import printer


def pressure(
    depth: Annotated[float, typer.Argument(help="Depth, in metres.")],
    latitude: Annotated[float, typer.Option(help="Latitude, in degrees north.")] = 45.0,
    as_json: Json = False,
) -> None:
    """Print the sea pressure at a depth."""
    import gsw

    value = float(gsw.p_from_z(-depth, latitude))
    with printer(as_json=as_json) as out:
        out.line(f"{value:.3f} dbar", pressure_dbar=value)


COMMANDS = {"pressure": pressure}
