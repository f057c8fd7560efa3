"""
Water of the paper's authors' program: ``environment.json`` and its arrays, as a local ocean and
from one.
"""

import difflib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.messages import one_line
from pymantaray.quantities.checks import checked_array
from pymantaray.user_files import exists, open_regular, read_text, shown

ENDING = ".json"
ARRAYS = {
    "bathymetry": ("x", "y", "data"),
    "ssp": ("x", "y", "z", "data"),
    "current": ("x", "y", "z", "u", "v"),
}
"""
Arrays of each section; x is east, y north and z down, and fields are flat with x slowest and z
fastest.
"""
_SOURCE = "source_dir"
_FILES = {
    "bathymetry": {"data": "bathymetry"},
    "ssp": {"z": "depth_coords", "data": "ssp"},
    "current": {},
}
_MAX_JSON_BYTES = 10_000_000
_MAX_ARRAY_BYTES = 4_000_000_000
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_COMPONENTS = {"current_east": "u", "current_north": "v"}
_FIELDS = ("sound_speed", *_COMPONENTS)
_BELOW_FLOOR = 10.0  # m


def read_json(path: Path) -> dict[str, Any]:
    """
    Read a JSON file with a table.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    dict

    Raises
    ------
    OceanError
        If the file cannot be read, is not JSON, or has a key twice.
    """
    text = read_text(path, OceanError, what="a JSON file", limit=_MAX_JSON_BYTES)
    try:
        tree = json.loads(text, object_pairs_hook=_without_repetition, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise OceanError(f"{path}: not valid JSON: {one_line(error)}") from None
    if not isinstance(tree, dict):
        raise OceanError(f"{path}: found {type(tree).__name__}; it must be a table in braces")
    return tree


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    tree = dict(pairs)
    if len(tree) < len(pairs):
        names = [key for key, _ in pairs]
        raise ValueError(f"key {next(key for key in names if names.count(key) > 1)!r} occurs twice")
    return tree


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is not a number of JSON")


def find_file(name: str, beside: Path) -> Path:
    """
    Find a file or folder that a file of the program names.

    The program's names are relative to its working folder, which is unknown here. The first of
    these exists: the name relative to the folder of the file, to the present working folder, and
    without leading ``../`` to each folder above the file.

    Parameters
    ----------
    name : str
    beside : pathlib.Path
        File that contains the name.

    Returns
    -------
    pathlib.Path
        The found path; if there is none, the first of these.
    """
    folder = beside.absolute().parent
    parts = Path(name).parts
    while parts and parts[0] in ("..", "."):
        parts = parts[1:]
    above = [folder, *folder.parents]
    places = [folder / name, Path(name).absolute(), *(parent.joinpath(*parts) for parent in above)]
    return next((place for place in places if exists(place)), places[0])


def is_environment(path: str | Path) -> bool:
    """True if a name is that of a JSON file."""
    return Path(path).suffix == ENDING


def files_of(path: str | Path) -> tuple[str, ...]:
    """A file of an ocean, and the arrays of an ``environment.json`` that can be read."""
    if not is_environment(path):
        return (str(path),)
    try:
        paths = _paths(Path(path))
    except OceanError:
        return (str(path),)
    return (
        str(path),
        *dict.fromkeys(str(file) for files in paths.values() for file in files.values()),
    )


def _paths(path: Path) -> dict[str, dict[str, Path]]:
    """File of each array, by section and key."""
    tree = read_json(path)
    _check_keys(path, "", tree, (_SOURCE, *ARRAYS), needed=(_SOURCE, "ssp"))
    if not isinstance(tree[_SOURCE], str):
        raise OceanError(
            f"{path}: {_SOURCE}: found {tree[_SOURCE]!r}; it must be the name of a folder"
        )
    source = find_file(tree[_SOURCE], path)
    if not (exists(source) and source.is_dir()):
        raise OceanError(f"{path}: {_SOURCE}: no folder {shown(source)}; correct the name")
    out = {}
    for section, keys in ARRAYS.items():
        if section in tree:
            if not isinstance(tree[section], dict):
                raise OceanError(
                    f"{path}: {section}: found {tree[section]!r}; it must be a table in braces"
                )
            _check_keys(path, f"{section}.", tree[section], keys, needed=keys)
            names = {key: tree[section][key] for key in keys}
            for key, name in names.items():
                if not isinstance(name, str):
                    raise OceanError(
                        f"{path}: {section}.{key}: found {name!r}; it must be a file name"
                    )
            out[section] = {key: source / name for key, name in names.items()}
    return out


def _check_keys(
    path: Path, before: str, tree: dict[str, Any], known: tuple[str, ...], needed: tuple[str, ...]
) -> None:
    for key in tree:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = (
                f"Did you mean `{before}{close[0]}`?" if close else f"Allowed: {', '.join(known)}"
            )
            raise OceanError(f"{path}: `{before}{one_line(key, 60)}`: unknown key. {hint}")
    missing = [key for key in needed if key not in tree]
    if missing:
        raise OceanError(f"{path}: {before}{missing[0]}: missing; add it")


def read_arrays(path: str | Path) -> dict[str, dict[str, Array]]:
    """
    Read the arrays of an ``environment.json``.

    Parameters
    ----------
    path : str or pathlib.Path

    Returns
    -------
    dict of str to dict of str to ndarray
        Arrays by section and key of `ARRAYS`; fields have the shape of their axes.

    Raises
    ------
    OceanError
        If a file is missing or is not what the program reads: double precision in C order, with
        increasing axes.
    """
    out: dict[str, dict[str, Array]] = {}
    for section, files in _paths(Path(path)).items():
        arrays = {
            key: _array(file, f"{Path(path).name}: {section}.{key}") for key, file in files.items()
        }
        axes: list[str] = [key for key in ("x", "y", "z") if key in arrays]
        for key in axes:
            label = f"{Path(path).name}: {section}.{key}"
            arrays[key] = checked_array(
                OceanError, label, arrays[key].ravel(), (None,), rising=True
            )
        shape = tuple(arrays[key].size for key in axes)
        for key in arrays.keys() - set(axes):
            if arrays[key].size != np.prod(shape):
                raise OceanError(
                    f"{Path(path).name}: {section}.{key} has {arrays[key].size} values; its axes"
                    f" {', '.join(axes)} need {_text(shape)}"
                )
            arrays[key] = arrays[key].reshape(shape)
        out[section] = arrays
    return out


def _array(file: Path, label: str) -> Array:
    """
    Array of a ``.npy`` file, whose header is compared with its size before memory is allocated.
    """

    def refusal(text: str) -> OceanError:
        return OceanError(f"{label}: {text}")

    with open_regular(file, refusal, what="a .npy file", limit=_MAX_ARRAY_BYTES) as stream:
        try:
            shape, fortran, dtype = _HEADERS[np.lib.format.read_magic(stream)](stream)
        except (ValueError, EOFError, KeyError, SyntaxError, RecursionError) as error:
            raise refusal(
                f"{shown(file)}: not a .npy file of numbers ({one_line(error)})"
            ) from None
        if dtype != np.float64:
            raise refusal(
                f"{shown(file)}: {dtype}; the program reads float64 only; convert the array"
            )
        if fortran and len(shape) > 1:
            raise refusal(
                f"{shown(file)}: Fortran order; the program reads C order only; use"
                " numpy.ascontiguousarray"
            )
        values = stream.read()
    if len(values) != math.prod(shape) * dtype.itemsize:
        raise refusal(
            f"{shown(file)}: {len(values):,} bytes of values, but its header says {_text(shape)}"
            " values; write the array again"
        )
    return np.frombuffer(values, dtype=dtype).reshape(shape).copy()


def _text(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "1"


def read_environment(path: str | Path) -> xr.Dataset:
    """
    Read an ``environment.json`` as a data set in metres.

    Parameters
    ----------
    path : str or pathlib.Path
        The JSON file. Relative names in it are found as by `find_file`.

    Returns
    -------
    xarray.Dataset
        Data set for `ocean_in_metres`, on the axes of the sound speed. Currents on other axes are
        on the grid points of both, which does not change their trilinear interpolation, and
        constant beyond their edges. The bathymetry keeps its axes.

    Raises
    ------
    OceanError
        As by `read_arrays`.
    """
    arrays = read_arrays(path)
    speed = arrays["ssp"]
    axes = {"east": speed["x"], "north": speed["y"], "depth": speed["z"]}
    fields = {"sound_speed": speed["data"]}
    if current := arrays.get("current"):
        own = {name: current[key] for name, key in (("east", "x"), ("north", "y"), ("depth", "z"))}
        both = {name: np.nan_to_num(current[key]) for name, key in _COMPONENTS.items()}
        if any(not np.array_equal(own[name], axes[name]) for name in axes):
            joint = {name: _joint(axes[name], own[name]) for name in axes}
            fields = {"sound_speed": _at_nodes(axes, speed["data"], joint)}
            both = {name: _at_nodes(own, values, joint) for name, values in both.items()}
            axes = joint
        fields |= both
    variables: dict[str, Any] = {name: (tuple(axes), values) for name, values in fields.items()}
    coordinates = dict(axes)
    if bed := arrays.get("bathymetry"):
        same = all(
            np.array_equal(bed[key], axes[name]) for key, name in (("x", "east"), ("y", "north"))
        )
        dims = ("east", "north") if same else ("floor_east", "floor_north")
        variables["sea_floor_depth"] = dims, bed["data"]
        coordinates |= {} if same else dict(zip(dims, (bed["x"], bed["y"]), strict=True))
    return xr.Dataset(variables, coordinates, {"title": Path(path).stem, "source": str(path)})


def _joint(axis: Array, other: Array) -> Array:
    """Grid points of an axis, and those of another between its ends."""
    return np.union1d(axis, other[(other > axis[0]) & (other < axis[-1])])


def _at_nodes(axes: dict[str, Array], values: Array, nodes: dict[str, Array]) -> Array:
    """Field at other grid points by trilinear interpolation."""
    places = np.stack(np.meshgrid(*nodes.values(), indexing="ij"), axis=-1)
    return linear_interpolator(tuple(axes.values()), values)(places)


def environment_arrays(local: xr.Dataset) -> dict[str, dict[str, Array]]:
    """
    Arrays of an ``environment.json`` for a local ocean.

    Parameters
    ----------
    local : xarray.Dataset
        Local ocean.

    Returns
    -------
    dict of str to dict of str to ndarray
        As by `read_arrays`. If the sea floor is not above the last level, a level is added below
        it, because the program traces rays in levels only.
    """
    deepest = float(local["sea_floor_depth"].max())
    if deepest >= float(local["depth"][-1]):
        below = local.isel(depth=[-1]).assign_coords(depth=[deepest + _BELOW_FLOOR])
        with_level = xr.concat([local[list(_FIELDS)], below[list(_FIELDS)]], dim="depth")
        local = with_level.assign(sea_floor_depth=local["sea_floor_depth"])
    axes = {
        key: local[name].values for key, name in (("x", "east"), ("y", "north"), ("z", "depth"))
    }
    bed = local["sea_floor_depth"]
    own = "floor_east" in bed.dims
    dims = ("floor_east", "floor_north") if own else ("east", "north")

    def field(name: str) -> Array:
        return np.ascontiguousarray(
            local[name].transpose("east", "north", "depth").values, dtype=float
        )

    return {
        "bathymetry": {
            "x": local[dims[0]].values,
            "y": local[dims[1]].values,
            "data": np.ascontiguousarray(bed.transpose(*dims).values, dtype=float),
        },
        "ssp": {**axes, "data": field("sound_speed")},
        "current": {**axes, **{key: field(name) for name, key in _COMPONENTS.items()}},
    }


def write_environment(
    arrays: dict[str, dict[str, Array]], folder: Path, source: str = "environment"
) -> None:
    """
    Write ``environment.json`` and its arrays into a folder.

    Parameters
    ----------
    arrays : dict of str to dict of str to ndarray
        From `read_arrays` or `environment_arrays`.
    folder : pathlib.Path
        Existing folder.
    source : str
        Name of the folder of the arrays, relative to ``folder``.
    """
    tree: dict[str, Any] = {_SOURCE: source}
    for section, values in arrays.items():
        (folder / source / section).mkdir(parents=True)
        tree[section] = {}
        for key, array in values.items():
            stem = _FILES[section].get(key, f"{key}_coords" if key in ("x", "y", "z") else key)
            tree[section][key] = f"{section}/{stem}.npy"
            np.save(
                folder / source / section / f"{stem}.npy",
                np.asarray(array, dtype=np.float64).ravel(),
            )
    (folder / f"environment{ENDING}").write_text(
        json.dumps(tree, indent=1) + "\n", encoding="utf-8"
    )
