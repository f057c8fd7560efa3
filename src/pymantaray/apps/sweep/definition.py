"""Definition of a sweep: a base study and lists of values for its fields, crossed or zipped."""

import json
import math
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from pymantaray.config import StudyConfig, load_study, parse_study
from pymantaray.config.common import NONE
from pymantaray.config.conditions import with_conditions
from pymantaray.config.door.fleet import with_tracks
from pymantaray.config.keys import Tree, with_key
from pymantaray.config.load import STUDY_FILE, preset_names
from pymantaray.errors import StudyError, SweepError
from pymantaray.user_files import parse_toml, read_text

SEED = "study.seed"
COUNT = "fleet.count"
SPACING = "fleet.spacing"
_MAX_AXES = 100
_COLUMNS = frozenset(
    [
        "condition",
        "error",
        "key",
        "point",
        "status",
        "solves",
        "failed_solves",
        "n",
        "mean_m",
        "median_m",
        "rmse_m",
        "rmse_standard_error_m",
        "p5_m",
        "p25_m",
        "p75_m",
        "p95_m",
        "max_m",
        "ping_rmse_m",
        "ping_rmse_standard_error_m",
        "ping_median_m",
        "ping_from_straight_rmse_m",
        "ping_from_straight_rmse_standard_error_m",
        "ping_from_straight_median_m",
        "ping_bound_rmse_m",
        "ping_efficiency",
        "horizontal_nees_ratio",
        "horizontal_nees_inside",
        "horizontal_nees_tests",
        "position_nees_ratio",
        "position_nees_inside",
        "position_nees_tests",
        "ranges_nis_ratio",
        "ranges_nis_inside",
        "ranges_nis_tests",
        "attempts",
        "dropouts",
        "dropout_percent",
        "shadow",
        "blocked",
        "outside",
        "weak",
        "stopped",
        "unheard",
        "unresolved",
        "range_error_mean_m",
        "range_error_sd_m",
        "range_error_p1_m",
        "range_error_p5_m",
        "range_error_p95_m",
        "range_error_p99_m",
        "range_error_min_m",
        "range_error_max_m",
        "ocean_seconds",
        "fleet_seconds",
        "rays_seconds",
        "realizations_seconds",
        "summary_seconds",
    ]
)
"""Columns of a sweep's table in addition to the swept fields."""
_NAME = re.compile(r"[^\W\d_][\w .-]*(?<! )")
KEYS = {
    "base": "A preset, a study file relative to this one, or a whole study as tables"
    " ``[base.study]`` and so on.",
    "folder": "Folder for relative names of files among the values. Default: the folder of this"
    " file.",
    "cross": "Table of lists of values by field of a study, ``fleet.count`` or ``fleet.spacing``;"
    " all combinations are points.",
    "zip": "Tables ``[[zip]]`` of lists of equal length, whose values change together; ``name``"
    " and ``labels`` are for tables.",
    "seeds": "Seeds of studies, crossed with all other fields.",
}
"""Keys of a sweep file and their meaning."""


class Axis(NamedTuple):
    """Dimension of a sweep: fields whose values change together."""

    name: str
    values: dict[str, list[Any]]
    """Values by field, in lists of equal length."""
    labels: list[str] | None = None

    @property
    def size(self) -> int:
        """Number of values."""
        return len(next(iter(self.values.values())))

    def coordinates(self) -> dict[str, list[Any]]:
        """Labels of values in tables: numbers and text unchanged, JSON for anything else."""
        columns = {name: [_word(value) for value in values] for name, values in self.values.items()}
        return {self.name: list(self.labels), **columns} if self.labels else columns


class Sweep:
    """
    Many studies: a base study and values for its fields.

    Parameters
    ----------
    base : StudyConfig, str or pathlib.Path
        Study, preset or study file that all points change.
    cross : mapping of str to sequence, optional
        Values by field, such as ``{"noise.range_sigma": [0.5, 1.0]}``, in all combinations. A field
        may be a whole section, or part of an entry of a list by its number or name
        (``fleet.vehicles.B.target_depth``). Two more fields are ``fleet.count``, the number of
        vehicles taken from the start of the list, and ``fleet.spacing``, a factor on the distances
        of vehicles from the centre of the frame. ``None`` or ``"none"`` removes a section.
    zipped : sequence of mapping, optional
        Each mapping has the values of fields that change together, and a ``name`` and ``labels``
        for tables.
    seeds : sequence of int, optional
        Seeds of studies, crossed with all other fields.
    folder : str or pathlib.Path
        Folder for relative names of files among the values. Default: the working folder.

    Raises
    ------
    StudyError
        If the base is not a study.
    SweepError
        If values are not a list, a field occurs twice, or zipped lists have different lengths.

    Examples
    --------
    >>> sweep = Sweep("quick", cross={"noise.range_sigma": [0.5, 1.0]}, seeds=[1, 2, 3])
    >>> sweep.shape, len(sweep)
    ((2, 3), 6)
    """

    def __init__(
        self,
        base: StudyConfig | str | Path,
        *,
        cross: Mapping[str, Any] | None = None,
        zipped: Sequence[Mapping[str, Any]] = (),
        seeds: Sequence[int] = (),
        folder: str | Path = "",
    ) -> None:
        config = base if isinstance(base, StudyConfig) else load_study(base)
        self.name = config.study.name
        self._base: Tree = with_conditions(config.model_dump(exclude_none=True, exclude_unset=True))
        self._folder = Path(os.path.realpath(folder))
        axes = [
            Axis(name, {name: _list(name, values)}) for name, values in _flat(cross or {}).items()
        ]
        axes += [_zip(table, number) for number, table in enumerate(zipped, start=1)]
        if len(seeds):
            axes.append(Axis(SEED, {SEED: _list("seeds", seeds)}))
        names = [name for axis in axes for name in dict.fromkeys((axis.name, *axis.coordinates()))]
        if taken := sorted(_COLUMNS & set(names)):
            raise SweepError(
                f"sweep: {taken[0]} is the name of another column of its tables; give another name"
            )
        if twice := sorted(name for name, count in Counter(names).items() if count > 1):
            raise SweepError(
                f"sweep: {', '.join(twice)} is given more than once; remove all but one"
            )
        if len(axes) > _MAX_AXES:
            raise SweepError(
                f"sweep: {len(axes):,} fields or lists of them; at most {_MAX_AXES} can be crossed"
            )
        self.axes = tuple(axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(axis.size for axis in self.axes)

    def __len__(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    def place(self, number: int) -> tuple[int, ...]:
        """
        Return the index of a point along each axis; the last axis varies fastest.

        Parameters
        ----------
        number : int
            Number of the point, from 0.

        Returns
        -------
        tuple of int
        """
        place = []
        for size in reversed(self.shape):
            number, k = divmod(number, size)
            place.append(k)
        return tuple(reversed(place))

    def point(self, number: int) -> StudyConfig:
        """
        Return the study of a point.

        Parameters
        ----------
        number : int
            Number of the point, from 0.

        Returns
        -------
        StudyConfig

        Raises
        ------
        StudyError
            If the values do not make a valid study, with one line per finding that names the point.
        """
        values = {
            field: values[k]
            for k, axis in zip(self.place(number), self.axes, strict=True)
            for field, values in axis.values.items()
        }
        shown = ", ".join(f"{field} = {_word(value)}" for field, value in values.items())
        label = f"point {number} ({shown[:200]})" if shown else self.name
        tree = self._base
        for field in sorted(values, key=(COUNT, SPACING).__contains__):  # these two last
            try:
                tree = _with(tree, field, values[field])
            except (StudyError, SweepError) as error:
                raise StudyError(f"{label}: {error}") from None
        return with_tracks(parse_study(tree, label, self._folder))

    def to_toml(self) -> str:
        """
        Sweep file with the base; each crossed field is a zip of its own, so that axes keep their
        order.
        """
        tables = [
            {
                "name": axis.name,
                **({} if axis.labels is None else {"labels": axis.labels}),
                **axis.values,
            }
            for axis in self.axes
        ]
        return tomli_w.dumps({"folder": str(self._folder), "base": self._base, "zip": tables})


def load_sweep(file: str | Path, **changes: Any) -> Sweep:
    r"""
    Read a sweep file.

    Parameters
    ----------
    file : str or pathlib.Path
        TOML: ``base``, a preset or a study file; tables ``[cross]`` and ``[[zip]]``; ``seeds``. See
        `Sweep`.
    **changes
        Values of the base by dotted key, as for `pymantaray.load_study`.

    Returns
    -------
    Sweep

    Raises
    ------
    SweepError
        If the file is missing, not TOML or not a sweep.
    StudyError
        If its base is not a study.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.sweep import load_sweep
    >>> lines = ['base = "quick"', "seeds = [1, 2]", "[cross]", "noise.range_sigma = [0.5, 1]"]
    >>> _ = Path("sweep.toml").write_text("\n".join(lines))
    >>> load_sweep("sweep.toml").shape
    (2, 2)
    """
    path = Path(file)
    text = read_text(path, SweepError, what="a sweep file")
    return parse_sweep(text, str(path), path.parent, changes)


def parse_sweep(
    text: str, label: str, folder: Path, changes: Mapping[str, Any] | None = None
) -> Sweep:
    """
    Sweep from a file's text, with changes of the base; names of files in the text are relative to a
    folder.
    """
    tree = parse_toml(text, label, SweepError)
    if unknown := set(tree) - set(KEYS):
        raise SweepError(f"{label}: {min(unknown)}: unknown key; allowed: {', '.join(KEYS)}")
    base, cross, zipped, seeds = (tree.get(key) for key in ("base", "cross", "zip", "seeds"))
    folder = folder / tree.get("folder", "")
    if isinstance(base, str):
        base = folder / base if Path(base).suffix == STUDY_FILE else base
    elif isinstance(base, dict):
        base = parse_study(base, f"{label}: base", folder)
    else:
        raise SweepError(f"{label}: base: missing; give a preset or a study file")
    for key, kind, what in (
        ("cross", dict, "a table"),
        ("zip", list, "tables [[zip]]"),
        ("seeds", list, "a list"),
    ):
        if not isinstance(tree.get(key, kind()), kind):
            raise SweepError(f"{label}: {key}: must be {what}")
    if isinstance(base, str) and base not in preset_names():
        raise SweepError(
            f"{label}: base: found {base!r}; allowed: a file that ends in"
            f" {STUDY_FILE}, {', '.join(preset_names())}"
        )
    if changes:
        base = (base if isinstance(base, StudyConfig) else load_study(base)).with_(**changes)
    try:
        return Sweep(base, cross=cross, zipped=zipped or (), seeds=seeds or (), folder=folder)
    except SweepError as error:
        raise SweepError(f"{label}: {str(error).removeprefix('sweep: ')}") from None


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Values by dotted field; in the file, a dotted field is a quoted key or nested tables."""
    out: dict[str, Any] = {}
    for name, value in table.items():
        out |= (
            _flat(value, f"{before}{name}.")
            if isinstance(value, Mapping)
            else {before + name: value}
        )
    return out


def _list(field: str, values: Any) -> list[Any]:
    values = values.tolist() if hasattr(values, "tolist") else values
    if isinstance(values, (str, bytes)) or not isinstance(values, Sequence) or not len(values):
        raise SweepError(
            f"sweep: {field}: found {_word(values)}; it must be a list of at least one value"
        )
    plain = (value.item() if hasattr(value, "item") else value for value in values)
    return [NONE if value is None or value == {} else value for value in plain]


def _zip(table: Mapping[str, Any], number: int) -> Axis:
    rest = dict(table)
    name = rest.pop("name", None)
    labels = rest.pop("labels", None)
    if name is not None and not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise SweepError(
            f"sweep: zip {number}: name is {name!r}; it must begin with a letter and contain only"
            " letters, digits, blanks, . _ and -"
        )
    values = {field: _list(field, v) for field, v in _flat(rest).items()}
    if not values or (labels is not None and name is None):
        raise SweepError(
            f"sweep: zip {number}: fields, or the name of labels, are missing; give fields with"
            " values, and a name with labels"
        )
    lists = {**values, **({} if labels is None else {"labels": _list("labels", labels)})}
    if len({len(v) for v in lists.values()}) > 1:
        sizes = ", ".join(f"{field} {len(v)}" for field, v in lists.items())
        raise SweepError(
            f"sweep: zip {number}: lists have different lengths, {sizes}; give lists of equal"
            " length"
        )
    return Axis(
        str(name or next(iter(values))),
        values,
        None if labels is None else [str(x) for x in labels],
    )


def _word(value: Any) -> Any:
    """Value for a table or a message."""
    if isinstance(value, (dict, list, tuple)):
        return json.dumps(value, default=str, ensure_ascii=False, separators=(",", ":"))
    return value if isinstance(value, (bool, int, float, str)) else str(value)


def _with(tree: Tree, field: str, value: Any) -> Tree:
    """Copy of a tree with another value of one field."""
    vehicles = tree["fleet"].get("vehicles", ())
    if field == COUNT:
        if not isinstance(value, int) or not 1 <= value <= len(vehicles):
            raise SweepError(
                f"{COUNT} is {value}; it must be from 1 to {len(vehicles)}, the vehicles of the"
                " base"
            )
        field = "fleet.vehicles"
        value = vehicles[:value]
    if field == SPACING:
        if not isinstance(value, int | float):
            raise SweepError(f"{SPACING} is {value}; it must be a factor such as 0.5")
        field = "fleet.vehicles"
        value = [_spread(v, float(value)) for v in vehicles]
    return with_key(tree, field, value)


def _spread(vehicle: Tree, factor: float) -> Tree:
    out = {**vehicle, "north": factor * vehicle["north"], "east": factor * vehicle["east"]}
    if "points" in out:
        out["points"] = [
            [factor * north, factor * east, depth] for north, east, depth in out["points"]
        ]
    return out
