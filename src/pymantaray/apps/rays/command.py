"""
Commands of `mantaray rays`: travel times, eigenrays and paths between positions in a table, and
their figures.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli import output
from pymantaray.cli.groups import existing, number_in, quantity, with_options
from pymantaray.cli.options import (
    LINKS,
    OUTPUT,
    Commands,
    Force,
    PrintOptions,
    Quiet,
    SearchOptions,
    SourceOptions,
    WaterOptions,
    format_names,
)
from pymantaray.cli.printing import printer
from pymantaray.cli.water import load_water, water_notes
from pymantaray.errors import AcousticsError
from pymantaray.plotting.formats import ONE_COLUMN

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pymantaray.geometry import LocalFrame

    Array = NDArray[np.float64]

_MAX_LINKS = 6  # per figure

app = Commands(help="Compute travel times and rays between positions.")


_MAX_RAYS = 100_000  # of a fan
Fan = Annotated[
    tuple[float, float, int] | None,
    typer.Option(
        metavar="FROM TO COUNT",
        help="Fan of COUNT rays between two launch angles in degrees, positive down, instead of"
        " eigenrays (in a plot: behind them).",
    ),
]


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Links, water and output of a command."""

    links: Annotated[Path, LINKS]
    out: Annotated[
        Path, typer.Argument(metavar="OUT.csv", help="Table to write; OUT.nc for NetCDF.")
    ]
    source: SourceOptions
    water: WaterOptions
    search: SearchOptions
    printing: PrintOptions
    force: Force = False


@app.command()
@with_options
def times(task: TaskOptions) -> None:
    """
    Compute the travel time of the earliest arrival of each link, or the reason for its absence.
    """
    from pymantaray.acoustics.selection import NEAR_DB, is_near_cutoff, within_cutoff
    from pymantaray.apps.rays.tables import begin_job, times_table

    job = begin_job("times", task)
    cutoff = job.water.reception.spreading_cutoff_db
    near = None
    if cutoff is None:
        arrivals = job.solve()
    else:
        wide = job.solve(cutoff + NEAR_DB)
        near = is_near_cutoff(wide, cutoff, "first")
        arrivals = within_cutoff(wide, cutoff)
    table = times_table(
        job.table.frame, job.source, job.receiver, arrivals, near, medium=job.medium
    )
    job.finish(arrivals.first().to_dataset() if task.out.suffix == ".nc" else table, arrivals)


@app.command()
@with_options
def eigen(task: TaskOptions) -> None:
    """Compute every arrival of each link: time, bounces, angles, spreading and slowness."""
    from pymantaray.apps.rays.tables import arrivals_table, begin_job

    job = begin_job("eigen", task)
    arrivals = job.solve()
    result = (
        arrivals.to_dataset()
        if task.out.suffix == ".nc"
        else arrivals_table(job.table.frame, arrivals)
    )
    job.finish(result, arrivals, arrivals=arrivals.link.size)


@dataclass(frozen=True)
class FanOptions:
    """Fan of rays instead of eigenrays."""

    fan: Fan = None
    azimuth: Annotated[
        float | None,
        typer.Option(
            parser=quantity("deg"),
            metavar="DEGREES",
            help="Direction of the fan, clockwise from north. Default: to the receiver.",
        ),
    ] = None
    distance: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="METRES",
            help="Horizontal length of the fan. Default: to the receiver.",
        ),
    ] = None

    @property
    def aimed(self) -> bool:
        """True if the rays need receivers."""
        return self.fan is None or self.azimuth is None or self.distance is None


@app.command()
@with_options
def trace(task: TaskOptions, rays: FanOptions) -> None:
    """Compute the path of each eigenray, or of a fan of rays from each source, node by node."""
    from pymantaray.apps.rays.tables import begin_job, paths_dataset, paths_table

    if rays.fan is None and (rays.azimuth is not None or rays.distance is not None):
        raise AcousticsError("--azimuth and --distance need --fan FROM TO COUNT")
    if rays.fan is not None and task.search.cutoff_db is not None:
        raise AcousticsError("--cutoff-db does not apply to --fan; remove one of them")
    angles = None if rays.fan is None else _fan_angles(*rays.fan)
    job = begin_job("trace", task, receivers=rays.aimed)
    found = None
    if angles is None:
        traced, found = job.trace()
    else:
        job.record["fan"] = {
            "from_to_count": rays.fan,
            "azimuth_deg": rays.azimuth,
            "distance_m": rays.distance,
        }
        traced = job.trace_fans(angles, rays.azimuth, rays.distance)
    result = paths_dataset(traced) if task.out.suffix == ".nc" else paths_table(traced)
    job.finish(result, found, rays=traced.row.size, nodes=traced.paths.arrival.size)


@dataclass(frozen=True)
class EndOptions:
    """Ends of the links."""

    source: Annotated[
        str | None,
        typer.Option(
            metavar="N,E,D",
            help="Position of the source: north, east and depth in metres, such as 0,0,20.",
        ),
    ] = None
    receiver: Annotated[
        list[str] | None,
        typer.Option(
            metavar="N,E,D",
            help="Position of the receiver. May be repeated; each has its own panel.",
        ),
    ] = None
    links: Annotated[
        Path | None,
        typer.Option(
            callback=existing(),
            metavar="LINKS.csv",
            help="Table of links, as for times, eigen and trace, instead of --source and"
            " --receiver.",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class FigureOptions:
    """File of a figure, and its layout for one column of a journal."""

    out: Annotated[
        Path, typer.Argument(metavar="OUT.png", help="Figure to write; OUT.pdf for a paper.")
    ]
    formats: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="84mm",
            help="For a paper: 84mm writes OUT.84mm.png (or .pdf) as well, in a layout for one"
            " column of a journal.",
            rich_help_panel=OUTPUT,
        ),
    ] = ""
    force: Force = False

    def files(self, inputs: list[Path]) -> list[Path]:
        """
        Files for both columns and, if requested, for one; raise an error if one must not be
        written.
        """
        files = [self.out]
        if format_names(self.formats, (ONE_COLUMN,)):
            files.append(self.out.with_suffix(f".{ONE_COLUMN}{self.out.suffix}"))
        for file in files:
            output.check_output(file, (".png", ".pdf"), inputs=inputs, force=self.force)
        return files


@app.command()
@with_options
def plot(
    figure: FigureOptions,
    ends: EndOptions,
    source: SourceOptions,
    water: WaterOptions,
    search: SearchOptions,
    fan: Fan = None,
    quiet: Quiet = False,
) -> None:
    """Draw the rays of one or several links over sound speed and sea bed."""
    from pymantaray.acoustics import ray_picture
    from pymantaray.apps.rays import write_ray_plot
    from pymantaray.plotting.style import ocean_header

    # refuse wrong options before the water is read
    files = figure.files([*source.files, *water.files, *([ends.links] if ends.links else [])])
    angles = () if fan is None else _fan_angles(*fan)
    _check_ends(ends)
    loaded = load_water(source, water, search)
    medium, _ = loaded.at_start
    # rays of each link
    titles = []
    pictures = []
    for name, start, receiver in _links(ends, loaded.frame):
        title = f"{name}{_words(start)} to {_words(receiver)} m"
        try:
            pictures.append(
                ray_picture(
                    medium,
                    start,
                    receiver,
                    fan_angles=angles,
                    max_surface_bounces=loaded.reception.max_surface_bounces,
                    max_bottom_bounces=loaded.reception.max_bottom_bounces,
                    spreading_cutoff_db=loaded.reception.spreading_cutoff_db,
                )
            )
        except AcousticsError as error:
            raise AcousticsError(f"{title}: {error}") from None
        titles.append(title)
    # draw them, and print how many arrive
    header = ocean_header({} if loaded.local is None else loaded.local.attrs)
    for file, one_column in zip(files, (False, True), strict=False):
        write_ray_plot(pictures, file, titles=titles, header=header, one_column=one_column)
    with printer(quiet=quiet) as printed:
        for title, picture in zip(titles, pictures, strict=True):
            count = int(picture["ray_arrives"].sum())
            printed.line(
                f"{title}: {count} ray{'' if count == 1 else 's'},"
                f" {picture.attrs['status'].lower()}"
            )
        printed.notes(water_notes(loaded))
        printed.paths(*files)


def _fan_angles(first: float, last: float, count: int) -> "Array":
    """Launch angles of a fan from degrees. [rad]"""
    import numpy as np

    if not 1 <= count <= _MAX_RAYS or not first <= last or (count > 1 and first == last):
        raise AcousticsError(
            f"--fan is {first:g} {last:g} {count}; it must be FROM TO COUNT with FROM < TO and"
            f" COUNT 1 to {_MAX_RAYS}"
        )
    return np.radians(np.linspace(first, last, count))


def parse_place(option: str, text: str) -> tuple[float, float, float]:
    """Parse north, east and depth, separated by commas, in metres or with units. [m]"""
    try:
        north, east, depth = (number_in(word, "m") for word in text.split(","))
    except ValueError:
        raise AcousticsError(
            f"{option} is {text!r}; it must be north, east and depth in metres, separated by"
            " commas, such as 6000,0,500"
        ) from None
    return north, east, depth


def _check_ends(ends: EndOptions) -> None:
    direct = ends.source is not None or bool(ends.receiver)
    if direct == (ends.links is not None) or (
        direct and (ends.source is None or not ends.receiver)
    ):
        raise AcousticsError("ends of the links: give either --source and --receiver, or --links")


def _links(ends: EndOptions, frame: "LocalFrame | None") -> "list[tuple[str, Array, Array]]":
    """Name and ends of each link. [m]"""
    import numpy as np

    from pymantaray.apps.rays.tables import read_links

    if ends.links is None:
        source = np.array(parse_place("--source", str(ends.source)))
        places = [np.array(parse_place("--receiver", text)) for text in ends.receiver or []]
        links = [("", source, place) for place in places]
        where = "--receiver"
    else:
        content = read_links(ends.links)
        frame_of = content.table.frame
        names = (
            [f"{name}: " for name in frame_of["name"]]
            if "name" in frame_of
            else [""] * len(frame_of)
        )
        links = list(zip(names, *content.places(frame), strict=True))
        where = str(ends.links)
    if not 1 <= len(links) <= _MAX_LINKS:
        raise AcousticsError(f"{where}: {len(links)} links; a figure can show 1 to {_MAX_LINKS}")
    return links


def _words(place: "Array") -> str:
    return f"({', '.join(f'{value:.6g}' for value in place)})"


COMMANDS = {"rays": app}
