"""
Located nodes
=============

Three transponders at 1300 m and 900 two-way travel times from a ship that rolls, in water faster
than the cast: the estimated positions, their 95 % ellipses, and the true positions, which are known
because the survey is simulated.
"""

import json
import runpy
import tempfile
from pathlib import Path

from matplotlib import pyplot as plt
from matplotlib.patches import Ellipse

from pymantaray.acoustics import Medium, read_profile
from pymantaray.apps.locate import LocateOptions, ReadOptions, locate, read_survey

with tempfile.TemporaryDirectory() as folder:
    runpy.run_path("../locate_survey.py")["main"](folder)  # this script runs in its own folder
    at = Path(folder)
    survey = read_survey(at / "pings.csv", ReadOptions(nodes=at / "nodes.csv", lever=(6, -2.5, 20)))
    cast = read_profile(at / "cast.csv")
    truth = json.loads((at / "truth.json").read_text())["nodes"]
water = Medium.from_profile(cast.depth, cast.sound_speed, bottom_depth=1500, interpolation="linear")
nodes = locate(survey, water, LocateOptions(speed_model="time")).nodes.set_index("name")


figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
left.plot(*survey.transmit_position[:, 1::-1].T, ".", ms=2, color="grey", label="ship")
for k, (name, row) in enumerate(nodes.iterrows()):
    left.plot(row["east"], row["north"], "^", ms=9, color=f"C{k}", label=name)
    north, east = survey.frame.to_local(truth[name]["lat"], truth[name]["lon"])
    error = 100.0 * (row["east"] - east), 100.0 * (row["north"] - north)  # cm
    size = 200.0 * row["ellipse_minor_m"], 200.0 * row["ellipse_major_m"]
    right.add_patch(Ellipse(error, *size, angle=-row["ellipse_azimuth_deg"], fc=f"C{k}", alpha=0.2))
    right.plot(*error, "o", color=f"C{k}")
right.plot(0.0, 0.0, "k+", ms=14)
left.set(title="Survey", xlabel="East [m]", ylabel="North [m]", aspect="equal")
right.set(title="Estimate minus truth", xlabel="East [cm]", ylabel="North [cm]", aspect="equal")
left.legend(loc="upper right", fontsize="small")
