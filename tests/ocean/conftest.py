"""Real data that are not in the project, and oceans whose fields are known in closed form."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import assemble_ocean, open_ocean, synthetic_ocean
from pymantaray.ocean.synthetic import HYCOM_DEPTHS

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data():
    if not DATA.is_dir():
        pytest.skip(f"real data are not at {DATA}")
    return DATA


@pytest.fixture(scope="session")
def gulf_stream_files(shared_data):
    return [
        shared_data / "hycom" / f"hycom_glby_930_2019030712_t003_{kind}.nc"
        for kind in ("ts3z", "uv3z")
    ]


@pytest.fixture(scope="session")
def beaufort_sea():
    return synthetic_ocean("beaufort")


@pytest.fixture(scope="session")
def fram_strait():
    return synthetic_ocean("fram")


@pytest.fixture(scope="session")
def closed_form_ocean():
    """Factory of oceans on HYCOM's grid around a centre, from functions of depth, lat and lon."""

    def make(
        lat_0,
        lon_0,
        *,
        temperature,
        salinity=lambda _z, _lat, _lon: 34.0,
        u=lambda _z, _lat, _lon: 0.3,
        v=lambda _z, _lat, _lon: -0.1,
        floor=lambda _lat, _lon: 1e4,
        n=(41, 61),
        depth=HYCOM_DEPTHS,
    ) -> xr.Dataset:
        z = np.asarray(depth, dtype=float)
        lat = lat_0 + 0.04 * (np.arange(n[0]) - (n[0] - 1) / 2)
        lon = lon_0 + 0.08 * (np.arange(n[1]) - (n[1] - 1) / 2)
        grid = np.meshgrid(z, lat, lon, indexing="ij")
        wet = grid[0] <= floor(grid[1], grid[2])
        named = {"water_temp": temperature, "salinity": salinity, "water_u": u, "water_v": v}
        return assemble_ocean(
            {"depth": z, "lat": lat, "lon": lon},
            np.datetime64("2020-01-01T00:00"),
            {k: np.where(wet, f(*grid), np.nan) for k, f in named.items()},
            title="closed form",
            source="test",
            synthetic=True,
        )

    return make


@pytest.fixture(scope="session")
def message_of():
    """The one line with which an ocean does not open."""

    def call(*args, **kwargs) -> str:
        with pytest.raises(OceanError) as caught:
            open_ocean(*args, **kwargs)
        message = str(caught.value)
        assert len(message.splitlines()) == 1
        assert message.isprintable()
        return message

    return call
