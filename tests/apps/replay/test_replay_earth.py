"""Measured times between latitudes and longitudes: the sea surface is curved by default."""

import ellipsoid_rays
import numpy as np
import pandas as pd
import pytest


@pytest.mark.slow
def test_times_to_a_deep_node_are_those_on_the_ellipsoid(mantaray, tmp_path):
    lat = 20.0 + np.linspace(-0.036, 0.036, 9)  # up to 4 km
    lon = -150.0 + np.linspace(0.01, -0.01, 9)
    node = 20.0, -150.0, 5000.0
    ships = ellipsoid_rays.ecef(lat, lon, np.full(9, 5.0))
    nodes = np.repeat(ellipsoid_rays.ecef(*node)[None], 9, axis=0)
    events = pd.DataFrame(
        {
            "time": np.arange(9.0),
            "source": "ship",
            "receiver": "node",
            "source_lat": lat,
            "source_lon": lon,
            "source_depth": 5.0,
            "receiver_lat": node[0],
            "receiver_lon": node[1],
            "receiver_depth": node[2],
            "travel_time": ellipsoid_rays.travel_times(ships, nodes),
        }
    )
    events.to_csv(tmp_path / "events.csv", index=False, float_format="%.12g")
    levels = np.arange(0.0, 5600.0, 10.0)
    profile = {"depth_m": levels, "sound_speed": ellipsoid_rays.deep_water(levels)[0]}
    pd.DataFrame(profile).to_csv(tmp_path / "profile.csv", index=False, float_format="%.12g")
    errors = {}
    for earth in (None, "flat", "sphere"):
        out = tmp_path / str(earth)
        words = ("replay", tmp_path / "events.csv", "--profile", tmp_path / "profile.csv")
        choice = () if earth is None else ("--earth", earth)
        done = mantaray(*words, "--bathymetry", 5590, "--out", out, *choice)
        assert done.code == 0, done.err
        assert ("Earth: sphere" in done.err) == (earth != "flat")
        table = pd.read_csv(out / "tables" / "events.csv")
        errors[earth] = 1500.0 * np.abs(table["predicted_s"] - events["travel_time"]).max()
    assert errors[None] == errors["sphere"] < 5e-3  # m
    assert errors["flat"] > 0.8
