"""Words on figures and pages: what water is shown, and what conditions are called."""

from collections.abc import Mapping
from typing import Any

CONDITION_LABELS = {
    "odometry": "Odometry only",
    "straight": "Straight ranges",
    "refracted": "Refracted ranges",
    "straight-all": "Straight, no dropouts",
    "no-ranges": "Graph without ranges",
}


_FITS = 28  # characters of a name on a figure


def ocean_header(attrs: Mapping[Any, Any]) -> str:
    """
    One line on the water that a figure shows; a synthetic ocean is always called that.

    Parameters
    ----------
    attrs : mapping
        Attributes of an ocean or profile data set: ``title``, ``synthetic`` and, if known, ``time``.

    Returns
    -------
    str

    Examples
    --------
    >>> ocean_header({"title": "Fram Strait (synthetic)", "synthetic": 1, "time": "2014-07-15T12:00:00"})
    'Fram Strait, synthetic ocean, 2014-07-15 12:00 UTC'
    """
    parts = [short(ocean_name(attrs))]
    if is_synthetic(attrs):
        parts.append("synthetic ocean")
    if attrs.get("time"):
        parts.append(f"{str(attrs['time'])[:16].replace('T', ' ')} UTC")
    return ", ".join(parts)


def ocean_name(attrs: Mapping[Any, Any]) -> str:
    """
    Name of an ocean without the note that it is synthetic.

    Parameters
    ----------
    attrs : mapping
        Attributes of an ocean data set.

    Returns
    -------
    str
    """
    return str(attrs.get("title", "unnamed ocean")).replace("(synthetic)", "").strip() or "unnamed ocean"


def short(name: str) -> str:
    """
    Name cut to what fits on a figure.

    Parameters
    ----------
    name : str

    Returns
    -------
    str
        At most 28 characters, the last an ellipsis if something was cut.
    """
    return name if len(name) <= _FITS else name[: _FITS - 1].rstrip() + "…"


def is_synthetic(attrs: Mapping[Any, Any]) -> bool:
    """
    Whether a data set says that its ocean is made up.

    Parameters
    ----------
    attrs : mapping
        Attributes of an ocean data set.

    Returns
    -------
    bool
    """
    return bool(int(attrs.get("synthetic", 0)))


def plain(text: str) -> str:
    """
    Text as matplotlib shows it literally: dollar signs start no mathematics.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return text.replace("$", r"\$")


def condition_label(name: str) -> str:
    """
    Words for a ranging condition.

    Parameters
    ----------
    name : str

    Returns
    -------
    str
        The name itself for a condition that is not one of the study's own.
    """
    return CONDITION_LABELS.get(name, name)
