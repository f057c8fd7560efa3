"""
The other end of `pymantaray.ocean.hdf5`: a program that reads NetCDF-4 files for another process.

It is run by path, imports nothing of MantaRay, and answers requests of one JSON line on standard input
with one JSON line and, for values, their bytes. The system ends it where a request costs more processor
time or memory than it may, and where the HDF5 library crashes: the other process loses nothing by that.
"""

import json
import math
import resource
import sys
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

_SECONDS = 5.0
_BYTES_PER_SECOND = 20e6  # of values asked for; decompression is ten times faster
_TEXT = 4000  # characters kept of an attribute
_NUMBERS = 64  # numbers kept of an attribute


def main() -> None:
    """Answer requests until standard input ends."""
    own_memory = _address_space()
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        _limit_processor_time(float(request["bytes"]))
        _limit_memory(own_memory + int(request["memory"]))
        values = None
        try:
            with netCDF4.Dataset(request["path"], "r") as file:
                file.set_auto_maskandscale(False)
                file.set_auto_chartostring(False)
                if "variable" in request:
                    values = _values(file, request)
                    answer: dict[str, Any] = {"dtype": values.dtype.str, "shape": values.shape}
                else:
                    answer = _header(file)
        except Exception as error:  # noqa: BLE001  the library raises whatever it stumbles over
            values = None
            answer = {"error": " ".join(str(error).split())[:200] or type(error).__name__}
        sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n")
        if values is not None:
            sys.stdout.buffer.write(values.reshape(-1).view(np.uint8).data)
        sys.stdout.buffer.flush()


def _header(file: netCDF4.Dataset) -> dict[str, Any]:
    variables = {}
    for name, variable in file.variables.items():
        stored = variable.datatype
        numeric = isinstance(stored, np.dtype) and stored.kind in "iuf"
        chunks = variable.chunking()
        chunk_values = math.prod(int(n) for n in chunks) if isinstance(chunks, list) else 0
        variables[name] = {
            "dims": variable.dimensions,
            "shape": [int(n) for n in variable.shape],
            "dtype": stored.str if numeric else "",  # text, compounds: nothing of an ocean
            "chunk_bytes": chunk_values * stored.itemsize if numeric else 0,
            "attrs": _attributes(variable),
        }
    return {"attrs": _attributes(file), "variables": variables}


def _values(file: netCDF4.Dataset, request: dict[str, Any]) -> Any:
    key = tuple(slice(start, stop) for start, stop in request["selection"])
    return np.asarray(file.variables[request["variable"]][key or ...], order="C")


def _attributes(thing: Any) -> dict[str, Any]:
    """Text and numbers only; what cannot be read is left out."""
    found: dict[str, Any] = {}
    for name in thing.ncattrs():
        try:
            value = thing.getncattr(name)
        except Exception:  # noqa: BLE001, S112  a damaged attribute is no attribute
            continue
        if isinstance(value, str):
            found[name] = value[:_TEXT]
        elif np.asarray(value).dtype.kind in "iuf":
            numbers = np.asarray(value).ravel()[:_NUMBERS].tolist()
            found[name] = numbers[0] if len(numbers) == 1 else numbers
    return found


def _limit_processor_time(n_bytes: float) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = used.ru_utime + used.ru_stime + _SECONDS + n_bytes / _BYTES_PER_SECOND
    _limit(resource.RLIMIT_CPU, int(seconds) + 1)


def _limit_memory(n_bytes: int) -> None:
    if sys.platform.startswith("linux"):
        _limit(resource.RLIMIT_AS, n_bytes)


def _limit(what: int, amount: int) -> None:
    """Set the limit, never above one that the process was started under."""
    _, hard = resource.getrlimit(what)
    resource.setrlimit(what, (amount if hard == resource.RLIM_INFINITY else min(amount, hard), hard))


def _address_space() -> int:
    if not sys.platform.startswith("linux"):
        return 0
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


if __name__ == "__main__":
    main()
