"""What the solver found as the tables that `mantaray rays` writes."""

from dataclasses import fields
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import choose_arrivals
from pymantaray.cli.rays_io import RECEIVER, SOURCE
from pymantaray.records import Arrivals, RayPaths, RayStatus
from pymantaray.records.base import Record

Array = NDArray[np.float64]
R = TypeVar("R", bound=Record)
_BOUNDARIES = np.array(["water", "surface", "bottom"])
_WORDS = {int(status): status.name.lower() for status in RayStatus}


class TracedRays(NamedTuple):
    """Paths of rays; the row of the links and the number within it that each ray has; of a fan, its launch angle."""

    paths: RayPaths
    row: NDArray[np.int64]
    number: NDArray[np.int64]
    launch_angle: Array | None = None


def times_table(links: pd.DataFrame, source: Array, receiver: Array, arrivals: Arrivals) -> pd.DataFrame:
    """
    One row a link: the columns it came with and its earliest arrival.

    Parameters
    ----------
    links : pandas.DataFrame
        As text.
    source, receiver : ndarray, shape (n_links, 3)
        [m]
    arrivals : Arrivals

    Returns
    -------
    pandas.DataFrame
        A column of the links that has the name of an added one is called ``given_...``.
    """
    link, row = choose_arrivals(arrivals, "first")
    time = _scattered(len(links), link, arrivals.travel_time[row])
    angle = _scattered(len(links), link, arrivals.launch_angle[row])
    added = pd.DataFrame(
        {
            "status": status_words(arrivals.status),
            "travel_time_s": time,
            "straight_range_m": np.linalg.norm(receiver - source, axis=-1),
            "refracted_range_m": arrivals.source_sound_speed * time,
            "chord_travel_time_s": arrivals.chord_travel_time,
            "source_sound_speed_m_s": arrivals.source_sound_speed,
            "receiver_sound_speed_m_s": arrivals.receiver_sound_speed,
            "surface_bounces": _whole(_scattered(len(links), link, arrivals.surface_bounces[row])),
            "bottom_bounces": _whole(_scattered(len(links), link, arrivals.bottom_bounces[row])),
            "launch_angle_deg": np.degrees(angle),
            "shadow_margin_m": arrivals.shadow_margin,
        }
    )
    return _beside(links, added)


def arrivals_table(links: pd.DataFrame, arrivals: Arrivals) -> pd.DataFrame:
    """
    One row an arrival, with the columns beyond the coordinates that its link came with.

    Parameters
    ----------
    links : pandas.DataFrame
        As text.
    arrivals : Arrivals

    Returns
    -------
    pandas.DataFrame
        A column of the links that has the name of an added one is called ``given_...``.
    """
    own = links.drop(columns=[*SOURCE, *RECEIVER]).iloc[arrivals.link].reset_index(drop=True)
    added = pd.DataFrame(
        {
            "row": arrivals.link,
            "arrival": number_within(arrivals.link),
            "travel_time_s": arrivals.travel_time,
            "surface_bounces": arrivals.surface_bounces,
            "bottom_bounces": arrivals.bottom_bounces,
            "turning_points": arrivals.turning_points,
            "launch_angle_deg": np.degrees(arrivals.launch_angle),
            "arrival_angle_deg": np.degrees(arrivals.arrival_angle),
            "spreading_db": arrivals.spreading_db,
        }
    )
    for end, slowness in (("source", arrivals.source_slowness), ("receiver", arrivals.receiver_slowness)):
        for k, axis in enumerate(("north", "east", "down")):
            added[f"{end}_slowness_{axis}_s_m"] = slowness[:, k] + 0.0  # no -0
    return _beside(own, added)


def paths_table(rays: TracedRays) -> pd.DataFrame:
    """
    One row a node.

    Parameters
    ----------
    rays : TracedRays

    Returns
    -------
    pandas.DataFrame
    """
    paths, ray = rays.paths, rays.paths.arrival
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
    """
    Record of the paths, with the row of the links and the number within it of each ray.

    Parameters
    ----------
    rays : TracedRays

    Returns
    -------
    xarray.Dataset
        `RayPaths.load` reads it from a file.
    """
    dataset = rays.paths.to_dataset()
    dataset["row"] = ("ray", rays.row, {"long_name": "row of the links, from 0"})
    dataset["number"] = ("ray", rays.number, {"long_name": "number of the ray within the row, from 0"})
    if rays.launch_angle is not None:
        name = "angle from the horizontal at the source, positive down"
        dataset["launch_angle"] = ("ray", rays.launch_angle, {"units": "rad", "long_name": name})
    return dataset


def joined(parts: list[R], offsets: list[int], counter: str) -> R:
    """
    Records one after the other.

    Parameters
    ----------
    parts : list of Record
        At least one, of one kind.
    offsets : list of int
        Added to the column ``counter`` of each part.
    counter : str
        Name of the column that counts links or arrivals.

    Returns
    -------
    Record
    """
    columns = {}
    for name in (f.name for f in fields(parts[0]) if "dims" in f.metadata):
        arrays = [getattr(part, name) for part in parts]
        if name == counter:
            arrays = [array + offset for array, offset in zip(arrays, offsets, strict=True)]
        columns[name] = np.concatenate(arrays)
    return type(parts[0])(**columns)


def number_within(group: NDArray[np.int64]) -> NDArray[np.int64]:
    """
    Number of each row within its group.

    Parameters
    ----------
    group : ndarray of int, shape (n,)
        Not decreasing.

    Returns
    -------
    ndarray of int, shape (n,)
        From 0.
    """
    return np.arange(group.size) - np.searchsorted(group, group)


def status_words(status: NDArray[np.int8]) -> list[str]:
    """
    Outcomes in words.

    Parameters
    ----------
    status : ndarray of int, shape (n_links,)
        RayStatus.

    Returns
    -------
    list of str
    """
    return [_WORDS[int(code)] for code in status]


def _scattered(n: int, rows: NDArray[np.int64], values: Array) -> Array:
    out = np.full(n, np.nan)
    out[rows] = values
    return out


def _whole(values: Array) -> "pd.Series[int]":
    return pd.Series(values).astype("Int64")


def _beside(links: pd.DataFrame, added: pd.DataFrame) -> pd.DataFrame:
    """Put added columns behind those of the links, after the numbers; one of the same name becomes given_..."""
    names: list[str] = []
    for name in links.columns:
        while name in added.columns or name in names:
            name = f"given_{name}"
        names.append(name)
    first = [name for name in ("row", "arrival") if name in added.columns]
    return pd.concat([added[first], links.set_axis(names, axis=1), added.drop(columns=first)], axis=1)
