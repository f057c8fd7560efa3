"""Storage of data sets in memory as files, for other processes and later sessions."""

import hashlib
import os
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile

import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.records.writing import NETCDF_LOCK


def cache_folder() -> Path:
    """Cache folder: ``$XDG_CACHE_HOME``, or the usual cache folder of the system."""
    home = os.environ.get("XDG_CACHE_HOME")
    if home:
        return Path(home) / "pymantaray"
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "pymantaray"


def stored_ocean(data: xr.Dataset) -> Path:
    """
    Write a data set in memory as NetCDF into the cache.

    Parameters
    ----------
    data : xarray.Dataset
        Any data set.

    Returns
    -------
    pathlib.Path
        The file. Its name is the hash of the content, so equal data are written once. A run that
        names the file can be repeated as long as the cache exists.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import open_ocean, stored_ocean
    >>> file = stored_ocean(ocean)
    >>> dict(open_ocean(file).sizes)
    {'depth': 40, 'lat': 5, 'lon': 11}
    """
    folder = cache_folder() / "oceans"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=folder, suffix=".part", delete=False) as part:
            written = Path(part.name)
        try:
            with NETCDF_LOCK:
                data.drop_encoding().to_netcdf(written, engine="netcdf4")
            with written.open("rb") as stream:
                name = hashlib.file_digest(stream, "sha256").hexdigest()[:24]
            return written.replace(folder / f"{name}.nc")
        except BaseException:
            with suppress(OSError):
                written.unlink()
            raise
    except (OSError, TypeError, ValueError, RuntimeError) as error:
        raise OceanError(
            f"data set in memory: cannot be written to {folder}: {one_line(error)}"
        ) from None
