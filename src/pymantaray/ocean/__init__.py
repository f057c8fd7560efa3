"""Oceans from model files, casts or synthetic regions, as sound speed, currents and sea floor."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.ocean.cast import Cast as Cast
    from pymantaray.ocean.casts import cast_ocean as cast_ocean
    from pymantaray.ocean.casts import holds_casts as holds_casts
    from pymantaray.ocean.casts import read_cast as read_cast
    from pymantaray.ocean.casts import read_casts as read_casts
    from pymantaray.ocean.check import check_ocean as check_ocean
    from pymantaray.ocean.corrections import correct_with_casts as correct_with_casts
    from pymantaray.ocean.ice import with_ice as with_ice
    from pymantaray.ocean.ice import with_roughness as with_roughness
    from pymantaray.ocean.local import to_local as to_local
    from pymantaray.ocean.modes import SoundSpeedCovariance as SoundSpeedCovariance
    from pymantaray.ocean.modes import VerticalModes as VerticalModes
    from pymantaray.ocean.modes import layer_weights as layer_weights
    from pymantaray.ocean.modes import vertical_modes as vertical_modes
    from pymantaray.ocean.open import ocean_times as ocean_times
    from pymantaray.ocean.open import open_ocean as open_ocean
    from pymantaray.ocean.open import open_ocean_series as open_ocean_series
    from pymantaray.ocean.perturb import column_ocean as column_ocean
    from pymantaray.ocean.perturb import mean_ocean as mean_ocean
    from pymantaray.ocean.perturb import perturb_ocean as perturb_ocean
    from pymantaray.ocean.perturb import pooled_rms as pooled_rms
    from pymantaray.ocean.schema import assemble_ocean as assemble_ocean
    from pymantaray.ocean.schema import validate_ocean as validate_ocean
    from pymantaray.ocean.schema import with_history as with_history
    from pymantaray.ocean.sea_floor import fill_below_sea_bed as fill_below_sea_bed
    from pymantaray.ocean.sea_floor import open_sea_floor as open_sea_floor
    from pymantaray.ocean.sea_floor import sea_floor_depth as sea_floor_depth
    from pymantaray.ocean.seawater import sound_speed as sound_speed
    from pymantaray.ocean.stored import stored_ocean as stored_ocean
    from pymantaray.ocean.summary import region_table as region_table
    from pymantaray.ocean.summary import sound_speed_profile_spread as sound_speed_profile_spread
    from pymantaray.ocean.synthetic import synthetic_ocean as synthetic_ocean
    from pymantaray.ocean.window import crop_around as crop_around
    from pymantaray.ocean.window import window_of as window_of

__getattr__, __dir__, __all__ = lazy_exports(__name__)
