"""Oceans: HYCOM's files or synthetic regions, as sound speed, currents and sea floor."""

from pymantaray.ocean.regrid import to_local
from pymantaray.ocean.source import open_ocean
from pymantaray.ocean.summary import region_table, sound_speed_profile_spread
from pymantaray.ocean.synthetic import synthetic_ocean

__all__ = ["open_ocean", "region_table", "sound_speed_profile_spread", "synthetic_ocean", "to_local"]
