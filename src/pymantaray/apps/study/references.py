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

from pymantaray.acoustics.reflection import sediment_source
from pymantaray.config.estimators import ConditionSection, FileBelief, NumericsBelief
from pymantaray.config.sections import AcousticsSection, DetectionSection, StudyConfig
from pymantaray.ocean import holds_casts
from pymantaray.ocean.equations import EQUATIONS
from pymantaray.ocean.files import open_file
from pymantaray.version import __version__

_SYNTHETIC = {
    "synthetic:beaufort": "steele2004 shimada2005 timmermans2014 timmermans2003 timmermans2008"
    " zhao2014 zhao2015",
    "synthetic:fram": "rudels2005 rudels2000 beszczynska2012 richter2018 hofmann2021 wekerle2020",
}
_SAYS = {
    "hycom": "chassignet2008",
    "glorys": "lellouche2021",
    "gebco": "weatherall2015",
    "etopo1": "amante2009",
}
"""Words in a file's attributes that identify the owner of its data."""
_ABSORPTION = {
    "francois-garrison": ("francois1982a", "francois1982b"),
    "ainslie-mccolm": ("ainslie1998",),
    "thorp": ("thorp1967", "jensen"),
}
_SURFACE = {"bubbles": ("apl-uw1994",), "coherent": ("pierson1964",)}
_SPECIAL = re.compile(r"([&%#_])")
_SOLVERS = {
    "gtsam": ("dellaert2012",),
    "incremental": ("dellaert2012", "kaess2012"),
    "fixed-lag": ("dellaert2012",),
    "kalman-filter": ("sola2017",),
}


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
        pages = str(f.get("pages", "")).replace("--", "-")
        parts = [
            f.get("title"),
            f.get("booktitle"),
            place,
            pages,
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
    >>> from pymantaray import citation, load_study
    >>> [reference.key for reference in citation(load_study("fram"))][-3:]
    ['dormand1980', 'snieder1998', 'sturm2012']
    """
    uses: dict[str, str] = {}
    for key, used_for in _relied_on(config):
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


def _relied_on(config: StudyConfig) -> Iterator[tuple[str, str]]:
    """Keys of references and the parts that rely on them; a key may occur several times."""
    yield MANTARAY.key, MANTARAY.used_for
    yield "kogucki-papalia", "conditions and noise of the study"
    o = config.ocean
    a = config.acoustics
    for source in o.source:
        yield from _data(source, "ocean")
    if isinstance(o.bathymetry, str):
        yield from _data(o.bathymetry, "sea floor")
    for key in EQUATIONS[o.equation].references:
        yield key, "sound speed"
    yield "dormand1980", "integration of rays"
    if a.spreading_cutoff_db != "none":
        yield "snieder1998", "reciprocal spreading of rays, by which weak rays are excluded"
    if a.currents:
        yield "munk1995", "sound in moving water"
    if config.detection is not None:
        yield from _sonar(config.detection, config.acoustics)
    for condition in config.conditions:
        yield from _condition(condition, config.solver_of(condition).kind)
    if config.solves:
        yield "sturm2012", "absolute trajectory error"


def _data(source: str, what: str) -> Iterator[tuple[str, str]]:
    """
    Owner of the data of a source: by name for a synthetic ocean, otherwise by the file's
    attributes.
    """
    if source.startswith("synthetic:"):
        for key in _SYNTHETIC.get(
            source, ""
        ).split():  # an unknown name raises an error when it is opened
            yield key, f"{what}, water masses of {source}"
        return
    said = ""
    if not holds_casts(source):
        with open_file(source) as data:
            said = " ".join(map(str, data.attrs.values())).lower()
    keys = [key for word, key in _SAYS.items() if word in said]
    for key in keys or [source]:
        yield key, what


def _sonar(s: DetectionSection, losses: AcousticsSection) -> Iterator[tuple[str, str]]:
    """Publications of the sonar equation."""
    for key in _ABSORPTION.get(s.absorption, ()):
        yield key, "absorption"
    if s.noise_spectral_level_db is None:
        yield "wenz1962", "ambient noise, in the form of Coates (1990)"
    for key in _SURFACE.get(losses.surface_loss, ()):
        yield key, "loss at the surface"
    if (source := sediment_source(losses.sediment)) is not None:
        yield source, "sediments"
    if s.leakage:
        yield "itu-p526", "sound behind an edge"


def _condition(e: ConditionSection, solver: str) -> Iterator[tuple[str, str]]:
    """References of one condition."""
    if isinstance(e.belief, FileBelief):
        for source in e.belief.source:
            yield from _data(source, "ocean that an estimator assumes")
    if isinstance(e.belief, NumericsBelief) and e.belief.equation is not None:
        for key in EQUATIONS[e.belief.equation].references:
            yield key, "sound speed that an estimator assumes"
    if e.modes is not None or e.variance.kind != "fixed":
        yield "munk1995", "travel times that depend on uncertain water"
    if e.loss == "gnc":
        yield "yang2020", "graduated non-convexity"
    for key in _SOLVERS.get(solver, ()):
        yield key, f"solver {solver}"


@cache
def _references() -> dict[str, dict[str, Any]]:
    return tomllib.loads(
        (files("pymantaray.apps.study") / "references.toml").read_text(encoding="utf-8")
    )


def _fields(key: str) -> Mapping[str, Any]:
    """BibTeX fields of a reference; any other key is the name of a file."""
    if key == MANTARAY.key:
        return MANTARAY.fields
    if key in _references():
        return _references()[key]
    return {"type": "misc", "title": key, "note": "data; cite as their provider asks"}
