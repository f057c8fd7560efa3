"""BELLHOP3D: its input files from a medium and links, what it writes, and its travel times beside ours."""

from pymantaray.acoustics.bellhop.output import read_bellhop_arrivals, read_bellhop_rays
from pymantaray.acoustics.bellhop.run import compare_with_bellhop
from pymantaray.acoustics.bellhop.write import BellhopOptions, HalfSpace, linear_medium, write_bellhop

__all__ = [
    "BellhopOptions",
    "HalfSpace",
    "compare_with_bellhop",
    "linear_medium",
    "read_bellhop_arrivals",
    "read_bellhop_rays",
    "write_bellhop",
]
