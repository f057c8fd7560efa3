"""The synthetic regions against real casts at the casts' own positions."""

import gsw
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import RegularGridInterpolator

from pymantaray.ocean.seawater import sound_speed

AXCTD = {  # July 2014, nine days after the paper's date; positions from the files' first lines
    "beaufort_axctd_20140724_74N140W": (73.9883, -139.9500),
    "beaufort_axctd_20140724_75N140W": (74.9517, -140.0750),
}
DEEP = {"beaufort_ctd_1997_canada_basin": (75.323, -144.185)}
FRAM = {
    "fram_bottle_1982_30": (77.501, -0.036),
    "fram_bottle_1982_40": (77.996, 1.183),
    "fram_bottle_1982_41": (78.465, 1.623),
    "fram_bottle_1982_42": (79.003, 1.368),
}


def cast(folder, name, position):
    """Depth [m] and sound speed [m/s] of a cast."""
    table = pd.read_csv(folder / "casts" / f"{name}.csv", comment="#")
    if "depth_m" in table:
        depth = table["depth_m"].to_numpy()
    else:
        depth = -gsw.z_from_p(table["pressure_dbar"].to_numpy(), position[0])
    return depth, sound_speed(table["temperature_degC"], table["practical_salinity"], depth, *position)


def model(ocean, depth, position):
    """Sound speed of an ocean along a vertical line, linear between its points. [m/s]"""
    axes = tuple(ocean[name].values for name in ("depth", "lat", "lon"))
    speed = sound_speed(
        ocean["water_temp"].values,
        ocean["salinity"].values,
        axes[0][:, None, None],
        axes[1][:, None],
        axes[2],
    )
    line = np.column_stack([depth, np.full_like(depth, position[0]), np.full_like(depth, position[1])])
    return RegularGridInterpolator(axes, speed, bounds_error=False)(line)


@pytest.mark.parametrize("name", AXCTD)
def test_the_beaufort_sea_is_within_2_m_s_rms_of_the_summer_casts(shared_data, beaufort_sea, name):
    depth, speed = cast(shared_data, name, AXCTD[name])
    upper = depth <= 1_000.0
    error = (model(beaufort_sea, depth, AXCTD[name]) - speed)[upper]
    assert np.sqrt(np.mean(error**2)) < 2.0


@pytest.mark.parametrize("name", DEEP)
def test_the_beaufort_sea_is_within_2_m_s_rms_of_the_deep_cast(shared_data, beaufort_sea, name):
    depth, speed = cast(shared_data, name, DEEP[name])
    found = model(beaufort_sea, depth, DEEP[name])
    deep = (depth > 1_000.0) & np.isfinite(found)
    assert depth[deep].max() > 2_900.0
    assert np.sqrt(np.mean((found - speed)[deep] ** 2)) < 2.0


def test_fram_strait_lies_within_the_casts_envelope_widened_by_2_m_s(shared_data, fram_strait):
    levels = np.concatenate([np.arange(100.0, 1_000.0, 20.0), np.arange(1_000.0, 2_600.0, 100.0)])
    casts = {name: cast(shared_data, name, where) for name, where in FRAM.items()}
    curves = np.array([np.interp(levels, depth, speed, right=np.nan) for depth, speed in casts.values()])
    low, high = np.nanmin(curves, axis=0) - 2.0, np.nanmax(curves, axis=0) + 2.0
    for where in FRAM.values():
        found = model(fram_strait, levels, where)
        wet = np.isfinite(found)
        assert wet.sum() > 50
        assert np.all(found[wet] >= low[wet])
        assert np.all(found[wet] <= high[wet])
