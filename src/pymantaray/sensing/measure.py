"""All measurements of a mission, without noise and with the noise of one realization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import Measurements, RangingTruth, Trajectories
from pymantaray.sensing.detection import draw_unheard
from pymantaray.sensing.landmarks import Landmark, check_names
from pymantaray.sensing.noise import SENSORS, NoiseModel
from pymantaray.sensing.other_packages import OtherNames, other_sensors
from pymantaray.sensing.picking import Candidates, draw_picks, range_on_picks
from pymantaray.sensing.ranging import Ranging
from pymantaray.sensing.schedule import by_pair
from pymantaray.sensing.sensor import Columns, Scene
from pymantaray.sensing.timing import ONE_WAY, ClockModel, Clocks, Timing, clock_error


def assemble(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    ranging: Ranging,
    noise: NoiseModel,
    *,
    gnss_depth: float | Array = 0.1,
    altitude: float | Array = 0.0,
    sensors: OtherNames = (),
) -> Measurements:
    """
    Return the measurements of a mission without noise, from its ranges.

    Parameters
    ----------
    truth : Trajectories
        True poses of the vehicles.
    landmarks : sequence of Landmark
        Landmarks.
    ranging : Ranging
        Result of `measure_ranges` for the same truth and landmarks.
    noise : NoiseModel
        Standard deviations of the measurements.
    gnss_depth : float or ndarray, shape (n_vehicles, n_samples)
        Depth above which a vehicle has a GNSS fix; 0 for no fixes, for example under ice. [m]
    altitude : float or ndarray, shape (n_vehicles, n_samples)
        Height above the sea floor; by default all vehicles are within reach of it. [m]
    sensors : sequence of str, or mapping of str to mapping
        Sensors of other packages, see `perturb`.

    Returns
    -------
    Measurements

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import NoiseModel, assemble
    >>> assemble(truth, [], ranging, NoiseModel(range_sigma=0.5)).range_sigma
    array([0.5, 0.5])
    """
    check_names(truth.name.tolist(), landmarks)
    scene = Scene(truth, landmarks, gnss_depth, altitude)
    columns: Columns = {}
    for sensor in SENSORS:
        columns |= sensor.measure(scene, noise)
    measurements = Measurements(
        name=truth.name,
        time=truth.time,
        start=truth.start,
        range_transmitter=ranging.attempts.transmitter,
        range_receiver=ranging.attempts.receiver,
        range_sample=ranging.attempts.sample,
        range_status=ranging.status,
        transmitter_sound_speed=ranging.truth.sound_speed,
        straight_range=ranging.truth.distance,
        refracted_range=ranging.truth.refracted_range,
        range_sigma=np.full(ranging.status.size, noise.range_sigma),
        **columns,
    )
    for other in other_sensors(sensors):
        measurements = other.measured(measurements, scene, noise)
    return measurements


def perturb(
    measurements: Measurements,
    *,
    root_seed: int,
    realization: int,
    timing: Timing = ONE_WAY,
    clocks: ClockModel | Clocks | None = None,
    ranging_truth: RangingTruth | None = None,
    detection: ArrayLike | Candidates | None = None,
    correlation_time: float = 0.0,
    sensors: OtherNames = (),
) -> Measurements:
    """
    Add one realization's noise to noise-free measurements.

    Parameters
    ----------
    measurements : Measurements
        From `assemble`; their standard deviations are those of the noise.
    root_seed : int
        Seed of the whole study.
    realization : int
        Index of the realization.
    timing : OneWay or TwoWay
        Timing of the ranges; it determines the effect of clocks.
    clocks : ClockModel or Clocks, optional
        Clocks of the vehicles, or their distribution in each realization. By default they are
        synchronous.
    ranging_truth : RangingTruth, optional
        True values of the same range attempts. Clocks need their travel times.
    detection : array_like, shape (n_ranges,), or Candidates, optional
        Probability that an attempt with an arrival is detected; or the arrivals that a receiver can
        mistake for the direct one, with probabilities that include their detection. By default
        every arrival is detected and no receiver errs.
    correlation_time : float
        Correlation time of the choice among candidates, see `draw_picks`. [s]
    sensors : sequence of str, or mapping of str to mapping
        Sensors of other packages, by the names of their entry points ``pymantaray.sensors``; a
        mapping has the noise levels of each. Their
        columns replace those of the same names.

    Returns
    -------
    Measurements
        With noise on all columns of sensors. With clocks, both ranges of an attempt are
        pseudoranges. An attempt that was not detected has status UNHEARD. An attempt with a
        mistaken arrival has the refracted range of that arrival, see `range_on_picks`.

    Raises
    ------
    SensingError
        If clocks, probabilities or candidates do not fit the measurements.

    Notes
    -----
    Each sensor of a vehicle and each ordered pair has its own random stream, so another vehicle or
    sensor does not change any draw. A range attempt has one draw for both of its ranges, detected
    or not. Therefore all conditions have the same noise.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import perturb
    >>> noisy = perturb(measurements, root_seed=1, realization=0)
    >>> print((noisy.straight_range - measurements.straight_range).round(2))
    [-0.3   0.59]
    """

    def normal(shape: tuple[int, ...], *names: str) -> Array:
        return stream(root_seed, realization, "sensing", *map(str, names)).standard_normal(shape)

    truth = ranging_truth
    draw = {"root_seed": root_seed, "realization": realization}
    if isinstance(detection, Candidates):
        picks = draw_picks(measurements, detection, **draw, correlation_time=correlation_time)
        measurements = range_on_picks(measurements, detection, picks)
        if truth is not None:
            wrong = detection.mistaken(picks)
            time = truth.travel_time.copy()
            time[wrong] = detection.travel_time[picks[wrong]]
            truth = replace(truth, travel_time=time)

    noise = measurements.range_sigma * by_pair(
        measurements,
        lambda transmitter, receiver, count: normal((count,), transmitter, "range", receiver),
    )
    if isinstance(clocks, ClockModel):
        clocks = clocks.draw(measurements.name.tolist(), **draw)
    if clocks is not None:
        if truth is None:
            raise SensingError("perturb: clocks need true travel times; add ranging_truth")
        noise += clock_error(measurements, truth, clocks, timing)
    columns: dict[str, Any] = {
        "straight_range": measurements.straight_range + noise,
        "refracted_range": measurements.refracted_range + noise,
    }
    for sensor in SENSORS:
        columns |= sensor.perturb(measurements, normal)
    noisy = replace(measurements, **columns)
    for other in other_sensors(sensors):
        noisy = other.perturbed(noisy, measurements, normal)
    if detection is None or isinstance(detection, Candidates):
        return noisy
    return draw_unheard(noisy, detection, **draw)
