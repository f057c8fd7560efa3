"""
Print how far a model's sound speed is from casts by depth: what a belief taken from a model errs
by.

Run with ``python benchmarks/model_minus_cast.py [DATA]``; DATA holds ``casts`` and ``hycom`` and is
by default ../shared/data beside the repository. A cast is averaged over the cells of the model's
levels. The first pair is of one month and place, but the model is our synthetic Beaufort Sea; the
second is HYCOM's own column, a year later and 300 km away, so that its difference holds a year and
an eddy too.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.ocean import open_ocean, read_cast, sound_speed

DATA = Path(__file__).parents[2] / "shared" / "data"
COLUMN = "hycom_glby_930_20210308T12_beaufort_point_ncss.csv"
SCALE, OFFSET, MISSING = 0.001, 20.0, -30000.0  # of its packed integers
PAIRS = {
    "synthetic Beaufort Sea": (
        "beaufort_axctd_20140724_74N140W.csv",
        "beaufort_axctd_20140724_75N140W.csv",
    ),
    "HYCOM, 8 March 2021": ("beaufort_xctd_icex20_1.csv", "beaufort_xctd_icex20_4.csv"),
}
ICEX = (71.2, -142.4)  # of the casts that do not say where they were taken
DOWN_TO = 400.0
Array = NDArray[np.float64]


def synthetic_column(lat: float, lon: float) -> tuple[Array, Array, Array]:
    """Depth [m], in-situ temperature [degC] and practical salinity of the nearest grid point."""
    ocean = open_ocean(
        "synthetic:beaufort", time=np.datetime64("2014-07-24"), window=(73.5, 75.5, -141.0, -139.0)
    )
    place = ocean.sel(lat=lat, lon=lon, method="nearest")
    return tuple(place[name].values.astype(float) for name in ("depth", "water_temp", "salinity"))


def hycom_column(file: Path) -> tuple[Array, Array, Array]:
    """The same of the file that HYCOM's server gave for a point."""
    table = pd.read_csv(file)
    depth, salinity, temperature = (table.iloc[:, k].to_numpy(float) for k in (3, 4, 5))
    wet = salinity > MISSING
    return depth[wet], SCALE * temperature[wet] + OFFSET, SCALE * salinity[wet] + OFFSET


def main() -> None:
    """Print a table for each pair."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", nargs="?", type=Path, default=DATA)
    data = parser.parse_args().data
    if not (data / "casts").is_dir():
        print(f"no casts in {data}; nothing to compare")
        return
    for model, names in PAIRS.items():
        columns = {}
        for name in names:
            own_place = "icex" not in name
            cast = read_cast(
                data / "casts" / name,
                **({} if own_place else dict(zip(("lat", "lon"), ICEX, strict=True))),
            )
            depth, *water = (
                synthetic_column(cast.lat, cast.lon)
                if own_place
                else hycom_column(data / "hycom" / COLUMN)
            )
            levels = depth[depth <= DOWN_TO]
            modelled = sound_speed(water[0], water[1], depth, cast.lat, cast.lon)[: levels.size]
            measured = sound_speed(*cast.cell_means(levels), levels, cast.lat, cast.lon)
            columns[name.removesuffix(".csv")] = pd.Series(modelled - measured, levels)
        table = pd.DataFrame(columns)
        print(f"\n{model} less casts [m/s], by depth [m]")
        print(table.to_string(float_format="{:+.1f}".format))
        print(
            "rms of the upper 300 m:", np.sqrt((table.loc[:300.0] ** 2).mean()).round(2).to_dict()
        )


if __name__ == "__main__":
    main()
