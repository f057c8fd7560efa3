"""Sound in the shadow of the sea surface: a wave that creeps along the surface and decays exponentially."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.medium import Medium

Array = NDArray[np.float64]
_ROOT, _SLOPE = (
    2.338107410459767,
    0.7012108227206914,
)  # of Airy's function: where it is first 0, and how steep
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_ROUNDS = 8  # between the gradient and the depth that it is meant over


class Creep(NamedTuple):
    """Creeping wave from one end of a link to the other."""

    spreading_db: float
    """Relative to a metre's, less spherical spreading along the chord. [dB]"""
    travel_time: float
    """[s]"""


def creep_along_surface(medium: Medium, source: Array, receiver: Array, frequency_hz: float) -> Creep | None:
    r"""
    First mode of the field in the shadow of the surface; None where the ends are not parted by it.

    In water whose sound speed falls by g with depth from c at a surface without pressure, :math:`\beta = (2 k^2 g / c)^{1/3}`. The
    field is a sum of modes :math:`\mathrm{Ai}(e^{-i \pi / 3} (\beta z - a e^{i \pi / 3}))`, a the zeros of :math:`\mathrm{Ai}(-a)`; deep in the
    shadow the first is left, which falls by :math:`\alpha = \tfrac{\sqrt 3}{2} a \beta^2 / 2k` nepers a metre. The rays that graze the surface take
    sound up and down again without such loss: what creeps goes the distance between them, which comes, as their times, from the water at
    both ends; the gradient is the mean over the depth :math:`a / \beta` in the middle of the link.
    """
    legs = [_to_surface(medium, end) for end in (source, receiver)]
    chord = float(np.linalg.norm(receiver - source))
    way = math.hypot(*(receiver - source)[:2]) - sum(far for far, _ in legs)
    speed, gradient, k = _at_surface(medium, 0.5 * (source + receiver), frequency_hz)
    if not (way > 0.0 and gradient > 0.0):  # NaN is not
        return None
    beta = (2.0 * k * k * gradient / speed) ** (1.0 / 3.0)
    alpha = 0.5 * math.sqrt(3.0) * _ROOT * beta**2 / (2.0 * k)
    below = (float(end[2]) - _surface(medium, end) for end in (source, receiver))
    heights = sum(_log_height(depth, beta, alpha, speed / gradient) for depth in below)
    norm = _SLOPE**2 / beta
    pressure = math.log(math.pi * math.sqrt(2.0 / (math.pi * k * chord)) / norm) + heights - alpha * way
    late = way * alpha / math.sqrt(3.0) / (3.0 * 2.0 * math.pi * frequency_hz)  # of the mode's group
    return Creep(
        -20.0 / math.log(10.0) * (math.log(chord) + pressure),
        sum(time for _, time in legs) + way / speed + late,
    )


def _to_surface(medium: Medium, end: Array) -> tuple[float, float]:
    """Horizontal distance [m] and time [s] of the ray that grazes the surface and comes to an end; NaN where none does."""
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


def _at_surface(medium: Medium, place: Array, frequency_hz: float) -> tuple[float, float, float]:
    """Sound speed, by how much a metre it falls over the depth of the first mode [1/s], and wavenumber."""
    depth, speed, gradient, k, surface = 1.0, math.nan, math.nan, math.nan, _surface(medium, place)
    for _ in range(_ROUNDS):
        column = np.array([[place[0], place[1], surface], [place[0], place[1], surface + depth]])
        speed, below = medium.sound_speed_at(column).tolist()
        gradient, k = (speed - below) / depth, 2.0 * math.pi * frequency_hz / speed
        if not gradient > 0.0:
            break
        depth = _ROOT * (2.0 * k * k * gradient / speed) ** (-1.0 / 3.0)
    return speed, gradient, k


def _surface(medium: Medium, place: Array) -> float:
    """Depth of the surface above a place, under ice that of its underside. [m]"""
    return float(medium.surface_depth(place[None])[0])


def _log_height(depth: float, beta: float, alpha: float, radius: float) -> float:
    """Logarithm of the first mode so far below the surface, less its growth along the grazing ray down to there."""
    from scipy.special import airye

    z = (beta * depth - _ROOT * np.exp(1j * math.pi / 3.0)) * np.exp(-1j * math.pi / 3.0)
    log = math.log(abs(airye(z)[0])) - float((2.0 / 3.0 * z * np.sqrt(z)).real)
    return log - alpha * math.sqrt(2.0 * radius * depth)
