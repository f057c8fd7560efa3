"""Absorption coefficient at any place of an ocean, from its temperature and salinity."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.absorption import (
    ainslie_mccolm_db_per_km,
    francois_garrison_db_per_km,
    thorp_db_per_km,
)
from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
Formula = Literal["francois-garrison", "ainslie-mccolm"]
Water = Callable[[Array], tuple[Array, Array]]
"""In-situ temperature [degC] and salinity at positions (n, 3)."""

_FORMULAS: dict[str, Callable[..., Array]] = {
    "francois-garrison": francois_garrison_db_per_km,
    "ainslie-mccolm": ainslie_mccolm_db_per_km,
}


@dataclass(frozen=True, eq=False)
class Absorption:
    """
    Absorption coefficient at any place; build it with one of the class methods.

    Attributes
    ----------
    db_per_km : callable
        Of positions (n, 3) north, east, down [m] and a frequency [Hz]; gives (n,) [dB/km].
    """

    db_per_km: Callable[[Array, float], Array]

    @classmethod
    def constant(cls, db_per_km: float) -> Self:
        """
        One coefficient everywhere, at every frequency.

        Parameters
        ----------
        db_per_km : float
            Not negative. [dB/km]

        Returns
        -------
        Absorption

        Raises
        ------
        AcousticsError
            If the coefficient is negative or not finite.
        """
        if not 0.0 <= db_per_km < np.inf:
            raise AcousticsError(f"absorption: {db_per_km} dB/km; must be finite and not negative")
        return cls(lambda position, _frequency: np.full(len(position), float(db_per_km)))

    @classmethod
    def thorp(cls) -> Self:
        """
        Thorp's formula: the same everywhere, whatever the water.

        Returns
        -------
        Absorption
        """
        return cls(lambda position, frequency: np.full(len(position), float(thorp_db_per_km(frequency))))

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
        Water that varies with depth only.

        Parameters
        ----------
        depth, temperature, salinity : array_like, shape (n_depth,)
            Levels, strictly increasing [m], in-situ temperature [degC], practical salinity; linear between
            the levels, constant beyond them. One level is uniform water.
        pH : float
            [-]
        formula : {"francois-garrison", "ainslie-mccolm"}

        Returns
        -------
        Absorption

        Raises
        ------
        AcousticsError
            If the shapes differ, a value is not finite, the levels do not increase or the formula is unknown.
        """
        z, T, S = (np.atleast_1d(np.array(v, dtype=float)) for v in (depth, temperature, salinity))
        if z.ndim != 1 or not z.shape == T.shape == S.shape:
            raise AcousticsError(
                f"depth, temperature, salinity: shapes {z.shape}, {T.shape}, {S.shape}; need (n_depth,)"
            )
        if not np.all(np.isfinite([z, T, S])) or np.any(np.diff(z) <= 0.0):
            raise AcousticsError(
                "depth, temperature, salinity: must be finite, and depth strictly increasing"
            )
        return cls._of_water(
            lambda x: (np.interp(x[:, 2], z, T), np.interp(x[:, 2], z, S)), pH=pH, formula=formula
        )

    @classmethod
    def from_dataset(
        cls,
        ocean: "xr.Dataset",
        *,
        centre: tuple[float, float] | None = None,
        pH: float = 8.0,
        formula: Formula = "francois-garrison",
    ) -> Self:
        """
        Water of an ocean data set, linear between its grid points and constant beyond its edges.

        Parameters
        ----------
        ocean : xarray.Dataset
            With ``water_temp`` and ``salinity`` on (depth, lat, lon) as `open_ocean` returns it, or on
            (north, east, depth) of the local frame.
        centre : tuple of float, optional
            Latitude and longitude of the local frame, as for `to_local`: the window's middle by default.
            [degrees]
        pH : float
            [-]
        formula : {"francois-garrison", "ainslie-mccolm"}

        Returns
        -------
        Absorption

        Raises
        ------
        AcousticsError
            If the data set lacks temperature or salinity, or the formula is unknown.
        """
        missing = [name for name in ("water_temp", "salinity") if name not in ocean]
        if missing:
            raise AcousticsError(
                f"ocean data set lacks {', '.join(missing)};"
                " give the one that open_ocean returned, before to_local"
            )
        water = _geographic_water(ocean, centre) if "lat" in ocean.dims else _local_water(ocean)
        return cls._of_water(water, pH=pH, formula=formula)

    @classmethod
    def _of_water(cls, water: Water, *, pH: float, formula: Formula) -> Self:
        if formula not in _FORMULAS:
            raise AcousticsError(f"absorption formula {formula!r}; allowed are {', '.join(_FORMULAS)}")

        def coefficient(position: Array, frequency_hz: float) -> Array:
            T, S = water(position)
            return _FORMULAS[formula](frequency_hz, temperature=T, salinity=S, depth=position[:, 2], pH=pH)

        return cls(coefficient)


def _geographic_water(ocean: "xr.Dataset", centre: tuple[float, float] | None) -> Water:
    from scipy.interpolate import RegularGridInterpolator

    from pymantaray.geometry import LocalFrame
    from pymantaray.ocean.sea_floor import fill_below_sea_bed
    from pymantaray.ocean.window import Window

    lat, lon, depth = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth"))
    middle = (0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1]))
    window = Window(lat, lon, LocalFrame(*(middle if centre is None else centre)))
    fields = [
        fill_below_sea_bed(ocean[name].transpose("depth", "lat", "lon").values, lat)
        for name in ("water_temp", "salinity")
    ]
    look_up = RegularGridInterpolator((depth, lat, lon), np.stack(fields, axis=-1))

    def water(x: Array) -> tuple[Array, Array]:
        at = (x[:, 2], *window.geographic(x[:, 0], x[:, 1]))
        values = look_up(
            np.stack([np.clip(v, a[0], a[-1]) for v, a in zip(at, (depth, lat, lon), strict=True)], -1)
        )
        return values[:, 0], values[:, 1]

    return water


def _local_water(ocean: "xr.Dataset") -> Water:
    from scipy.interpolate import RegularGridInterpolator

    names = ("north", "east", "depth")
    axes = [np.asarray(ocean[name].values, dtype=float) for name in names]
    fields = np.stack([ocean[v].transpose(*names).values for v in ("water_temp", "salinity")], axis=-1)
    for i, axis in enumerate(axes):
        if axis.size == 1:  # one point means no variation along it
            axes[i], fields = np.array([axis[0], axis[0] + 1.0]), np.repeat(fields, 2, axis=i)
    if not np.all(np.isfinite(fields)):
        raise AcousticsError(
            "ocean data set: water_temp or salinity is not finite; fill it below the sea bed"
        )
    look_up = RegularGridInterpolator(axes, fields.astype(float))

    def water(x: Array) -> tuple[Array, Array]:
        values = look_up(np.stack([np.clip(v, a[0], a[-1]) for v, a in zip(x.T, axes, strict=True)], -1))
        return values[:, 0], values[:, 1]

    return water
