"""
Measured beside predicted travel times
======================================

A simulated campaign under ice: 400 measured travel times between six nodes with clock errors, and
the travel times that rays in the casts predict. The offsets of the clocks are estimated. What
remains is noise, and later arrivals (above zero).
"""

import runpy
import tempfile
from pathlib import Path

import pandas as pd
from matplotlib import pyplot as plt

from pymantaray import open_waters
from pymantaray.apps.replay import read_events, replay_events

with tempfile.TemporaryDirectory() as folder:
    runpy.run_path("../replay_campaign.py")["main"](folder)  # this script runs in its own folder
    events = pd.read_csv(Path(folder) / "events.csv").head(400)
    events.to_csv(Path(folder) / "events.csv", index=False)
    waters = open_waters(Path(folder) / "casts.csv", bathymetry=3000.0, max_surface_bounces=1)
    replay = replay_events(read_events(Path(folder) / "events.csv"), waters, rule="within:6")

offset = replay.clocks.set_index("node")["offset_s"]
clocks = replay.events["receiver"].map(offset) - replay.events["source"].map(offset)

figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), sharey=True, layout="constrained")
time, residual = replay.events["time_s"] / 60.0, replay.events["residual_s"]
for node, at in replay.events.groupby("receiver").groups.items():
    panels[0].plot(time[at], 1e3 * residual[at], ".", label=node)
    panels[1].plot(time[at], 1e3 * (residual - clocks)[at], ".")
panels[0].set(ylabel="Measured minus predicted [ms]", xlabel="Time [min]", title="As measured")
panels[1].set(
    ylabel="Measured minus predicted [ms]", xlabel="Time [min]", title="Clock offsets removed"
)
panels[1].label_outer()
figure.legend(*panels[0].get_legend_handles_labels(), title="Receiver", loc="outside right center")
