"""
Tables as CSV: no cell is a formula for a spreadsheet, numbers stay numbers, and what is read back
is what was written.
"""

import csv
import io

import numpy as np
import pandas as pd
import pytest

from pymantaray.records.csv_text import csv_text, read_csv
from pymantaray.records.text_table import read_text_table

FORMULAS = [
    "=cmd|'/c calc'!A0",
    "=1+1",
    "+1+cmd",
    "-2+3+cmd|' /C calc'!D2",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    " =1+1",
    "'=1+1",
    "''@x",
]
HARMLESS = ["a\nb", "alpha", "a=b", "-1.5e-3", "+7", "-inf", "-", "O'Brien", "'tis", "1 - 2"]


def cells(text):
    return list(csv.reader(io.StringIO(text, newline="")))


@pytest.mark.parametrize("text", FORMULAS)
def test_text_that_a_spreadsheet_would_run_is_text_to_it(text):
    """
    Excel and LibreOffice take a cell for a formula by its first character; an apostrophe makes it
    text.
    """
    for rows in (
        cells(csv_text(pd.DataFrame({"node": [text, "b"]}))),
        cells(csv_text(pd.DataFrame({text: [1, 2]}))),
    ):
        shown = text.replace("\r", "\n")
        assert [cell for row in rows for cell in row if shown in cell] == [f"'{shown}"]


def test_no_text_begins_a_row_of_its_own():
    table = pd.DataFrame({"node": ["a\r=1+1", "a\r\n=1+1", "a\n=1+1", 'a",=1+1'], "n": range(4)})
    assert [len(row) for row in cells(csv_text(table))] == [2] * 5


@pytest.mark.parametrize("text", HARMLESS)
def test_other_text_and_numbers_are_left_as_they_are(text):
    assert cells(csv_text(pd.DataFrame({"node": [text]}))) == [["node"], [text]]
    table = pd.DataFrame({"x": [-1.5, np.nan], "n": [-2, 3], "t": [True, False]})
    assert csv_text(table) == table.to_csv(index=False)


def test_what_is_read_back_is_what_was_written(tmp_path):
    table = pd.DataFrame(
        {"=node": [*FORMULAS, *HARMLESS], "n": range(len(FORMULAS) + len(HARMLESS))}
    )
    (tmp_path / "t.csv").write_text(csv_text(table), encoding="utf-8", newline="")
    text = [
        cell.replace("\r", "\n") for cell in table["=node"]
    ]  # pandas reads any end of a line as \n
    back = read_csv(tmp_path / "t.csv")
    assert list(back.columns) == ["=node", "n"]
    assert [cell.replace("\r", "\n") for cell in back["=node"]] == text


def test_a_table_of_people_gives_the_names_that_were_exported(tmp_path):
    names = ["=a", "-b", "c", "'d"]
    (tmp_path / "t.csv").write_text(csv_text(pd.DataFrame({"vehicle": names, "depth": [1.0] * 4})))
    assert read_text_table(tmp_path / "t.csv").frame["vehicle"].tolist() == names
