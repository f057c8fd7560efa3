"""Writer of files for the viewer Rerun, in its axes: east, north, up."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.errors import ExchangeError, optional_package
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.recording import Recording
from pymantaray.records.status import TRUTH

TIMELINE = "mission"


def write_rrd(recording: Recording, path: Path) -> None:
    """
    Write a recording as a Rerun file.

    ``map`` has axes east, north, up [m]. It contains moving bodies (forward, left, up) under
    ``map/<condition>/<vehicle>``, their paths under ``map/path``, ``map/landmarks``, and
    ``map/ranges``, the pairs with a received ping. ``earth/<vehicle>`` has true paths as latitudes
    and longitudes, ``error/<condition>/<vehicle>`` distances from the truth [m], and
    ``range_error/<transmitter>/<receiver>`` refracted minus true range [m].

    Raises
    ------
    ExchangeError
        If rerun-sdk is not installed.
    """
    with optional_package(ExchangeError, "rrd", "rerun-sdk", "rerun"):
        import rerun as rr
    stream = rr.RecordingStream("mantaray", recording_id=recording.name)
    stream.save(path)
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for entity, archetype in _static(rr, recording):
        stream.log(entity, archetype, static=True)
    for entity, samples, columns in _moving(rr, recording):
        rr.send_columns(
            entity, indexes=[_times(rr, recording, samples)], columns=columns, recording=stream
        )
    stream.flush()
    stream.disconnect()


def _times(rr: Any, recording: Recording, samples: Any) -> Any:
    """Instants of samples, as dates if the mission has a date."""
    truth = recording.truth
    time = truth.time[samples]
    if np.isnat(truth.start):
        return rr.TimeColumn(TIMELINE, duration=time)
    since = np.round(time * 1e9).astype("m8[ns]")
    return rr.TimeColumn(TIMELINE, timestamp=truth.start.astype("M8[ns]") + since)


def _static(rr: Any, recording: Recording) -> Iterator[tuple[str, Any]]:
    truth = recording.truth
    m = recording.measurements
    if m.landmark_name.size:
        yield (
            "map/landmarks",
            rr.Points3D(swap_enu(recording.landmarks), labels=m.landmark_name.tolist()),
        )
    for p in recording.poses:
        yield f"map/path/{p.condition}/{p.vehicle}", rr.LineStrips3D([swap_enu(p.position)])
        yield f"map/{p.condition}/{p.vehicle}", rr.Points3D([[0.0, 0.0, 0.0]], labels=[p.vehicle])
        if p.condition == TRUTH and truth.frame is not None:
            places = np.stack(truth.frame.to_geodetic(*p.position[:, :2].T), axis=-1)
            yield f"earth/{p.vehicle}", rr.GeoLineStrings(lat_lon=[places])


def _moving(rr: Any, recording: Recording) -> Iterator[tuple[str, Any, Any]]:
    """Entities with their samples and values."""
    truth = recording.truth
    m = recording.measurements
    received = recording.received
    true = dict(zip(truth.name.tolist(), truth.position, strict=True))
    for p in recording.poses:
        xyzw = swap_enu_attitude(p.quaternion)[:, [1, 2, 3, 0]]
        yield (
            f"map/{p.condition}/{p.vehicle}",
            p.samples,
            rr.Transform3D.columns(translation=swap_enu(p.position), quaternion=xyzw),
        )
        if p.condition != TRUTH:
            error = np.linalg.norm(p.position - true[p.vehicle][p.samples], axis=1)
            yield f"error/{p.condition}/{p.vehicle}", p.samples, rr.Scalars.columns(scalars=error)
    ends = np.stack([m.range_transmitter, m.range_receiver], axis=1)[received]
    samples, count = np.unique(m.range_sample[received], return_counts=True)
    places = np.array(
        [
            [recording.place(int(end), int(k)) for end in pair]
            for pair, k in zip(ends, m.range_sample[received], strict=True)
        ]
    ).reshape(-1, 2, 3)
    if received.size:
        yield (
            "map/ranges",
            samples,
            rr.LineStrips3D.columns(strips=list(swap_enu(places))).partition(count),
        )
    error = m.refracted_range[received] - np.linalg.norm(places[:, 0] - places[:, 1], axis=1)
    for pair in np.unique(ends, axis=0):
        rows = (ends == pair).all(axis=1)
        names = "/".join(recording.participants[end] for end in pair)
        yield (
            f"range_error/{names}",
            m.range_sample[received][rows],
            rr.Scalars.columns(scalars=error[rows]),
        )
