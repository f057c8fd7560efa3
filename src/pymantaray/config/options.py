"""Options of `open_water`, and their keys in a configuration."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pymantaray.config.common import NONE
from pymantaray.config.load import preset_names
from pymantaray.config.sections import AcousticsSection, OceanSection
from pymantaray.errors import WaterError
from pymantaray.messages import did_you_mean


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
