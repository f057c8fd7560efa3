"""
Brute-force fans of rays for many receivers at once: an independent oracle for direct rays in a
smooth 3-D medium.

It shares no code with the solver. scipy's splines through the medium's grid values give the field,
a fixed-step RK4 integrates the rays, and every sign change between neighbouring rays of a fan of
1e5 is a ray.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from oracles import sheet_under
from scipy.interpolate import CubicSpline, make_interp_spline

Array = NDArray[np.float64]
GRAZING = 0.5  # m; a ray that passes a boundary this closely may count as in the water or not
_DIFFERENCE = 1e-6  # of the slowness across the plane
PARTS = 64  # into which the two intervals about a dip are divided
Z, P, T, A, Y, Q, TOP, BED = range(8)


class Rays(NamedTuple):
    """One row per eigenray; slope is the change of the miss by the launch angle [m/rad]."""

    link: NDArray[np.int64]
    angle: Array
    time: Array
    spreading: Array
    slope: Array
    grazing: NDArray[np.bool_]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def _rates(layers, depth, k, z, p, y, q, c_source):
    """
    Derivatives of depth, slowness, time, tube width, offset and its slowness by range at one
    station, and the layer.
    """
    n = depth.size
    while k < n - 2 and z >= depth[k + 1]:
        k += 1
    while k > 0 and z < depth[k]:
        k -= 1
    x = z - depth[k]
    d = layers[k]
    c = d[0] + x * (d[1] + x * (d[2] + x * d[3]))
    cz = d[1] + x * (2.0 * d[2] + 3.0 * x * d[3])
    cy = 0.0
    if d.size > 4:
        cy = d[4] + x * (d[5] + x * (d[6] + x * d[7]))
        cyz = d[5] + x * (2.0 * d[6] + 3.0 * x * d[7])
        cyy = d[8] + x * (d[9] + x * (d[10] + x * d[11]))
        cyyz = d[9] + x * (2.0 * d[10] + 3.0 * x * d[11])
        c += y * (cy + 0.5 * y * cyy)
        cz += y * (cyz + 0.5 * y * cyyz)
        cy += y * cyy
    ic = 1.0 / c
    n2 = c_source * c_source * ic * ic
    h2 = n2 - p * p - q * q
    if not h2 > 1e-4:
        return np.nan, 0.0, 0.0, 0.0, 0.0, 0.0, k
    ih = 1.0 / np.sqrt(h2)
    return p * ih, -n2 * cz * ic * ih, n2 * ih / c_source, ih, q * ih, -n2 * cy * ic * ih, k


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def _trace(section, depth, bed, step, stops, z_source, c_source, angle, q0, out):
    """
    Trace rays; out (n, stops, 8) takes Z, P, T, A, Y, Q and the clearances so far after each of the
    numbers of steps.
    """
    for i in range(angle.size):
        z, p, t, a, y, q = z_source, np.sin(angle[i]), 0.0, 0.0, 0.0, q0[i]
        k, top, floor, stop = 0, z_source, bed[0] - z_source, 0
        for j in range(stops[-1]):
            s0, s1, s2 = section[2 * j], section[2 * j + 1], section[2 * j + 2]
            z1, p1, t1, a1, y1, q1, k = _rates(s0, depth, k, z, p, y, q, c_source)
            h = 0.5 * step
            z2, p2, t2, a2, y2, q2, k = _rates(
                s1, depth, k, z + h * z1, p + h * p1, y + h * y1, q + h * q1, c_source
            )
            z3, p3, t3, a3, y3, q3, k = _rates(
                s1, depth, k, z + h * z2, p + h * p2, y + h * y2, q + h * q2, c_source
            )
            z4, p4, t4, a4, y4, q4, k = _rates(
                s2, depth, k, z + step * z3, p + step * p3, y + step * y3, q + step * q3, c_source
            )
            w = step / 6.0
            z += w * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
            p += w * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
            t += w * (t1 + 2.0 * t2 + 2.0 * t3 + t4)
            a += w * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            y += w * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
            q += w * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
            top, floor = min(top, z), min(floor, bed[j + 1] - z)
            if not top > -50.0 or floor < -50.0:  # gone for good
                break
            if j + 1 == stops[stop]:
                o = out[i, stop]
                o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7] = z, p, t, a, y, q, top, floor
                stop += 1
        for rest in range(stop, stops.size):
            out[i, rest, 0] = np.nan


class SectionFan:
    """
    Fans of a source along one azimuth through a smooth medium, of which only the grid and its
    values are used.
    """

    def __init__(self, medium):
        self.medium = medium
        self.coefficients = CubicSpline(
            medium.depth, medium.sound_speed, axis=2, bc_type="natural"
        ).c
        self.coefficients = np.moveaxis(
            self.coefficients[::-1], (0, 1), (3, 2)
        )  # north, east, layer, power

    def _weights(self, nodes, x):
        """
        Values, first and second derivatives of the interpolating splines of unit vectors at x; (3,
        n, nodes).
        """
        basis = make_interp_spline(nodes, np.eye(nodes.size), k=min(3, nodes.size - 1))
        return np.stack([basis(x, nu) for nu in range(3)])

    def section(self, source, azimuth, step, n_steps, full=False):
        """
        Cubics in depth of the sound speed at twice as many ranges as steps, in the plane or with
        derivatives across it.
        """
        m = self.medium
        r = 0.5 * step * np.arange(2 * n_steps + 1)
        if m.north.size == 1:
            flat = np.zeros((r.size, m.depth.size - 1, 12 if full else 4))
            flat[..., :4] = self.coefficients[0, 0]
            return flat
        un, ue = np.cos(azimuth), np.sin(azimuth)
        wn = self._weights(m.north, source[0] + r * un)
        we = self._weights(m.east, source[1] + r * ue)

        def value(i, j):
            total = np.zeros((r.size, *self.coefficients.shape[2:]))
            for n in range(m.north.size):
                here = np.flatnonzero(np.abs(wn[i, :, n]) > 0.0)
                part = we[j, here] @ self.coefficients[n].reshape(m.east.size, -1)
                total[here] += wn[i, here, n][:, None, None] * part.reshape(
                    here.size, *total.shape[1:]
                )
            return total

        c = value(0, 0)
        if not full:
            return np.ascontiguousarray(c)
        cy = -ue * value(1, 0) + un * value(0, 1)
        cyy = ue * ue * value(2, 0) - 2.0 * ue * un * value(1, 1) + un * un * value(0, 2)
        return np.ascontiguousarray(np.concatenate([c, cy, cyy], axis=2))

    def _bed(self, source, azimuth, step, n_steps):
        m, r = self.medium, step * np.arange(n_steps + 1)
        place = np.column_stack([source[0] + r * np.cos(azimuth), source[1] + r * np.sin(azimuth)])
        return sheet_under(m.bed.north, m.bed.east, m.bed.depth, place)[0]

    def _speed(self, layers, z):
        k = np.clip(
            np.searchsorted(self.medium.depth, z, side="right") - 1, 0, self.medium.depth.size - 2
        )
        x = z - self.medium.depth[k]
        d = layers[k]
        return d[0] + x * (d[1] + x * (d[2] + x * d[3]))

    def trace(self, source, azimuth, angle, q, step, stops, section=None):
        """
        States (n, stops, 8) of rays after numbers of steps, in the vertical section or another one.
        """
        if section is None:
            section = self.section(source, azimuth, step, int(stops[-1]))
        bed = self._bed(source, azimuth, step, int(stops[-1]))
        c_source = self._speed(section[0], source[2])
        out = np.empty((angle.size, stops.size, 8))
        _trace(section, self.medium.depth, bed, step, stops, source[2], c_source, angle, q, out)
        return out, c_source, section

    def eigenrays(self, source, azimuth, receivers, angle, step=15.0):
        """
        Rays in the plane, of a fan at equally spaced launch angles, to receivers (range, a whole
        number of steps, and depth).
        """
        ends = np.rint(receivers[:, 0] / step).astype(np.int64)
        stops, where = np.unique(ends, return_inverse=True)
        out, c_source, section = self.trace(source, azimuth, angle, 0.0 * angle, step, stops)
        rows, dips = [], []
        for link, (stop, (distance, depth)) in enumerate(zip(where, receivers, strict=True)):
            place = (
                distance,
                depth,
                source[2],
                c_source,
                self._speed(section[2 * ends[link]], depth),
            )
            rows.append(_roots(link, angle, out[:, stop], place))
            dips += [(link, stop, i, place) for i in _dips(out[:, stop], depth)]
        if dips:
            first = np.array([angle[i - 1] for _, _, i, _ in dips])
            parts = first[:, None] + np.linspace(0.0, 2.0 * (angle[1] - angle[0]), PARTS + 1)
            more = self.trace(source, azimuth, parts.ravel(), 0.0 * parts.ravel(), step, stops)[0]
            more = more.reshape(*parts.shape, *more.shape[1:])
            rows += [
                _roots(link, parts[n], more[n, :, stop], place)
                for n, (link, stop, _, place) in enumerate(dips)
            ]
        return Rays(*(np.concatenate(column) for column in zip(*rows, strict=True)))

    def near(self, source, azimuth, receiver, angle, half_width=4e-4, step=10.0, n_rays=401):
        """
        Rays near a launch angle that meet one receiver in three dimensions: each ray of the fan is
        turned until it ends in the plane.
        """
        n_steps = int(np.ceil(receiver[0] / step))
        stops, step = np.array([n_steps]), receiver[0] / n_steps
        angles = angle + np.linspace(-half_width, half_width, n_rays)
        q = 0.0 * angles
        section = self.section(source, azimuth, step, n_steps, full=True)
        for turn in range(4):
            out, c_source, _ = self.trace(source, azimuth, angles, q, step, stops, section)
            came = np.isfinite(out[:, 0, Z])
            if not came.any():
                break
            if turn < 3:
                better = q[came] - out[came, 0, Y] / out[came, 0, A]
                q = np.interp(
                    angles, angles[came], better
                )  # rays that did not come take their neighbours'
        # the width across the plane: derivative of the offset by its slowness, which horizontal
        # refraction changes
        beside = self.trace(source, azimuth, angles, q + _DIFFERENCE, step, stops, section)[0]
        both = np.isfinite(out[:, 0, Z]) & np.isfinite(
            beside[:, 0, Z]
        )  # states of other rays are not set
        out[both, 0, A] = np.abs(beside[both, 0, Y] - out[both, 0, Y]) / _DIFFERENCE
        place = receiver[0], receiver[1], source[2], c_source, self._speed(section[-1], receiver[1])
        return Rays(*_roots(0, angles, out[:, 0], place))


def _wet(state):
    return (state[:, TOP] > -GRAZING) & (state[:, BED] > -GRAZING)


def _dips(state, depth):
    """
    Rays about which the miss has an extremum near zero without a change of sign: a pair of rays may
    hide there.
    """
    with np.errstate(invalid="ignore"):
        miss, wet = state[:, Z] - depth, _wet(state)
        size, bend = np.abs(miss), np.abs(miss[:-2] - 2.0 * miss[1:-1] + miss[2:])
        low = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (size[1:-1] < bend)
        one_sign = (miss[:-2] * miss[1:-1] > 0.0) & (miss[2:] * miss[1:-1] > 0.0)
        return np.flatnonzero(low & one_sign & wet[:-2] & wet[1:-1] & wet[2:]) + 1


def _roots(link, angle, state, place):
    """
    Rays of a fan that end at a place (range, depth, depth of the source, sound speed at the source
    and there).
    """
    distance, depth, z_source, c_source, speed = place
    wet = _wet(state)
    with np.errstate(invalid="ignore"):
        miss = state[:, Z] - depth
        i = np.flatnonzero(wet[:-1] & wet[1:] & (miss[:-1] * miss[1:] <= 0.0))
    f0, f1, width = miss[i], miss[i + 1], angle[1] - angle[0]
    u = f0 / (f0 - f1)
    # the slope at the root from the slopes at both ends, by central differences
    slope = np.gradient(miss, width)
    d0, d1 = slope[i], slope[i + 1]
    d = np.where(np.isfinite(d0 + d1), (1 - u) * d0 + u * d1, (f1 - f0) / width)
    at = (1 - u)[:, None] * state[i] + u[:, None] * state[i + 1]
    n = c_source / speed
    area = np.abs(d) * np.sqrt(np.maximum(n * n - at[:, P] ** 2, 0.0)) / n * at[:, A]
    level = 10.0 * np.log10(np.maximum(area, 1e-30) * n / (distance**2 + (depth - z_source) ** 2))
    grazing = (np.minimum(at[:, TOP], at[:, BED])) < GRAZING
    return np.full(i.size, link), angle[i] + u * width, at[:, T], level, np.abs(d), grazing
