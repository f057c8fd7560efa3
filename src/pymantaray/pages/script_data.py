"""Numbers for the scripts of a page."""

import json
import re
from typing import Any

import numpy as np

_NOT_FINITE = re.compile("NaN|-?Infinity")


def as_json(content: Any) -> str:
    """JSON that is safe inside a script of a page; numbers that are not finite become null."""
    return _json(content).replace("<", "\\u003c")


def _json(value: Any) -> str:
    """JSON of nested values and arrays; whole numbers have no decimals."""
    if isinstance(value, dict):
        return f"{{{','.join(f'{_json(key)}:{_json(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_json, value))}]"
    if not isinstance(value, np.ndarray | np.generic | float):
        return json.dumps(value)
    array = np.asarray(value)
    if array.dtype.kind != "f":
        return json.dumps(array.tolist(), separators=(",", ":"))
    text = json.dumps((array + 0.0).tolist(), separators=(",", ":"))  # without negative zeros
    text = text.replace(".0,", ",").replace(".0]", "]").removesuffix(".0")
    return text if np.isfinite(array).all() else _NOT_FINITE.sub("null", text)
