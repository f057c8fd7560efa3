"""Factor graph, its file format and its batch solution; knows measurements, never the ocean or the truth."""

from pymantaray.estimation.assemble import CONDITIONS, build_graph
from pymantaray.estimation.conditions import collect_estimates, solve_conditions
from pymantaray.estimation.dead_reckoning import dead_reckon
from pymantaray.estimation.gate import SolveOptions
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.pyfg import read_pyfg, write_pyfg
from pymantaray.estimation.solution import Solution
from pymantaray.estimation.solve import GraphSolver

__all__ = [
    "CONDITIONS",
    "FactorGraph",
    "GraphSolver",
    "GraphValues",
    "Solution",
    "SolveOptions",
    "build_graph",
    "collect_estimates",
    "dead_reckon",
    "read_pyfg",
    "solve_conditions",
    "write_pyfg",
]
