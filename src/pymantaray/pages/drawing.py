"""Figures of a page, before and after they are drawn."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import NamedTuple

from matplotlib.figure import Figure

from pymantaray.pages.folder import FIGURES


class Picture(NamedTuple):
    """
    A drawn figure: size on the page [px], files by kind, signs, colours and words of its legend,
    counterpart in the paper, folder.
    """

    name: str
    caption: str
    width: int
    height: int
    files: Mapping[str, bytes]
    legend: Sequence[tuple[str, str, str]] = ()
    paper: str = ""
    folder: str = f"{FIGURES}/"


@dataclass(frozen=True)
class FigureSpec:
    """
    A figure of a report: file name without suffix, caption, function that draws it, counterpart in
    the paper, and function that draws it for one column of a journal, if it needs another layout.
    """

    name: str
    caption: str
    draw: Callable[[], Figure]
    paper: str = ""
    column: Callable[[], Figure] | None = None
    guard: Callable[[], AbstractContextManager[None]] = nullcontext
    """Context in which it is drawn: that of another package, if it is from one."""


def with_source(caption: str, *, synthetic: bool) -> str:
    """Caption with a remark if the ocean is synthetic."""
    return f"{caption} Synthetic ocean." if synthetic else caption
