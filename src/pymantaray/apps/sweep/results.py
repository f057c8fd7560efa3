"""Results of a sweep: its progress, and one table of all points."""

import tomllib
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.apps.sweep.definition import Sweep, parse_sweep
from pymantaray.apps.sweep.keys import DONE, FAILED, PLAN, POINT, SWEEP, read_points
from pymantaray.apps.sweep.plan import SweepPlan, read_plan
from pymantaray.config.settings import key_heading
from pymantaray.errors import SweepError
from pymantaray.jobs.store import Store, open_store
from pymantaray.records.column_attributes import with_column_attributes
from pymantaray.records.result_table import ResultTable, notebook_html

OPEN = "open"


class Status(NamedTuple):
    """Progress of a sweep."""

    points: int
    done: int
    failed: int
    failures: dict[str, int]
    """Number of failed points by error line."""

    @property
    def open(self) -> int:
        """Number of unfinished points."""
        return self.points - self.done - self.failed


class SweepResults:
    """
    Results of a sweep, which may be unfinished.

    Parameters
    ----------
    store : Store
    sweep : Sweep
        Definition.
    keys : list of str
        Keys of its points.
    """

    def __init__(self, store: Store, sweep: Sweep, keys: list[str]) -> None:
        self.sweep = sweep
        self._store = store
        self._keys = keys

    def status(self) -> Status:
        """
        Count finished, failed and unfinished points; equal points count once.

        Returns
        -------
        Status
        """
        known = set(self._keys)
        done = 0
        lines = Counter[str]()
        for _, status, content in read_points(self._store, known):
            done += status == DONE
            lines.update([content["error"]] if status == FAILED else [])
        return Status(len(known), done, lines.total(), dict(lines.most_common()))

    @property
    def notes(self) -> list[str]:
        """Notes of the readers of all finished points, each once."""
        return list(dict.fromkeys(n for content in self.contents for n in content.get("notes", [])))

    @property
    def synthetic(self) -> bool:
        """True if the ocean of some finished point is synthetic."""
        return any(content.get("synthetic", False) for content in self.contents)

    @property
    def origin(self) -> dict[str, Any]:
        """Versions of MantaRay that computed the points, and the definition of the sweep."""
        versions = dict.fromkeys(c["version"] for c in self.contents if "version" in c)
        return {"versions": list(versions), "sweep": tomllib.loads(self.sweep.to_toml())}

    def _repr_html_(self) -> str:
        """HTML for a notebook: numbers of finished, failed and unfinished points, and the table."""
        status = self.status()
        counts = {
            DONE: status.done,
            FAILED: status.failed,
            OPEN: status.open,
            "points": status.points,
        }
        fields = [name for axis in self.sweep.axes for name in axis.coordinates()]
        return notebook_html(
            f"Sweep {self.sweep.name}", counts, [point_table(self.table(), fields)]
        )

    def table(self) -> pd.DataFrame:
        """
        Return a tidy table with one row per point and condition; an unfinished point has one row.

        Returns
        -------
        pandas.DataFrame
            ``point``, the swept fields, ``status``, ``error``, ``condition``, errors and
            consistency of the condition, counts of the point's links, seconds of its stages,
            ``key``.
        """
        coordinates = [axis.coordinates() for axis in self.sweep.axes]
        rows: list[dict[str, Any]] = []
        for number, content in enumerate(self.contents):
            place = self.sweep.place(number)
            fields = {
                n: v[k] for k, axis in zip(place, coordinates, strict=True) for n, v in axis.items()
            }
            links = content.get("links", {})
            seconds = {
                f"{name}_seconds": value for name, value in content.get("seconds", {}).items()
            }
            for condition, statistics in content.get("conditions", {"": {}}).items():
                row = {
                    "point": number,
                    **fields,
                    "status": content["status"],
                    "error": content.get("error", ""),
                }
                rows.append(
                    row
                    | {"condition": condition}
                    | statistics
                    | links
                    | seconds
                    | {"key": content["key"]}
                )
        return pd.DataFrame(rows)

    def dataset(self) -> xr.Dataset:
        """
        Return the table as a data set over the swept fields, with NaN for missing results.

        Returns
        -------
        xarray.Dataset
            Dimensions are the crossed fields, the groups of zipped fields, and ``condition``.
        """
        contents = self.contents
        conditions = list(dict.fromkeys(name for c in contents for name in c.get("conditions", {})))
        dims = [axis.name for axis in self.sweep.axes]
        shape = self.sweep.shape
        data: dict[str, Any] = {
            name: (dims, np.array([c.get(name, "") for c in contents], dtype=str).reshape(shape))
            for name in ("status", "error")
        }
        for group, ending in (("links", ""), ("seconds", "_seconds")):
            for name in dict.fromkeys(name for c in contents for name in c.get(group, {})):
                values = [c.get(group, {}).get(name) for c in contents]
                data[name + ending] = dims, np.array(values, dtype=float).reshape(shape)
        statistics = dict.fromkeys(
            name for c in contents for row in c.get("conditions", {}).values() for name in row
        )
        for name in statistics:
            values = [
                [c.get("conditions", {}).get(x, {}).get(name) for x in conditions] for c in contents
            ]
            array = np.array(values, dtype=float).reshape(*shape, len(conditions))
            data[name] = [*dims, "condition"], array
        coordinates: dict[str, Any] = {"condition": conditions}
        for axis in self.sweep.axes:
            for name, values in axis.coordinates().items():
                plain = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
                coordinates[name] = axis.name, np.array(values, dtype=float if plain else str)
        title = {"title": f"Sweep over {self.sweep.name}"}
        table = with_column_attributes(xr.Dataset(data, coordinates, title))
        for name in coordinates.keys() - {"condition"}:
            _, _, unit = key_heading(name).partition(" [")
            is_number = table[name].dtype.kind == "f"
            units = {"units": unit.removesuffix("]") or "1"} if is_number else {}
            table[name].attrs = {"long_name": name, **units}
        return table

    @cached_property
    def contents(self) -> list[dict[str, Any]]:
        """Contents of the files of all points."""
        there = {
            key: {"status": status, **content, "key": key}
            for key, status, content in read_points(self._store, set(self._keys))
        }
        return [there.get(key) or {"status": OPEN, "key": key} for key in self._keys]


def point_table(table: pd.DataFrame, fields: Sequence[str]) -> ResultTable:
    """
    Return the table of all points for pages, notebooks and commands.

    Parameters
    ----------
    table : pandas.DataFrame
        From `SweepResults.table`.
    fields : sequence of str
        Swept columns.

    Returns
    -------
    ResultTable
    """
    columns = [str(name) for name in table.columns if name != "key"]
    brief = ["point", *fields, "status", "condition", "mean_m", "rmse_m", "dropout_percent"]
    return ResultTable(
        "points",
        table,
        "Points",
        columns=columns,
        brief=[name for name in brief if name in columns],
        words={name: key_heading(name) for name in fields},
        file="table.csv",
    )


def open_sweep(place: str | Path) -> SweepResults:
    """
    Open the results of a finished or running sweep.

    Parameters
    ----------
    place : str or pathlib.Path
        Folder or URL of the sweep.

    Returns
    -------
    SweepResults

    Raises
    ------
    SweepError
        If there is no sweep.

    Examples
    --------
    >>> open_sweep("nowhere")
    Traceback (most recent call last):
        ...
    pymantaray.errors.SweepError: nowhere: not a sweep: it has no sweep.toml
    """
    store = open_store(place)
    content = store.read(SWEEP)
    if content is None:
        raise SweepError(f"{place}: not a sweep: it has no {SWEEP}")
    try:
        toml = content.decode()
    except UnicodeDecodeError:
        raise SweepError(
            f"{place}/{SWEEP}: cannot be read: not UTF-8 text; run the sweep again"
        ) from None
    sweep = parse_sweep(toml, f"{place}/{SWEEP}", Path())
    plan = read_plan(store.read(PLAN))
    known = plan is not None and plan.is_of(toml) and len(plan.keys) == len(sweep)
    return SweepResults(
        store, sweep, plan.keys if plan and known else [key[POINT] for key in SweepPlan(sweep).keys]
    )
