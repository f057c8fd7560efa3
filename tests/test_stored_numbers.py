"""Stored numbers: what moves is noticed, rounding is not, and each belongs to a test."""

import ast
import json
import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from stored_numbers import entry, leaves, moved

from pymantaray.records import RayStatus

TESTS = Path(__file__).parent
LONG = np.random.default_rng(0).normal(1450.0, 5.0, (40, 3))


@dataclass
class Result:
    """What an application may give."""

    position: np.ndarray
    status: RayStatus
    note: str

    @property
    def sigma_m(self):
        return 2.0


def stored(result):
    return {name: entry(value) for name, value in leaves(result)}


def test_fields_properties_and_attributes_are_stored():
    result = Result(np.array([1.0, math.nan]), RayStatus.OK, "in /tmp/a/b.csv, 3 m")
    water = xr.Dataset({"c": ("z", [1450.0], {"units": "m s-1"})})
    found = stored({"one": result, "water": water, "seconds": 3.0, "rows": [{"a": 1}, {"a": 2}]})
    assert found == {
        "one.position": [[2], 1, 1.0, 0.0],
        "one.status": "OK",
        "one.note": "in  3 m",
        "one.sigma_m": [[], 0, 2.0],
        "water.c.": [[1], 0, 1450.0],
        "water.c.attrs.units": "m s-1",
        "rows[].a": [[2], 0, 1.0, 2.0],
    }


@pytest.mark.parametrize("values", [LONG, LONG[0]])
def test_rounding_is_not_noticed_and_one_wrong_number_is(values):
    known = entry(values)
    assert not moved(known, entry(values * (1.0 + 1e-9)))
    wrong = values.copy()
    wrong.flat[2] += 0.1
    assert moved(known, entry(wrong))
    assert moved(known, entry(values[::-1]))
    assert moved(known, entry(values[..., 1:]))


def test_what_a_figure_shows_is_stored():
    figure, axes = plt.subplots()
    axes.plot([0.0, 1.0], [2.0, 3.0], label="way")
    axes.legend()
    axes.set_xlabel("time [s]")
    before = stored(figure)
    axes.lines[0].set_ydata([2.0, 4.0])
    differ = {name for name, value in stored(figure).items() if moved(before[name], value)}
    plt.close(figure)
    assert before["[0].labels[]"].strip() == "time [s]"
    assert before["[0].legend[0]"] == "way"
    assert differ == {"[0].lines[0].[0]"}


def test_numbers_of_tests_that_are_gone_are_gone():
    left = []
    for file in TESTS.rglob("stored/*.json"):
        module = file.parent.parent / f"{file.stem}.py"
        functions = {
            node.name
            for node in ast.walk(ast.parse(module.read_text()))
            if isinstance(node, ast.FunctionDef)
        }
        names = {key.split("[")[0].split(" ")[0] for key in json.loads(file.read_text())}
        left += [f"{file}: {name}" for name in names - functions]
    assert left == []
