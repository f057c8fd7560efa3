"""Trajectories and tables in other people's formats."""

from pymantaray.export.tum import graph_tum_files, write_graph_tum, write_tum

__all__ = ["graph_tum_files", "write_graph_tum", "write_tum"]
