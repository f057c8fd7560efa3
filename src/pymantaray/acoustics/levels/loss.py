"""
Transmission loss of every arrival: spreading, absorption along its path, and reflections at sea bed
and surface.

The theory page on loss has the limits of each model and its sources. Models of reflection are in
`reflection`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics import RayPaths
from pymantaray.acoustics.levels.absorption import Absorption
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.near_ends import NEAR, nearly_coincident
from pymantaray.acoustics.paths import quadrature, trace_paths
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.boundary import BoundarySurface, Reflection
from pymantaray.quantities.checks import check_number
from pymantaray.records import Arrivals
from pymantaray.records.base import Column, Record, column

_SURFACE = 1  # codes of RayPaths.boundary
_BOTTOM = 2


@dataclass(frozen=True, eq=False)
class TransmissionLoss(Record):
    """Loss of each arrival at one frequency, in the same rows as the `Arrivals`."""

    kind: ClassVar[str] = "transmission_loss"

    link: Column = column("arrival", "1", "index of the link", "i8")
    geometric_db: Column = column("arrival", "1", "geometric loss re 1 m, in dB")
    absorption_db: Column = column("arrival", "1", "absorption along the path, in dB")
    surface_db: Column = column("arrival", "1", "loss of the bounces at the surface, in dB")
    bottom_db: Column = column("arrival", "1", "loss of the bounces at the sea bed, in dB")
    total_db: Column = column("arrival", "1", "transmission loss re 1 m, in dB")
    boundary_phase: Column = column(
        "arrival", "rad", "phase that the bounces add, time as exp(-i omega t)"
    )


class Bounces(NamedTuple):
    """
    Bounces of ray paths, each field of shape (n_bounces,); angles are relative to the tilted
    boundary. [rad, m/s]
    """

    arrival: NDArray[np.int64]
    boundary: NDArray[np.int64]
    grazing_angle: Array
    sound_speed: Array


def transmission_loss(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    arrivals: Arrivals,
    frequency_hz: float,
    *,
    absorption: Absorption | None = None,
    bottom: Reflection | None = None,
    surface: Reflection | None = None,
    paths: RayPaths | None = None,
) -> TransmissionLoss:
    """
    Return the transmission loss of each arrival.

    Parameters
    ----------
    medium : Medium
        As given to `find_eigenrays`.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        As given to `find_eigenrays`. [m]
    arrivals : Arrivals
        Result of `find_eigenrays` for these positions.
    frequency_hz : float
        Centre of the signal's band. [Hz]
    absorption : Absorption, optional
        Absorption of the water. Default: none.
    bottom : Reflection, optional
        Reflection at the sea bed, such as `FluidBottom`. Default: that of ``medium.bed``; a bed
        without a reflection reflects all sound without a change of phase.
    surface : Reflection, optional
        Reflection at the surface, such as `SeaSurface` or `IceCover`. Default: that of
        ``medium.surface``; a surface without a reflection reflects all sound with phase pi.
    paths : RayPaths, optional
        Result of `trace_paths` for the arrivals. Default: the function traces paths if it needs
        them.

    Returns
    -------
    TransmissionLoss

    Raises
    ------
    AcousticsError
        If the frequency is not positive, or positions, arrivals and paths, with their bounces, do
        not match.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import Absorption, transmission_loss
    >>> water = Absorption.thorp()
    >>> loss = transmission_loss(medium, source, receiver, arrivals, 25e3, absorption=water)
    >>> print(loss.total_db.round(1), loss.absorption_db.round(1))
    [88.5 88.2] [18.5 18.6]
    """
    check_number(AcousticsError, "frequency_hz", frequency_hz, "Hz", positive=True)
    geometric = geometric_loss_db(source, receiver, arrivals)
    n = geometric.size
    # paths are needed only for absorption and for reflections with a loss
    models = {
        _SURFACE: medium.surface.reflection if surface is None else surface,
        _BOTTOM: medium.bed.reflection if bottom is None else bottom,
    }
    counts = {_SURFACE: arrivals.surface_bounces, _BOTTOM: arrivals.bottom_bounces}
    bounced = any(model is not None and np.any(counts[code]) for code, model in models.items())
    if paths is None and n and (absorption is not None or bounced):
        paths = trace_paths(medium, source, receiver, arrivals)
    if paths is not None and paths.arrival.size and paths.arrival.max() >= n:
        raise AcousticsError(
            f"paths: arrival {paths.arrival.max()}; there are only {n} arrivals; trace their paths"
        )
    # absorption along each path
    absorbed = np.zeros(n)
    if absorption is not None and paths is not None:
        points = quadrature(paths)
        if points.arrival.size:  # else all are between equal positions
            per_metre = absorption.db_per_km(points.position, frequency_hz) / 1000.0
            absorbed = _sums(points.arrival, per_metre * points.weight, n)
    # reflections; without a model, the surface turns the phase and the bed does not
    lost = {_SURFACE: np.zeros(n), _BOTTOM: np.zeros(n)}
    phase = np.zeros(n)
    if models[_SURFACE] is None:
        phase = np.pi * arrivals.surface_bounces.astype(float)
    if bounced and paths is not None:
        bounces = find_bounces(paths)
        _check_bounces(bounces, arrivals)
        for code, model in models.items():
            if model is None:
                continue
            at = bounces.boundary == code
            loss, shift = model.loss_and_phase(
                bounces.grazing_angle[at], frequency_hz, sound_speed=bounces.sound_speed[at]
            )
            lost[code] = _sums(bounces.arrival[at], loss, n)
            phase += _sums(bounces.arrival[at], shift, n)
    return TransmissionLoss(
        link=arrivals.link,
        geometric_db=geometric,
        absorption_db=absorbed,
        surface_db=lost[_SURFACE],
        bottom_db=lost[_BOTTOM],
        total_db=geometric + absorbed + lost[_SURFACE] + lost[_BOTTOM],
        boundary_phase=phase,
    )


class Losses(NamedTuple):
    """Losses besides spreading; a reflection is None if the boundary has its own."""

    absorption: Absorption | None
    bottom: Reflection | None
    surface: Reflection | None


def loss_under_rough_surface(
    medium: Medium,
    ends: tuple[Array, Array],
    arrivals: Arrivals,
    frequency_hz: float,
    losses: Losses,
) -> Array:
    """
    Transmission loss of arrivals under a rough surface, whose paths are not traced. [dB]

    Absorption is that at the mean depth of both ends over the length c t. Reflections have the
    grazing angle of the ray parameter at the ends, by Snell's law.
    """
    source, receiver = ends
    loss = geometric_loss_db(source, receiver, arrivals)
    if not loss.size:
        return loss
    link = arrivals.link
    if losses.absorption is not None:
        middle = 0.5 * (source + receiver)[link]
        speed = 0.5 * (arrivals.source_sound_speed + arrivals.receiver_sound_speed)[link]
        per_km: Array = losses.absorption.db_per_km(middle, frequency_hz)
        loss = loss + per_km * speed * arrivals.travel_time / 1000.0
    p = [
        np.hypot(*slowness[:, :2].T)
        for slowness in (arrivals.source_slowness, arrivals.receiver_slowness)
    ]
    parameter = 0.5 * (p[0] + p[1])
    boundaries = (
        (medium.surface, losses.surface, arrivals.surface_bounces),
        (medium.bed, losses.bottom, arrivals.bottom_bounces),
    )
    for boundary, model, count in boundaries:
        reflection = boundary.reflection if model is None else model
        if reflection is None or not np.any(count):
            continue
        places = np.zeros((1, 3))
        places[0, :2], places[0, 2] = source[0, :2], float(boundary.depth.mean())
        speed = np.full(
            link.size,
            float(replace(medium, surface=BoundarySurface(0.0)).sound_speed_at(places)[0]),
        )
        grazing = np.arccos(np.clip(parameter * speed, 0.0, 1.0))
        loss = loss + count * reflection.loss_and_phase(grazing, frequency_hz, sound_speed=speed)[0]
    return np.asarray(loss)


def geometric_loss_db(source: ArrayLike, receiver: ArrayLike, arrivals: Arrivals) -> Array:
    r"""
    Return the spreading of each arrival relative to 1 m from the source; minus infinity for direct
    rays between equal positions. [dB]

    `Arrivals` has :math:`10 \lg (c_s A / c_r \Omega d^2)` with the ray tube's cross-section A at
    the receiver, its solid angle :math:`\Omega` at the source, the speeds at both ends and the
    straight distance d. Adding
    :math:`20 \lg d` gives the loss of pressure of ray theory at constant density, which is
    reciprocal. It is too small within a few wavelengths of a caustic.
    """
    a = np.atleast_2d(np.asarray(source, dtype=float))
    b = np.atleast_2d(np.asarray(receiver, dtype=float))
    n = arrivals.status.size
    if a.shape != (n, 3) or b.shape != (n, 3):
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; for arrivals of {n} links, both must"
            f" have shape ({n}, 3)"
        )
    distance = np.linalg.norm(b - a, axis=-1)[arrivals.link]
    reflected = (arrivals.surface_bounces > 0) | (arrivals.bottom_bounces > 0)
    distance[reflected & nearly_coincident(a, b)[arrivals.link]] = NEAR
    with np.errstate(divide="ignore"):
        spherical = 20.0 * np.log10(distance)
    return np.asarray(np.where(distance > 0.0, spherical + arrivals.spreading_db, spherical))


def find_bounces(paths: RayPaths) -> Bounces:
    r"""
    Find the bounces of ray paths: two successive nodes at one position with a flag of the boundary.

    A reflection changes the slowness by twice its component along the boundary's normal, so the
    grazing angle has :math:`\sin\gamma = c\,|\mathbf{p}_{after} - \mathbf{p}_{before}| / 2`.
    """
    marked = np.flatnonzero(paths.boundary)
    before = marked[0::2]
    after = marked[1::2]
    if before.size != after.size or np.any(
        (after != before + 1)
        | (paths.arrival[after] != paths.arrival[before])
        | (paths.boundary[after] != paths.boundary[before])
    ):
        raise AcousticsError(
            "ray paths: a bounce must be two successive nodes of one arrival and boundary"
        )
    speed = 1.0 / np.linalg.norm(paths.slowness[before], axis=-1)
    step = np.linalg.norm(paths.slowness[after] - paths.slowness[before], axis=-1)
    return Bounces(
        arrival=paths.arrival[before],
        boundary=paths.boundary[before].astype(np.int64),
        grazing_angle=np.arcsin(np.minimum(0.5 * step * speed, 1.0)),
        sound_speed=speed,
    )


def _sums(rows: NDArray[np.int64], values: Array, n: int) -> Array:
    return np.asarray(np.bincount(rows, values, minlength=n), dtype=float)


def _check_bounces(bounces: Bounces, arrivals: Arrivals) -> None:
    for code, expected in (
        (_SURFACE, arrivals.surface_bounces),
        (_BOTTOM, arrivals.bottom_bounces),
    ):
        rows = bounces.arrival[bounces.boundary == code]
        wrong = np.flatnonzero(np.bincount(rows, minlength=expected.size) != expected)
        if wrong.size:
            raise AcousticsError(
                f"paths and arrivals disagree on the bounces of {wrong.size} arrivals, first"
                f" {wrong[0]}; trace the paths of these arrivals"
            )
