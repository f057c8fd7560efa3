"""
Range errors over a region
==========================

The bias atlas of the synthetic Beaufort Sea: the mean range error of 3 km links from 100 m to 300 m
depth over four bearings, in every 8th column. Ranges are too short everywhere, most in the east and
in eddies.
"""

import tempfile
from pathlib import Path

from matplotlib import pyplot as plt

from pymantaray.apps.atlas import Atlas, AtlasLinks, open_atlas, run_atlas

links = AtlasLinks(pairs=((100.0, 300.0),), distances=(3_000.0,), bearings=4)
with tempfile.TemporaryDirectory() as folder:
    path = run_atlas(
        Atlas("synthetic:beaufort", links, every=8), Path(folder) / "atlas.nc", workers=1
    )
    with open_atlas(path) as atlas:
        error = (
            atlas["range_error"]
            .sel(convention="transmitter", distance=3_000.0)
            .squeeze(["pair", "time"])
            .mean("bearing")
            .load()
        )

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
mesh = axes.pcolormesh(error["lon"], error["lat"], error.transpose("lat", "lon"), cmap="viridis")
axes.set(xlabel="Longitude [degrees]", ylabel="Latitude [degrees]")
axes.set_title("Synthetic Beaufort Sea: 3 km, 100 m to 300 m", loc="left")
figure.colorbar(mesh, label="Mean range error [m]")
