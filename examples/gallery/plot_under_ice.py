"""
A link under ice
================

Ice of 4 m draft is the upper boundary of the water: direct rays, and those that the ice reflects, between two vehicles.
"""

from matplotlib import pyplot as plt

from pymantaray.acoustics import ray_picture
from pymantaray.water import open_water

figure, panels = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
for axes, draft in zip(panels, (0.0, 40.0), strict=True):
    medium, _ = open_water("synthetic:beaufort", **({"ice": draft} if draft else {})).at_start
    picture = ray_picture(medium, [0, 0, 60], [4e3, 0, 60], max_surface_bounces=2, spreading_cutoff_db=15.0)
    for ray in range(picture.sizes["ray"]):
        bounces = int(picture["ray_surface_bounces"][ray])
        colour = ("#D55E00", "#0072B2", "#009E73")[bounces]
        label = f"{bounces} reflections, {float(picture['ray_travel_time'][ray]):.4f} s"
        axes.plot(picture["ray_range"][ray] / 1e3, picture["ray_depth"][ray], color=colour, label=label)
    axes.axhspan(0.0, draft, color="lightgrey")
    axes.set(
        ylim=(200.0, 0.0), ylabel="Depth [m]", title=f"Keel of {draft:g} m draft" if draft else "Open water"
    )
    axes.legend(ncols=2, loc="lower left", fontsize="small")
panels[-1].set_xlabel("Distance [km]")
