"""Transmission loss of every arrival: spreading, absorption along its path, and its bounces."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.absorption_field import Absorption
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.path_integrals import quadrature
from pymantaray.acoustics.paths import trace_paths
from pymantaray.acoustics.reflection import WATER_DENSITY, FluidBottom, reflection_coefficient
from pymantaray.acoustics.surface_loss import SeaSurface
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, RayPaths
from pymantaray.records.base import Column, Record, column

Array = NDArray[np.float64]
_SURFACE, _BOTTOM = 1, 2  # codes of RayPaths.boundary


@dataclass(frozen=True, eq=False)
class TransmissionLoss(Record):
    """Loss of each arrival at one frequency, row for row as the `Arrivals` it was made from."""

    kind: ClassVar[str] = "transmission_loss"

    link: Column = column("arrival", "1", "index of the link", "i8")
    geometric_db: Column = column("arrival", "dB", "geometric loss re 1 m")
    absorption_db: Column = column("arrival", "dB", "absorption along the path")
    surface_db: Column = column("arrival", "dB", "loss of the bounces at the surface")
    bottom_db: Column = column("arrival", "dB", "loss of the bounces at the sea bed")
    total_db: Column = column("arrival", "dB", "transmission loss re 1 m")
    boundary_phase: Column = column("arrival", "rad", "phase that the bounces add, time as exp(-i omega t)")


@dataclass(frozen=True)
class Bounces:
    """
    Every bounce of a set of ray paths.

    Attributes
    ----------
    arrival, boundary : ndarray of int, shape (n_bounces,)
        Row of the arrivals; 1 at the surface, 2 at the sea bed.
    grazing_angle : ndarray, shape (n_bounces,)
        Between ray and boundary, as it is tilted there. [rad]
    sound_speed : ndarray, shape (n_bounces,)
        [m/s]
    """

    arrival: NDArray[np.int64]
    boundary: NDArray[np.int64]
    grazing_angle: Array
    sound_speed: Array


def find_bounces(paths: RayPaths) -> Bounces:
    r"""
    Bounces of ray paths and their grazing angles.

    Parameters
    ----------
    paths : RayPaths
        A bounce is two successive nodes at one place, both marked with the boundary.

    Returns
    -------
    Bounces

    Raises
    ------
    AcousticsError
        If the marked nodes are not pairs.

    Notes
    -----
    Reflection changes slowness along the boundary's normal only, by twice its normal part, so the grazing
    angle has :math:`\sin\gamma = c\,|\mathbf{p}_{after} - \mathbf{p}_{before}| / 2`.
    """
    marked = np.flatnonzero(paths.boundary)
    before, after = marked[0::2], marked[1::2]
    if before.size != after.size or np.any(
        (after != before + 1)
        | (paths.arrival[after] != paths.arrival[before])
        | (paths.boundary[after] != paths.boundary[before])
    ):
        raise AcousticsError("ray paths: a bounce must be two successive nodes of one arrival and boundary")
    speed = 1.0 / np.linalg.norm(paths.slowness[before], axis=-1)
    step = np.linalg.norm(paths.slowness[after] - paths.slowness[before], axis=-1)
    return Bounces(
        arrival=paths.arrival[before],
        boundary=paths.boundary[before].astype(np.int64),
        grazing_angle=np.arcsin(np.minimum(0.5 * step * speed, 1.0)),
        sound_speed=speed,
    )


def geometric_loss_db(source: ArrayLike, receiver: ArrayLike, arrivals: Arrivals) -> Array:
    r"""
    Spreading of each arrival relative to 1 m from the source.

    Parameters
    ----------
    source, receiver : array_like, shape (n_links, 3) or (3,)
        As given to `find_eigenrays`. [m]
    arrivals : Arrivals

    Returns
    -------
    ndarray, shape (n_arrivals,)
        Minus infinity between equal positions. [dB]

    Raises
    ------
    AcousticsError
        If positions and arrivals do not belong together.

    Notes
    -----
    `Arrivals` has :math:`10 \lg (c_s A / c_r \Omega d^2)` with the ray tube's cross-section A at the
    receiver, its solid angle :math:`\Omega` at the source, the speeds at both ends and the straight distance d. Adding
    :math:`20 \lg d` leaves the loss of pressure of ray theory at constant density, which is reciprocal.
    Within the caustic's own few wavelengths it is too small.
    """
    a, b = np.atleast_2d(np.asarray(source, dtype=float)), np.atleast_2d(np.asarray(receiver, dtype=float))
    n = arrivals.status.size
    if a.shape != (n, 3) or b.shape != (n, 3):
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; arrivals of {n} links need ({n}, 3) for both"
        )
    distance = np.linalg.norm(b - a, axis=-1)[arrivals.link]
    with np.errstate(divide="ignore"):
        spherical = 20.0 * np.log10(distance)
    return np.asarray(np.where(distance > 0.0, spherical + arrivals.spreading_db, spherical))


def transmission_loss(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    arrivals: Arrivals,
    frequency_hz: float,
    *,
    absorption: Absorption | None = None,
    bottom: FluidBottom | None = None,
    surface: SeaSurface | None = None,
    paths: RayPaths | None = None,
    water_density: float = WATER_DENSITY,
) -> TransmissionLoss:
    """
    Transmission loss of each arrival.

    Parameters
    ----------
    medium : Medium
        As given to `find_eigenrays`.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        As given to `find_eigenrays`. [m]
    arrivals : Arrivals
        What `find_eigenrays` returned for them.
    frequency_hz : float
        Middle of the signal's band. [Hz]
    absorption : Absorption, optional
        By default the water absorbs nothing.
    bottom : FluidBottom, optional
        By default the sea bed reflects everything, without change of phase.
    surface : SeaSurface, optional
        By default the surface reflects everything, with phase pi.
    paths : RayPaths, optional
        What `trace_paths` returned for the arrivals, if at hand; traced here where they are needed.
    water_density : float
        Of the water at the sea bed. [kg/m3]

    Returns
    -------
    TransmissionLoss

    Raises
    ------
    AcousticsError
        If the frequency is not positive, positions, arrivals and paths do not belong together, or a path's
        bounces are not those of its arrival.
    """
    if not 0.0 < frequency_hz < np.inf:
        raise AcousticsError(f"frequency_hz: {frequency_hz:g}; must be positive and finite")
    geometric = geometric_loss_db(source, receiver, arrivals)
    n = geometric.size
    absorbed, surface_db, bottom_db = np.zeros(n), np.zeros(n), np.zeros(n)
    phase = np.pi * arrivals.surface_bounces.astype(float)
    bounced = (surface is not None and np.any(arrivals.surface_bounces)) or (
        bottom is not None and np.any(arrivals.bottom_bounces)
    )
    if paths is None and n and (absorption is not None or bounced):
        paths = trace_paths(medium, source, receiver, arrivals)
    if absorption is not None and paths is not None:
        absorbed = absorption_along_db(paths, absorption, frequency_hz, n_arrivals=n)
    if bounced and paths is not None:
        found = find_bounces(paths)
        _check_bounces(found, arrivals)
        if surface is not None:
            at = found.boundary == _SURFACE
            loss = surface.loss_db(found.grazing_angle[at], frequency_hz, sound_speed=found.sound_speed[at])
            surface_db = _sums(found.arrival[at], loss, n)
        if bottom is not None:
            at = found.boundary == _BOTTOM
            r = reflection_coefficient(
                found.grazing_angle[at], bottom, sound_speed=found.sound_speed[at], density=water_density
            )
            with np.errstate(divide="ignore"):  # nothing comes back at the angle of intromission
                bottom_db = _sums(found.arrival[at], -20.0 * np.log10(np.abs(r)), n)
            phase += _sums(found.arrival[at], np.angle(r), n)
    return TransmissionLoss(
        link=arrivals.link,
        geometric_db=geometric,
        absorption_db=absorbed,
        surface_db=surface_db,
        bottom_db=bottom_db,
        total_db=geometric + absorbed + surface_db + bottom_db,
        boundary_phase=phase,
    )


def absorption_along_db(
    paths: RayPaths, absorption: Absorption, frequency_hz: float, *, n_arrivals: int
) -> Array:
    """
    Absorption along each path: the integral of the coefficient over arc length.

    Parameters
    ----------
    paths : RayPaths
    absorption : Absorption
    frequency_hz : float
        [Hz]
    n_arrivals : int
        Arrivals that the paths belong to.

    Returns
    -------
    ndarray, shape (n_arrivals,)
        [dB]

    Raises
    ------
    AcousticsError
        If the paths are not those of so many arrivals.
    """
    points = quadrature(paths)
    if paths.arrival.size and paths.arrival.max() >= n_arrivals:
        raise AcousticsError(f"paths reach arrival {paths.arrival.max()}; the arrivals are {n_arrivals}")
    if points.arrival.size == 0:  # all between equal positions
        return np.zeros(n_arrivals)
    per_metre = absorption.db_per_km(points.position, frequency_hz) / 1000.0
    return _sums(points.arrival, per_metre * points.weight, n_arrivals)


def _sums(rows: NDArray[np.int64], values: Array, n: int) -> Array:
    return np.asarray(np.bincount(rows, values, minlength=n), dtype=float)


def _check_bounces(found: Bounces, arrivals: Arrivals) -> None:
    for code, expected in ((_SURFACE, arrivals.surface_bounces), (_BOTTOM, arrivals.bottom_bounces)):
        rows = found.arrival[found.boundary == code]
        if rows.size and rows.max() >= expected.size:
            raise AcousticsError(f"paths reach arrival {rows.max()}; the arrivals are {expected.size}")
        wrong = np.flatnonzero(np.bincount(rows, minlength=expected.size) != expected)
        if wrong.size:
            raise AcousticsError(
                f"paths and arrivals disagree on the bounces of {wrong.size} arrivals, first {wrong[0]};"
                " trace the paths of these arrivals"
            )
