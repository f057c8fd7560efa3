"""
Absorption of sound by sea water: three published formulas, and the coefficient at any position in
an ocean.

The theory page on loss has the formulas, their data, a comparison, and the sources.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.quantities.checks import check_number, checked_array

if TYPE_CHECKING:
    import xarray as xr

    from pymantaray.ocean.window import Window

Formula = Literal["francois-garrison", "ainslie-mccolm"]
"""Formula of the water's properties."""


@dataclass(frozen=True, eq=False)
class Absorption:
    """
    Absorption coefficient at any position; build it with one of the class methods.

    Attributes
    ----------
    db_per_km : callable
        Function of positions (n, 3) north, east, down [m] and a frequency [Hz] that returns (n,)
        coefficients. [dB/km]

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.acoustics import Absorption
    >>> absorption = Absorption.from_profile([0.0, 1000.0], [-1.0, 0.5], [28.0, 34.9])
    >>> print(absorption.db_per_km(np.array([[0.0, 0.0, 100.0]]), 25e3).round(2))
    [5.]
    """

    db_per_km: Callable[[Array, float], Array]

    @classmethod
    def constant(cls, db_per_km: float) -> Self:
        """
        Return absorption with a constant coefficient.

        Parameters
        ----------
        db_per_km : float
            Coefficient. [dB/km]

        Returns
        -------
        Absorption
        """
        check_number(AcousticsError, "absorption", db_per_km, "dB/km")
        return cls(partial(_everywhere, float(db_per_km)))

    @classmethod
    def thorp(cls) -> Self:
        """Return absorption by Thorp's formula, which does not depend on the water."""
        return cls(_thorp)

    @classmethod
    def from_profile(
        cls,
        depth: ArrayLike,
        temperature: ArrayLike,
        salinity: ArrayLike,
        *,
        pH: float = 8.0,
        formula: Formula = "francois-garrison",
    ) -> Self:
        """
        Return absorption in water that varies with depth only.

        Parameters
        ----------
        depth, temperature, salinity : array_like, shape (n_depth,)
            Levels in strictly increasing order, in-situ temperature and practical salinity, which
            are linear between the levels and constant beyond them. One level is uniform water. [m,
            degC, -]
        pH : float
            pH on the NBS scale. [-]
        formula : {"francois-garrison", "ainslie-mccolm"}
        """
        z = checked_array(AcousticsError, "depth", np.atleast_1d(depth), (None,), rising=True)
        T = checked_array(AcousticsError, "temperature", np.atleast_1d(temperature), z.shape)
        S = checked_array(AcousticsError, "salinity", np.atleast_1d(salinity), z.shape)
        check_number(AcousticsError, "salinity", S.min())
        column = linear_interpolator([z], np.stack([T, S], axis=-1))
        return cls._of_water(partial(_at_depth, column), pH=pH, formula=formula)

    @classmethod
    def from_dataset(
        cls,
        ocean: xr.Dataset,
        *,
        centre: tuple[float, float] | None = None,
        pH: float = 8.0,
        formula: Formula = "francois-garrison",
    ) -> Self:
        """
        Return absorption in an ocean data set, linear between its grid points and constant beyond
        its edges.

        Parameters
        ----------
        ocean : xarray.Dataset
            Data set from `open_ocean`, with ``water_temp`` and ``salinity`` on (depth, lat, lon).
        centre : tuple of float, optional
            Latitude and longitude of the local frame, as for `to_local`. Default: the middle of the
            window. [degrees]
        pH, formula
            As in `from_profile`.
        """
        from pymantaray.ocean.sea_floor import fill_below_sea_bed
        from pymantaray.ocean.window import Window

        names = ("water_temp", "salinity")
        missing = [name for name in names if name not in ocean]
        if missing:
            raise AcousticsError(
                f"ocean data set lacks {', '.join(missing)}; use the data set from open_ocean,"
                " before to_local"
            )
        window = Window.of(ocean, centre)
        lat = window.lat
        lon = window.lon
        fields = [
            fill_below_sea_bed(ocean[name].transpose("depth", "lat", "lon").values, lat)
            for name in names
        ]
        look_up = linear_interpolator((ocean["depth"].values, lat, lon), np.stack(fields, axis=-1))

        return cls._of_water(partial(_at_place, look_up, window), pH=pH, formula=formula)

    @classmethod
    def _of_water(cls, water: Callable[[Array], Array], *, pH: float, formula: Formula) -> Self:
        """
        Absorption from in-situ temperature [degC] and practical salinity (n, 2) at positions (n,
        3).
        """
        if formula not in _FORMULAS:
            raise AcousticsError(f"absorption formula {formula!r}; allowed: {', '.join(_FORMULAS)}")

        return cls(partial(_by_formula, _FORMULAS[formula], pH, water))


# module-level functions, so an absorption can be pickled for another process


def _everywhere(db_per_km: float, position: Array, _frequency: float) -> Array:
    return np.full(len(position), db_per_km)


def _thorp(position: Array, frequency: float) -> Array:
    return np.full(len(position), float(thorp_db_per_km(frequency)))


def _at_depth(column: Callable[[Array], Array], position: Array) -> Array:
    return column(position[:, 2:])


def _at_place(look_up: Callable[[Array], Array], window: Window, position: Array) -> Array:
    return look_up(
        np.stack([position[:, 2], *window.geographic(position[:, 0], position[:, 1])], axis=-1)
    )


def _by_formula(
    formula: Callable[..., Array],
    pH: float,
    water: Callable[[Array], Array],
    position: Array,
    frequency: float,
) -> Array:
    T, S = water(position).T
    return formula(frequency, temperature=T, salinity=S, depth=position[:, 2], pH=pH)


def francois_garrison_db_per_km(
    frequency_hz: ArrayLike,
    *,
    temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    pH: ArrayLike = 8.0,
) -> Array:
    """
    Absorption by boric acid, magnesium sulphate and water itself, after Francois and Garrison
    (1982). [dB/km]

    Frequency [Hz], in-situ temperature [degC], practical salinity, depth [m] and pH on the NBS
    scale broadcast.
    """
    hz, T, S, z, ph = (
        np.asarray(v, dtype=float) for v in (frequency_hz, temperature, salinity, depth, pH)
    )
    f = hz / 1000.0
    c = 1412.0 + 3.21 * T + 1.19 * S + 0.0167 * z
    kelvin = 273.0 + T  # the paper's
    f1 = 2.8 * np.sqrt(S / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)
    f2 = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (S - 35.0))
    a1 = 8.86 / c * 10.0 ** (0.78 * ph - 5.0)
    a2 = 21.44 * S / c * (1.0 + 0.025 * T)
    cold = 4.937e-4 + T * (-2.59e-5 + T * (9.11e-7 - 1.50e-8 * T))
    warm = 3.964e-4 + T * (-1.146e-5 + T * (1.45e-7 - 6.5e-10 * T))
    a3 = np.where(T <= 20.0, cold, warm)
    p2 = 1.0 + z * (-1.37e-4 + 6.2e-9 * z)
    p3 = 1.0 + z * (-3.83e-5 + 4.9e-10 * z)
    # fresh water has no boric acid: with f1 = 0 its term is 0; f2 is always positive
    boric = a1 * f1 / (f1**2 + f**2)
    sulphate = a2 * p2 * f2 / (f2**2 + f**2)
    return np.asarray((boric + sulphate + a3 * p3) * f**2)


def ainslie_mccolm_db_per_km(
    frequency_hz: ArrayLike,
    *,
    temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    pH: ArrayLike = 8.0,
) -> Array:
    """
    Absorption by the simplified formula of Ainslie and McColm (1998), arguments as above. [dB/km]

    The formula is a fit to that of Francois and Garrison within 10 %.
    """
    hz, T, S, z, ph = (
        np.asarray(v, dtype=float) for v in (frequency_hz, temperature, salinity, depth, pH)
    )
    f = hz / 1000.0
    km = z / 1000.0
    f1 = 0.78 * np.sqrt(S / 35.0) * np.exp(T / 26.0)
    f2 = 42.0 * np.exp(T / 17.0)
    boric = 0.106 * f1 / (f1**2 + f**2) * np.exp((ph - 8.0) / 0.56)
    sulphate = 0.52 * (1.0 + T / 43.0) * (S / 35.0) * f2 / (f2**2 + f**2) * np.exp(-km / 6.0)
    water = 0.00049 * np.exp(-(T / 27.0 + km / 17.0))
    return np.asarray((boric + sulphate + water) * f**2)


def thorp_db_per_km(frequency_hz: ArrayLike) -> Array:
    """
    Absorption by Thorp's formula in the form of Jensen et al. and Bellhop at a frequency [Hz].
    [dB/km]

    It applies to about 4 degC and 1000 m. Thorp (1967) has only the two relaxations, 0.1 and 40 dB
    per kiloyard.
    """
    f = (np.asarray(frequency_hz, dtype=float) / 1000.0) ** 2
    return np.asarray(0.0033 + f * (0.11 / (1.0 + f) + 44.0 / (4100.0 + f) + 3.0e-4))


_FORMULAS: dict[str, Callable[..., Array]] = {
    "francois-garrison": francois_garrison_db_per_km,
    "ainslie-mccolm": ainslie_mccolm_db_per_km,
}
