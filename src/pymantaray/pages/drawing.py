"""Drawn figures."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pymantaray.apps.study.store import FIGURES


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
