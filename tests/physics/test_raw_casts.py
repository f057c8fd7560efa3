"""
Eigenrays of a noisy layered profile against `LayerFan`, a brute-force fan of circular arcs that
shares no code with the solver.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays

BOTTOM = 400.0  # m
DEPTH = np.arange(0.0, BOTTOM + 1.0, 2.0)
SPACING, SAME_TIME, CUTOFF, NEAR_CUTOFF = 2e-5, 1e-9, 15.0, 0.5  # rad, s, dB


def duct(noise):
    """A duct at 150 m with noise of 0.3 m/s in every level. [m/s]"""
    return 1450.0 - 6.0 * np.exp(-(((DEPTH - 150.0) / 60.0) ** 2)) + 0.016 * DEPTH + 0.3 * noise


def upward(noise):
    """Upward refraction with noise of 0.1 m/s in every level. [m/s]"""
    return 1440.0 + 0.06 * DEPTH + 0.1 * noise


class LayerFan:
    """
    Rays through layers with constant gradients, from layer to layer, all launch angles at a time.
    """

    def __init__(self, speed, source_depth, length, most_surface):
        self.speed, self.gradient = speed, np.diff(speed) / np.diff(DEPTH)
        self.source_depth, self.length, self.most_surface = source_depth, length, most_surface

    def trace(self, angle):
        """
        Depth and time at the end, and reflections at the surface; NaN if the bottom or too many
        reflections stop a ray.
        """
        n = angle.size
        z, sine, layer = (
            np.full(n, self.source_depth),
            np.sin(angle),
            np.full(n, int(self.source_depth // 2.0)),
        )
        parameter = np.cos(angle) / np.interp(self.source_depth, DEPTH, self.speed)
        r, time, bounces, end = np.zeros(n), np.zeros(n), np.zeros(n, dtype=int), np.full(n, np.nan)
        alive = np.arange(n)
        while alive.size:
            k, s, a = layer[alive], sine[alive], parameter[alive]
            g = self.gradient[k]
            down = s > 0.0
            turns = a * self.speed[k + down] >= 1.0
            out = down ^ turns  # the ray leaves through the lower face
            c_out = self.speed[k + out]
            s_out = np.sqrt(np.maximum((1.0 - a * c_out) * (1.0 + a * c_out), 0.0)) * np.where(
                out, 1.0, -1.0
            )
            step = np.minimum((s - s_out) / (a * g), self.length - r[alive])
            last = step >= self.length - r[alive]
            s_end = np.where(last, s - a * g * step, s_out)
            # the chord of an arc has the mean of the angles at its ends
            rise = step * np.tan(0.5 * (np.arcsin(s) + np.arcsin(s_end)))
            time[alive] += np.abs((np.arctanh(s) - np.arctanh(s_end)) / g)
            r[alive] += step
            z[alive] = np.where(last, z[alive] + rise, DEPTH[k + out])
            end[alive[last]] = z[alive[last]]
            layer[alive] = k + np.where(out, 1, -1)
            up = alive[~last & (layer[alive] < 0)]
            sine[alive] = s_end
            sine[up], layer[up] = -sine[up], 0
            bounces[up] += 1
            alive = alive[
                ~last & (layer[alive] < DEPTH.size - 1) & (bounces[alive] <= self.most_surface)
            ]
        return end, time, bounces

    def eigenrays(self, receiver_depth, steepest):
        """
        Bounces, time and spreading [dB] of each ray that ends at a depth: at changes of sign
        between neighbours, twice refined.
        """
        angle, width, wanted = np.arange(-steepest, steepest, SPACING), SPACING, None
        for _ in range(3):
            miss, time, bounces = self.trace(angle)
            miss -= receiver_depth
            same = (bounces[1:] == bounces[:-1]) & (np.diff(angle) < 1.5 * width)
            wanted = np.flatnonzero(same & (miss[1:] * miss[:-1] < 0.0))
            found = (
                angle[wanted],
                angle[wanted + 1],
                miss[wanted],
                miss[wanted + 1],
                time[wanted],
                time[wanted + 1],
            )
            count = bounces[wanted]
            width /= 20.0
            angle = (angle[wanted][:, None] + width * np.arange(21)).ravel()
        a, b, fa, fb, ta, tb = found
        share = fa / (fa - fb)
        launch, slope = a + share * (b - a), (fb - fa) / (b - a)
        cosine = np.cos(launch)
        c0, c1 = np.interp([self.source_depth, receiver_depth], DEPTH, self.speed)
        sine_end = np.sqrt(1.0 - (cosine * c1 / c0) ** 2)
        distance = np.hypot(self.length, receiver_depth - self.source_depth)
        tube = (
            np.abs(slope)
            * self.length
            / cosine
            * np.sqrt(1.0 - sine_end**2)
            / distance**2
            * c0
            / c1
        )
        return count, ta + share * (tb - ta), 10.0 * np.log10(tube)


@pytest.mark.slow
@pytest.mark.parametrize(("water", "seed", "least"), [(duct, 1, 9), (upward, 2, 20)])
def test_no_ray_of_a_noisy_cast_is_missed_or_invented(water, seed, least):
    """In the duct is a ray 4e-5 rad beside the angle at which rays turn at a level."""
    speed = water(np.random.default_rng(seed).standard_normal(DEPTH.size))
    medium = Medium.from_profile(DEPTH, speed, bottom_depth=BOTTOM, interpolation="linear")
    agreed = 0
    for length, source, receiver in (
        (3000.0, 151.3, 83.1),
        (4000.0, 31.7, 15.9),
        (2000.0, 111.1, 105.7),
    ):
        arrivals = find_eigenrays(medium, [0.0, 0.0, source], [length, 0.0, receiver], 7, 0)
        count, time, spreading = LayerFan(speed, source, length, 7).eigenrays(receiver, 0.45)
        pairs = np.abs(arrivals.travel_time[:, None] - time) < SAME_TIME
        pairs &= arrivals.surface_bounces[:, None] == count
        assert pairs.any(axis=1).all()
        assert pairs.any(axis=0)[spreading < CUTOFF - NEAR_CUTOFF].all()
        agreed += pairs.sum()
    assert agreed >= least
