"""Workspaces of one thread: every array that the kernels write to, with its size."""

from collections import namedtuple
from typing import Any

import numpy as np

from pymantaray.acoustics._kernels.boundary import N_PATH
from pymantaray.acoustics._kernels.cells import MAX_CANDIDATES, N_CANDIDATE
from pymantaray.acoustics._kernels.rows import N_COLUMNS
from pymantaray.acoustics._kernels.search import MAX_ROOTS, MAX_STACK, N_BRACKET, N_NODE
from pymantaray.acoustics._kernels.section import MAX_COLUMNS, SMOOTH
from pymantaray.acoustics._kernels.step import N_FAN, N_FULL
from pymantaray.acoustics._kernels.trace import MOST_BOUNCES

MAX_PATH = 32_768
MAX_NODES = 4096
_ANGLES = 768  # nodes of a first fan besides those of the levels: twice the widest fan over its spacing

Work = namedtuple(
    "Work",
    "y K K_fan ynew no_path path breaks floor_breaks cells candidates small acc store cuts nodes node fan extremes stack brackets rows",
)
Work.__doc__ = (
    "Workspaces of one thread, shared by all kernels; never read before they are written for a link."
)


def shapes(
    n_depth: int,
    columns: int = MAX_COLUMNS,
    lines: int = MAX_COLUMNS,
    nodes: int = MAX_NODES,
    path: int = MAX_PATH,
) -> Work:
    """Shapes of the workspaces, for so many columns of a section, grid lines under a link, angles of a fan and steps."""
    return Work(
        y=(N_FULL,),
        K=(7, N_FULL),
        K_fan=(7, N_FAN),
        ynew=(N_FULL,),
        no_path=(0, N_PATH),
        path=(path, N_PATH),
        breaks=(columns + 1,),
        floor_breaks=(lines + 2,),
        cells=(3, MOST_BOUNCES + 2),
        candidates=(MAX_CANDIDATES, N_CANDIDATE),
        small=(6, 4),
        acc=(4, 2 * n_depth),
        store=(columns, n_depth, 16),
        cuts=(n_depth + columns + 4,),
        nodes=(nodes,),
        node=(N_NODE,),
        fan=(nodes, N_NODE),
        extremes=(2, n_depth),
        stack=(MAX_STACK, 2, N_NODE),
        brackets=(MAX_ROOTS, 2, N_BRACKET),
        rows=(MAX_ROOTS, N_COLUMNS),
    )


def least_shapes(packed: tuple[Any, ...], longest: float) -> Work:
    """Shapes that suffice for links of at most this horizontal distance in a medium. [m]"""
    kind, north, east, depth, column_step = packed[0], packed[1], packed[2], packed[3], packed[-1]
    path = min(2048 + int(0.2 * longest), MAX_PATH)  # steps are some 5 m and more
    lines = min(north.size + east.size, MAX_COLUMNS)
    if kind == SMOOTH:  # one column more: distances may round differently on another processor
        columns = min(int(np.ceil(longest / column_step)) + 2, MAX_COLUMNS)
        return shapes(depth.size, columns, lines, min(_ANGLES + 2 * depth.size, MAX_NODES), path)
    return shapes(depth.size, lines, lines, min(_ANGLES + 2 * depth.size * lines, MAX_NODES), path)


def workspace(n_depth: int) -> Work:
    """Workspaces of one thread for any link."""
    return Work(*(np.empty(shape) for shape in shapes(n_depth)))
