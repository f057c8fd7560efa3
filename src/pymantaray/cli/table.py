"""Command `mantaray table`: a travel-time table for use on board."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pymantaray.cli.options import (
    ArrivalOptions,
    Force,
    Json,
    Quiet,
    WaterOptions,
    parse_pair,
    quantity,
    with_options,
)
from pymantaray.cli.output import check_output
from pymantaray.cli.printing import LOG, printer


def _axis(text: Any) -> Any:
    """Parse START:STOP or START:STOP:STEP."""
    numbers = [quantity("m")(word) for word in str(text).split(":")]
    if len(numbers) not in (2, 3):
        raise typer.BadParameter(f"{text}: START:STOP or START:STOP:STEP is needed, such as 0:200:5")
    return tuple(numbers)


def _sea_floor(ocean: list[str], keys: dict[str, Any], deepest: float) -> dict[str, float]:
    """Sea floor of a profile without one: the deepest level of the profile or the largest depth of the table."""
    from pymantaray.water.ocean import is_profile
    from pymantaray.water.uniform import one_profile
    from pymantaray.water.water import configuration_of

    section = configuration_of(ocean, keys).ocean
    if section.bathymetry is not None or not is_profile(section):
        return {}
    depth = max(deepest, float(one_profile(section).depth[-1]))
    LOG.info("sea floor at %g m, the deepest level of the profile or of the table; --sea-floor changes it", depth)
    return {"bathymetry": depth}


@with_options
def table(
    ocean: Annotated[
        list[str],
        typer.Argument(
            metavar="OCEAN",
            help="Ocean files, a profile or cast, a synthetic ocean, a preset or a TOML file.",
        ),
    ],
    water: WaterOptions,
    arrivals: ArrivalOptions,
    source_depth: Annotated[
        Any, typer.Option(parser=_axis, metavar="M:M[:STEP]", help="Depths of the source, such as 0:200:5.")
    ],
    receiver_depth: Annotated[
        Any, typer.Option(parser=_axis, metavar="M:M[:STEP]", help="Depths of the receiver.")
    ],
    horizontal_range: Annotated[
        Any,
        typer.Option(
            "--range",
            parser=_axis,
            metavar="M:M[:STEP]",
            help="Horizontal ranges. STEP is the size of the smallest cells, which bound shadows. Default: 1/64 of the extent.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="TABLE", help="File to write: .nc, or .mtt for the C reader.")],
    arrival: Annotated[
        Literal["direct", "first", "strongest"] | None,
        typer.Option(help="Selected arrival. Default: that of the configuration, else direct."),
    ] = None,
    error: Annotated[
        float,
        typer.Option(parser=quantity("m"), metavar="M", help="Bound of the error of an interpolated range."),
    ] = 0.05,
    node: Annotated[
        str | None,
        typer.Option(
            metavar="NORTH,EAST", help="Position of the source in metres from the centre of the water."
        ),
    ] = None,
    sectors: Annotated[
        int, typer.Option(min=1, max=360, help="Sectors of bearing, for water that varies horizontally.")
    ] = 1,
    ensemble: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Another possible ocean, for the standard deviation of ranges. May be repeated.",
        ),
    ] = None,
    c_reader: Annotated[
        Path | None, typer.Option(metavar="FILE.h", help="Also write the C99 reader of .mtt files.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Build a table that maps two depths and a travel time to a horizontal range."""
    inputs = [Path(name) for name in ocean]
    check_output(out, [".nc", ".mtt"], inputs=inputs, force=force)
    if c_reader is not None:
        check_output(c_reader, [".h"], inputs=[*inputs, out], force=force)
    from pymantaray.online import build_table, save_table
    from pymantaray.online.file import c_header
    from pymantaray.records.writing import whole_file
    from pymantaray.water import open_water

    keys = water.keys | arrivals.keys | ({} if arrival is None else {"arrival": arrival})
    keys |= _sea_floor(ocean, keys, max(source_depth[1], receiver_depth[1]))
    built = build_table(
        open_water(ocean, **keys),
        source_depth,
        receiver_depth,
        horizontal_range,
        tolerance=error,
        node=(0.0, 0.0) if node is None else parse_pair("--node", node, "m"),
        sectors=sectors,
        ensemble=[open_water(path, **keys) for path in ensemble or []],
    )
    save_table(built, out, replace=force)
    if c_reader is not None:
        with whole_file(c_reader, replace=force) as temporary:
            temporary.write_text(c_header())
    shares = built.shares()
    with printer(as_json=as_json, quiet=quiet) as printed:
        printed.line(
            f"{len(built.tree.corner)} cells, {built.tree.nbytes / 1e3:.0f} kB, error of the range below {error:g} m",
            cells=len(built.tree.corner),
            bytes=built.tree.nbytes,
            tolerance_m=error,
        )
        printed.line(
            ", ".join(f"{100.0 * share:.1f} % {name}" for name, share in shares.items() if share > 0.0),
            shares=shares,
        )
        printed.paths(table=out, **({} if c_reader is None else {"c_reader": c_reader}))
