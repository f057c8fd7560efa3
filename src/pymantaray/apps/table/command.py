"""Command `mantaray table`: a travel-time table for use on board."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import typer

from pymantaray.cli.groups import existing, number_in, quantities, quantity, with_options
from pymantaray.cli.options import OUTPUT, ArrivalOptions, Force, PrintOptions, WaterOptions
from pymantaray.cli.output import check_output, progress_bars
from pymantaray.cli.printing import LOG


def _axis(text: Any) -> Any:
    """Parse START:STOP or START:STOP:STEP."""
    try:
        numbers = tuple(number_in(word, "m") for word in str(text).split(":"))
    except ValueError:
        numbers = ()
    if len(numbers) not in (2, 3):
        raise typer.BadParameter(
            f"found {text!r}; it must be START:STOP[:STEP] in metres, such as 0:200:5"
        )
    return numbers


@dataclass(frozen=True)
class BoxOptions:
    """Limits of a table and the error of its ranges."""

    source_depth: Annotated[
        Any,
        typer.Option(
            parser=_axis,
            metavar="START:STOP[:STEP]",
            help="Depths of the source, such as 0:200:5. METRES, as in the two ranges below; STEP"
            " is the size of the smallest cells, which bound shadows. Default: 1/64 of the extent.",
        ),
    ]
    receiver_depth: Annotated[
        Any,
        typer.Option(parser=_axis, metavar="START:STOP[:STEP]", help="Depths of the receiver."),
    ]
    horizontal_range: Annotated[
        Any,
        typer.Option(
            "--range",
            parser=_axis,
            metavar="START:STOP[:STEP]",
            help="Horizontal ranges.",
        ),
    ]
    error: Annotated[
        float,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Bound of the error of an interpolated range.",
        ),
    ] = 0.05

    @property
    def deepest(self) -> float:
        """Largest depth of a source or receiver. [m]"""
        return float(max(self.source_depth[1], self.receiver_depth[1]))


@dataclass(frozen=True)
class TableWaterOptions:
    """Arrival, place of the source, and other possible oceans."""

    arrival: Annotated[
        Literal["direct", "first", "strongest", "direct-or-first"] | None,
        typer.Option(help="Selected arrival. Default: that of the configuration, else direct."),
    ] = None
    node: Annotated[
        Any,
        typer.Option(
            parser=quantities("m", 2),
            metavar="NORTH,EAST",
            help="Position of the source from the centre of the water.",
        ),
    ] = "0,0"
    sectors: Annotated[
        int,
        typer.Option(
            min=1, max=360, help="Sectors of bearing, for water that varies horizontally."
        ),
    ] = 1
    ensemble: Annotated[
        list[Path] | None,
        typer.Option(
            callback=existing(),
            metavar="FILE",
            help="Another possible ocean, for the standard deviation of ranges. May be repeated.",
        ),
    ] = None

    @property
    def keys(self) -> dict[str, Any]:
        """Options of `pymantaray.open_water`."""
        return {} if self.arrival is None else {"arrival": self.arrival}


@dataclass(frozen=True)
class FileOptions:
    """Files to write."""

    panel: ClassVar = OUTPUT

    out: Annotated[
        Path,
        typer.Option(metavar="TABLE", help="File to write: .nc, or .mtt for the C reader."),
    ]
    c_reader: Annotated[
        Path | None, typer.Option(metavar="FILE.h", help="Also write the C99 reader of .mtt files.")
    ] = None
    force: Force = False

    def check(self, inputs: list[Path]) -> None:
        """Raise an error if a file cannot or must not be written."""
        check_output(self.out, [".nc", ".mtt"], inputs=inputs, force=self.force)
        if self.c_reader is not None:
            check_output(self.c_reader, [".h"], inputs=[*inputs, self.out], force=self.force)


@with_options
def table(
    ocean: Annotated[
        list[str],
        typer.Argument(
            callback=existing(),
            metavar="OCEAN",
            help="Ocean files, a profile or cast, a synthetic ocean, a preset or a TOML file.",
        ),
    ],
    water: WaterOptions,
    arrivals: ArrivalOptions,
    limits: BoxOptions,
    choice: TableWaterOptions,
    files: FileOptions,
    printing: PrintOptions,
) -> None:
    """Build a table that maps two depths and a travel time to a horizontal range."""
    files.check([Path(name) for name in ocean])
    from pymantaray.apps.table import build_table, save_table
    from pymantaray.apps.table.file import c_header
    from pymantaray.config.door.water import open_water
    from pymantaray.records.writing import whole_file

    # water, and members of an ensemble
    keys = water.keys | arrivals.keys | choice.keys
    keys |= _sea_floor(ocean, keys, limits.deepest)
    opened = open_water(ocean, **keys)
    members = [open_water(path, **keys) for path in choice.ensemble or []]
    # build and write the table
    with progress_bars(quiet=printing.quiet) as progress:
        built = build_table(
            opened,
            limits.source_depth,
            limits.receiver_depth,
            limits.horizontal_range,
            tolerance=limits.error,
            node=choice.node,
            sectors=choice.sectors,
            ensemble=members,
            progress=progress,
        )
    save_table(built, files.out, replace=files.force)
    written = {"table": files.out}
    if files.c_reader is not None:
        with whole_file(files.c_reader, replace=files.force) as temporary:
            temporary.write_text(c_header())
        written["c_reader"] = files.c_reader
    # print its size and what it contains
    shares = built.shares()
    cells = len(built.tree.corner)
    size = built.tree.nbytes
    with printing.printer() as printed:
        printed.line(
            f"{cells} cells, {size / 1e3:.0f} kB, error of the range below {limits.error:g} m",
            cells=cells,
            bytes=size,
            tolerance_m=limits.error,
        )
        printed.notes(note for water in (opened, *members) for note in water.notes)
        words = (f"{100.0 * share:.1f} % {name}" for name, share in shares.items() if share > 0.0)
        printed.line(", ".join(words), shares=shares)
        printed.paths(**written)


def _sea_floor(ocean: list[str], keys: dict[str, Any], deepest: float) -> dict[str, float]:
    """
    Sea floor of a profile without one: the deepest level of the profile or the largest depth of the
    table.
    """
    from pymantaray.config.door.ocean import build_mission_ocean
    from pymantaray.config.door.water import configuration_of

    own = build_mission_ocean(configuration_of(ocean, keys))
    if own.has_sea_floor or not own.is_profile:
        return {}
    depth = max(deepest, float(own.profile().depth[-1]))
    LOG.info(
        "sea floor at %g m, the deepest level of the profile or of the table; --bathymetry changes"
        " it",
        depth,
    )
    return {"bathymetry": depth}


COMMANDS = {"table": table}
