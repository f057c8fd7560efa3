"""From a preset's name or a TOML file to a validated configuration, and back to text."""

import difflib
import re
import reprlib
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args

import tomli_w
from pydantic import BaseModel, ValidationError

from pymantaray.config.estimators import NAME, input_file
from pymantaray.config.sections import PARTICIPANT, DetectionSection, SoundConfig, StudyConfig
from pymantaray.errors import StudyError

Model = TypeVar("Model", bound=BaseModel)
_MOST_CHARACTERS = 10_000_000
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 100
_ALLOWED = {
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "literal_error": "{expected}",
    "union_tag_invalid": "{expected_tags}",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "string_pattern_mismatch": "text that matches {pattern}",
    "too_short": "{min_length} or more",
    "string_too_short": "text of a letter or more",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    **dict.fromkeys(
        ("datetime_type", "datetime_parsing", "datetime_from_date_parsing"), "a time as 2014-07-15T12:00:00"
    ),
}
_PATTERNS = {
    NAME: "letters, digits and ._- after a letter or digit",
    PARTICIPANT: "1 to 64 letters, digits, _ and -",
}


def list_presets() -> dict[str, str]:
    """
    Names of the presets that the package ships, each with its one-line description.

    Returns
    -------
    dict of str to str
    """
    return {name: load_study(name).study.description for name in preset_names()}


def preset_text(name: str) -> str:
    """
    TOML text of a preset, with its comments.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Raises
    ------
    StudyError
        If there is no such preset; the message lists those there are.
    """
    known = preset_names()
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise StudyError(f"no preset {name!r}; {hint}there are {', '.join(known)}")
    return (files("pymantaray.config") / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def load_study(
    name_or_file: str | Path,
    *,
    realizations: int | None = None,
    ocean: Sequence[str | Path] | None = None,
) -> StudyConfig:
    """
    Read and check a study's configuration; the description of a changed one says what is changed.

    Parameters
    ----------
    name_or_file : str or pathlib.Path
        Name of a preset, or a TOML file. Ocean and sea floor files named in it are relative to its folder.
    realizations : int, optional
        Number of realizations in place of the configured one.
    ocean : sequence of path or str, optional
        Ocean files, or the name of a synthetic ocean, in place of the whole configured ocean. Files are
        relative to the working folder; the time is the files' only one, the centre the middle of the data.

    Returns
    -------
    StudyConfig

    Raises
    ------
    StudyError
        If the file is missing or not TOML, or a value is not allowed: one line per finding with the
        file, the key, what was found and what is allowed.

    Examples
    --------
    >>> load_study("beaufort", realizations=2).study.realizations
    2
    """
    tree, folder = _tree(name_or_file)
    name = str(name_or_file)
    if realizations is not None or ocean is not None:
        _change(tree, name, realizations, ocean)
    if ocean is not None:
        tree["ocean"] = {"source": [input_file(str(source), Path()) for source in ocean]}
    return parse_study(tree, name, folder)


def load_sound(name_or_file: str | Path) -> SoundConfig:
    """
    Read what ranging needs of a study's configuration; a file may have that alone.

    Parameters
    ----------
    name_or_file : str or pathlib.Path
        Name of a preset, or a TOML file with the section ``[ocean]`` and, where their defaults do not fit, ``[mission]``,
        ``[acoustics]``, ``[ranging]`` and ``[detection]``. One with a fleet is read as a study; without, its other sections are
        passed over.

    Returns
    -------
    SoundConfig
        A `StudyConfig` of a study.

    Raises
    ------
    StudyError
        As `load_study`.
    """
    tree, folder = _tree(name_or_file)
    if "fleet" in tree:
        return parse_study(tree, str(name_or_file), folder)
    others = StudyConfig.model_fields.keys() - SoundConfig.model_fields.keys()
    sound = {name: section for name, section in tree.items() if name not in others}
    return parse(SoundConfig, sound, str(name_or_file), folder)


def load_detection(file: Path) -> DetectionSection:
    """Section ``[detection]`` of a TOML file, whatever else is in it."""
    tree, folder = _tree(file)
    section = tree.get("detection")
    if not isinstance(section, dict):
        raise StudyError(f"{file}: has no section [detection]")
    return parse(DetectionSection, section, f"{file}: detection", folder)


def _tree(name_or_file: str | Path) -> tuple[dict[str, Any], Path | None]:
    """What TOML gives for a preset or a file, and the file's folder."""
    path, name = Path(name_or_file), str(name_or_file)
    is_file = path.suffix == ".toml" or len(path.parts) > 1 or isinstance(name_or_file, Path)
    if not is_file and name not in preset_names() and path.exists():
        raise StudyError(f"{name}: no preset, and no study's file, whose name ends in .toml")
    text = _read(path) if is_file else preset_text(name)
    try:
        return tomllib.loads(text), path.parent if is_file else None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{name}: not valid TOML: {error}") from None
    except (ValueError, RecursionError):
        raise StudyError(
            f"{name}: not valid TOML: a number is too long, or tables are nested too deep"
        ) from None


def _change(
    tree: dict[str, Any], name: str, realizations: int | None, ocean: Sequence[str | Path] | None
) -> None:
    study = tree.setdefault("study", {})
    if not isinstance(study, dict):
        return
    changes = []
    if realizations is not None:
        study["realizations"] = realizations
        changes.append(f"{realizations} realization{'' if realizations == 1 else 's'}")
    if ocean is not None:
        changes.append(f"the ocean {' '.join(map(str, ocean))}")
    study["description"] = f"{name} with {' and '.join(changes)}"


def parse_study(tree: dict[str, Any], label: str = "study", folder: Path | None = None) -> StudyConfig:
    """
    Check a configuration given as nested dictionaries.

    Parameters
    ----------
    tree : dict
        What `tomllib` gives for a study's file.
    label : str
        Name of its origin, for messages.
    folder : pathlib.Path, optional
        What input files in it are relative to; by default the working folder.

    Returns
    -------
    StudyConfig

    Raises
    ------
    StudyError
        One line per finding.
    """
    return parse(StudyConfig, tree, label, folder)


def parse(model: type[Model], tree: dict[str, Any], label: str, folder: Path | None) -> Model:
    """Check nested dictionaries by a model; input files are relative to the folder, by default the working folder."""
    try:
        return model.model_validate(tree, context={"folder": folder or Path()})
    except ValidationError as error:
        raise StudyError("\n".join(f"{label}: {line}" for line in finding_lines(error, model))) from None


def finding_lines(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """What a model refused, one line per finding: where, what was found and what is allowed."""
    findings = [dict(finding) for finding in error.errors(include_url=False)]
    lines: dict[str, str] = {}
    for finding in findings:
        if not _follows(finding, findings):
            fault, ends, allowed = _describe(finding, model).partition("; allowed: ")
            before = (
                f"{lines[fault]} or " if fault in lines else ends
            )  # a value of which several kinds may be
            lines[fault] = before + allowed
    return [fault + allowed for fault, allowed in lines.items()]


def study_toml(config: StudyConfig) -> str:
    """
    Write a resolved configuration, defaults included, as TOML that `load_study` reads back.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    str
    """
    tree = config.model_dump(exclude_none=True)
    return tomli_w.dumps({"study": tree.pop("study"), **tree})


def _read(path: Path) -> str:
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_MOST_CHARACTERS + 1)
    except UnicodeDecodeError:
        raise StudyError(f"{path}: cannot be read: not UTF-8 text") from None
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        shown = repr(str(path)) if "\0" in str(path) else str(path)
        raise StudyError(f"{shown}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(text) > _MOST_CHARACTERS:
        raise StudyError(f"{path}: cannot be read: more than {_MOST_CHARACTERS:,} characters")
    return text


def preset_names() -> list[str]:
    """Names of the presets that the package ships."""
    folder = files("pymantaray.config") / "presets"
    return sorted(
        entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")
    )


def _follows(finding: dict[str, Any], findings: list[dict[str, Any]]) -> bool:
    """Whether a list only seems too short because its entries were refused, which is said already."""
    location = finding["loc"]
    return finding["type"] == "too_short" and any(
        len(other["loc"]) > len(location) and other["loc"][: len(location)] == location for other in findings
    )


def _describe(finding: dict[str, Any], root: type[BaseModel]) -> str:
    kind, location, context = finding["type"], finding["loc"], finding.get("ctx", {})
    model, where, options = _walk(location[:-1] if kind == "extra_forbidden" else location, root)
    if kind == "extra_forbidden":
        known = sorted(model.model_fields) if model else []
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        prefix = f"{where}." if where else ""
        return f"{prefix}{location[-1]}: unknown key; {hint}allowed: {', '.join(known)}"
    if kind == "missing":
        return f"{where}: missing; add it{_meaning(location, root)}"
    if kind == "value_error":
        return f"{where}: {context['error']}" if where else str(context["error"])
    value = finding.get("input")
    allowed = _ALLOWED[kind].format(**context) if kind in _ALLOWED else finding["msg"]
    if kind == "union_tag_not_found":
        kinds = [tag for option in options for tag in get_args(option.model_fields["kind"].annotation)]
        return f"{where}.kind: missing; add it, one of {', '.join(map(repr, kinds))}"
    if kind == "union_tag_invalid":
        return f"{where}.kind: found {context['tag']!r}; allowed: {allowed}"
    if kind == "string_pattern_mismatch":
        allowed = _PATTERNS.get(context["pattern"], f"text that matches {context['pattern']}")
    if kind == "tuple_type" and isinstance(value, dict) and issubclass(root, SoundConfig):
        allowed = f"tables in a list, each under [[{where}]]"
    shown = f"{len(value)} entries" if kind == "too_short" and value is not None else _SHORT.repr(value)
    return f"{where}: found {shown}; allowed: {allowed}"


def _meaning(location: tuple[int | str, ...], root: type[BaseModel]) -> str:
    """What the key at a pydantic location means, in brackets; nothing where nobody has said it."""
    model, _, _ = _walk(location[:-1], root)
    field = model.model_fields.get(str(location[-1])) if model else None
    meaning = (field.description or "").replace("``", "") if field else ""
    first = re.split(r"\.(?=\s|$)", meaning)[0]
    unit = re.search(r"\[[^]]+\]$", meaning)
    words = first + (f" {unit[0]}" if unit and unit[0] not in first else "")
    return f" ({words[:1].lower()}{words[1:]})" if words else ""


class _Place(NamedTuple):
    """A place in a configuration."""

    model: type[BaseModel] | None
    """That owns it; None if it is of one of several kinds."""
    path: str
    """As TOML has it."""
    options: list[type[BaseModel]]
    """Models that may stand there."""


def _walk(location: tuple[int | str, ...], root: type[BaseModel]) -> _Place:
    """Find a pydantic location under a root; tags of unions in it are no part of the path."""
    model: type[BaseModel] | None = root
    options: list[type[BaseModel]] = []
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif model is not None and part in model.model_fields:
            path += f".{part}" if path else part
            options = _models_in(model.model_fields[part].annotation)
            model = options[0] if len(options) == 1 else None
        else:
            tagged = [m for m in options if part in get_args(m.model_fields["kind"].annotation)]
            model = tagged[0] if tagged else None
    return _Place(model, path, options)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]
