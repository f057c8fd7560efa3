"""GLORYS12 by place and day from Copernicus Marine, through the service's own package."""

import datetime as dt
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.convert import minute, parse_instant
from pymantaray.ocean.fetch.catalogue import Dataset, covering, load_catalogue
from pymantaray.ocean.fetch.hycom import Fetched, check_out
from pymantaray.ocean.fetch.region import LARGEST_VALUES, Region
from pymantaray.ocean.open import open_ocean
from pymantaray.ocean.schema import with_history
from pymantaray.records.writing import write_netcdf

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

    Parameters
    ----------
    lat, lon, out, servers, overwrite
        As in `fetch_hycom`.
    time : str or numpy.datetime64
        UTC; the mean of its day is taken.
    product : str, optional
        Name of a product of the catalogue; by default the first that covers the time.

    Notes
    -----
    Needs an account of Copernicus Marine, which the package asks for or finds where its own login has stored it. Retries
    and time limits are the package's. The service returns potential temperature ``thetao``, practical salinity ``so`` and
    currents ``uo`` and ``vo`` on model levels ``depth``; the reader of CF files makes them in-situ temperature on a valid
    ocean.
    """
    region = Region.of(lat, lon)
    day = parse_instant(time).astype("datetime64[D]").astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    chosen = covering(load_catalogue(servers).copernicus, day, product, "product")[0]
    points = (region.north - region.south) * region.width * _POINTS_PER_DEGREE**2 * _LEVELS
    if points > LARGEST_VALUES:
        raise OceanError(
            f"fetch: the window has about {points:,.0f} points; allowed are {LARGEST_VALUES:,}, make it smaller"
        )
    with tempfile.TemporaryDirectory(prefix="mantaray-") as folder:
        files = [Path(folder) / f"part{i}.nc" for i in range(len(chosen.datasets))]
        for part, file in zip(chosen.datasets, files, strict=True):
            _subset(_request(part, region, day, file))
        try:
            ocean = open_ocean(files, time=day)
        except OceanError as error:
            raise OceanError(f"copernicus: what the service returned is no ocean: {error}") from None
    title = f"{chosen.title}, {minute(day)[:10]}"
    ids = ", ".join(part.path for part in chosen.datasets)
    ocean = ocean.assign_attrs(title=title, source=chosen.title)
    ocean = with_history(ocean, f"fetched from Copernicus Marine ({ids}): {region.text}")
    write_netcdf(ocean, path, replace=overwrite)
    return Fetched(path, title, day, len(files))


def _request(part: Dataset, region: Region, day: np.datetime64, file: Path) -> dict[str, Any]:
    """Arguments of ``copernicusmarine.subset`` for one data set, whose daily means have their time at midnight."""
    instant = dt.datetime.fromisoformat(str(day)).replace(tzinfo=dt.UTC)
    return {
        "dataset_id": part.path,
        "variables": list(part.variables),
        "minimum_latitude": region.south,
        "maximum_latitude": region.north,
        "minimum_longitude": region.west,
        "maximum_longitude": region.west + region.width,  # beyond 180 across the antimeridian
        "start_datetime": instant,
        "end_datetime": instant,
        "coordinates_selection_method": "outside",  # one point beyond each side: the window is enclosed
        "output_directory": file.parent,
        "output_filename": file.name,
        "file_format": "netcdf",
        "overwrite": True,
        "disable_progress_bar": True,
    }


def _subset(request: dict[str, Any]) -> None:
    dataset = request["dataset_id"]
    try:
        import copernicusmarine

        copernicusmarine.subset(**request)
    except ImportError as error:
        known = (error.name or "").partition(".")[0] == "copernicusmarine"
        raise OceanError(f"copernicus: {'' if known else f'{one_line(error)}; '}{_EXTRA}") from None
    except Exception as error:  # noqa: BLE001  the package raises its own, its libraries' and click's
        kind = type(error).__name__
        login = any(w in kind for w in ("Credential", "Password", "Authentication", "Abort"))
        remedy = f"; {_ACCOUNT}" if login else ""
        raise OceanError(f"copernicus: {dataset}: {one_line(error) or kind} ({kind}){remedy}") from None
    if not (request["output_directory"] / request["output_filename"]).is_file():
        raise OceanError(f"copernicus: {dataset}: the service returned no file; {_ACCOUNT}")
