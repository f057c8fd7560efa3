"""Files that together are an ocean: their times, and the valid ocean at one of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean import cf
from pymantaray.ocean.conversion import levels
from pymantaray.ocean.files import StoredFile, open_stored
from pymantaray.ocean.grid import GeographicWindow, Selection, select
from pymantaray.ocean.hdf5 import Hdf5Process
from pymantaray.ocean.hycom import SAME_DEGREES, without_scaled_fill
from pymantaray.ocean.schema import VARIABLES
from pymantaray.ocean.times import Instants, instants

Array = NDArray[np.float64]
Currents = Literal["required", "rest"]
_ROLES = tuple(v.name for v in VARIABLES)


@dataclass(frozen=True)
class Part:
    """One file: what is in it and which of it the window takes."""

    file: StoredFile
    layout: cf.Layout
    times: Instants
    grid: Selection
    levels: Array
    """Rising. [m] or [dbar]"""
    upward: bool
    """Whether levels fall in the file."""
    is_pressure: bool

    def field(self, role: str) -> cf.Field | None:
        """Variable of a role, if the file has it."""
        return next((f for f in self.layout.fields if f.role == role), None)

    def read(self, field: cf.Field, instant: np.datetime64) -> Array:
        """
        Values of a variable at an instant.

        Parameters
        ----------
        field : cf.Field
        instant : numpy.datetime64
            One of the file's.

        Returns
        -------
        ndarray, shape (depth, lat, lon)
            In the unit of the file; NaN where missing.
        """
        file, layout = self.file, self.layout
        stored = file.variables[field.variable]
        lat, lon, depth = (file.variables[n].dims[0] for n in (layout.lat, layout.lon, layout.depth))
        wanted = {lat: self.grid.rows}
        time = file.variables[layout.time].dims
        if time:
            i = int(np.flatnonzero(self.times == instant)[0])
            wanted[time[0]] = slice(i, i + 1)
        axis = stored.dims.index(lon)
        blocks = [file.values(field.variable, {**wanted, lon: block}) for block in self.grid.blocks]
        whole = blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=axis)
        whole = np.moveaxis(whole, [stored.dims.index(d) for d in (depth, lat, lon)], (-3, -2, -1))
        whole = whole.reshape(whole.shape[-3:])  # what is left has one element
        if self.upward:
            whole = whole[::-1]
        if self.grid.falling:
            whole = whole[:, ::-1]
        if not np.array_equal(self.grid.order, np.arange(whole.shape[-1])):
            whole = whole[..., self.grid.order]
        return without_scaled_fill(field.variable, np.ascontiguousarray(whole))


class Collection:
    """
    Files that together hold an ocean.

    Parameters
    ----------
    paths : sequence of str or Path
    window : tuple of float, optional
        South, north, west, east. [degrees]

    Raises
    ------
    OceanError
        If a file is missing, damaged or not of an ocean.
    """

    def __init__(self, paths: Sequence[str | Path], window: GeographicWindow | None = None) -> None:
        if not paths:
            raise OceanError("ocean: no file given; name at least one NetCDF file")
        self._reader = Hdf5Process()
        try:
            self.parts = [_part(path, window, self._reader) for path in paths]
            self._require(_ROLES[:2])
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process that reads NetCDF-4."""
        self._reader.close()

    @property
    def names(self) -> str:
        """Names of the files, for messages."""
        names = [part.file.name for part in self.parts]
        return ", ".join(names if len(names) < 5 else [*names[:3], f"... {names[-1]}"])

    def times(self) -> Instants:
        """
        All instants that a file has.

        Returns
        -------
        ndarray of datetime64, shape (time,)
            Rising.
        """
        return np.unique(np.concatenate([part.times for part in self.parts]))

    def whole_times(self, currents: Currents) -> Instants:
        """
        Instants at which everything is there.

        Parameters
        ----------
        currents : {"required", "rest"}

        Returns
        -------
        ndarray of datetime64, shape (time,)
            Rising.
        """
        found = self.times()
        for role in self.needed(currents):
            found = np.intersect1d(found, np.concatenate([p.times for p in self.parts if p.field(role)]))
        return found

    def needed(self, currents: Currents) -> tuple[str, ...]:
        """
        Variables that must be there.

        Parameters
        ----------
        currents : {"required", "rest"}
            At rest, currents are needed only where a file has one of them.

        Returns
        -------
        tuple of str

        Raises
        ------
        OceanError
            If no file has one of them.
        """
        if currents not in ("required", "rest"):
            raise OceanError(f"currents is {currents!r}; allowed are 'required' and 'rest'")
        absent = [r for r in _ROLES[2:] if not any(p.field(r) for p in self.parts)]
        if not absent:
            return _ROLES
        if currents == "required" or len(absent) == 1:
            raise self._lacks(absent)
        return _ROLES[:2]

    def at(self, instant: np.datetime64, roles: Sequence[str]) -> dict[str, tuple[Part, cf.Field]]:
        """
        Where each variable is found at an instant.

        Parameters
        ----------
        instant : numpy.datetime64
        roles : sequence of str

        Returns
        -------
        dict of str to (Part, cf.Field)

        Raises
        ------
        OceanError
            If one is missing then, or the files disagree on the grid.
        """
        found: dict[str, tuple[Part, cf.Field]] = {}
        for part in self.parts:
            if instant not in part.times:
                continue
            for role in roles:
                field = part.field(role)
                if field is not None and role not in found:
                    found[role] = (part, field)
                    _check_same_grid(part, role, *next(iter(found.items())))
        absent = [r for r in roles if r not in found]
        if absent:
            raise OceanError(f"{self.names}: no {' and no '.join(absent)} at {instant}; choose another time")
        return found

    def _require(self, roles: Sequence[str]) -> None:
        missing = [r for r in roles if not any(p.field(r) for p in self.parts)]
        if missing:
            raise self._lacks(missing)

    def _lacks(self, roles: Sequence[str]) -> OceanError:
        relative = [n for p in self.parts for n in p.layout.grid_relative]
        rest = 'or open it with currents="rest" for water at rest'
        if relative and set(roles) <= set(_ROLES[2:]):
            return OceanError(f"{self.names}: {cf.grid_relative_refusal(relative)}, {rest}")
        line = (
            f"{self.names}: no {' and no '.join(roles)}; an ocean needs water_temp, salinity, water_u and"
            " water_v, or their CF standard names (HYCOM's ts3z and uv3z files together)"
        )
        return OceanError(line + (f", {rest}" if list(roles) == list(_ROLES[2:]) else ""))


def _part(path: str | Path, window: GeographicWindow | None, reader: Hdf5Process) -> Part:
    try:
        return _part_of(open_stored(path, reader), window)
    except OceanError:
        raise
    except Exception as error:  # noqa: BLE001  what no check foresaw in a damaged file
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise OceanError(f"{Path(path).name}: cannot be read, perhaps damaged ({reason})") from None


def _part_of(file: StoredFile, window: GeographicWindow | None) -> Part:
    layout = cf.layout_of(file)
    axis, is_pressure = levels(file, layout.depth)
    steps = np.diff(axis)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise OceanError(f"{file.name}: {layout.depth} neither rises nor falls throughout; sort it")
    upward = bool(steps.size and steps[0] < 0.0)
    times = instants(file, layout.time)
    grid = select(file.values(layout.lat), file.values(layout.lon), window, file.name)
    return Part(file, layout, times, grid, axis[::-1] if upward else axis, upward, is_pressure)


def _check_same_grid(part: Part, role: str, first_role: str, first: tuple[Part, cf.Field]) -> None:
    other = first[0]
    if part is other:
        return
    pairs = {
        "depth": (part.levels, other.levels, SAME_DEGREES),
        "lat": (part.grid.lat, other.grid.lat, SAME_DEGREES),
        "lon": (part.grid.lon, other.grid.lon, SAME_DEGREES),
    }
    for name, (a, b, tolerance) in pairs.items():
        if a.shape != b.shape or np.max(np.abs(a - b)) > tolerance or part.is_pressure != other.is_pressure:
            raise OceanError(f"{part.file.name}: {name} of {role} differs from that of {first_role}")
