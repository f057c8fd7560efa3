"""Travel-time tables for use on board: range from two depths and a travel time, without an ocean or a ray solver."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.online.cells import CellStatus as CellStatus
    from pymantaray.online.file import open_table as open_table
    from pymantaray.online.file import save_table as save_table
    from pymantaray.online.make import build_table as build_table
    from pymantaray.online.table import TableRanges as TableRanges
    from pymantaray.online.table import TravelTimeTable as TravelTimeTable

__getattr__, __dir__, __all__ = lazy_exports(__name__)
