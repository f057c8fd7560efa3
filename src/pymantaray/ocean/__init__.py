"""Oceans: models' files, casts or synthetic regions, as sound speed, currents and sea floor."""

from pymantaray.ocean.cast_ocean import cast_ocean
from pymantaray.ocean.casts import read_cast, read_casts
from pymantaray.ocean.check import check_ocean
from pymantaray.ocean.local import to_local
from pymantaray.ocean.objective_analysis import correct_with_casts
from pymantaray.ocean.perturb import perturb_ocean
from pymantaray.ocean.series import open_ocean_series
from pymantaray.ocean.source import ocean_times, open_ocean
from pymantaray.ocean.summary import region_table, sound_speed_profile_spread
from pymantaray.ocean.synthetic import synthetic_ocean
from pymantaray.ocean.topography import open_sea_floor

__all__ = [
    "cast_ocean",
    "check_ocean",
    "correct_with_casts",
    "ocean_times",
    "open_ocean",
    "open_ocean_series",
    "open_sea_floor",
    "perturb_ocean",
    "read_cast",
    "read_casts",
    "region_table",
    "sound_speed_profile_spread",
    "synthetic_ocean",
    "to_local",
]
