"""Other programs' formats: one module a format, which reads and writes it where both make sense."""

from pymantaray.exchange.read import read_trajectories
from pymantaray.exchange.tracks import Poses, Tracks
from pymantaray.exchange.tum import graph_tum_files, write_graph_tum, write_tum

__all__ = ["Poses", "Tracks", "graph_tum_files", "read_trajectories", "write_graph_tum", "write_tum"]
