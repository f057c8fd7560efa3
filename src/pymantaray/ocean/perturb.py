"""
Perturbed oceans for estimators: random members, the horizontal mean, or one column everywhere.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import gsw
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.modes import VerticalModes, vertical_modes
from pymantaray.ocean.names import Equation
from pymantaray.ocean.schema import (
    VARIABLES,
    latitude,
    layer_edges,
    longitude,
    validate_ocean,
    with_history,
)
from pymantaray.ocean.seawater import absolute_and_conservative, sound_speed
from pymantaray.ocean.window import counted_place

# of a random field; the cubic spline then loses 0.1 % of the standard deviation
_NODES_PER_SCALE = 4.0
_MARGIN = 3  # nodes beyond the window
_MAX_NODES = 1500  # along one axis
_ACCURACY = 1e-6  # m/s, of a change of sound speed
_STEP = 0.01  # degC, or fraction of the salinity, for the derivative of sound speed
_ITERATIONS = 30
_MAX_SALINITY_FACTOR = 2.0


def perturb_ocean(
    ocean: xr.Dataset,
    *,
    rms: float,
    horizontal_scale: float,
    rng: np.random.Generator,
    modes: VerticalModes | int | None = None,
    down_to: float | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    Perturb the sound speed of an ocean at random, in vertical modes.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    rms : float
        Expected rms of the perturbation over the water and all members. [m/s]
    horizontal_scale : float
        Scale L of the correlation exp(-d²/2L²); infinite for a horizontally uniform perturbation.
        [m]
    rng : numpy.random.Generator
        Source of the random amplitudes. Studies use `pymantaray.geometry.streams.stream`.
    modes : VerticalModes or int, optional
        Modes, for example of casts, or a number of modes of this ocean's columns. Default: modes of
        its columns with 99.99 % of the variance.
    down_to : float, optional
        Depth limit of the water for ``rms``. Default: the sea bed. [m]
    equation : str
        Equation of sound speed.

    Returns
    -------
    xarray.Dataset
        A valid ocean on the same grid. Its history describes the perturbation.

    Notes
    -----
    A member has sound speed c + s Σ a_k φ_k(z). The a_k are independent Gaussian fields with
    variance v_k; φ_k and v_k are shapes and variances of `VerticalModes`. The factor s makes the
    expected mean square equal to ``rms`` squared, with wet grid points weighted by the thickness of
    their layers. The rms of a single member differs, more so for longer scales. Temperature is
    changed until sound speed is exact within 1e-6 m/s; salinity is changed only where no
    temperature suffices. Currents are unchanged and no longer balance the density. The same
    generator state gives errors in proportion to ``rms``. Water may become colder than its freezing
    point.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import perturb_ocean
    >>> rng = np.random.default_rng(1)
    >>> other = perturb_ocean(ocean, rms=0.5, horizontal_scale=20e3, rng=rng)
    >>> other.attrs["history"].splitlines()[-1].split(",")[0]
    'sound speed perturbed by 2 vertical modes'
    """
    error = draw_sound_speed_error(
        ocean,
        rms=rms,
        horizontal_scale=horizontal_scale,
        rng=rng,
        modes=modes,
        down_to=down_to,
        equation=equation,
    )
    profiles = error.profiles(np.asarray(ocean["depth"].values, dtype=float))
    change = np.einsum("kz,kyx->zyx", profiles, error.fields)
    member = change_sound_speed(ocean, change, equation=equation)
    layer = "the water column" if down_to is None else f"the upper {down_to:g} m"
    return with_history(
        member,
        f"sound speed perturbed by {len(profiles)} vertical modes, expected {rms:g} m/s rms over"
        f" {layer}, horizontal scale {horizontal_scale:g} m, by temperature ({equation}); no longer"
        " in balance with the currents",
    )


class SoundSpeedError(NamedTuple):
    """
    Random error of sound speed: the sum over vertical modes of a profile times a horizontal field.
    """

    modes: VerticalModes
    scale: Array
    """Standard deviation of the amplitude of each mode. [m/s]"""
    fields: Array
    """Amplitudes (n_modes, lat, lon) with variance 1."""

    def profiles(self, depth: Array) -> Array:
        """Profiles (n_modes, depth) of the modes at depths [m]. [m/s]"""
        return self.scale[:, None] * self.modes.at(depth)


def draw_sound_speed_error(
    ocean: xr.Dataset,
    *,
    rms: float,
    horizontal_scale: float,
    rng: np.random.Generator,
    modes: VerticalModes | int | None = None,
    down_to: float | None = None,
    equation: Equation = "teos-10",
) -> SoundSpeedError:
    """Draw the error of sound speed of `perturb_ocean`, with the same arguments."""
    validate_ocean(ocean)
    for name, value in (("rms", rms), ("horizontal_scale", horizontal_scale), ("down_to", down_to)):
        if value is not None and not value > 0.0:
            raise OceanError(f"perturbation: {name} is {value:g}; it must be positive")
    if not isinstance(modes, VerticalModes):
        modes = vertical_modes(ocean, n_modes=modes, equation=equation)
    lat, lon, depth = (np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon", "depth"))
    factor = rms / pooled_rms(ocean, modes.variance @ modes.at(depth) ** 2, down_to)
    fields = random_fields(lat, lon, count=modes.variance.size, scale=horizontal_scale, rng=rng)
    return SoundSpeedError(modes, factor * np.sqrt(modes.variance), fields)


def mean_ocean(ocean: xr.Dataset) -> xr.Dataset:
    """
    Replace each level of an ocean by its horizontal mean.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.

    Returns
    -------
    xarray.Dataset
        A valid ocean with uniform levels, including currents, and the same sea bed.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import mean_ocean
    >>> surface = mean_ocean(ocean)["water_temp"][0]
    >>> float(ocean["water_temp"][0].std().round(2)), float(surface.std().round(2))
    (0.01, 0.0)
    """
    validate_ocean(ocean)
    columns = {}
    for v in VARIABLES:
        field = np.asarray(ocean[v.name].values, dtype=float)
        wet = np.isfinite(field)
        count = wet.sum(axis=(1, 2))
        total = np.where(wet, field, 0.0).sum(axis=(1, 2))
        columns[v.name] = np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0)
    return with_history(
        _uniform(ocean, columns),
        "replaced by the horizontal mean of each level, including currents",
    )


def column_ocean(ocean: xr.Dataset, place: tuple[float, float]) -> xr.Dataset:
    """
    Replace an ocean by one of its columns everywhere, at rest, as from a single cast.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    place : tuple of float
        Latitude and longitude inside the window; the function uses the column of the nearest wet
        grid point. [degrees]

    Returns
    -------
    xarray.Dataset
        A valid ocean with the same grid and sea bed. Where the sea bed is deeper than the column,
        the deepest value is extended downward.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import column_ocean
    >>> column = column_ocean(ocean, (78.0, 0.0))
    >>> float(column["water_temp"][0].std().round(2)), float(np.abs(column["water_u"]).max())
    (0.0, 0.0)
    """
    validate_ocean(ocean)
    lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon"))
    at_lat, at_lon = counted_place(ocean, place, "column")
    wet = np.isfinite(ocean["water_temp"].values)
    apart = np.hypot(lat[:, None] - at_lat, (lon - at_lon) * np.cos(np.radians(at_lat)))
    i, j = np.unravel_index(int(np.argmin(np.where(wet[0], apart, np.inf))), apart.shape)
    levels = int(wet[:, i, j].sum())
    at_level = np.minimum(np.arange(len(wet)), levels - 1)
    columns = {
        v.name: np.asarray(ocean[v.name].values[at_level, i, j], dtype=float) for v in VARIABLES[:2]
    }
    columns |= {v.name: np.zeros(len(wet)) for v in VARIABLES[2:]}
    deepest = float(ocean["depth"].values[levels - 1])
    return with_history(
        _uniform(ocean, columns),
        f"replaced by the column at {latitude(lat[i])}, {longitude(lon[j])}, at rest, carried down"
        f" from {deepest:g} m where deeper",
    )


def _uniform(ocean: xr.Dataset, columns: dict[str, Array]) -> xr.Dataset:
    """Apply columns everywhere, down to the sea bed of the ocean."""
    wet = np.isfinite(ocean["water_temp"].values)
    uniform = ocean.copy()
    for name, column in columns.items():
        uniform[name] = ocean[name].copy(data=np.where(wet, column[:, None, None], np.nan))
    validate_ocean(uniform)
    return uniform


def random_fields(
    lat: Array, lon: Array, *, count: int, scale: float, rng: np.random.Generator
) -> Array:
    """
    Draw independent fields (count, lat, lon) with mean 0, variance 1 and correlation exp(-d²/2L²)
    of scale L [m].

    The correlation is a product of correlations along north and east of the local frame around the
    middle of the window. On a lattice with spacing L/4, a field is F_n Z F_eᵀ with standard normal
    Z, where F Fᵀ is the correlation along an axis. The field is exactly Gaussian with the stated
    covariance. A cubic spline interpolates it to the grid. With an infinite scale, each field is
    one number.
    """
    from scipy.interpolate import RectBivariateSpline

    if math.isinf(scale):
        return np.broadcast_to(
            rng.standard_normal((count, 1, 1)), (count, lat.size, lon.size)
        ).copy()
    frame = LocalFrame(0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1]))
    north, east = frame.to_local(lat[:, None], lon[None, :])
    axes = [_lattice(x, scale) for x in (north, east)]
    factors = [_factor(axis, scale) for axis in axes]
    fields = np.empty((count, lat.size, lon.size))
    for field in fields:
        nodes = factors[0] @ rng.standard_normal([f.shape[1] for f in factors]) @ factors[1].T
        field[:] = RectBivariateSpline(axes[0], axes[1], nodes).ev(north, east)
    return fields


def _lattice(x: Array, scale: float) -> Array:
    step = scale / _NODES_PER_SCALE
    low = float(x.min()) - _MARGIN * step
    high = float(x.max()) + _MARGIN * step
    count = math.ceil((high - low) / step) + 1
    if count > _MAX_NODES:
        raise OceanError(
            f"random field: horizontal_scale {scale:g} m needs {count} nodes across the window; the"
            f" limit is {_MAX_NODES}; use at least {scale * count / _MAX_NODES:.0f} m or a smaller"
            " window"
        )
    return np.asarray(low + step * np.arange(count), dtype=float)


def _factor(axis: Array, scale: float) -> Array:
    correlation = np.exp(-0.5 * ((axis[:, None] - axis) / scale) ** 2)
    values, vectors = np.linalg.eigh(correlation)
    true = values > 1e-12 * values[-1]  # smaller eigenvalues are rounding errors
    return np.asarray(vectors[:, true] * np.sqrt(values[true]))


def pooled_rms(ocean: xr.Dataset, variance: Array, down_to: float | None) -> float:
    """
    Square root of the mean over the water of a variance that depends on depth.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean. Weights are the thickness of layers times their numbers of wet points.
    variance : ndarray, shape (depth,)
        [m²/s²]
    down_to : float or None
        Depth limit of the mean; None for the sea bed. [m]

    Returns
    -------
    float
        [m/s]

    Raises
    ------
    OceanError
        If the mean is zero.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import pooled_rms
    >>> pooled_rms(ocean, np.full(ocean["depth"].size, 0.25), down_to=500.0)
    0.5
    """
    z = np.asarray(ocean["depth"].values, dtype=float)
    edges = np.minimum(layer_edges(z), np.inf if down_to is None else down_to)
    weight = np.diff(edges) * np.isfinite(ocean["water_temp"].values).sum(axis=(1, 2))
    pooled = float(np.sqrt(np.sum(weight * variance) / np.sum(weight)))
    if not pooled > 0.0:
        raise OceanError(
            "perturbation: the modes are zero above down_to; use other modes or a greater down_to"
        )
    return pooled


def change_sound_speed(
    ocean: xr.Dataset, change: ArrayLike, *, equation: Equation = "teos-10"
) -> xr.Dataset:
    """
    Change the sound speed of an ocean by amounts (depth, lat, lon) [m/s], exact within 1e-6 m/s.

    The function changes temperature. Where temperature reaches the limit of a valid ocean, it also
    changes salinity.
    """
    depth, lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values)
    k, y, x = np.nonzero(wet)
    start = np.asarray(ocean["water_temp"].values, dtype=float)[wet]
    salinity = np.asarray(ocean["salinity"].values, dtype=float)[wet]

    # absolute salinity is proportional to practical salinity, and slow to compute
    if equation == "teos-10":
        SA, _, p = absolute_and_conservative(start, salinity, depth[k], lat[y], lon[x])

    def speed(t: Array, share: Array) -> Array:
        """Sound speed at a temperature and a fraction of the salinity."""
        if equation == "teos-10":
            return np.asarray(gsw.sound_speed(SA * share, gsw.CT_from_t(SA * share, t, p), p))
        return sound_speed(t, salinity * share, depth[k], lat[y], lon[x], equation=equation)

    full = np.ones(start.size)
    target = speed(start, full) + np.broadcast_to(np.asarray(change, dtype=float), wet.shape)[wet]
    temperature = _root(lambda t: speed(t, full), start, target)
    possible = np.clip(temperature, VARIABLES[0].lowest, VARIABLES[0].highest)
    fields = {"water_temp": possible}
    beyond = possible != temperature
    if beyond.any():
        fresh = 0.0 * full
        share = _root(
            lambda s: speed(possible, s),
            full,
            np.where(beyond, target, speed(possible, full)),
            fresh,
            _MAX_SALINITY_FACTOR * full,
        )
        fields["salinity"] = np.where(beyond, salinity * share, salinity)
    changed = ocean.copy()
    for name, values in fields.items():
        field = np.full(wet.shape, np.nan)
        field[wet] = values
        changed[name] = ocean[name].copy(data=field)
    try:
        validate_ocean(changed)
    except OceanError as error:
        raise OceanError(
            f"{error} (after a change of sound speed; reduce rms, or limit it to the upper water"
            " with down_to)"
        ) from None
    return changed


def _root(
    speed: Callable[[Array], Array],
    start: Array,
    target: Array,
    low: Array | float = -np.inf,
    high: Array | float = np.inf,
) -> Array:
    """
    Solve speed(argument) = target within bounds, element by element, with the secant method from
    start.
    """
    with np.errstate(all="ignore"):
        base = speed(start)
        slope = (speed(start + _STEP) - base) / _STEP
        value = start
        off = target - base
        for _ in range(_ITERATIONS):
            if np.abs(off).max(initial=0.0) < _ACCURACY:
                return value
            step = np.clip(value + off / slope, low, high) - value
            value = value + step
            before = off
            off = target - speed(value)
            moved = np.abs(step) > 1e-6
            slope = np.where(moved, (before - off) / step, slope)
    raise OceanError(
        "ocean: no temperature or salinity changes sound speed by"
        f" {np.nanmax(np.abs(target - base)):.3g} m/s; reduce the change"
    )
