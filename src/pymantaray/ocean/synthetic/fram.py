"""
Synthetic Fram Strait: polar outflow, Atlantic inflow and its recirculation, fronts and eddies.

Water masses follow the references beside each. Without a published value, temperature and salinity
of a core are rounded from the bottle casts of 1982. Tests against these casts therefore check the
construction and are not independent evidence. Only abstracts and excerpts of the papers were read;
[1] is cited from general knowledge of its classes.

References
----------
.. [1] Rudels, B. et al. (2005), The interaction between waters from the Arctic Ocean and the Nordic
   Seas north of Fram Strait and along the East Greenland Current: results from the Arctic Ocean-02
   Oden expedition, J. Mar. Syst. 55, 1-30.
.. [2] Rudels, B., Meyer, R., Fahrbach, E., Ivanov, V. V., Østerhus, S., Quadfasel, D., Schauer, U.,
   Tverberg, V. and Woodgate, R. A. (2000), Water mass distribution in Fram Strait and over the
   Yermak Plateau in summer 1997, Ann. Geophys. 18, 687-705.
.. [3] Beszczynska-Möller, A., Fahrbach, E., Schauer, U. and Hansen, E. (2012), Variability in
   Atlantic water temperature and transport at the entrance to the Arctic Ocean, 1997-2010, ICES J.
   Mar. Sci. 69, 852-863.
.. [4] Richter, M. E., von Appen, W.-J. and Wekerle, C. (2018), Does the East Greenland Current
   exist in the northern Fram Strait?, Ocean Sci. 14, 1147-1165.
.. [5] Hofmann, Z., von Appen, W.-J. and Wekerle, C. (2021), Seasonal and mesoscale variability of
   the two Atlantic Water recirculation pathways in Fram Strait, J. Geophys. Res. Oceans 126.
.. [6] Wekerle, C., Hattermann, T., Wang, Q., Crews, L., von Appen, W.-J. and Danilov, S. (2020),
   Properties and dynamics of mesoscale eddies in Fram Strait from a comparison between two
   high-resolution ocean-sea ice models, Ocean Sci. 16, 1225-1246.
"""

import numpy as np

from pymantaray.arrays import Array
from pymantaray.ocean.synthetic.geostrophy import (
    GRAVITY,
    Eddy,
    Grid,
    coriolis,
    eddy_fields,
    scattered,
)
from pymantaray.ocean.synthetic.watermass import WaterColumn, WaterMass

# deep waters: saltier and warmer from the Eurasian Basin, fresher and colder from the Greenland Sea
# [1]
_EURASIAN_DEEP = (
    WaterMass("upper polar deep water", 1_200.0, -0.58, 34.905),
    WaterMass("Eurasian Basin deep water", 1_800.0, -0.84, 34.92),
    WaterMass("Eurasian Basin deep water", 2_600.0, -0.95, 34.927),
    WaterMass("Eurasian Basin bottom water", 5_000.0, -0.97, 34.932),
)
_POLAR = WaterColumn(
    "East Greenland Current",
    (
        WaterMass("polar surface water, melt", 0.0, -1.2, 31.8),
        WaterMass("polar surface water, winter remnant", 40.0, -1.70, 33.0),
        WaterMass("lower halocline", 110.0, -1.30, 34.1),
        WaterMass("top of the Atlantic layer", 170.0, 0.1, 34.60),
        WaterMass("Arctic Atlantic Water", 280.0, 1.0, 34.87),  # 0 to 2 degC [1, 4]
        WaterMass("Arctic Atlantic Water, lower", 550.0, 0.35, 34.89),
        WaterMass("upper polar deep water", 850.0, -0.25, 34.895),
        *_EURASIAN_DEEP,
    ),
)
_CENTRAL = WaterColumn(
    "northern Greenland Sea",
    (
        WaterMass("polar surface water, warm", 0.0, 2.2, 34.2),  # theta above 0, light [1]
        WaterMass("seasonal pycnocline", 28.0, 0.9, 34.6),
        WaterMass("winter mixed layer", 80.0, -0.40, 34.84),
        WaterMass("Arctic intermediate water, upper", 250.0, -0.50, 34.872),
        WaterMass("Arctic intermediate water", 600.0, -0.74, 34.886),
        WaterMass("Nordic Seas deep water, upper", 1_200.0, -1.00, 34.901),
        WaterMass("Nordic Seas deep water", 1_800.0, -1.10, 34.904),
        WaterMass("Nordic Seas deep water", 2_600.0, -1.18, 34.905),
        WaterMass("Nordic Seas bottom water", 5_000.0, -1.20, 34.908),
    ),
)
_RECIRCULATION = WaterColumn(
    "recirculating Atlantic Water",
    (
        WaterMass("warm polar surface water", 0.0, 2.8, 34.2),
        WaterMass("seasonal pycnocline", 28.0, 2.0, 34.65),
        WaterMass("Atlantic Water, upper", 90.0, 2.15, 34.93),
        WaterMass("Atlantic Water", 190.0, 2.05, 34.97),  # above 2 degC [1]
        WaterMass("Atlantic Water, lower", 330.0, 1.35, 34.945),
        WaterMass("Atlantic Water, base", 520.0, 0.35, 34.910),
        WaterMass("intermediate water", 800.0, -0.35, 34.897),
        *_EURASIAN_DEEP,
    ),
)
_INFLOW = WaterColumn(
    "West Spitsbergen Current",
    (
        WaterMass("summer surface layer", 0.0, 5.4, 34.75),
        WaterMass("Atlantic Water, upper", 45.0, 4.5, 35.00),
        WaterMass("Atlantic Water", 140.0, 3.7, 35.06),  # inflow mean 3.1 degC, core warmer [3]
        WaterMass("Atlantic Water, lower", 350.0, 2.5, 35.01),
        WaterMass("Atlantic Water, base", 600.0, 0.9, 34.935),
        WaterMass("intermediate water", 850.0, -0.30, 34.90),
        *_EURASIAN_DEEP,
    ),
)

_DAY = 86_400.0
_COUNT = 30
HALF_BOX = (240e3, 300e3)
"""Half extents (north, east) of the eddies' periodic box: the window plus four radii. [m]"""
_POLAR_FRONT = -95e3  # m east of the centre, over the upper Greenland slope
_POLAR_WIDTH = 32e3
_INFLOW_FRONT = 130e3  # m east, off the Svalbard slope
_INFLOW_WIDTH = 34e3
_RECIRCULATION_FRONT = 40e3  # m north: none at 78 10' N, steady at 78 50' N [5]
_RECIRCULATION_WIDTH = 34e3
_OUTFLOW_SPEED = -0.03  # m/s north, constant over depth
_INFLOW_SPEED = 0.06
_EDDY_DRIFT = 3.5e3 / _DAY  # 35 km within a lifetime of 10 days [6]


def _eddies() -> tuple[Eddy, ...]:
    """
    Make alternating anticyclones and cyclones with radii that a grid of 2 to 4 km resolves.

    In models with a resolution of 1 km, the mean radius is near 5 km and cyclones are slightly more
    frequent [6].
    """
    eddies = []
    for i, ((a, b), (c, d, e)) in enumerate(
        zip(scattered(_COUNT, 2), scattered(_COUNT, 3), strict=True)
    ):
        anticyclone = i % 2 == 0
        eddies.append(
            Eddy(
                north=(2.0 * a - 1.0) * HALF_BOX[0],
                east=(2.0 * b - 1.0) * HALF_BOX[1],
                drift_north=0.5 * _EDDY_DRIFT * (2.0 * d - 1.0),
                drift_east=-_EDDY_DRIFT * (0.5 + e),  # westward, like the recirculation
                radius=10e3 + 7e3 * c,
                core_depth=200.0 + 120.0 * d if anticyclone else 60.0 + 40.0 * d,
                half_thickness=160.0 if anticyclone else 45.0,
                heave=30.0 if anticyclone else -20.0,
                foreign_fraction=0.9 if anticyclone else 0.0,
                from_surface=True,
            )
        )
    return tuple(eddies)


EDDIES = _eddies()
"""Positions of the eddies at the epoch, and their drift."""


def _meander(north: Array, elapsed: float) -> Array:
    """Eastward displacement of a front: two waves that travel south with the outflow. [m]"""
    days = elapsed / _DAY
    long = 7e3 * np.sin(2.0 * np.pi * (north / 110e3 + days / 28.0))
    short = 4e3 * np.sin(2.0 * np.pi * (north / 63e3 + days / 13.0) + 1.0)
    return np.asarray(long + short)


def _step(x: Array, width: float) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(x / width)))


def water(grid: Grid, elapsed: float) -> Array:
    """
    Potential temperature [degC] and practical salinity (depth, lat, lon, 2) at a time since the
    epoch [s].
    """
    heave, fraction = eddy_fields(EDDIES, elapsed, grid, HALF_BOX)
    origin = grid.depth[:, None, None] - heave
    shift = _meander(grid.north, elapsed)
    east_of_polar = _step(grid.east - _POLAR_FRONT - 0.25 * grid.north - shift, _POLAR_WIDTH)
    inflow = _step(grid.east - _INFLOW_FRONT + 0.15 * grid.north - 0.6 * shift, _INFLOW_WIDTH)
    wave = 6e3 * np.sin(2.0 * np.pi * (grid.east / 90e3 + elapsed / (20.0 * _DAY)))
    recirculation = _step(grid.north - _RECIRCULATION_FRONT - wave, _RECIRCULATION_WIDTH)
    between = east_of_polar * (1.0 - inflow)
    atlantic = _RECIRCULATION.evaluate(origin)
    mixed = (
        ((1.0 - east_of_polar) * (1.0 - inflow))[..., None] * _POLAR.evaluate(origin)
        + (between * (1.0 - recirculation))[..., None] * _CENTRAL.evaluate(origin)
        + (between * recirculation)[..., None] * atlantic
        + inflow[..., None] * _INFLOW.evaluate(origin)
    )
    # eddies from the inflow carry Atlantic water, which does not differ from the two boundary
    # currents
    foreign = (fraction * between)[..., None]
    return np.asarray((1.0 - foreign) * mixed + foreign * atlantic)


def floor(grid: Grid) -> Array:
    """
    Depth of the sea bed: Greenland shelf, deep passage with a rise in the north, Svalbard slope.
    [m]
    """
    greenland = _step(-(grid.east + 118e3 - 0.15 * grid.north), 26e3)
    svalbard = _step(grid.east - 205e3 + 0.25 * grid.north, 26e3)
    rise = np.exp(
        -0.5 * ((grid.north - 115e3) / 32e3) ** 2 - 0.5 * ((grid.east - 25e3) / 60e3) ** 2
    )
    knoll = np.exp(-0.5 * ((grid.north + 100e3) ** 2 + (grid.east - 110e3) ** 2) / 22e3**2)
    deep = 3_200.0 - 800.0 * rise - 1_100.0 * knoll
    return np.asarray(
        deep - (deep - 280.0) * greenland - (deep - 300.0) * (1.0 - greenland) * svalbard
    )


def reference_height(grid: Grid) -> Array:
    """Sea surface height whose slope drives the two boundary currents at all depths. [m]"""
    metres_per_speed = coriolis(np.asarray(78.0)) / GRAVITY
    outflow = 40e3 * np.tanh((grid.east + 110e3 - 0.2 * grid.north) / 40e3)
    inflow = 35e3 * np.tanh((grid.east - 175e3 + 0.2 * grid.north) / 35e3)
    return np.asarray(metres_per_speed * (_OUTFLOW_SPEED * outflow + _INFLOW_SPEED * inflow))
