"""
Eigenrays under rough ice: against stationary paths in water of one speed, and against the general
solver under flat ice.
"""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays, trace_paths
from pymantaray.errors import AcousticsError, GeometryError
from pymantaray.geometry.roughness import Roughness

SPEED = 1450.0
DEPTH = np.array(
    [0, 10, 20, 30, 35, 40, 45, 50, 55, 60, 70, 80, 100, 120, 150, 200, 300, 600, 1000, 2700.0]
)
PROFILE = 1436.0 + 0.016 * DEPTH + 6.0 * np.exp(-(((DEPTH - 60.0) / 12.0) ** 2))
PROFILE += 18.0 * (1.0 - np.exp(-np.maximum(DEPTH - 100.0, 0.0) / 100.0))


def wave(x):
    return 2.0 + 0.15 * np.sin(2.0 * np.pi * x / 120.0)


def stationary_times(z_source, z_receiver, distance):
    """
    Times of the paths with one reflection at a wave: stationary in the place of the reflection
    (Fermat).
    """
    x = np.linspace(0.0, distance, 400_001)

    def time(x):
        z = wave(x)
        return (np.hypot(x, z - z_source) + np.hypot(distance - x, z - z_receiver)) / SPEED

    rate = np.gradient(time(x), x)
    rows = np.flatnonzero(rate[:-1] * rate[1:] < 0.0)
    times = []
    for row in rows:
        near = x[row - 2 : row + 4]
        fit = np.polynomial.Polynomial.fit(near, time(near), 2).deriv().roots()
        times.append(time(float(np.real(fit[0]))))
    return np.sort(times)


@pytest.mark.slow
def test_rays_with_one_reflection_at_a_wave_are_the_stationary_paths():
    north = np.arange(-50.0, 1550.0, 0.5)
    surface = BoundarySurface(wave(north)[:, None], north, roughness=Roughness(0.0, 20.0))
    medium = Medium.from_profile(
        [0.0, 500.0], [SPEED, SPEED], bottom_depth=500.0, ice_draft=surface, interpolation="linear"
    )
    arrivals = find_eigenrays(medium, [[0.0, 0.0, 40.0]], [[1500.0, 0.0, 60.0]], 1, 0, None)
    once = np.sort(arrivals.travel_time[arrivals.surface_bounces == 1])
    true = stationary_times(40.0, 60.0, 1500.0)
    assert true.size >= 3
    assert once.size == true.size
    np.testing.assert_allclose(once, true, atol=3e-7)
    assert arrivals.travel_time[arrivals.surface_bounces == 0] == pytest.approx(
        np.hypot(1500.0, 20.0) / SPEED
    )


@pytest.mark.parametrize(
    ("interpolation", "time", "slowness"), [("smooth", 5e-6, 2e-7), ("linear", 1e-7, 2e-9)]
)
def test_without_a_slope_the_arrivals_are_those_under_flat_ice(interpolation, time, slowness):
    flat = Medium.from_profile(
        DEPTH, PROFILE, bottom_depth=400.0, interpolation=interpolation, ice_draft=1.5
    )
    rough = replace(flat, surface=flat.surface.with_roughness(Roughness(0.0, 20.0)))
    source = np.array([[0.0, 0.0, 30.0], [0.0, 100.0, 90.0]])
    receiver = np.array([[2100.0, 300.0, 80.0], [1400.0, -900.0, 25.0]])
    known, arrivals = (find_eigenrays(m, source, receiver, 7, 1) for m in (flat, rough))
    assert known.link.size >= 8
    matched = 0
    for k in range(known.link.size):
        same = (arrivals.link == known.link[k]) & (
            arrivals.surface_bounces == known.surface_bounces[k]
        )
        same &= arrivals.bottom_bounces == known.bottom_bounces[k]
        apart = np.abs(arrivals.travel_time[same] - known.travel_time[k])
        if not apart.size or apart.min() > time:
            continue
        row = np.flatnonzero(same)[np.argmin(apart)]
        matched += 1
        np.testing.assert_allclose(
            arrivals.source_slowness[row], known.source_slowness[k], atol=slowness
        )
        np.testing.assert_allclose(
            arrivals.receiver_slowness[row], known.receiver_slowness[k], atol=slowness
        )
    assert matched >= 0.95 * known.link.size
    assert arrivals.link.size == pytest.approx(known.link.size, rel=0.05)


def test_both_directions_of_a_link_and_all_numbers_of_threads_agree():
    ice = BoundarySurface(1.5, roughness=Roughness(np.radians(0.5), 20.0))
    medium = Medium.from_profile(DEPTH, PROFILE, bottom_depth=2680.0, ice_draft=ice)
    a, b = (
        [[0.0, 100.0, 90.0], [500.0, 0.0, 20.0]],
        [[2400.0, -900.0, 90.0], [-1200.0, 700.0, 20.0]],
    )
    forth, back = find_eigenrays(medium, a, b, 4, 0), find_eigenrays(medium, b, a, 4, 0, threads=1)
    np.testing.assert_array_equal(forth.travel_time, back.travel_time)
    np.testing.assert_array_equal(forth.source_slowness, -back.receiver_slowness)
    flat = find_eigenrays(replace(medium, surface=medium.surface.with_roughness(None)), a, b, 4, 0)
    assert forth.link.size > flat.link.size
    refused(AcousticsError, "paths of rays under rough ice", trace_paths, medium, a, b, forth)


def test_a_draw_has_its_slope_and_its_correlation():
    rough = Roughness(np.radians(0.5), 20.0, draw=3)
    x = np.arange(0.0, 1700.0, 1.0)
    z = rough.elevation_at(x[:, None], x[None, ::7])
    assert z.std() == pytest.approx(rough.height, rel=0.05)
    assert np.gradient(z, 1.0, axis=0).std() == pytest.approx(np.tan(np.radians(0.5)), rel=0.05)
    assert (z[20:] * z[:-20]).mean() / z.var() == pytest.approx(np.exp(-1.0), abs=0.05)
    again = Roughness(np.radians(0.5), 20.0, draw=3).elevation_at(x, 0.0)
    np.testing.assert_array_equal(again, rough.elevation_at(x, 0.0))
    other = rough.with_draw(4).elevation_at(x, 0.0)
    assert abs(np.corrcoef(again, other)[0, 1]) < 0.3
    refused(GeometryError, "roughness: length is 0 m", Roughness, 0.01, 0.0)
    refused(GeometryError, "it must be below 0.5 rad", Roughness, 0.7, 10.0)


def test_the_general_solver_gets_the_rough_surface_on_a_grid():
    north = np.linspace(-500.0, 500.0, 5)
    speed = SPEED + 1e-3 * north[:, None, None] + np.zeros((5, 5, 3))
    ice = BoundarySurface(2.0, roughness=Roughness(np.radians(0.5), 60.0))
    medium = Medium.from_grid(
        north,
        north,
        [0.0, 100.0, 300.0],
        speed,
        bathymetry=300.0,
        interpolation="linear",
        ice_draft=ice,
    )
    a, b = [[-150.0, 0.0, 40.0]], [[150.0, 30.0, 60.0]]
    arrivals = find_eigenrays(medium, a, b, 1, 0)
    image = np.sqrt(300.0**2 + 30.0**2 + (40.0 + 60.0 - 2.0 * 2.0) ** 2) / SPEED
    once = arrivals.travel_time[arrivals.surface_bounces == 1]
    assert once.size > 0
    assert np.abs(once - image).max() < 4.0 * 2.0 * ice.roughness.height / SPEED
    assert once[0] != pytest.approx(image, abs=1e-7)
    far = replace(medium, surface=ice.with_roughness(Roughness(0.01, 0.5)))
    refused(
        AcousticsError,
        "use a smaller domain, a longer correlation length or a profile",
        find_eigenrays,
        far,
        a,
        b,
        1,
    )
