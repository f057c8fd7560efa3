"""Dead reckoning against motions whose end is known."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import EstimationError
from pymantaray.estimation import dead_reckon
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_exp


def test_noise_free_odometry_leads_back_to_the_truth(fleet):
    position, quaternion = dead_reckon(fleet.noise_free)
    np.testing.assert_allclose(position, fleet.position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        matrix_from_quaternion(quaternion), matrix_from_quaternion(fleet.quaternion), rtol=0, atol=1e-12
    )


def test_constant_twist_composes_to_its_exponential(make_fleet):
    o = make_fleet(n_agents=1, n_times=41).noise_free
    twist = np.array([0.01, -0.02, 0.05, 30.0, 1.0, -2.0])
    step, way = se3_exp(twist)
    odometry = replace(
        o,
        odometry_rotation=np.tile(quaternion_from_matrix(step), (1, 40, 1)),
        odometry_translation=np.tile(way, (1, 40, 1)),
        first_position=np.zeros((1, 3)),
        first_quaternion=np.array([[1.0, 0, 0, 0]]),
    )
    position, quaternion = dead_reckon(odometry)
    whole, end = se3_exp(40 * twist)
    np.testing.assert_allclose(position[0, -1], end, rtol=0, atol=1e-9)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion[0, -1]), whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("field", "what"), [("first_position", "first-pose prior"), ("odometry_translation", "odometry")]
)
def test_missing_input_is_refused_by_vehicle(fleet, field, what):
    broken = np.array(getattr(fleet.noisy, field))
    broken[1] = np.nan
    with pytest.raises(EstimationError, match=f"^vehicle B: {what} is not finite"):
        dead_reckon(replace(fleet.noisy, **{field: broken}))
