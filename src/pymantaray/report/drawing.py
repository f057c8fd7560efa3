"""Drawn figures, as processes exchange them: this module imports no library that draws."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from pymantaray.study.store import FIGURES


class Picture(NamedTuple):
    """A drawn figure: size on the page [px], files by kind, signs, colours and words of its legend, counterpart in the paper, folder."""

    name: str
    caption: str
    width: int
    height: int
    files: Mapping[str, bytes]
    legend: Sequence[tuple[str, str, str]] = ()
    paper: str = ""
    folder: str = f"{FIGURES}/"


class Drawing(NamedTuple):
    """Figures of a run by name, and its rays as JSON; empty if they are not drawn yet."""

    pictures: Mapping[str, Picture] = MappingProxyType({})
    rays: str = ""
