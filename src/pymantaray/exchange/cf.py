"""
Reader and writer of CF trajectories (discrete sampling geometry) of gliders, floats and drifters.

Layouts follow CF conventions 1.11, chapter 9 and appendix H.4: one trajectory, contiguous and
indexed ragged arrays, incomplete and orthogonal multidimensional arrays. Glider files of
OceanGliders (OG1), IMOS and EGO are single trajectories. So are Argo's trajectory files (user's
manual, doi:10.13155/29825), with positions at the surface and pressures between.
"""

from pathlib import Path
from typing import Any

import gsw
import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from pymantaray.arrays import AnyArray, Array, Indices, Instants
from pymantaray.errors import ExchangeError, OceanError
from pymantaray.exchange.centre import centre_attributes, centre_of_names
from pymantaray.exchange.recording import Recording, VehiclePoses
from pymantaray.exchange.tracks import Poses, geodetic, level
from pymantaray.ocean.cf_profiles import instance_of_rows, labels_of, without_bad_flags
from pymantaray.ocean.convert import decoded_times, to_our_unit
from pymantaray.ocean.files import reading, text
from pymantaray.records import write_netcdf
from pymantaray.records.dates import seconds_since
from pymantaray.records.position_rows import PositionRows

_QUANTITIES = {
    "time": ("time",),
    "latitude": ("latitude",),
    "longitude": ("longitude",),
    "depth": ("depth",),
    "pressure": ("sea_water_pressure", "sea_water_pressure_due_to_sea_water"),
    "heading": ("platform_orientation",),
    "pitch": ("platform_pitch_fore_up", "platform_pitch"),
    "roll": ("platform_roll_starboard_down", "platform_roll"),
}
_PERIODS = (None, 360.0, None, 2.0 * np.pi, 2.0 * np.pi, 2.0 * np.pi)
"""Decimals of latitude, longitude, depth, heading, pitch and roll."""
_FILL = 99_999.0  # fill value of Argo, also if it is not declared


def read_cf(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Read the trajectories of a CF data set, and notes about omitted data; missing positions are
    interpolated in time.
    """
    try:
        with reading(path) as data:
            return _TrajectoryReader(data, path).read()
    except OceanError as error:
        raise ExchangeError(
            f"{path}: {str(error).removeprefix(f'{path}: ').removeprefix(f'{path.name}: ')}"
        ) from None


class _TrajectoryReader:
    """Reader of one file, which identifies variables by their meaning."""

    def __init__(self, data: xr.Dataset, path: Path) -> None:
        self._data, self._path, self._notes = data, path, list[str]()
        self._centre = centre_of_names(data.attrs, path)
        self._names = {quantity: self._candidates(quantity) for quantity in _QUANTITIES}
        for needed in ("time", "latitude", "longitude"):
            if not self._names[needed]:
                raise ExchangeError(
                    f"{path}: no variable with standard_name {needed}; a trajectory needs time,"
                    " latitude and longitude"
                )

    def read(self) -> tuple[list[Poses], list[str]]:
        """Read all trajectories of the file."""
        names = self._chosen()
        time = self._values(names["time"])
        lat, lon = (self._degrees(names[axis], axis) for axis in ("latitude", "longitude"))
        shape = np.broadcast_shapes(time.shape, lat.shape)
        down, is_pressure = self._down(names, shape)
        columns = [
            np.broadcast_to(v, shape) for v in (time, lat, lon, down, *self._angles(names, shape))
        ]
        poses = []
        for name, rows in self._trajectories(names["latitude"], shape):
            p = self._poses(name, names["time"], *(c[rows] for c in columns))
            if p is None:
                continue
            if is_pressure:
                with np.errstate(all="ignore"):  # of impossible pressures, which are refused later
                    p.place[:, 2] = -gsw.z_from_p(p.place[:, 2], p.place[:, 0])
            poses.append(p)
        if not poses:
            raise ExchangeError(f"{self._path}: no trajectory with two valid positions and times")
        return poses, self._notes

    def _candidates(self, quantity: str) -> list[str]:
        """
        Variables of a quantity by standard name, or by unit, axis and direction as in cf-xarray.
        """
        import cf_xarray  # noqa: F401  registers the accessor

        data = self._data.set_coords(
            [str(n) for n, v in self._data.variables.items() if v.ndim < 3]
        )
        named = data.cf.standard_names
        names = [str(n) for standard in _QUANTITIES[quantity] for n in named.get(standard, [])]
        if quantity in ("time", "latitude", "longitude"):
            names += [str(n) for n in data.cf.coordinates.get(quantity, [])]
        return [n for n in dict.fromkeys(names) if self._data.variables[n].dtype.kind in "biuf"]

    def _chosen(self) -> dict[str, str]:
        """
        Variable of each quantity: on the longest common dimension, and with the shortest name among
        several.
        """
        variables = self._data.variables
        for dim, _ in sorted(self._data.sizes.items(), key=lambda item: -item[1]):
            names = {
                quantity: min(those, key=lambda n: (-variables[n].ndim, len(n)))
                for quantity, names in self._names.items()
                if (those := [n for n in names if dim in variables[n].dims])
            }
            if {"time", "latitude", "longitude"} <= set(names):
                return names
        raise ExchangeError(
            f"{self._path}: time, latitude and longitude have no common dimension; a trajectory"
            " needs one"
        )

    def _values(self, name: str) -> Array:
        """Numbers of a variable; NaN if missing or flagged as bad."""
        values, bad = without_bad_flags(self._data, name)
        if bad:
            self._notes.append(f"{self._path}: {bad} values of {name} rejected by quality flags")
        return values

    def _degrees(self, name: str, axis: str) -> Array:
        """Latitudes or longitudes, from degrees or radians. [degrees]"""
        values = self._values(name)
        unit = text(self._data.variables[name], "units")
        return to_our_unit(values, axis, unit, where=f"{self._path}: {name}") if unit else values

    def _down(self, names: dict[str, str], shape: tuple[int, ...]) -> tuple[Array, bool]:
        """
        Depths, positive down [m], or pressures [dbar], and True for pressures; 0 if the file has
        neither.
        """
        for quantity, kind, unit in (("depth", "length", "m"), ("pressure", "pressure", "dbar")):
            if quantity not in names:
                continue
            variable = self._data.variables[names[quantity]]
            down = to_our_unit(
                self._values(names[quantity]),
                kind,
                text(variable, "units") or unit,
                where=str(self._path),
            )
            if np.isfinite(down).any():
                if quantity == "pressure":
                    self._notes.append(f"{self._path}: depth from {names[quantity]} by TEOS-10")
                return (
                    -down if text(variable, "positive").lower() == "up" else down
                ), quantity == "pressure"
        self._notes.append(f"{self._path}: no depth and no pressure; depth set to the surface")
        return np.zeros(shape), False

    def _angles(self, names: dict[str, str], shape: tuple[int, ...]) -> list[Array]:
        """
        Heading, pitch and roll, with missing pitch and roll set to 0; empty without a heading.
        [rad]
        """
        if "heading" not in names:
            return []
        angles = [np.zeros(shape)] * 3
        for k, quantity in enumerate(("heading", "pitch", "roll")):
            if quantity in names:
                values = self._values(names[quantity])
                if not np.isfinite(values).any():
                    return []
                in_radians = (
                    text(self._data.variables[names[quantity]], "units").lower().startswith("rad")
                )
                angles[k] = values if in_radians else np.radians(values)
        return angles

    def _trajectories(self, lat: str, shape: tuple[int, ...]) -> list[tuple[str, Any]]:
        """Name and indices of each trajectory."""
        dims = tuple(map(str, self._data.variables[lat].dims))
        ids = self._identifiers()
        if len(shape) == 2:
            return [(self._name(ids, k), (k, slice(None))) for k in range(shape[0])]
        of_row = instance_of_rows(self._data, dims[0], self._path)
        if of_row is None:
            if ids is not None and ids.shape == shape and shape[0] > 1:  # one identifier per row
                return [
                    (str(one), np.flatnonzero(ids == one)) for one in dict.fromkeys(ids.tolist())
                ]
            return [(self._name(ids, 0), slice(None))]
        return [
            (self._name(ids, int(k)), np.flatnonzero(of_row == k))
            for k in np.unique(of_row[of_row >= 0])
        ]

    def _identifiers(self) -> AnyArray | None:
        """Names of the trajectories in the file."""
        variables = self._data.variables
        roles = [v for v in variables.values() if v.attrs.get("cf_role") == "trajectory_id"]
        usual = ("PLATFORM_NUMBER", "TRAJECTORY", "trajectory")
        known = [*roles, *(variables[name] for name in usual if name in variables)]
        return labels_of(known[0]) if known else None

    def _name(self, ids: AnyArray | None, k: int) -> str:
        if ids is None or k >= ids.size or not ids[k]:
            return self._path.stem if k == 0 else f"{self._path.stem}_{k}"
        return str(ids[k])

    def _poses(self, name: str, time: str, instants: Array, *columns: Array) -> Poses | None:
        """
        Make one trajectory from positions and angles; drop rows without a time and interpolate
        gaps.
        """
        timed = np.isfinite(instants) & (np.abs(instants) < 1e15)
        order = np.flatnonzero(timed)[np.argsort(instants[timed], kind="stable")]
        seconds = instants[order]
        columns = self._possible(name, time, (order, seconds), columns)
        within = np.ones(order.size, dtype=bool)
        whole = []
        for values, period in zip(columns, _PERIODS, strict=False):
            column = values[order]
            known = np.isfinite(column) & (np.abs(column) < _FILL)
            if not known.any():
                return None
            at = seconds[known]
            own = column[known]
            whole.append(
                np.interp(seconds, at, own if period is None else np.unwrap(own, period=period))
            )
            if len(whole) <= 3:  # position, not angles
                within &= (seconds >= at[0]) & (seconds <= at[-1])
        if np.count_nonzero(within) < 2:
            return None
        left = instants.size - np.count_nonzero(within)
        if left:
            self._notes.append(
                f"{self._path}: {name}: {left} of {instants.size} rows dropped: no time, or"
                " outside the valid positions"
            )
        dates = self._dates(seconds[within], time)
        lines = [column[within] for column in whole]
        attitude = level(*lines[3:]) if lines[3:] else None
        return Poses(
            name, dates, np.column_stack(lines[:3]), attitude, True, str(self._path), self._centre
        )

    def _possible(
        self,
        name: str,
        time: str,
        timed: tuple[Indices, Array],
        columns: tuple[Array, ...],
    ) -> tuple[Array, ...]:
        """Columns without impossible positions, which the rows at some times [s] then lack."""
        order, seconds = timed
        lat, lon, *others = (np.array(column, dtype=float) for column in columns)
        known = np.isfinite(lat[order] + lon[order])
        known &= (np.abs(lat[order]) < _FILL) & (np.abs(lon[order]) < _FILL)
        rows = order[known]
        if not rows.size:
            return columns
        dates = self._dates(seconds[known], time)
        positions = PositionRows(self._path, ExchangeError, noun="row")
        keep = positions.possible(
            seconds_since(dates, dates[0]),
            np.column_stack([lat[rows], lon[rows]]),
            rows,
            geographic=True,
            who=name,
            stated_degrees=bool(text(self._data.variables[self._names["latitude"][0]], "units")),
        )
        positions.refuse_most(int(keep.sum()))
        self._notes += positions.notes
        lat[rows[~keep]] = np.nan
        lon[rows[~keep]] = np.nan
        return (lat, lon, *others)

    def _dates(self, times: Array, name: str) -> Instants:
        """Dates of times in the unit of their variable."""
        variable = self._data.variables[name]
        unit = text(variable, "units")
        if " since " not in unit:
            raise ExchangeError(
                f"{self._path}: {name} has units {unit!r}; it needs units such as 'seconds since"
                " 1970-01-01'"
            )
        return decoded_times(times, unit, text(variable, "calendar"), where=f"{self._path}: {name}")


_VARIABLES = {
    "time": "time",
    "latitude": "latitude",
    "longitude": "longitude",
    "depth": "depth",
    "heading": "platform_orientation",
    "pitch": "platform_pitch_fore_up",
    "roll": "platform_roll_starboard_down",
}
"""Variables in exported files, and their standard names."""
_UNITS = {"latitude": "degrees_north", "longitude": "degrees_east", "depth": "m"}


def write_cf(recording: Recording, folder: Path) -> None:
    """
    Write the poses of each condition as a CF data set of trajectories (incomplete multidimensional
    arrays), one file each.

    Attitudes are relative to true north. The trajectory of a vehicle that is not present all the
    time is shorter.

    Raises
    ------
    ExchangeError
        If the mission has no date, or its frame no geographic position.
    """
    truth = recording.truth
    if np.isnat(truth.start) or truth.frame is None:
        raise ExchangeError(
            f"{recording.name}: the run has no date or no geographic position, which CF"
            " trajectories need"
        )
    # poses of each condition
    units = {**_UNITS, "time": f"seconds since {np.datetime_as_string(truth.start)}"}
    files: dict[str, list[VehiclePoses]] = {}
    for p in recording.poses:
        files.setdefault(p.condition, []).append(p)
    for condition, fleet in files.items():
        # columns by vehicle; NaN where a trajectory is shorter
        columns = np.full((len(_VARIABLES), len(fleet), max(p.samples.size for p in fleet)), np.nan)
        for k, p in enumerate(fleet):
            local = Poses(
                p.vehicle, truth.time[p.samples], p.position, p.quaternion, False, recording.name
            )
            placed = geodetic(local, truth.frame)
            turn = Rotation.from_quat(np.asarray(placed.quaternion), scalar_first=True).as_euler(
                "ZYX", degrees=True
            )
            columns[:, k, : p.samples.size] = np.column_stack(
                [placed.time, placed.place, turn[:, 0] % 360.0, turn[:, 1:]]
            ).T
        # data set with attributes of CF
        data = xr.Dataset(
            {
                "trajectory": (
                    "trajectory",
                    [p.vehicle for p in fleet],
                    {"cf_role": "trajectory_id"},
                )
            },
            attrs={
                "title": f"{recording.name}: {condition}",
                "featureType": "trajectory",
                **centre_attributes(truth.centre),
            },
        )
        data["trajectory"].encoding["dtype"] = "S1"
        for (name, standard), values in zip(_VARIABLES.items(), columns, strict=True):
            attrs = {"standard_name": standard, "units": units.get(name, "degrees")}
            data[name] = ("trajectory", "obs"), values, attrs
        data["time"].attrs |= {"calendar": "standard", "units_metadata": "leap_seconds: none"}
        data["depth"].attrs |= {"positive": "down", "axis": "Z"}
        write_netcdf(
            data.set_coords(["time", "latitude", "longitude", "depth"]), folder / f"{condition}.nc"
        )
