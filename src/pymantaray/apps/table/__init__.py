"""
Tables of travel times for use on board.

Examples
--------
>>> from pymantaray import Medium
>>> from pymantaray.apps.table import build_table
>>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
>>> table = build_table(medium, (0.0, 100.0), (0.0, 500.0), (100.0, 2000.0))
>>> print(table.travel_time(50.0, 400.0, 1500.0).travel_time.round(4))
[1.0536]
"""

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
