"""
Common parts of all sections of a configuration: strict models, the word "none", file names,
quantities with units.
"""

import datetime as dt
import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue

from pymantaray.config.checks import PARTICIPANT, checked
from pymantaray.config.meanings import meaning
from pymantaray.config.references import References
from pymantaray.ocean.names import SYNTHETIC
from pymantaray.quantities.units import quantity_of

PositiveFloat = Annotated[float, Field(gt=0.0)]
NonNegativeFloat = Annotated[float, Field(ge=0.0)]
ParticipantName = Annotated[str, Field(pattern=PARTICIPANT)]
NONE = "none"
"""Word for no value, for every key that may have none."""


T = TypeVar("T")


def _in(unit: str) -> tuple[BeforeValidator, Any]:
    """Marks of a quantity: a number is in this unit; text with its own unit is converted."""
    return (
        BeforeValidator(
            lambda value: quantity_of(value, unit) if isinstance(value, str) else value
        ),
        Field(json_schema_extra={"unit": unit}),
    )


Metres = Annotated[T, *_in("m")]
Seconds = Annotated[T, *_in("s")]
Hours = Annotated[T, *_in("h")]
Days = Annotated[T, *_in("d")]
MetresPerSecond = Annotated[T, *_in("m/s")]
Degrees = Annotated[T, *_in("deg")]
Radians = Annotated[T, *_in("rad")]
DegreesPerSecond = Annotated[T, *_in("deg/s")]
RadiansPerSecond = Annotated[T, *_in("rad/s")]
Hertz = Annotated[T, *_in("Hz")]


def _instant(value: object) -> object:
    """
    Date and time of ISO 8601 text, a date or a NumPy instant; other values are returned unchanged.
    """
    if isinstance(value, np.datetime64) and not np.isnat(value):
        return value.astype("datetime64[us]").item()
    if isinstance(value, str):
        try:
            return dt.datetime.fromisoformat(value.strip())
        except ValueError:
            return value
    if isinstance(value, dt.date) and not isinstance(value, dt.datetime):
        return dt.datetime.combine(value, dt.time())
    return value


Instant = Annotated[
    dt.datetime, BeforeValidator(_instant, json_schema_input_type=dt.datetime | str)
]
"""Date and time, UTC unless a zone is given."""


def utc_instant(time: dt.datetime) -> np.datetime64:
    """Convert a configuration's time to an instant; a time without a zone is UTC."""
    if time.tzinfo is not None:
        time = time.astimezone(dt.UTC).replace(tzinfo=None)
    return np.datetime64(time, "ns")


Depth = Metres[NonNegativeFloat]
"""Positive down."""


class Located(str):
    """Text of a configuration with the folder to which file names in it are relative."""

    __slots__ = ("folder",)
    folder: Path

    def __new__(cls, text: str, folder: Path) -> Self:
        """Create the text of a file in a folder."""
        out = super().__new__(cls, text)
        out.folder = folder
        return out


def located(tree: Any, folder: Path) -> Any:
    """
    Nested dictionaries and lists with a folder for each text; texts that have a folder keep it.
    """
    if isinstance(tree, str):
        return tree if isinstance(tree, Located) else Located(tree, folder)
    if isinstance(tree, Mapping):
        return {key: located(value, folder) for key, value in tree.items()}
    return [located(value, folder) for value in tree] if isinstance(tree, list | tuple) else tree


IN_MEMORY = "memory:"
"""Source of an ocean in memory."""
_NO_FILE = (SYNTHETIC, IN_MEMORY)


def _anchor(name: Any, info: ValidationInfo) -> Any:
    if not isinstance(name, str) or not name or name.startswith(_NO_FILE):
        return name
    if "\0" in name:
        raise ValueError(f"found {name!r}, which is not a valid file name; correct it")
    own = name.folder if isinstance(name, Located) else (info.context or {}).get("folder", Path())
    return os.path.realpath(own / name)


InputFile = Annotated[str, Field(min_length=1), BeforeValidator(_anchor)]
"""
File name: relative to the file that contains it, otherwise to the folder of the validation or the
working folder; then absolute.
"""


InputFiles = Annotated[
    tuple[InputFile, ...],
    BeforeValidator(
        lambda value: (value,) if isinstance(value, str) else value,
        json_schema_input_type=str | tuple[str, ...],
    ),
    Field(strict=False),
]
OceanSource = Annotated[InputFiles, Field(min_length=1)]
"""
Source of `open_ocean`: a file, several files that belong together, or the name of a synthetic
ocean.
"""


def own_files(source: Sequence[str]) -> tuple[str, ...]:
    """Files of an ocean's source; none for a synthetic ocean."""
    return tuple(name for name in source if not name.startswith(_NO_FILE))


class Section(BaseModel):
    """
    Base of all sections: frozen, strict about types, no unknown keys, finite numbers only,
    ``"none"`` for no value.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )
    in_toml: ClassVar[bool] = False
    """True if the section is the root of a TOML file."""

    @model_validator(mode="before")
    @classmethod
    def _drop_none(cls, tree: Any) -> Any:
        if not isinstance(tree, Mapping):
            return tree
        empty = cls._may_lack()
        return {
            key: value
            for key, value in tree.items()
            if not (key in empty and isinstance(value, str) and value == NONE)
        }

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: Any, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """JSON schema with the meanings of the keys."""
        out = handler(schema)
        for key, entry in handler.resolve_ref_schema(out).get("properties", {}).items():
            if key in cls.model_fields and (text := meaning(cls, key)):
                entry.setdefault("description", text)
        return out

    def references(self) -> References:
        """Publications that the section relies on, each with its use; none by default."""
        return iter(())

    @classmethod
    @cache
    def _may_lack(cls) -> frozenset[str]:
        """Keys without a value by default."""
        return frozenset(
            key for key, field in cls.model_fields.items() if field.default in (None, ())
        )

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """
        Copy the section; unlike pydantic's own method, this checks changed keys and values like
        those of a file.

        Parameters
        ----------
        update : mapping, optional
            New values by key.
        deep : bool
            If True, values are also copied.

        Returns
        -------
        Section

        Raises
        ------
        StudyError
            If a key is unknown or a value is not allowed; one line per finding.
        """
        copy = super().model_copy(deep=deep)
        if not update:
            return copy
        own = {key: getattr(copy, key) for key in copy.model_fields_set}
        return self._checked({**own, **update})

    @classmethod
    def _checked(cls, tree: dict[str, Any]) -> Self:
        """Section from keys that are checked like those of a file."""
        return checked(cls, tree, cls.__name__, None)


def require_unique(what: str, values: Sequence[str]) -> None:
    """Raise a ValueError, which pydantic converts to a finding, if a value occurs twice."""
    repeated = sorted({v for v in values if values.count(v) > 1})
    if repeated:
        raise ValueError(f"{what} must differ; found {', '.join(repeated)} more than once")
