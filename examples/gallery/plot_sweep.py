"""
A sweep: position error against time between pings
==================================================

Three small studies with pings every half hour, hour and two hours, with straight and with refracted
ranges.
"""

import tempfile

from matplotlib import pyplot as plt

from pymantaray.apps.sweep import Sweep, run_sweep

sweep = Sweep("quick", cross={"mission.ping_interval_h": [0.5, 1.0, 2.0]})
with tempfile.TemporaryDirectory() as folder:
    table = run_sweep(sweep, folder, workers=1).table()

LABELS = {
    "odometry": "odometry only",
    "straight": "straight ranges",
    "refracted": "refracted ranges",
}
figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for condition, rows in table.groupby("condition"):
    axes.plot(
        rows["mission.ping_interval_h"].astype(float), rows["rmse_m"], "o-", label=LABELS[condition]
    )
axes.set(xlabel="Time between pings [h]", ylabel="RMSE of position [m]", yscale="log")
axes.set_yticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"], minor=False)
axes.yaxis.minorticks_off()
axes.set_title("Preset quick, synthetic Beaufort Sea", loc="left")
axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
