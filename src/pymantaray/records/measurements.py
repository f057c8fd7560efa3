"""Measurements of vehicles: odometry, depth, surface GNSS and ranges, with or without noise."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, DatedRecord, column
from pymantaray.records.status import RayStatus


@dataclass(frozen=True, eq=False)
class Measurements(DatedRecord):
    """
    Measurements of a fleet at common sample times, and their stated standard deviations.

    A sample is an index into ``time``. In the range table, a participant is an index into ``name``
    if it is below the number of vehicles, otherwise this number plus an index into
    ``landmark_name``. Every range attempt has a row; ``range_status`` (`RayStatus`) is its outcome.
    The simulator writes values without noise, and `sensing.perturb` adds noise. `RangingTruth`
    contains the data to which estimators have no access.

    Examples
    --------
    >>> from pymantaray.apps.ranges import measure
    >>> from pymantaray import Trajectories
    >>> fleet = Trajectories(
    ...     name=["A", "B"],
    ...     role=["vehicle", "vehicle"],
    ...     time=[0.0, 60.0],
    ...     position=[[[0, 0, 20], [30, 0, 20]], [[2000, 0, 400], [2000, 30, 400]]],
    ...     quaternion=[[[1, 0, 0, 0]] * 2] * 2,
    ...     status=[[0, 0], [0, 0]],
    ... )
    >>> sea = {"source": "synthetic:beaufort", "centre_lat": 74.5, "centre_lon": -140.0}
    >>> run = measure(fleet, sea, 60.0)
    >>> run.measurements.name.tolist(), run.measurements.depth.shape
    (['A', 'B'], (2, 2))
    """

    kind: ClassVar[str] = "measurements"

    name: Column = column("vehicle", "", "vehicle name", "U", labels=True)
    time: Column = column("time", "s", "time since the start of the mission")

    odometry_rotation: Column = column(
        "vehicle edge quat", "1", "relative rotation from pose k to k+1, (w, x, y, z)"
    )
    odometry_translation: Column = column(
        "vehicle edge body_axis", "m", "translation from pose k to k+1 in body frame k"
    )
    odometry_sigma: Column = column(
        "vehicle edge tangent", "1", "sigma in the tangent: 3 rotation [rad], 3 translation [m]"
    )

    depth: Column = column("vehicle time", "m", "depth, positive down")
    depth_sigma: Column = column("vehicle", "m", "standard deviation of the depth measurement")

    gnss_vehicle: Column = column("fix", "1", "index of the vehicle", "i4")
    gnss_sample: Column = column("fix", "1", "index into time", "i4")
    gnss_position: Column = column("fix axis", "m", "GNSS position in the local frame")
    gnss_sigma: Column = column("fix", "m", "standard deviation per axis")

    landmark_name: Column = column("landmark", "", "landmark name", "U", labels=True)
    landmark_position: Column = column("landmark axis", "m", "surveyed position of the landmark")
    landmark_sigma: Column = column("landmark", "m", "standard deviation per axis of the survey")

    first_position: Column = column("vehicle axis", "m", "position prior of the first pose")
    first_quaternion: Column = column(
        "vehicle quat", "1", "orientation prior of the first pose, (w, x, y, z)"
    )
    first_sigma: Column = column(
        "vehicle tangent", "1", "sigma of the first-pose prior: rotation [rad], translation [m]"
    )

    range_transmitter: Column = column("range", "1", "participant that transmits", "i4")
    range_receiver: Column = column("range", "1", "participant that receives", "i4")
    range_sample: Column = column("range", "1", "index into time", "i4")
    range_status: Column = column("range", "1", "outcome of the attempt", "i1", flags=RayStatus)
    transmitter_sound_speed: Column = column("range", "m s-1", "sound speed at the transmitter")
    straight_range: Column = column("range", "m", "measured straight distance")
    refracted_range: Column = column(
        "range", "m", "sound speed at the transmitter times measured travel time, NaN for a dropout"
    )
    range_sigma: Column = column("range", "m", "standard deviation of the range")

    attitude_vehicle: Column = column("attitude", "1", "index of the vehicle", "i4", may_lack=True)
    attitude_sample: Column = column("attitude", "1", "index into time", "i4", may_lack=True)
    attitude_quaternion: Column = column(
        "attitude quat", "1", "rotation body to world, (w, x, y, z)", may_lack=True
    )
    attitude_sigma: Column = column(
        "attitude axis", "rad", "sigma of rotations about north, east and down", may_lack=True
    )
    attitude_bias_sigma: Column = column(
        "attitude", "rad", "sigma of the heading's bias", may_lack=True
    )

    dvl_vehicle: Column = column("dvl", "1", "index of the vehicle", "i4", may_lack=True)
    dvl_sample: Column = column(
        "dvl", "1", "index into time of the first of two samples", "i4", may_lack=True
    )
    dvl_velocity: Column = column(
        "dvl body_axis",
        "m s-1",
        "mean velocity over ground until the next sample, in the body frame",
        may_lack=True,
    )
    dvl_sigma: Column = column(
        "dvl body_axis", "m s-1", "standard deviation of each axis of the velocity", may_lack=True
    )
    dvl_bias_sigma: Column = column("dvl", "m s-1", "standard deviation of the bias", may_lack=True)
    dvl_beam_loss: Column = column("dvl", "1", "probability that a beam is lost", may_lack=True)

    altimeter_vehicle: Column = column(
        "altimeter", "1", "index of the vehicle", "i4", may_lack=True
    )
    altimeter_sample: Column = column("altimeter", "1", "index into time", "i4", may_lack=True)
    altimeter_depth: Column = column(
        "altimeter", "m", "charted depth of the sea floor minus altitude", may_lack=True
    )
    altimeter_sigma: Column = column(
        "altimeter", "m", "standard deviation of the altitude", may_lack=True
    )
    altimeter_bias_sigma: Column = column(
        "altimeter", "m", "standard deviation of the charted depth's error", may_lack=True
    )
