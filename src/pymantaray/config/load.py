"""
Reading of presets and TOML files, with their bases, and of options of `open_water`, to validated
configurations.
"""

import re
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pymantaray.config.checks import NAME
from pymantaray.config.common import NONE, located
from pymantaray.config.conditions import with_conditions
from pymantaray.config.keys import Tree, changed, described, merged, with_key, words_of
from pymantaray.config.parse import parse
from pymantaray.config.sections import (
    AcousticsSection,
    DetectionSection,
    OceanSection,
    SoundConfig,
    StudyConfig,
)
from pymantaray.config.text import STARTER, commented_toml
from pymantaray.errors import MantaRayError, StudyError, WaterError
from pymantaray.messages import did_you_mean
from pymantaray.user_files import exists, parse_toml, read_text

if TYPE_CHECKING:
    import xarray as xr

STUDY_FILE = ".toml"
"""Ending of a study file."""
BASE = "base"
"""Key at the top of a file for the preset or file that it changes."""
PLAN = "plan"
"""Section of a file for `mantaray plan`; a study is the same without it."""
_PRESETS = files("pymantaray.config") / "presets"
_MAX_BYTES = 10_000_000


def list_presets() -> dict[str, str]:
    """
    List the names of all presets with their one-line descriptions.

    Returns
    -------
    dict of str to str

    Examples
    --------
    >>> from pymantaray.config import list_presets
    >>> list(list_presets())
    ['beaufort', 'estimators-beaufort', 'estimators-fram', 'fram', 'quick', 'survey']
    """
    return {name: load_study(name).study.description for name in preset_names()}


def preset_text(name: str) -> str:
    """
    Return the TOML text of a preset with the meaning of each key; keys at their defaults are
    commented out.

    Parameters
    ----------
    name : str
        Name of the preset.

    Returns
    -------
    str
        Text for `load_study`.

    Raises
    ------
    StudyError
        If the preset does not exist; the message lists the presets.

    Examples
    --------
    >>> from pymantaray.config import preset_text
    >>> lines = preset_text("quick").splitlines()
    >>> next(line for line in lines if line.startswith("duration_h")).partition("#")[0].strip()
    'duration_h = 24.0'
    """
    _check_preset(name)
    return commented_toml(load_study(name))


def starter_text(name: str, **changes: Any) -> str:
    """
    Return the TOML text of a preset for a new study file: as `preset_text`, after some lines that
    explain its use.

    Parameters
    ----------
    name : str
        Name of the preset.
    **changes
        Values by dotted key, as for `load_study`.

    Returns
    -------
    str

    Raises
    ------
    StudyError
        As for `preset_text`, or if a change is not allowed.

    Examples
    --------
    >>> from pymantaray.config import starter_text
    >>> text = starter_text("quick", **{"noise.range_sigma": 2.0})
    >>> next(line for line in text.splitlines() if line.startswith("range_sigma"))
    'range_sigma = 2.0  # Standard deviation of a range, modem jitter included. [m]'
    """
    _check_preset(name)
    config = load_study(name, **changes)
    origin = config.study.description if changes else f"the preset {name}"
    return STARTER.format(name=origin) + commented_toml(config)


def load_study(
    name_or_file: str | Path,
    *,
    realizations: int | None = None,
    ocean: "str | Path | Sequence[str | Path] | xr.Dataset | None" = None,
    **changes: Any,
) -> StudyConfig:
    """
    Read and check the configuration of a study; the description of a changed configuration lists
    the changes.

    Parameters
    ----------
    name_or_file : str or pathlib.Path
        Name of a preset, or a TOML file. Names of files in it are relative to its folder. The key
        ``base`` of a file is a preset or another file, whose keys apply unless the file has them.
    realizations : int, optional
        Number of realizations, which replaces the configured one.
    ocean : str, path, sequence of them, or xarray.Dataset, optional
        Ocean that replaces the whole section ``[ocean]``: files, a profile or cast, the name of a
        synthetic ocean, a preset or TOML file for its ocean, or an ocean in memory. Names of files
        are relative to the working folder; the time is the only time of the files, and the centre
        is the middle of the data. An ocean in memory is written to the user's cache, where other
        processes and later sessions find it.
    **changes
        Values by dotted key, such as ``**{"noise.range_sigma": 2.0}``. Part of a key may be the
        name of an entry (``fleet.vehicles.B.target_depth``); ``"none"`` removes a value. Names of
        files are relative to the working folder.

    Returns
    -------
    StudyConfig

    Raises
    ------
    StudyError
        If the file is missing or not TOML, or a value is not allowed, with one line per finding:
        file, key, value and allowed values.

    Examples
    --------
    >>> load_study("beaufort", realizations=2).study.realizations
    2
    >>> load_study("quick", **{"noise.range_sigma": 2.0}).noise.range_sigma
    2.0
    """
    name = str(name_or_file)
    words = []
    tree = _tree(name_or_file)
    if realizations is not None:
        tree = with_key(tree, "study.realizations", realizations)
        words.append(f"{realizations} realization{'' if realizations == 1 else 's'}")
    if ocean is not None:
        if hasattr(ocean, "data_vars"):
            from pymantaray.ocean import stored_ocean

            ocean = stored_ocean(cast("xr.Dataset", ocean))
        sources = listed_sources(ocean, "ocean", StudyError)
        section = {"source": sources}
        if len(sources) == 1 and (sources[0].endswith(STUDY_FILE) or sources[0] in preset_names()):
            section = _tree(sources[0]).get("ocean", {})
        tree = {**tree, "ocean": located(section, Path())}
        words.append(f"the ocean {' '.join(sources)}")
    tree = changed(tree, changes)
    words += words_of(changes)
    return parse_study(described(tree, name, words) if words else tree, name)


def listed_sources(
    source: Any, name: str, error: type[MantaRayError], objects: str = "or an xarray.Dataset"
) -> list[str]:
    """
    Words of a source that consists of names or files; another object raises an error that names
    the allowed ``objects``.
    """
    if isinstance(source, str | Path):
        return [str(source)]
    import xarray as xr

    if not isinstance(source, Sequence):
        raise error(
            f"{name} is of type {type(source).__name__}; it must be a name, a path, a sequence of"
            f" them, {objects}"
        )
    if several := sum(isinstance(word, xr.Dataset) for word in source):
        raise error(
            f"{name} has {several} data sets in a sequence; join them with xarray.merge and give"
            " one"
        )
    return [str(word) for word in source]


def load_sound(name_or_file: str | Path, **changes: Any) -> SoundConfig:
    """
    Read the sections of a configuration that ranging needs; a file may have only these.

    Parameters
    ----------
    name_or_file : str or pathlib.Path
        Name of a preset, or a TOML file with the section ``[ocean]`` and, where their defaults do
        not fit, ``[mission]``, ``[acoustics]``, ``[ranging]`` and ``[detection]``. A file with a
        fleet is read as a study; in other files, the remaining sections are ignored.
    **changes
        Values by dotted key, as for `load_study`.

    Returns
    -------
    SoundConfig
        A `StudyConfig` for a study.

    Raises
    ------
    StudyError
        As for `load_study`.

    Examples
    --------
    >>> from pymantaray.config import load_sound
    >>> sound = load_sound("quick", **{"ocean.source": "synthetic:fram"})
    >>> sound.ocean.source, sound.acoustics.interpolation
    (('synthetic:fram',), 'smooth')
    """
    tree = _tree(name_or_file)
    label = str(name_or_file)
    if "fleet" in tree:
        return parse_study(changed(tree, changes), label)
    others = StudyConfig.model_fields.keys() - SoundConfig.model_fields.keys()
    sound = {name: section for name, section in tree.items() if name not in others}
    return parse(SoundConfig, changed(sound, changes), label, None)


def sound_sections(file: Path) -> dict[str, Any]:
    """
    Section ``[detection]`` and keys of ``[acoustics]`` of a TOML file by dotted key; other sections
    are ignored.
    """
    tree = _tree(file)
    if not isinstance(tree.get("detection"), dict):
        raise StudyError(f"{file}: no section [detection]; add it")
    parse(DetectionSection, tree["detection"], f"{file}: detection", None)
    losses = parse(AcousticsSection, tree.get("acoustics", {}), f"{file}: acoustics", None)
    keys = losses.model_dump(exclude_unset=True, exclude_none=True)
    return {
        "detection": tree["detection"],
        **{f"acoustics.{key}": value for key, value in keys.items()},
    }


def plan_tree(file: Path) -> Tree | None:
    """
    Section ``[plan]`` of a study file, whose texts remember the folder of the file; None if there
    is none.
    """
    section = _parsed(_read(file), str(file), file.parent).get(PLAN)
    if section is not None and not isinstance(section, dict):
        raise StudyError(f"{file}: {PLAN}: found {section!r}; allowed: a table")
    return section


def _tree(name_or_file: str | Path, chain: tuple[str, ...] = ()) -> Tree:
    """
    Tree of a preset or a file, merged into that of its base; its texts have the folder of their
    file.
    """
    path = Path(name_or_file)
    name = str(name_or_file)
    if path.suffix == ".json":
        raise _no_study(path)
    is_file = path.suffix == STUDY_FILE or len(path.parts) > 1 or isinstance(name_or_file, Path)
    if not is_file and name not in preset_names() and exists(path):
        raise _no_study(path)
    if not is_file:
        _check_preset(name)
    folder = path.parent if is_file else Path()
    text = _read(path if is_file else Path(str(_PRESETS / f"{name}.toml")))
    tree = _parsed(text, name, folder)
    tree.pop(PLAN, None)
    here = str(path.resolve()) if is_file else name
    tree = _over_base(tree, folder, name, (*chain, here)) if BASE in tree else tree
    whole: Tree = with_conditions(tree)
    return whole


def _parsed(text: str, label: str, folder: Path) -> Tree:
    """Nested dictionaries of a TOML text, whose texts have a folder."""
    tree = parse_toml(text, label, StudyError)
    try:
        return {key: located(value, folder) for key, value in tree.items()}
    except RecursionError:
        raise StudyError(f"{label}: not valid TOML: tables are nested too deeply") from None


def _over_base(tree: Tree, folder: Path, label: str, chain: tuple[str, ...]) -> Tree:
    """
    Tree merged into that of its base; file names are relative to a folder, and ``chain`` has the
    files on the way to this base.
    """
    base = tree[BASE]
    rest = {key: value for key, value in tree.items() if key != BASE}
    if not isinstance(base, str) or not (base in preset_names() or base.endswith(STUDY_FILE)):
        hint = did_you_mean(str(base), preset_names())
        raise StudyError(
            f"{label}: base: found {str(base)[:100]!r}; {hint}allowed: a file that ends in"
            f" {STUDY_FILE}, {', '.join(preset_names())}"
        )
    source = str(base) if base in preset_names() else folder / base
    reached = source if isinstance(source, str) else str(source.resolve())
    if reached in chain:
        circle = " -> ".join(Path(name).name for name in (*chain[chain.index(reached) :], reached))
        raise StudyError(f"{label}: base: {circle} is a circle; remove one of these keys")
    try:
        tree = merged(_tree(source, chain), rest)
    except StudyError as error:
        raise StudyError(
            str(error) if str(error).startswith(label) else f"{label}: base: {error}"
        ) from None
    return _named(tree, rest, label, str(base))


def _named(tree: Tree, own: Tree, label: str, base: str) -> Tree:
    """
    Tree of a file with a base; by default its name is that of the file, and its description names
    the base.
    """
    study = own.get("study", {})
    if not isinstance(study, dict) or not isinstance(tree.get("study", {}), dict):
        return tree
    stem = Path(label).stem
    named = {} if "name" in study or not re.match(NAME, stem) else {"name": stem}
    described = (
        {} if "description" in study else {"description": f"{Path(label).name}, based on {base}"}
    )
    return {**tree, "study": {**tree.get("study", {}), **named, **described}}


def parse_study(
    tree: dict[str, Any], label: str = "study", folder: Path | None = None
) -> StudyConfig:
    """
    Check the nested dictionaries of a configuration.

    Parameters
    ----------
    tree : dict
        Content of a study file as `tomllib` returns it.
    label : str
        Name of its origin, for messages.
    folder : pathlib.Path, optional
        Folder for relative file names. Default: the working folder.

    Returns
    -------
    StudyConfig

    Raises
    ------
    StudyError
        One line per finding.

    Examples
    --------
    >>> import tomllib
    >>> from pymantaray.config import load_study, parse_study, study_toml
    >>> tree = tomllib.loads(study_toml(load_study("quick")))
    >>> tree["noise"]["range_sigma"] = 2.0
    >>> parse_study(tree).noise.range_sigma
    2.0
    """
    if BASE in tree:
        folder = folder or Path()
        tree = _over_base(located(tree, folder), folder, label, ())
    return parse(StudyConfig, tree, label, folder)


def _no_study(path: Path) -> StudyError:
    """
    Error about a file or folder that is no study; a run folder contains one, and a file of the
    paper's authors' program becomes one.
    """
    inside = path / "config.toml"
    remedy = f"use {inside}" if inside.is_file() else "correct the name"
    if path.suffix == ".json":
        remedy = f"convert a sim.json with mantaray authors import {path}"
    return StudyError(
        f"{path}: not a preset, and not a study file, whose name ends in {STUDY_FILE}; {remedy}"
    )


def _read(path: Path) -> str:
    if exists(path) and path.is_dir():
        raise _no_study(path)
    return read_text(path, StudyError, what="a study file", limit=_MAX_BYTES)


def preset_names() -> list[str]:
    """Names of all presets."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in _PRESETS.iterdir()
        if entry.name.endswith(".toml")
    )


def _check_preset(name: str) -> None:
    known = preset_names()
    if name not in known:
        hint = did_you_mean(name, known)
        raise StudyError(f"no preset {name!r}; {hint}allowed: {', '.join(known)}")


def names_configuration(words: Sequence[str]) -> bool:
    """True if the words are a single name of a preset or a TOML file."""
    return len(words) == 1 and (words[0].endswith(".toml") or words[0] in preset_names())


def dotted_keys(options: dict[str, Any]) -> dict[str, Any]:
    """
    Dotted keys of a configuration for options of `open_water`, without those that are None; no
    cut-off is ``"none"``.
    """
    keys: dict[str, Any] = {}
    for name, value in options.items():
        if value is None and name == "spreading_cutoff_db":
            keys[f"acoustics.{name}"] = NONE
        elif value is None:
            continue
        elif "." in name:
            keys[name] = value
        elif name == "centre":
            keys |= _pair(
                name,
                value,
                ("ocean.centre_lat", "ocean.centre_lon"),
                "latitude and longitude [degrees]",
            )
        elif name == "half_extent":
            both = (value, value) if isinstance(value, int | float | str) else value
            sides = ("ocean.half_extent_north", "ocean.half_extent_east")
            keys |= _pair(name, both, sides, "one length, or north and east [m]")
        elif name == "currents":
            carry = value == "carry"
            keys |= {"ocean.currents": "required" if carry else value, "acoustics.currents": carry}
        elif name in OceanSection.model_fields:
            keys[f"ocean.{name}"] = str(value) if isinstance(value, Path) else value
        elif name in AcousticsSection.model_fields:
            keys[f"acoustics.{name}"] = value
        elif name in ("mission", "ranging", "detection"):
            keys[name] = dict(value)
        else:
            known = sorted(
                {
                    *OceanSection.model_fields,
                    *AcousticsSection.model_fields,
                    "centre",
                    "half_extent",
                }
                - {"source"}
            )
            hint = did_you_mean(name, known)
            raise WaterError(f"{name}: unknown option of water; {hint}allowed: {', '.join(known)}")
    return keys


def _pair(name: str, value: Any, keys: tuple[str, str], allowed: str) -> dict[str, Any]:
    """Values of two keys from an option with two values: numbers, or text with a unit."""
    entries = [] if isinstance(value, str) or not isinstance(value, Iterable) else list(value)
    if len(entries) != len(keys):
        raise WaterError(f"{name} is {value!r}; allowed: {allowed}")
    return {
        key: one if isinstance(one, str) else float(one)
        for key, one in zip(keys, entries, strict=True)
    }
