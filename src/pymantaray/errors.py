"""
Exceptions for invalid input and impossible requests: one base class, one subclass per folder.

A function raises the error of its folder if it cannot use an argument. The message is one line with
the value and the allowed values. A docstring lists an error only if it does not follow from the
description of the parameters.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from pymantaray.messages import printable, without_secrets


class MantaRayError(Exception):
    r"""
    Invalid input or an impossible request; the message is one printable line, without passwords and
    tokens.

    Examples
    --------
    >>> from pymantaray import MantaRayError, load_study
    >>> try:
    ...     load_study("quick", duration_h=-1.0)
    ... except MantaRayError as error:
    ...     print("refused in one line:", "\n" not in str(error))
    refused in one line: True
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(
            *(printable(without_secrets(a)) if isinstance(a, str) else a for a in arguments)
        )


class GeometryError(MantaRayError):
    """A frame, rotation or pose is invalid."""


class RecordError(MantaRayError):
    """A record has an invalid shape, invalid values or invalid file content."""


class WriteError(MantaRayError):
    """A file cannot be written: the disk is full, or the folder is missing or read-only."""


class OceanError(MantaRayError):
    """An ocean data set is missing, is malformed or does not cover the requested domain."""


class AcousticsError(MantaRayError):
    """The ray solver cannot use a sound-speed medium or a link."""


class FleetError(MantaRayError):
    """A vehicle, its behaviour or its position is impossible."""


class SensingError(MantaRayError):
    """A measurement or noise model is inconsistent."""


class EstimationError(MantaRayError):
    """A factor graph is malformed or cannot be solved."""


class EvaluationError(MantaRayError):
    """The data do not support the requested error statistic."""


class WaterError(MantaRayError):
    """Water for rays is invalid."""


class JobError(MantaRayError):
    """Tasks cannot run: their folder, store, workers or scheduler is unusable."""


class ExtensionError(MantaRayError):
    """A sensor or figure of another package is missing or fails."""


class StudyError(MantaRayError):
    """A study's configuration, run folder or inputs are unusable."""


class ReportError(MantaRayError):
    """A table, figure or page cannot be made from a run."""


class PlanError(MantaRayError):
    """A plan of a deployment that cannot be evaluated."""


class SweepError(MantaRayError):
    """A sweep's definition, store or workers are unusable."""


class ServiceError(MantaRayError):
    """A ranging service or its server cannot use a ping or its own definition."""


class AtlasError(MantaRayError):
    """An atlas cannot be computed as requested, or a file is not an atlas."""


class ReplayError(MantaRayError):
    """Measured events, or the water that they are compared with, are unusable."""


class LocateError(MantaRayError):
    """A survey of pings, or its water, is unusable."""


class OnlineError(MantaRayError):
    """A travel-time table cannot be built or read, or a measurement on line is unusable."""


class ExchangeError(MantaRayError):
    """A file of another program cannot be read, or lacks the requested data."""


@contextmanager
def errors_as(error: type[MantaRayError], *others: type[MantaRayError]) -> Iterator[None]:
    """Raise errors of other folders as those of the caller's folder, with the same message."""
    try:
        yield
    except others as cause:
        raise error(str(cause)) from None


@contextmanager
def optional_package(
    error: type[MantaRayError], where: object, name: str, extra: str
) -> Iterator[None]:
    """
    Raise an error with the command that installs an optional package if its import fails, because
    it is missing or damaged.
    """
    try:
        yield
    except ModuleNotFoundError:
        raise error(
            f'{where}: {name} is not installed; pip install "pymantaray[{extra}]"'
        ) from None
    except Exception as cause:  # noqa: BLE001  a damaged package raises any type
        reason = " ".join(str(cause).split())[:120]
        raise error(
            f"{where}: {name} cannot be imported ({type(cause).__name__}: {reason}); uninstall it,"
            f' then pip install "pymantaray[{extra}]"'
        ) from None
