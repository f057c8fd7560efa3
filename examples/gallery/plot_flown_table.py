"""
Ranges of existing trajectories
===============================

A table of time, vehicle and position in the synthetic Beaufort Sea: every pair ranges every 5
minutes. The two directions of a pair differ, because each range uses the sound speed at its
transmitter.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

from pymantaray.apps.ranges import measure

time = np.arange(0.0, 7201.0, 60.0)
moves = (
    ("auv1", 0.0, 0.9, 0.3, 60.0),
    ("auv2", 3e3, -0.2, 0.8, 400.0),
    ("auv3", 5e3, 0.0, -0.5, 200.0),
)
rows = [
    {"time": time, "vehicle": name, "north": n + u * time, "east": v * time, "depth": z}
    for name, n, u, v, z in moves
]
with tempfile.TemporaryDirectory() as folder:
    pd.concat(pd.DataFrame(row) for row in rows).to_csv(Path(folder) / "flown.csv", index=False)
    ranges = measure(Path(folder) / "flown.csv", "synthetic:beaufort", 300.0).ranges()

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for link, part in ranges.groupby(["transmitter", "receiver"]):
    error = part["refracted_range"] - part["straight_range"]
    axes.plot(part["time"] / 60.0, error, ".-", label=" to ".join(link))
axes.set(xlabel="Time [min]", ylabel="Range error [m]")
axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
axes.set_title("Travel time times sound speed at the transmitter, minus distance", loc="left")
