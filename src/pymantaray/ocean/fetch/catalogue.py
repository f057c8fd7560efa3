"""Which experiment covers a time, and under which address: configuration in TOML."""

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


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Addresses(_Table):
    """Root of a THREDDS server's OPeNDAP service."""

    opendap: str
    """Where paths of data sets begin; another server's, or a mirror's."""


class _Span(_Table):
    name: str
    """As ``--experiment`` takes it."""
    title: str
    """For messages and what is written."""
    first: dt.datetime
    """Its first instant, UTC."""
    last: dt.datetime | None = None
    """Its last instant, UTC; goes on unless given."""

    def covers(self, instant: np.datetime64) -> bool:
        """Whether the span holds an instant."""
        ended = self.last is not None and np.datetime64(self.last) < instant
        return bool(np.datetime64(self.first) <= instant) and not ended

    @property
    def text(self) -> str:
        """Name and span, for messages."""
        return f"{self.name} {self.first:%Y-%m-%d} to {f'{self.last:%Y-%m-%d}' if self.last else 'today'}"


Span = TypeVar("Span", bound=_Span)


class Dataset(_Table):
    """A data set, by its path on a server, ``{year}`` standing for the year, or its identifier, and what it holds."""

    path: Annotated[str, pydantic.Field(validation_alias=pydantic.AliasChoices("path", "id"))]
    """On the server below ``opendap``; or ``id``, as Copernicus Marine names it."""
    variables: tuple[str, ...]
    """What it holds, by HYCOM's names."""


class Experiment(_Span):
    """A run of HYCOM as its server holds it."""

    year_starts_h: Annotated[int, pydantic.Field(ge=0, le=48)] = 0
    """Hours after midnight of 1 January at which the data set of a year begins. [h]"""
    datasets: tuple[Dataset, ...]
    """What it consists of."""

    def year_of(self, instant: np.datetime64) -> int:
        """Year of the data set that should hold an instant."""
        shifted = instant - np.timedelta64(self.year_starts_h, "h")
        return int(shifted.astype("datetime64[Y]").astype(int)) + 1970

    @property
    def by_year(self) -> bool:
        """Whether it has a data set for each year."""
        return any("{year}" in d.path for d in self.datasets)


class Product(_Span):
    """A product of Copernicus Marine."""

    datasets: tuple[Dataset, ...]
    """What it consists of."""


class Catalogue(_Table):
    """All that is configuration about servers."""

    addresses: Addresses
    """Where the server is."""
    experiments: tuple[Experiment, ...]
    """Runs of HYCOM, the preferred one of a time first."""
    copernicus: tuple[Product, ...] = ()
    """Products of Copernicus Marine."""


def covering(
    spans: tuple[Span, ...], instant: np.datetime64, name: str | None, kind: str
) -> tuple[Span, ...]:
    """Those that cover an instant, the preferred one first; only the one of a name where that is given."""
    named = tuple(s for s in spans if name is None or s.name == name)
    if not named:
        known = ", ".join(s.name for s in spans) or "none"
        raise OceanError(f"fetch: no {kind} is called {name!r}; there are {known}")
    covers = tuple(s for s in named if s.covers(instant))
    if not covers:
        listed = ", ".join(s.text for s in named)
        raise OceanError(f"fetch: no {kind} covers {minute(instant)}; there is {listed}")
    return covers


def split_address(address: str) -> tuple[str, tuple[str, str] | None]:
    """Address without user and password, and these."""
    try:
        parts = urlsplit(address)
        host, _ = parts.hostname, parts.port
    except ValueError:
        host = None
    if not host or parts.scheme not in ("http", "https"):
        raise OceanError(f"fetch: {address!r} is not an address; needs http:// or https:// and a host")
    account = (unquote(parts.username), unquote(parts.password or "")) if parts.username else None
    root = urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", ""))
    return root, account


def load_catalogue(servers: str | Path | None = None) -> Catalogue:
    """Catalogue of the package, with the tables of a TOML file or the address of an OPeNDAP root in their place."""
    shipped = files("pymantaray.ocean.fetch").joinpath("servers.toml")
    table = tomllib.loads(shipped.read_text(encoding="utf-8"))
    named = os.environ.get("MANTARAY_OCEAN_SERVERS") if servers is None else servers
    where = named or "servers.toml"
    if named and re.match(r"https?:", str(named)):
        table["addresses"] = {"opendap": str(named)}
    elif named:
        try:  # tables as a whole: never one server's address and another's
            table |= tomllib.loads(Path(named).read_text(encoding="utf-8"))
        except OSError as error:
            line = f"cannot be read ({error.strerror}); name a TOML file of servers"
            raise OceanError(f"{where}: {line}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise OceanError(f"{where}: not TOML ({error})") from None
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
                f"{where}: experiment {experiment.name} holds {', '.join(variables)}; needs each of"
                f" {', '.join(HYCOM_NAMES)} once"
            )
    return catalogue
