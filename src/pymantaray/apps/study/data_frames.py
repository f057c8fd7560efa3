"""Data frames of a run, with one row per range attempt or pose and units in `attrs`."""

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pymantaray.evaluation import trajectory_errors
from pymantaray.records import DatedRecord, RangingTruth, RayStatus, VehicleStatus
from pymantaray.records.status import TRUTH

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.apps.study.store import Run

_POSE = ("north", "east", "down", "qw", "qx", "qy", "qz")
_UNITS = {
    "time": "s",
    "date": "UTC",
    **dict.fromkeys(("latitude", "longitude"), "degrees"),
    **dict.fromkeys(("north", "east", "down", "error"), "m"),
    **dict.fromkeys(("straight_range", "refracted_range", "range_sigma"), "m"),
    **{f.name: f.metadata["units"] for f in fields(RangingTruth) if f.metadata["units"] != "1"},
    "convergence": "degrees",
}


def range_frame(run: "Run", realization: int | None) -> pd.DataFrame:
    """
    One row per range attempt: measurements, without noise or of a realization, and true values.
    """
    m = run.measurements if realization is None else run.noisy_measurements(realization)
    truth = run.ranging_truth_in(realization)
    names = np.concatenate([m.name, m.landmark_name])
    measured = {
        name: getattr(m, name) for name in ("straight_range", "refracted_range", "range_sigma")
    }
    true = {f.name: getattr(truth, f.name) for f in fields(truth)}
    # flags become booleans
    true = {n: v == 1 if v.dtype == np.int8 else v for n, v in true.items()}
    frame = pd.DataFrame(
        {
            "time": m.time[m.range_sample],
            "transmitter": names[m.range_transmitter],
            "receiver": names[m.range_receiver],
            "status": np.array([member.name for member in RayStatus])[m.range_status],
            "distance": true.pop("distance"),
            **measured,
            **true,
        }
    )
    return _finished(frame, m)


def error_frame(run: "Run") -> pd.DataFrame:
    """
    One row per estimated pose: estimate minus truth along each axis, and the length of this
    difference.
    """
    truth = run.truth
    estimates = run.estimates
    error = estimates.to_dataset()["position"] - truth.position
    frame = _rows(error.to_dataset(dim="axis"))
    frame["error"] = trajectory_errors(truth, estimates).ravel()
    return _finished(frame, truth)


def pose_frame(run: "Run", realization: int) -> pd.DataFrame:
    """
    One row per pose of the truth and of every condition in a realization; convergence is the
    bearing of true north.
    """
    # ranges alone have realizations of noise, but no estimates
    estimated = realization if run.study.solves else 0
    estimates = run.estimates.to_dataset().isel(realization=estimated)
    parts = {TRUTH: _poses(run.truth.to_dataset())}
    for condition in run.estimates.condition.tolist():
        parts[condition] = _poses(estimates.sel(condition=condition))
    frame = pd.concat(parts, names=["condition"]).reset_index("condition").reset_index(drop=True)
    status = np.array([member.name for member in VehicleStatus])[run.truth.status].ravel()
    frame["status"] = np.tile(status, len(parts))
    if (local := run.truth.frame) is not None:
        latitude, longitude = local.to_geodetic(frame["north"], frame["east"])
        frame.insert(3, "latitude", latitude)
        frame.insert(4, "longitude", longitude)
        frame.insert(5, "convergence", np.degrees(local.convergence(latitude, longitude)))
    return _finished(frame, run.truth)


def _poses(data: "xr.Dataset") -> pd.DataFrame:
    position = data["position"].to_dataset(dim="axis")
    quaternion = data["quaternion"].to_dataset(dim="quat")
    poses = position.merge(
        quaternion.rename({axis: f"q{axis}" for axis in "wxyz"}), compat="override"
    )
    return _rows(poses)[["vehicle", "time", *_POSE]]


def _rows(data: "xr.Dataset") -> pd.DataFrame:
    return data.reset_coords(drop=True).to_dataframe().reset_index()


def _finished(frame: pd.DataFrame, record: DatedRecord) -> pd.DataFrame:
    """Frame with units, and with dates beside its times if the mission has a date."""
    if not np.isnat(record.start):
        since = pd.to_timedelta(frame["time"], unit="s")
        frame.insert(list(frame).index("time") + 1, "date", pd.Timestamp(record.start) + since)
    frame.attrs["units"] = {name: _UNITS[name] for name in frame if name in _UNITS}
    return frame
