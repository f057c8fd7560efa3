"""
Numbers of tiny runs, stored beside the tests: a change that should move none moves none.

A file `stored/<module>.json` in a folder of tests holds, for each test and each name in its result,
the shape, how many are not finite, and the numbers: all of a short array, the root mean square and
two weighted sums of a long one. They were never right because they are stored; laws and oracles say
that. ``pytest -n 0 --store-numbers FILE`` stores those of today, whose differences are for review.
"""

import dataclasses
import json
import math
import re
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter

RTOL = 1e-6  # of the largest number of an array: solvers end within it on any machine
ATOL = 1e-12  # below: rounding of what is zero
SHORT = 12  # numbers of an array that is stored whole
NUMBER = re.compile(r"(?<![\w.#])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
PATH = re.compile(r"\S*/\S*/\S*")
CHANGES = re.compile(
    r"seconds|elapsed|created|version|history|modified|folder|path$|^sha256|_s_cpu|cpu_ms|memory"
    r"|workers|least_eigenvalue|^distance$|lower_bound|gradient_norm"
)
"""Names of what differs from run to run or from machine to machine, and of where a solver ends."""


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Names and arrays or texts of all that a result holds."""
    below = f"{name}." if name else ""
    if isinstance(value, Figure):
        yield from leaves([artists(axes) for axes in value.axes], name)
    elif isinstance(value, Path):
        yield from _of_file(value, name)
    elif isinstance(value, xr.Dataset):
        yield from leaves(dict(value.variables) | {"attrs": value.attrs}, name)
    elif isinstance(value, xr.Variable | xr.DataArray):
        yield from leaves({"": value.values, "attrs": value.attrs}, name)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            if not CHANGES.search(str(key)):
                yield from leaves(item, f"{below}{PATH.sub('', str(key))}")
    elif isinstance(value, pd.DataFrame):
        yield from leaves({str(column): value[column].to_numpy() for column in value}, name)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        yield from leaves({field.name: getattr(value, field.name) for field in fields}, name)
        yield from _of_properties(value, name)
    elif hasattr(value, "_asdict"):
        yield from leaves(value._asdict(), name)
    elif isinstance(value, SimpleNamespace):
        yield from leaves(vars(value), name)
    elif isinstance(value, Enum):
        yield name, value.name
    elif value is None:
        yield name, np.asarray(np.nan)
    elif isinstance(value, str):
        yield from _of_text(value, name)
    elif isinstance(value, list | tuple):
        yield from _of_sequence(value, name)
    elif isinstance(value, bool | int | float | complex | np.ndarray | np.generic):
        yield from _of_array(np.asarray(value), name)


def _of_properties(value, name):
    """Numbers and texts that an object computes."""
    for key in dir(type(value)):
        if isinstance(getattr(type(value), key), property | cached_property) and key[0] != "_":
            found = getattr(value, key)
            if isinstance(found, bool | int | float | str | np.ndarray):
                yield from leaves({key: found}, name)


def _of_sequence(values, name):
    """A sequence of numbers as an array, of like items as columns, of others item by item."""
    if values and all(isinstance(v, bool | int | float | np.number | None) for v in values):
        yield from _of_array(np.array([math.nan if v is None else v for v in values]), name)
        return
    items = [dict(leaves(item)) for item in values]
    if len(items) > 1 and all(alike(item, items[0]) for item in items):
        for key, first in items[0].items():
            column = [item[key] for item in items]
            if isinstance(first, str):
                yield from _of_text(" ".join(column), f"{name}[]{key and '.'}{key}")
            else:
                yield f"{name}[]{key and '.'}{key}", np.stack(column)
        return
    yield f"{name}#", np.asarray(len(values))
    for i, item in enumerate(items):
        for key, value in item.items():
            yield f"{name}[{i}]{key and '.'}{key}", value


def alike(one: dict, other: dict) -> bool:
    """Whether two results have the same names, with texts and arrays of the same shapes."""
    return one.keys() == other.keys() and all(
        (type(v), np.shape(v)) == (type(other[k]), np.shape(other[k])) for k, v in one.items()
    )


def _of_text(text, name):
    """A text without names of files; of a long one the start and all its numbers."""
    text = PATH.sub("", text)
    yield name, text[:60]
    if len(text) > 60:
        yield f"{name}~", numbers_in(text)


def numbers_in(text: str) -> np.ndarray:
    """All numbers that are written in a text."""
    return np.array([float(number.replace("−", "-")) for number in NUMBER.findall(text)])


def _of_array(values, name):
    """An array of numbers; texts as one text."""
    if values.dtype.kind in "mM":
        values = values.astype(f"{values.dtype.kind}8[ns]").astype(float) / 1e9
    if values.dtype.kind in "OSUT":
        yield from _of_text(" ".join(str(v) for v in values.ravel()), name)
    elif values.dtype.kind == "c":
        yield name, np.stack([values.real, values.imag])
    elif values.dtype.names is None:
        yield name, values.astype(float)


def _of_file(path, name):
    """What a file holds, or all files of a folder."""
    if path.is_dir():
        for file in sorted(path.iterdir()):
            yield from _of_file(file, f"{name}/{file.name}")
    elif path.suffix == ".json":
        yield from leaves(json.loads(path.read_text()), name)
    elif path.suffix == ".nc":
        with xr.open_dataset(path, decode_times=False) as dataset:
            yield from leaves(dataset.load(), name)
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            yield from leaves(dict(arrays), name)
    elif path.suffix in (".csv", ".txt", ".tum", ".g2o", ".pyfg", ".env", ".bty", ".kml"):
        yield name, numbers_in(path.read_text())


def artists(axes) -> dict:
    """What is drawn in axes, in data coordinates where it has them."""
    drawn = {
        "title": axes.get_title(),
        "labels": [axes.get_xlabel(), axes.get_ylabel()],
        "limits": [*axes.get_xlim(), *axes.get_ylim()],
        "scales": [axes.get_xscale(), axes.get_yscale()],
        "ticks": [_ticks(axes.xaxis), _ticks(axes.yaxis)],
        "lines": [_line(line) for line in axes.lines],
        "texts": [[text.get_text(), *text.get_position(), text.get_size()] for text in axes.texts],
        "collections": [_collection(collection) for collection in axes.collections],
        "patches": [[patch.get_path().vertices, *patch.get_facecolor()] for patch in axes.patches],
        "images": [[image.get_array(), image.get_extent()] for image in axes.images],
    }
    if legend := axes.get_legend():
        drawn["legend"] = [text.get_text() for text in legend.get_texts()]
    return drawn


def _ticks(axis):
    """Names at an axis, if they are not its numbers, and how they are turned."""
    formatter = axis.get_major_formatter()
    names = [*formatter.seq] if isinstance(formatter, FixedFormatter) else []
    return [" ".join(names), *(label.get_rotation() for label in axis.get_ticklabels()[:1])]


def _line(line):
    """Where a line goes, and how it looks."""
    colour = to_rgba_array(line.get_color())
    look = [line.get_linewidth(), line.get_markersize(), line.get_linestyle(), line.get_marker()]
    return [line.get_xydata(), colour, str(look), line.get_zorder()]


def _collection(collection):
    """Where the parts of a collection are, and how they look."""
    paths = [path.vertices for path in collection.get_paths()]
    return {
        "offsets": np.ma.filled(collection.get_offsets(), np.nan),
        "paths": np.concatenate(paths) if paths else np.empty((0, 2)),
        "values": np.ma.filled(np.ma.asarray(collection.get_array(), float), np.nan)
        if collection.get_array() is not None
        else [],
        "faces": collection.get_facecolor(),
        "widths": collection.get_linewidth(),
    }


def entry(value: np.ndarray | str) -> list | str:
    """What is stored of one array, or of one text."""
    if isinstance(value, str):
        return value
    finite = np.isfinite(value)
    numbers = np.where(finite, value, 0.0).ravel()
    if numbers.size > SHORT:
        k = np.arange(numbers.size)
        weights = [np.cos(k * 0.5 * (math.sqrt(5) - 1)), np.cos(k * math.sqrt(2))]
        sums = [numbers @ weight / math.sqrt(numbers.size) for weight in weights]
        numbers = np.array([np.sqrt(np.mean(numbers**2)), *sums])
    return [list(value.shape), int((~finite).sum()), *(float(f"{v:.8g}") for v in numbers)]


def moved(stored: list | str, now: list | str) -> bool:
    """Whether an entry is not the same within the tolerance."""
    if isinstance(stored, str) or isinstance(now, str) or stored[:2] != now[:2]:
        return stored != now
    a, b = np.array(stored[2:]), np.array(now[2:])
    return a.size > 0 and not np.abs(a - b).max() <= RTOL * np.abs(a).max() + ATOL


@pytest.fixture
def as_stored(request):
    """Compare the numbers of a result with stored ones; slow tests store none."""
    file = request.path.parent / "stored" / f"{request.path.stem}.json"

    def check(result: Any, *, without: str = "(?!)", name: str = "") -> None:
        if request.node.get_closest_marker("slow"):
            return
        test = f"{request.node.name}{name and ' '}{name}"
        now = {path: entry(value) for path, value in leaves(result) if not re.search(without, path)}
        assert now, "no numbers"
        known = json.loads(file.read_text()) if file.exists() else {}
        if request.config.getoption("store_numbers"):
            file.parent.mkdir(exist_ok=True)
            lines = ",\n".join(
                f"{json.dumps(key)}: {{\n"
                + ",\n".join(f" {json.dumps(k)}: {json.dumps(v)}" for k, v in entries.items())
                + "\n}"
                for key, entries in sorted((known | {test: now}).items())
            )
            file.write_text(f"{{\n{lines}\n}}\n")
            return
        assert test in known, (
            f"store its numbers: pytest -n 0 --store-numbers {request.node.nodeid}"
        )
        differ = [
            f"{path}: {known[test].get(path)} is now {now.get(path)}"
            for path in sorted({*known[test], *now})
            if path not in known[test] or path not in now or moved(known[test][path], now[path])
        ]
        assert not differ, "\n".join(
            [f"{len(differ)} of {len(now)} moved; if they should, --store-numbers:", *differ[:12]]
        )

    return check
