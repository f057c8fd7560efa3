r"""
Factor graphs from files: formats, minima, certificates.

Examples
--------
>>> from pathlib import Path
>>> from pymantaray.apps.graphs import open_graph
>>> noise = "0.01 0 0 0 0 0 0.01 0 0 0 0 0.01 0 0 0 1e-4 0 0 1e-4 0 1e-4"
>>> lines = [
...     "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1",
...     "VERTEX_SE3:QUAT 1 A1 10 0 0 0 0 0 1",
...     f"VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1 {noise}",
...     f"EDGE_SE3:QUAT 1 A0 A1 10.1 0 0 0 0 0 1 {noise}",
... ]
>>> _ = Path("graph.pyfg").write_text("\n".join(lines))
>>> opened = open_graph("graph.pyfg")
>>> opened.graph
<FactorGraph: 1 vehicle, 0 landmarks, 2 poses>
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.graphs.external import (
        GraphResult as GraphResult,
        open_graph as open_graph,
        solve_graph as solve_graph,
        to_gtsam as to_gtsam,
    )
    from pymantaray.apps.graphs.staircase import Certificate as Certificate, certify as certify

__getattr__, __dir__, __all__ = lazy_exports(__name__)
