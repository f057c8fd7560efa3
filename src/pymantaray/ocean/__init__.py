"""
Oceans from model files, casts or synthetic regions, as sound speed, currents and sea floor.

Examples
--------
>>> import numpy as np
>>> from pymantaray.ocean import Cast, open_ocean
>>> ocean = open_ocean("synthetic:fram", window=(77.9, 78.1, -0.4, 0.4))
>>> depth = np.array([0.0, 50.0, 200.0, 1000.0])
>>> temperature, salinity = np.array([4.0, 3.0, 2.5, -0.5]), np.array([34.0, 34.8, 35.0, 34.9])
>>> cast = Cast("C1", 78.0, 0.0, ocean["time"].values, depth, temperature, salinity)
>>> dict(ocean.sizes)
{'depth': 40, 'lat': 5, 'lon': 11}
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.ocean.cast import Cast as Cast
    from pymantaray.ocean.casts import (
        cast_ocean as cast_ocean,
        holds_casts as holds_casts,
        read_cast as read_cast,
        read_casts as read_casts,
    )
    from pymantaray.ocean.check import check_ocean as check_ocean
    from pymantaray.ocean.corrections import correct_with_casts as correct_with_casts
    from pymantaray.ocean.ice import with_ice as with_ice, with_roughness as with_roughness
    from pymantaray.ocean.local import to_local as to_local
    from pymantaray.ocean.modes import (
        SoundSpeedCovariance as SoundSpeedCovariance,
        VerticalModes as VerticalModes,
        layer_weights as layer_weights,
        vertical_modes as vertical_modes,
    )
    from pymantaray.ocean.open import (
        ocean_times as ocean_times,
        open_ocean as open_ocean,
        open_ocean_series as open_ocean_series,
    )
    from pymantaray.ocean.perturb import (
        column_ocean as column_ocean,
        mean_ocean as mean_ocean,
        perturb_ocean as perturb_ocean,
        pooled_rms as pooled_rms,
    )
    from pymantaray.ocean.schema import (
        assemble_ocean as assemble_ocean,
        validate_ocean as validate_ocean,
        with_history as with_history,
    )
    from pymantaray.ocean.sea_floor import (
        fill_below_sea_bed as fill_below_sea_bed,
        open_sea_floor as open_sea_floor,
        sea_floor_depth as sea_floor_depth,
    )
    from pymantaray.ocean.seawater import sound_speed as sound_speed
    from pymantaray.ocean.stored import stored_ocean as stored_ocean
    from pymantaray.ocean.summary import (
        region_table as region_table,
        sound_speed_profile_spread as sound_speed_profile_spread,
    )
    from pymantaray.ocean.synthetic import synthetic_ocean as synthetic_ocean
    from pymantaray.ocean.window import crop_around as crop_around, window_of as window_of

__getattr__, __dir__, __all__ = lazy_exports(__name__)
