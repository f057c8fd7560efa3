"""Water from any source: fields, medium, currents and reception."""

from pymantaray.water.water import Source, Water, open_water, open_waters, water_of

__all__ = ["Source", "Water", "open_water", "open_waters", "water_of"]
