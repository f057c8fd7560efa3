"""
Air-gun shots along one line at an ocean-bottom instrument: an unknown clock and position, times of
direct rays in closed form and of head waves in the sea bed, noise of 19 ms.
"""

import json

import numpy as np
import pytest
from oracles import direct_travel_time_linear_gradient

SURFACE_SPEED, GRADIENT, DEPTH, GUN = 1480.0, 0.017, 2500.0, 8.0
NOISE = 0.019  # s
HEAD_FROM, CRUST_SPEED = 10e3, 4500.0
CLOCK = ("--clock-offset-sigma", 10, "--clock-drift-sigma", "1e-5")


def direct(shots, node):
    return direct_travel_time_linear_gradient(
        shots, node, sound_speed_surface=SURFACE_SPEED, gradient=GRADIENT
    )


class Line:
    """Shots on a line with an azimuth of 34 degrees, and the files that a user has."""

    def __init__(
        self, folder, *, ends=(-20e3, 20e3), across=2500.0, offset=2.3, step=150.0, seed=0
    ):
        rng = np.random.default_rng(seed)
        along = np.arange(*ends, step)
        self.along = np.array([np.cos(0.6), np.sin(0.6)])
        self.across = np.array([-self.along[1], self.along[0]])
        shots = along[:, None] * self.along + 20.0 * np.sin(along / 3e3)[:, None] * self.across
        shots = np.column_stack([shots, np.full(along.size, GUN)])
        self.truth = np.append(700.0 * self.along + across * self.across, DEPTH)
        distance = np.linalg.norm(shots[:, :2] - self.truth[:2], axis=1)
        self.is_head = distance > HEAD_FROM
        kink = direct(np.array([HEAD_FROM, 0.0, GUN]), np.array([0.0, 0.0, DEPTH]))
        travel_time = np.where(
            self.is_head, kink + (distance - HEAD_FROM) / CRUST_SPEED, direct(shots, self.truth)
        )
        time = 60.0 * np.arange(along.size)
        self.clock = offset, 3e-6
        measured = travel_time + offset + 3e-6 * time + rng.normal(0.0, NOISE, along.size)
        rows = ["time,node,one_way_time_s,direction,north_m,east_m,depth_m"]
        for values in zip(time, measured, *shots.T, strict=True):
            rows.append("{:g},OBS1,{:.6f},to node,{:.3f},{:.3f},{:g}".format(*map(float, values)))
        pings = folder / "pings.csv"
        pings.write_text("\n".join(rows) + "\n")
        north, east, depth = self.truth + np.array([1500.0, -800.0, 60.0])
        nodes = folder / "nodes.csv"
        nodes.write_text(
            "name,north_m,east_m,depth_m,sigma_horizontal_m,sigma_depth_m\n"
            f"OBS1,{north},{east},{depth},2000,100\n"
        )
        profile = folder / "cast.csv"
        levels = [(z, SURFACE_SPEED + GRADIENT * z) for z in (0.0, 4000.0)]
        profile.write_text(
            "\n".join(["depth_m,sound_speed", *(f"{z:g},{c:g}" for z, c in levels)]) + "\n"
        )
        self.words = ["locate", pings, "--profile", profile, "--earth", "flat"]
        self.with_nodes = [*self.words, "--nodes", nodes]
        self.with_depth = [*self.words, "--depth", 2500]

    def errors(self, node):
        """Errors along the line, of the distance from it, and of depth."""
        north, east = node["north"], node["east"]
        step = np.array([north, east])
        across = abs(step @ self.across) - abs(self.truth[:2] @ self.across)
        return (step - self.truth[:2]) @ self.along, across, node["depth"] - DEPTH


@pytest.mark.slow
@pytest.mark.parametrize("start", ["with_nodes", "with_depth"])
@pytest.mark.parametrize("offset", [2.3, -4.0])
def test_an_instrument_beside_a_line_is_located_with_its_mirror(mantaray, tmp_path, start, offset):
    line = Line(tmp_path, offset=offset)
    done = json.loads(mantaray(*getattr(line, start), *CLOCK, "--json").out)
    (node,) = done["nodes"]
    along, across, depth = line.errors(node)
    assert abs(along) < 30.0, line.errors(node)
    sigma = np.hypot(node["sigma_north_m"], node["sigma_east_m"])
    assert abs(across) < 4.0 * sigma < 2000.0
    assert abs(depth) < 4.0 * node["sigma_depth_m"]
    (mirror,) = done["mirrors"]
    assert mirror["undecided"]
    assert node["status"] == "two solutions"
    clock = {row["unknown"]: row for row in done["unknowns"]}["OBS1 clock offset [s]"]
    assert clock["value"] == pytest.approx(offset, abs=5.0 * clock["sigma"])
    assert done["rms_s"] == pytest.approx(NOISE, rel=0.2)


def test_head_waves_are_left_out_with_their_reason(told, tmp_path):
    line = Line(tmp_path, step=300.0)
    done = told(*line.with_depth, *CLOCK)
    unused = {row["line"] - 2: row["reason"] for row in done["rejected"]}  # below the header
    early = [row for row in np.flatnonzero(line.is_head) if "head wave" not in unused.get(row, "")]
    assert len(early) <= 0.02 * line.is_head.sum()  # those in the noise at the change
    direct_ones = np.flatnonzero(~line.is_head)
    lost = [row for row in direct_ones if row in unused]
    assert len(lost) <= 0.06 * direct_ones.size
    assert "s before the direct ray" in unused[0]


def test_a_line_beyond_the_last_direct_ray_says_so(mantaray, tmp_path, as_stored):
    """In water whose sound speed falls with depth, sound from the surface bends to the bed."""
    gradient, speed = -0.05, 1540.0
    along = np.arange(-24e3, 24e3, 400.0)
    shots = np.column_stack([along, 0.0 * along, np.full(along.size, GUN)])
    node = np.array([300.0, 1200.0, 1000.0])
    distance = np.linalg.norm(shots[:, :2] - node[:2], axis=1)
    # a ray that leaves the gun horizontally is the last one: an arc of the radius c / g
    radius = (speed + gradient * GUN) / -gradient
    last = np.sqrt(radius**2 - (radius - (node[2] - GUN)) ** 2)
    shadow = distance > last
    time = np.array(
        [
            direct_travel_time_linear_gradient(
                shot, node, sound_speed_surface=speed, gradient=gradient
            )
            for shot in shots
        ]
    )
    late = 0.6 + 1e-5 * distance  # a reflection of the sea bed and the surface
    rng = np.random.default_rng(2)
    time = time + np.where(shadow, late, 0.0) - 1.4 + rng.normal(0.0, 0.005, along.size)
    rows = ["time,node,one_way_time_s,direction,north_m,east_m,depth_m"]
    rows += [
        f"{60 * k},OBS1,{time[k]:.6f},to node,{shots[k, 0]:.3f},0,{GUN}" for k in range(along.size)
    ]
    (tmp_path / "pings.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "cast.csv").write_text(
        f"depth_m,sound_speed\n0,{speed}\n1400,{speed + 1400 * gradient}\n"
    )
    words = (
        "locate",
        tmp_path / "pings.csv",
        "--profile",
        tmp_path / "cast.csv",
        "--earth",
        "flat",
    )
    water = ("--depth", 1000, "--depth-sigma", 10, "--bathymetry", 1400)
    done = json.loads(mantaray(*words, *water, *CLOCK, "--json").out)
    unused = {row["line"] - 2: row["reason"] for row in done["rejected"]}
    assert set(unused) >= set(np.flatnonzero(distance > last + 400.0).tolist())
    assert "no direct ray at 24" in unused[0]
    assert "head wave or reflection" in unused[0]
    assert done["nodes"][0]["north"] == pytest.approx(300.0, abs=30.0)
    as_stored(done, without="mirrors|candidates")


def test_an_unknown_clock_that_counts_as_known_is_refused(mantaray, tmp_path):
    line = Line(tmp_path, step=600.0)
    done = mantaray(*line.with_depth)
    assert done.code == 2
    assert "imply a clock offset of about 2." in done.err
    assert "give --clock-offset-sigma" in done.err


def test_a_known_clock_needs_no_offset(told, tmp_path):
    line = Line(tmp_path, ends=(-8e3, 9e3), offset=0.0, step=600.0)
    (node,) = told(*line.with_depth)["nodes"]
    along, across, _ = line.errors(node)
    sigma = np.hypot(node["sigma_north_m"], node["sigma_east_m"])
    assert abs(along) < 30.0
    assert abs(across) < 4.0 * sigma


def test_a_survey_that_does_not_converge_says_what_to_try(mantaray, monkeypatch, tmp_path):
    line = Line(tmp_path, ends=(-8e3, 9e3), step=600.0)
    monkeypatch.setattr("pymantaray.apps.locate.solve._MAX_STEPS", 1)
    monkeypatch.setattr("pymantaray.apps.locate.solve._MAX_DAMPED", 0)
    done = mantaray(*line.with_depth, *CLOCK)
    assert done.code == 1
    assert "not converged; check the initial positions" in done.err
    assert "--clock-offset-sigma" in done.err
