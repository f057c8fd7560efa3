"""
In a section of sound speed by range and depth, rays, amplitudes and phases are those that Bellhop
finds on the same file.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pymantaray import find_eigenrays, open_water
from pymantaray.acoustics import FluidBottom, transmission_loss
from pymantaray.apps.bellhop import read_bellhop_arrivals

DATA = Path(__file__).parent / "data"
WIDEST = np.radians(29.0)  # Bellhop's fan ends at 30 degrees
RATE = 4000.0  # samples per second
# a beam that touches a level gives Bellhop an arrival of -112 dB at 9 km and 1200 m; its ray, in a
# dense fan through the same section, is 2.4 m below the receiver
WEAKEST = 10.0 ** (-105.0 / 20.0)
NEAR = 3e-6  # s; Bellhop's times have single precision, and are those of beams 0.003 degrees apart


def write_section(folder):
    """Write the section of which Bellhop wrote the arrivals: a duct that ends at a front."""
    ranges, depth = np.linspace(-1.0, 17.0, 37), np.linspace(0.0, 3000.0, 61)
    eta = 2.0 * (depth[:, None] - 900.0) / 900.0
    speed = 1500.0 * (1.0 + 0.00737 * (eta - 1.0 + np.exp(-eta)))
    speed = speed + 6.0 * np.tanh((ranges - 8.0) / 2.0) * np.exp(-((depth[:, None] / 400.0) ** 2))
    rows = [ranges, *speed]
    lines = [str(ranges.size), *(" ".join(f"{value:.6f}" for value in row) for row in rows)]
    (folder / "bellhop_section.ssp").write_text("\n".join(lines) + "\n")
    shutil.copy(DATA / "bellhop_section.env", folder)
    return folder / "bellhop_section.ssp"


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Links, our arrivals with their loss, and those of Bellhop with their links."""
    water = open_water(write_section(tmp_path_factory.mktemp("section")), interpolation="linear")
    bellhop = read_bellhop_arrivals(DATA / "bellhop_section.arr")
    depth, reach = np.meshgrid(bellhop.receiver_depth, bellhop.receiver_range, indexing="ij")
    receiver = np.column_stack([reach.ravel(), np.zeros(depth.size), depth.ravel()])
    source = np.broadcast_to([0.0, 0.0, bellhop.source_depth[0]], receiver.shape)
    arrivals = find_eigenrays(water.medium, source, receiver, 1, 1, None)
    # Bellhop's bed in water of 1 g/cm3 has the density of water
    bottom = FluidBottom(sound_speed=1600.0, density=1025.0)
    loss = transmission_loss(
        water.medium, source, receiver, arrivals, float(bellhop.frequency), bottom=bottom
    )
    return arrivals, loss, bellhop


def bounces(arrivals):
    return np.column_stack([arrivals.surface_bounces, arrivals.bottom_bounces])


def of_same_link(arrivals, row, bellhop):
    """Arrivals of Bellhop with the link and the reflections of one of ours."""
    same = (bounces(bellhop) == bounces(arrivals)[row]).all(axis=1)
    return np.flatnonzero(same & (bellhop.pair == arrivals.link[row]))


def test_every_arrival_is_found_by_both(both):
    arrivals, _, bellhop = both
    comparable = np.flatnonzero(np.abs(arrivals.launch_angle) < WIDEST)
    pairs = []
    for row in comparable:
        others = of_same_link(arrivals, row, bellhop)
        away = np.abs(bellhop.travel_time[others] - arrivals.travel_time[row])
        assert away.min() < NEAR
        pairs.append(others[np.argmin(away)])
    within = (bounces(bellhop) <= 1).all(axis=1) & (np.abs(bellhop.launch_declination) < WIDEST)
    assert set(pairs) == set(np.flatnonzero(within & (bellhop.amplitude > WEAKEST)))
    assert len(set(map(tuple, bounces(bellhop)[pairs]))) == 4  # none, surface, bed, both
    assert np.bincount(arrivals.link[comparable]).max() == 4


def test_angles_amplitudes_and_phases_are_those_of_bellhop(both):
    arrivals, loss, bellhop = both
    differences = []
    for row in np.flatnonzero(np.abs(arrivals.launch_angle) < WIDEST):
        others = of_same_link(arrivals, row, bellhop)
        angle = np.abs(bellhop.launch_declination[others] - arrivals.launch_angle[row])
        other = others[np.argmin(angle)]
        assert angle.min() < np.radians(0.1)
        phase = 0.5 * np.pi * arrivals.caustics[row] - loss.boundary_phase[row]
        assert np.cos(bellhop.phase[other] - phase) > np.cos(np.radians(0.2))
        level = 20.0 * np.log10(bellhop.amplitude[other]) + loss.total_db[row]
        differences.append(np.abs(level))
    assert np.median(differences) < 0.001
    assert np.quantile(differences, 0.9) < 0.02
    assert np.max(differences) < 2.0  # beside a caustic


def test_the_impulse_response_is_that_of_bellhops_arrivals(both):
    arrivals, loss, bellhop = both
    response = arrivals.impulse_response(RATE, loss)
    start = response["travel_time"].values
    inside = np.abs(arrivals.launch_angle) < WIDEST
    whole = [k for k in range(start.size) if inside[arrivals.link == k].all()]
    used = (bounces(bellhop) <= 1).all(axis=1) & (bellhop.amplitude > WEAKEST)
    assert len(whole) > 3
    for link in whole:
        own = used & (bellhop.pair == link)
        size = bellhop.amplitude[own] * np.exp(1j * bellhop.phase[own])
        delay = bellhop.travel_time[own] - start[link]
        samples = response["delay"].values[:, None] - delay
        expected = np.sum(size * np.sinc(RATE * samples), axis=1)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(response.values[link], expected, atol=0.03 * largest)
