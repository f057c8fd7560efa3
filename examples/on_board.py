"""
A vehicle estimates its position on board: dead reckoning, ranges at two constant sound speeds, and
MantaRay's travel-time table.

`python examples/on_board.py [FIGURE]` runs a mission of 20 minutes below warm surface water
(packages: `pymantaray[serve]`). Two beacons ping in turn. The program starts `mantaray serve`,
which computes what the vehicle hears and when. The loop feeds four estimators with the same
odometry, depths and travel times, prints their errors, and draws truth and estimates. One constant
speed is 1,500 m/s, the other is the speed of the profile at the vehicle's depth of 60 m.
"""

import http.client
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from pymantaray import open_water
from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
from pymantaray.apps.table import build_table
from pymantaray.geometry.se3 import so3_exp

STEP, PING, DURATION = 0.1, 20.0, 1200.0  # s
START = StartPose((0.0, -600.0, 60.0), sigma=[0.001, 0.001, 0.01, 2.0, 2.0, 0.2])
BEACONS = {"B1": Beacon((2500.0, 500.0, 200.0)), "B2": Beacon((-500.0, 2500.0, 200.0))}
ODOMETRY_SIGMA = np.array(
    [2e-5, 2e-5, 2e-4, 0.01, 0.01, 0.005]
)  # of a step; heading and speed drift besides
GYRO_BIAS, SCALE_ERROR = 2e-5, 0.01  # rad/s, 1
TRAVEL_TIME_SIGMA = 3e-4  # s


def write_profile(file: Path) -> None:
    """Write a profile with a warm surface layer, 300 m deep."""
    depth = np.linspace(0.0, 300.0, 61)
    speed = 1465.0 + 25.0 / (1.0 + np.exp((depth - 35.0) / 8.0)) + 0.016 * depth
    rows = [f"{z:g},{c:.3f}" for z, c in zip(depth, speed, strict=True)]
    file.write_text("\n".join(["depth_m,sound_speed", *rows, ""]))


@contextmanager
def server(profile: Path) -> Iterator[http.client.HTTPConnection]:
    """Run `mantaray serve` on a free port, and connect to it."""
    command = [
        sys.executable,
        "-m",
        "pymantaray",
        "serve",
        str(profile),
        "--bathymetry",
        "300",
        "--port",
        "0",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            ready = next(
                (line for line in process.stdout if line.startswith("listening on ")), None
            )
            if ready is None:
                sys.exit("on_board.py: the server did not start")
            with closing(
                http.client.HTTPConnection(ready.split("//")[1].strip(), timeout=60)
            ) as connection:
                yield connection
        finally:
            process.terminate()


def hear(
    connection: http.client.HTTPConnection, now: float, source: Beacon, vehicle: np.ndarray
) -> tuple[float, float] | None:
    """Arrival time and travel time of a ping at the vehicle; None if it hears nothing. [s]"""
    ends = [
        dict(zip(("north", "east", "depth"), map(float, place), strict=True))
        for place in (source.position, vehicle)
    ]
    ping = {"time": now, "source": ends[0], "receivers": [{"name": "vehicle", **ends[1]}]}
    connection.request("POST", "/ping", json.dumps(ping))
    answer = json.loads(connection.getresponse().read())
    if "error" in answer:
        raise RuntimeError(answer["error"])
    found = answer["receivers"][0]
    return None if found["arrival_time"] is None else (found["arrival_time"], found["travel_time"])


def estimators(profile: Path) -> dict[str, OnlineEstimator]:
    """Four estimators that differ in their ranges only."""
    water = open_water(str(profile), bathymetry=300.0)
    medium, _ = water.at_start
    at_vehicle = float(medium.sound_speed_at([START.position])[0])
    # without the third numbers, cells are halved to 0.2 m and building takes ten times as long
    table = build_table(
        water, (195.0, 205.0, 2.5), (50.0, 70.0, 2.5), (500.0, 4000.0, 50.0), tolerance=0.1
    )
    wide = {"lag": 30.0, "gate": np.inf}
    return {
        "dead reckoning": OnlineEstimator(START, {}, 1500.0, **wide),
        "1500 m/s": OnlineEstimator(START, BEACONS, 1500.0, **wide),
        f"{at_vehicle:.1f} m/s": OnlineEstimator(START, BEACONS, at_vehicle, **wide),
        "MantaRay": OnlineEstimator(START, BEACONS, table, **wide),
    }


def main(figure: str | None = None) -> None:
    """Run the mission, print the errors, and draw the tracks if there is a file for them."""
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "profile.csv"
        write_profile(profile)
        fleet = estimators(profile)
        with server(profile) as connection:
            tracks = fly(fleet, connection)
    print_errors(fleet, tracks)
    if figure is not None:
        draw({name: np.array(track) for name, track in tracks.items()}, figure)


def fly(
    fleet: dict[str, OnlineEstimator], connection: http.client.HTTPConnection
) -> dict[str, list[np.ndarray]]:
    """Move the vehicle, and feed the estimators; positions each 10 s."""
    rng = np.random.default_rng(2)
    rotation, position = np.eye(3), np.array(START.position)
    tracks: dict[str, list[np.ndarray]] = {"truth": [], **{name: [] for name in fleet}}
    on_its_way: list[tuple[float, float, str, float]] = []
    for k in range(1, round(DURATION / STEP) + 1):
        now = k * STEP
        turn = np.array([0.0, 0.0, 0.004 * np.sin(2.0 * np.pi * now / 900.0) * STEP])
        way = np.array([1.5 * STEP, 0.0, 0.0])
        position, rotation = position + rotation @ way, rotation @ so3_exp(turn)
        noise = ODOMETRY_SIGMA * rng.standard_normal(6)
        odometry = (
            (1.0 + SCALE_ERROR) * way + noise[3:],
            turn + noise[:3] + [0.0, 0.0, GYRO_BIAS * STEP],
            ODOMETRY_SIGMA,
        )
        depth = position[2] + 0.1 * rng.standard_normal()
        for name, estimator in fleet.items():
            estimator.add_odometry(now, *odometry)
            if k % 10 == 0:
                estimator.add_depth(now, depth, 0.1)
            if k % 100 == 0:
                tracks[name].append(estimator.position())
        if k % 100 == 0:
            tracks["truth"].append(position)
        if k % round(PING / STEP) == 0:
            beacon = list(BEACONS)[k // round(PING / STEP) % len(BEACONS)]
            heard = hear(connection, now, BEACONS[beacon], position)
            if heard is not None:
                arrival, travel_time = heard
                measured = travel_time + TRAVEL_TIME_SIGMA * rng.standard_normal()
                on_its_way.append((arrival, now, beacon, measured))
        # decoding takes a second; the server's travel time belongs to the vehicle's position at the
        # ping
        while on_its_way and on_its_way[0][0] + 1.0 <= now:
            _, sent, beacon, measured = on_its_way.pop(0)
            for estimator in fleet.values():
                if beacon in estimator.beacons:
                    estimator.add_range(sent, beacon, measured, TRAVEL_TIME_SIGMA)
    return tracks


def print_errors(fleet: dict[str, OnlineEstimator], tracks: dict[str, list[np.ndarray]]) -> None:
    """Print the horizontal errors of each estimator."""
    truth = np.array(tracks["truth"])
    for name, estimator in fleet.items():
        error = np.linalg.norm((np.array(tracks[name]) - truth)[:, :2], axis=1)
        rms, used = np.sqrt(np.mean(error**2)), estimator.counts()["used"]
        print(
            f"{name:15} error {rms:6.2f} m RMS, {error[-1]:6.2f} m at the end; {used} measurements"
            " used"
        )


def draw(tracks: dict[str, np.ndarray], figure: str) -> None:
    """Draw the tracks and their horizontal errors."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    fig, (chart, errors) = plt.subplots(1, 2, figsize=(10.0, 4.5), layout="constrained")
    time = 100 * STEP * np.arange(1, len(tracks["truth"]) + 1) / 60.0
    for name, track in tracks.items():
        wide = {"color": "0.75", "linewidth": 6.0} if name == "truth" else {}
        line = chart.plot(track[:, 1], track[:, 0], label=name, **wide)
        if name != "truth":
            error = np.linalg.norm((track - tracks["truth"])[:, :2], axis=1)
            errors.plot(time, error, label=name, color=line[0].get_color())
    for name, beacon in BEACONS.items():
        chart.plot(beacon.position[1], beacon.position[0], "k^")
        chart.annotate(
            name,
            (beacon.position[1], beacon.position[0]),
            (0.0, -14.0),
            textcoords="offset points",
            ha="center",
        )
    chart.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    chart.margins(0.1)
    chart.legend()
    errors.set(xlabel="time [min]", ylabel="horizontal error [m]")
    errors.legend()
    fig.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(*sys.argv[1:2])
