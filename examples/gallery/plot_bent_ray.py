"""
A bent ray and the straight line
================================

A transmitter at 20 m and a receiver at 200 m, 10 km apart, in the synthetic Beaufort Sea. The modem
multiplies the travel time by the sound speed where it is, and the range that it reports is too
short.
"""

import numpy as np
from matplotlib import pyplot as plt

from pymantaray import open_water
from pymantaray.acoustics import find_eigenrays, ray_picture

medium, _ = open_water("synthetic:beaufort").at_start
source, receiver = [0.0, 0.0, 20.0], [10_000.0, 0.0, 200.0]  # north, east, down [m]
ray = find_eigenrays(medium, [source], [receiver]).first()
error = ray.source_sound_speed[0] * ray.travel_time[0] - np.linalg.norm(
    np.subtract(receiver, source)
)

picture = ray_picture(medium, source, receiver, n_depth=1001)
section = picture["sound_speed"].sel(depth=slice(0.0, 600.0)).T
figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
mesh = axes.pcolormesh(
    section["range"] / 1e3, section["depth"], section, cmap="Blues_r", rasterized=True
)
axes.plot(
    picture["ray_range"][0] / 1e3, picture["ray_depth"][0], color="#D55E00", lw=2.5, label="sound"
)
axes.plot(
    picture["chord_range"] / 1e3, picture["chord_depth"], "wo--", lw=1.5, label="straight line"
)
axes.set(ylim=(600.0, 0.0), xlabel="Distance [km]", ylabel="Depth [m]")
axes.set_title(f"Synthetic Beaufort Sea: the modem's range is wrong by {error:+.0f} m", loc="left")
axes.legend(loc="lower left", facecolor="lightgrey")
figure.colorbar(mesh, label="Sound speed [m/s]")
