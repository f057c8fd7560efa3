"""
Laws along whole rays: Snell's invariant, Fermat's principle, and what a change of the ocean does to
travel time.
"""

import numpy as np
import pytest
from factories import ARCTIC_DEPTH, HIDDEN, arctic, front_links, make_front, ridged
from oracles import field_of
from scipy.interpolate import CubicHermiteSpline

from pymantaray.acoustics import (
    Medium,
    find_eigenrays,
    path_integrals,
    ray_picture,
    trace_paths,
    travel_time_sensitivity,
)
from pymantaray.acoustics.levels.loss import find_bounces
from pymantaray.records import RayAxis


@pytest.fixture(scope="module", params=["smooth", "linear"])
def duct(request):
    """
    Rays of an Arctic profile in random directions: arrivals, their paths and the profile as a
    function.
    """
    depth, speed = ARCTIC_DEPTH, arctic(ARCTIC_DEPTH)
    medium = Medium.from_profile(depth, speed, bottom_depth=3000.0, interpolation=request.param)
    rng = np.random.default_rng(9)
    n = 60
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(500.0, 9e3, n)
    source = np.column_stack([rng.uniform(-1e3, 1e3, (n, 2)), rng.uniform(5.0, 400.0, n)])
    step = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])
    receiver = np.column_stack([source[:, :2] + step, rng.uniform(5.0, 900.0, n)])
    arrivals = find_eigenrays(medium, source, receiver, tolerance=1e-5)
    paths = trace_paths(medium, source, receiver, arrivals, tolerance=1e-5)
    return medium, source, receiver, arrivals, paths, field_of(medium)


def test_a_ray_that_turns_back_on_a_slope_has_its_reflections():
    """
    Over a bed of 20 degrees rays launched at all angles leave a reflection backwards: they are
    followed in depth.
    """
    north, slope = np.array([0.0, 4000.0]), np.tan(np.radians(20.0))
    bed = (200.0 + slope * north)[:, None]
    medium = Medium.from_grid(north, [0.0], [0.0, 3e3], np.full((2, 1, 2), 1500.0), bathymetry=bed)
    rng = np.random.default_rng(0)
    ends = []
    for _ in range(2):
        n = rng.uniform(500.0, 3500.0, 80)
        ends.append(
            np.column_stack([n, 0.0 * n, rng.uniform(0.02, 0.95, n.size) * (200.0 + slope * n)])
        )
    arrivals = find_eigenrays(medium, *ends, 1, 1, None)
    paths = trace_paths(medium, *ends, arrivals)
    flat = np.abs(arrivals.launch_angle) < 1.0
    assert np.count_nonzero(flat & (arrivals.ray_axis == RayAxis.VERTICAL)) > 5
    for boundary, bounces in ((1, arrivals.surface_bounces), (2, arrivals.bottom_bounces)):
        met = np.bincount(paths.arrival, paths.boundary == boundary, minlength=bounces.size)
        np.testing.assert_array_equal(met, 2 * bounces)  # a node before and one after
    time = path_integrals(paths, lambda x: np.full(len(x), 1.0 / 1500.0))[:, 0]
    np.testing.assert_allclose(time, arrivals.travel_time, rtol=0, atol=1e-7)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_a_reflection_in_layers_has_two_nodes_and_a_loss(interpolation):
    medium = Medium.from_profile(
        [0.0, 100.0, 300.0, 1000.0],
        [1450.0, 1460.0, 1455.0, 1470.0],
        bottom_depth=1000.0,
        interpolation=interpolation,
    )
    ends = [0.0, 0.0, 50.0], [5000.0, 0.0, 200.0]
    arrivals = find_eigenrays(medium, *ends, 1, 1)
    paths = trace_paths(medium, *ends, arrivals)
    bounces = find_bounces(paths)
    picture = ray_picture(medium, *ends, max_surface_bounces=1, max_bottom_bounces=1)
    for code, expected, shown in (
        (1, arrivals.surface_bounces, picture.ray_surface_bounces),
        (2, arrivals.bottom_bounces, picture.ray_bottom_bounces),
    ):
        assert expected.sum() >= 2
        rows = bounces.arrival[bounces.boundary == code]
        np.testing.assert_array_equal(np.bincount(rows, minlength=expected.size), expected)
        np.testing.assert_array_equal(shown, expected)
    # Snell's law to a flat boundary
    horizontal = np.hypot(*arrivals.source_slowness[:, :2].T)
    met = np.cos(bounces.grazing_angle) / bounces.sound_speed
    np.testing.assert_allclose(met, horizontal[bounces.arrival], rtol=1e-9)


def test_no_steep_ray_steps_over_a_ridge():
    """
    A ridge up to 150 m, 200 m wide: followed in depth, rays of a leg that is one step went through
    it.
    """
    medium, rng = ridged(150.0, speed=1480.0), np.random.default_rng(1)
    n = 120
    source = np.column_stack([rng.uniform(-1500.0, 1500.0, (n, 2)), rng.uniform(1.0, 400.0, n)])
    receiver = np.tile(HIDDEN.position, (n, 1))
    arrivals = find_eigenrays(medium, source, receiver, 1, 1)
    paths = trace_paths(medium, source, receiver, arrivals)
    same = np.diff(paths.arrival) == 0
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    a, b = paths.position[:-1][same], paths.position[1:][same]
    points = (a + share * (b - a)).reshape(-1, 3)
    assert arrivals.link.size > n
    assert (medium.bottom_depth(points) - points[:, 2]).min() > -1e-3


def dense(paths, ray, n=2001):
    """
    Points of one ray at equal steps of travel time, by the cubic Hermite polynomials between its
    nodes.
    """
    own = paths.arrival == ray
    t, x, p = paths.travel_time[own], paths.position[own], paths.slowness[own]
    keep = np.concatenate([[True], np.diff(t) > 0.0])
    velocity = p / np.sum(p * p, axis=1, keepdims=True)
    return CubicHermiteSpline(t[keep], x[keep], velocity[keep])(np.linspace(t[0], t[-1], n))


def polygon_time(points, speed):
    """Travel time along a fine polygon: Simpson's rule of slowness on every segment."""
    a, b = points[:-1], points[1:]
    mean = (1.0 / speed(a) + 4.0 / speed(0.5 * (a + b)) + 1.0 / speed(b)) / 6.0
    return float(np.sum(np.linalg.norm(b - a, axis=1) * mean))


def bumps(rng, n, chord):
    """A smooth displacement that vanishes at the ends, across the chord, of 1 to 30 m."""
    t = np.linspace(0.0, 1.0, n)
    across = np.linalg.svd(chord[None])[2][1:]
    waves = np.sin(np.pi * np.arange(1, 6)[:, None] * t)
    weights = rng.normal(size=(2, 5)) * np.array([1.0, 1.0, 0.5, 0.3, 0.2])
    shape = (weights @ waves).T @ across
    return shape * rng.uniform(1.0, 30.0) / np.abs(shape).max()


def test_every_eigenray_is_stationary_and_the_earliest_a_minimum(duct):
    """
    Beyond a caustic a ray is a saddle: only the change of first order vanishes. The earliest of all
    is a minimum.
    """
    medium, source, receiver, arrivals, paths, speed = duct

    rng = np.random.default_rng(5)
    kinks = (
        1e-7 if medium.interpolation == "linear" else 0.0
    )  # the polygon cuts the corners of c(z)
    # the earliest of every ray that there is, where none is lost to the surface
    everything = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None)
    earliest = everything.first().travel_time[arrivals.link]
    minima = 0
    for ray in range(0, len(arrivals.link), 3):
        points = dense(paths, ray)
        own = polygon_time(points, speed)
        chord = points[-1] - points[0]
        shape = bumps(rng, len(points), chord)
        shape /= np.abs(shape).max()
        first = (
            np.diff([polygon_time(points + scale * shape, speed) for scale in (-0.1, 0.1)])[0] / 0.2
        )
        assert abs(first) < 5e-8 + 10 * kinks, (
            ray,
            first,
        )  # s per metre; a ray out of place has up to 1e-4
        if abs(arrivals.travel_time[ray] - earliest[ray]) < 1e-9 and points[:, 2].min() > 60.0:
            minima += 1
            for _ in range(5):
                shift = bumps(rng, len(points), chord)
                assert polygon_time(points + shift, speed) > own - 2e-9 - kinks, ray
    assert minima >= 3


SHAPES = {
    "depth gaussians": lambda x: np.exp(
        -(
            (
                (x[:, 2:] - np.array([40.0, 130.0, 400.0, 900.0]))
                / np.array([30.0, 60.0, 150.0, 300.0])
            )
            ** 2
        )
    ),
    "horizontal slope": lambda x: np.column_stack([(x[:, 0] - 19e3) / 1e4, (x[:, 1] - 15e3) / 1e4]),
    "eddy": lambda x: np.exp(
        -((x[:, :1] - 18e3) ** 2 + (x[:, 1:2] - 15e3) ** 2) / 5e3**2
        - ((x[:, 2:] - 200.0) / 150.0) ** 2
    ),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_sensitivity_is_the_derivative_of_travel_time_by_sound_speed(name, interpolation):
    """-integral of phi / c^2 ds against central differences of the solver in a perturbed ocean.

    The shape is what the medium interpolates between its grid points, as the perturbation is.
    """
    base = make_front(interpolation)
    source, receiver = front_links(14, 31)
    source[:, 2] += 7.0
    receiver[:, 2] += 11.0
    arrivals = find_eigenrays(base, source, receiver, tolerance=1e-5)
    paths = trace_paths(base, source, receiver, arrivals, tolerance=1e-5)
    n, e, z = np.meshgrid(base.north, base.east, base.depth, indexing="ij")
    grid = np.column_stack([n.ravel(), e.ravel(), z.ravel()])
    shapes = SHAPES[name](grid).reshape(*n.shape, -1)
    interpolate = field_of(base, shapes)
    sensitivity = travel_time_sensitivity(paths, interpolate)
    amplitude = 0.02 if interpolation == "smooth" else 0.005  # m/s
    strong = np.flatnonzero(arrivals.spreading_db < 6.0)
    for k in range(shapes.shape[-1]):
        times = []
        for sign in (1.0, -1.0):
            moved = Medium.from_grid(
                base.north,
                base.east,
                base.depth,
                base.sound_speed + sign * amplitude * shapes[..., k],
                bathymetry=base.bed,
                interpolation=interpolation,
            )
            found = find_eigenrays(moved, source, receiver, tolerance=1e-5)
            times.append([nearest(found, arrivals, row) for row in strong])
        slope = (np.array(times[0]) - np.array(times[1])) / (2.0 * amplitude)
        error = np.abs(slope - sensitivity[strong, k])
        assert np.isfinite(error).mean() > 0.9
        scale = np.abs(sensitivity[:, k]).max()
        assert scale > 1e-5  # s per m/s: 1 cm/s over 10 km is 50 us
        assert np.nanmedian(error) < 1e-4 * scale, (np.nanmedian(error), scale)
        assert np.nanpercentile(error, 90) < 1e-2 * scale, (np.nanpercentile(error, 90), scale)


def nearest(found, arrivals, row):
    """
    Travel time of the arrival of the perturbed ocean that leaves most nearly as one of the
    unperturbed; NaN if none.
    """
    same = found.link == arrivals.link[row]
    gap = np.linalg.norm(found.source_slowness[same] - arrivals.source_slowness[row], axis=1)
    if not gap.size or gap.min() > 3e-6:  # 4 mrad
        return np.nan
    return found.travel_time[same][np.argmin(gap)]
