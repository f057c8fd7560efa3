"""Finding Bellhop on the machine and running it on input files."""

import os
import resource
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from pymantaray.errors import AcousticsError

PROGRAMS = ("bellhopcxx3d", "bellhopcxx", "bellhop3d", "bellhop3d.exe")
_TAIL = 200  # characters of the print file in a message


@dataclass(frozen=True)
class BellhopRun:
    """
    One finished run.

    Attributes
    ----------
    output : pathlib.Path
        The `.arr` or `.ray` file.
    cpu_time, wall_time : float
        Of the program, all its threads together, and on the clock. [s]
    """

    output: Path
    cpu_time: float
    wall_time: float


def find_bellhop(program: str | Path | None = None) -> Path:
    """
    Find the program.

    Parameters
    ----------
    program : str or pathlib.Path, optional
        Name on PATH, or a path. Default: the first of ``bellhopcxx3d``, ``bellhopcxx``, ``bellhop3d`` and
        ``bellhop3d.exe`` on PATH.

    Returns
    -------
    pathlib.Path
        Absolute.

    Raises
    ------
    AcousticsError
        If it is not there or may not be run.
    """
    names = PROGRAMS if program is None else (str(program),)
    for name in names:
        found = shutil.which(name)
        if found:
            return Path(found).resolve()
    if program is not None and Path(program).is_file():
        raise AcousticsError(f"{program}: is there but may not be run; make it executable")
    raise AcousticsError(
        f"Bellhop: no {' or '.join(names)} on PATH; install it, or name the program by its path"
    )


def run_bellhop(
    program: str | Path | None, env: str | Path, *, timeout: float = 600.0, threads: int | None = 1
) -> BellhopRun:
    """
    Run Bellhop on a `.env` file; it writes its results next to it.

    Parameters
    ----------
    program : str or pathlib.Path, optional
        See `find_bellhop`.
    env : str or pathlib.Path
        The file, for an arrivals or a ray run.
    timeout : float
        The run is ended after this long. [s]
    threads : int, optional
        1 holds bellhopcxx to one thread, None leaves it all; the Fortran program has one anyway.

    Returns
    -------
    BellhopRun

    Raises
    ------
    AcousticsError
        If the program is missing, fails, takes too long or writes no result; the message ends with the tail of
        its print file.

    Notes
    -----
    The Fortran program takes the name of the file alone; ``bellhopcxx`` and ``bellhopcuda`` are told that the
    run is 3-D.
    """
    binary, file = find_bellhop(program), Path(env).resolve()
    if not file.is_file():
        raise AcousticsError(f"{env}: no such file")
    words = [str(binary)]
    if "cxx" in binary.name or "cuda" in binary.name:
        words += ["--3D", *(["-1"] if threads == 1 else [])]
    outputs = [file.with_suffix(suffix) for suffix in (".arr", ".ray")]
    for old in (*outputs, file.with_suffix(".prt")):
        old.unlink(missing_ok=True)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    try:
        done = subprocess.run(  # a program that the user named, no shell
            [*words, file.stem],
            cwd=file.parent,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout,
            check=False,
            env={**os.environ, "LC_ALL": "C"},
        )
    except subprocess.TimeoutExpired:
        raise AcousticsError(
            f"{binary.name}: not finished with {file.name} after {timeout:g} s{_tail(file, b'')}"
        ) from None
    except OSError as error:
        raise AcousticsError(f"{binary}: cannot be run: {error.strerror}") from None
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    tail = _tail(file, done.stdout + done.stderr)
    if done.returncode != 0:
        raise AcousticsError(f"{binary.name}: failed on {file.name} with exit code {done.returncode}{tail}")
    written = [path for path in outputs if path.is_file() and path.stat().st_size > 0]
    if not written or "FATAL ERROR" in tail:
        raise AcousticsError(f"{binary.name}: wrote no arrivals or rays for {file.name}{tail}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return BellhopRun(output=written[0], cpu_time=cpu, wall_time=wall)


def _tail(file: Path, printed: bytes) -> str:
    """End of the print file, or of what the program said, on one line."""
    try:
        text = file.with_suffix(".prt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = printed.decode("utf-8", "replace")
    words = " ".join(text.split())
    return f"; its print file ends: {words[-_TAIL:]}" if words else "; it printed nothing"
