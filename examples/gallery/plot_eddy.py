"""
Through an eddy
===============

Two vehicles at 150 m, 10 km apart, on either side of a warm eddy of 10 km radius. Sound that
crosses it arrives early, and ranges are too short. Near the centre the eddy spreads the rays so far
that their loss is more than 15 dB above spherical spreading: by default such rays are no arrivals.
"""

import numpy as np
from matplotlib import pyplot as plt

from pymantaray.acoustics import Medium, find_eigenrays

axis = np.linspace(-30e3, 30e3, 61)
depth = np.linspace(0.0, 1000.0, 41)
north, east, down = np.meshgrid(axis, axis, depth, indexing="ij")
warm = 8.0 * np.exp(-(north**2 + east**2) / 1e4**2 - ((down - 150.0) / 150.0) ** 2)
speed = 1440.0 + 0.016 * down + warm
medium = Medium.from_grid(axis, axis, depth, speed, bathymetry=np.full((61, 61), 1000.0))

offset = np.linspace(-25e3, 25e3, 251)
zero = np.zeros_like(offset)
ray = find_eigenrays(
    medium,
    np.stack([zero - 5e3, offset, zero + 150.0], 1),
    np.stack([zero + 5e3, offset, zero + 150.0], 1),
).first()
figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
axes.plot(offset / 1e3, 1442.4 * ray.travel_time - 10e3)
weak = offset[np.isnan(ray.travel_time)] / 1e3
axes.axvspan(weak.min(), weak.max(), color="lightgrey", label="rays too weak")
axes.set(xlabel="Distance of the link from the eddy's centre [km]", ylabel="Range error [m]")
axes.set_title("Ranges over 10 km with the sound speed outside the eddy", loc="left")
axes.legend(loc="lower right")
