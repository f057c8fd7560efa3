"""
Rays under rough ice, on a plane and on a sphere, against a dense fan by the Runge-Kutta method in
polar coordinates, which shares no code with the solver.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays
from pymantaray.geometry import EarthSphere
from pymantaray.geometry.roughness import Roughness

LEVELS = np.concatenate([np.arange(0.0, 120.0, 0.25), np.arange(120.0, 401.0, 2.0)])
ICE = 3.0  # m
ROUGH = Roughness(math.radians(0.5), 40.0)
BED = 400.0
CUTOFF = 15.0
PLANET = 600e3  # m; a small one bends rays by more than the tolerance
TIME, ANGLE = 5e-8, 5e-5  # s, rad


def speed(z):
    return 1436.0 + 18.0 * (1.0 - np.exp(-z / 100.0))


def gradient(z):
    return 0.18 * np.exp(-z / 100.0)


def draft(distance):
    """Depth of the ice along north, by a spline of its own."""
    x = np.arange(-5.0, distance + 5.0, 0.2)
    return CubicSpline(x, ICE + ROUGH.elevation_at(x, 0.0))


class Eigenrays(NamedTuple):
    """Launch angle [rad], travel time [s], reflections and spreading [dB]."""

    angle: np.ndarray
    time: np.ndarray
    bounces: np.ndarray
    spreading: np.ndarray


class RoughFan:
    """
    Rays (depth, angle, time, reflections) by the distance along the surface of a sphere, whose
    radius may be infinite.
    """

    def __init__(self, radius, start, end, distance, step=1.0):
        self.radius, self.start, self.end, self.distance = radius, start, end, distance
        self.steps = np.linspace(0.0, distance, math.ceil(distance / step) + 1)
        self.draft = draft(distance)
        self.rise = self.draft.derivative()

    def rates(self, y):
        stretch = 1.0 - y[0] / self.radius
        c = speed(y[0])
        bend = -1.0 / self.radius - stretch * gradient(y[0]) / c
        return np.stack([stretch * np.tan(y[1]), bend, stretch / (c * np.cos(y[1]))])

    def advance(self, y, h):
        k1 = self.rates(y)
        k2 = self.rates(y + 0.5 * h * k1)
        k3 = self.rates(y + 0.5 * h * k2)
        k4 = self.rates(y + h * k3)
        return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def trace(self, angles):
        y = np.stack([np.full(angles.size, self.start), angles, np.zeros(angles.size)])
        bounces = np.zeros(angles.size, dtype=int)
        with np.errstate(all="ignore"):  # rays beyond the bed or steeper than vertical do not count
            for x, h in zip(self.steps[:-1], np.diff(self.steps), strict=True):
                new = self.advance(y, h)
                hit = np.flatnonzero(new[0] < self.draft(x + h))
                if hit.size:
                    new[:, hit] = self.reflected(y[:, hit], x, h)
                    bounces[hit] += 1
                y = new
                y[:, y[0] > BED] = np.nan
        return y, bounces

    def reflected(self, y, x, h):
        """Rays after a step in which they meet the surface."""
        part = np.full(y.shape[1], 0.5 * h)
        for _ in range(6):
            at = self.advance(y, part)
            rise = self.rise(x + part)
            part -= (at[0] - self.draft(x + part)) / (np.tan(at[1]) - rise)
            part = np.clip(part, 0.0, h)
        y = self.advance(y, part)
        y[1] = 2.0 * np.arctan(self.rise(x + part)) - y[1]
        return self.advance(y, h - part)

    def eigenrays(self, steepest, spacing):
        """Rays with at least one reflection within the cut-off."""
        angles = np.arange(-steepest, steepest, spacing)
        y, bounces = self.trace(angles)
        miss = y[0] - self.end
        same = (bounces[1:] == bounces[:-1]) & (bounces[1:] > 0)
        rows = np.flatnonzero(same & (miss[1:] * miss[:-1] <= 0.0))
        low, high = angles[rows], angles[rows + 1]
        first, last = miss[rows], miss[rows + 1]
        for i in range(14):  # regula falsi and bisection in turns
            share = 0.5 if i % 3 == 2 else first / (first - last)
            middle = low + share * (high - low)
            new = self.trace(middle)[0][0] - self.end
            left = (new > 0.0) == (first > 0.0)
            low, first = np.where(left, middle, low), np.where(left, new, first)
            high, last = np.where(left, high, middle), np.where(left, last, new)
        y, count = self.trace(middle)
        near = [self.trace(middle + d) for d in (1e-6, -1e-6)]
        rate = (near[0][0][0] - near[1][0][0]) / 2e-6
        chord = math.hypot(self.distance, self.end - self.start)
        tube = speed(self.start) / speed(self.end) * self.distance * np.abs(rate) * np.cos(y[1])
        spreading = 10.0 * np.log10(tube / np.cos(middle) / chord**2)
        good = (count == bounces[rows]) & (np.abs(y[0] - self.end) < 1e-4)
        good &= (near[0][1] == count) & (near[1][1] == count) & (spreading < CUTOFF)
        return Eigenrays(*(v[good] for v in (middle, y[2], count, spreading)))


def solved(radius, start, end, distance):
    """Rays of the solver with at least one reflection."""
    earth = None if math.isinf(radius) else EarthSphere(radius)
    # a fine grid of equal depths, so that the solver samples the roughness every half metre
    north = np.arange(-20.0, distance + 21.0)
    surface = BoundarySurface(np.full((north.size, 1), ICE), north, roughness=ROUGH)
    medium = Medium.from_profile(
        LEVELS, speed(LEVELS), bottom_depth=BED, ice_draft=surface, earth=earth
    )
    far = distance if earth is None else float(earth.frame_distance(distance))
    rays = find_eigenrays(medium, [[0.0, 0.0, start]], [[far, 0.0, end]], 4, 0, CUTOFF)
    rays = rays.at({"arrival": rays.surface_bounces > 0})
    return Eigenrays(rays.launch_angle, rays.travel_time, rays.surface_bounces, rays.spreading_db)


def found_in(rays, others):
    """True for each ray that the others have as well."""
    same = rays.bounces[:, None] == others.bounces
    same &= np.abs(rays.angle[:, None] - others.angle) < ANGLE
    same &= np.abs(rays.time[:, None] - others.time) < TIME
    return same.any(axis=1)


@pytest.mark.parametrize(
    ("radius", "start", "end", "distance"),
    [
        (math.inf, 40.0, 25.0, 900.0),
        (PLANET, 40.0, 25.0, 900.0),
        pytest.param(PLANET, 25.0, 20.0, 1500.0, marks=pytest.mark.slow),
    ],
)
def test_rays_under_rough_ice_are_those_of_a_dense_fan(radius, start, end, distance):
    rays = solved(radius, start, end, distance)
    fan = RoughFan(radius, start, end, distance).eigenrays(0.25, 5e-5)
    known, again = found_in(rays, fan), found_in(fan, rays)
    print(np.column_stack([*rays, known]), np.column_stack([*fan, again]), sep="\n")
    strong = rays.spreading < CUTOFF - 0.5
    assert rays.time.size >= 3
    assert known[strong].all()
    assert again[fan.spreading < CUTOFF - 0.5].all()
