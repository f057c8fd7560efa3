"""Options of `open_water`, and their keys in a configuration."""

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pymantaray.config.load import preset_names
from pymantaray.config.sections import AcousticsSection, OceanSection
from pymantaray.errors import WaterError


def names_configuration(words: Sequence[str]) -> bool:
    """True if the words are a single name of a preset or a TOML file."""
    return len(words) == 1 and (words[0].endswith(".toml") or words[0] in preset_names())


def dotted_keys(options: dict[str, Any]) -> dict[str, Any]:
    """Dotted keys of a configuration for options of `open_water`, without those that are None."""
    keys: dict[str, Any] = {}
    for name, value in options.items():
        if value is None:
            continue
        if "." in name:
            keys[name] = value
        elif name == "centre":
            lat, lon = value
            keys |= {"ocean.centre_lat": float(lat), "ocean.centre_lon": float(lon)}
        elif name == "half_extent":
            north, east = (value, value) if isinstance(value, int | float) else value
            keys |= {"ocean.half_extent_north": float(north), "ocean.half_extent_east": float(east)}
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
                {*OceanSection.model_fields, *AcousticsSection.model_fields, "centre", "half_extent"}
                - {"source"}
            )
            close = get_close_matches(name, known, n=1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise WaterError(f"{name}: unknown option of water; {hint}allowed: {', '.join(known)}")
    return keys
