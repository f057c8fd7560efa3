"""
Tables of results in a terminal: headings break between words, and columns that do not fit follow
below.
"""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from pymantaray.records.result_table import Head, ResultTable

_NAME = 30  # characters of a row's name, or of a word, that a table shows in one line
_GAP = 3  # characters between columns, and at both ends of a line
_EDGE = 2
_BREAK = re.compile(r"(?<=\s)|(?<=[._])(?=[A-Za-z])")  # in a heading


def print_table(table: "ResultTable") -> None:
    """Print a table to standard output."""
    from rich.console import Console

    from pymantaray.records.digits import plain_signs

    console = Console()
    room = console.width - _EDGE
    rows = [[plain_signs(text) for text in row] for row in table.rows]
    columns = [[row[k] for row in rows] for k in range(len(table.heads))]
    least = [
        _least(head, cells, name=k == 0)
        for k, (head, cells) in enumerate(zip(table.heads, columns, strict=True))
    ]
    for number, block in enumerate(_blocks(least, room)):
        heads = [table.heads[k] for k in block]
        part = [columns[k] for k in block]
        widths = _widths([head.text for head in heads], [least[k] for k in block], room)
        console.print(_rich_table(heads, part, widths, "" if number else table.caption))


def _least(head: "Head", cells: Sequence[str], *, name: bool) -> int:
    """Smallest width of a column: numbers and short names of rows stay in one line."""
    whole = max(map(len, cells), default=0)
    if not (head.numbers or (name and whole <= _NAME)):
        whole = min(max((len(word) for cell in cells for word in cell.split()), default=0), _NAME)
    return max(whole, *(len(part.strip()) for part in _BREAK.split(head.text)))


def _blocks(least: Sequence[int], room: int) -> list[list[int]]:
    """Columns of each part of a table that fits the room; the first column is in all parts."""
    blocks: list[list[int]] = [[]]
    used = 0
    for k, width in enumerate(least):
        if blocks[-1] and used + _GAP + width > room and len(blocks[-1]) > min(len(blocks) - 1, 1):
            blocks.append([0] if k > 1 else [])
            used = least[0] if k > 1 else 0
        used += width + (_GAP if blocks[-1] else 0)
        blocks[-1].append(k)
    return blocks


def _folded(text: str, width: int) -> list[str]:
    """Lines of a heading in a width."""
    lines = [""]
    for part in _BREAK.split(text):
        if lines[-1] and len((lines[-1] + part).rstrip()) > width:
            lines.append("")
        lines[-1] += part
    return [line.rstrip() for line in lines]


def _widths(heads: Sequence[str], least: Sequence[int], room: int) -> list[int]:
    """Widths of columns; free room goes to the headings with most lines."""
    widths = list(least)
    for _ in range(room - sum(widths) - _GAP * (len(widths) - 1)):
        lines = [len(_folded(head, width)) for head, width in zip(heads, widths, strict=True)]
        if max(lines) == 1:
            break
        widths[lines.index(max(lines))] += 1
    return widths


def _rich_table(
    heads: "Sequence[Head]", columns: Sequence[Sequence[str]], widths: Sequence[int], caption: str
) -> "Table":
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    shown = Table(
        title=escape(caption) or None, title_justify="left", box=box.SIMPLE, pad_edge=False
    )
    for head, width in zip(heads, widths, strict=True):
        text = escape("\n".join(_folded(head.text, width)))
        justify = "right" if head.numbers else "left"
        shown.add_column(text, overflow="fold", justify=justify, min_width=width)  # type: ignore[arg-type]
    for cells in zip(*columns, strict=True):
        shown.add_row(*map(escape, cells))
    return shown
