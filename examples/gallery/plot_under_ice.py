"""
A link under ice
================

Two vehicles at 60 m depth and 4 km apart, in open water and under an ice keel of 40 m draft. No ray
is direct: the water is slowest at the surface and bends sound up, so every ray reflects there, or
at the underside of the ice.
"""

import numpy as np
from matplotlib import pyplot as plt

from pymantaray import open_water
from pymantaray.acoustics import ray_picture

figure, panels = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
for axes, draft in zip(panels, (0.0, 40.0), strict=True):
    medium, _ = open_water("synthetic:beaufort", **({"ice": draft} if draft else {})).at_start
    picture = ray_picture(medium, [0, 0, 60], [4e3, 0, 60], max_surface_bounces=2)
    reflections = picture["ray_surface_bounces"].values
    for count in np.unique(reflections):
        rays = picture.isel(ray=reflections == count)
        label = f"reflections: {count}, travel time {float(rays['ray_travel_time'].mean()):.4f} s"
        lines = axes.plot(rays["ray_range"].T / 1e3, rays["ray_depth"].T, color=f"C{count}")
        lines[0].set_label(label)
    axes.axhspan(0.0, draft, color="lightgrey")
    axes.plot([0.0, 4.0], [60.0, 60.0], "ko")
    axes.set(ylim=(100.0, 0.0), ylabel="Depth [m]")
    axes.set_title(f"Keel of {draft:g} m draft" if draft else "Open water", loc="left")
    axes.legend(loc="lower right", fontsize="small")
panels[-1].set_xlabel("Distance [km]")
