"""Oceans in memory as files, for work that other processes or later sessions do with them."""

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
    """Folder of files that can be made again: ``$XDG_CACHE_HOME``, or the user's own by the habits of the system."""
    home = os.environ.get("XDG_CACHE_HOME")
    if home:
        return Path(home) / "pymantaray"
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "pymantaray"


def stored_ocean(data: xr.Dataset) -> Path:
    """
    Write a data set in memory as NetCDF into the cache, and return its file.

    The name is the hash of the content: the same data are written once, and a run that names the file can be repeated as long
    as the cache is there.
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
        raise OceanError(f"data set in memory: cannot be written to {folder}: {one_line(error)}") from None
