"""
Make a survey of three transponders whose truth is known: pings, drop points and a cast, for
`mantaray locate`.

Run with ``python examples/locate_survey.py FOLDER``. A ship sails a circle and a cross over the
nodes at 2 m/s, rolls and pitches, and pings each node every 40 s. The water is faster than the cast
by a fraction that drifts by 3e-4, times have noise of 0.1 ms, and 3 % of them are wrong by up to
0.6 s. The transponders answer after 13 ms; antenna and transducer are 21 m apart.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pymantaray import LocalFrame, Medium, find_eigenrays
from pymantaray.geometry import EarthSphere

LATITUDE = 44.83
CENTRE = LocalFrame(LATITUDE, -125.11)
NODES = {
    "P1": (410.0, -20.0, 1296.0),
    "P2": (-250.0, 380.0, 1310.0),
    "P3": (-230.0, -365.0, 1288.0),
}
DROPPED = {
    "P1": (425.0, -31.0, 1300.0),
    "P2": (-262.0, 371.0, 1300.0),
    "P3": (-214.0, -352.0, 1300.0),
}
LEVER = (6.0, -2.5, 20.0)  # antenna to transducer: forward, starboard, down, in metres
TURN_AROUND, SIGMA, GROSS = 0.013, 1e-4, 0.03
RADIUS, SPEED, INTERVAL, PINGS = 900.0, 2.0, 40.0, 300


def cast() -> tuple[np.ndarray, np.ndarray]:
    """Depths [m] and sound speeds [m/s] with a minimum at 600 m."""
    depth = np.arange(0.0, 1501.0, 20.0)
    return depth, 1480.0 + 12.0 * np.exp(-depth / 150.0) + 0.016 * np.maximum(depth - 600.0, 0.0)


def ship(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Antenna's north, east, depth [m] and heading, pitch, roll [rad]: laps of a circle, and a cross
    on every third.
    """
    turn = SPEED / RADIUS * time
    crossing = np.floor(turn / (2.0 * np.pi)) % 3 == 2
    angle = np.where(crossing, np.pi / 4.0, turn)
    along = np.where(crossing, np.cos(turn), 1.0) * RADIUS
    up = 12.0 + 0.5 * np.sin(2.0 * np.pi * time / 8.0)
    attitude = [
        (turn + np.pi / 2.0) % (2.0 * np.pi),
        np.radians(1.5) * np.sin(2.0 * np.pi * time / 7.0),
        np.radians(2.5) * np.sin(2.0 * np.pi * time / 11.0 + 1.0),
    ]
    return np.column_stack([along * np.cos(angle), along * np.sin(angle), -up]), np.column_stack(
        attitude
    )


def transducer(time: np.ndarray) -> np.ndarray:
    """Place of the transducer. [m]"""
    place, attitude = ship(time)
    return place + Rotation.from_euler("ZYX", attitude).apply(LEVER)


def slowing(time: np.ndarray) -> np.ndarray:
    """Factor of travel times in water that is faster than the cast."""
    return 1.0 - 3e-4 * (0.5 + np.sin(2.0 * np.pi * time / 7000.0))


def main(folder: str) -> None:
    """Write the files of a survey."""
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    earth = EarthSphere.at_latitude(LATITUDE)  # depths are below the curved sea surface
    medium = Medium.from_profile(*cast(), bottom_depth=1500.0, interpolation="linear", earth=earth)
    names, n = list(NODES), len(NODES)
    time = np.repeat(INTERVAL * np.arange(PINGS), n) + np.tile(1.5 * np.arange(n), PINGS)
    node = np.tile(np.arange(n), PINGS)
    place = np.array([NODES[name] for name in names])[node]

    def leg(at: np.ndarray) -> np.ndarray:
        return find_eigenrays(medium, transducer(at), place).first().travel_time * slowing(at)

    down = leg(time)
    two_way = 2.0 * down
    for _ in range(3):  # the ship moves on while the answer comes up
        two_way = down + leg(time + two_way + TURN_AROUND)
    received = time + two_way + TURN_AROUND
    measured = two_way + TURN_AROUND + rng.normal(0.0, SIGMA, time.size)
    wrong = rng.random(time.size) < GROSS
    measured[wrong] += rng.choice([-1.0, 1.0], wrong.sum()) * rng.uniform(0.02, 0.6, wrong.sum())

    head = ["time", "node", "two_way_time_s"]
    start = np.datetime64("2023-06-20T00:00:00", "us")
    columns = [
        (start + np.round(1e6 * time).astype("timedelta64[us]")).astype(str),
        np.array(names)[node],
    ]
    columns.append(np.char.mod("%.7f", measured))
    for end, at in (("", time), ("_rx", received)):
        antenna, attitude = ship(at)
        lat, lon = CENTRE.to_geodetic(antenna[:, 0], antenna[:, 1])
        head += [f"{name}{end}" for name in ("lat", "lon")] + [f"depth{end}_m"]
        head += [f"{name}{end}_deg" for name in ("heading", "pitch", "roll")]
        columns += [
            np.char.mod("%.9f", lat),
            np.char.mod("%.9f", lon),
            np.char.mod("%.4f", antenna[:, 2]),
        ]
        columns += [np.char.mod("%.5f", angle) for angle in np.degrees(attitude).T]
    rows = [",".join(row) for row in zip(*columns, strict=True)]
    (out / "pings.csv").write_text("\n".join([",".join(head), *rows]) + "\n")
    lines = ["name,lat,lon,depth_m,sigma_horizontal_m,sigma_depth_m,turn_around_ms"]
    for name, (north, east, depth) in DROPPED.items():
        lat, lon = CENTRE.to_geodetic(north, east)
        lines.append(f"{name},{lat:.9f},{lon:.9f},{depth:g},50,20,13")
    (out / "nodes.csv").write_text("\n".join(lines) + "\n")
    depth, speed = cast()
    levels = [f"{z:g},{c:.4f}" for z, c in zip(depth, speed, strict=True)]
    (out / "cast.csv").write_text("\n".join(["depth_m,sound_speed", *levels]) + "\n")
    truth = {}
    for name, (north, east, deep) in NODES.items():
        lat, lon = CENTRE.to_geodetic(north, east)
        truth[name] = {"lat": float(lat), "lon": float(lon), "depth": deep}
    (out / "truth.json").write_text(
        json.dumps({"nodes": truth, "gross_errors": int(wrong.sum())}, indent=1) + "\n"
    )


if __name__ == "__main__":
    main(sys.argv[1])
