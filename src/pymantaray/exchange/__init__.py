"""Readers and writers of other programs' formats, one module per format."""

from pymantaray.exchange.read import read_trajectories
from pymantaray.exchange.tracks import Poses, Tracks
from pymantaray.exchange.tum import graph_tum_files, write_graph_tum, write_tum

__all__ = [
    "Poses",
    "Tracks",
    "graph_tum_files",
    "read_trajectories",
    "write_graph_tum",
    "write_tum",
]
