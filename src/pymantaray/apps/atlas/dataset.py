"""
File of an atlas: CF variables and attributes, and assembly from blocks, one in memory at a time.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.apps.atlas.links import CONVENTIONS, AtlasLinks
from pymantaray.apps.atlas.plan import Atlas
from pymantaray.errors import AtlasError
from pymantaray.records import NETCDF_LOCK, RayStatus, whole_file
from pymantaray.records.writing import CF_VERSION, check_room
from pymantaray.user_files import check_regular
from pymantaray.version import __version__

FORMAT = "pymantaray atlas 1"
WATER, LAND, EDGE = 0, 1, 2
"""Status of a column; `EDGE`: its links do not fit into the data."""
LocatedBlock = tuple[tuple[int, slice, slice], dict[str, NDArray[Any]]]
"""Position of a block in the atlas, and its variables."""
NOTES = "notes"
"""Notes of the readers of the water, in a block and in the file."""
_LINK = ("pair", "distance", "bearing")
_PLACE = ("time", "lat", "lon")
_SECOND = np.timedelta64(1, "s")
_EPOCH = np.datetime64("1970-01-01T00:00:00", "ns")


class AtlasVariable(NamedTuple):
    """One variable over the columns."""

    dims: tuple[str, ...]
    """Dimensions in addition to time, lat and lon."""
    dtype: str
    nothing: float
    """Value of columns on land or too close to the edge."""
    attrs: dict[str, Any]


def _length(name: str) -> dict[str, Any]:
    return {"long_name": name, "units": "m"}


def _flags(name: str, meanings: Iterable[tuple[str, int]]) -> dict[str, Any]:
    words, values = zip(*meanings, strict=True)
    return {
        "long_name": name,
        "flag_values": np.array(values, dtype="i1"),
        "flag_meanings": " ".join(words),
        "units": "1",
    }


_BY_CONVENTION = ("convention", *_LINK)
VARIABLES = {
    "column_status": AtlasVariable(
        (),
        "i1",
        EDGE,
        _flags("status of the column", (("water", WATER), ("land", LAND), ("edge", EDGE))),
    ),
    "range_error": AtlasVariable(
        _BY_CONVENTION,
        "f4",
        np.nan,
        _length("sound speed of the convention times travel time, minus distance"),
    ),
    "reference_speed_error": AtlasVariable(
        _BY_CONVENTION,
        "f4",
        np.nan,
        _length("part due to the reference speed: travel time along the chord"),
    ),
    "bending_error": AtlasVariable(
        _BY_CONVENTION,
        "f4",
        np.nan,
        _length("part due to bending: travel time minus time along the chord"),
    ),
    "link_status": AtlasVariable(
        _LINK,
        "i1",
        RayStatus.OUTSIDE,
        _flags(
            "outcome of the link, without reflections",
            ((s.name.lower(), s.value) for s in RayStatus),
        ),
    ),
    "arrivals_within": AtlasVariable(
        _LINK, "i2", 0, {"long_name": "arrivals close to the level of the strongest", "units": "1"}
    ),
    "no_direct_path": AtlasVariable(
        ("pair", "distance"),
        "f4",
        np.nan,
        {
            "long_name": "fraction of the bearings without a direct path, of those with a receiver"
            " in the water",
            "units": "1",
        },
    ),
    "worst_range_error": AtlasVariable(
        ("convention", "pair", "distance"),
        "f4",
        np.nan,
        _length("maximum magnitude of range_error over the bearings"),
    ),
    "safe_distance": AtlasVariable(
        ("convention", "safe"),
        "f4",
        np.nan,
        _length(
            "distance up to which every direct range error of all pairs and bearings is within safe"
        ),
    ),
}


def shape_of(variable: AtlasVariable, links: AtlasLinks) -> tuple[int, ...]:
    """Lengths of a variable's additional dimensions."""
    sizes = dict(zip(_LINK, links.shape, strict=True))
    sizes |= {"convention": len(CONVENTIONS), "safe": len(links.safe)}
    return tuple(sizes[name] for name in variable.dims)


def coordinates(atlas: Atlas) -> dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]:
    """Dimensions, values and attributes of all variables that are not over the columns."""
    links, (lat_bounds, lon_bounds) = atlas.links, atlas.cells()
    pairs = np.array(links.pairs)
    depth = {"standard_name": "depth", "units": "m", "positive": "down"}
    time = {
        "standard_name": "time",
        "axis": "T",
        "units": "seconds since 1970-01-01",
        "calendar": "standard",
    }
    north = {
        "standard_name": "latitude",
        "units": "degrees_north",
        "axis": "Y",
        "bounds": "lat_bounds",
    }
    east = {
        "standard_name": "longitude",
        "units": "degrees_east",
        "axis": "X",
        "bounds": "lon_bounds",
    }
    return {
        "time": (("time",), (atlas.times - _EPOCH) / _SECOND, time),
        "lat": (("lat",), atlas.lat, north),
        "lon": (("lon",), atlas.lon, east),
        "lat_bounds": (("lat", "bound"), lat_bounds, {}),
        "lon_bounds": (("lon", "bound"), lon_bounds, {}),
        "convention": (
            ("convention", "letter"),
            np.array(CONVENTIONS, dtype="S")[:, None].view("S1"),  # CF does not allow strings here
            {
                "long_name": "sound speed that converts a travel time to a range",
                "_Encoding": "utf-8",
            },
        ),
        "transmitter_depth": (
            ("pair",),
            pairs[:, 0],
            depth | {"long_name": "depth of the transmitter"},
        ),
        "receiver_depth": (("pair",), pairs[:, 1], depth | {"long_name": "depth of the receiver"}),
        "distance": (("distance",), np.array(links.distances), _length("horizontal distance")),
        "bearing": (
            ("bearing",),
            links.bearings_deg,
            {"long_name": "from transmitter to receiver, clockwise from north", "units": "degree"},
        ),
        "safe": (("safe",), np.array(links.safe), _length("threshold of the range error")),
    }


def attributes(atlas: Atlas, title: str, synthetic: bool) -> dict[str, Any]:
    """Global attributes of the file of an atlas."""
    links = atlas.links
    cutoff = "none" if links.spreading_cutoff_db is None else f"{links.spreading_cutoff_db:g} dB"
    return {
        "Conventions": CF_VERSION,
        "format": FORMAT,
        "atlas_key": atlas.key,
        "title": f"Bias of straight-line ranging: {title}",
        "ocean": title,
        "source": f"pymantaray {__version__}: eigenrays",
        "history": f"pymantaray {__version__}",
        "ocean_files": ", ".join(Path(name).name for name in atlas.checksums),
        "synthetic": int(synthetic),
        "nominal_sound_speed": links.nominal_sound_speed,
        "spreading_cutoff": cutoff,
        "arrivals_within_db": links.within_db,
        "max_surface_bounces": links.max_surface_bounces,
        "max_bottom_bounces": links.max_bottom_bounces,
        "interpolation": links.interpolation,
        "sound_speed_equation": atlas.ocean.equation,
        "comment": "range_error is reference_speed_error + bending_error; NaN where no direct"
        " arrival is admitted. The transmitter is at the column.",
    }


def write_atlas(
    atlas: Atlas,
    blocks: Iterable[LocatedBlock],
    path: Path,
    *,
    title: str,
    synthetic: bool,
) -> None:
    """Write the file of an atlas block by block, atomically."""
    cells = int(np.prod(atlas.shape))
    size = sum(
        np.dtype(v.dtype).itemsize * int(np.prod(shape_of(v, atlas.links)))
        for v in VARIABLES.values()
    )
    with whole_file(path) as temporary, NETCDF_LOCK:
        check_room(temporary, cells * size)  # uncompressed size
        try:
            _fill(temporary, atlas, attributes(atlas, title, synthetic), blocks)
        except RuntimeError as error:  # netCDF4 raises this for a full disk
            raise OSError(str(error)) from None


def _fill(path: Path, atlas: Atlas, attrs: dict[str, Any], blocks: Iterable[LocatedBlock]) -> None:
    from netCDF4 import Dataset

    _, rows, columns = atlas.blocks[0].place
    chunk = min(rows.stop, atlas.shape[1]), min(columns.stop, atlas.shape[2])
    with Dataset(path, "w", format="NETCDF4") as file:
        file.setncatts(attrs)
        for name, (dims, values, own) in coordinates(atlas).items():
            for dim, size in zip(dims, np.shape(values), strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            kind = "S1" if values.dtype.kind == "S" else "f8"
            variable = file.createVariable(name, kind, dims, fletcher32=True)
            variable.set_auto_chartostring(False)
            variable.setncatts(own)
            variable[:] = values
        for name, v in VARIABLES.items():
            variable = file.createVariable(
                name,
                v.dtype,
                (*_PLACE, *v.dims),
                compression="zlib",
                complevel=2,
                shuffle=True,
                chunksizes=(1, *chunk, *shape_of(v, atlas.links)),
                fill_value=np.float32(np.nan) if v.dtype == "f4" else False,
            )
            variable.setncatts(v.attrs)
            if "pair" in v.dims:
                variable.setncattr("coordinates", "transmitter_depth receiver_depth")
        notes: dict[str, None] = {}
        for (time, rows, columns), arrays in blocks:
            notes |= dict.fromkeys(arrays[NOTES].tolist())
            for name in VARIABLES:
                file[name][time, rows, columns] = arrays[name]
        file.setncattr(NOTES, "\n".join(notes))


def open_atlas(path: str | Path) -> xr.Dataset:
    """
    Open the file of an atlas lazily, after reading each of its variables once.

    Parameters
    ----------
    path : str or pathlib.Path
        File from `run_atlas`.

    Returns
    -------
    xarray.Dataset
        Variables over time, lat, lon and further dimensions. The caller closes it.

    Raises
    ------
    AtlasError
        If the file is not an atlas, or is damaged.

    Examples
    --------
    Continues the example of `pymantaray.apps.atlas`:

    >>> from pymantaray.apps.atlas import open_atlas
    >>> atlas.to_netcdf("copy.nc")
    >>> with open_atlas("copy.nc") as file:
    ...     print(round(float(file["worst_range_error"].max()), 1))
    103.1
    """
    check_regular(path, AtlasError, what="an atlas")
    try:
        dataset = xr.open_dataset(path, engine="netcdf4")
    except Exception as error:  # noqa: BLE001  xarray raises many types for damaged data
        reason = (isinstance(error, OSError) and error.strerror) or str(error).partition("\n")[0]
        raise AtlasError(f"{path}: not a readable NetCDF file: {reason}") from None
    if dataset.attrs.get("format") != FORMAT:
        dataset.close()
        raise AtlasError(
            f"{path}: not an atlas of this version; compute one with mantaray atlas run (in"
            " Python: run_atlas)"
        )
    try:
        for name in dict.fromkeys((*VARIABLES, *dataset.variables)):
            variable = dataset.variables[name]
            if variable.dims[:1] == _PLACE[:1]:
                for instant in range(variable.shape[0]):
                    _ = variable[instant].values
            else:
                _ = variable.values
    except Exception as error:  # noqa: BLE001  netCDF4 and xarray raise many types
        dataset.close()
        raise AtlasError(
            f"{path}: damaged: {name} cannot be read ({type(error).__name__}); restore it from a"
            " copy, or compute the atlas again"
        ) from None
    return dataset


def notes_of(atlas: xr.Dataset) -> list[str]:
    """Notes of the readers of the water of an atlas."""
    return str(atlas.attrs.get(NOTES, "")).splitlines()


def largest_over_pairs(atlas: xr.Dataset) -> xr.DataArray:
    """Largest range error over pairs and bearings, NaN without any direct path. [m]"""
    return atlas["worst_range_error"].max("pair")


def mean_lost_over_pairs(atlas: xr.Dataset) -> xr.DataArray:
    """Mean percentage over the pairs in the water of links without a direct path."""
    return 100.0 * atlas["no_direct_path"].astype(float).mean("pair")


def safety_table(atlas: xr.Dataset) -> pd.DataFrame:
    """
    Table of range errors and of the fraction of locations that are safe for straight-line ranging.

    Parameters
    ----------
    atlas : xarray.Dataset
        From `open_atlas`.

    Returns
    -------
    pandas.DataFrame
        One row per convention and distance: ``convention``, ``distance_m``,
        ``no_direct_path_percent``, ``median_m`` and ``p95_m`` of the maximum error of a location
        (over pairs and bearings), and for each threshold ``safe_to_<error>m_percent``, the
        percentage of locations and times in the water where every direct range error is within the
        threshold.

    Examples
    --------
    Continues the example of `pymantaray.apps.atlas`:

    >>> from pymantaray.apps.atlas import safety_table
    >>> table = safety_table(atlas).round(1)
    >>> table[["convention", "distance_m", "median_m"]].head(2)
        convention  distance_m  median_m
    0  transmitter      1000.0       0.9
    1  transmitter      3000.0       3.0
    """
    rows = []
    water = (atlas["column_status"] == WATER).values
    # a pair counts at each place where it is in the water
    lost = atlas["no_direct_path"].values[water]  # place, pair, distance
    worst = largest_over_pairs(atlas).values[water]  # place, convention, distance
    for c, convention in enumerate(atlas["convention"].values):
        for d, distance in enumerate(atlas["distance"].values):
            place = worst[:, c, d]
            place = place[np.isfinite(place)]
            share = {
                f"safe_to_{safe:g}m_percent": 100.0 * float(np.mean(place <= safe))
                if place.size
                else np.nan
                for safe in atlas["safe"].values
            }
            known = lost[:, :, d][np.isfinite(lost[:, :, d])]
            rows.append(
                {
                    "convention": str(convention),
                    "distance_m": float(distance),
                    "no_direct_path_percent": 100.0 * float(known.mean()) if known.size else np.nan,
                    "median_m": float(np.median(place)) if place.size else np.nan,
                    "p95_m": float(np.percentile(place, 95)) if place.size else np.nan,
                    **share,
                }
            )
    return pd.DataFrame(rows)
