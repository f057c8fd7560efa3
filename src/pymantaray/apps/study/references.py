"""
Publications that a study relies on, as text and as BibTeX; `references.toml` contains all of them.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import metadata
from importlib.resources import files
from itertools import chain, count
from pathlib import Path
from typing import Any

from pymantaray.config.sections import StudyConfig
from pymantaray.version import __version__

_SPECIAL = re.compile(r"([&%#_])")


@dataclass(frozen=True)
class Reference:
    """Publication, and the parts of a study that rely on it."""

    key: str
    fields: Mapping[str, Any]
    used_for: str

    def __str__(self) -> str:
        """One line: authors, year, title, where, DOI."""
        f = self.fields
        year = f" ({f['year']})" if "year" in f else ""
        place = " ".join(str(f[name]) for name in ("journal", "volume") if name in f)
        parts = [
            f.get("title"),
            f.get("booktitle"),
            place,
            str(f.get("pages", "")).replace("--", "-"),
            *(f.get(name) for name in ("institution", "number", "publisher", "version", "note")),
            f"doi:{f['doi']}" if "doi" in f else "",
        ]
        authors = (
            f.get("author", "").strip("{}").replace(" and others", " et al.").replace(" and ", "; ")
        )
        return ", ".join(part for part in (authors + year, *parts) if part)

    @property
    def bibtex(self) -> str:
        """BibTeX entry."""
        values = {
            name: _SPECIAL.sub(r"\\\1", str(value))
            for name, value in self.fields.items()
            if name != "type"
        }
        lines = [f"  {name} = {{{value}}}," for name, value in values.items()]
        return "\n".join([f"@{self.fields['type']}{{{self.key},", *lines, "}"])


def _address() -> str:
    """Address of the repository in the package's metadata."""
    urls = metadata("pymantaray").get_all("Project-URL") or []
    by_label: dict[str, str] = dict(url.split(", ", 1) for url in urls)
    return by_label["Repository"]


MANTARAY = Reference(
    "mantaray",
    {
        "type": "software",
        "author": "{The MantaRay developers}",
        "title": "MantaRay: effects of refraction on acoustic ranges between underwater vehicles",
        "version": __version__,
        "year": "2026",
        "url": _address(),
    },
    "the software",
)
"""MantaRay itself, as in CITATION.cff."""


class Citations(tuple[Reference, ...]):
    """
    References in the order of the data flow; as text, one line each below the parts that rely on
    them.
    """

    __slots__ = ()

    def __str__(self) -> str:
        """One line per reference, grouped by use."""
        groups: dict[str, list[str]] = {}
        for reference in self:
            groups.setdefault(reference.used_for, []).append(f"  {reference}")
        return "\n".join(
            line for used_for, lines in groups.items() for line in (f"{used_for}:", *lines)
        )

    @property
    def bibtex(self) -> str:
        """Content of a `.bib` file with all entries."""
        return "\n\n".join(reference.bibtex for reference in self) + "\n"


def citation(config: StudyConfig) -> Citations:
    """
    List the publications that a study with this configuration relies on.

    Parameters
    ----------
    config : StudyConfig
        See `pymantaray.load_study`. Its files must exist, because their attributes identify the
        owners of the data.

    Returns
    -------
    Citations
        A tuple of references, each with ``key``, ``fields``, ``used_for`` and ``bibtex``; ``str``
        gives text, ``.bibtex`` a `.bib` file. An unknown data set has only its name: cite it as its
        provider asks.

    Raises
    ------
    OceanError
        If an ocean file cannot be opened.

    Examples
    --------
    >>> from pymantaray import load_study
    >>> from pymantaray.apps.study import citation
    >>> [reference.key for reference in citation(load_study("fram"))][-3:]
    ['dormand1980', 'snieder1998', 'sturm2012']
    """
    uses: dict[str, str] = {}
    for key, used_for in ((MANTARAY.key, MANTARAY.used_for), *config.references()):
        uses.setdefault(key, used_for)
    return Citations(
        Reference(name, _fields(key), used_for)
        for name, (key, used_for) in zip(_names(uses), uses.items(), strict=True)
    )


def _names(uses: Iterable[str]) -> Iterator[str]:
    """
    Keys in BibTeX; the key of a file is its stem, with a number if another reference has that key.
    """
    taken = set(_references())
    for key in uses:
        if key in _references():
            yield key
            continue
        stem = re.sub(r"[^\w.:+-]+", "-", Path(key).stem)
        names = chain([stem], (f"{stem}-{i}" for i in count(2)))
        name = next(name for name in names if name not in taken)
        taken.add(name)
        yield name


@cache
def _references() -> dict[str, dict[str, Any]]:
    return tomllib.loads((files("pymantaray") / "references.toml").read_text(encoding="utf-8"))


def _fields(key: str) -> Mapping[str, Any]:
    """BibTeX fields of a reference; any other key is the name of a file."""
    if key == MANTARAY.key:
        return MANTARAY.fields
    if key in _references():
        return _references()[key]
    return {"type": "misc", "title": key, "note": "data; cite as their provider asks"}
