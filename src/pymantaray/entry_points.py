"""Modules of other packages that extend this one, named as entry points of their distributions."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pymantaray.errors import MantaRayError


@cache
def extensions(group: str) -> dict[str, EntryPoint]:
    """Entry points ``pymantaray.<group>`` of all installed packages, by name."""
    points = entry_points(group=f"pymantaray.{group}")
    return {point.name: point for point in sorted(points, key=lambda point: point.name)}


@cache
def load_extension(group: str, name: str) -> Any:
    """
    Import the module of an entry point.

    Raises
    ------
    MantaRayError
        If no package has the entry point, or the module cannot be imported.
    """
    known = extensions(group)
    if name not in known:
        raise MantaRayError(
            f"{group}: no installed package has {name!r}; found {', '.join(known) or 'none'};"
            f" install the package that has it as an entry point of pymantaray.{group}"
        )
    try:
        return known[name].load()
    except Exception as error:  # of a package that is not ours
        raise MantaRayError(
            f"package {package_of(known[name])[0]!r}: its entry point {name!r} of"
            f" 'pymantaray.{group}' cannot be loaded: {type(error).__name__}: {error}; repair or"
            " uninstall the package"
        ) from error


def package_of(point: EntryPoint) -> tuple[str, str]:
    """Name and version of the package that has an entry point."""
    return (point.dist.name, point.dist.version) if point.dist else (point.value, "unknown")
