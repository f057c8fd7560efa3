"""
Digits, heads and forms of a table of results, which the terminal, notebooks, pages and LaTeX share.
"""

import re
from io import StringIO

import numpy as np
import pandas as pd
import pytest

from pymantaray.records.digits import show, show_alike, show_row
from pymantaray.records.result_table import ResultTable, heading


@pytest.mark.parametrize(
    ("value", "shown"),
    [(4620, "4,620"), (-4.9213, "−4.921"), (np.nan, "–"), (None, "–"), (0.0, "0"),
     (831875.0, "831,875"),
     (6.0e-5, "6.000e−05"), (True, "yes"), ("A", "A"), (np.int64(-3), "−3")],
)  # fmt: skip
def test_a_single_number_has_four_digits(value, shown):
    assert show(value) == shown


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ([143.0, 179.02, 34.94], ["143.00", "179.02", "34.94"]),
        ([-0.0181, 0.9698, np.nan], ["−0.0181", "0.9698", "–"]),
        ([24.0, 48.0, 0.0], ["24", "48", "0"]),
        ([12345.678, 3.0], ["12,345.68", "3.00"]),
        ([831875.4, 120.25], ["831,875", "120"]),
        ([831875.4, 0.25], ["831,875.4", "0.2"]),
        ([1e-9, 3.5], ["1.000e−09", "3.500e+00"]),
        ([0.00012, 3.5], ["0.0001", "3.5000"]),
        ([2e8, 3.0, np.nan], ["2.000e+08", "3.000e+00", "–"]),
        ([0.0, 0.0], ["0", "0"]),
        ([1, 2.5, "text", None], ["1", "2.500", "text", "–"]),
        ([74.5], ["74.50"]),
    ],
)
def test_numbers_of_a_column_have_equal_decimals_or_all_an_exponent(values, shown):
    assert show_alike(values) == shown


def test_equal_decimals_hold_for_numbers_of_all_sizes():
    rng = np.random.default_rng(3)
    for _ in range(500):
        low, high = np.sort(rng.uniform(-9, 9, 2))
        numbers = rng.choice([-1, 1], 6) * 10.0 ** rng.uniform(low, high, 6)
        texts = show_alike(numbers.tolist())
        (exponent,) = {"e" in text for text in texts}
        (decimals,) = {len(text.partition("e")[0].partition(".")[2]) for text in texts}
        read = np.array([float(text.replace(",", "").replace("−", "-")) for text in texts])
        assert (read != 0.0).all(), (numbers, texts)
        allowed = (
            0.5
            * 10.0**-decimals
            * (10.0 ** np.floor(np.log10(np.abs(numbers))) if exponent else 1.0)
        )
        assert (np.abs(read - numbers) <= 1.001 * allowed).all(), (numbers, texts)


def test_a_row_of_one_quantity_has_equal_decimals():
    assert show_row(["sd", 3.25, 4.0]) == ["sd", "3.250", "4.000"]
    assert show_row(["sigma", 0.1, "m"]) == ["sigma", "0.1", "m"]


def test_a_column_or_a_row_is_one_quantity_with_its_own_head():
    frame = pd.DataFrame(
        {"quantity": ["n", "sd_m"], "a": [4000.0, 3.25], "b": [3000.0, 4.0], "percent": [1.0, 2.5]}
    )
    by_column = ResultTable("t", frame, words={"percent": "predicted [%]"})
    assert by_column.rows == [["N", "4,000.00", "3,000", "1.000"], ["sd [m]", "3.25", "4", "2.500"]]
    assert [head.text for head in by_column.heads] == ["quantity", "a", "b", "predicted [%]"]
    by_row = ResultTable("t", frame, columns=("quantity", "a", "b"), by_row=True)
    assert by_row.rows == [["N", "4,000", "3,000"], ["sd [m]", "3.250", "4.000"]]


def test_columns_in_one_unit_have_equal_decimals_except_whole_numbers():
    frame = pd.DataFrame(
        {
            "mean_m": [143.1, 179.0],
            "p5_m": [2.064, 0.065],
            "distance_m": [20000.0, 500.0],
            "ratio": [0.5, 0.25],
            "tiny_s": [1e-7, 1.0],
            "lat": [74.5, 74.512345678],
        }
    )
    assert ResultTable("t", frame).rows == [
        ["143.10", "2.06", "20,000", "0.5000", "1.000e−07", "74.500000"],
        ["179.00", "0.07", "500", "0.2500", "1.000e+00", "74.512346"],
    ]


def test_headings_have_units_in_brackets():
    assert [heading(c) for c in ("mean_m", "p95_m", "start_h", "percent", "final_cost",
                                 "speed_m_s")] == [
        "mean [m]", "95 % [m]", "start [h]", "share [%]", "final cost", "speed [m/s]",
    ]  # fmt: skip


def test_a_table_for_print_has_short_lines():
    """
    Settings have their meaning instead of a key and no zeros; long texts and heads wrap; powers of
    ten are typeset.
    """
    words = "Error of the rotation as a fraction of its angle."
    frame = pd.DataFrame(
        {
            "key": ["noise.a", "noise.b"],
            "Fram": [1e-6, 0.1],
            "Beaufort": [1e-6, 0.25],
            "meaning": [words, "b"],
        }
    )
    latex = ResultTable("noise", frame, by_row=True).to_latex()
    assert r"{p{0.5\linewidth}rr}" in latex
    assert rf"{words} & 1.000$\times 10^{{-6}}$ & 1.000$\times 10^{{-6}}$ \\" in latex
    assert r"b & 0.1 & 0.25 \\" in latex
    long = pd.DataFrame({"condition": ["a"], "rmse_standard_error_m": [0.25]})
    assert (
        r"condition & \shortstack[r]{standard \\{} error of \\{} RMSE [m]} \\"
        in ResultTable("t", long).to_latex()
    )


def test_a_table_without_rows_has_its_heads():
    table = ResultTable("t", pd.DataFrame({"condition": [], "rmse_m": []}), "Errors")
    assert table.rows == []
    assert "condition & RMSE [m] \\\\\n\\midrule\n\\bottomrule" in table.to_latex()
    assert str(table) == "condition  RMSE [m]\n(no rows)"


def test_a_rounding_error_among_lengths_is_zero_and_needs_no_exponent():
    frame = pd.DataFrame(
        {"median_m": [12.3456, 1e-8, -3e-8, 0.0], "tiny_m": [1e-8, 2e-8, 0.0, 3e-8]}
    )
    cells = [
        list(column) for column in zip(*ResultTable("t", frame[["median_m"]]).rows, strict=True)
    ]
    assert cells == [["12.35", "0.00", "0.00", "0.00"]]
    alone = [row[0] for row in ResultTable("t", frame[["tiny_m"]]).rows]
    assert [float(text) for text in alone] == [1e-8, 2e-8, 0.0, 3e-8], (
        "the column has no longer lengths"
    )
    assert [row[0] for row in ResultTable("t", frame).rows] == cells[0], (
        "another column changes nothing"
    )


def test_every_form_has_the_same_cells():
    frame = pd.DataFrame({"condition": ["a_b", "50 %"], "rmse_m": [-1.25, 12.3456], "n": [1200, 3]})
    table = ResultTable("errors", frame, "Errors & more", brief=("condition", "rmse_m"))
    cells = [["a_b", "−1.25", "1,200"], ["50 %", "12.35", "3"]]
    assert table.rows == cells
    body = table.to_latex().partition("\\midrule\n")[2].partition("\\bottomrule")[0]
    latex = [line.removesuffix(" \\\\").split(" & ") for line in body.splitlines()]
    assert latex == [["a\\_b", "$-$1.25"], ["50 \\%", "12.35"]]
    assert "\\caption{Errors \\& more}" in table.to_latex()
    assert "\\label{tab:errors}" in table.to_latex()
    assert "\\toprule" in table.to_latex()
    html = re.findall(r"<td>(.*?)</td>", table._repr_html_())
    assert html == [text for row in cells for text in row[:2]]
    assert [line.split() for line in str(table).splitlines()[1:]] == [
        ["a_b", "-1.25", "1,200"], ["50", "%", "12.35", "3"],
    ]  # fmt: skip
    pd.testing.assert_frame_equal(pd.read_csv(StringIO(table.to_csv())), frame)


def test_a_cut_table_says_so():
    table = ResultTable("t", pd.DataFrame({"x": range(1000)}), "All.")
    assert table.first(500).caption == "All: the first 500 of 1,000 rows"
    assert len(table.first(500).rows) == 500
    assert table.first(1000) is table
