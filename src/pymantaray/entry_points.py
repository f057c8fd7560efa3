"""Modules of other packages that extend this one, named as entry points of their distributions."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points

from pymantaray.errors import MantaRayError


@cache
def load_entry_points(group: str) -> None:
    """
    Import the modules of the entry points ``pymantaray.<group>``, once in a process.

    Raises
    ------
    MantaRayError
        If a module cannot be imported.
    """
    for point in sorted(entry_points(group=f"pymantaray.{group}"), key=lambda point: point.name):
        _load(point)


def _load(point: EntryPoint) -> None:
    """Import the module of an entry point."""
    try:
        point.load()
    except Exception as error:  # of a package that is not ours
        package = point.dist.name if point.dist else point.value
        raise MantaRayError(
            f"package {package!r}: its entry point {point.name!r} of {point.group!r} cannot be"
            f" loaded: {type(error).__name__}: {error}; repair or uninstall the package"
        ) from error
