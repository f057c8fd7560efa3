"""Commands of `mantaray atlas`; they import modules when they run, which keeps the help fast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.apps.atlas.links import AtlasLinks
from pymantaray.apps.ocean.command import Files
from pymantaray.cli.groups import Fields, existing, quantities, quantity, with_options
from pymantaray.cli.options import (
    OUTPUT,
    Commands,
    FigureFormats,
    Force,
    Json,
    ProcessOptions,
    Quiet,
    RunGroup,
    SearchOptions,
    TableOptions,
    To,
    WaterOptions,
    format_names,
    parse_duration,
)
from pymantaray.cli.output import check_output, counted_progress, resumable
from pymantaray.cli.printing import printer
from pymantaray.errors import AtlasError
from pymantaray.plotting.formats import FIGURE_FORMATS

if TYPE_CHECKING:
    from pymantaray.config.door.sound import SoundOptions

_SAFETY = "Maximum error of a location, and percentage of locations below each threshold"

app = Commands(
    cls=RunGroup, help="Map the errors of straight-line ranging in every column of an ocean."
)

AtlasFile = Annotated[
    Path, typer.Argument(callback=existing(), metavar="ATLAS.nc", help="File of an atlas.")
]


@dataclass(frozen=True)
class ColumnOptions:
    """Columns and instants of an atlas."""

    every: Annotated[int, typer.Option(min=1, help="Use every n-th column along each axis.")] = 1
    window: Annotated[
        Any,
        typer.Option(
            parser=quantities("deg", 4),
            metavar="S,N,W,E",
            help="Region of the columns, in degrees. Links may use water outside.",
        ),
    ] = None
    start: Annotated[
        str | None, typer.Option(metavar="TIME", help="First instant (UTC) of a series.")
    ] = None
    stop: Annotated[
        str | None, typer.Option(metavar="TIME", help="Last instant (UTC) of a series.")
    ] = None
    step_h: Annotated[
        str | None,
        typer.Option(
            metavar="HOURS",
            help="Minimum time between instants, a number or text such as '2 d'. Default: all"
            " instants; 24 h for a synthetic ocean.",
        ),
    ] = None

    def instants(self, source: Sequence[str], time: list[str] | None) -> Any:
        """Instants of an ocean's files, or those of the option ``--time``."""
        from pymantaray.apps.atlas.plan import instants_between

        if (self.start is None) != (self.stop is None) or (self.start is not None and time):
            raise AtlasError("--start and --stop must be used together and without --time")
        if self.start is None or self.stop is None:
            if self.step_h is not None:
                raise AtlasError("--step-h needs --start and --stop; give both")
            return time or None
        step = None if self.step_h is None else parse_duration("--step-h", self.step_h, "h")
        return instants_between(source, self.start, self.stop, step)


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """Links of each column."""

    depths: Annotated[
        Any,
        typer.Option(
            parser=quantities("m"),
            metavar="METRES,...",
            help="Depths separated by commas: use all pairs, with the transmitter above.",
        ),
    ] = "20,200,800"
    pair: Annotated[
        list[Any] | None,
        typer.Option(
            parser=quantities("m", 2),
            metavar="METRES,METRES",
            help="Depths of transmitter and receiver, instead of --depths. May be repeated.",
        ),
    ] = None
    links: Annotated[
        AtlasLinks,
        Fields("distances", "bearings", "safe", "within_db", nominal_sound_speed="--nominal"),
    ]

    def of_study(self, sound: "SoundOptions", tolerance: float) -> AtlasLinks:
        """Links with the search of a study."""
        pairs = self.pair or combinations_with_replacement(self.depths, 2)
        return replace(
            self.links,
            pairs=tuple(pairs),
            max_surface_bounces=sound.options.max_surface_bounces,
            max_bottom_bounces=sound.options.max_bottom_bounces,
            spreading_cutoff_db=sound.options.spreading_cutoff_db,
            tolerance=tolerance,
            interpolation=sound.interpolation,
        )


@dataclass(frozen=True, kw_only=True)
class OutOptions(ProcessOptions):
    """File of an atlas, and the processes that compute it."""

    out: Annotated[
        Path,
        typer.Option(
            metavar="ATLAS.nc",
            help="File to write. Finished blocks in ATLAS.nc.blocks are skipped.",
            rich_help_panel=OUTPUT,
        ),
    ]
    force: Force = False


@app.command()
@with_options
def run(
    files: Files,
    water: WaterOptions,
    search: SearchOptions,
    grid: ColumnOptions,
    links: LinkOptions,
    out: OutOptions,
    printing: TableOptions,
) -> None:
    """Compute an atlas, or complete an interrupted one."""
    check_output(out.out, [".nc"], inputs=[Path(name) for name in files], force=True)
    from pymantaray.apps.atlas import Atlas, open_atlas, run_atlas, safety_table
    from pymantaray.apps.atlas.dataset import notes_of
    from pymantaray.config.door.sound import build_sound
    from pymantaray.config.door.water import configuration_of
    from pymantaray.records.digits import counted

    config = configuration_of(files, replace(water, time=None).keys | search.keys)
    atlas = Atlas(
        config,
        links.of_study(build_sound(config), search.tolerance),
        window=grid.window,
        every=grid.every,
        times=grid.instants(config.ocean.source, water.time),
    )
    with printing.printer() as printed:
        n, rows, columns = atlas.shape
        instants = counted(n, "instant")
        blocks = counted(len(atlas.blocks), "block")
        count = atlas.links.count
        printed.line(f"{rows} x {columns} columns, {instants}, {count} links each; {blocks}")
        printed.add(columns_lat=rows, columns_lon=columns, instants=n, links=count)
        with (
            resumable(lambda: "the same command resumes with the blocks that are not finished"),
            counted_progress("blocks", quiet=printing.quiet) as progress,
        ):
            run_atlas(
                atlas,
                out.out,
                client=out.scheduler,
                workers=out.workers,
                force=out.force,
                progress=progress,
            )
        with open_atlas(out.out) as dataset:
            printed.notes(notes_of(dataset))
            printed.frame("safety", safety_table(dataset), _SAFETY)
        printed.paths(file=out.out)


@app.command()
def show(file: AtlasFile, as_json: Json = False, to: To = "text") -> None:
    """Print range errors and safe locations by convention and distance."""
    from pymantaray.apps.atlas import open_atlas, safety_table
    from pymantaray.apps.atlas.dataset import notes_of

    with open_atlas(file) as dataset, printer(as_json=as_json, to=to) as printed:
        printed.line(dataset.attrs["title"], title=dataset.attrs["title"])
        printed.notes(notes_of(dataset))
        printed.frame("safety", safety_table(dataset), _SAFETY)


@app.command()
def plot(
    file: AtlasFile,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder for the figures, PNG and PDF, and the page.",
            rich_help_panel=OUTPUT,
        ),
    ],
    convention: Annotated[
        str,
        typer.Option(
            metavar="WORD", help="Sound speed: transmitter, receiver, mean, chord or nominal."
        ),
    ] = "transmitter",
    distance: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="A distance of the atlas. Default: the middle one.",
        ),
    ] = None,
    pair: Annotated[
        Any,
        typer.Option(
            parser=quantities("m", 2),
            metavar="METRES,METRES",
            help="A pair of depths of the atlas. Default: all.",
        ),
    ] = None,
    at: Annotated[
        Any,
        typer.Option(
            parser=quantities("deg", 2),
            metavar="LAT,LON",
            help="Place of the time series, for an atlas with several instants.",
        ),
    ] = None,
    formats: FigureFormats = "",
    quiet: Quiet = False,
) -> None:
    """
    Draw maps of safe distances, errors and lost paths, time series of the error, and an interactive
    page.
    """
    names = format_names(formats, FIGURE_FORMATS)
    from pymantaray.apps.atlas import open_atlas, write_atlas_page, write_atlas_plots
    from pymantaray.cli.output import progress_bars

    with open_atlas(file) as dataset, progress_bars(quiet=quiet) as progress:
        paths = write_atlas_plots(
            dataset,
            out,
            convention=convention,
            distance=distance,
            pair=pair,
            place=at,
            formats=names,
            progress=progress,
        )
        page = write_atlas_page(dataset, paths, out)
    for path in (*paths, page):
        typer.echo(str(path))


COMMANDS = {"atlas": app}
