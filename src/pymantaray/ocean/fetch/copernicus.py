"""Download of GLORYS12 by place and day from Copernicus Marine, with the service's own package."""

import datetime as dt
import tempfile
from pathlib import Path

import numpy as np

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.convert import minute, parse_instant
from pymantaray.ocean.fetch.catalogue import Dataset, covering, load_catalogue
from pymantaray.ocean.fetch.hycom import FetchResult, check_out
from pymantaray.ocean.fetch.region import MAX_VALUES, Region
from pymantaray.ocean.open import open_ocean
from pymantaray.ocean.schema import with_history
from pymantaray.records.writing import write_netcdf

_EXTRA = 'copernicusmarine is not installed; pip install "pymantaray[copernicus]"'
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
) -> FetchResult:
    """
    Download a window of a GLORYS12 daily mean and write it as a valid ocean.

    Parameters
    ----------
    lat, lon, out, servers, overwrite
        As in `fetch_hycom`.
    time : str or numpy.datetime64
        Instant (UTC); the function downloads the mean of its day.
    product : str, optional
        Name of a product in the catalogue. Default: the first that covers the time.

    Returns
    -------
    FetchResult

    Notes
    -----
    The download needs an account of Copernicus Marine. The package ``copernicusmarine`` asks for it
    or uses a stored login, and defines retries and time limits. The service returns potential
    temperature ``thetao``, practical salinity ``so`` and currents ``uo`` and ``vo`` on model levels
    ``depth``. The reader of CF files converts them to a valid ocean with in-situ temperature.

    Examples
    --------
    >>> from pymantaray.ocean.fetch import fetch_copernicus
    >>> result = fetch_copernicus((78, 79), (0, 4), "2014-07-15", "fram.nc")  # doctest: +SKIP
    """
    region = Region.of(lat, lon)
    day = parse_instant(time).astype("datetime64[D]").astype("datetime64[s]")
    path = check_out(out, overwrite=overwrite)
    chosen = covering(load_catalogue(servers).copernicus, day, product, "product")[0]
    points = (region.north - region.south) * region.width * _POINTS_PER_DEGREE**2 * _LEVELS
    if points > MAX_VALUES:
        raise OceanError(
            f"fetch: the window has about {points:,.0f} points; the limit is {MAX_VALUES:,}; use a"
            " smaller window"
        )
    with tempfile.TemporaryDirectory(prefix="mantaray-") as folder:
        files = [Path(folder) / f"part{i}.nc" for i in range(len(chosen.datasets))]
        for part, file in zip(chosen.datasets, files, strict=True):
            _subset(part, region, day, file)
        try:
            ocean = open_ocean(files, time=day)
        except OceanError as error:
            raise OceanError(
                f"copernicus: the service did not return a valid ocean: {error}; try again later"
            ) from None
    title = f"{chosen.title}, {minute(day)[:10]}"
    ids = ", ".join(part.path for part in chosen.datasets)
    ocean = ocean.assign_attrs(title=title, source=chosen.title)
    ocean = with_history(ocean, f"fetched from Copernicus Marine ({ids}): {region.text}")
    write_netcdf(ocean, path, replace=overwrite)
    return FetchResult(path, title, day, len(files))


def _subset(part: Dataset, region: Region, day: np.datetime64, file: Path) -> None:
    """Download one data set; the time of daily means is midnight."""
    instant = dt.datetime.fromisoformat(str(day)).replace(tzinfo=dt.UTC)
    request = {
        "dataset_id": part.path,
        "variables": list(part.variables),
        "minimum_latitude": region.south,
        "maximum_latitude": region.north,
        "minimum_longitude": region.west,
        "maximum_longitude": region.west + region.width,  # greater than 180 across the antimeridian
        "start_datetime": instant,
        "end_datetime": instant,
        "coordinates_selection_method": "outside",  # one point beyond each side encloses the window
        "output_directory": file.parent,
        "output_filename": file.name,
        "file_format": "netcdf",
        "overwrite": True,
        "disable_progress_bar": True,
    }
    try:
        import copernicusmarine

        copernicusmarine.subset(**request)
    except ImportError as error:
        known = (error.name or "").partition(".")[0] == "copernicusmarine"
        raise OceanError(f"copernicus: {'' if known else f'{one_line(error)}; '}{_EXTRA}") from None
    except Exception as error:  # noqa: BLE001  the package and its libraries raise many types
        kind = type(error).__name__
        login = any(w in kind for w in ("Credential", "Password", "Authentication", "Abort"))
        remedy = f"; {_ACCOUNT}" if login else ""
        raise OceanError(
            f"copernicus: {part.path}: {one_line(error) or kind} ({kind}){remedy}"
        ) from None
    if not file.is_file():
        raise OceanError(f"copernicus: {part.path}: the service returned no file; {_ACCOUNT}")
