"""TOML out: a small emitter for the nested tables that a resolved configuration is made of."""

import datetime as dt
import json
from collections.abc import Mapping, Sequence
from typing import Any

_WIDTH = 100  # arrays longer than this are written one item a line


def dumps(table: Mapping[str, Any]) -> str:
    """
    Write nested mappings as TOML.

    Parameters
    ----------
    table : mapping
        Values may be str, bool, int, float, datetime, mappings, and sequences of these. Keys whose value
        is None are left out: TOML has no null.

    Returns
    -------
    str
        Text that `tomllib.loads` reads back to the same values, floats to the last digit.

    Raises
    ------
    TypeError
        If a value is of another type.

    Examples
    --------
    >>> print(dumps({"study": {"name": "mine", "seed": 1}}), end="")
    [study]
    name = "mine"
    seed = 1
    """
    lines: list[str] = []
    _emit(table, (), lines)
    return "\n".join(lines).lstrip("\n") + "\n"


def _emit(table: Mapping[str, Any], path: tuple[str, ...], lines: list[str]) -> None:
    items = [(key, value) for key, value in table.items() if value is not None]
    plain = [(k, v) for k, v in items if not isinstance(v, Mapping) and not _is_table_array(v)]
    lines.extend(f"{_key(k)} = {_value(v)}" for k, v in plain)
    for key, value in items:
        name = ".".join(_key(part) for part in (*path, key))
        if isinstance(value, Mapping):
            lines.extend(["", f"[{name}]"])
            _emit(value, (*path, key), lines)
        elif _is_table_array(value):
            for entry in value:
                lines.extend(["", f"[[{name}]]"])
                _emit(entry, (*path, key), lines)


def _is_table_array(value: Any) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) > 0
        and all(isinstance(entry, Mapping) for entry in value)
    )


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("-", "").replace("_", "").isalnum()
    return key if bare else _text(key)


def _text(text: str) -> str:
    # JSON's escapes are TOML's, but for DEL; characters beyond 16 bits must not become surrogate pairs
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, dt.datetime):
        return value.isoformat()
    if isinstance(value, Sequence):
        parts = [_value(v) for v in value]
        line = f"[{', '.join(parts)}]"
        return line if len(line) <= _WIDTH else "[\n" + "".join(f"  {part},\n" for part in parts) + "]"
    raise TypeError(f"cannot write {type(value).__name__} as TOML")
