"""Is this ocean fit for use: everything that is wrong or doubtful about a data set, not only the first thing."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.check_place import check_place
from pymantaray.ocean.check_schema import check_schema
from pymantaray.ocean.check_water import check_water
from pymantaray.ocean.collection import Currents
from pymantaray.ocean.files import StoredFile, open_stored
from pymantaray.ocean.findings import Finding, Findings, doubtful, wrong
from pymantaray.ocean.hdf5 import Hdf5Process
from pymantaray.ocean.schema import DIMS, VARIABLES, validate_ocean
from pymantaray.ocean.seawater import Equation
from pymantaray.ocean.source import open_ocean

Array = NDArray[np.float64]


def check_ocean(
    source: str | Path | Sequence[str | Path] | xr.Dataset,
    *,
    time: str | np.datetime64 | None = None,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
    fleet: Mapping[str, Array] | None = None,
    sea_floor: xr.DataArray | None = None,
    equation: Equation = "teos-10",
    currents: Currents = "required",
) -> Findings:
    """
    List what is wrong and what is doubtful about an ocean.

    Parameters
    ----------
    source : str, Path, sequence of them, or xarray.Dataset
        As `pymantaray.ocean.open_ocean` takes it, or a data set.
    time : str or numpy.datetime64, optional
        Instant, if the source holds several.
    centre, half_extent : tuple of float, optional
        Domain that it must hold, see `pymantaray.ocean.to_local`.
    fleet : mapping of str to ndarray, shape (n, 3), optional
        Points north, east, down that each vehicle plans to reach, the first one its start; they must lie
        in the domain and above the sea bed. [m]
    sea_floor : xarray.DataArray, optional
        Sea floor that `to_local` is to be given.
    equation : {"teos-10", "del-grosso", "unesco"}
        Equation of sound speed.
    currents : {"required", "rest"}
        As in `pymantaray.ocean.open_ocean`.

    Returns
    -------
    Findings
        What is wrong comes first. Where the structure is broken, what depends on it is not checked.

    Examples
    --------
    >>> found = check_ocean("synthetic:fram")
    >>> found.ok, [f.what for f in found.doubtful]
    (True, ['made up'])
    """
    if isinstance(source, xr.Dataset):
        ocean, found = source, _structure(source)
    else:
        try:
            ocean, found = open_ocean(source, time=time, currents=currents), []
        except OceanError as error:
            return _sorted(_unopened(source, str(error)))
    if any(f.severity == "wrong" for f in found):
        return _sorted(found)
    found = [
        *found,
        *check_water(ocean, equation),
        *check_place(ocean, centre=centre, half_extent=half_extent, fleet=fleet or {}, sea_floor=sea_floor),
        *_provenance(ocean),
    ]
    return _sorted(found)


def _structure(ocean: xr.Dataset) -> list[Finding]:
    """All violations of the schema; the schema's own validation has the last word."""
    found = check_schema(ocean)
    if not any(f.severity == "wrong" for f in found):
        try:
            validate_ocean(ocean)
        except OceanError as error:
            found.append(wrong("not a valid ocean", str(error), "", ""))
    return found


def _unopened(source: str | Path | Sequence[str | Path], reason: str) -> list[Finding]:
    """Why a source does not open, and what else is wrong in its files as far as they can be read."""
    paths = [Path(s) for s in ([source] if isinstance(source, str | Path) else source)]
    raw = _raw(paths)
    found = [] if raw is None else [f for f in check_schema(raw) if f.severity == "wrong"]
    said = [f for f in found if f.where and f.where.split()[0] in reason]
    if any(f.what != "variable missing" for f in said):
        return found  # with more detail than the reason
    opening = wrong("cannot be opened", reason, "", "")
    return [opening, *(f for f in found if f not in said)]


def _raw(paths: Sequence[Path]) -> xr.Dataset | None:
    """Files as they are, one time step, under the schema's names; None where that makes no sense."""
    fields: dict[str, xr.DataArray] = {}
    coordinates: dict[str, xr.DataArray] = {}
    try:
        with Hdf5Process() as reader:
            for path in paths:
                file = open_stored(path, reader)
                for v in VARIABLES:
                    if v.name in file.variables:
                        fields[v.name] = _first(file, v.name)
                for name in DIMS:
                    stored = {"lat": "latitude", "lon": "longitude"}.get(name, "")
                    found = name if name in file.variables else stored
                    if found in file.variables and len(file.variables[found].dims) == 1:
                        units = {"units": file.variables[found].text("units")}
                        coordinates[name] = xr.DataArray(file.values(found), dims=(name,), attrs=units)
        if not fields:
            return None
        time = np.datetime64("NaT", "ns")  # whether times can be read, the opening has said
        lent = {"title": "", "source": "", "synthetic": 0}  # files need not have them
        return xr.Dataset(fields, coords={**coordinates, "time": time}, attrs=lent)
    except (OceanError, ValueError):
        return None  # it cannot be opened: that is known already


def _first(file: StoredFile, name: str) -> xr.DataArray:
    """First time step of a variable, its dimensions called as the schema does."""
    variable = file.variables[name]
    values = file.values(name, {"time": slice(0, 1)})
    kept = [k for k, dim in enumerate(variable.dims) if dim != "time"]
    dims = [{"latitude": "lat", "longitude": "lon"}.get(variable.dims[k], variable.dims[k]) for k in kept]
    shape = [values.shape[k] for k in kept]
    return xr.DataArray(values.reshape(shape), dims=dims, attrs={"units": variable.text("units")})


def _provenance(ocean: xr.Dataset) -> list[Finding]:
    """Doubts from what the ocean says about itself."""
    found = []
    if int(ocean.attrs.get("synthetic", 0)):
        found.append(
            doubtful("made up", "synthetic = 1", "", "do not report it as a model's or a measurement's ocean")
        )
    still = not any(
        np.any(ocean[name].values[np.isfinite(ocean[name].values)]) for name in ("water_u", "water_v")
    )
    if still:
        found.append(
            doubtful(
                "currents at rest", "0 m/s everywhere", "", "floats do not drift; give u and v if they should"
            )
        )
    found.extend(
        doubtful("changed", line.strip(), "", "see that the change is meant")
        for line in str(ocean.attrs.get("history", "")).splitlines()
        if any(word in line.lower() for word in _CHANGES) and not (still and "rest" in line.lower())
    )
    return found


_CHANGES = (
    "carried",
    "extended",
    "extension",
    "added",
    "level",
    "perturbed",
    "replaced",
    "at rest",
    "set to 0",
)


def _sorted(found: list[Finding]) -> Findings:
    return Findings(tuple(sorted(found, key=lambda f: f.severity != "wrong")))
