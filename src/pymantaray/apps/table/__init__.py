"""Tables of travel times for use on board."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.apps.table.cells import CellStatus as CellStatus
    from pymantaray.apps.table.file import open_table as open_table, save_table as save_table
    from pymantaray.apps.table.make import build_table as build_table
    from pymantaray.apps.table.table import (
        TableRanges as TableRanges,
        TravelTimeTable as TravelTimeTable,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
