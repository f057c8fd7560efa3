"""
Transmission loss of every arrival: spreading, absorption along its path, and its bounces at sea bed and surface.

The theory page on loss has the limits of each model and what was opened of its sources.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.absorption import Absorption
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.paths import quadrature, trace_paths
from pymantaray.errors import AcousticsError
from pymantaray.geometry.checks import check_fields, check_number
from pymantaray.records import Arrivals, RayPaths
from pymantaray.records.base import Column, Record, column

Array = NDArray[np.float64]
_WATER_DENSITY = 1025.0  # kg/m3
_SURFACE, _BOTTOM = 1, 2  # codes of RayPaths.boundary
_GRAVITY = 9.81
_BUBBLE_CEILING = 15.0  # dB; secondary sources give 15 and 30
_SEDIMENTS = {  # sound speed [m/s], density [kg/m3], attenuation [dB per wavelength]
    "clay": (1500.0, 1500.0, 0.2),
    "silt": (1575.0, 1700.0, 1.0),
    "sand": (1650.0, 1900.0, 0.8),
    "gravel": (1800.0, 2000.0, 0.6),
    "moraine": (1950.0, 2100.0, 0.4),
}


@dataclass(frozen=True, eq=False)
class TransmissionLoss(Record):
    """Loss of each arrival at one frequency, row for row as the `Arrivals` it was made from."""

    kind: ClassVar[str] = "transmission_loss"

    link: Column = column("arrival", "1", "index of the link", "i8")
    geometric_db: Column = column("arrival", "1", "geometric loss re 1 m, in dB")
    absorption_db: Column = column("arrival", "1", "absorption along the path, in dB")
    surface_db: Column = column("arrival", "1", "loss of the bounces at the surface, in dB")
    bottom_db: Column = column("arrival", "1", "loss of the bounces at the sea bed, in dB")
    total_db: Column = column("arrival", "1", "transmission loss re 1 m, in dB")
    boundary_phase: Column = column("arrival", "rad", "phase that the bounces add, time as exp(-i omega t)")


@dataclass(frozen=True)
class FluidBottom:
    """
    Sea bed as a homogeneous fluid half space.

    Parameters
    ----------
    sound_speed : float
        [m/s]
    density : float
        [kg/m3]
    attenuation_db_per_wavelength : float
        Of compressional waves in the sediment.
    """

    sound_speed: float
    density: float
    attenuation_db_per_wavelength: float = 0.0

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "", "sound_speed", "density", positive=True)
        check_fields(AcousticsError, self, "dB", "attenuation_db_per_wavelength")

    @classmethod
    def standard(cls, name: str) -> Self:
        """
        One of five sediments of the standard table (Jensen et al., 1.3): clay, silt, sand, gravel or moraine.

        The table's shear is left out. It is slow in these (50 to 600 m/s); rock, where it is not, is not a
        fluid and is left out too.
        """
        if name not in _SEDIMENTS:
            raise AcousticsError(f"sediment {name!r} is unknown; there are {', '.join(_SEDIMENTS)}")
        return cls(*_SEDIMENTS[name])


@dataclass(frozen=True)
class SeaSurface:
    """
    Surface under wind.

    Parameters
    ----------
    wind_speed : float
        At 10 m. [m/s]
    model : {"bubbles", "coherent"}
        What is lost: the energy that bubbles absorb, or all that is not reflected specularly and in phase.
    """

    wind_speed: float
    model: Literal["bubbles", "coherent"] = "bubbles"

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "m/s", "wind_speed")
        if self.model not in ("bubbles", "coherent"):
            raise AcousticsError(f"SeaSurface: model {self.model!r}; allowed are 'bubbles' and 'coherent'")

    def loss_db(self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike) -> Array:
        """Loss of one bounce, by grazing angle [rad], frequency [Hz] and sound speed at the surface [m/s]. [dB]"""
        if self.model == "bubbles":
            return bubble_loss_db(grazing_angle, frequency_hz, wind_speed=self.wind_speed)
        return coherent_surface_loss_db(
            grazing_angle, frequency_hz, wind_speed=self.wind_speed, sound_speed=sound_speed
        )


@dataclass(frozen=True)
class IceCover:
    """
    Underside of ice, which loses the same at every bounce.

    Parameters
    ----------
    db_per_bounce : float
        Measured were some 20 dB at steep angles, falling beyond 30 degrees from the vertical [1]_, and 15 dB now and then at
        grazing angles up to 30 degrees under undulating ice [2]_. [dB]

    References
    ----------
    .. [1] Langleben, M. P. and Pounder, E. R. (1970), Acoustic attenuation in sea ice, part II, AD0707059, abstract:
       amplitude reflection coefficient about 0.1 near the vertical, 20 to 450 kHz.
    .. [2] Verrall, R. and Ganton, J. (1977), The reflection of acoustic waves in sea water from an ice covered surface,
       ADA047298, abstract: reflectivities of -15 dB not uncommon, 0.2 to 20 kHz.
    """

    db_per_bounce: float

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "dB", "db_per_bounce")

    def loss_db(self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike) -> Array:  # noqa: ARG002
        """Loss of one bounce, as `SeaSurface.loss_db`. [dB]"""
        return np.full(np.shape(grazing_angle), self.db_per_bounce)


Surface = SeaSurface | IceCover


class Bounces(NamedTuple):
    """Bounces of ray paths, each (n_bounces,), with the angle to the boundary as it is tilted there [rad], and [m/s]."""

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
    bottom: FluidBottom | None = None,
    surface: Surface | None = None,
    paths: RayPaths | None = None,
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
    surface : SeaSurface or IceCover, optional
        By default the surface reflects everything, with phase pi.
    paths : RayPaths, optional
        What `trace_paths` returned for the arrivals, if at hand; traced here where they are needed.

    Returns
    -------
    TransmissionLoss

    Raises
    ------
    AcousticsError
        If the frequency is not positive, positions, arrivals and paths do not belong together, or a path's
        bounces are not those of its arrival.
    """
    check_number(AcousticsError, "frequency_hz", frequency_hz, "Hz", positive=True)
    geometric = geometric_loss_db(source, receiver, arrivals)
    n = geometric.size
    absorbed, surface_db, bottom_db = np.zeros(n), np.zeros(n), np.zeros(n)
    phase = np.pi * arrivals.surface_bounces.astype(float)
    bounced = (surface is not None and np.any(arrivals.surface_bounces)) or (
        bottom is not None and np.any(arrivals.bottom_bounces)
    )
    if paths is None and n and (absorption is not None or bounced):
        paths = trace_paths(medium, source, receiver, arrivals)
    if paths is not None and paths.arrival.size and paths.arrival.max() >= n:
        raise AcousticsError(f"paths reach arrival {paths.arrival.max()}; the arrivals are {n}")
    if absorption is not None and paths is not None:
        points = quadrature(paths)
        if points.arrival.size:  # else all are between equal positions
            per_metre = absorption.db_per_km(points.position, frequency_hz) / 1000.0
            absorbed = _sums(points.arrival, per_metre * points.weight, n)
    if bounced and paths is not None:
        bounces = find_bounces(paths)
        _check_bounces(bounces, arrivals)
        if surface is not None:
            at = bounces.boundary == _SURFACE
            loss = surface.loss_db(
                bounces.grazing_angle[at], frequency_hz, sound_speed=bounces.sound_speed[at]
            )
            surface_db = _sums(bounces.arrival[at], loss, n)
        if bottom is not None:
            at = bounces.boundary == _BOTTOM
            r = reflection_coefficient(bounces.grazing_angle[at], bottom, sound_speed=bounces.sound_speed[at])
            with np.errstate(divide="ignore"):  # nothing comes back at the angle of intromission
                bottom_db = _sums(bounces.arrival[at], -20.0 * np.log10(np.abs(r)), n)
            phase += _sums(bounces.arrival[at], np.angle(r), n)
    return TransmissionLoss(
        link=arrivals.link,
        geometric_db=geometric,
        absorption_db=absorbed,
        surface_db=surface_db,
        bottom_db=bottom_db,
        total_db=geometric + absorbed + surface_db + bottom_db,
        boundary_phase=phase,
    )


def geometric_loss_db(source: ArrayLike, receiver: ArrayLike, arrivals: Arrivals) -> Array:
    r"""
    Spreading of each arrival relative to 1 m from the source, minus infinity between equal positions. [dB]

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


def find_bounces(paths: RayPaths) -> Bounces:
    r"""
    Bounces of ray paths: two successive nodes at one place, both marked with the boundary.

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


def reflection_coefficient(
    grazing_angle: ArrayLike,
    bottom: FluidBottom,
    *,
    sound_speed: ArrayLike,
) -> NDArray[np.complex128]:
    r"""
    Rayleigh's plane-wave reflection coefficient of pressure at a fluid half space, complex.

    By grazing angle [rad] and sound speed of the water at the sea bed [m/s]. For time dependence
    :math:`e^{-i\omega t}`; its argument is the phase that the bounce adds.

    With :math:`m = \rho_b/\rho`, :math:`n = (c/c_b)(1 + i\delta)`, attenuation
    :math:`\delta = \ln 10\, \alpha_\lambda / 40\pi`,
    :math:`R = (m \sin\gamma - q)/(m \sin\gamma + q)`, :math:`q = \sqrt{n^2 - \cos^2\gamma}`, Im q >= 0.
    """
    angle = np.asarray(grazing_angle, dtype=float)
    loss_tangent = math.log(10.0) * bottom.attenuation_db_per_wavelength / (40.0 * math.pi)
    n = np.asarray(sound_speed, dtype=float) / bottom.sound_speed * (1.0 + 1j * loss_tangent)
    q = np.sqrt(n**2 - np.cos(angle) ** 2)
    m_sin = bottom.density / _WATER_DENSITY * np.sin(angle)
    return np.asarray((m_sin - q) / (m_sin + q))


def wave_height_rms(wind_speed: ArrayLike) -> Array:
    r"""
    Standard deviation of the surface elevation of a fully developed sea, by the wind at 10 m [m/s]. [m]

    The integral of the spectrum of Pierson and Moskowitz (1964)
    :math:`\alpha g^2 \omega^{-5} \exp[-\beta (g/U\omega)^4]` with :math:`\alpha = 0.0081, \beta = 0.74` is
    :math:`\sigma^2 = \alpha U^4 / 4 \beta g^2`; its U is at 19.5 m, 1.026 times that at 10 m.
    """
    return np.asarray(
        (1.026 * np.asarray(wind_speed, dtype=float)) ** 2 / (2.0 * _GRAVITY) * math.sqrt(0.0081 / 0.74)
    )


def coherent_surface_loss_db(
    grazing_angle: ArrayLike, frequency_hz: ArrayLike, *, wind_speed: ArrayLike, sound_speed: ArrayLike
) -> Array:
    r"""
    Loss of the specular, in-phase part of the field at a rough surface. [dB]

    Kirchhoff's :math:`|R| = \exp(-2 k^2 \sigma^2 \sin^2\gamma)` for Gaussian elevations. What is lost here is
    scattered, not gone: at modem frequencies the scattered part is what arrives.
    """
    k = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float) / np.asarray(sound_speed, dtype=float)
    rayleigh = k * wave_height_rms(wind_speed) * np.sin(grazing_angle)
    return np.asarray(40.0 / math.log(10.0) * rayleigh**2)


def bubble_loss_db(grazing_angle: ArrayLike, frequency_hz: ArrayLike, *, wind_speed: ArrayLike) -> Array:
    r"""
    Energy that the bubbles under a breaking sea absorb from a surface-reflected path. [dB]

    After the APL-UW handbook of 1994:
    :math:`1.26 \cdot 10^{-3} U^{1.57} f^{0.85} / \sin\gamma` with f in kHz from 6 m/s on, below that the
    value at 6 m/s times :math:`e^{1.2 (U - 6)}`. A fit to data of 20 to 40 kHz within 3 dB. Past a ceiling, scattering
    from beneath the bubbles carries on.
    """
    wind = np.asarray(wind_speed, dtype=float)
    breaking = 1.26e-3 * np.maximum(wind, 6.0) ** 1.57 * np.exp(1.2 * np.minimum(wind - 6.0, 0.0))
    khz = np.asarray(frequency_hz, dtype=float) / 1000.0
    sine = np.maximum(np.sin(grazing_angle), 1e-12)
    return np.asarray(np.minimum(breaking * khz**0.85 / sine, _BUBBLE_CEILING))


def _sums(rows: NDArray[np.int64], values: Array, n: int) -> Array:
    return np.asarray(np.bincount(rows, values, minlength=n), dtype=float)


def _check_bounces(bounces: Bounces, arrivals: Arrivals) -> None:
    for code, expected in ((_SURFACE, arrivals.surface_bounces), (_BOTTOM, arrivals.bottom_bounces)):
        rows = bounces.arrival[bounces.boundary == code]
        wrong = np.flatnonzero(np.bincount(rows, minlength=expected.size) != expected)
        if wrong.size:
            raise AcousticsError(
                f"paths and arrivals disagree on the bounces of {wrong.size} arrivals, first {wrong[0]};"
                " trace the paths of these arrivals"
            )
