"""Atomic writing of files, and one lock for all reading and writing of NetCDF."""

import errno
import os
import secrets
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pymantaray.errors import RecordError, WriteError
from pymantaray.records.stops import deferred_stops, unfinished
from pymantaray.user_files import check_regular, exists

if TYPE_CHECKING:
    import xarray as xr

NETCDF_LOCK = threading.RLock()
"""Lock for open NetCDF files: the C libraries behind netCDF4 are not thread-safe."""

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PROBE_BYTES = 1 << 20
_COMPRESSED_BYTES = 4000  # of a variable that is worth compressing
_COMPRESSION = 2  # of a variable; 6 takes half as long again for 2 % less
_OVERHEAD_BYTES = 4000  # per NetCDF file and per variable


@contextmanager
def whole_file(path: Path | str, *, replace: bool = True) -> Iterator[Path]:
    """
    Write a file atomically, through a temporary file in the same folder.

    The temporary file is new and empty and has an unpredictable name. It is renamed when the block
    ends, and removed if the block raises.

    Parameters
    ----------
    path : pathlib.Path or str
        Final file.
    replace : bool
        If False, an existing file raises an error.

    Yields
    ------
    pathlib.Path
        Temporary file.

    Raises
    ------
    WriteError
        If the file cannot be written. The message gives the cause.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.records import whole_file
    >>> with whole_file("notes.txt") as temporary:
    ...     _ = temporary.write_text("two pings lost")
    >>> Path("notes.txt").read_text()
    'two pings lost'
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name[:50]}.{secrets.token_hex(8)}.part")
    try:
        _check_target(path, replace=replace)
        unfinished.add(temporary)
        os.close(
            os.open(
                temporary,
                os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0),
                0o666,
            )
        )
        try:
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())  # reports a full network disk at the latest
            _check_target(path, replace=replace)
            temporary.replace(path)
        except OSError as error:
            raise WriteError(f"{path}: cannot be written: {_cause(error, temporary)}") from None
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            unfinished.discard(temporary)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        raise WriteError(
            f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}"
        ) from None


def _check_target(path: Path, *, replace: bool) -> None:
    if path.is_symlink() or exists(path):
        if not replace:
            raise WriteError(f"{path}: already exists; give another name")
        if not (path.is_symlink() or path.is_file()):
            raise WriteError(f"{path}: cannot be written: not a regular file")


def _cause(error: OSError, temporary: Path) -> str:
    """
    Cause of a failed write.

    netCDF4 reports a full disk as "HDF error" or "Permission denied", so this function writes again
    to get the cause.
    """
    if error.errno not in _NO_ROOM:
        try:
            with temporary.open("ab") as file:
                file.write(bytes(_PROBE_BYTES))
                # writes all bytes; an unbuffered file would write a part without an error
                file.flush()
                os.fsync(file.fileno())
        except OSError as cause:
            error = cause
    return error.strerror or str(error).partition("\n")[0]


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """
    Create a folder that is removed after the block; raise `WriteError` with the cause if files
    cannot be written there.
    """
    place = "temporary files"
    try:
        with tempfile.TemporaryDirectory(prefix="mantaray-") as name:
            place = name
            try:
                yield Path(name)
            except (OSError, RuntimeError) as error:  # netCDF4 raises RuntimeError for a full disk
                cause = error if isinstance(error, OSError) else OSError(str(error))
                raise OSError(_cause(cause, Path(name, "cause"))) from None
    except OSError as error:
        raise WriteError(
            f"{place}: cannot be written: {error.strerror or error}; free some space, or set TMPDIR"
            " to another folder"
        ) from None


CF_VERSION = "CF-1.11"
"""The version of the CF conventions that files claim."""


def pack(variable: "xr.Variable", step: float | Sequence[float]) -> None:
    """
    Let a file hold a variable as integers that count steps, NaN as the least integer; as it is if
    an integer of 32 bits is too small for it.

    Steps of several components are multiples of the least one by powers of two, whose zeros need no
    room. A chunk has all values along the two longest dimensions, which compresses best.
    """
    values = variable.values
    steps = np.atleast_1d(np.asarray(step, dtype=float))
    least = float(steps.min())
    if not np.nanmax(np.abs(values), initial=0.0) < least * (2**31 - 2):
        return
    if steps.size > 1:
        variable.values = np.round(values / steps) * steps
    longest = sorted(range(values.ndim), key=lambda k: values.shape[k])[-2:]
    chunks = tuple(max(n, 1) if k in longest else 1 for k, n in enumerate(values.shape))
    variable.encoding |= {"dtype": "i4", "scale_factor": least, "_FillValue": np.int32(-(2**31))}
    variable.encoding |= {"chunksizes": chunks} if values.size else {}


def write_netcdf(dataset: "xr.Dataset", path: Path | str, *, replace: bool = True) -> None:
    """
    Write a data set atomically as NetCDF-4 with CF attributes; long variables are compressed.

    Parameters
    ----------
    dataset : xarray.Dataset
        Data set; missing title and history are added.
    path : pathlib.Path or str
        File.
    replace : bool
        As in `whole_file`.

    Examples
    --------
    >>> import xarray as xr
    >>> from pymantaray.records import read_netcdf, write_netcdf
    >>> write_netcdf(xr.Dataset({"time": ("ping", [0.0, 600.0], {"units": "s"})}), "pings.nc")
    >>> dict(read_netcdf("pings.nc").sizes)
    {'ping': 2}
    """
    # xarray's own `to_netcdf` imports dask's scheduler if it is installed
    from netCDF4 import Dataset
    from xarray.backends import NetCDF4DataStore

    dataset = dataset.copy()
    path = Path(path)
    about = {"title": path.stem.replace("_", " "), "history": f"pymantaray {version('pymantaray')}"}
    dataset.attrs = {"Conventions": CF_VERSION, **about, **dataset.attrs}
    for name in dataset.indexes:
        dataset[name].encoding["_FillValue"] = None
        if dataset[name].dtype.kind == "U":  # CF's checks of coordinates need characters
            dataset[name].encoding["dtype"] = "S1"
    for variable in dataset.variables.values():
        if variable.dtype.kind in "fiu" and variable.nbytes > _COMPRESSED_BYTES:
            variable.encoding.pop("contiguous", None)  # of the file from which it was read
            variable.encoding |= {"zlib": True, "shuffle": True, "complevel": _COMPRESSION}
    with whole_file(path, replace=replace) as temporary, deferred_stops(), NETCDF_LOCK:
        check_room(temporary, dataset.nbytes + _OVERHEAD_BYTES * (1 + len(dataset.variables)))
        try:
            dataset.load()
            with Dataset(temporary, "w", format="NETCDF4") as file:
                dataset.dump_to_store(NetCDF4DataStore(file))  # type: ignore[no-untyped-call]
        except RuntimeError as error:  # netCDF4 raises this for a full disk
            raise OSError(str(error)) from None


def netcdf_content(groups: Mapping[str, "xr.Dataset"]) -> bytes:
    """Content of a NetCDF file with unencoded groups."""
    from netCDF4 import Dataset
    from xarray.backends import NetCDF4DataStore

    with deferred_stops(), NETCDF_LOCK, temporary_folder() as folder:
        path = folder / "groups.nc"
        # opened once, because HDF5 opens a file more slowly the more groups it has
        with Dataset(path, "w", format="NETCDF4") as file:
            for name, dataset in groups.items():
                dataset.drop_encoding().dump_to_store(NetCDF4DataStore(file.createGroup(name)))  # type: ignore[no-untyped-call]
        return path.read_bytes()


def netcdf_groups(content: bytes) -> "dict[str, xr.Dataset]":
    """Read the groups from `netcdf_content` without decoding times."""
    import xarray as xr

    with deferred_stops(), NETCDF_LOCK, temporary_folder() as folder:
        path = folder / "groups.nc"
        path.write_bytes(content)
        groups = xr.open_groups(path, engine="netcdf4", decode_times=False)
        try:
            return {name.strip("/"): group.load() for name, group in groups.items() if name != "/"}
        finally:
            for group in groups.values():
                group.close()


def check_room(temporary: Path, size: int) -> None:
    """
    Raise the system's error for a full disk before HDF5 does.

    HDF5 keeps a file open after a failed write.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    with temporary.open("rb+") as file:
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno in _NO_ROOM:  # other errors: not every file system supports this
                raise
        file.truncate(0)


def read_netcdf(path: Path | str, **options: Any) -> "xr.Dataset":
    """
    Read a NetCDF file into memory.

    Parameters
    ----------
    path : pathlib.Path or str
        File.
    **options
        Options of `xarray.open_dataset`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    RecordError
        If the file is missing or unreadable.

    Examples
    --------
    >>> import xarray as xr
    >>> from pymantaray.records import read_netcdf, write_netcdf
    >>> write_netcdf(xr.Dataset({"time": ("ping", [0.0, 600.0], {"units": "s"})}), "pings.nc")
    >>> print(read_netcdf("pings.nc")["time"].values)
    [  0. 600.]
    """
    import xarray as xr

    check_regular(path, RecordError, what="a NetCDF file")
    try:
        with (
            deferred_stops(),
            NETCDF_LOCK,
            xr.open_dataset(path, engine="netcdf4", **options) as dataset,
        ):
            return dataset.load()
    except Exception as error:  # noqa: BLE001  netCDF4 and xarray raise many types for damaged data
        reason = (isinstance(error, OSError) and error.strerror) or str(error).partition("\n")[0]
        raise RecordError(f"{path}: not a readable NetCDF file: {reason}") from None
