"""Transmission loss: the image method's amplitudes, circular arcs, and what is off by default."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from pymantaray.acoustics import (
    Absorption,
    FluidBottom,
    Medium,
    SeaSurface,
    find_eigenrays,
    transmission_loss,
)
from pymantaray.acoustics.absorption import francois_garrison_db_per_km
from pymantaray.acoustics.loss import find_bounces, geometric_loss_db, reflection_coefficient
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, RayPaths

C, DEPTH, FREQUENCY = 1500.0, 200.0, 12e3
SOURCE, RECEIVER = np.array([100.0, -50.0, 60.0]), np.array([-500.0, 750.0, 140.0])  # 1000 m apart
RANGE, DISTANCE = 1000.0, float(np.hypot(1000.0, 80.0))
WAVEGUIDE = Medium.from_profile([0.0, DEPTH], [C, C], bottom_depth=DEPTH)
LETTERS = {"s": (1, 0.0), "b": (2, DEPTH)}
FAMILIES = ["", "s", "b", "sb", "bs", "sbs", "bsb", "sbsb", "bsbs"]
ORDERS = [family.count("s") for family in FAMILIES], [family.count("b") for family in FAMILIES]


def path_of(family, source=SOURCE, receiver=RECEIVER):
    """Nodes of the polygon that meets the boundaries of a family in turn, unfolded into one straight line."""
    depths = [source[2], *(LETTERS[letter][1] for letter in family), receiver[2]]
    climb = np.abs(np.diff(depths))
    length = float(np.hypot(np.linalg.norm((receiver - source)[:2]), climb.sum()))
    share = np.concatenate([[0.0], np.cumsum(climb) / climb.sum()])
    corners = source + share[:, None] * (receiver - source)
    corners[:, 2] = depths
    legs = np.diff(corners, axis=0)
    slowness = legs / np.linalg.norm(legs, axis=1, keepdims=True) / C
    inner = np.repeat(np.arange(1, len(corners) - 1), 2)
    order = np.concatenate([[0], inner, [len(corners) - 1]])
    flags = np.repeat([LETTERS[letter][0] for letter in family], 2).astype(int)
    return {
        "position": corners[order],
        "slowness": np.repeat(slowness, 2, axis=0),
        "travel_time": share[order] * length / C,
        "boundary": np.concatenate([[0], flags, [0]]),
    }, length


def image_arrivals():
    """Arrivals and paths of one link by the families above."""
    made = [path_of(family) for family in FAMILIES]
    lengths = np.array([length for _, length in made])
    nodes = {name: np.concatenate([path[name] for path, _ in made]) for name in made[0][0]}
    counts = [len(path["boundary"]) for path, _ in made]
    paths = RayPaths(arrival=np.repeat(np.arange(len(made)), counts), **nodes)
    n = len(made)
    first, last = (np.array([path["slowness"][i] for path, _ in made]) for i in (0, -1))
    arrivals = Arrivals(
        link=np.zeros(n, int),
        travel_time=lengths / C,
        surface_bounces=ORDERS[0],
        bottom_bounces=ORDERS[1],
        turning_points=np.zeros(n, int),
        launch_angle=np.arcsin(first[:, 2] * C),
        arrival_angle=np.arcsin(last[:, 2] * C),
        spreading_db=20.0 * np.log10(lengths / DISTANCE),
        source_slowness=first,
        receiver_slowness=last,
        ray_axis=np.zeros(n, int),
        status=[0],
        chord_travel_time=[DISTANCE / C],
        source_sound_speed=[C],
        receiver_sound_speed=[C],
        shadow_margin=[0.0],
    )
    return arrivals, paths


def image_sources():
    """Length and bounces of every image of the source, by the classical series; shares nothing with `path_of`."""
    for m in range(-2, 3):
        for sign in (1, -1):
            depth = 2 * m * DEPTH + sign * SOURCE[2]
            surface, bottom = (abs(m), abs(m)) if sign == 1 else ((m - 1, m) if m > 0 else (1 - m, -m))
            yield float(np.hypot(RANGE, depth - RECEIVER[2])), surface, bottom


def test_lossless_waveguide_has_the_amplitudes_of_the_image_method():
    arrivals, paths = image_arrivals()
    loss = transmission_loss(WAVEGUIDE, SOURCE, RECEIVER, arrivals, FREQUENCY, paths=paths)
    omega = 2.0 * np.pi * FREQUENCY
    amplitude = 10.0 ** (-loss.total_db / 20.0) * np.exp(
        1j * (omega * arrivals.travel_time + loss.boundary_phase)
    )
    found = sorted(zip(arrivals.travel_time, arrivals.surface_bounces, amplitude, strict=True))
    images = sorted(
        (d / C, s, (-1.0) ** s / d * np.exp(1j * omega * d / C))
        for d, s, b in image_sources()
        if (s, b) in set(zip(*ORDERS, strict=True)) and s + b <= 4
    )
    assert len(found) == len(images) == len(FAMILIES)
    for (t, s, a), (t_image, s_image, a_image) in zip(found, images, strict=True):
        assert (t, s) == (pytest.approx(t_image, rel=1e-12), s_image)
        assert a == pytest.approx(a_image, abs=1e-10)


def test_solver_tracer_and_loss_together_are_the_image_method():
    """Every image with up to two reflections at each boundary, from the medium alone: delay, amplitude and phase."""
    bottom, surface = FluidBottom.standard("silt"), SeaSurface(7.0)
    arrivals = find_eigenrays(WAVEGUIDE, SOURCE, RECEIVER, 2, 2)
    loss = transmission_loss(WAVEGUIDE, SOURCE, RECEIVER, arrivals, FREQUENCY, bottom=bottom, surface=surface)
    found = sorted(
        zip(
            arrivals.surface_bounces,
            arrivals.bottom_bounces,
            arrivals.travel_time,
            loss.geometric_db,
            loss.surface_db,
            loss.bottom_db,
            loss.boundary_phase,
            strict=True,
        )
    )
    images = sorted((s, b, d) for d, s, b in image_sources() if s <= 2 and b <= 2)
    assert len(found) == len(images) == 9
    for row, (s, b, d) in zip(found, images, strict=True):
        angle = np.arccos(RANGE / d)
        r = reflection_coefficient(angle, bottom, sound_speed=C)
        per_surface = surface.loss_db(angle, FREQUENCY, sound_speed=C)
        expected = (20.0 * np.log10(d), s * per_surface, -20.0 * b * np.log10(np.abs(r)))
        assert row[:3] == (s, b, pytest.approx(d / C, abs=3e-9))
        assert row[3:6] == pytest.approx(expected, rel=1e-4, abs=1e-3)
        assert row[6] == pytest.approx(np.pi * s + b * np.angle(r), abs=1e-4)


def test_bounces_and_grazing_angles_are_those_of_the_unfolded_path():
    arrivals, paths = image_arrivals()
    found = find_bounces(paths)
    assert np.bincount(found.arrival, minlength=9).tolist() == [len(family) for family in FAMILIES]
    np.testing.assert_allclose(found.grazing_angle, np.abs(arrivals.launch_angle)[found.arrival], rtol=1e-12)
    np.testing.assert_allclose(found.sound_speed, C, rtol=1e-12)


def test_each_bounce_costs_its_reflection_coefficient():
    arrivals, paths = image_arrivals()
    bottom, surface = FluidBottom.standard("silt"), SeaSurface(7.0)
    loss = transmission_loss(
        WAVEGUIDE, SOURCE, RECEIVER, arrivals, FREQUENCY, bottom=bottom, surface=surface, paths=paths
    )
    angle = np.arccos(RANGE / (arrivals.travel_time * C))
    r = reflection_coefficient(angle, bottom, sound_speed=C)
    ns, nb = np.array(ORDERS)
    np.testing.assert_allclose(loss.bottom_db, -20.0 * nb * np.log10(np.abs(r)), rtol=1e-9)
    np.testing.assert_allclose(
        loss.surface_db, ns * surface.loss_db(angle, FREQUENCY, sound_speed=C), rtol=1e-9
    )
    np.testing.assert_allclose(loss.boundary_phase, np.pi * ns + nb * np.angle(r), atol=1e-9)
    np.testing.assert_allclose(
        loss.total_db, loss.geometric_db + loss.surface_db + loss.bottom_db, rtol=1e-14
    )


def test_sloping_sea_bed_is_met_at_the_angle_to_its_normal():
    slope, ray = np.radians(10.0), np.radians(25.0)  # the bed deepens northward, the ray goes north and down
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    before = np.array([np.cos(ray), 0.0, np.sin(ray)]) / C
    after = before - 2.0 * (before @ normal) * normal
    paths = RayPaths(
        arrival=[0] * 4,
        position=np.array([[0.0, 0, 0], [1, 0, 1], [1, 0, 1], [2, 0, 1]]),
        slowness=np.array([before, before, after, after]),
        travel_time=[0.0, 1.0, 1.0, 2.0],
        boundary=[0, 2, 2, 0],
    )
    assert find_bounces(paths).grazing_angle[0] == pytest.approx(ray - slope, rel=1e-12)


def test_absorption_follows_the_profile_along_every_path():
    arrivals, paths = image_arrivals()
    profile = [0.0, DEPTH], [12.0, 4.0], [33.0, 34.7]
    loss = transmission_loss(
        WAVEGUIDE,
        SOURCE,
        RECEIVER,
        arrivals,
        FREQUENCY,
        absorption=Absorption.from_profile(*profile),
        paths=paths,
    )

    def alpha(z):
        t, s = np.interp(z, profile[0], profile[1]), np.interp(z, profile[0], profile[2])
        return float(francois_garrison_db_per_km(FREQUENCY, temperature=t, salinity=s, depth=z)) / 1000.0

    def between(a, b):
        return quad(alpha, min(a, b), max(a, b), epsabs=1e-10)[0]

    for i, family in enumerate(FAMILIES):
        depths = [SOURCE[2], *(LETTERS[letter][1] for letter in family), RECEIVER[2]]
        vertical = sum(between(a, b) for a, b in pairwise(depths))
        expected = vertical / abs(np.sin(arrivals.launch_angle[i]))
        assert loss.absorption_db[i] == pytest.approx(expected, rel=1e-6), family


def test_constant_absorption_is_proportional_to_path_length():
    arrivals, paths = image_arrivals()
    loss = transmission_loss(
        WAVEGUIDE, SOURCE, RECEIVER, arrivals, FREQUENCY, absorption=Absorption.constant(3.0), paths=paths
    )
    np.testing.assert_allclose(loss.absorption_db, 3e-3 * C * arrivals.travel_time, rtol=1e-12)


def test_solver_and_tracer_give_spherical_spreading_and_absorption_in_uniform_water():
    source = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, 10.0], [20.0, 30.0, 100.0]])
    receiver = np.array([[3000.0, 0.0, 150.0], [0.0, 7000.0, 190.0], [20.0, 30.0, 120.0]])
    distance = np.linalg.norm(receiver - source, axis=1)
    arrivals = find_eigenrays(WAVEGUIDE, source, receiver)
    loss = transmission_loss(
        WAVEGUIDE, source, receiver, arrivals, FREQUENCY, absorption=Absorption.constant(1.2)
    )
    np.testing.assert_allclose(loss.geometric_db, 20.0 * np.log10(distance), atol=1e-4)
    np.testing.assert_allclose(loss.absorption_db, 1.2e-3 * distance, rtol=1e-6)
    np.testing.assert_allclose(loss.total_db, loss.geometric_db + loss.absorption_db, rtol=1e-12)
    assert not np.any(loss.boundary_phase)
    np.testing.assert_array_equal(loss.link, arrivals.link)


def arc_of_constant_gradient(source, receiver, surface_speed, gradient):
    """Radius and angles of the circle through two positions of a linear profile; its centre is where c = 0."""
    r, level = np.linalg.norm((receiver - source)[:2]), -surface_speed / gradient
    z0, z1 = source[2] - level, receiver[2] - level
    x = (r**2 + z1**2 - z0**2) / (2.0 * r)
    return np.hypot(x, z0), np.arctan2(z0, -x), np.arctan2(z1, r - x), level


def test_absorption_along_a_circular_arc():
    medium = Medium.from_profile([0.0, 3000.0], [1450.0, 1495.0], bottom_depth=3000.0)
    source, receiver = np.array([0.0, 0.0, 800.0]), np.array([6000.0, 5000.0, 500.0])
    radius, t0, t1, level = arc_of_constant_gradient(source, receiver, 1450.0, 0.015)
    profile = [0.0, 3000.0], [4.0, -1.0], [32.0, 35.0]

    def alpha(angle):
        z = level + radius * np.sin(angle)
        return float(
            francois_garrison_db_per_km(
                25e3, temperature=4.0 - 5.0 * z / 3000.0, salinity=32.0 + 3.0 * z / 3000.0, depth=z
            )
        )

    expected = quad(alpha, min(t0, t1), max(t0, t1), epsabs=0.0, epsrel=1e-10)[0] * radius / 1000.0
    arrivals = find_eigenrays(medium, source, receiver)
    loss = transmission_loss(
        medium, source, receiver, arrivals, 25e3, absorption=Absorption.from_profile(*profile)
    )
    assert loss.absorption_db.size == 1
    assert loss.absorption_db[0] == pytest.approx(expected, rel=1e-5)


def test_spreading_in_a_constant_gradient_is_the_closed_form():
    # the metric ds/c is that of hyperbolic space of curvature -g^2: dA/dOmega = c_r^2 sinh^2(g t) / g^2
    g, c0 = 0.015, 1450.0
    medium = Medium.from_profile([0.0, 3000.0], [c0, c0 + 3000.0 * g], bottom_depth=3000.0)
    source, receiver = np.array([0.0, 0.0, 800.0]), np.array([6000.0, 5000.0, 500.0])
    c_s, c_r = c0 + g * source[2], c0 + g * receiver[2]
    arrivals = find_eigenrays(medium, source, receiver)
    expected = 20.0 * np.log10(np.sqrt(c_s * c_r) * np.sinh(g * arrivals.travel_time) / g)
    np.testing.assert_allclose(geometric_loss_db(source, receiver, arrivals), expected, atol=1e-4)


def test_loss_is_reciprocal():
    rng = np.random.default_rng(3)
    z = np.array([0.0, 30.0, 80.0, 200.0, 1000.0])
    medium = Medium.from_profile(z, [1480.0, 1478.0, 1462.0, 1466.0, 1478.0], bottom_depth=1000.0)
    water = Absorption.from_profile(z, [8.0, 7.5, 2.0, 3.0, 2.0], [33.0, 33.0, 34.0, 34.8, 34.9])
    a = rng.uniform([0, 0, 5], [10.0, 10.0, 900.0], (12, 3))
    b = rng.uniform([2e3, 2e3, 5], [5e3, 5e3, 900.0], (12, 3))
    arrivals = [find_eigenrays(medium, *ends, canonical=False) for ends in ((a, b), (b, a))]
    there, back = (
        transmission_loss(medium, *ends, rays, 15e3, absorption=water)
        for ends, rays in zip(((a, b), (b, a)), arrivals, strict=True)
    )
    same = (arrivals[0].link[:, None] == arrivals[1].link) & (
        np.abs(arrivals[0].travel_time[:, None] - arrivals[1].travel_time) < 1e-6
    )
    i, j = np.nonzero(same)
    assert i.size > 8
    np.testing.assert_allclose(there.absorption_db[i], back.absorption_db[j], rtol=1e-4)
    np.testing.assert_allclose(there.total_db[i], back.total_db[j], atol=0.02)


def test_ocean_data_set_serves_medium_and_absorption_alike():
    from pymantaray.ocean import open_ocean

    ocean = open_ocean("synthetic:beaufort").isel(lat=slice(30, 46), lon=slice(100, 140))
    medium = Medium.from_dataset(ocean)
    source, receiver = np.array([0.0, 0.0, 20.0]), np.array([3000.0, 1000.0, 300.0])
    arrivals = find_eigenrays(medium, source, receiver)
    loss = transmission_loss(
        medium, source, receiver, arrivals, 10e3, absorption=Absorption.from_dataset(ocean)
    )
    column = ocean.sel(depth=slice(20.0, 300.0))
    middle = {"lat": ocean["lat"].size // 2, "lon": ocean["lon"].size // 2}
    alpha = francois_garrison_db_per_km(
        10e3,
        temperature=column["water_temp"].isel(middle).values,
        salinity=column["salinity"].isel(middle).values,
        depth=column["depth"].values,
    )
    distance = np.linalg.norm(receiver - source) / 1000.0
    assert alpha.min() * distance < loss.absorption_db[0] < alpha.max() * distance


def test_nothing_is_lost_by_default_and_paths_are_not_needed():
    arrivals, _ = image_arrivals()
    loss = transmission_loss(WAVEGUIDE, SOURCE, RECEIVER, arrivals, FREQUENCY)
    for name in ("absorption_db", "surface_db", "bottom_db"):
        assert not np.any(getattr(loss, name))
    np.testing.assert_allclose(loss.total_db, 20.0 * np.log10(arrivals.travel_time * C), rtol=1e-12)
    np.testing.assert_allclose(loss.boundary_phase, np.pi * np.array(ORDERS[0]), rtol=1e-14)


def test_equal_positions_lose_nothing_and_links_without_arrivals_are_no_rows():
    source = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, 50.0]])
    receiver = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, 500.0]])  # the second lies under the sea bed
    arrivals = find_eigenrays(WAVEGUIDE, source, receiver)
    loss = transmission_loss(
        WAVEGUIDE, source, receiver, arrivals, FREQUENCY, absorption=Absorption.constant(1.0)
    )
    assert loss.total_db.tolist() == [-np.inf]
    none = find_eigenrays(WAVEGUIDE, source[1:], receiver[1:])
    empty = transmission_loss(
        WAVEGUIDE, source[1:], receiver[1:], none, FREQUENCY, absorption=Absorption.constant(1.0)
    )
    assert empty.total_db.size == 0


def test_bad_input_is_refused():
    arrivals, paths = image_arrivals()
    link = (WAVEGUIDE, SOURCE, RECEIVER)
    with pytest.raises(AcousticsError, match="frequency_hz: 0; must be positive"):
        transmission_loss(*link, arrivals, 0.0)
    with pytest.raises(AcousticsError, match=r"arrivals of 1 links need \(1, 3\)"):
        transmission_loss(WAVEGUIDE, np.zeros((2, 3)), np.ones((2, 3)), arrivals, 1e3)
    one = {name: getattr(paths, name)[:2] for name in ("arrival", "position", "slowness", "travel_time")}
    direct_only = RayPaths(boundary=[0, 0], **one)
    with pytest.raises(AcousticsError, match="disagree on the bounces of 7 arrivals, first 1"):
        transmission_loss(*link, arrivals, 1e3, surface=SeaSurface(5.0), paths=direct_only)
    with pytest.raises(AcousticsError, match="two successive nodes"):
        find_bounces(RayPaths(boundary=[0, 1], **one))
