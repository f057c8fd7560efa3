"""All measurements of a mission without noise, each with the noise level it is believed to have."""

from collections.abc import Sequence

import numpy as np

from pymantaray.records import Measurements, Trajectories
from pymantaray.sensing.depth import measure_depth
from pymantaray.sensing.gnss import measure_gnss
from pymantaray.sensing.landmarks import Landmark, check_names, landmark_positions
from pymantaray.sensing.noise import NoiseModel
from pymantaray.sensing.odometry import measure_odometry
from pymantaray.sensing.ranging import Ranging


def assemble(
    truth: Trajectories,
    landmarks: Sequence[Landmark],
    ranging: Ranging,
    noise: NoiseModel,
    *,
    gnss_depth: float = 1.0,
) -> Measurements:
    """
    Measurements of a mission whose ranges are already measured.

    Parameters
    ----------
    truth : Trajectories
        Where the vehicles are.
    landmarks : sequence of Landmark
        The same as were ranged.
    ranging : Ranging
        What `measure_ranges` returned for the same truth.
    noise : NoiseModel
        Fills the standard deviations; nothing is perturbed.
    gnss_depth : float
        A vehicle has a GNSS fix while it is shallower. [m]

    Returns
    -------
    Measurements
        Without noise.

    Raises
    ------
    SensingError
        If a name is used twice or the GNSS depth is negative.
    """
    check_names([str(name) for name in truth.name], landmarks)
    n_agents = len(truth.name)
    rotation, translation = measure_odometry(truth)
    fixes = measure_gnss(truth, gnss_depth=gnss_depth)
    first_sigma = np.repeat([noise.first_rotation_sigma, noise.first_position_sigma], 3)
    return Measurements(
        name=truth.name,
        time=truth.time,
        odometry_rotation=rotation,
        odometry_translation=translation,
        odometry_sigma=noise.odometry_sigma(rotation, translation, truth.time),
        depth=measure_depth(truth),
        depth_sigma=np.full(n_agents, noise.depth_sigma),
        gnss_agent=fixes.agent,
        gnss_sample=fixes.sample,
        gnss_position=fixes.position,
        gnss_sigma=np.full(fixes.agent.size, noise.gnss_sigma),
        landmark_name=np.array([landmark.name for landmark in landmarks], dtype=str),
        landmark_position=landmark_positions(landmarks),
        landmark_sigma=np.full(len(landmarks), noise.landmark_sigma),
        first_position=truth.position[:, 0],
        first_quaternion=truth.quaternion[:, 0],
        first_sigma=np.tile(first_sigma, (n_agents, 1)),
        range_transmitter=ranging.attempts.transmitter,
        range_receiver=ranging.attempts.receiver,
        range_sample=ranging.attempts.sample,
        range_status=ranging.status,
        transmitter_sound_speed=ranging.truth.sound_speed,
        straight_range=ranging.truth.distance,
        refracted_range=ranging.truth.refracted_range,
        range_sigma=np.full(ranging.status.size, noise.range_sigma),
    )
