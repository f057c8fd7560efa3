"""
A plan: how deep to hang a receiver
===================================

Twelve depths of a receiver T in the synthetic Fram Strait, evaluated without noise realizations. At
60 m and below, T loses less than half as many ranges as at the surface. Position errors change
little.
"""

from matplotlib import pyplot as plt

from pymantaray.apps.plan import DeploymentPlan, PlanSection, search_designs
from pymantaray.config import load_study

receiver = {"name": "T", "north": 0.0, "east": 0.0, "depth": 1.0, "sigma": 2.0}
water = {"ocean.source": "synthetic:fram", "ocean.centre_lat": 78.0, "ocean.centre_lon": 0.0}
depths = [1.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 150.0, 200.0, 300.0]
section = PlanSection(free={"landmarks.T.depth": depths}, lost_of="T")
plan = DeploymentPlan(load_study("quick", landmarks=[receiver], **water), section)
frame = search_designs(plan, workers=1).frame

figure, panels = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
panels[0].plot(depths, frame["lost_percent"], "o-")
panels[0].set(ylabel="Lost ranges of T [%]", ylim=(0.0, None))
panels[0].set_title("Preset quick in the synthetic Fram Strait", loc="left")
for column, label in (
    ("error_m", "95 % error"),
    ("bias_rmse_m", "RMS bias"),
    ("bound_rmse_m", "lower bound of RMSE"),
):
    panels[1].plot(depths, frame[column], "o-", label=label)
panels[1].set(xlabel="Depth of T [m]", ylabel="Position error [m]", ylim=(0.0, None))
panels[1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
