"""
Arrivals that a receiver cannot separate: the image source, limits of the band, and the field across
a caustic.
"""

import numpy as np
import pytest
from oracles import image_source
from refusals import refused

from pymantaray.acoustics import (
    Medium,
    find_eigenrays,
    find_tails,
    received_loss_db,
    transmission_loss,
)
from pymantaray.acoustics.levels.caustics import fold_between, fold_pairs, waves_of
from pymantaray.errors import AcousticsError

SPEED, HZ = 1480.0, 3000.0
DEPTHS = np.array([3.0, 5.0, 10.0, 20.0, 40.0])


def shallow(draft=0.0):
    """
    Uniform water below a flat surface or the flat underside of ice: ends, arrivals with one
    reflection, and losses.
    """
    water = Medium.from_profile([0.0, 500.0], [SPEED, SPEED], bottom_depth=500.0, ice_draft=draft)
    source = np.tile([0.0, 0.0, 5.0 + draft], (DEPTHS.size, 1))
    receiver = np.column_stack(
        [np.full(DEPTHS.size, 1500.0), np.zeros(DEPTHS.size), DEPTHS + draft]
    )
    arrivals = find_eigenrays(water, source, receiver, 1, 0)
    assert arrivals.link.tolist() == np.repeat(np.arange(DEPTHS.size), 2).tolist()
    return arrivals, transmission_loss(water, source, receiver, arrivals, HZ)


@pytest.mark.parametrize("draft", [0.0, 3.0])
def test_coherent_direct_and_reflected_sound_is_source_plus_image(draft):
    arrivals, loss = shallow(draft)
    exact = -20.0 * np.log10(np.abs(image_source(5.0, 1500.0, DEPTHS, 2.0 * np.pi * HZ / SPEED)))
    tone = received_loss_db(arrivals, loss, HZ, 200.0, coherent=True)
    np.testing.assert_allclose(tone, np.repeat(exact, 2), rtol=0.0, atol=0.01)
    assert (
        np.ptp(exact - loss.total_db[::2]) > 15.0
    )  # from 12 dB weaker to 6 dB stronger than the direct sound


def test_the_band_decides_by_default_what_is_summed():
    """
    Delays of 14 us to 0.18 ms: all are summed in a band of 50 Hz, none is in one of 1 MHz at least
    within 0.1 dB.
    """
    arrivals, loss = shallow()
    alone = received_loss_db(arrivals, loss, HZ, 200.0, coherent=False)
    np.testing.assert_array_equal(alone, loss.total_db)
    tone = received_loss_db(arrivals, loss, HZ, 200.0, coherent=True)
    np.testing.assert_allclose(
        received_loss_db(arrivals, loss, HZ, 50.0), tone, rtol=0.0, atol=0.01
    )
    np.testing.assert_allclose(received_loss_db(arrivals, loss, HZ, 1e7), alone, rtol=0.0, atol=0.1)


def test_a_link_with_one_arrival_keeps_its_loss_to_the_last_digit():
    water = Medium.from_profile([0.0, 500.0], [SPEED, SPEED], bottom_depth=500.0)
    ends = (
        np.tile([0.0, 0.0, 50.0], (3, 1)),
        np.array([[900.0, 0.0, z] for z in (10.0, 50.0, 200.0)]),
    )
    arrivals = find_eigenrays(water, *ends)
    loss = transmission_loss(water, *ends, arrivals, HZ)
    for coherent in (True, False, "auto"):
        received = received_loss_db(arrivals, loss, HZ, 200.0, coherent=coherent)
        np.testing.assert_array_equal(received, loss.total_db)


def munk():
    """
    The deep sea's channel: from 300 m, at 25 km, rays reach no depth above 3.2 km; two of a fold
    end there.
    """
    z = np.arange(0.0, 5001.0, 25.0)
    eta = 2.0 * (z - 1300.0) / 1300.0
    return Medium.from_profile(
        z, 1500.0 * (1.0 + 0.00737 * (eta - 1.0 + np.exp(-eta))), bottom_depth=5000.0
    )


@pytest.fixture(scope="module")
def beside_the_fold():
    """Rays at depths from 4 to 1,400 m inside the edge of Munk's fold, which is at 3,239 m."""
    water, depth = munk(), 3239.0 + np.geomspace(4.0, 1400.0, 25)
    source = np.tile([0.0, 0.0, 300.0], (depth.size, 1))
    receiver = np.column_stack([np.full(depth.size, 25e3), np.zeros(depth.size), depth])
    arrivals = find_eigenrays(water, source, receiver, spreading_cutoff_db=None)
    return (
        water,
        source,
        receiver,
        arrivals,
        transmission_loss(water, source, receiver, arrivals, 200.0),
    )


def test_far_inside_a_fold_the_uniform_field_is_the_sum_of_both_rays(beside_the_fold):
    _, _, _, arrivals, loss = beside_the_fold
    waves = waves_of(arrivals, loss)
    pairs = fold_pairs(arrivals, 200.0, np.inf)
    early, late = (waves.at(rows) for rows in pairs.T)
    omega = 2.0 * np.pi * 200.0
    apart = omega * (late.time - early.time)
    fold = fold_between(early, late, 200.0)
    wave = fold.wave()
    uniform = np.exp(wave.log_size + 1j * (omega * wave.time + wave.phase))
    rays = sum(np.exp(w.log_size + 1j * (omega * w.time + w.phase)) for w in (early, late))
    scale = np.exp(early.log_size) + np.exp(late.log_size)
    error = np.abs(uniform - rays) / scale
    assert np.count_nonzero(apart > 5.0) > 5
    assert (error[apart > 5.0] < 0.25 / apart[apart > 5.0]).all()
    assert (
        np.ptp(np.abs(uniform[apart < 1.0])) < 0.3 * scale.max()
    )  # finite at the edge, where both rays grow


def test_the_field_continues_across_the_caustic(beside_the_fold):
    """
    Behind the edge the continued field has the ratios of Airy's function with the width that the
    rays inside have.
    """
    from scipy.special import airy

    water, source, receiver, arrivals, loss = beside_the_fold
    pairs = fold_pairs(arrivals, 200.0, 20.0)
    waves = waves_of(arrivals, loss)
    fold = fold_between(*(waves.at(rows) for rows in pairs.T), 200.0)
    slope, start = np.polyfit(receiver[arrivals.link[pairs[:, 0]], 2], fold.argument, 1)
    behind = -start / slope - np.array([0.3, 0.6, 0.9]) / slope
    ends = source[:3], np.column_stack([np.full(3, 25e3), np.zeros(3), behind])
    none = find_eigenrays(water, *ends, spreading_cutoff_db=None)
    assert not none.link.size
    tails = find_tails(water, *ends, none, 200.0)
    assert tails.link.tolist() == [0, 1, 2]
    ai = airy(np.array([0.3, 0.6, 0.9]))[0]
    np.testing.assert_allclose(np.diff(tails.waves.log_size), np.diff(np.log(ai)), rtol=0.1)
    inside = fold.wave().log_size[np.argmin(fold.argument)]
    assert inside > tails.waves.log_size[0] > inside - 1.0
    lit = find_tails(water, source, receiver, arrivals, 200.0)
    assert not lit.link.size


def test_without_links_there_are_no_tails():
    water, nothing = munk(), np.zeros((0, 3))
    arrivals = find_eigenrays(water, nothing, nothing)
    assert not find_tails(water, nothing, nothing, arrivals, 200.0).link.size


@pytest.mark.parametrize(
    ("message", "band", "coherent"),
    [
        ("coherent is 'yes'; allowed: true, false and 'auto'", (HZ, 200.0), "yes"),
        ("bandwidth_hz is 0 Hz; it must be finite and positive", (HZ, 0.0), "auto"),
        ("frequency_hz is -1 Hz; it must be finite and positive", (-1.0, 10.0), "auto"),
    ],
)
def test_bands_and_options_that_do_not_exist_are_refused(message, band, coherent):
    refused(AcousticsError, message, received_loss_db, *shallow(), *band, coherent=coherent)
