"""Requests and answers of the ranging server as JSON; missing values are null."""

from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError, model_validator

from pymantaray.apps.service.ranging_service import Ping, RangingService
from pymantaray.config.checks import finding_lines
from pymantaray.config.common import Section
from pymantaray.errors import ServiceError
from pymantaray.messages import one_line
from pymantaray.records import RayStatus
from pymantaray.sensing.receptions import Direction

MAX_RECEIVERS = 10_000
_MAX_FAULTS = 3  # in one answer
_MAX_LINE = 480  # characters of an error
Vector = Annotated[tuple[float, float, float], Field(strict=False)]


class Participant(Section):
    """
    Source or receiver: north and east [m], or lat and lon [degrees], and depth [m]; velocity for
    two-way timing only [m/s].
    """

    name: str | None = Field(default=None, max_length=64)
    north: float | None = None
    east: float | None = None
    lat: float | None = Field(default=None, ge=-90.0, le=90.0)
    lon: float | None = Field(default=None, ge=-360.0, le=360.0)
    depth: float
    velocity: Vector | None = Field(default=None, description="along north, east and down")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        local = self.north is not None and self.east is not None
        globe = self.lat is not None and self.lon is not None
        if (
            local == globe
            or (self.north is None) != (self.east is None)
            or (self.lat is None) != (self.lon is None)
        ):
            raise ValueError("give either north and east or lat and lon")
        return self

    @property
    def geographic(self) -> bool:
        """True if its position is a latitude and longitude."""
        return self.lat is not None

    @property
    def place(self) -> tuple[float | None, float | None, float]:
        """Position as `RangingService.ping` takes it."""
        return (
            (self.lat, self.lon, self.depth)
            if self.geographic
            else (self.north, self.east, self.depth)
        )


class PingRequest(Section):
    """
    One ping. With ``arrivals`` the answer lists all arrivals of each receiver, not only the
    selected one.
    """

    time: float = Field(
        description="seconds since the start of the ocean; without effect if the ocean does not"
        " vary"
    )
    source: Participant
    receivers: tuple[Participant, ...] = Field(max_length=MAX_RECEIVERS, strict=False)
    arrivals: bool = False

    @model_validator(mode="after")
    def _one_frame(self) -> Self:
        if len({p.geographic for p in (self.source, *self.receivers)}) > 1:
            raise ValueError(
                "some positions have north and east, others lat and lon; use one of the two for all"
            )
        return self


@dataclass(slots=True)
class ArrivalAnswer:
    """
    One eigenray. Times include the current's effect; angles are from the horizontal, positive down.
    [s], [rad], [dB].
    """

    arrival_time: float
    travel_time: float
    surface_bounces: int
    bottom_bounces: int
    launch_angle: float | None
    arrival_angle: float | None
    spreading_db: float | None
    level_db: float | None


@dataclass(slots=True)
class ReceiverAnswer:
    """
    Outcome of the ping at a receiver: columns of `Ping`; numbers are null without an arrival or a
    sonar.
    """

    name: str | None
    status: str
    travel_time: float | None
    arrival_time: float | None
    refracted_range: float | None
    straight_range: float
    source_sound_speed: float | None
    chord_travel_time: float | None
    level_db: float | None
    probability: float | None
    arrivals: list[ArrivalAnswer] | None


@dataclass(slots=True)
class PingAnswer:
    """Receivers in the order of the request."""

    time: float
    receivers: list[ReceiverAnswer]


ANSWER = TypeAdapter(PingAnswer)
"""Conversion of answers to JSON; they are not models, because their values need no checks."""


class ErrorAnswer(BaseModel):
    """Reason of a failed request, in one line."""

    error: str


def error_body(line: str) -> bytes:
    """Body of an answer with one short printable line that says why a request failed."""
    return ErrorAnswer(error=one_line(line, _MAX_LINE)).model_dump_json().encode()


def read_request(body: bytes) -> PingRequest:
    """Parse the body of a request; a malformed one is refused in one line."""
    try:
        return PingRequest.model_validate_json(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["type"] == "json_invalid":
            raise ServiceError(f"not valid JSON: {first['ctx']['error']}") from None
        if not first["loc"] and first["type"] == "model_type":
            raise ServiceError(
                "the request is not a JSON object; it needs time, source and receivers"
            ) from None
        lines = [line.removeprefix(": ") for line in finding_lines(error, PingRequest)]
        more = f"; and {len(lines) - _MAX_FAULTS} more" if len(lines) > _MAX_FAULTS else ""
        raise ServiceError("; ".join(lines[:_MAX_FAULTS]) + more) from None


def answer(service: RangingService, request: PingRequest) -> PingAnswer:
    """Answer a request by one ping."""
    receivers = request.receivers
    moving = any(p.velocity is not None for p in (request.source, *receivers))
    ping = service.ping(
        request.time,
        np.array(request.source.place),
        np.array([p.place for p in receivers]),
        source_velocity=(request.source.velocity or (0.0,) * 3) if moving else None,
        receiver_velocities=[p.velocity or (0.0,) * 3 for p in receivers] if moving else None,
        geographic=request.source.geographic,
    )
    arrivals = (
        _arrivals(service, request.time, ping) if request.arrivals else [None] * len(receivers)
    )
    names = (p.name for p in receivers)
    status = (_STATUS[code] for code in ping.status.tolist())
    numbers = (column.tolist() for column in _numbers(ping))
    rows = zip(names, status, *numbers, arrivals, strict=True)
    return PingAnswer(request.time, [ReceiverAnswer(*row) for row in rows])


def answer_body(service: RangingService, body: bytes) -> bytes:
    """Body of the answer to the body of a request; a malformed one is refused in one line."""
    return ANSWER.dump_json(answer(service, read_request(body)))


_STATUS = {status.value: status.name.lower() for status in RayStatus}
# columns of a `Ping`
_numbers = attrgetter(*(field.name for field in fields(ReceiverAnswer)[2:-1]))


def _arrivals(service: RangingService, time: float, ping: Ping) -> list[list[ArrivalAnswer]]:
    """All eigenrays to each receiver."""
    rays = ping.arrivals
    receptions = ping.receptions
    detector = service.water.reception.detector
    # receptions in the order of the rays
    rows = (receptions.direction == Direction.FORTH) & (receptions.arrival >= 0)
    travel = receptions.travel_time[rows]
    level = np.full(rays.link.size, np.nan)
    if detector is not None:
        level = detector.sonar.source_level_db - receptions.loss_db[rows]
    bounces = (rays.surface_bounces, rays.bottom_bounces)
    angles = (rays.launch_angle, rays.arrival_angle)
    # columns as in `ArrivalAnswer`
    columns = (time + travel, travel, *bounces, *angles, rays.spreading_db, level)
    out: list[list[ArrivalAnswer]] = [[] for _ in range(ping.status.size)]
    for link, *row in zip(
        rays.link.tolist(), *(column.tolist() for column in columns), strict=True
    ):
        out[link].append(ArrivalAnswer(*row))
    return out


def schema() -> dict[str, object]:
    """JSON schemas of requests and answers."""
    return {
        "PingRequest": PingRequest.model_json_schema(),
        "PingAnswer": ANSWER.json_schema(mode="serialization"),
        "ErrorAnswer": ErrorAnswer.model_json_schema(mode="serialization"),
    }
