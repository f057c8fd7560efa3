"""Names of every column and every tuple that the kernels share, `at.NAME` there, and the workspaces that they write to."""

from collections import namedtuple
from typing import Any

import numpy as np

from pymantaray.compile import PLAIN

# State y of a ray, see `step`. A fan integrates the first N_FAN numbers only.
W, P, XI, ETA, TAU, Y, Q, DY_DQ = range(8)
N_FAN, N_FULL = 4, 8
# Kept beside it for a fan: the distance along the axis at which an OPEN ray left the water or a FORWARD one was reflected
# too often (0: nowhere), and the largest |xi| on its way; of the former the derivative of that place by the launch angle, and of
# the logarithm of how steeply it rose there. Its least and greatest offset across the axis on its way, with their derivatives.
GONE, GROWN, GONE_RATE, GONE_BEND = range(8, 12)
HIGHEST, HIGHEST_RATE, LOWEST, LOWEST_RATE = range(12, 16)
# Kept beside it for a full ray: the number of caustics, places at which XI passes through zero on the way.
CAUSTICS_PASSED = 16
N_STATE = 17

# Node of a recorded path: time [m at the source's sound speed], range, depth, cross-track offset [m],
# slowness along range, depth and cross-track [times the source's sound speed], boundary.
TIME, RANGE, DEPTH, SIDE, P_RANGE, P_DEPTH, P_SIDE, BOUNDARY = range(8)
N_PATH = 8
IN_WATER, AT_SURFACE, AT_BOTTOM = 0, 1, 2

# Node of a path in the local frame: travel time [s], position (3) [m], slowness (3) [s/m], boundary.
NODE_TIME, NODE_POSITION, NODE_SLOWNESS, NODE_BOUNDARY = 0, 1, 4, 7
N_NODE = 8

# Ray of a fan: launch angle, miss and its slope, slowness and its slope, whether it came, code of its reflections; for the
# search only: error of the cubic about it, tolerance, how far it diverged on its way (before it is traced, is expected to), and GONE
# with what is known of it, and its least and greatest depth less the source's with their derivatives. The upper end of an interval has in place of DEFECT the number of the fan's interval that it is of.
ANGLE, MISS, SLOPE, SLOWNESS, SLOWNESS_SLOPE, GOOD, CODE, DEFECT, TOL, GROWTH = range(10)
LEFT, LEFT_RATE, LEFT_BEND = range(10, 13)
TOP, TOP_RATE, LOW, LOW_RATE = range(13, 17)
INTERVAL = DEFECT
N_RAY = 17
N_BRACKET = 7  # of these an end of a bracket has the first

# Row of an arrival: travel time [s], launch and arrival angle [rad], spreading [dB], turning points, slowness vectors at
# both ends (3 + 3) [s/m], reflections at the surface and at the sea bed, axis along which it was traced, and caustics.
TRAVEL_TIME, LAUNCH_ANGLE, ARRIVAL_ANGLE, SPREADING_DB, TURNING_POINTS = range(5)
SOURCE_SLOWNESS, RECEIVER_SLOWNESS = 5, 8
SURFACE_BOUNCES, BOTTOM_BOUNCES, RAY_AXIS, CAUSTICS = 11, 12, 13, 14
N_ARRIVAL = 15
HORIZONTAL, CHORD, VERTICAL = 0, 1, 2  # as `records.RayAxis`

# What belongs to a link: chord travel time [s], sound speed at both ends [m/s], least miss [m], number of rays traced, and
# 1 if none was left out for want of room.
CHORD_TIME, SOURCE_SPEED, RECEIVER_SPEED, MARGIN, RAYS, COMPLETE = range(6)
N_INFO = 6

# Rows of the cells of the sea bed: those in which the last ray was reflected, those that are held, those to be tried.
LANDED, HELD, TRIED = 0, 1, 2
MOST_BOUNCES = 15  # of each kind

# Candidate, see `cells`: its cells, launch angle, cross-track slowness, reflections at both boundaries, generation.
CANDIDATE_ANGLE, CANDIDATE_Q, CANDIDATE_COUNTS, CANDIDATE_GENERATION = range(
    MOST_BOUNCES + 1, MOST_BOUNCES + 5
)
N_CANDIDATE = MOST_BOUNCES + 5

SMOOTH, LINEAR = 0, 1  # kinds of a field

Domain = namedtuple(
    "Domain",
    "kind north east depth field knots_north degree_north knots_east degree_east lut lut_scale column_step bed surface uniform layered radius",
)
Domain.__doc__ = """A medium as the kernels take it: sound speed, and `BoundaryGrid` of the sea bed and of the surface.

field holds, for SMOOTH, B-spline coefficients (north, east, 2 * depth), else the sound speed (north, east, depth). A
surface without ice has one point at depth 0. A uniform one does not vary horizontally; layered is such a LINEAR one
whose levels reach the sea bed. radius is that of the Earth if depths and sound speeds are those of flattened water, else 0. [m]
"""

Section = namedtuple("Section", "kind n_range r_first r_step breaks depth lut lut_scale data layered")
Section.__doc__ = """Field along one baseline.

n_range columns (SMOOTH) or cells (LINEAR); breaks holds the cell edges (LINEAR);
lut maps depth to a level not below the cell's own. data is, for SMOOTH, (n_range, n_depth - 1, 16): the
cubics in depth of c, c_r, c_y and c_yy in each layer; for LINEAR, (n_range, n_depth, 6).
"""

Baseline = namedtuple("Baseline", "north east unit_north unit_east")
Baseline.__doc__ = """Where a link starts and its horizontal direction."""

Walls = namedtuple("Walls", "bed surface line breaks n_breaks across cells held")
Walls.__doc__ = """Sea bed and surface along one baseline; breaks are the ranges at which it crosses their grid lines, the ends too.

across, usually 1, is the share of their slope across the plane that counts. Row LANDED of cells takes the cells of the sea
bed in which a ray is reflected. Where held is not negative the bed is that of the cell cells[HELD, held] alone, continued
beyond its edges by as much as it is wide; there is none elsewhere and for a cell -1.
"""

Rule = namedtuple("Rule", "kind max_surface max_bottom spare legs end_depth fold")
Rule.__doc__ = """What a ray does at the surface and at the sea bed.

OPEN: it goes on beyond them. FORWARD: it is reflected, at most so many times, and spare times more of each kind: a search
needs rays on both sides of those that it may keep. LEGS: on a vertical axis, it is
reflected ``legs - 1`` times and ends at end_depth. fold is the mark of the boundary on which the receiver is, 0 if none: the
search then unfolds the miss, see `search.shoot`.
"""
OPEN, FORWARD, LEGS = 0, 1, 2

Course = namedtuple("Course", "rule axis length target to_levels")
Course.__doc__ = """How rays are followed: by a rule, along an axis over a length, to an offset target. [m]

Steps of a fan's direct rays through a SMOOTH section end at its levels with to_levels; those of full rays always do.
For LEGS the length is a rough
measure of all legs.
"""

Axis = namedtuple("Axis", "z_source cb sb c_ref")
Axis.__doc__ = """Axis through the source along which a ray is followed: depth of the source, cosine and sine of its tilt, sound speed there."""

Cell = namedtuple("Cell", "column layer")
Cell.__doc__ = """Cell of a section: number of its column along the range (LINEAR) and of its layer; layers -1 and n - 1 are outside the levels."""

Point = namedtuple("Point", "along w dw side dside")
Point.__doc__ = """Place of a ray: distance along the axis, offsets in and out of the plane, and the derivative of each by that distance."""

Lengths = namedtuple("Lengths", "first longest near")
Lengths.__doc__ = """Lengths of a step to a face: that to begin with, the longest, and how near to the face it has to end. [m]"""

Reflections = namedtuple("Reflections", "surface bottom code")
Reflections.__doc__ = """Reflections of a ray: the number at either boundary, and the code of their order and cells, see `boundary.append_code`."""

Found = namedtuple("Found", "count weak rays complete")
Found.__doc__ = """Result of a search: rows of arrivals, rays too weak to count, rays traced, and whether none was left out for want of room."""

ArcPoint = namedtuple("ArcPoint", "depth speed sine cosine")
ArcPoint.__doc__ = """Place on an arc of `arcs`: depth, sound speed, and sine (positive down) and cosine of the ray's angle."""

ArcRates = namedtuple("ArcRates", "sine cosine range")
ArcRates.__doc__ = """Derivatives of sine, cosine and range by the launch angle at a fixed depth."""

Snell = namedtuple("Snell", "a da sine_squared c_ref")
Snell.__doc__ = """Constants of a ray through layers: a = cos / c with its derivative by the launch angle; sine squared and c at the source."""

Link = namedtuple("Link", "z0 z1 c0 c1 horizontal length unit_north unit_east")
Link.__doc__ = """The two ends of a link: depths, sound speeds, distances and direction."""

Accuracy = namedtuple("Accuracy", "coarse fine miss")
Accuracy.__doc__ = (
    """Tolerances of a fan's rays and of an eigenray, and how near to the receiver an eigenray ends. [m]"""
)

Settings = namedtuple("Settings", "cutoff_db tolerance canonical")
Settings.__doc__ = """What the caller of `link.solve_links` may choose besides the numbers of reflections."""

Results = namedtuple("Results", "rows counts status info")
Results.__doc__ = """Arrivals (n_links, n, N_ARRIVAL) of links, how many each has, its status and its info (n_links, N_INFO)."""

Ray = namedtuple("Ray", "y K ynew path")
Ray.__doc__ = """What one ray is integrated in; K (7, N_FULL) asks for the full state, K (7, N_FAN) for that of a fan.

path (n, N_PATH) takes every accepted step of a full ray when it has rows.
"""

N_LANES = 47  # rows of eight numbers, see `march`
MAX_COLUMNS = 1024
MAX_PATH = 32_768
MAX_NODES = 4096
MAX_ROOTS = 256
MAX_HALVED = 8  # intervals at a time
MAX_CANDIDATES = 96
_ANGLES = 768  # nodes of a first fan besides those of the levels: twice the widest fan over its spacing

Work = namedtuple(
    "Work",
    "y K K_fan ynew no_path path breaks wall_breaks cells candidates small acc store cuts nodes fan extremes stack halves middles brackets rows lanes",
)
Work.__doc__ = """Workspaces of one thread, shared by all kernels; never read before they are written for a link.

Without lanes, None on CUDA and in plain Python, the rays of a fan are traced one after the other.
"""


def shapes(
    n_depth: int,
    columns: int = MAX_COLUMNS,
    lines: int = MAX_COLUMNS,
    nodes: int = MAX_NODES,
    path: int = MAX_PATH,
    halved: int = MAX_HALVED,
) -> Work:
    """Shapes of the workspaces, for so many columns of a section, grid lines under a link, angles of a fan, steps, and intervals halved at a time."""
    return Work(
        y=(N_STATE,),
        K=(7, N_FULL),
        K_fan=(7, N_FAN),
        ynew=(N_FULL,),
        no_path=(0, N_PATH),
        path=(path, N_PATH),
        breaks=(columns + 1,),
        wall_breaks=(lines + 2,),
        cells=(3, MOST_BOUNCES + 2),
        candidates=(MAX_CANDIDATES, N_CANDIDATE),
        small=(6, 4),
        acc=(4, 2 * n_depth),
        store=(columns, n_depth, 16),
        cuts=(n_depth + columns + 4,),
        nodes=(nodes,),
        fan=(nodes, N_RAY),
        extremes=(2, n_depth),
        stack=(20 + 16 * halved, 2, N_RAY),
        halves=(halved, 2, N_RAY),
        middles=(halved, N_RAY),
        brackets=(MAX_ROOTS, 2, N_BRACKET),
        rows=(MAX_ROOTS, N_ARRIVAL),
        lanes=(N_LANES, 8),
    )


def least_shapes(domain: Any, longest: float) -> Work:
    """Shapes that suffice for links of at most this horizontal distance in a medium. [m]"""
    path = min(2048 + int(0.2 * longest), MAX_PATH)  # steps are some 5 m and more
    lines = min(sum(one.north.size + one.east.size for one in (domain.bed, domain.surface)), MAX_COLUMNS)
    n_depth = domain.depth.size
    if domain.kind == SMOOTH:  # one column more: distances may round differently on another processor
        columns = min(int(np.ceil(longest / domain.column_step)) + 2, MAX_COLUMNS)
        return shapes(n_depth, columns, lines, min(_ANGLES + 2 * n_depth, MAX_NODES), path, 1)
    columns = min(domain.north.size + domain.east.size, MAX_COLUMNS)
    return shapes(n_depth, columns, lines, min(_ANGLES + 2 * n_depth * columns, MAX_NODES), path, 1)


def workspace(n_depth: int) -> Work:
    """Workspaces of one thread for any link."""
    work = Work(*(np.empty(shape) for shape in shapes(n_depth)))
    return work._replace(lanes=None) if PLAIN else work
