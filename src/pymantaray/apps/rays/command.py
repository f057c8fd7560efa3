"""Commands of `mantaray rays`: travel times, eigenrays and paths between positions in a table."""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.apps.rays.plot_command import plot
from pymantaray.cli.groups import quantity, with_options
from pymantaray.cli.options import (
    LINKS,
    Commands,
    Fan,
    Force,
    PrintOptions,
    SearchOptions,
    SourceOptions,
    WaterOptions,
    fan_angles,
)

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray

    from pymantaray.acoustics import Medium
    from pymantaray.apps.rays.tables import TracedRays
    from pymantaray.records import Arrivals
    from pymantaray.records.text_table import TextTable
    from pymantaray.sensing.water import Water

    Array = NDArray[np.float64]

SHOWS_RESULTS = True

app = Commands(help="Compute travel times and rays between positions.")
app.command("plot")(plot)

_MIN_LINKS_FOR_BAR = 4096  # fewer links have no progress bar


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
    from pymantaray.apps.rays.tables import times_table

    job = _begin("times", task)
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
    from pymantaray.apps.rays.tables import arrivals_table

    job = _begin("eigen", task)
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
    from pymantaray.apps.rays.tables import paths_dataset, paths_table
    from pymantaray.errors import AcousticsError

    if rays.fan is None and (rays.azimuth is not None or rays.distance is not None):
        raise AcousticsError("--azimuth and --distance need --fan FROM TO COUNT")
    if rays.fan is not None and task.search.cutoff_db is not None:
        raise AcousticsError("--cutoff-db does not apply to --fan; remove one of them")
    angles = None if rays.fan is None else fan_angles(*rays.fan)
    job = _begin("trace", task, receivers=rays.aimed)
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


@dataclass(frozen=True, eq=False)
class Job:
    """One call of a command: its checked input, computation and output."""

    task: TaskOptions
    water: "Water"
    table: "TextTable"
    source: "Array"
    receiver: "Array"
    record: dict[str, Any]

    @property
    def medium(self) -> "Medium":
        """Medium of the rays."""
        return self.water.at_start[0]

    @property
    def notes(self) -> list[str]:
        """Notes about the water for the user."""
        from pymantaray.cli.water import water_notes

        return water_notes(self.water)

    def solve(self, cutoff_db: float | None = None) -> "Arrivals":
        """
        Arrivals of all links, with the cut-off [dB] of the search or another one, and with currents
        if there are any.
        """
        from pymantaray.acoustics import find_eigenrays
        from pymantaray.acoustics.currents import carried
        from pymantaray.cli.output import progress_bars

        reception = self.water.reception
        with progress_bars(
            quiet=self.task.printing.quiet or len(self.source) < _MIN_LINKS_FOR_BAR
        ) as report:
            arrivals = find_eigenrays(
                self.medium,
                self.source,
                self.receiver,
                reception.max_surface_bounces,
                reception.max_bottom_bounces,
                reception.spreading_cutoff_db if cutoff_db is None else cutoff_db,
                tolerance=self.task.search.tolerance,
                progress=None
                if report is None
                else lambda done, total: report("links", done, total),
            )
        currents = self.water.at_start[1]
        if currents is None:
            return arrivals
        return carried(
            self.medium,
            self.source,
            self.receiver,
            arrivals,
            currents,
            tolerance=self.task.search.tolerance,
        )

    def trace(self) -> "tuple[TracedRays, Arrivals]":
        """Paths of all arrivals, and the arrivals."""
        from pymantaray.acoustics import trace_paths
        from pymantaray.apps.rays.tables import TracedRays, number_within

        arrivals = self.solve()
        tolerance = self.task.search.tolerance
        paths = trace_paths(self.medium, self.source, self.receiver, arrivals, tolerance=tolerance)
        return TracedRays(paths, arrivals.link, number_within(arrivals.link)), arrivals

    def trace_fans(
        self, angles: "Array", azimuth: float | None, distance: float | None
    ) -> "TracedRays":
        """
        Fan from the source of every row, with an azimuth [degrees] and length [m], by default
        towards the receiver.
        """
        import numpy as np

        from pymantaray.acoustics import trace_fan
        from pymantaray.apps.rays.tables import TracedRays, joined
        from pymantaray.errors import AcousticsError

        fans = []
        for line, source, (north, east, _) in zip(
            self.table.frame.index, self.source, self.receiver - self.source, strict=True
        ):
            try:
                fans.append(
                    trace_fan(
                        self.medium,
                        source,
                        math.atan2(east, north) if azimuth is None else math.radians(azimuth),
                        angles,
                        math.hypot(north, east) if distance is None else distance,
                        max_surface_bounces=self.water.reception.max_surface_bounces,
                        max_bottom_bounces=self.water.reception.max_bottom_bounces,
                        tolerance=self.task.search.tolerance,
                    )
                )
            except AcousticsError as error:
                raise AcousticsError(f"{self.table.path}, line {line}: {error}") from None
        n = len(fans)
        size = angles.size
        return TracedRays(
            joined(fans, size),
            np.repeat(np.arange(n), size),
            np.tile(np.arange(size), n),
            np.tile(angles, n),
        )

    def finish(
        self, result: "pd.DataFrame | xr.Dataset", found: "Arrivals | None", **also: int
    ) -> None:
        """
        Write the result, and print the outcomes of the links, notes, and the name of the output.
        """
        from pymantaray.apps.rays.tables import status_words, write_result
        from pymantaray.records.digits import counted

        outcomes = Counter([] if found is None else status_words(found.status))
        write_result(
            result,
            self.task.out,
            self.record | ({} if found is None else {"outcomes": dict(outcomes)}),
        )
        with self.task.printing.printer() as printed:
            counts = ", ".join(f"{count} {word}" for word, count in outcomes.most_common())
            more = ", ".join(counted(count, noun.removesuffix("s")) for noun, count in also.items())
            ends = "source" if found is None else "link"
            notes = [*self.notes, *([] if found is None else found.incomplete_note())]
            printed.line(
                f"{counted(len(self.source), ends)}: {'; '.join(filter(None, (counts, more)))}",
                **{f"{ends}s": len(self.source), "outcomes": outcomes, **also},
            )
            printed.notes(notes)
            printed.paths(file=self.task.out)


def _begin(command: str, task: TaskOptions, *, receivers: bool = True) -> Job:
    """Read and check all input of a command before its computation."""
    import numpy as np

    from pymantaray.apps.rays.tables import read_links, sidecar
    from pymantaray.cli.output import check_output
    from pymantaray.cli.water import load_water, search_record
    from pymantaray.version import __version__

    check_output(
        task.out,
        (".csv", ".nc"),
        inputs=[task.links, *task.source.files, *task.water.files],
        beside=[sidecar(task.out)] if task.out.suffix == ".csv" else [],
        force=task.force,
    )
    content = read_links(task.links, receivers=receivers)
    water = load_water(task.source, task.water, task.search)
    start, *others = content.places(water.frame)
    end = others[0] if others else np.full_like(start, np.nan)
    record = {
        "mantaray": __version__,
        "command": command,
        "links": str(task.links),
        "medium": water.record,
        "search": {**search_record(water), "tolerance": task.search.tolerance},
    }
    return Job(task, water, content.table, start, end, record)


COMMANDS = {"rays": app}
