"""State of the installation: packages, extras, output folders, kernels and processors."""

import hashlib
import os
import platform
import resource
import shlex
import sys
import tempfile
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "gtsam",
    "gsw",
    "pandas",
    "xarray",
    "netCDF4",
    "pyproj",
    "pydantic",
)
"""Packages that compute results; their versions are in the key of each result."""
_KERNELS = (
    "acoustics._kernels.field",
    "acoustics._kernels.link",
    "acoustics._kernels.paths",
    "estimation._kernels.cholesky",
    "estimation._kernels.residuals",
    "fleet.kernel",
)


def versions() -> dict[str, str | None]:
    """
    Versions of Python and of the packages that affect results; None for a package that is not
    installed.
    """
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


_SHOWING = ("cli", "pages", "plotting", "figures")
"""Folders whose modules show results and change none."""
_SHOWING_MODULES = ("command", "figures", "page", "plots", "report")
"""Last words of the names of such modules in other folders."""


@cache
def code_version() -> str:
    """
    Version of the package with a hash of what computes results, such as ``0.1.0+3f2a9c1b52d0``.

    The hash includes the source files, without those that only show results, and the versions of
    Python and of `PACKAGES`. With these, a checkout and its wheel have the same version.
    """
    root = Path(__file__).parent
    content = hashlib.sha256("".join(f"{k} {v}\n" for k, v in versions().items()).encode())
    for file in sorted(root.rglob("*.py")):
        name = file.relative_to(root)
        if not shows_results(name):
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            content.update(f"{name.as_posix()} {digest}\n".encode())
    return f"{_version('pymantaray')}+{content.hexdigest()[:12]}"


def shows_results(module: Path) -> bool:
    """True for a module that shows results and changes none, by its folder or its name."""
    last_word = module.stem.rpartition("_")[2]
    return last_word in _SHOWING_MODULES or not set(_SHOWING).isdisjoint(module.parts[:-1])


def peak_memory_mib() -> float:
    """
    Peak resident memory of this process. [MiB]

    Without ``/proc``, it is the peak of the parent process if that is larger.
    """
    try:
        with Path("/proc/self/status").open("rb", buffering=0) as file:
            status = file.read(2**16)  # in one call, because workers call this after each message
        return round(float(status.partition(b"VmHWM:")[2].split(maxsplit=1)[0]) / 2.0**10, 1)
    except (OSError, ValueError, IndexError):
        unit = 2.0**20 if sys.platform == "darwin" else 2.0**10  # bytes on macOS, KiB elsewhere
        return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)


def installation() -> dict[str, Any]:
    """
    Collect packages, extras, folders, processors and faults of the installation.

    Returns
    -------
    dict
        ``version``, ``folder``, ``python``, ``platform``; ``packages``, one row each (name,
        version, needs, fault); ``extras``, one row each (name, missing, install); ``folders``, one
        row each (use, folder, writable, remedy); ``kernels`` (compiled, all); ``processors``
        (cores, usable_cores, memory_gib); ``faults``, one line for each problem that prevents
        normal use.
    """
    packages, extras = _requirements()
    kernels = _kernels()
    folders = _folders(kernels)
    faults = [f"{row['name']}: {row['fault']}" for row in packages if row["fault"]]
    faults += [
        f"{row['folder']}: not writable; {row['remedy']}" for row in folders if not row["writable"]
    ]
    return {
        "version": _version("pymantaray"),
        "folder": str(Path(__file__).parent),
        "python": f"{platform.python_version()}, {sys.executable}",
        "platform": platform.platform(),
        "packages": packages,
        "extras": extras,
        "folders": folders,
        "kernels": {
            "compiled": sum(file.exists() for file in kernels),
            "all": len(kernels),
        },
        "processors": {
            "cores": os.cpu_count(),
            "usable_cores": len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count(),
            "memory_gib": round(
                os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1
            ),
        },
        "faults": faults,
    }


def _requirements() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Required packages and extras according to the metadata of the installed package."""
    from packaging.requirements import Requirement

    packages = []
    extras = dict[str, list[str]]()
    for line in requires("pymantaray") or ():
        requirement = Requirement(line)
        there = _version(requirement.name)
        fits = there is not None and requirement.specifier.contains(there, prereleases=True)
        marker = requirement.marker
        if marker is None:
            fault = (
                ""
                if fits
                else "is not installed"
                if there is None
                else "has an unsupported version"
            )
            packages.append(
                {
                    "name": requirement.name,
                    "version": there,
                    "needs": str(requirement.specifier),
                    "fault": fault,
                }
            )
        else:
            extra = str(marker).partition('extra == "')[2].partition('"')[0]
            missing = extras.setdefault(extra, [])
            missing += [] if fits else [f"{requirement.name}{requirement.specifier}"]
    rows = [
        {
            "name": extra,
            "missing": missing,
            "install": f"pip install {shlex.quote(f'pymantaray[{extra}]')}",
        }
        for extra, missing in extras.items()
    ]
    return packages, rows


def _kernels() -> list[Path]:
    """Index file of the disk cache of each entry; empty if nothing is cached on disk."""
    files = []
    for module in _KERNELS:
        for function in vars(import_module(f"pymantaray.{module}")).values():
            cache: Any = getattr(function, "_cache", None)
            if getattr(cache, "cache_path", None) and function.__module__ == f"pymantaray.{module}":
                files.append(Path(cache.cache_path, cache._cache_file._index_name))
    return files


def _folders(kernels: list[Path]) -> list[dict[str, Any]]:
    """Output folders, and the remedy for each that is not writable."""
    import matplotlib as mpl

    from pymantaray.compile import PLAIN

    caches: list[Path | None] = [*sorted({file.parent for file in kernels})]
    caches += [] if PLAIN or caches else [None]
    uses = [("compiled kernels", folder, "NUMBA_CACHE_DIR") for folder in caches]
    uses.append(("figures", Path(mpl.get_cachedir()), "MPLCONFIGDIR"))
    uses.append(("temporary files", Path(tempfile.gettempdir()), "TMPDIR"))
    uses.append(("results in the working folder", Path.cwd(), ""))
    return [
        {
            "use": use,
            "folder": str(folder or "nowhere"),
            "writable": folder is not None and _writable(folder),
            "remedy": f"set {variable} to a writable folder"
            if variable
            else "work in a writable folder",
        }
        for use, folder, variable in uses
    ]


def _writable(folder: Path) -> bool:
    """Return True if a file can be created in a folder; the folder is created if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
