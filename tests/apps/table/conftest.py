"""A small table and the profile that it is made of."""

from made_up_table import places, table, water

__all__ = ["places", "table", "water"]
