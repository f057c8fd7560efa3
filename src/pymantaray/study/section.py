"""What all sections of a configuration have in common: their base class and the types of their values."""

from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

PositiveFloat = Annotated[float, Field(gt=0.0)]
NonNegativeFloat = Annotated[float, Field(ge=0.0)]
Depth = Annotated[float, Field(ge=0.0, description="positive down [m]")]


class Section(BaseModel):
    """Base of all sections: frozen, strict about types, no unknown keys, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def require_unique(what: str, values: Sequence[str]) -> None:
    """
    Check that no value comes twice.

    Parameters
    ----------
    what : str
        Name of the values, for the message.
    values : sequence of str

    Raises
    ------
    ValueError
        If one does; pydantic makes a finding of it.
    """
    repeated = sorted({v for v in values if values.count(v) > 1})
    if repeated:
        raise ValueError(f"{what} must differ; found {', '.join(repeated)} more than once")
