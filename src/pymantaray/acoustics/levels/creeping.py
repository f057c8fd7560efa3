"""
Sound in the shadow of the sea surface: the field of a point source as an integral over horizontal
wavenumber.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.medium import Medium
from pymantaray.arrays import Array

Field = NDArray[np.complex128]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_PLACES = 0.5 * (1.0 + np.polynomial.legendre.leggauss(5)[0])  # along the link, for the mean column
_BELOW = 40.0  # widths of the boundary layer in wavenumber on both sides of the grazing ray
_ABOVE = 16.0
_TAPER = 0.8  # fraction of each side with a taper
_REAL = 24.0  # thicknesses of the boundary layer below the deeper end with the real water
_DEEPER = 40.0  # additional thicknesses of the boundary layer below that
_STEP = 0.15  # thicknesses of the boundary layer per step in depth
_OVER = 2.0  # ranges of the link after which the sum over wavenumbers repeats
_ROUNDS = 8
_APART = 0.03  # relative difference of the two frequencies whose phases give the delay


class Creep(NamedTuple):
    """Sound along the surface from one end of a link to the other."""

    spreading_db: float
    """Loss relative to 1 m, minus spherical spreading along the chord. [dB]"""
    travel_time: float
    """Group delay. [s]"""


class Column(NamedTuple):
    """Mean water column of a link: depths below the surface and the sound speed at them."""

    depth: Array
    speed: Array
    layer: float
    """Thickness of the boundary layer below the surface. [m]"""

    def wavenumber(self, depth: Array, frequency_hz: float) -> Array:
        """[1/m]"""
        return 2.0 * math.pi * frequency_hz / np.interp(depth, self.depth, self.speed)


def creep_along_surface(
    medium: Medium, source: Array, receiver: Array, frequency_hz: float
) -> Creep | None:
    r"""
    Field in the shadow of the surface; None if the surface does not separate the ends.

    In water whose sound speed c(z) is that of the link's mean column, the field of a point source
    at horizontal distance r is

    .. math:: p = \tfrac12 \int g(\kappa) H_0^{(1)}(\kappa r)\, \kappa\, d\kappa,

    where g solves :math:`g'' + (\omega^2 / c^2 - \kappa^2) g = -2 \delta(z - z_s)`, is zero at the
    surface and travels down below both ends. The integral contains all creeping modes (its poles)
    and holds at the border of the shadow too, where their sum does not converge. It is taken over
    wavenumbers about that of the ray that grazes the surface: no other sound gets to the receiver.

    The ordinary differential equation is solved by exponentials of matrices (Magnus, fourth order).
    The boundary layer below the surface has the thickness :math:`1 / \beta`, :math:`\beta = (2 k^2
    |c'| / c)^{1/3}`, and in wavenumber the width
    :math:`\beta^2 / 2 k`.
    """
    legs = [_to_surface(medium, end) for end in (source, receiver)]
    distance = math.hypot(*(receiver - source)[:2])
    way = distance - sum(far for far, _ in legs)
    if not way > 0.0:  # NaN is not
        return None
    depths = sorted(float(end[2]) - _surface(medium, end) for end in (source, receiver))
    column = _mean_column(medium, source, receiver, depths[1], frequency_hz)
    if column is None:
        return None
    early = sum(time for _, time in legs) + way / float(column.speed[0])
    frequencies = frequency_hz * np.array([1.0 - _APART, 1.0, 1.0 + _APART])
    before, pressure, after = (
        field_below_surface(column, depths, distance, frequency)
        for frequency in frequencies.tolist()
    )
    omega = 2.0 * math.pi * (frequencies[2] - frequencies[0])
    late = float(np.angle(after / before * np.exp(-1j * omega * early))) / omega
    chord = float(np.linalg.norm(receiver - source))
    return Creep(-20.0 * math.log10(max(abs(pressure) * chord, 1e-30)), early + late)


def field_below_surface(
    column: Column, depths: list[float], distance: float, frequency_hz: float
) -> complex:
    """
    Pressure re 1 m at a horizontal distance, time as exp(-i omega t), by the depths of the upper
    and the lower end. [m]
    """
    upper, lower = depths
    bottom = float(column.depth[-1])
    k = column.wavenumber(np.array([0.0, upper, bottom]), frequency_hz)
    width = 0.5 / (k[0] * column.layer**2)
    most = min(k[1] + _ABOVE * width, k[2] - 2.0 * width)
    least = k[0] - _BELOW * width
    step = 2.0 * math.pi / (_OVER * distance)
    kappa = np.arange(least + 0.5 * step, max(most, k[0] + width), step)
    solve = _Solver(column, kappa, frequency_hz, _STEP * column.layer)
    at_upper = solve(0.0, upper, (np.zeros(kappa.size, complex), np.ones(kappa.size, complex)))
    down = solve(upper, bottom, at_upper)
    slope = solve.outgoing(bottom)
    out = solve(bottom, lower, (np.ones(kappa.size, complex), slope))
    green = -2.0 * at_upper[0] * out[0] / (down[0] * slope - down[1])
    hankel = np.sqrt(2.0 * kappa / (math.pi * distance)) * np.exp(
        1j * (kappa * distance - 0.25 * math.pi)
    )
    window = _smooth_step((kappa - least) / (_TAPER * _BELOW * width))
    window = window * _smooth_step((most - kappa) / (_TAPER * _ABOVE * width))
    return complex(0.5 * step * np.sum(green * window * hankel))


class _Solver(NamedTuple):
    """Solutions of f'' + (k(z)^2 - kappa^2) f = 0 for many kappa at once."""

    column: Column
    kappa: Array
    frequency_hz: float
    step: float

    def __call__(self, start: float, end: float, state: tuple[Field, Field]) -> tuple[Field, Field]:
        """Integrate f and f' from one depth to another, up or down."""
        n = max(math.ceil(abs(end - start) / self.step), 1)
        h = (end - start) / n
        z = start + h * (np.arange(n)[:, None] + 0.5 + np.array([-1.0, 1.0]) * math.sqrt(3.0) / 6.0)
        squared = self.column.wavenumber(z.ravel(), self.frequency_hz).reshape(n, 2) ** 2
        f, slope = state
        for q1, q2 in squared.tolist():
            q = 0.5 * (q1 + q2) - self.kappa**2
            skew = math.sqrt(3.0) / 12.0 * h * h * (q2 - q1)
            root = np.sqrt((skew * skew - h * h * q).astype(complex))
            cosh = np.cosh(root)
            ratio = np.where(
                np.abs(root) > 1e-8, np.sinh(root) / np.where(root == 0.0, 1.0, root), 1.0
            )
            f, slope = (
                (cosh + skew * ratio) * f + h * ratio * slope,
                (cosh - skew * ratio) * slope - h * q * ratio * f,
            )
        return f, slope

    def outgoing(self, depth: float) -> Field:
        """
        Ratio f' / f of a wave that travels down, to second order of the slow change with depth.
        """
        around = self.column.wavenumber(depth - np.array([0.0, 1.0]), self.frequency_hz) ** 2
        vertical = np.sqrt((around[0] - self.kappa**2).astype(complex))
        slope: Field = 1j * vertical - (around[0] - around[1]) / (4.0 * vertical**2)
        return slope


def _smooth_step(x: Array) -> Array:
    """
    Step from 0 to 1 between 0 and 1 by the error function, whose spectrum decays fastest for its
    width.
    """
    from scipy.special import erfc

    return np.asarray(0.5 * erfc(3.5 * (1.0 - 2.0 * x)))


def _mean_column(
    medium: Medium, source: Array, receiver: Array, lower: float, frequency_hz: float
) -> Column | None:
    """
    Mean water column along a link to below its deeper end; None if sound speed does not decrease
    below the surface.

    Below its minimum, sound speed decreases as below the surface, so no ray returns from deeper
    water.
    """
    along = source + _PLACES[:, None] * (receiver - source)
    surface = medium.surface_depth(along)

    def mean_speed(depth: Array) -> Array:
        place = np.empty((_PLACES.size, depth.size, 3))
        place[..., :2] = along[:, None, :2]
        place[..., 2] = surface[:, None] + depth
        return np.asarray(
            medium.sound_speed_at(place.reshape(-1, 3)).reshape(_PLACES.size, -1).mean(axis=0)
        )

    layer = thick = 1.0
    for _ in range(_ROUNDS):  # between the gradient and the depth over which it is the mean
        speed, below = mean_speed(np.array([0.0, layer])).tolist()
        if not below < speed:
            return None
        k = 2.0 * math.pi * frequency_hz / speed
        thick = layer
        layer = (2.0 * k * k * (speed - below) / (layer * speed)) ** (-1.0 / 3.0)
    room = float((medium.bottom_depth(along) - surface).min())
    deepest = min(lower + _REAL * layer, max(lower, room - 1.0))
    depth = np.linspace(0.0, deepest, max(math.ceil(4.0 * deepest), 8))
    water = mean_speed(depth)
    least = np.flatnonzero(depth >= lower - 1e-9)
    last = int(least[np.argmin(water[least])]) + 1
    depth = depth[:last]
    water = water[:last]
    further = np.linspace(0.0, _DEEPER * layer, 401)
    gradient = _gradient_below(
        (water[-1] - water[-2]) / (depth[-1] - depth[-2]), (below - speed) / thick, further
    )
    drop = np.cumsum(0.5 * (gradient[1:] + gradient[:-1]) * np.diff(further))
    return Column(
        np.append(depth, depth[-1] + further[1:]), np.append(water, water[-1] + drop), layer
    )


def _gradient_below(last: float, surface: float, further: Array) -> Array:
    """
    Gradient below the deeper end, which changes within a third of the depth from its value there to
    that below the surface. [1/s]
    """
    share = np.clip(3.0 * further / further[-1], 0.0, 1.0)
    return np.asarray(last + (surface - last) * share**2 * (3.0 - 2.0 * share))


def _to_surface(medium: Medium, end: Array) -> tuple[float, float]:
    """
    Horizontal distance [m] and time [s] of the ray from an end that grazes the surface; NaN without
    such a ray.
    """
    u = 0.5 * (1.0 + _NODES)
    surface = _surface(medium, end)
    below = float(end[2]) - surface
    depth = surface + np.append(below * u**2, 0.0)
    place = np.column_stack([np.full_like(depth, end[0]), np.full_like(depth, end[1]), depth])
    speed = medium.sound_speed_at(place)
    cosine = speed[:-1] / speed[-1]
    if not (cosine < 1.0).all():
        return math.nan, math.nan
    step = _WEIGHTS * below * u / np.sqrt(1.0 - cosine**2)
    return float(step @ cosine), float(step @ (1.0 / speed[:-1]))


def _surface(medium: Medium, place: Array) -> float:
    """Depth of the surface, or of the underside of ice, above a position. [m]"""
    return float(medium.surface_depth(place[None])[0])
