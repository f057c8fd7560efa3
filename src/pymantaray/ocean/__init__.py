"""Oceans from model files, casts or synthetic regions, as sound speed, currents and sea floor."""

from pymantaray.ocean.cast import Cast
from pymantaray.ocean.casts import cast_ocean, holds_casts, read_cast, read_casts
from pymantaray.ocean.check import check_ocean
from pymantaray.ocean.corrections import correct_with_casts
from pymantaray.ocean.ice import with_ice, with_roughness
from pymantaray.ocean.local import to_local
from pymantaray.ocean.modes import SoundSpeedCovariance, VerticalModes, layer_weights, vertical_modes
from pymantaray.ocean.open import ocean_times, open_ocean, open_ocean_series
from pymantaray.ocean.perturb import column_ocean, mean_ocean, perturb_ocean, pooled_rms
from pymantaray.ocean.schema import assemble_ocean, validate_ocean, with_history
from pymantaray.ocean.sea_floor import fill_below_sea_bed, open_sea_floor, sea_floor_depth
from pymantaray.ocean.seawater import sound_speed
from pymantaray.ocean.stored import stored_ocean
from pymantaray.ocean.summary import region_table, sound_speed_profile_spread
from pymantaray.ocean.synthetic import synthetic_ocean
from pymantaray.ocean.window import crop_around, window_of

__all__ = [
    "Cast",
    "SoundSpeedCovariance",
    "VerticalModes",
    "assemble_ocean",
    "cast_ocean",
    "check_ocean",
    "column_ocean",
    "correct_with_casts",
    "crop_around",
    "fill_below_sea_bed",
    "holds_casts",
    "layer_weights",
    "mean_ocean",
    "ocean_times",
    "open_ocean",
    "open_ocean_series",
    "open_sea_floor",
    "perturb_ocean",
    "pooled_rms",
    "read_cast",
    "read_casts",
    "region_table",
    "sea_floor_depth",
    "sound_speed",
    "sound_speed_profile_spread",
    "stored_ocean",
    "synthetic_ocean",
    "to_local",
    "validate_ocean",
    "vertical_modes",
    "window_of",
    "with_history",
    "with_ice",
    "with_roughness",
]
