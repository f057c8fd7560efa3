"""
Sound in a duct
===============

Water that is slowest at 150 m keeps sound near that depth: a fan of rays from the middle of the
duct, and one from 20 m.
"""

import numpy as np
from matplotlib import pyplot as plt

from pymantaray.acoustics import Medium, ray_picture

depth = np.array([0.0, 75.0, 150.0, 300.0, 600.0, 1200.0, 3000.0])
speed = np.array([1450.0, 1443.0, 1440.0, 1446.0, 1456.0, 1466.0, 1496.0])
medium = Medium.from_profile(depth, speed, bottom_depth=3000.0)

figure, panels = plt.subplots(
    1, 3, figsize=(8, 3.6), sharey=True, width_ratios=(1, 3, 3), layout="constrained"
)
panels[0].plot(speed, depth, color="#D55E00")
panels[0].set(
    ylim=(600.0, 0.0), xlim=(1438.0, 1458.0), xlabel="Sound speed [m/s]", ylabel="Depth [m]"
)
angles = np.radians(np.linspace(-6, 6, 25))
for axes, start in zip(panels[1:], (150.0, 20.0), strict=True):
    picture = ray_picture(
        medium, [0, 0, start], [20e3, 0, start], fan_angles=angles, spreading_cutoff_db=None
    )
    fan = picture.sel(ray=picture["ray_arrives"] == 0)
    axes.plot(fan["ray_range"].T / 1e3, fan["ray_depth"].T, color="#0072B2", lw=0.7)
    axes.set(
        xlabel="Distance [km]", ylabel="Depth [m]", title=f"From {start:g} m, within 6 degrees"
    )
    axes.label_outer()
