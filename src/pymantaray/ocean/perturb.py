"""Oceans that are believed instead of the true one: random members, the mean, or one column everywhere."""

from typing import Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import wrapped
from pymantaray.ocean.modes import SoundSpeedCovariance, VerticalModes, vertical_modes
from pymantaray.ocean.random_field import pooled_rms, random_fields
from pymantaray.ocean.schema import VARIABLES, validate_ocean, with_history
from pymantaray.ocean.seawater import Equation
from pymantaray.ocean.sound_speed_change import change_sound_speed

Array = NDArray[np.float64]
Method = Literal["eof", "gaussian-process", "mean", "column"]


def perturb_ocean(
    ocean: xr.Dataset,
    method: Method,
    *,
    rms: float | None = None,
    horizontal_scale: float | None = None,
    vertical_scale: float | None = None,
    rng: np.random.Generator | None = None,
    modes: VerticalModes | None = None,
    n_modes: int | None = None,
    spread: tuple[ArrayLike, ArrayLike] | None = None,
    down_to: float | None = None,
    place: tuple[float, float] | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    One ocean that differs from the given one as a belief might.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    method : {"eof", "gaussian-process", "mean", "column"}
        Random errors in the vertical modes of sound speed; random errors with a Gaussian correlation in
        depth; the horizontal mean of each level; the column at a place everywhere, at rest, as one cast at the
        start would give. The model of another day needs no method: open the same source at another time.
    rms : float
        Of the random errors' sound speed, pooled over the water and all members. [m/s]
    horizontal_scale : float
        L of the random errors' correlation exp(-d²/2L²); infinite for the same error everywhere. [m]
    vertical_scale : float
        The same in depth, for ``gaussian-process``. [m]
    rng : numpy.random.Generator
        For the random methods: one member for each state of it. A study's come from
        `pymantaray.geometry.streams.stream`.
    modes : VerticalModes, optional
        For ``eof``, for example of casts. Default: those of this ocean's own columns.
    n_modes : int, optional
        For ``eof`` without ``modes``: how many.
    spread : tuple of array_like, optional
        For ``gaussian-process``: depths [m] and the relative standard deviation there, linear between them and
        constant beyond. Default: the same at all depths.
    down_to : float, optional
        Depth down to which ``rms`` is pooled. Default: the sea bed. [m]
    place : tuple of float
        For ``column``: latitude and longitude; the nearest wet grid point is taken. [degrees]
    equation : {"teos-10", "del-grosso", "unesco"}
        Of the sound speed that changes.

    Returns
    -------
    xarray.Dataset
        A valid ocean with the same grid and sea bed; what was done is in its history.

    Raises
    ------
    OceanError
        If the method is unknown, an argument that it needs is missing or one is given that it does not take, or
        the result is no valid ocean.

    Notes
    -----
    A random member has sound speed c + s Σ a_k φ_k(z), the a_k being independent Gaussian fields of variance
    v_k, φ_k and v_k modes and variances of `VerticalModes` or of the covariance `SoundSpeedCovariance.gaussian`.
    The factor s makes the expected mean square, each wet grid point weighted by its layer's thickness, ``rms``
    squared; a single member's differs, the more so the longer the scales. Temperature is changed (`change_sound_speed`), until sound
    speed is right within 1e-6 m/s; currents stay, and so density no longer balances them. The
    same generator state gives errors in proportion to ``rms``. Water may come out colder than its freezing
    point: it is a belief.
    """
    validate_ocean(ocean)
    _check_arguments(
        method,
        {"rms": rms, "horizontal_scale": horizontal_scale, "vertical_scale": vertical_scale, "rng": rng}
        | {"modes": modes, "n_modes": n_modes, "spread": spread, "down_to": down_to, "place": place},
    )
    if method == "mean":
        return _horizontal_mean(ocean)
    if place is not None:
        return _column(ocean, place)
    depth = np.asarray(ocean["depth"].values, dtype=float)
    if method == "eof":
        taken = vertical_modes(ocean, n_modes=n_modes, equation=equation) if modes is None else modes
        shapes, variance = taken.at(depth), taken.variance
        told = f"{variance.size} vertical modes"
    else:
        sigma = (
            np.ones_like(depth)
            if spread is None
            else np.interp(depth, np.asarray(spread[0], dtype=float), np.asarray(spread[1], dtype=float))
        )
        shapes, variance = SoundSpeedCovariance.gaussian(
            depth, rms=sigma, vertical_scale=_given(vertical_scale), horizontal_scale=1.0
        ).principal()
        told = f"a Gaussian process of vertical scale {vertical_scale:g} m"
    factor = _given(rms) / pooled_rms(ocean, variance @ shapes**2, down_to)
    assert rng is not None  # checked above; for the type checker
    fields = random_fields(
        *(np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon")),
        count=variance.size,
        scale=_given(horizontal_scale),
        rng=rng,
    )
    error = factor * np.einsum("kz,kyx->zyx", np.sqrt(variance)[:, None] * shapes, fields)
    made = change_sound_speed(ocean, error, equation=equation)
    reach = "the water column" if down_to is None else f"the upper {down_to:g} m"
    return with_history(
        made,
        f"sound speed perturbed by {told}, expected {rms:g} m/s rms over {reach}, horizontal scale"
        f" {horizontal_scale:g} m, by temperature ({equation}); no longer in balance with the currents",
    )


def _check_arguments(method: str, given: dict[str, object]) -> None:
    needs = {
        "eof": ({"rms", "horizontal_scale", "rng"}, {"modes", "n_modes", "down_to"}),
        "gaussian-process": (
            {"rms", "horizontal_scale", "vertical_scale", "rng"},
            {"spread", "down_to"},
        ),
        "mean": (set(), set()),
        "column": ({"place"}, set()),
    }
    if method not in needs:
        raise OceanError(f"perturbation {method!r} is unknown; allowed are {', '.join(get_args(Method))}")
    needed, allowed = needs[method]
    present = {name for name, value in given.items() if value is not None}
    if missing := sorted(needed - present):
        raise OceanError(f"perturbation {method}: {' and '.join(missing)} needed")
    if extra := sorted(present - needed - allowed):
        raise OceanError(f"perturbation {method}: takes no {' and no '.join(extra)}")
    for name in ("rms", "horizontal_scale", "vertical_scale", "down_to"):
        value = given[name]
        if isinstance(value, int | float) and not value > 0.0:
            raise OceanError(f"perturbation {method}: {name} is {value:g}; it must be positive")


def _given(value: float | None) -> float:
    assert value is not None  # checked before; for the type checker
    return float(value)


def _horizontal_mean(ocean: xr.Dataset) -> xr.Dataset:
    columns = {}
    for v in VARIABLES:
        field = np.asarray(ocean[v.name].values, dtype=float)
        wet = np.isfinite(field)
        count = wet.sum(axis=(1, 2))
        total = np.where(wet, field, 0.0).sum(axis=(1, 2))
        columns[v.name] = np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0)
    return with_history(
        _uniform(ocean, columns), "replaced by the horizontal mean of each level, currents too"
    )


def _column(ocean: xr.Dataset, place: tuple[float, float]) -> xr.Dataset:
    lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("lat", "lon"))
    middle = 0.5 * (lon[0] + lon[-1])
    at_lat, at_lon = place[0], wrapped(place[1], about=middle)
    if not (lat[0] <= at_lat <= lat[-1] and lon[0] <= at_lon <= lon[-1]):
        raise OceanError(
            f"perturbation column: {place[0]:g} N {place[1]:g} E is outside the ocean's window, latitude {lat[0]:g} to"
            f" {lat[-1]:g}, longitude {lon[0]:g} to {lon[-1]:g}"
        )
    wet = np.isfinite(ocean["water_temp"].values)
    apart = np.hypot(lat[:, None] - at_lat, (lon - at_lon) * np.cos(np.radians(at_lat)))
    i, j = np.unravel_index(int(np.argmin(np.where(wet[0], apart, np.inf))), apart.shape)
    columns = {}
    levels = int(wet[:, i, j].sum())
    for v in VARIABLES[:2]:
        column = np.array(ocean[v.name].values[:, i, j], dtype=float)
        column[levels:] = column[levels - 1]
        columns[v.name] = column
    columns |= {v.name: np.zeros(len(wet)) for v in VARIABLES[2:]}
    deepest = float(ocean["depth"].values[levels - 1])
    return with_history(
        _uniform(ocean, columns),
        f"replaced by the column at {lat[i]:g} N {lon[j]:g} E, at rest, carried down from {deepest:g} m where deeper",
    )


def _uniform(ocean: xr.Dataset, columns: dict[str, Array]) -> xr.Dataset:
    """Columns everywhere, down to the ocean's own sea bed."""
    wet = np.isfinite(ocean["water_temp"].values)
    made = ocean.copy()
    for name, column in columns.items():
        made[name] = ocean[name].copy(data=np.where(wet, column[:, None, None], np.nan))
    validate_ocean(made)
    return made
