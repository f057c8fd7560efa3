"""Check nested dictionaries against the models of a configuration: one line for each finding."""

import difflib
import re
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from pymantaray.config.meanings import meaning
from pymantaray.errors import StudyError

Model = TypeVar("Model", bound=BaseModel)
NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$"
PARTICIPANT = r"^[A-Za-z0-9_-]{1,64}$"
NAMED = r"^\s*\w[\w.-]*\s*=\s*\w+\s*(\[.*\])?\s*$"
"""A variable and its CF standard name, with a unit in brackets if the variable lacks one."""
_MAX_FINDINGS = 50  # in a message
_MAX_KEY_LENGTH = 100  # characters; a message shortens longer keys
_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 100
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
    "too_long": "{max_length} or less",
    "string_too_short": "text of at least one letter",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    **dict.fromkeys(
        ("datetime_type", "datetime_parsing", "datetime_from_date_parsing"),
        "a time as 2014-07-15T12:00:00",
    ),
}
_PATTERNS = {
    NAME: "1 to 128 letters, digits and ._-, the first a letter or digit",
    PARTICIPANT: "1 to 64 letters, digits, _ and -",
    NAMED: "VARIABLE=STANDARD_NAME, such as temp=sea_water_potential_temperature",
}


def checked(model: type[Model], tree: dict[str, Any], label: str, folder: Path | None) -> Model:
    """
    Check nested dictionaries by a model; input files are relative to the folder. Default: the
    working folder.
    """
    try:
        return model.model_validate(tree, context={"folder": folder or Path()})
    except ValidationError as error:
        raise StudyError(
            "\n".join(f"{label}: {line}" for line in finding_lines(error, model))
        ) from None


def finding_lines(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """One line per finding of a model: the key, its value and the allowed values."""
    findings: list[dict[str, Any]] = [*map(dict, error.errors(include_url=False))]
    lines: dict[str, str] = {}
    for finding in findings[: 2 * _MAX_FINDINGS]:
        location: tuple[int | str, ...] = finding["loc"]
        # a list is too short only because its entries are wrong, which other findings report
        follows = finding["type"] == "too_short" and any(
            other["loc"][: len(location)] == location != other["loc"] for other in findings
        )
        if not follows:
            fault, ends, allowed = _describe(finding, model).partition("; allowed: ")
            # a value may have several allowed types
            lines[fault] = (f"{lines[fault]} or " if fault in lines else ends) + allowed
    shown = [fault + allowed for fault, allowed in lines.items()][:_MAX_FINDINGS]
    more = len(findings) - _MAX_FINDINGS
    return [*shown, f"and {more:,} more findings"] if more > 0 else shown


def _describe(finding: dict[str, Any], root: type[BaseModel]) -> str:
    kind = finding["type"]
    location = finding["loc"]
    context = finding.get("ctx", {})
    owner = _walk(location[:-1], root).model if location else None
    # a model that allows tables of other names still refuses other keys
    if kind == "dict_type" and owner is not None and location[-1] not in owner.model_fields:
        kind = "extra_forbidden"
    model, where, options = _walk(location[:-1] if kind == "extra_forbidden" else location, root)
    if kind == "extra_forbidden":
        key = str(location[-1])
        if len(key) > _MAX_KEY_LENGTH or not key.isprintable():
            key = _REPR.repr(key)
        return _unknown(key, model, where, root)
    if kind == "missing":
        return f"{where}: missing; add it{_meaning(location, root)}"
    if kind == "value_error":
        return f"{where}: {context['error']}" if where else str(context["error"])
    value = finding.get("input")
    allowed = _ALLOWED[kind].format(**context) if kind in _ALLOWED else finding["msg"]
    if kind == "union_tag_not_found":
        kinds = [
            tag for option in options for tag in get_args(option.model_fields["kind"].annotation)
        ]
        return f"{where}.kind: missing; add it, one of {', '.join(map(repr, kinds))}"
    if kind == "union_tag_invalid":
        return f"{where}.kind: found {_REPR.repr(context['tag'])}; allowed: {allowed}"
    if kind == "string_pattern_mismatch":
        allowed = _PATTERNS.get(context["pattern"], f"text that matches {context['pattern']}")
    if kind == "tuple_type" and isinstance(value, dict) and getattr(root, "in_toml", False):
        allowed = f"tables in a list, each under [[{where}]]"
    shown = (
        f"{len(value)} entries"
        if kind in ("too_short", "too_long") and value is not None
        else _REPR.repr(value)
    )
    return f"{where}: found {shown}; allowed: {allowed}"


def _unknown(key: str, model: type[BaseModel] | None, where: str, root: type[BaseModel]) -> str:
    """
    Line about an unknown key, with similar keys of its table or of others, otherwise with all keys
    of its table.
    """
    known = sorted(model.model_fields) if model else []
    prefix = f"{where}." if where else ""
    paths = list(_paths(root, ""))
    meant = [path for path in paths if path.rpartition(".")[2] == key]
    meant = meant or [f"{prefix}{name}" for name in difflib.get_close_matches(key, known, n=1)]
    if not (meant or where):  # a key without its table
        ends = [path.rpartition(".")[2] for path in paths]
        meant = [
            paths[ends.index(end)] for end in difflib.get_close_matches(key, ends, n=1, cutoff=0.8)
        ]
    hint = (
        f"Did you mean {' or '.join(f'`{path}`' for path in meant)}?"
        if meant
        else f"Allowed: {', '.join(known)}"
    )
    return f"`{prefix}{key}`: unknown key. {hint}"


def _paths(model: type[BaseModel], before: str) -> Iterator[str]:
    """Dotted keys of a model and of its tables, without lists of tables."""
    for name, field in model.model_fields.items():
        yield before + name
        inner = models_in(field.annotation)
        if len(inner) == 1 and not _is_list(field.annotation):
            yield from _paths(inner[0], f"{before}{name}.")


def _is_list(annotation: Any) -> bool:
    return get_origin(annotation) is tuple or any(_is_list(inner) for inner in get_args(annotation))


def _meaning(location: tuple[int | str, ...], root: type[BaseModel]) -> str:
    """Meaning of the key at a pydantic location, in parentheses; empty without a description."""
    model, _, _ = _walk(location[:-1], root)
    key = str(location[-1])
    text = meaning(model, key).replace("``", "") if model and key in model.model_fields else ""
    first = re.split(r"\.(?=\s|$)", text)[0]
    unit = re.search(r"\[[^]]+\]$", text)
    words = first + (f" {unit[0]}" if unit else "")
    return f" ({words[:1].lower()}{words[1:]})" if words else ""


class _Place(NamedTuple):
    """Location of a key in a configuration."""

    model: type[BaseModel] | None
    """Model with the key; None if several models are possible."""
    path: str
    """Path in TOML."""
    options: list[type[BaseModel]]
    """Allowed models at this location."""


def _walk(location: tuple[int | str, ...], root: type[BaseModel]) -> _Place:
    """Find a pydantic location under a root; tags of unions are not part of the path."""
    model: type[BaseModel] | None = root
    options: list[type[BaseModel]] = []
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif model is not None and part in model.model_fields:
            path += f".{part}" if path else part
            options = models_in(model.model_fields[part].annotation)
            model = options[0] if len(options) == 1 else None
        else:
            tagged = [m for m in options if part in get_args(m.model_fields["kind"].annotation)]
            model = tagged[0] if tagged else None
    return _Place(model, path, options)


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Models that a value of a type may be or contain."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in models_in(argument)]
