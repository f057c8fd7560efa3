"""Which experiment covers a time, and under which address: configuration in TOML."""

import datetime as dt
import os
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.messages import check_address

SERVERS_VARIABLE = "MANTARAY_OCEAN_SERVERS"
HYCOM_VARIABLES = ("water_temp", "salinity", "water_u", "water_v")
Instants = NDArray[np.datetime64]


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(frozen=True, extra="forbid")


class Addresses(_Table):
    """Roots of a THREDDS server's services; ``subset`` may be empty where there is none."""

    opendap: str
    subset: str = ""


class PathOfVariables(_Table):
    """A data set of an experiment, ``{year}`` in its path standing for the year, and what it holds."""

    path: str
    variables: tuple[str, ...]


class Experiment(_Table):
    """A run of HYCOM as its server holds it."""

    name: str
    title: str
    first: dt.datetime
    last: dt.datetime | None = None
    longitudes: float = -180.0
    """Where the longitude axis begins; needed by the subset service only. [degrees]"""
    year_starts_h: Annotated[int, pydantic.Field(ge=0, le=48)] = 0
    """Hours after midnight of 1 January at which the data set of a year begins."""
    step_h: Annotated[float, pydantic.Field(gt=0.0)] = 3.0
    missing: str = ""
    """File of steps that do not exist, in the package or beside the TOML file."""
    datasets: tuple[PathOfVariables, ...]

    def covers(self, instant: np.datetime64) -> bool:
        """
        Whether the experiment's span holds an instant.

        Parameters
        ----------
        instant : numpy.datetime64

        Returns
        -------
        bool
        """
        return bool(
            np.datetime64(self.first) <= instant
            and (self.last is None or instant <= np.datetime64(self.last))
        )

    def year_of(self, instant: np.datetime64) -> int:
        """
        Year of the data set that should hold an instant.

        Parameters
        ----------
        instant : numpy.datetime64

        Returns
        -------
        int
        """
        shifted = instant - np.timedelta64(self.year_starts_h, "h")
        return int(shifted.astype("datetime64[Y]").astype(int)) + 1970

    @property
    def by_year(self) -> bool:
        """Whether it has a data set for each year."""
        return any("{year}" in d.path for d in self.datasets)


class Product(_Table):
    """A product of Copernicus Marine: its data sets' identifiers and what they hold."""

    class Dataset(_Table):
        """One data set."""

        id: str
        variables: tuple[str, ...]

    name: str
    title: str
    first: dt.datetime
    last: dt.datetime | None = None
    datasets: tuple[Dataset, ...]


class Catalogue(_Table):
    """All that is configuration about servers."""

    addresses: Addresses
    experiments: tuple[Experiment, ...]
    copernicus: tuple[Product, ...] = ()

    def covering(self, instant: np.datetime64, name: str | None = None) -> tuple[Experiment, ...]:
        """
        Experiments that cover an instant, the preferred one first.

        Parameters
        ----------
        instant : numpy.datetime64
        name : str, optional
            Take this one only.

        Returns
        -------
        tuple of Experiment

        Raises
        ------
        OceanError
            If there is none.
        """
        known = ", ".join(e.name for e in self.experiments)
        named = [e for e in self.experiments if name is None or e.name == name]
        if not named:
            raise OceanError(f"fetch: no experiment is called {name!r}; there are {known}")
        found = tuple(e for e in named if e.covers(instant))
        if not found:
            spans = ", ".join(f"{e.name} {e.first:%Y-%m-%d} to {_day(e.last)}" for e in named)
            raise OceanError(f"fetch: no experiment covers {minute(instant)}; there is {spans}")
        return found


def minute(instant: np.datetime64) -> str:
    """
    Instant as text, to the minute.

    Parameters
    ----------
    instant : numpy.datetime64

    Returns
    -------
    str

    Examples
    --------
    >>> minute(np.datetime64("2014-07-15T12:00:00"))
    '2014-07-15T12:00'
    """
    return str(np.datetime_as_string(instant, unit="m"))


def load_catalogue(servers: str | Path | None = None) -> Catalogue:
    """
    Read the catalogue of servers.

    Parameters
    ----------
    servers : str or Path, optional
        A TOML file whose tables replace those of the package, or the address of an OPeNDAP root. By default
        what the environment variable MANTARAY_OCEAN_SERVERS names, else the package's own.

    Returns
    -------
    Catalogue

    Raises
    ------
    OceanError
        If the file cannot be read or says something that is not understood.
    """
    table = tomllib.loads(
        files("pymantaray.ocean.fetch").joinpath("servers.toml").read_text(encoding="utf-8")
    )
    given = os.environ.get(SERVERS_VARIABLE) if servers is None else servers
    where = "servers.toml"
    if given and re.match(r"https?://", str(given)):
        table["addresses"] = {"opendap": str(given)}
        where = str(given)
    elif given:
        where = str(given)
        table |= _read_toml(Path(given))  # tables as a whole: never one server's address and another's
        for experiment in table.get("experiments", []):
            _place_beside(experiment, Path(given).parent)
    try:
        catalogue = Catalogue.model_validate(table)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise OceanError(f"{where}: {key}: {first['msg']}") from None
    for address in (catalogue.addresses.opendap, catalogue.addresses.subset):
        if address:
            check_address(address)
    for experiment in catalogue.experiments:
        held = sorted(name for d in experiment.datasets for name in d.variables)
        if held != sorted(HYCOM_VARIABLES):
            raise OceanError(
                f"{where}: experiment {experiment.name} holds {', '.join(held)}; needs each of"
                f" {', '.join(HYCOM_VARIABLES)} once"
            )
    return catalogue


def known_missing(experiment: Experiment) -> Instants:
    """
    Steps of an experiment that are known not to exist.

    Parameters
    ----------
    experiment : Experiment

    Returns
    -------
    ndarray of datetime64
        Sorted; empty where none is known.

    Raises
    ------
    OceanError
        If the experiment names a list that is not there or cannot be read.
    """
    if not experiment.missing:
        return np.array([], dtype="datetime64[s]")
    path = Path(experiment.missing)
    try:
        source = path if path.is_absolute() else files("pymantaray.ocean.fetch").joinpath(experiment.missing)
        lines = [line.split() for line in source.read_text(encoding="utf-8").splitlines()]
        steps = [f"{w[0]}-{step}" for w in lines if w and not w[0].startswith("#") for step in w[1:]]
        return np.sort(np.array(steps, dtype="datetime64[s]"))
    except (OSError, ValueError) as error:
        raise OceanError(f"{experiment.missing}: list of missing steps cannot be read ({error})") from None


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OceanError(f"{path}: cannot be read ({error.strerror}); name a TOML file of servers") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise OceanError(f"{path}: not TOML ({error})") from None


def _place_beside(experiment: Any, folder: Path) -> None:
    """Let a list of missing steps lie beside the user's file."""
    if isinstance(experiment, dict) and isinstance(name := experiment.get("missing"), str) and name:
        beside = (folder / name).resolve()
        if beside.is_file():
            experiment["missing"] = str(beside)


def _day(instant: dt.datetime | None) -> str:
    return "today" if instant is None else f"{instant:%Y-%m-%d}"
