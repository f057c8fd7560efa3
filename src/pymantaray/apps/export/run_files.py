"""Export of a run to the formats of other programs."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.acoustics import RayPaths, trace_paths
from pymantaray.apps.graphs.g2o import LEFT_OUT, write_g2o
from pymantaray.apps.study.graphs import noisy_graphs, write_graphs
from pymantaray.apps.study.mission import medium_of_run
from pymantaray.apps.study.store import Run, open_run
from pymantaray.errors import ExchangeError, StudyError, WriteError, optional_package
from pymantaray.estimation import CONDITIONS, GraphValues
from pymantaray.exchange.centre import ENU, NED, centre_attributes, write_sidecar
from pymantaray.exchange.cf import write_cf
from pymantaray.exchange.kitti import write_kitti
from pymantaray.exchange.maps import Feature, geojson, kml
from pymantaray.exchange.matlab import write_mat
from pymantaray.exchange.recording import FleetPoses, Recording, new_file
from pymantaray.exchange.rerun import write_rrd
from pymantaray.exchange.rosbag import write_bag
from pymantaray.exchange.tum import write_tum
from pymantaray.exchange.vtk import write_fleet, write_ranges, write_rays
from pymantaray.jobs.folder import staged_folder
from pymantaray.plotting.style import GREY, INK, LEVELS, condition_looks
from pymantaray.records import Arrivals, whole_file
from pymantaray.records.csv_text import csv_text
from pymantaray.records.status import TRUTH
from pymantaray.sensing.ranging import link_positions
from pymantaray.version import __version__

_SUFFIXES = {"s": "s", "m": "m", "degrees": "deg", "m s-1": "m_per_s"}


class Format(NamedTuple):
    """Writer of a realization; true if it writes a folder of files."""

    write: Callable[[Run, int, Path], None]
    folder: bool = True
    axes: str = ""
    """
    Axes in ``frame.json`` beside the files, which gives the frame's centre, because the format
    cannot; empty for no such file.
    """


def export_run(run: Run | str | Path, to: str, out: str | Path, *, realization: int = 0) -> Path:
    """
    Write one realization of a run in another program's format, atomically.

    Parameters
    ----------
    run : Run, str or pathlib.Path
        Folder of a run. For ``kml`` and ``geojson`` also ``location.json`` or its folder, or the
        file of an atlas.
    to : str
        Key of `FORMATS`.
    out : str or pathlib.Path
        A new or empty folder; for ``rrd``, ``mcap``, ``kml``, ``geojson`` and ``mat`` a file that
        does not exist.
    realization : int
        Index of the realization, from 0.

    Returns
    -------
    pathlib.Path
        The folder or file.

    Raises
    ------
    ExchangeError
        If the format does not exist, the run has no data for it, or its library is not installed.
    StudyError
        If the folder is not a run or does not have this realization.
    JobError
        If the folder for the results is not empty or in use.
    WriteError
        If the file exists or cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.study`:

    >>> from pymantaray.apps.export import export_run
    >>> sorted(path.name for path in export_run(run, "tum", "tum").iterdir())[:2]
    ['odometry-A.tum', 'odometry-B.tum']
    """
    if to not in FORMATS:
        raise ExchangeError(f"export: unknown format {to!r}; allowed: {', '.join(FORMATS)}")
    if to in MAPS and not isinstance(run, Run) and (found := source_features(Path(run))):
        with whole_file(out, replace=False) as temporary:
            temporary.write_text(MAPS[to](*found), encoding="utf-8")
        return Path(out)
    run = run if isinstance(run, Run) else open_run(run)
    count = run.study.realizations
    form = FORMATS[to]
    if not 0 <= realization < count:
        raise StudyError(f"realization {realization}: the run has 0 to {count - 1}")
    if form.folder:
        with staged_folder(out) as (stage, folder):
            try:
                form.write(run, realization, stage)
                if form.axes:
                    write_sidecar(stage, run.truth.centre, form.axes)
            except OSError as error:
                raise WriteError(
                    f"{folder}: cannot be written: {error.strerror or error}"
                ) from None
        return folder
    with whole_file(out, replace=False) as temporary:
        form.write(run, realization, temporary)
    return Path(out)


def record(run: Run, realization: int) -> Recording:
    """Data of one realization for other programs."""
    e = run.estimates
    estimates = {
        condition: FleetPoses(
            position, quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
        )
        for condition, position, quaternion in zip(
            e.condition.tolist(),
            e.position[:, realization],
            e.quaternion[:, realization].astype(float),  # stored with seven digits
            strict=True,
        )
        if np.isfinite(position).all()
    }
    name = f"{run.study.name}-{realization}"
    noisy = run.noisy_measurements(realization)
    return Recording(name, run.truth, estimates, noisy, run.measurements.landmark_position)


def _tum(run: Run, realization: int, folder: Path) -> None:
    for p in record(run, realization).poses:
        file = new_file(folder, p, ".tum")
        time = run.truth.time[p.samples]
        write_tum(file, time, p.position, p.quaternion, centre=run.truth.centre)


def _kitti(run: Run, realization: int, folder: Path) -> None:
    for p in record(run, realization).poses:
        if p.condition == TRUTH:
            times = new_file(folder, p._replace(condition="times"), ".txt")
            np.savetxt(times, run.truth.time[p.samples], fmt="%.17g")
        write_kitti(new_file(folder, p, ".txt"), p.position, p.quaternion)


def _frames(run: Run, realization: int) -> dict[str, pd.DataFrame]:
    """Data frames of a realization, with units in ``attrs``."""
    errors = run.errors()
    return {
        "trajectories": run.trajectories(realization),
        "ranges": run.ranges(realization),
        "errors": errors[errors["realization"] == realization].drop(columns="realization"),
    }


def _tables(run: Run, realization: int) -> dict[str, pd.DataFrame]:
    """Data frames of a realization, with units in the names of columns."""
    frames = _frames(run, realization)
    for frame in frames.values():
        units = frame.attrs.pop("units")
        suffixes = {name: _SUFFIXES[unit] for name, unit in units.items() if unit in _SUFFIXES}
        frame.columns = pd.Index([f"{n}_{suffixes[n]}" if n in suffixes else n for n in frame])
    return frames


def _recorded(
    write: Callable[[Recording, Path], object],
) -> Callable[[Run, int, Path], None]:
    """Writer of the data of one realization."""
    return lambda run, realization, path: write(record(run, realization), path)  # type: ignore[return-value]


def _csv(run: Run, realization: int, folder: Path) -> None:
    for name, frame in _tables(run, realization).items():
        (folder / f"{name}.csv").write_text(csv_text(frame), encoding="utf-8")


def _parquet(run: Run, realization: int, folder: Path) -> None:
    with optional_package(ExchangeError, "parquet", "pyarrow", "parquet"):
        import pyarrow.parquet  # noqa: F401
    for name, frame in _tables(run, realization).items():
        frame.to_parquet(folder / f"{name}.parquet", engine="pyarrow", index=False)


def _pyfg(run: Run, realization: int, folder: Path) -> None:
    _check_ranges(run)
    write_graphs(run, realization, folder)


def _g2o(run: Run, realization: int, folder: Path) -> None:
    """Poses and edges at the estimates; the format has nothing else."""
    _check_ranges(run)
    recording = record(run, realization)
    graphs = noisy_graphs(run, recording.measurements)
    solved = {name: poses for name, poses in recording.estimates.items() if name in graphs}
    if not solved:
        raise ExchangeError(
            f"{run.path}: every solve of realization {realization} with ranges failed; select"
            " another realization"
        )
    for name, (position, quaternion) in solved.items():
        values = GraphValues(
            position=position.reshape(-1, 3),
            quaternion=quaternion.reshape(-1, 4),
            landmark_position=recording.measurements.landmark_position,
        )
        write_g2o(graphs[name], folder / f"{name}.g2o", initial=values, leave_out=LEFT_OUT)


def _check_ranges(run: Run) -> None:
    ranging = [name for name, condition in CONDITIONS.items() if condition.ranges is not None]
    if not set(ranging) & {c.name for c in run.study.conditions}:
        raise ExchangeError(
            f"{run.path}: no condition of the study has ranges; a graph needs one of"
            f" {', '.join(ranging)}"
        )


def _mcap(run: Run, realization: int, file: Path) -> None:
    with TemporaryDirectory(dir=file.parent) as folder:
        write_bag(record(run, realization), Path(folder), mcap=True)
        shutil.move(next(Path(folder).glob("*.mcap")), file)


def _mat(run: Run, realization: int, file: Path) -> None:
    facts = {
        "name": run.study.name,
        "realization": realization,
        "axes": NED,
        "source": f"pymantaray {__version__}",
        **centre_attributes(run.truth.centre),
    }
    write_mat(_frames(run, realization), facts, file)


def _map(to: str) -> Callable[[Run, int, Path], None]:
    """Writer of a map in a format of `MAPS`."""

    def write(run: Run, realization: int, file: Path) -> None:
        recording = record(run, realization)
        file.write_text(MAPS[to](run_features(run, recording), recording.name), encoding="utf-8")

    return write


def _vtk(run: Run, realization: int, folder: Path) -> None:
    """Fleet, ranges and, if the water is available and the surface not rough, eigenrays."""
    recording = record(run, realization)
    write_fleet(recording, folder)
    write_ranges(recording, {c.name: c.ranges for c in run.study.conditions if c.ranges}, folder)
    paths = run_rays(run)
    if paths is not None:
        write_rays(paths, run.arrivals, run.truth.time[run.links.sample], folder)


def run_rays(run: Run) -> RayPaths | None:
    """
    Trace the arrivals of a run in the water at their pings; without reflections at a rough surface.

    None if there are none, or if the water varies and its files are missing or have changed.
    """
    water = medium_of_run(run)
    links = run.links
    arrivals = run.arrivals
    landmarks = run.measurements.landmark_position
    if water is None or not arrivals.link.size:
        return None
    source, receiver = (
        link_positions(run.truth, landmarks, links, end) for end in ("first", "second")
    )
    parts = []
    for sample in np.unique(links.sample[arrivals.link]).tolist():
        medium = water(float(run.truth.time[sample]))
        chosen = np.flatnonzero(links.sample == sample)
        rows = np.flatnonzero(links.sample[arrivals.link] == sample)
        if medium.surface.roughness is not None:
            rows = rows[arrivals.surface_bounces[rows] == 0]
        # arrivals of increasing links, in rows of these links
        own = {
            item.name: getattr(arrivals, item.name)[
                rows if item.metadata["dims"][0] == "arrival" else chosen
            ]
            for item in fields(Arrivals)
        }
        some = Arrivals(**own | {"link": np.searchsorted(chosen, own["link"])})
        paths = trace_paths(medium, source[chosen], receiver[chosen], some)
        parts.append(replace(paths, arrival=rows[paths.arrival]))
    return RayPaths.stack(parts)


MAPS: dict[str, Callable[[list[Feature], str], str]] = {
    "kml": kml,
    "geojson": lambda features, _name: geojson(features),
}
"""Text of features by format."""


def run_features(run: Run, recording: Recording) -> list[Feature]:
    """Paths of the vehicles under all conditions, and landmarks."""
    truth = recording.truth
    frame = truth.frame
    if frame is None:
        raise ExchangeError(
            f"{run.path}: the run has no geographic position; a map needs one: give `centre` in its"
            " study"
        )
    looks = condition_looks(list(recording.estimates))
    colours = {TRUTH: INK, **{name: colour for name, (colour, _) in looks.items()}}
    features = []
    for p in recording.poses:
        if not p.samples.size:
            continue
        time = truth.time[p.samples]
        span = None
        if not np.isnat(truth.start):
            since = np.round(time[[0, -1]] * 1e3).astype("m8[ms]")
            first, last = truth.start.astype("M8[ms]") + since
            span = f"{first}Z", f"{last}Z"
        latitude, longitude = frame.to_geodetic(*p.position[:, :2].T)
        features.append(
            Feature(
                "LineString" if np.ptp(p.position, axis=0).any() else "Point",
                np.column_stack([longitude, latitude, -p.position[:, 2], time]),
                {"name": p.vehicle, "condition": p.condition},
                p.condition,
                colours[p.condition],
                span,
            )
        )
    for name, (north, east, down) in zip(
        recording.measurements.landmark_name.tolist(), recording.landmarks.tolist(), strict=True
    ):
        latitude, longitude = frame.to_geodetic(north, east)
        place = np.array([[longitude, latitude, -down]])
        features.append(Feature("Point", place, {"name": name}, "landmarks", GREY))
    return features


def source_features(source: Path) -> tuple[list[Feature], str] | None:
    """
    Features and title of located nodes (``location.json`` or its folder) or of an atlas; None for
    another source.
    """
    from pymantaray.apps.locate.displacement import CAMPAIGN_FILE, read_campaign

    if source.suffix == ".json" or (source / CAMPAIGN_FILE).is_file():
        from pymantaray.apps.locate.write import campaign_features

        return campaign_features(read_campaign(source)), source.name
    if source.suffix == ".nc":
        from pymantaray.apps.atlas import open_atlas

        with open_atlas(source) as atlas:
            return list(_atlas_features(atlas)), str(atlas.attrs["title"])
    return None


def _atlas_features(atlas: xr.Dataset) -> Iterator[Feature]:
    """
    Cells of the atlas in the water, with the largest errors and the mean percentages of lost paths
    over all pairs and bearings, as in the table of the atlas; the colour is the largest error of
    the first convention at the middle distance, relative to that of the atlas.
    """
    from pymantaray.apps.atlas.dataset import (
        WATER as IN_WATER,
        largest_over_pairs,
        mean_lost_over_pairs,
    )

    worst = largest_over_pairs(atlas).values
    lost = mean_lost_over_pairs(atlas).values
    safe = atlas["safe_distance"].values
    conventions = [str(name) for name in atlas["convention"].values]
    distances = [f"{distance:g}m" for distance in atlas["distance"].values]
    shown = worst[..., 0, len(distances) // 2]
    largest = np.nanmax(shown, initial=np.finfo(float).tiny)
    lat_bounds, lon_bounds = atlas["lat_bounds"].values, atlas["lon_bounds"].values
    for t, i, j in np.argwhere(atlas["column_status"].values == IN_WATER).tolist():
        (south, north), (west, east) = lat_bounds[i], lon_bounds[j]
        ring = np.array([[west, south], [east, south], [east, north], [west, north]])
        place = f"{atlas['lat'].values[i]:.4f}, {atlas['lon'].values[j]:.4f}"
        properties = {"name": place}
        instant = atlas["time"].values[t]
        if not np.isnat(instant):
            properties["time_utc"] = f"{np.datetime_as_string(instant, unit='s')}Z"
        for c, convention in enumerate(conventions):
            for d, distance in enumerate(distances):
                properties[f"worst_range_error_{convention}_{distance}_m"] = worst[t, i, j, c, d]
            for s, limit in enumerate(atlas["safe"].values):
                properties[f"safe_distance_{convention}_{limit:g}m_m"] = safe[t, i, j, c, s]
        for d, distance in enumerate(distances):
            properties[f"mean_no_direct_path_{distance}_percent"] = lost[t, i, j, d]
        share = shown[t, i, j] / largest
        colour = (
            ("#" + "".join(f"{round(255 * part):02x}" for part in LEVELS(float(share))[:3]))
            if np.isfinite(share)
            else GREY
        )
        yield Feature("Polygon", ring, properties, properties.get("time_utc", "cells"), colour)


FORMATS = {
    "tum": Format(_tum),
    "kitti": Format(_kitti, axes=NED),
    "cf": Format(_recorded(write_cf)),
    "csv": Format(_csv, axes=NED),
    "parquet": Format(_parquet, axes=NED),
    "g2o": Format(_g2o, axes=NED),
    "pyfg": Format(_pyfg, axes=NED),
    "rrd": Format(_recorded(write_rrd), folder=False),
    "mcap": Format(_mcap, folder=False),
    "bag": Format(_recorded(write_bag)),
    "vtk": Format(_vtk, axes=ENU),
    **{to: Format(_map(to), folder=False) for to in MAPS},
    "mat": Format(_mat, folder=False),
}
