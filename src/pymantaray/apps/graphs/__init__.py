"""Factor graphs from files: formats, minima, certificates."""

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
