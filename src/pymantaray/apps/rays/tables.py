"""
Jobs of `mantaray rays`: input of links, computation, and output of travel times, arrivals and paths
as tables.
"""

import json
import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray import acoustics
from pymantaray.acoustics import Medium, RayPaths, choose_arrivals, currents
from pymantaray.arrays import Array
from pymantaray.cli import output
from pymantaray.cli.water import load_water, search_record, water_notes
from pymantaray.errors import AcousticsError
from pymantaray.geometry import LocalFrame
from pymantaray.records import Arrivals, RayStatus, whole_file, write_netcdf
from pymantaray.records.csv_text import csv_text
from pymantaray.records.digits import counted
from pymantaray.records.text_table import TextTable, read_text_table
from pymantaray.sensing.water import Water
from pymantaray.version import __version__

if TYPE_CHECKING:
    from pymantaray.apps.rays.command import TaskOptions

LOCAL, GEOGRAPHIC = (
    [f"{end}_{axis}" for end in ("source", "receiver") for axis in axes]
    for axes in (("north", "east", "depth"), ("lat", "lon", "depth"))
)
_DIGITS = "%.12g"
_MIN_LINKS_FOR_BAR = 4096  # fewer links have no progress bar
_BOUNDARIES = np.array(["water", "surface", "bottom"])
_WORDS = {int(status): status.name.lower() for status in RayStatus}


class TracedRays(NamedTuple):
    """
    Paths of rays; for each ray the row of its link and its number in this row, and for fans its
    launch angle.
    """

    paths: RayPaths
    row: NDArray[np.int64]
    number: NDArray[np.int64]
    launch_angle: Array | None = None


@dataclass(frozen=True, eq=False)
class LinkTable:
    """
    A table of links, and its ends: north, east or latitude, longitude, and depth (n_links, 3).
    """

    table: TextTable
    ends: tuple[Array, ...]
    geographic: bool

    def places(self, frame: LocalFrame | None) -> tuple[Array, ...]:
        """
        North, east, down in a frame of the sources and, if the table has them, of the receivers.
        [m]
        """
        if not self.geographic:
            return self.ends
        if frame is None:
            raise AcousticsError(
                f"{self.table.path}: latitudes and longitudes need a place of the profile; give"
                " `centre`, or use north and east"
            )
        if max(np.abs(end[:, 0]).max(initial=0.0) for end in self.ends) > 90.0:
            raise AcousticsError(
                f"{self.table.path}: a latitude is not in -90 to 90 degrees; correct it"
            )
        return tuple(
            np.column_stack([*frame.to_local(end[:, 0], end[:, 1]), end[:, 2]]) for end in self.ends
        )


def read_links(path: Path, *, receivers: bool = True) -> LinkTable:
    """Read links from a table, or only their sources."""
    table = read_text_table(path)
    geographic = GEOGRAPHIC[0] in table.frame
    names = GEOGRAPHIC if geographic else LOCAL
    values = table.numbers(names if receivers else names[:3])
    return LinkTable(
        table, tuple(values[:, k : k + 3].copy() for k in range(0, values.shape[1], 3)), geographic
    )


def sidecar(out: Path) -> Path:
    """File beside a table that records its origin."""
    return out.with_name(out.name + ".json")


def write_table(table: pd.DataFrame, out: Path) -> None:
    """Write a table as CSV."""
    with whole_file(out) as temporary:
        temporary.write_text(csv_text(table, float_format=_DIGITS), encoding="utf-8")


def write_result(result: pd.DataFrame | xr.Dataset, out: Path, record: dict[str, Any]) -> None:
    """
    Write a table as CSV with a JSON record of its origin, or NetCDF with this record in the
    attribute ``made_by``.
    """
    if isinstance(result, xr.Dataset):
        write_netcdf(result.assign_attrs(made_by=json.dumps(record)), out)
        return
    with whole_file(sidecar(out)) as beside:
        beside.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        write_table(result, out)


def times_table(
    links: pd.DataFrame,
    source: Array,
    receiver: Array,
    arrivals: Arrivals,
    near_cutoff: NDArray[np.bool_] | None = None,
    *,
    medium: Medium,
) -> pd.DataFrame:
    """
    One row per link: its input columns, its earliest arrival, and a flag if 1 dB of the cut-off
    changes this arrival.
    """
    link, row = choose_arrivals(arrivals, "first")

    def of_first(values: NDArray[Any], kind: str = "float64") -> "pd.Series[Any]":
        return pd.Series(values[row], index=link, dtype=kind).reindex(range(len(links)))

    time = of_first(arrivals.travel_time)
    # 1 if near the cut-off, 0 if not, empty without an arrival
    arrives = time.notna()
    flag = (
        arrives.astype("Int64") * 0
        if near_cutoff is None
        else pd.Series(near_cutoff.astype(int), dtype="Int64")
    )
    added = pd.DataFrame(
        {
            "status": status_words(arrivals.status),
            "travel_time_s": time,
            "straight_range_m": medium.straight_distance(source, receiver),
            "refracted_range_m": arrivals.source_sound_speed * time,
            "chord_travel_time_s": arrivals.chord_travel_time,
            "source_sound_speed_m_s": arrivals.source_sound_speed,
            "receiver_sound_speed_m_s": arrivals.receiver_sound_speed,
            "surface_bounces": of_first(arrivals.surface_bounces, "Int64"),
            "bottom_bounces": of_first(arrivals.bottom_bounces, "Int64"),
            "launch_angle_deg": np.degrees(of_first(arrivals.launch_angle)),
            "shadow_margin_m": arrivals.shadow_margin,
            "near_cutoff": flag.where(arrives | (flag == 1)),
            "complete": pd.Series(arrivals.complete.astype(int), dtype="Int64").where(
                arrivals.status != RayStatus.OUTSIDE
            ),
        }
    )
    return _beside(links, added)


def arrivals_table(links: pd.DataFrame, arrivals: Arrivals) -> pd.DataFrame:
    """One row per arrival, with the input columns of its link except coordinates."""
    own = links.drop(columns=[*LOCAL, *GEOGRAPHIC], errors="ignore").iloc[arrivals.link]
    return _beside(own, arrivals.to_dataframe().rename(columns={"link": "row"}))


def paths_table(rays: TracedRays) -> pd.DataFrame:
    """One row per node."""
    paths = rays.paths
    ray = rays.paths.arrival
    first = np.searchsorted(ray, np.arange(rays.row.size))
    step = paths.position[:, :2] - paths.position[first[ray], :2]
    columns = {"row": rays.row[ray]}
    if rays.launch_angle is None:
        columns |= {"arrival": rays.number[ray]}
    else:
        columns |= {"ray": rays.number[ray], "launch_angle_deg": np.degrees(rays.launch_angle)[ray]}
    return pd.DataFrame(
        columns
        | {
            "travel_time_s": paths.travel_time,
            "range_m": np.hypot(step[:, 0], step[:, 1]),
            "north": paths.position[:, 0],
            "east": paths.position[:, 1],
            "depth": paths.position[:, 2],
            "boundary": _BOUNDARIES[paths.boundary],
        }
    )


def paths_dataset(rays: TracedRays) -> xr.Dataset:
    """Record of the paths, with each ray's link row and number in this row."""
    dataset = rays.paths.to_dataset()
    dataset["row"] = ("ray", rays.row, {"long_name": "row of the links, from 0"})
    dataset["number"] = (
        "ray",
        rays.number,
        {"long_name": "number of the ray within the row, from 0"},
    )
    if rays.launch_angle is not None:
        name = "angle from the horizontal at the source, positive down"
        dataset["launch_angle"] = ("ray", rays.launch_angle, {"units": "rad", "long_name": name})
    return dataset


def joined(fans: list[RayPaths], rays: int) -> RayPaths:
    """Concatenate paths of fans with equal numbers of rays."""
    return RayPaths.stack(
        [replace(fan, arrival=fan.arrival + i * rays) for i, fan in enumerate(fans)]
    )


def number_within(group: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of each row within its group."""
    return np.arange(group.size) - np.searchsorted(group, group)


def status_words(status: NDArray[np.int8]) -> list[str]:
    """Outcomes as text."""
    return [_WORDS[int(code)] for code in status]


def _beside(links: pd.DataFrame, added: pd.DataFrame) -> pd.DataFrame:
    """
    Append columns to those of the links; an input column of the same name is renamed to given_...
    """
    names: list[str] = []
    for name in links.columns:
        while name in added.columns or name in names:
            name = f"given_{name}"
        names.append(name)
    first = [name for name in ("row", "arrival") if name in added.columns]
    links = links.set_axis(names, axis=1).reset_index(drop=True)
    return pd.concat([added[first], links, added.drop(columns=first)], axis=1)


@dataclass(frozen=True, eq=False)
class Job:
    """One call of a command: its checked input, computation and output."""

    task: "TaskOptions"
    water: Water
    table: TextTable
    source: Array
    receiver: Array
    record: dict[str, Any]

    @property
    def medium(self) -> Medium:
        """Medium of the rays."""
        return self.water.at_start[0]

    def solve(self, cutoff_db: float | None = None) -> Arrivals:
        """
        Arrivals of all links, with the cut-off [dB] of the search or another one, and with currents
        if there are any.
        """
        reception = self.water.reception
        with output.progress_bars(
            quiet=self.task.printing.quiet or len(self.source) < _MIN_LINKS_FOR_BAR
        ) as report:
            arrivals = acoustics.find_eigenrays(
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
        flow = self.water.at_start[1]
        if flow is None:
            return arrivals
        return currents.carried(
            self.medium,
            self.source,
            self.receiver,
            arrivals,
            flow,
            tolerance=self.task.search.tolerance,
        )

    def trace(self) -> tuple[TracedRays, Arrivals]:
        """Paths of all arrivals, and the arrivals."""
        arrivals = self.solve()
        paths = acoustics.trace_paths(
            self.medium, self.source, self.receiver, arrivals, tolerance=self.task.search.tolerance
        )
        return TracedRays(paths, arrivals.link, number_within(arrivals.link)), arrivals

    def trace_fans(
        self, angles: Array, azimuth: float | None, distance: float | None
    ) -> TracedRays:
        """
        Fan from the source of every row, with an azimuth [degrees] and length [m], by default
        towards the receiver.
        """
        fans = []
        for line, source, (north, east, _) in zip(
            self.table.frame.index, self.source, self.receiver - self.source, strict=True
        ):
            try:
                fans.append(
                    acoustics.trace_fan(
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
        self, result: pd.DataFrame | xr.Dataset, found: Arrivals | None, **also: int
    ) -> None:
        """
        Write the result, and print the outcomes of the links, notes, and the name of the output.
        """
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
            notes = [*water_notes(self.water), *([] if found is None else found.incomplete_note())]
            printed.line(
                f"{counted(len(self.source), ends)}: {'; '.join(filter(None, (counts, more)))}",
                **{f"{ends}s": len(self.source), "outcomes": outcomes, **also},
            )
            printed.notes(notes)
            printed.paths(file=self.task.out)


def begin_job(command: str, task: "TaskOptions", *, receivers: bool = True) -> Job:
    """Read and check all input of a command before its computation."""
    output.check_output(
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
