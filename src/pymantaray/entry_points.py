"""
Modules of other packages that extend this one, named as entry points of their distributions.

Every call of their code is inside `Extension.guarded`, which turns whatever happens there into one
error line with the name of the package.
"""

import hashlib
import logging
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distribution, distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from pymantaray.errors import ExtensionError
from pymantaray.messages import one_line
from pymantaray.records import stops

SENSORS = "sensors"
FIGURES = "figures"
_LOG = logging.getLogger(__name__)
_LONGEST = 300  # characters of another package's error
_CURRENT: ContextVar["Extension | None"] = ContextVar("extension", default=None)


@dataclass(frozen=True)
class Extension:
    """Entry point of another package."""

    group: str
    name: str
    package: str
    version: str
    point: EntryPoint

    def __str__(self) -> str:
        """Package and entry point, for the beginning of an error line."""
        return (
            f"package {self.package!r}: its entry point {self.name!r} of 'pymantaray.{self.group}'"
        )

    def refuse(self, fault: str) -> NoReturn:
        """Raise the error line of a fault."""
        raise ExtensionError(f"{self} {fault}; repair or uninstall the package")

    @contextmanager
    def guarded(self, what: str) -> Iterator[None]:
        """
        Run code of the package: any exception, and `sys.exit`, becomes an `ExtensionError`.

        The block changes neither the working folder nor the handling of warnings and of
        floating-point errors, and its standard output goes to standard error.
        """
        token = _CURRENT.set(self)
        folder = _working_folder()
        try:
            with warnings.catch_warnings(), np.errstate(), redirect_stdout(sys.stderr):
                yield
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            if isinstance(error, SystemExit) and stops.handled.is_set():  # a stop request
                raise
            if isinstance(error, ExtensionError):
                raise
            raise ExtensionError(
                f"{self} {what}: {type(error).__name__}: {_text_of(error)}; repair or uninstall"
                " the package"
            ) from error
        finally:
            _CURRENT.reset(token)
            if folder is not None:
                os.chdir(folder)

    def load(self) -> Any:
        """Import the module; a module that failed is not imported again in this process."""
        module = _loaded(self)
        if isinstance(module, ExtensionError):
            raise ExtensionError(*module.args)
        return module

    @property
    def key(self) -> dict[str, str]:
        """Version, source and requirements of the package, on which its results depend."""
        return {
            "group": self.group,
            "name": self.name,
            "package": self.package,
            "version": self.version,
            "source": _source_hash(self),
            "requires": _versions_of_requirements(self),
        }


def current_extension() -> Extension | None:
    """Entry point whose code runs now; None for code of this package."""
    return _CURRENT.get()


@cache
def extensions(group: str) -> Mapping[str, tuple[Extension, ...]]:
    """Entry points ``pymantaray.<group>`` of all installed packages by name."""
    found: dict[str, list[Extension]] = {}
    packages = set[str]()
    for one in distributions():
        # reading the other metadata of all packages takes a third of a second
        if "pymantaray" not in _text_of_points(one):
            continue
        try:
            first = distribution(one.name)  # other folders of the path may have it, too
            package, number = first.name, first.version
            points = [*first.entry_points.select(group=f"pymantaray.{group}")]
        except Exception as error:  # noqa: BLE001  damaged metadata of any installed package
            _LOG.warning(
                "%s: its entry points cannot be read: %s; they are left out",
                one_line(getattr(one, "_path", "a package")),
                _text_of(error),
            )
            continue
        if package in packages:
            continue
        packages.add(package)
        for point in points:
            found.setdefault(point.name, []).append(
                Extension(group, point.name, package, number or "unknown", point)
            )
    return {name: tuple(found[name]) for name in sorted(found)}


def extension(group: str, name: str) -> Extension:
    """
    Entry point of a group by its name.

    Raises
    ------
    ExtensionError
        If no package has the entry point, or more than one has it.
    """
    known = extensions(group)
    if name not in known:
        raise ExtensionError(
            f"{group}: no installed package has {name!r}; found {', '.join(known) or 'none'};"
            f" install the package that has it as an entry point of pymantaray.{group}"
        )
    one, *others = known[name]
    if others:
        raise ExtensionError(
            f"{group}: packages {', '.join(other.package for other in known[name])} all have an"
            f" entry point {name!r}; uninstall all but one"
        )
    return one


def extension_keys(sensors: Iterable[str] = ()) -> list[dict[str, str]]:
    """Keys of all entry points in use: sensors of these names, and all figures."""
    figures = [one for several in extensions(FIGURES).values() for one in several]
    return [one.key for one in (*(extension(SENSORS, name) for name in sensors), *figures)]


@cache
def _loaded(one: Extension) -> Any:
    """Module of an entry point, or the error of its import."""
    try:
        with one.guarded("cannot be loaded"):
            return one.point.load()
    except ExtensionError as error:
        return error


@cache
def _source_hash(one: Extension) -> str:
    """
    Hash of all files of the package that has an entry point: those of its distribution, and those
    in the folder of its module.
    """
    content = hashlib.sha256()
    try:
        with one.guarded("has a source that cannot be read"):
            for name, file in sorted(_files_of(one).items()):
                if file.is_file() and "__pycache__" not in file.parts:
                    digest = hashlib.sha256(file.read_bytes()).hexdigest()
                    content.update(f"{name} {digest}\n".encode(errors="surrogateescape"))
    except ExtensionError as error:  # its import fails as well, with the same reason
        return str(error)
    return content.hexdigest()


def _files_of(one: Extension) -> dict[str, Path]:
    """Files of the package of an entry point by their names in the package."""
    out: dict[str, Path] = {}
    owner = one.point.dist
    for path in (owner.files or ()) if owner is not None else ():
        if not any(
            part.endswith((".dist-info", ".egg-info", "__pycache__")) for part in path.parts
        ):
            out[path.as_posix()] = Path(str(path.locate()))
    top = one.point.module.partition(".")[0]
    spec = find_spec(top)  # an editable installation lists no files
    if spec is None:
        return out
    if spec.submodule_search_locations is None:
        return out if spec.origin is None else out | {top: Path(spec.origin)}
    for folder in map(Path, spec.submodule_search_locations):
        out |= {f"{top}/{p.relative_to(folder).as_posix()}": p for p in folder.rglob("*")}
    return out


def _versions_of_requirements(one: Extension) -> str:
    """Versions of the packages that the package of an entry point requires."""
    from packaging.requirements import Requirement

    lines = []
    owner = one.point.dist
    for text in (owner.requires or ()) if owner is not None else ():
        with suppress(Exception):  # a requirement that is not installed or not readable
            name = Requirement(text).name
            lines.append(f"{name} {version(name)}")
    return ", ".join(sorted(lines))


def _text_of_points(one: Distribution) -> str:
    """Text of the entry points of an installed package; empty if it cannot be read."""
    try:
        return one.read_text("entry_points.txt") or ""
    except Exception:  # noqa: BLE001  damaged metadata of any installed package
        return ""


def _working_folder() -> str | None:
    try:
        return str(Path.cwd())
    except OSError:  # it was removed
        return None


def _text_of(error: BaseException) -> str:
    """One line of an exception, whose own text may fail."""
    try:
        return one_line(error, _LONGEST)
    except Exception:  # noqa: BLE001  of a class that is not ours
        return "no text"
