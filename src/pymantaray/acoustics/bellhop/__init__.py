"""BELLHOP3D, both ways: its input files from a medium, its files as a medium, its output, and comparisons."""

from pymantaray.acoustics.bellhop.compare import bellhop_arrivals, compare_with_bellhop
from pymantaray.acoustics.bellhop.environment import Environment, HalfSpace
from pymantaray.acoustics.bellhop.files import read_bellhop, write_bellhop
from pymantaray.acoustics.bellhop.outputs import BellhopArrivals, read_bellhop_arrivals
from pymantaray.acoustics.bellhop.program import BellhopRun, find_bellhop, run_bellhop
from pymantaray.acoustics.bellhop.rays import BellhopRays, read_bellhop_rays
from pymantaray.acoustics.bellhop.read_env import read_environment
from pymantaray.acoustics.bellhop.refine import linear_medium

__all__ = [
    "BellhopArrivals",
    "BellhopRays",
    "BellhopRun",
    "Environment",
    "HalfSpace",
    "bellhop_arrivals",
    "compare_with_bellhop",
    "find_bellhop",
    "linear_medium",
    "read_bellhop",
    "read_bellhop_arrivals",
    "read_bellhop_rays",
    "read_environment",
    "run_bellhop",
    "write_bellhop",
]
