"""
Errors that MantaRay raises on purpose: one base class, one subclass per folder.

What a function cannot take it refuses by its folder's error, in one line with the value and what is allowed. Docstrings
list refusals only where they do not follow from what is said of the arguments.
"""

from pymantaray.messages import without_secrets


class MantaRayError(Exception):
    """Bad input or an impossible request; the message is one line for the user, without passwords and tokens."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(without_secrets(one) if isinstance(one, str) else one for one in arguments))


class GeometryError(MantaRayError):
    """A frame, rotation or pose is not what it has to be."""


class RecordError(MantaRayError):
    """A record has the wrong shape, values or file content."""


class WriteError(MantaRayError):
    """A file cannot be written: the disk is full, the folder is missing or read-only."""


class OceanError(MantaRayError):
    """An ocean data set is missing, malformed or does not cover what is asked of it."""


class AcousticsError(MantaRayError):
    """A sound-speed medium or a link is not what the ray solver can take."""


class FleetError(MantaRayError):
    """A vehicle, behaviour or its placement is impossible."""


class SensingError(MantaRayError):
    """A measurement or noise model is inconsistent."""


class EstimationError(MantaRayError):
    """A factor graph is malformed or cannot be solved."""


class EvaluationError(MantaRayError):
    """An error statistic is asked of data that do not support it."""


class WaterError(MantaRayError):
    """The water for rays is not what it has to be."""


class JobError(MantaRayError):
    """Tasks cannot be done: their folder, store, workers or scheduler is unusable."""


class StudyError(MantaRayError):
    """A study's configuration, run folder or inputs are unusable."""


class ReportError(MantaRayError):
    """A table, figure or page cannot be made from the run at hand."""


class SweepError(MantaRayError):
    """A sweep's definition, store or workers are unusable."""


class ServiceError(MantaRayError):
    """A ping, or what a ranging service or its server is made of, is not what it can take."""


class AtlasError(MantaRayError):
    """An atlas cannot be made of what is asked for, or a file is none."""


class ReplayError(MantaRayError):
    """Measured events, or the water that they are compared in, are unusable."""


class LocateError(MantaRayError):
    """A survey of pings, or the water that it was taken in, is unusable."""


class ExchangeError(MantaRayError):
    """Another program's file cannot be read, or does not hold what is asked of it."""
