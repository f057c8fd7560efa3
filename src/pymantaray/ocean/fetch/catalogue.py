"""Catalogue of experiments and products, their time spans and addresses, from TOML."""

import datetime as dt
import os
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, TypeVar
from urllib.parse import unquote, urlsplit, urlunsplit

import numpy as np
import pydantic

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import HYCOM_NAMES, minute
from pymantaray.user_files import read_toml


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Addresses(_Table):
    """Root of a THREDDS server's OPeNDAP service."""

    opendap: str
    """Root of the paths of data sets, of any server or mirror."""


class _Span(_Table):
    name: str
    """Name for ``experiment``."""
    title: str
    """Title in messages and output."""
    first: dt.datetime
    """First instant, UTC."""
    last: dt.datetime | None = None
    """Last instant, UTC; without it, the run continues."""

    def covers(self, instant: np.datetime64) -> bool:
        """Return True if the span contains an instant."""
        ended = self.last is not None and np.datetime64(self.last) < instant
        return bool(np.datetime64(self.first) <= instant) and not ended

    @property
    def text(self) -> str:
        """Name and span for messages."""
        return (
            f"{self.name} {self.first:%Y-%m-%d} to"
            f" {f'{self.last:%Y-%m-%d}' if self.last else 'today'}"
        )


Span = TypeVar("Span", bound=_Span)


class Dataset(_Table):
    """
    A data set: its path on a server, with ``{year}`` for the year, or its identifier, and its
    variables.
    """

    path: Annotated[str, pydantic.Field(validation_alias=pydantic.AliasChoices("path", "id"))]
    """Path below ``opendap``, or ``id`` in Copernicus Marine."""
    variables: tuple[str, ...]
    """Variables by HYCOM's names."""


class Experiment(_Span):
    """A run of HYCOM on its server."""

    year_starts_h: Annotated[int, pydantic.Field(ge=0, le=48)] = 0
    """Start of a yearly data set, after midnight of 1 January. [h]"""
    datasets: tuple[Dataset, ...]
    """Data sets of the experiment."""

    def year_of(self, instant: np.datetime64) -> int:
        """Year of the data set for an instant."""
        shifted = instant - np.timedelta64(self.year_starts_h, "h")
        return int(shifted.astype("datetime64[Y]").astype(int)) + 1970

    @property
    def by_year(self) -> bool:
        """True if there is one data set per year."""
        return any("{year}" in d.path for d in self.datasets)


class Product(_Span):
    """A product of Copernicus Marine."""

    datasets: tuple[Dataset, ...]
    """Data sets of the product."""


class Catalogue(_Table):
    """Configuration of servers."""

    addresses: Addresses
    """Address of the server."""
    experiments: tuple[Experiment, ...]
    """Runs of HYCOM in order of preference."""
    copernicus: tuple[Product, ...] = ()
    """Products of Copernicus Marine."""


def covering(
    spans: tuple[Span, ...], instant: np.datetime64, name: str | None, kind: str
) -> tuple[Span, ...]:
    """
    Select the spans that cover an instant, in order of preference, or only the one with a name.
    """
    named = tuple(s for s in spans if name is None or s.name == name)
    if not named:
        known = ", ".join(s.name for s in spans) or "none"
        raise OceanError(f"fetch: unknown {kind} {name!r}; available: {known}")
    covers = tuple(s for s in named if s.covers(instant))
    if not covers:
        listed = ", ".join(s.text for s in named)
        raise OceanError(f"fetch: no {kind} covers {minute(instant)}; available: {listed}")
    return covers


def split_address(address: str) -> tuple[str, tuple[str, str] | None]:
    """Split an address into the address without user and password, and these two."""
    try:
        parts = urlsplit(address)
        host = parts.hostname
        _ = parts.port
    except ValueError:
        host = None
    if not host or parts.scheme not in ("http", "https"):
        raise OceanError(
            f"fetch: {address!r} is not a valid URL; it must have http:// or https:// and a host"
        )
    account = (unquote(parts.username), unquote(parts.password or "")) if parts.username else None
    root = urlunsplit(
        (parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", "")
    )
    return root, account


def load_catalogue(servers: str | Path | None = None) -> Catalogue:
    """
    Load the catalogue of the package; tables of a TOML file or the address of an OPeNDAP root
    replace its entries.
    """
    shipped = files("pymantaray.ocean.fetch").joinpath("servers.toml")
    table = tomllib.loads(shipped.read_text(encoding="utf-8"))
    named = os.environ.get("MANTARAY_OCEAN_SERVERS") if servers is None else servers
    where = named or "servers.toml"
    if named and re.match(r"https?:", str(named)):
        table["addresses"] = {"opendap": str(named)}
    elif named:
        # tables are replaced as a whole, so that entries of two servers do not mix
        table |= read_toml(str(named), OceanError)
    try:
        catalogue = Catalogue.model_validate(table)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise OceanError(f"{where}: {key}: {first['msg']}") from None
    split_address(catalogue.addresses.opendap)
    for experiment in catalogue.experiments:
        variables = sorted(name for d in experiment.datasets for name in d.variables)
        if variables != sorted(HYCOM_NAMES):
            raise OceanError(
                f"{where}: experiment {experiment.name} has {', '.join(variables)}; it must have"
                f" each of {', '.join(HYCOM_NAMES)} once"
            )
    return catalogue
