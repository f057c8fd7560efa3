"""
Vehicles that another program moves: their ranges through an ocean by three roads, and what
estimators make of them.

Three unicycles are integrated in plain numpy and written as a table. The table goes through
`measure`, through a study whose fleet it is, and, ping by ping, through a `RangingService`: the
travel times are the same to the last digit.

    python examples/own_trajectories.py [FOLDER]      a new folder for the table and the study's run
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from pymantaray import StudyConfig, load_study
from pymantaray.apps.ranges import measure
from pymantaray.apps.service import RangingService
from pymantaray.apps.study import run_study
from pymantaray.evaluation import error_table, range_error_table

CENTRE = {"centre_lat": 74.5, "centre_lon": -140.0}
OCEAN = {"source": "synthetic:beaufort", **CENTRE}
INTERVAL = 300.0  # s, between pings of everybody to everybody
STUDY = f"""
[study]
name = "own-trajectories"
realizations = 2

[ocean]
source = "synthetic:beaufort"
centre_lat = {CENTRE["centre_lat"]}
centre_lon = {CENTRE["centre_lon"]}

[mission]
ping_interval_h = {INTERVAL / 3600.0!r}

[fleet]
trajectories = "mission.csv"
"""


def unicycles(duration: float = 3600.0, step: float = 10.0) -> pd.DataFrame:
    """
    Poses of three vehicles that swim at constant speed and turn at a constant rate, each at its
    depth.
    """
    time = np.arange(0.0, duration + step, step)
    parts = []
    for name, start, speed, heading, rate, depth in (
        ("auv1", (0.0, 0.0), 1.5, 0.3, 4e-4, 40.0),
        ("auv2", (2500.0, -800.0), 1.2, 2.0, -6e-4, 150.0),
        ("auv3", (-1500.0, 3000.0), 1.0, -1.0, 3e-4, 400.0),
    ):
        headings = heading + rate * time
        place = np.zeros((time.size, 2)) + start
        for k in range(time.size - 1):  # x' = v cos(heading), y' = v sin(heading)
            place[k + 1] = place[k] + speed * step * np.array(
                [np.cos(headings[k]), np.sin(headings[k])]
            )
        parts.append(
            pd.DataFrame(
                {
                    "time": time,
                    "vehicle": name,
                    "north": place[:, 0],
                    "east": place[:, 1],
                    "depth": depth + 10.0 * np.sin(time / 400.0),
                    "heading": headings,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def ping_by_ping(config: StudyConfig, fleet: pd.DataFrame, times: list[float]) -> pd.Series:
    """
    One-way travel time of each ping to each listener, asked for as a simulator would in its loop.
    [s]
    """
    places = {
        name: rows.set_index("time")[["north", "east", "depth"]]
        for name, rows in fleet.groupby("vehicle")
    }
    out = {}
    with RangingService(config) as service:
        for time in times:
            at = {name: rows.loc[time].to_numpy() for name, rows in places.items()}
            for source, place in at.items():
                listeners = [name for name in at if name != source]
                ping = service.ping(time, place, [at[name] for name in listeners])
                out |= {
                    (time, source, name): t
                    for name, t in zip(listeners, ping.travel_time, strict=True)
                }
    return pd.Series(out)


def main(folder: Path) -> None:
    """Write the table, take the three roads, compare."""
    if folder.exists():
        sys.exit(f"{folder}: is already there; give a new folder")
    folder.mkdir(parents=True)
    fleet = unicycles()
    fleet.to_csv(folder / "mission.csv", index=False)
    (folder / "study.toml").write_text(STUDY)

    ranges = measure(folder / "mission.csv", OCEAN, INTERVAL)
    errors = range_error_table(ranges.measurements, ranges.ranging_truth, ranges.truth).iloc[-1]
    print(
        f"{errors['n']} of {errors['attempts']} ranges heard, error {errors['mean_m']:+.2f} m on"
        " average"
    )

    config = load_study(folder / "study.toml")
    study = run_study(config, folder / "run", workers=1)
    table = ranges.ranges().set_index(["time", "transmitter", "receiver"])["travel_time"]
    by_study = study.ranges().set_index(["time", "transmitter", "receiver"])["travel_time"]
    by_ping = ping_by_ping(config, fleet, table.index.unique("time").tolist())
    print("study: the same travel times:", table.equals(by_study))
    print("service: the same travel times:", table.equals(by_ping.reindex(table.index)))
    for row in error_table(study.truth, study.estimates).itertuples():
        print(f"{row.condition:<10} mean position error {row.mean_m:.2f} m")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "own-trajectories"))
