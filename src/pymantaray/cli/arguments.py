"""Arguments of the library in its messages, as the options of the running command."""

import inspect
import re
from collections.abc import Iterable

from typer.models import OptionInfo

_ARGUMENT = re.compile(r"`([a-z]\w*)(?:=([^`]*))?`")
_PARAMETERS = {
    "drift_sigma": "clock_drift_sigma",
    "ice_slope_deg": "ice_slope",
    "names": "name",
    "offset_sigma": "clock_offset_sigma",
    "overwrite": "force",
    "place": "position",
    "speed_model": "sound_speed",
    "thin_profile": "thin",
    "tolerance": "error",
    "total_s": "time_limit",
}
"""Parameters of commands for arguments with another name."""
_flags = dict[str, str]()


def use_options_of(parameters: Iterable[inspect.Parameter]) -> None:
    """Write the options of a command with these parameters into the texts of `in_options`."""
    _flags.clear()
    for p in parameters:
        for mark in getattr(p.annotation, "__metadata__", ()):
            if isinstance(mark, OptionInfo):
                words = (
                    mark.default,
                    *(mark.param_decls or ()),
                )  # typer's first argument may be a name
                names = [word for word in words if isinstance(word, str) and word.startswith("--")]
                _flags[p.name] = (
                    names[0].partition("/")[0] if names else f"--{p.name.replace('_', '-')}"
                )


def in_options(text: str) -> str:
    """
    Text with options instead of arguments: ``--centre`` for ```centre```, ``--currents rest`` for
    ```currents='rest'```.

    Names that are no arguments of the running command stay as they are.
    """
    return _ARGUMENT.sub(_option, text)


def _option(match: "re.Match[str]") -> str:
    name, value = match.groups()
    flag = _flags.get(name) or _flags.get(_PARAMETERS.get(name, ""))
    if flag is None:
        return match[0]
    return flag if value in (None, "True") else f"{flag} " + value.strip("'\"")
