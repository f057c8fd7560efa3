"""Trajectories and tables in other people's formats."""

from pymantaray.export.tum import write_graph_tum, write_tum

__all__ = ["write_graph_tum", "write_tum"]
