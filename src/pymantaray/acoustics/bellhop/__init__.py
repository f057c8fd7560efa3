"""BELLHOP3D: its input files from a medium and links, running it, what it writes, and comparisons."""

from pymantaray.acoustics.bellhop.output import (
    BellhopArrivals,
    BellhopRays,
    read_bellhop_arrivals,
    read_bellhop_rays,
)
from pymantaray.acoustics.bellhop.run import (
    BellhopRun,
    bellhop_arrivals,
    compare_with_bellhop,
    find_bellhop,
    run_bellhop,
)
from pymantaray.acoustics.bellhop.write import BellhopOptions, HalfSpace, linear_medium, write_bellhop

__all__ = [
    "BellhopArrivals",
    "BellhopOptions",
    "BellhopRays",
    "BellhopRun",
    "HalfSpace",
    "bellhop_arrivals",
    "compare_with_bellhop",
    "find_bellhop",
    "linear_medium",
    "read_bellhop_arrivals",
    "read_bellhop_rays",
    "run_bellhop",
    "write_bellhop",
]
