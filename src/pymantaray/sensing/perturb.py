"""The noise stage: the same measurements, perturbed by one realization's named random streams."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_exp
from pymantaray.records import Measurements, RangingTruth
from pymantaray.sensing.clocks import ClockModel, Clocks, clock_error
from pymantaray.sensing.detection import draw_unheard
from pymantaray.sensing.mistaken import Candidates, draw_taken, take_arrivals
from pymantaray.sensing.noise import ranged_pairs
from pymantaray.sensing.timing import OneWay, Timing

Array = NDArray[np.float64]
_ONE_WAY = OneWay()


def perturb(
    measurements: Measurements,
    *,
    root_seed: int,
    realization: int,
    timing: Timing = _ONE_WAY,
    clocks: ClockModel | Clocks | None = None,
    ranging_truth: RangingTruth | None = None,
    probability: ArrayLike | None = None,
    candidates: Candidates | None = None,
) -> Measurements:
    """
    Add one realization's noise to noise-free measurements.

    Parameters
    ----------
    measurements : Measurements
        As `assemble` made them; their standard deviations are those of the noise.
    root_seed : int
        Seed of the whole study.
    realization : int
        Index of the realization.
    timing : OneWay or TwoWay
        As the ranges were measured; clocks act by it.
    clocks : ClockModel or Clocks, optional
        Clocks of the vehicles, drawn anew in each realization or given. By default they are synchronous.
    ranging_truth : RangingTruth, optional
        Of the same range attempts. Needed where there are clocks, which act on its travel times.
    probability : array_like, shape (n_ranges,), optional
        That an attempt with an arrival is heard. By default it is.
    candidates : Candidates, optional
        Arrivals that may be taken for the direct ones; their probabilities include that of being heard, so
        `probability` is left out. By default the receiver never errs.

    Returns
    -------
    Measurements
        Ranges, depths, GNSS fixes and landmark surveys with added Gaussian noise; odometry and
        first-pose priors with noise ``T Exp(xi)`` on the manifold. With clocks, both ranges of an attempt are
        pseudoranges. An attempt that was not heard has status UNHEARD. One that took another arrival for
        the direct one has that arrival's refracted range, see `take_arrivals`.

    Raises
    ------
    SensingError
        If clocks, probabilities or candidates do not fit the measurements, or both of the latter are given.

    Notes
    -----
    Each vehicle's sensor and each ordered pair draws from its own stream, so another vehicle or sensor
    moves no draw. A range attempt has one draw, heard or not, and both of its ranges get it; a vehicle
    draws for a GNSS fix at every sample, surfaced or not. So all conditions see the same noise.
    """

    def normal(shape: tuple[int, ...], *names: str) -> Array:
        return stream(root_seed, realization, "sensing", *names).standard_normal(shape)

    o = measurements
    if candidates is not None:
        if probability is not None:
            raise SensingError(
                "perturb: probability and candidates are given; candidates hold both, give them alone"
            )
        taken = draw_taken(o, candidates, root_seed=root_seed, realization=realization)
        o = take_arrivals(o, candidates, taken)
        if ranging_truth is not None:
            wrong = candidates.mistaken(taken)
            time = ranging_truth.travel_time.copy()
            time[wrong] = candidates.travel_time[taken[wrong]]
            ranging_truth = replace(ranging_truth, travel_time=time)
    names = [str(name) for name in o.name]
    n_time = o.time.size
    edges = o.odometry_sigma.shape[1:]
    odometry = np.stack([normal(edges, name, "odometry") for name in names]) * o.odometry_sigma
    rotation, translation = _compose(o.odometry_rotation, o.odometry_translation, odometry)
    first = np.stack([normal((6,), name, "first pose") for name in names]) * o.first_sigma
    first_quaternion, first_position = _compose(o.first_quaternion, o.first_position, first)
    depth = np.stack([normal((n_time,), name, "depth") for name in names]) * o.depth_sigma[:, None]
    gnss = np.stack([normal((n_time, 3), name, "gnss") for name in names])[o.gnss_agent, o.gnss_sample]
    surveys = [normal((3,), str(name), "survey") for name in o.landmark_name]
    survey = np.array(surveys).reshape(-1, 3) * o.landmark_sigma[:, None]

    noise = np.empty(o.range_status.size)
    for transmitter, receiver, rows in ranged_pairs(o):
        noise[rows] = normal((rows.size,), transmitter, "range", receiver)
    noise *= o.range_sigma
    if isinstance(clocks, ClockModel):
        clocks = clocks.draw(names, root_seed=root_seed, realization=realization)
    if clocks is not None:
        if ranging_truth is None:
            raise SensingError("perturb: clocks act on true travel times; give ranging_truth")
        noise += clock_error(o, ranging_truth, clocks, timing)
    noisy = replace(
        o,
        odometry_rotation=rotation,
        odometry_translation=translation,
        depth=o.depth + depth,
        gnss_position=o.gnss_position + gnss * o.gnss_sigma[:, None],
        landmark_position=o.landmark_position + survey,
        first_position=first_position,
        first_quaternion=first_quaternion,
        straight_range=o.straight_range + noise,
        refracted_range=o.refracted_range + noise,
    )
    if probability is None:
        return noisy
    return draw_unheard(noisy, probability, root_seed=root_seed, realization=realization)


def _compose(quaternion: Array, translation: Array, xi: Array) -> tuple[Array, Array]:
    """Right-compose a pose with the exponential of a tangent vector."""
    rotation = matrix_from_quaternion(quaternion)
    turn, move = se3_exp(xi)
    return quaternion_from_matrix(rotation @ turn), translation + np.einsum(
        "...ij,...j->...i", rotation, move
    )
