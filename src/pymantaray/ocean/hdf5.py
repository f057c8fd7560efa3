"""NetCDF-4 files read in a process of their own, since a damaged one can crash or hang the HDF5 library."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError

_CHILD = Path(__file__).with_name("_hdf5_child.py")
_LINE = 8 << 20  # bytes of the longest header that is taken
_OWN_MEMORY = 256 << 20  # bytes the library may take besides the values
_NUMBER = frozenset("biuf")


class Hdf5Process:
    """
    A process that reads NetCDF-4 files on request; it starts with the first one and again after a crash.

    Notes
    -----
    The HDF5 library is written for files that HDF5 wrote. On files with flipped bits the release that
    netCDF4 1.7.5 brings (2.0.0) was found to loop without end, to inflate a compressed block to a thousand
    times its size whatever the file declares, and is known to crash on others (HDFGroup/hdf5 issues 6488
    and 6489). None of these can be undone inside a process. So each request has a limit of processor time
    and of memory, set by the system; what exceeds them ends the child and becomes one `OceanError`.
    Values come back as bytes with a JSON header: nothing is unpickled.
    """

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process, if there is one."""
        if self._child is None:
            return
        child, self._child = self._child, None
        child.kill()
        child.communicate()

    def header(self, path: Path) -> dict[str, Any]:
        """
        Names, sizes and attributes of the variables of a file.

        Parameters
        ----------
        path : pathlib.Path

        Returns
        -------
        dict
            ``attrs`` and ``variables``; each variable with ``dims``, ``shape``, ``dtype``,
            ``chunk_bytes`` and ``attrs``; ``dtype`` is empty where the values are no numbers.

        Raises
        ------
        OceanError
            If the file is damaged.
        """
        return self._ask(path, {}, 0)

    def values(
        self, path: Path, variable: str, selection: tuple[slice, ...], n_bytes: int
    ) -> NDArray[np.generic]:
        """
        Values of a block of one variable, as stored.

        Parameters
        ----------
        path : pathlib.Path
        variable : str
        selection : tuple of slice
            One for each dimension, without steps.
        n_bytes : int
            What the block and the chunks that hold it need at most. [bytes]

        Returns
        -------
        ndarray

        Raises
        ------
        OceanError
            If the file is damaged, or costs more than it may.
        """
        key = [(s.start, s.stop) for s in selection]
        answer = self._ask(path, {"variable": variable, "selection": key}, n_bytes)
        dtype, shape = np.dtype(str(answer["dtype"])), tuple(int(n) for n in answer["shape"])
        expected = tuple(s.stop - s.start for s in selection)
        if dtype.kind not in _NUMBER or shape != expected:
            raise OceanError(f"{path.name}: cannot be read, {variable} is not what its header declares")
        result = np.empty(shape, dtype)
        assert self._child is not None
        assert self._child.stdout is not None
        view = memoryview(result.reshape(-1).view(np.uint8).data)
        while view:
            n = self._child.stdout.readinto(view)  # type: ignore[attr-defined]
            if not n:
                raise self._died(path)
            view = view[n:]
        return result

    def _ask(self, path: Path, request: dict[str, Any], n_bytes: int) -> dict[str, Any]:
        child = self._running()
        assert child.stdin is not None
        assert child.stdout is not None
        full = {**request, "path": str(path), "bytes": n_bytes, "memory": _OWN_MEMORY + 4 * n_bytes}
        try:
            child.stdin.write(json.dumps(full).encode() + b"\n")
            child.stdin.flush()
            line = child.stdout.readline(_LINE)
        except BrokenPipeError:
            line = b""
        if not line.endswith(b"\n"):
            raise self._died(path)
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise OceanError(f"{path.name}: cannot be read as NetCDF, perhaps cut short ({answer['error']})")
        return answer

    def _running(self) -> subprocess.Popen[bytes]:
        if self._child is None:
            # one thread: the child does no arithmetic, and threads reserve memory that counts
            quiet = {
                **os.environ,
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
                "MKL_NUM_THREADS": "1",
            }
            self._child = subprocess.Popen(
                [sys.executable, "-P", str(_CHILD)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=quiet,
            )
        return self._child

    def _died(self, path: Path) -> OceanError:
        self.close()
        return OceanError(
            f"{path.name}: cannot be read, the HDF5 library crashed, hung or ran out of memory on it;"
            " the file is damaged, fetch or write it again"
        )
