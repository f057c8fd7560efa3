"""Colour maps for depth and sound speed, from cmocean, cut to where lines on them can be read."""

import warnings

import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap

with warnings.catch_warnings():
    # cmocean 4.0 makes its maps in a way that matplotlib 3.11 has deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import cmocean


def part_of(colormap: Colormap, low: float, high: float) -> Colormap:
    """
    Stretch of a colour map.

    Parameters
    ----------
    colormap : matplotlib.colors.Colormap
    low, high : float
        Ends of the stretch, within 0 to 1; ``low`` above ``high`` reverses it.

    Returns
    -------
    matplotlib.colors.Colormap
    """
    return LinearSegmentedColormap.from_list(
        f"{colormap.name} {low:g} to {high:g}", colormap(np.linspace(low, high, 256))
    )


SOUND_SPEED = part_of(cmocean.cm.ice, 0.99, 0.55)
"""Light blues: black, grey and orange lines stand out on all of them."""

DEPTH = part_of(cmocean.cm.thermal, 0.88, 0.08)
"""Light at the surface, dark below; lines of all its colours stand out on white."""

WATER = part_of(cmocean.cm.thermal, 0.12, 0.98)
"""Sound speed where its structure is the subject: slow dark, fast light."""

FLOOR = part_of(cmocean.cm.deep, 0.04, 0.85)
"""Depth of the sea floor in plan: shallow light, deep dark."""
