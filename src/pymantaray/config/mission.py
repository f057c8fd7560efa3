"""Sections of a configuration for times: durations, periods and schedules of pings."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from pymantaray.config.common import (
    Hours,
    InputFile,
    Metres,
    NonNegativeFloat,
    PositiveFloat,
    Seconds,
    Section,
)
from pymantaray.sensing import PingSchedule, Schedule, SlotSchedule


class SlotsSection(Section):
    """Vehicles ping in turn, one per slot (TDMA); slots repeat after the last."""

    kind: Literal["slots"]
    """Vehicles ping in turn."""
    slots: tuple[str, ...] = Field(min_length=1, strict=False)
    """Names of the vehicles, in the order of their slots."""
    slot_s: Seconds[PositiveFloat]
    """Length of a slot. [s]"""
    start_s: Seconds[NonNegativeFloat] = 0.0
    """Time of the first slot. [s]"""


class PingsSection(Section):
    """Pings from a table of times, transmitters and optional receivers."""

    kind: Literal["pings"]
    """Pings from a table."""
    file: InputFile
    """
    CSV file with columns ``time`` [s], ``transmitter`` and optional ``receivers``; relative to this
    file.
    """


AnySchedule = Annotated[SlotsSection | PingsSection, Field(discriminator="kind")]


class MissionSection(Section):
    """
    Durations and periods, as in the paper's table of mission timing.

    Without a ``schedule``, all vehicles ping at every multiple of ``ping_interval_h``. A mission
    with existing trajectories lasts from their first pose to their last, unless ``duration_h`` is
    shorter.
    """

    duration_h: Hours[PositiveFloat] = 168.0
    """Time from the first sample to the last. Default with trajectories: their duration. [h]"""
    physics_step_s: Seconds[PositiveFloat] = 0.125
    """Step of the vehicles' motion. [s]"""
    sampling_period_s: Seconds[PositiveFloat] = 200.0
    """
    Time between samples of poses and sensors. Samples at both ends of the mission: not in the
    paper, record 0001. [s]
    """
    ping_interval_h: Hours[PositiveFloat] = 4.0
    """Interval of pings of all vehicles. No ping at time 0: not in the paper, record 0001. [h]"""
    ping_start_h: Hours[NonNegativeFloat] | None = None
    """Time of the first ping. Default: ``ping_interval_h``. [h]"""
    schedule: AnySchedule | None = None
    """Schedule of pings, instead of ``ping_interval_h``."""
    gnss_depth: Metres[PositiveFloat] = 0.1
    """Depth above which vehicles have GNSS fixes. Not in the paper, record 0001. [m]"""
    sensors: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """
    Sensors of other packages, by the names of their entry points ``pymantaray.sensors``. Not in the
    paper.
    """

    @model_validator(mode="after")
    def _first_ping_is_a_sample(self) -> Self:
        if self.ping_start_h is not None:
            samples = self.ping_start_h * 3600.0 / self.sampling_period_s
            if abs(samples - round(samples)) > 1e-9 * max(samples, 1.0):
                raise ValueError(
                    f"ping_start_h is {self.ping_start_h * 3600.0:g} s; it must be a whole multiple"
                    f" of sampling_period_s, {self.sampling_period_s:g} s"
                )
            if self.schedule is not None:
                raise ValueError("ping_start_h and schedule cannot be combined; remove one of them")
        return self


def keys_of_schedule(schedule: Schedule) -> dict[str, Any]:
    """Keys of ``[mission]`` for a schedule; none for a list of pings, which needs a file."""
    if isinstance(schedule, SlotSchedule):
        slots = {"slots": list(schedule.slots), "slot_s": schedule.slot, "start_s": schedule.start}
        return {"schedule": {"kind": "slots", **slots}}
    if isinstance(schedule, PingSchedule):
        start = {} if schedule.start is None else {"ping_start_h": schedule.start / 3600.0}
        return {"ping_interval_h": schedule.interval / 3600.0, **start}
    return {}
