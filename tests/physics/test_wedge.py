"""
Uniform water between a flat surface, or plane ice, and a plane sea bed: every bounced ray is the
straight line to an image.

The source is mirrored in the planes that a ray meets, in turn and in three dimensions; the ray
exists where each place of reflection lies on the wet part of its plane. A slope of zero is the wave
guide.
"""

from typing import NamedTuple

import numpy as np
import pytest
from factories import QUICK
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays

Array = NDArray[np.float64]
C = 1500.0
# s; for the ray and for each reflection, which takes place within a micrometre of the boundary
ATOL_TIME = 1e-9
ATOL_ANGLE = 2e-6  # of slowness times sound speed
# m; a receiver on a boundary is met this far inside, which turns the ray and not its travel time
INSET = 1e-3
ATOL_SPREADING = 0.01  # dB
# m; a corner this near to an end, to the beach or to the edge of the grid may be there or not
DOUBT = 2e-3


class Bed(NamedTuple):
    """
    A plane: its depth where north = east = 0, and how much it deepens per metre north and east.
    """

    depth: float
    north: float = 0.0
    east: float = 0.0

    def at(self, place):
        """Depth under places (..., 2 or 3). [m]"""
        return self.depth + self.north * place[..., 0] + self.east * place[..., 1]


class Ray(NamedTuple):
    """A straight line to an image, folded back into the water."""

    surface: int
    bottom: int
    travel_time: float
    source_slowness: Array
    receiver_slowness: Array
    spreading_db: float
    doubtful: bool


def alternating(max_surface, max_bottom):
    """Orders of reflection: straight lines between two planes meet them in turn."""
    yield ""
    for first, second in ("sb", "bs"):
        for n in range(1, max_surface + max_bottom + 1):
            family = (first + second) * n
            family = family[:n]
            if family.count("s") <= max_surface and family.count("b") <= max_bottom:
                yield family


def unbounded(_):
    """Distance of any place from the edge of a medium without one. [m]"""
    return np.inf


SURFACE = Bed(0.0)


def images(source, receiver, bed, most, inside=unbounded, top=SURFACE):
    """
    All rays up to a number of reflections; inside gives the distance of a position from the edge
    of the grid.
    """
    planes = {
        letter: (
            np.array([0.0, 0.0, plane.depth]),
            np.array([plane.north, plane.east, -1.0])
            / np.sqrt(1.0 + plane.north**2 + plane.east**2),
        )
        for letter, plane in (("s", top), ("b", bed))
    }
    distance = np.linalg.norm(receiver - source)
    for family in alternating(*most):
        mirrored = [source]
        for letter in family:
            at, n = planes[letter]
            mirrored.append(mirrored[-1] - 2.0 * ((mirrored[-1] - at) @ n) * n)
        # from the receiver back: each leg points to the image of the planes that are left
        corners = [receiver]
        exists, doubtful = True, False
        for letter, image in zip(reversed(family), reversed(mirrored[1:]), strict=True):
            at, n = planes[letter]
            here = corners[-1]
            fall, height = (image - here) @ n, (at - here) @ n
            if abs(height) < 1e-9 or fall * height <= 0.0 or abs(height) > abs(fall):
                exists = False  # on the plane already, or it does not lie on the way
                break
            corner = here + (height / fall) * (image - here)
            wet = bed.at(corner) - corner[2] if letter == "s" else corner[2] - top.at(corner)
            room = min(wet, inside(corner))
            doubtful |= min(abs(room), np.linalg.norm(corner - here)) < DOUBT
            exists &= room > 0.0
            corners.append(corner)
        if not exists or (family and np.linalg.norm(corners[-1] - source) < 1e-9):
            continue
        corners.append(source)
        corners.reverse()
        doubtful |= bool(family) and np.linalg.norm(corners[1] - source) < DOUBT
        length = np.linalg.norm(receiver - mirrored[-1])
        legs = [
            (b - a) / np.linalg.norm(b - a) / C for a, b in ((corners[0], corners[1]), corners[-2:])
        ]
        spreading = 20.0 * np.log10(length / distance)
        yield Ray(
            family.count("s"), family.count("b"), length / C, *legs, spreading, bool(doubtful)
        )


def differences(arrivals, link, expected, atol_angle=ATOL_ANGLE):
    """
    What the arrivals of one link lack, have in excess, or have wrong; an empty list where they
    agree.
    """
    left = list(np.flatnonzero(arrivals.link == link))
    wrong = []
    for ray in sorted(expected, key=lambda ray: ray.doubtful):
        slowness = arrivals.source_slowness[left] - ray.source_slowness
        gap = np.abs(arrivals.travel_time[left] - ray.travel_time) + np.linalg.norm(
            slowness, axis=1
        )
        same = (arrivals.surface_bounces[left] == ray.surface) & (
            arrivals.bottom_bounces[left] == ray.bottom
        )
        same &= gap < 1e-4
        if not same.any():
            if not ray.doubtful:
                wrong.append(("missed", ray))
            continue
        i = left.pop(int(np.argmin(np.where(same, gap, np.inf))))
        errors = {
            "travel time": (
                arrivals.travel_time[i] - ray.travel_time,
                ATOL_TIME * (1 + ray.surface + ray.bottom),
            ),
            "source slowness": (
                C * np.linalg.norm(arrivals.source_slowness[i] - ray.source_slowness),
                atol_angle,
            ),
            "receiver slowness": (
                C * np.linalg.norm(arrivals.receiver_slowness[i] - ray.receiver_slowness),
                atol_angle,
            ),
            "launch angle": (
                np.sin(arrivals.launch_angle[i]) - C * ray.source_slowness[2],
                atol_angle,
            ),
            "arrival angle": (
                np.sin(arrivals.arrival_angle[i]) - C * ray.receiver_slowness[2],
                atol_angle,
            ),
            "spreading": (arrivals.spreading_db[i] - ray.spreading_db, ATOL_SPREADING),
        }
        wrong += [
            (what, error, ray) for what, (error, bar) in errors.items() if not abs(error) <= bar
        ]
    wrong += [
        (
            "invented",
            int(arrivals.surface_bounces[i]),
            int(arrivals.bottom_bounces[i]),
            arrivals.travel_time[i],
            arrivals.launch_angle[i],
            arrivals.spreading_db[i],
        )
        for i in left
    ]
    return wrong


def check(medium, bed, source, receiver, most, inside=unbounded, top=SURFACE, **options):
    """All links of a medium against the images; returns the number of rays that agree."""
    arrivals = find_eigenrays(medium, source, receiver, *most, spreading_cutoff_db=None, **options)
    wrong, rays = [], 0
    for link, ends in enumerate(zip(source, receiver, strict=True)):
        expected = list(images(*ends, bed, most, inside, top))
        rays += len(expected)
        atol = ATOL_ANGLE
        if any(min(end[2] - top.at(end), bed.at(end) - end[2]) < INSET for end in ends):
            atol += 1.5 * INSET / np.linalg.norm(np.subtract(*ends))
        found = differences(arrivals, link, expected, atol)
        wrong += [(*(end.tolist() for end in ends), *what) for what in found]
    assert not wrong, f"{len(wrong)} of {rays} rays, bed {bed}:\n" + "\n".join(map(str, wrong[:20]))
    chord = np.linalg.norm(receiver - source, axis=1) / C
    np.testing.assert_allclose(arrivals.chord_travel_time, chord, rtol=1e-13)
    return rays


def guide(depth, interpolation, ice):
    """Uniform water of a depth under ice over a flat bed, with a level inside."""
    levels = [0.0, 0.4 * depth + ice, 1.2 * depth + ice]
    return Medium.from_profile(
        levels, [C] * 3, bottom_depth=depth + ice, ice_draft=ice, interpolation=interpolation
    )


def guide_links(depth, rng):
    """
    From vertical to 50 km; level, near and on the boundaries; and rays at the seam of 60 degrees
    between two fans.
    """
    near = [0.01, 0.5, depth - 0.5, depth - 0.01]
    pairs = []
    for distance in (0.0, 0.1, 3.0, 0.5 * depth, 3.0 * depth, 5e3, 5e4, -1.0, -1.0):
        for kind in range(7):
            z0, z1 = rng.uniform(0.0, depth, 2)
            if kind == 1:
                z1 = z0
            elif kind == 2:
                z0, z1 = rng.choice([0.0, depth], 2)
            elif kind == 3:
                z0 = rng.choice([0.0, depth])
            elif kind == 4:
                z1 = rng.choice([0.0, depth])
            elif kind == 5:
                z0, z1 = rng.choice(near, 2)
            elif kind == 6:
                z0, z1 = rng.choice([0.0, 0.4 * depth, depth], 2)
            if (
                distance < 0.0
            ):  # so steep that a ray of a few reflections is 50 to 70 degrees from the horizontal
                climb = depth * rng.integers(1, 6) + rng.choice([-1.0, 1.0]) * z0 + z1
                distance = max(climb, 1.0) / np.tan(rng.uniform(0.9, 1.2))
            bearing = rng.choice([0.0, np.pi, rng.uniform(0.0, 2.0 * np.pi)])
            start = np.array([*rng.uniform(-1e3, 1e3, 2), z0])
            end = start + distance * np.array([np.cos(bearing), np.sin(bearing), 0.0])
            end[2] = z1
            if not np.array_equal(start, end):
                pairs.append((start, end))
    source, receiver = (np.array(ends) for ends in zip(*pairs, strict=True))
    return source, receiver


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@settings(QUICK, max_examples=2)
@given(
    depth=st.sampled_from([30.0, 200.0, 1000.0, 4000.0]),
    seed=st.integers(0, 2**32 - 1),
    canonical=st.booleans(),
    ice=st.sampled_from([0.0, 12.0]),
)
def test_wave_guide_has_every_image_and_no_other_ray(interpolation, depth, seed, canonical, ice):
    """All families with up to three reflections at each boundary, one by one."""
    ends = [
        end + np.array([0.0, 0.0, ice]) for end in guide_links(depth, np.random.default_rng(seed))
    ]
    medium, bed, top = guide(depth, interpolation, ice), Bed(depth + ice), Bed(ice)
    assert check(medium, bed, *ends, (0, 0), top=top, canonical=canonical) == len(ends[0])
    assert check(medium, bed, *ends, (3, 3), top=top, canonical=canonical) > 8 * len(ends[0])


def wedge(bed, side=10e3, inner=(), interpolation="linear"):
    """
    Uniform water over a plane bed, on a square grid about the origin with the given lines inside.
    """
    axis = np.sort(np.array([-side, side, *inner]))
    north, east = np.meshgrid(axis, axis, indexing="ij")
    bathymetry = bed.at(np.stack([north, east], axis=-1))
    lowest = bathymetry.max() + 10.0
    levels = [0.0, 0.3 * lowest, lowest]
    speed = np.full((axis.size, axis.size, 3), C)
    medium = Medium.from_grid(
        axis, axis, levels, speed, bathymetry=bathymetry, interpolation=interpolation
    )
    return medium, lambda place: side - np.max(np.abs(place[:2]))


def sloping(depth, slope_deg, azimuth):
    """A bed that deepens towards an azimuth."""
    slope = np.tan(np.radians(slope_deg))
    return Bed(depth, slope * np.cos(azimuth), slope * np.sin(azimuth))


def wedge_links(bed, n, rng, bearings, side=10e3):
    """Pairs 3 m to 8 km apart in at least 20 m of water."""
    pairs = []
    while len(pairs) < n:
        place = rng.uniform(-0.7 * side, 0.7 * side, 2)
        bearing = rng.choice(bearings) if len(bearings) else rng.uniform(0.0, 2.0 * np.pi)
        other = place + 10.0 ** rng.uniform(0.5, 3.9) * np.array([np.cos(bearing), np.sin(bearing)])
        depths = bed.at(np.array([place, other]))
        if np.abs(other).max() < side and depths.min() > 20.0:
            z = depths * rng.uniform(0.02, 0.98, 2)
            pairs.append((np.array([*place, z[0]]), np.array([*other, z[1]])))
    source, receiver = (np.array(ends) for ends in zip(*pairs, strict=True))
    return source, receiver


DIRECTIONS = {"up": [np.pi], "down": [0.0], "across": [0.5 * np.pi, -0.5 * np.pi], "oblique": []}


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize(
    "slope_deg",
    [5.0, *(pytest.param(slope, marks=pytest.mark.slow) for slope in (0.5, 2.0, 10.0, 20.0))],
)
def test_wedge_has_every_image_in_the_plane_and_across_it(slope_deg, direction):
    """Up to two reflections at each boundary, those that turn the ray back among them."""
    rng = np.random.default_rng(31)
    for depth in (200.0, 1000.0, 3000.0):
        azimuth = rng.choice([0.0, 0.5 * np.pi, rng.uniform(0.0, 2.0 * np.pi)])
        bed = sloping(depth, slope_deg, azimuth)
        medium, inside = wedge(bed)
        bearings = [azimuth + turn for turn in DIRECTIONS[direction]]
        source, receiver = wedge_links(bed, 10, rng, bearings)
        assert check(medium, bed, source, receiver, (2, 2), inside) > 80


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@settings(QUICK, max_examples=3)
@given(
    depth=st.floats(100.0, 4000.0),
    slope_deg=st.floats(0.0, 4.0),
    azimuth=st.floats(0.0, 6.3),
    seed=st.integers(0, 2**32 - 1),
)
def test_cells_of_a_plane_do_not_matter(interpolation, depth, slope_deg, azimuth, seed):
    """The same plane on a grid of unequal lines, both interpolations."""
    rng = np.random.default_rng(seed)
    bed = sloping(depth, slope_deg, azimuth)
    medium, inside = wedge(bed, inner=rng.uniform(-8e3, 8e3, 4), interpolation=interpolation)
    check(medium, bed, *wedge_links(bed, 10, rng, []), (2, 2), inside)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@pytest.mark.parametrize("slope", [(0.02, 0.0), (0.0, -0.03), (0.03, 0.02)])
def test_sloping_ice_reflects_like_a_mirror(interpolation, slope):
    axis, rng, top = np.linspace(-4e3, 4e3, 9), np.random.default_rng(2), Bed(210.0, *slope)
    draft = top.at(np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1))
    c, bed = np.full((9, 9, 2), C), np.full((9, 9), 900.0)
    medium = Medium.from_grid(
        axis, axis, [0.0, 1e3], c, bathymetry=bed, ice_draft=draft, interpolation=interpolation
    )
    ends = rng.uniform([-2e3, -2e3, 320.0], [2e3, 2e3, 560.0], (2, 20, 3))
    assert check(medium, Bed(900.0), *ends, (1, 1), top=top) > 60
