"""
Synthetic Beaufort Sea: cold fresh cap, Pacific layers, Atlantic and deep water, halocline eddies.

Water masses follow the references beside each. If a paper gives a range, or a core varies between
years, the value is that of summer 2014. Without a published value, temperature and salinity of a
core are rounded from the casts of 2014 and 1997. Tests against these casts therefore check the
construction and are not independent evidence. Only abstracts and excerpts of the papers were read.

References
----------
.. [1] Steele, M., Morison, J., Ermold, W., Rigor, I., Ortmeyer, M. and Shimada, K. (2004),
   Circulation of summer Pacific halocline water in the Arctic Ocean, J. Geophys. Res. 109, C02027,
   doi:10.1029/2003JC002009.
.. [2] Shimada, K., Itoh, M., Nishino, S., McLaughlin, F., Carmack, E. and Proshutinsky, A. (2005),
   Halocline structure in the Canada Basin of the Arctic Ocean, Geophys. Res. Lett. 32, L03605,
   doi:10.1029/2004GL021358. Core salinities of Pacific Summer and Winter Water, 31.3 and 33.1: AGU
   Fall Meeting 2004, abstract 2004AGUFMOS41A0454S.
.. [3] Timmermans, M.-L., Proshutinsky, A., Golubeva, E., Jackson, J. M., Krishfield, R., McCall,
   M., Platov, G., Toole, J., Williams, W., Kikuchi, T. and Nishino, S. (2014), Mechanisms of
   Pacific Summer Water variability in the Arctic's Central Canada Basin, J. Geophys. Res. Oceans
   119, 7523-7548, doi:10.1002/2014JC010273.
.. [4] Timmermans, M.-L., Garrett, C. and Carmack, E. (2003), The thermohaline structure and
   evolution of the deep waters in the Canada Basin, Arctic Ocean, Deep-Sea Res. I 50, 1305-1321.
.. [5] Timmermans, M.-L., Toole, J., Proshutinsky, A., Krishfield, R. and Plueddemann, A. (2008),
   Eddies in the Canada Basin, Arctic Ocean, observed from ice-tethered profilers, J. Phys.
   Oceanogr. 38, 133-145.
.. [6] Zhao, M., Timmermans, M.-L., Cole, S., Krishfield, R., Proshutinsky, A. and Toole, J. (2014),
   Characterizing the eddy field in the Arctic Ocean halocline, J. Geophys. Res. Oceans 119,
   doi:10.1002/2014JC010488.
.. [7] Zhao, M. and Timmermans, M.-L. (2015), Vertical scales and dynamics of eddies in the Arctic
   Ocean's Canada Basin, J. Geophys. Res. Oceans 120, 8195-8209, doi:10.1002/2015JC011251.
"""

import numpy as np

from pymantaray.arrays import Array
from pymantaray.ocean.synthetic.geostrophy import Eddy, Grid, eddy_fields, scattered
from pymantaray.ocean.synthetic.watermass import WaterColumn, WaterMass

_CAP = (
    WaterMass("summer melt water", 0.0, -1.20, 27.2),
    WaterMass("mixed layer", 18.0, -1.27, 27.5),
    WaterMass("remnant of the winter mixed layer", 40.0, -1.28, 28.4),
)
_BELOW_PACIFIC_SUMMER = (
    WaterMass("Pacific Winter Water, upper", 130.0, -1.33, 32.5),
    WaterMass("Pacific Winter Water", 185.0, -1.49, 33.1),  # S 33.1 [2]
    WaterMass("lower halocline water", 250.0, -0.80, 34.2),  # [2]
    WaterMass("top of the Atlantic layer", 300.0, 0.0, 34.56),  # 0 degC by convention
    WaterMass("Atlantic Water, upper", 370.0, 0.55, 34.78),
    WaterMass("Atlantic Water, temperature maximum", 470.0, 0.69, 34.855),
    WaterMass("Atlantic Water, Barents Sea branch", 750.0, 0.27, 34.875),
    WaterMass("bottom of the Atlantic layer", 1000.0, -0.05, 34.89),
    WaterMass("upper deep water", 1500.0, -0.40, 34.92),
    WaterMass("Canada Basin deep water", 2000.0, -0.50, 34.945),
    WaterMass("deep temperature minimum", 2400.0, -0.524, 34.952),  # [4]
    WaterMass("homogeneous bottom layer", 2700.0, -0.514, 34.956),  # [4], uniform to the bottom
    WaterMass("homogeneous bottom layer", 5000.0, -0.514, 34.9562),
)
# Alaskan Coastal Water, S 31 to 32, cools away from Alaska; summer Bering Sea Water, S 32 to 33 [1,
# 3]
_SOUTH = WaterColumn(
    "southern Canada Basin",
    (
        *_CAP,
        WaterMass("Pacific Summer Water, Alaskan Coastal", 55.0, 0.40, 30.7),
        WaterMass("Pacific Summer Water, Bering Sea", 95.0, -0.98, 32.07),
        *_BELOW_PACIFIC_SUMMER,
    ),
)
_NORTH = WaterColumn(
    "central Canada Basin",
    (
        *_CAP,
        WaterMass("Pacific Summer Water, Alaskan Coastal", 58.0, -0.10, 30.8),
        WaterMass("Pacific Summer Water, Bering Sea", 95.0, -1.02, 32.07),
        *_BELOW_PACIFIC_SUMMER,
    ),
)
# cores of halocline eddies are anomalously cold, near freezing, at the halocline's own salinity [5,
# 6]
_EDDY_WATER = WaterColumn(
    "cold halocline eddy",
    (
        *_CAP,
        WaterMass("eddy core", 57.0, -1.45, 30.75),
        WaterMass("eddy core", 95.0, -1.50, 32.07),
        *_BELOW_PACIFIC_SUMMER,
    ),
)

_DAY = 86_400.0
_COUNT = 20
HALF_BOX = (230e3, 380e3)
"""Half extents (north, east) of the eddies' periodic box: the window plus four radii. [m]"""
_GYRE_CENTRE = (80e3, -290e3)  # near 75 N, 150 W
_GYRE_RADIUS = 350e3
_GYRE_HEAVE = 35.0  # m, of the halocline between the gyre's centre and its rim
_GYRE_DEPTH = 170.0  # m, depth of the largest displacement of the halocline
_GYRE_HEIGHT = 0.06  # m, sea surface height that the density does not explain


def _eddies() -> tuple[Eddy, ...]:
    """
    Make anticyclones, half of them in the upper halocline [5] and half in the Pacific Winter Water
    [7].
    """
    eddies = []
    for i, ((a, b), (c, d, e)) in enumerate(
        zip(scattered(_COUNT, 2), scattered(_COUNT, 3), strict=True)
    ):
        shallow = i % 2 == 0
        half_thickness = 20.0 if shallow else 60.0
        eddies.append(
            Eddy(
                north=(2.0 * a - 1.0) * HALF_BOX[0],
                east=(2.0 * b - 1.0) * HALF_BOX[1],
                drift_north=(-3.0 + 2.0 * (2.0 * d - 1.0)) * 1e3 / _DAY,
                drift_east=(-1.0 + 2.0 * (2.0 * e - 1.0)) * 1e3 / _DAY,
                radius=9e3 + 5e3 * c,  # deformation radius about 13 km in Canadian waters [6]
                core_depth=56.0 + 14.0 * d if shallow else 110.0 + 30.0 * d,
                half_thickness=half_thickness,
                heave=(0.45 + 0.10 * e) * half_thickness,
                foreign_fraction=0.8,
                from_surface=False,
            )
        )
    return tuple(eddies)


EDDIES = _eddies()
"""Positions of the eddies at the epoch, and their drift."""


def _gyre_distance_squared(grid: Grid) -> Array:
    return np.asarray((grid.north - _GYRE_CENTRE[0]) ** 2 + (grid.east - _GYRE_CENTRE[1]) ** 2)


def water(grid: Grid, elapsed: float) -> Array:
    """
    Potential temperature [degC] and practical salinity (depth, lat, lon, 2) at a time since the
    epoch [s].
    """
    heave, fraction = eddy_fields(EDDIES, elapsed, grid, HALF_BOX)
    bowl = np.exp(-0.5 * _gyre_distance_squared(grid) / _GYRE_RADIUS**2)
    at_centre = np.exp(-0.5 * (_GYRE_CENTRE[0] ** 2 + _GYRE_CENTRE[1] ** 2) / _GYRE_RADIUS**2)
    profile = grid.depth / _GYRE_DEPTH * np.exp(1.0 - grid.depth / _GYRE_DEPTH)
    heave = heave + _GYRE_HEAVE * profile[:, None, None] * (bowl - at_centre)
    origin = grid.depth[:, None, None] - heave
    south = 0.5 * (1.0 - np.tanh(grid.north / 110e3))[..., None]
    ambient = south * _SOUTH.evaluate(origin) + (1.0 - south) * _NORTH.evaluate(origin)
    share = fraction[..., None]
    return np.asarray((1.0 - share) * ambient + share * _EDDY_WATER.evaluate(origin))


def floor(grid: Grid) -> Array:
    """
    Depth of the sea bed: the plain of the Canada Basin, shallower to the south and towards Banks
    Island. [m]
    """
    south = 0.5 * (1.0 - np.tanh((grid.north + 130e3) / 45e3))
    banks = 0.5 * (1.0 + np.tanh((grid.east - 0.5 * grid.north - 270e3) / 55e3))
    return np.asarray(3_750.0 - 1_000.0 * south - 1_900.0 * banks)


def reference_height(grid: Grid) -> Array:
    """
    Sea surface height of the gyre that its density does not explain; it drives a weak current at
    all depths. [m]
    """
    return np.asarray(_GYRE_HEIGHT * np.exp(-0.5 * _gyre_distance_squared(grid) / _GYRE_RADIUS**2))
