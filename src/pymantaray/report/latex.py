"""Tables as LaTeX, with the heads and digits of the page, for a paper that loads booktabs."""

import pandas as pd

from pymantaray.report.page import ShownTable

_SIGNS = {"−": "$-$", "–": "--", "²": "$^2$", "≤": "$\\leq$", "°": "$^\\circ$"}


def latex(table: ShownTable, name: str) -> str:
    """A table as it is on the page; its label is ``tab:`` and its name."""
    frame = pd.DataFrame([[text for text, _ in row] for row in table.rows])
    frame = frame.reindex(columns=range(len(table.head)))
    frame.columns = pd.Index([_escaped(text) for text, *_ in table.head])
    content = frame.map(_escaped).to_latex(
        index=False,
        escape=False,
        column_format="".join("r" if mark == "number" else "l" for _, mark, _ in table.head),
        caption=_escaped(table.caption),
        label=f"tab:{name}",
        position="tb",
    )
    return str(content)


def _escaped(text: str) -> str:
    """Text whose special characters LaTeX writes as they are."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    special |= {sign: f"\\{sign}" for sign in "&%$#_{}"} | {"<": "$<$", ">": "$>$", "\n": " "} | _SIGNS
    return "".join(special.get(letter, letter) for letter in text)
