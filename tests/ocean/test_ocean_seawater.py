"""TEOS-10 as we call it: broadcasting, gaps, and the adiabatic law."""

import gsw
import numpy as np

from pymantaray.ocean.seawater import absolute_and_conservative, density, in_situ_temperature, sound_speed


def test_potential_temperature_of_in_situ_temperature_is_the_start():
    depth = np.array([0.0, 500.0, 2_500.0, 4_000.0])
    theta = np.array([-1.5, 0.7, -0.5, -0.5])
    t = in_situ_temperature(theta, 34.9, depth, 75.0, -140.0)
    SA, CT, _ = absolute_and_conservative(t, 34.9, depth, 75.0, -140.0)
    np.testing.assert_allclose(gsw.pt_from_CT(SA, CT), theta, rtol=0, atol=1e-9)
    assert np.all(t[1:] > theta[1:])  # compression warms
    assert t[0] == theta[0]


def test_arguments_broadcast_and_gaps_stay_gaps():
    t = np.array([[1.0, np.nan], [2.0, 3.0]])
    for quantity in (sound_speed, density):
        found = quantity(t, 35.0, np.array([[0.0], [100.0]]), 10.0, np.array([20.0, 21.0]))
        assert found.shape == (2, 2)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(t))


def test_sound_speed_rises_with_temperature_salinity_and_depth():
    base = sound_speed(0.0, 34.0, 100.0, 78.0, 0.0)
    assert sound_speed(1.0, 34.0, 100.0, 78.0, 0.0) > base
    assert sound_speed(0.0, 35.0, 100.0, 78.0, 0.0) > base
    assert sound_speed(0.0, 34.0, 200.0, 78.0, 0.0) > base
