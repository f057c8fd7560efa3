"""Times of an instrument to the sea surface and back: they fix the depth, or the sound speed."""

import numpy as np
import pytest
from oracles import direct_travel_time_linear_gradient
from refusals import refused

from pymantaray.apps.locate import read_survey
from pymantaray.errors import LocateError

SPEED, GRADIENT, DEPTH = 1490.0, 0.012, 3000.0


def time_between(a, b):
    return direct_travel_time_linear_gradient(a, b, sound_speed_surface=SPEED, gradient=GRADIENT)


@pytest.fixture
def pings(tmp_path):
    """A circle, which cannot separate depth from sound speed, without and with echoes."""
    rng = np.random.default_rng(3)
    angle = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    ships = np.column_stack([2000.0 * np.cos(angle), 2000.0 * np.sin(angle), np.full(120, 6.0)])
    node = np.array([40.0, -25.0, DEPTH])
    times = 2.0 * time_between(ships, node) * (1.0 - 1e-3) + 0.02 + rng.normal(0.0, 1e-4, 120)
    head = "time,node,partner,two_way_time_s,north_m,east_m,depth_m"
    rows = [
        f"{15 * k},N1,,{times[k]:.7f},{ships[k, 0]:.3f},{ships[k, 1]:.3f},6" for k in range(120)
    ]
    (tmp_path / "circle.csv").write_text("\n".join([head, *rows]) + "\n")
    # the depth of the surface is known, and the echo has no turn-around time
    echo = 2.0 * time_between(np.zeros(3), np.array([0.0, 0.0, DEPTH])) * (1.0 - 1e-3)
    echoes = [f"{1800 + 60 * k},N1,N1,{echo + rng.normal(0.0, 1e-4):.7f},,," for k in range(40)]
    (tmp_path / "both.csv").write_text("\n".join([head, *rows, *echoes]) + "\n")
    (tmp_path / "echoes.csv").write_text("\n".join([head, *echoes]) + "\n")
    cast = [(z, SPEED + GRADIENT * z) for z in (0.0, 3500.0)]
    (tmp_path / "cast.csv").write_text(
        "\n".join(["depth_m,sound_speed", *(f"{z:g},{c:g}" for z, c in cast)]) + "\n"
    )
    (tmp_path / "nodes.csv").write_text(
        "name,north_m,east_m,depth_m,sigma_horizontal_m,sigma_depth_m,turn_around_ms\n"
        "N1,0,0,3060,500,100,20\n"
    )
    return tmp_path


def located(told, folder, name, *words):
    return told(
        *("locate", folder / name, "--nodes", folder / "nodes.csv"),
        *("--earth", "flat", "--profile", folder / "cast.csv", "--sound-speed", "scale", *words),
        without="candidates|probability|chi_square|budget",
    )["nodes"][0]


def test_echoes_separate_depth_from_sound_speed(told, pings):
    alone = located(told, pings, "circle.csv")
    both = located(told, pings, "both.csv")
    assert alone["sigma_depth_m"] > 5.0
    assert both["sigma_depth_m"] < 0.5
    assert abs(both["depth"] - DEPTH) < 4.0 * both["sigma_depth_m"]
    assert both["north"] == pytest.approx(40.0, abs=4.0 * both["sigma_north_m"])
    assert both["n_used"] == 160


def test_echoes_alone_give_the_depth_in_known_water(told, pings):
    node = located(told, pings, "echoes.csv", "--sound-speed", "known")
    assert node["depth"] == pytest.approx(DEPTH * (1.0 - 1e-3), abs=0.5)
    assert node["sigma_north_m"] == pytest.approx(500.0, rel=0.01)


def test_an_echo_is_two_way(pings):
    text = (pings / "both.csv").read_text().replace("two_way", "one_way")
    path = pings / "wrong.csv"
    path.write_text(text)
    from pymantaray.apps.locate import ReadOptions

    options = ReadOptions(nodes=pings / "nodes.csv")
    refused(LocateError, "two-way for an echo of the surface", read_survey, path, options)
