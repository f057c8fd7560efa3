"""
Names of all columns and tuples that the kernels share (`at.NAME` in the kernels), and the
workspaces of the kernels.
"""

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.compile import PLAIN

# State y of a ray, see `step`. For a fan, only the first N_FAN numbers are integrated; for a ray
# whose variations in the plane and out of it depend on each other, N_SPACE: also the derivatives of
# Y and Q by the launch angle, and of W, P, Y and Q by the cross-track slowness. DY_DQ is then the
# integral of 1 / h; at the end, it receives the derivative.
W, P, XI, ETA, TAU, Y, Q, DY_DQ = range(8)
Y_ANGLE, Q_ANGLE, W_Q, P_Q, Y_Q, Q_Q = range(8, 14)
N_FAN, N_FULL = 4, 8
N_SPACE = 16  # 14 numbers and two zeros: a vector of `lanes`
# Additional numbers for a ray of a fan: GONE, the distance along the axis at which an OPEN ray left
# the water or a FORWARD ray had too many reflections (0: nowhere); GROWN, the largest |xi| on the
# path; the smallest and largest offset across the axis on the path. For an OPEN ray, derivatives by
# the launch angle of GONE, of the logarithm of the steepness there, and of both offsets; and the
# same by the cross-track slowness.
GONE, GROWN, HIGHEST, LOWEST = range(16, 20)
GONE_RATE, GONE_BEND, HIGHEST_RATE, LOWEST_RATE = range(20, 24)
GONE_RATE_Q, GONE_BEND_Q, HIGHEST_RATE_Q, LOWEST_RATE_Q = range(24, 28)
# Additional number for a full ray: the number of caustics, points on the path at which the width of
# the ray tube passes through zero.
CAUSTICS_PASSED = 28
N_STATE = 29

# Node of a recorded path: time [m at the source's sound speed], range, depth, cross-track offset
# [m], slowness along range, depth and cross-track [times the source's sound speed], boundary.
TIME, RANGE, DEPTH, SIDE, P_RANGE, P_DEPTH, P_SIDE, BOUNDARY = range(8)
N_PATH = 8
IN_WATER, AT_SURFACE, AT_BOTTOM = 0, 1, 2

# Node of a path in the local frame: travel time [s], position (3) [m], slowness (3) [s/m],
# boundary.
NODE_TIME, NODE_POSITION, NODE_SLOWNESS, NODE_BOUNDARY = 0, 1, 4, 7
N_NODE = 8

# Ray of a fan: launch angle, miss and its slope, slowness and its slope, 1 if it reached the end,
# code of its reflections, cross-track slowness at the source. For the search only: error of the
# cubic of the miss near it, tolerance, divergence on the path (before tracing: expected
# divergence), GONE with its two derivatives, smallest and largest depth relative to the source with
# their derivatives, derivative of the cross-track offset by the cross-track slowness, divided by
# the ray's length, and derivative of CROSS by the launch angle. The upper end of an interval has
# the number of the fan's interval instead of DEFECT.
ANGLE, MISS, SLOPE, SLOWNESS, SLOWNESS_SLOPE, GOOD, CODE, CROSS, DEFECT, TOL, GROWTH = range(11)
LEFT, LEFT_RATE, LEFT_BEND = range(11, 14)
TOP, TOP_RATE, LOW, LOW_RATE = range(14, 18)
SPREAD, CROSS_SLOPE = 18, 19
INTERVAL = DEFECT
N_RAY = 20
N_BRACKET = 8  # number of these columns, from the first, that an end of a bracket has

# A link in the queue of `march`: its number (negative: none), columns of its section, their
# distance [m], first number of the section in the store, number of breaks of its boundaries,
# derivatives of c_ref / c by depth and across the track at the source [1/m], 1 if steps end at the
# levels, 1 if rays leave the plane, first, next and last + 1 of the rows of rays to be traced, and
# number of these rays that are not finished; the same three of the rays traced ahead; then its
# `Baseline`, `Link` and `Progress`.
FLIGHT_LINK, FLIGHT_COLUMNS, FLIGHT_STEP, FLIGHT_STORE, FLIGHT_BREAKS = range(5)
FLIGHT_GRADIENT, FLIGHT_CROSS_GRADIENT, FLIGHT_LEVELS, FLIGHT_CROSS = range(5, 9)
FLIGHT_FIRST, FLIGHT_NEXT, FLIGHT_LAST, FLIGHT_PENDING = range(9, 13)
AHEAD_FIRST, AHEAD_NEXT, AHEAD_LAST = range(13, 16)
FLIGHT_LINE, FLIGHT_ENDS, FLIGHT_PROGRESS = 16, 20, 28
N_FLIGHT = 37

# Row of an arrival: travel time [s], launch and arrival angle [rad], spreading [dB], turning
# points, slowness vectors at both ends (3 + 3) [s/m], reflections at the surface and at the sea
# bed, axis of integration, and caustics.
TRAVEL_TIME, LAUNCH_ANGLE, ARRIVAL_ANGLE, SPREADING_DB, TURNING_POINTS = range(5)
SOURCE_SLOWNESS, RECEIVER_SLOWNESS = 5, 8
SURFACE_BOUNCES, BOTTOM_BOUNCES, RAY_AXIS, CAUSTICS = 11, 12, 13, 14
N_ARRIVAL = 15
HORIZONTAL, CHORD, VERTICAL = 0, 1, 2  # as `records.RayAxis`

# Information about a link: chord travel time [s], sound speed at both ends [m/s], smallest miss
# [m], number of traced rays, 1 if there was room for all arrivals, and 1 if the search resolved all
# intervals, or a half if it should be repeated from the other end.
CHORD_TIME, SOURCE_SPEED, RECEIVER_SPEED, MARGIN, RAYS, COMPLETE, RESOLVED = range(7)
N_INFO = 7

# Rows of the array of sea-bed cells: reflections of the last ray, held cells, and cells to try.
LANDED, HELD, TRIED = 0, 1, 2
MAX_BOUNCES = 15  # at each boundary

# Candidate, see `cells`: cells, launch angle, cross-track slowness, reflections at both boundaries,
# generation.
CANDIDATE_ANGLE, CANDIDATE_Q, CANDIDATE_COUNTS, CANDIDATE_GENERATION = range(
    MAX_BOUNCES + 1, MAX_BOUNCES + 5
)
N_CANDIDATE = MAX_BOUNCES + 5

SMOOTH, LINEAR = 0, 1  # kinds of a field
# Water that varies horizontally or has a surface that rays cannot cross layer by layer; layered
# water; layered water with a sea bed below the levels
VARYING, LAYERED, DEEPER = 0, 1, 2

Domain = namedtuple(
    "Domain",
    "kind north east depth field knots_north degree_north knots_east degree_east lut lut_scale"
    " column_step bed surface uniform layered ladder radius",
)
Domain.__doc__ = """Medium for the kernels: sound speed, and `BoundaryGrid` of the sea bed and of
the surface.

For SMOOTH, field contains B-spline coefficients (north, east, 2 * depth); for LINEAR, the sound
speed (north, east, depth). A surface without ice has one point at depth 0. A uniform medium does
not vary horizontally; layered is LAYERED or DEEPER if it is also LINEAR or has a flat surface,
and otherwise VARYING. With ladder, fans of direct rays are traced by `ladder`, not by `march`.
radius is that of the Earth if depths and sound speeds are those of flattened water, otherwise 0.
[m]"""

FieldSection = namedtuple(
    "FieldSection", "kind n_range r_first r_step breaks depth lut lut_scale data layered ladder"
)
FieldSection.__doc__ = """Sound-speed field along one baseline.

It has n_range columns (SMOOTH) or cells (LINEAR); breaks contains the edges of the cells (LINEAR).
lut maps a depth to a level at or above the layer of this depth. For SMOOTH, data has shape
(n_range, n_depth - 1, 16) and contains the cubics in depth of c, c_r, c_y and c_yy in each layer;
for LINEAR, its shape is (n_range, n_depth, 6)."""

Baseline = namedtuple("Baseline", "north east unit_north unit_east")
Baseline.__doc__ = """Start of a link, and its horizontal direction."""

Walls = namedtuple("Walls", "bed surface line breaks n_breaks across cells held")
Walls.__doc__ = """Sea bed and surface along one baseline; breaks are the ranges at which it crosses
their grid lines, and its ends.

across is the share of the boundaries' slope across the plane that the kernels use, usually 1. Row
LANDED of cells receives the cells of the sea bed in which a ray is reflected. If held is not
negative, the bed is that of the cell cells[HELD, held] alone, extended beyond its edges by its
width; elsewhere, and for a cell -1, there is no bed."""

BoundaryRule = namedtuple("BoundaryRule", "kind max_surface max_bottom spare legs end_depth fold")
BoundaryRule.__doc__ = """Behaviour of a ray at the surface and at the sea bed.

OPEN: the ray continues beyond them. FORWARD: it is reflected at most max_surface and max_bottom
times, plus spare times each, because a search needs rays on both sides of the allowed ones. LEGS:
on a vertical axis, it is reflected ``legs - 1`` times and ends at end_depth. fold is the mark of
the boundary on which the receiver is, or 0: the search then unfolds the miss, see
`search.shoot`."""
OPEN, FORWARD, LEGS = 0, 1, 2

Course = namedtuple("Course", "rule axis length target to_levels cross")
Course.__doc__ = """Integration of rays: rule at the boundaries, axis, length along it, and target
offset. [m]

With to_levels, steps of a fan's direct rays through a SMOOTH section end at its levels; steps of
full rays always do. For LEGS, the length is an approximate total of all legs. With cross, direct
rays of a fan leave the plane and end in it at the receiver; otherwise they remain in it."""

Axis = namedtuple("Axis", "z_source cb sb c_ref")
Axis.__doc__ = """Axis of integration through the source: depth of the source, cosine and sine of
the tilt, sound speed at the source."""

Cell = namedtuple("Cell", "column layer")
Cell.__doc__ = """Cell of a section: index of its column in range (LINEAR) and of its layer; layers
-1 and n - 1 are outside the levels."""

Point = namedtuple("Point", "along w dw side dside")
Point.__doc__ = """Point of a ray: distance along the axis, offsets in and out of the plane, and
their derivatives by this distance."""

StepLengths = namedtuple("StepLengths", "first longest near")
StepLengths.__doc__ = """StepLengths of a step to a face: initial length, maximum, and maximum
distance of its end from the face. [m]"""

Reflections = namedtuple("Reflections", "surface bottom code")
Reflections.__doc__ = """Reflections of a ray: numbers at both boundaries, and the code of their
order and cells, see `boundary.append_code`."""

SearchResult = namedtuple("SearchResult", "count weak rays complete")
SearchResult.__doc__ = """Result of a search: number of arrivals, of rays below the cut-off and of
traced rays; True if there was room for all."""

Snell = namedtuple("Snell", "a da sine_squared c_ref")
Snell.__doc__ = """Constants of a ray through layers: a = cos / c and its derivative by the launch
angle; squared sine and c at the source."""

Progress = namedtuple("Progress", "asked top left right brackets margin rays complete resolved")
Progress.__doc__ = """Progress of a search: intervals that wait for rays, intervals on the stack,
first and last interval of the fan that is not yet judged, number of brackets, smallest miss, number
of rays, 1 if the limits were sufficient, and 1 if no interval remained unresolved, or a half if
other rays may exist that the search does not follow. All are floats."""

Link = namedtuple("Link", "z0 z1 c0 c1 horizontal length unit_north unit_east")
Link.__doc__ = """Ends of a link: depths, sound speeds, distances and direction."""

Accuracy = namedtuple("Accuracy", "coarse fine miss")
Accuracy.__doc__ = (
    """Tolerances of a fan's rays and of an eigenray, and maximum miss of an eigenray. [m]"""
)

Settings = namedtuple("Settings", "cutoff_db tolerance canonical shallower")
Settings.__doc__ = """
Options of `link.solve_links` in addition to the numbers of reflections.

With canonical, links are solved from their deeper end, or with shallower from the other one.
"""

Results = namedtuple("Results", "rows counts status info")
Results.__doc__ = """Arrivals (n_links, n, N_ARRIVAL) of links, and number of arrivals, status and
information (n_links, N_INFO) of each link."""

Ray = namedtuple("Ray", "y K ynew path")
Ray.__doc__ = """Workspace of one ray: K (7, N_FULL) for the full state, K (7, N_FAN) for the state
of a fan, K (7, N_SPACE) for coupled variations.

path (n, N_PATH) receives every accepted step of a full ray if it has rows."""

N_LANES = 137  # rows of sixteen numbers, see `march`
MAX_COLUMNS = 1024
MAX_STEPS = 100_000  # of a ray
MAX_PATH = 32_768
MAX_NODES = 4096
MAX_ROOTS = 256
MAX_HALVED = 16  # intervals of a link that wait for rays at a time
MAX_AHEAD = 2 * MAX_HALVED  # rays of a link traced ahead
MAX_FLIGHTS = 16  # links whose rays are traced together
MAX_CANDIDATES = 96
N_LADDER = 12  # rows, see `ladder`
BLOCK = 32  # layers of a block of `ladder`
N_LAYER = 11  # rows of a block of layers
_LINE = 8  # numbers of a line of the processor's cache

Work = namedtuple(
    "Work",
    "y K K_fan K_space ynew no_path path breaks wall_breaks cells candidates small acc store cuts"
    " extremes ladder layers nodes rays stack halves kinds brackets rows",
)
Work.__doc__ = """Workspaces of one thread, shared by all kernels; kernels write them for each link
before they read them.

rays contains two rows for each interval that waits for rays, two tables of as many rays traced
ahead, and then the fan."""

Flights = namedtuple("Flights", "links lanes wall_breaks nodes rays stack halves kinds brackets")
Flights.__doc__ = """Links whose rays are traced together: a row (N_FLIGHT) of each, the rows of
`march`, and arrays of `Work`, one of each link."""

Room = namedtuple("Room", "work flights")
Room.__doc__ = """Workspaces of `link.solve_links`; flights is None in plain Python,
where rays are traced one after another."""


def shapes(n_depth: int) -> Work:
    """Shapes of the workspaces for links in a medium with a number of levels."""
    return Work(
        y=(N_STATE,),
        K=(7, N_FULL),
        K_fan=(7, N_FAN),
        K_space=(7, N_SPACE),
        ynew=(N_SPACE,),
        no_path=(0, N_PATH),
        path=(MAX_PATH, N_PATH),
        breaks=(MAX_COLUMNS + 1,),
        wall_breaks=(MAX_COLUMNS + 2,),
        cells=(3, MAX_BOUNCES + 2),
        candidates=(MAX_CANDIDATES, N_CANDIDATE),
        small=(6, 4),
        acc=(4, 2 * n_depth),
        store=(MAX_COLUMNS, n_depth, 16),
        cuts=(n_depth + MAX_COLUMNS + 4,),
        extremes=(2, n_depth),
        ladder=(N_LADDER, 3 * n_depth + 64),
        layers=(N_LAYER * (3 * n_depth + 64 + 2 * BLOCK),),
        nodes=(MAX_NODES,),
        rays=(6 * MAX_HALVED + MAX_NODES, N_RAY),
        stack=(20 + 16 * MAX_HALVED, 2, N_RAY),
        halves=(MAX_HALVED, 2, N_RAY),
        kinds=(MAX_HALVED,),
        brackets=(MAX_ROOTS, 2, N_BRACKET),
        rows=(MAX_ROOTS, N_ARRIVAL),
    )


def flight_shapes(own: Work) -> Flights:
    """Shapes of the workspaces of links whose rays are traced together, from those of one link."""
    arrays = {name: (MAX_FLIGHTS, *getattr(own, name)) for name in Flights._fields[2:]}
    return Flights(links=(MAX_FLIGHTS, N_FLIGHT), lanes=(N_LANES, 16), **arrays)


def _aligned(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """
    Allocate an array that starts on a line of the processor's cache, so that a vector of `march`
    is on one line.
    """
    numbers = np.empty(math.prod(shape) + _LINE)
    start = -(numbers.ctypes.data // numbers.itemsize) % _LINE
    return numbers[start : start + math.prod(shape)].reshape(shape)


def workspace(n_depth: int) -> Work:
    """Workspaces of one thread for any link."""
    return Work(*(_aligned(shape) for shape in shapes(n_depth)))


def solver_room(n_depth: int) -> Room:
    """Workspaces of one thread that solves any links."""
    work = workspace(n_depth)
    arrays = flight_shapes(shapes(n_depth))
    return Room(work, None if PLAIN else Flights(*(_aligned(shape) for shape in arrays)))
