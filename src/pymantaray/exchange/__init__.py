"""Other programs' formats: one module a format, which reads and writes it where both make sense."""

from pymantaray.exchange.tum import graph_tum_files, write_graph_tum, write_tum

__all__ = ["graph_tum_files", "write_graph_tum", "write_tum"]
