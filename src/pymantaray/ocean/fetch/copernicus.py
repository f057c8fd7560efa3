"""GLORYS12 by place and day from Copernicus Marine, through the service's own package."""

import datetime as dt
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.fetch.catalogue import Product, load_catalogue, minute
from pymantaray.ocean.fetch.hycom import Fetched, check_out, write_whole
from pymantaray.ocean.fetch.messages import one_line
from pymantaray.ocean.fetch.region import LARGEST_VALUES, Region
from pymantaray.ocean.schema import with_history

_EXTRA = 'needs the package copernicusmarine: pip install "pymantaray[copernicus]"'
_POINTS_PER_DEGREE = 12
_LEVELS = 50
_ACCOUNT = "log in once with: copernicusmarine login"


def fetch_copernicus(
    lat: tuple[float, float],
    lon: tuple[float, float],
    time: str | np.datetime64,
    out: str | Path,
    *,
    product: str | None = None,
    servers: str | Path | None = None,
    overwrite: bool = False,
) -> Fetched:
    """
    Fetch a window of GLORYS12's daily means and write it as a valid ocean.

    Needs an account of Copernicus Marine, which the package asks for or finds where its own login has
    stored it. Retries and time limits are the package's.

    Parameters
    ----------
    lat : tuple of float
        South and north. [degrees]
    lon : tuple of float
        West and east in any convention. [degrees]
    time : str or numpy.datetime64
        UTC; the mean of its day is taken.
    out : str or Path
        File to write; its folder must exist.
    product : str, optional
        Name of a product of the catalogue; by default the first that covers the time.
    servers : str or Path, optional
        See `pymantaray.ocean.fetch.catalogue.load_catalogue`.
    overwrite : bool, optional
        Replace an existing file.

    Returns
    -------
    Fetched

    Raises
    ------
    OceanError
        If the package is not installed, the service refuses, or what it returns is not an ocean.

    Notes
    -----
    The service returns potential temperature ``thetao``, practical salinity ``so`` and currents ``uo`` and
    ``vo`` on model levels ``depth``; the reader of CF files makes them in-situ temperature on a valid ocean.
    """
    region = Region.of(lat, lon)
    day = parse_instant(time).astype("datetime64[D]").astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    chosen = _product(load_catalogue(servers).copernicus, day, product)
    points = (region.north - region.south) * region.width * _POINTS_PER_DEGREE**2 * _LEVELS
    if points > LARGEST_VALUES:
        raise OceanError(
            f"fetch: the window has about {points:,.0f} points; allowed are {LARGEST_VALUES:,}, make it smaller"
        )
    with tempfile.TemporaryDirectory(prefix="mantaray-") as folder:
        parts = [
            _subset(request_of(part, region, day, Path(folder), f"part{i}.nc"))
            for i, part in enumerate(chosen.datasets)
        ]
        ocean = _opened(parts, day)
    title = f"{chosen.title}, {minute(day)[:10]}"
    ids = ", ".join(part.id for part in chosen.datasets)
    ocean = ocean.assign_attrs(title=title, source=chosen.title)
    write_whole(with_history(ocean, f"fetched from Copernicus Marine ({ids}): {region.text}"), path)
    return Fetched(path, title, day, "Copernicus Marine", len(parts), 0)


def request_of(
    part: Product.Dataset, region: Region, day: np.datetime64, folder: Path, name: str
) -> dict[str, Any]:
    """
    Arguments of ``copernicusmarine.subset`` for one data set.

    Parameters
    ----------
    part : Product.Dataset
    region : Region
    day : numpy.datetime64
        A midnight, where the daily means have their time.
    folder : pathlib.Path
        Where the service's file goes.
    name : str
        Its name.

    Returns
    -------
    dict
    """
    # the package counts longitudes as it finds them, and shifts its axis where west exceeds east
    east = (region.west + region.width + 180.0) % 360.0 - 180.0
    instant = dt.datetime.fromisoformat(str(day)).replace(tzinfo=dt.UTC)
    return {
        "dataset_id": part.id,
        "variables": list(part.variables),
        "minimum_latitude": region.south,
        "maximum_latitude": region.north,
        "minimum_longitude": region.west,
        "maximum_longitude": east if east > region.west else east + 360.0,
        "start_datetime": instant,
        "end_datetime": instant,
        "coordinates_selection_method": "outside",  # one point beyond each side: the window is enclosed
        "output_directory": folder,
        "output_filename": name,
        "file_format": "netcdf",
        "overwrite": True,
        "disable_progress_bar": True,
    }


def _product(products: tuple[Product, ...], day: np.datetime64, name: str | None) -> Product:
    named = [p for p in products if name is None or p.name == name]
    if not named:
        known = ", ".join(p.name for p in products)
        raise OceanError(f"fetch: no product is called {name!r}; there are {known or 'none'}")
    for p in named:
        if np.datetime64(p.first) <= day and (p.last is None or day <= np.datetime64(p.last)):
            return p
    spans = ", ".join(
        f"{p.name} from {p.first:%Y-%m-%d}" + (f" to {p.last:%Y-%m-%d}" if p.last else "") for p in named
    )
    raise OceanError(f"fetch: no product covers {minute(day)[:10]}; there is {spans}")


def _subset(request: dict[str, Any]) -> Path:
    with _one_line_errors(request["dataset_id"]):
        import copernicusmarine

        copernicusmarine.subset(**request)
    path = Path(request["output_directory"]) / str(request["output_filename"])
    if not path.is_file():
        raise OceanError(f"copernicus: {request['dataset_id']}: the service returned no file")
    return path


@contextmanager
def _one_line_errors(dataset: str) -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "copernicusmarine":
            raise OceanError(f"copernicus: {one_line(error)}; {_EXTRA}") from None
        raise OceanError(f"copernicus: {_EXTRA}") from None
    except Exception as error:  # noqa: BLE001  the package raises its own, its libraries' and click's
        kind = type(error).__name__
        remedy = (
            f"; {_ACCOUNT}"
            if any(w in kind for w in ("Credential", "Password", "Authentication", "Abort"))
            else ""
        )
        raise OceanError(f"copernicus: {dataset}: {one_line(error) or kind} ({kind}){remedy}") from None


def _opened(parts: list[Path], day: np.datetime64) -> xr.Dataset:
    from pymantaray.ocean.open import open_ocean

    try:
        return open_ocean(parts if len(parts) > 1 else parts[0], time=day).load()
    except OceanError as error:
        raise OceanError(f"copernicus: what the service returned is no ocean: {error}") from None
