"""
Measured beside predicted travel times
======================================

A made-up campaign under ice: six nodes with clocks that are off, casts, and 400 measured travel times.
"""

import runpy
import tempfile
from pathlib import Path

import pandas as pd
from matplotlib import pyplot as plt

from pymantaray.replay import read_events, replay_events
from pymantaray.water import open_waters

with tempfile.TemporaryDirectory() as folder:
    runpy.run_path("../replay_campaign.py")["main"](folder)  # this script runs in its own folder
    events = pd.read_csv(Path(folder) / "events.csv").head(400)
    events.to_csv(Path(folder) / "events.csv", index=False)
    waters = open_waters(Path(folder) / "casts.csv", bathymetry=3000.0, max_surface_bounces=1)
    replay = replay_events(read_events(Path(folder) / "events.csv"), waters, rule="within:6")

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
axes.plot(replay.events["time_s"] / 60.0, 1e3 * replay.events["residual_s"], ".")
axes.set(xlabel="Time [min]", ylabel="Measured minus predicted [ms]")
