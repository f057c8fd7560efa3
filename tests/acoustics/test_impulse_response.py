"""
The impulse response of a link is the sum of its arrivals: image sources give it in uniform water, a
coherent sum gives it at one frequency, and phases follow the convention of Bellhop's arrivals.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pymantaray.acoustics import (
    FluidBottom,
    Medium,
    find_eigenrays,
    plot_arrivals,
    received_loss_db,
    transmission_loss,
)
from pymantaray.apps.bellhop import read_bellhop_arrivals
from pymantaray.errors import RecordError

C, DEPTH, FS = 1500.0, 200.0, 8000.0
SOURCE, RECEIVER = np.array([0.0, 0.0, 40.0]), np.array([900.0, 0.0, 110.0])
BELLHOP = Path(__file__).parents[1] / "apps" / "bellhop" / "data" / "bellhop_plane.arr"


def water():
    return Medium.from_profile([0.0, 100.0, DEPTH], [C, C, C], bottom_depth=DEPTH)


def link(bounces=(1, 1)):
    medium = water()
    arrivals = find_eigenrays(
        medium,
        SOURCE[None],
        RECEIVER[None],
        max_surface_bounces=bounces[0],
        max_bottom_bounces=bounces[1],
    )
    return medium, arrivals


def images():
    """Travel time [s] and pressure re 1 m of the images of up to one reflection at each side."""
    found = []
    for depth, sign in (
        (40.0, 1.0),
        (-40.0, -1.0),
        (2.0 * DEPTH - 40.0, 1.0),
        (2.0 * DEPTH + 40.0, -1.0),  # surface, then bed
        (-2.0 * DEPTH + 40.0, -1.0),  # bed, then surface
    ):
        length = np.hypot(900.0, 110.0 - depth)
        found.append((length / C, sign / length))
    return np.array(sorted(found)).T


def test_a_response_in_uniform_water_is_that_of_image_sources():
    medium, arrivals = link()
    loss = transmission_loss(medium, SOURCE[None], RECEIVER[None], arrivals, 1000.0)
    response = arrivals.impulse_response(FS, loss)
    time, pressure = images()
    expected = np.sum(
        pressure * np.sinc(FS * (response["delay"].values[:, None] + time[0] - time)), axis=1
    )
    np.testing.assert_allclose(response.values[0], expected, atol=1e-9)
    assert float(response["travel_time"][0]) == pytest.approx(time[0], abs=1e-9)


def test_a_tone_through_the_response_is_the_coherent_sum():
    medium, arrivals = link()
    bottom = FluidBottom(sound_speed=1700.0, density=1800.0, attenuation_db_per_wavelength=0.6)
    ends = SOURCE[None], RECEIVER[None]
    loss = transmission_loss(medium, *ends, arrivals, 1000.0, bottom=bottom)
    response = arrivals.impulse_response(FS, loss)
    tone = np.sum(response.values[0] * np.exp(-2j * np.pi * 1000.0 * response["delay"].values))
    expected = received_loss_db(arrivals, loss, 1000.0, 100.0, coherent=True)
    assert -20.0 * np.log10(np.abs(tone)) == pytest.approx(expected[0], abs=0.1)


def test_phases_are_those_of_bellhop():
    """A reflection at the surface has a phase of pi in Bellhop's file, and reverses a response."""
    bellhop = read_bellhop_arrivals(BELLHOP)
    phase = bellhop.phase - np.pi * bellhop.surface_bounces
    np.testing.assert_allclose(np.cos(phase), 1.0, atol=1e-9)
    _, arrivals = link((1, 0))
    assert arrivals.surface_bounces.tolist() == [0, 1]
    response = arrivals.impulse_response(FS)
    at = [16, 16 + round(FS * float(np.diff(arrivals.travel_time)[0]))]
    assert response.values[0, at[0]].real > 0.9
    assert response.values[0, at[1]].real < -0.5


def test_a_caustic_turns_the_phase_by_a_quarter_of_a_cycle():
    _, arrivals = link((0, 0))
    passed = replace(arrivals, caustics=np.ones(1, dtype=np.int16))
    plain, turned = (a.impulse_response(FS).values[0, 16] for a in (arrivals, passed))
    assert turned == pytest.approx(1j * plain, abs=1e-12)


def test_links_without_an_arrival_are_silent():
    medium = Medium.from_profile(
        [0.0, 100.0, 3000.0], [1500.0, 1480.0, 1530.0], bottom_depth=3000.0
    )
    ends = [[0.0, 0.0, 5.0], [0.0, 0.0, 500.0]], [[20e3, 0.0, 5.0], [900.0, 0.0, 400.0]]
    response = find_eigenrays(medium, *ends).impulse_response(FS)
    assert np.isnan(response["travel_time"][0])
    assert not response.values[0].any()
    assert np.abs(response.values[1]).max() == pytest.approx(1.0, abs=0.1)


def test_a_wrong_rate_or_loss_is_refused():
    medium, arrivals = link()
    _, other = link((0, 0))
    loss = transmission_loss(medium, SOURCE[None], RECEIVER[None], other, 1000.0)
    with pytest.raises(RecordError, match="sampling_rate is 0"):
        arrivals.impulse_response(0.0)
    with pytest.raises(RecordError, match="loss is of other arrivals"):
        arrivals.impulse_response(FS, loss)


def test_the_figure_of_arrivals_has_their_delays_and_levels():
    medium, arrivals = link()
    loss = transmission_loss(medium, SOURCE[None], RECEIVER[None], arrivals, 1000.0)
    axes = plot_arrivals(arrivals, loss=loss)
    points = np.concatenate([line.get_xydata() for line in axes.lines])
    points = points[np.argsort(points[:, 0])]
    np.testing.assert_allclose(
        points[:, 0], 1e3 * (arrivals.travel_time - arrivals.travel_time[0]), atol=1e-9
    )
    np.testing.assert_allclose(points[:, 1], -loss.total_db)
    assert axes.get_xlabel() == "Delay from the first arrival [ms]"
