"""A study under ice: from its configuration to vehicles, fixes and losses."""

import numpy as np

from pymantaray.study.manifest import Stopwatch
from pymantaray.study.mission import simulate_mission

DETECTION = {"source_level_db": 185.0, "frequency_hz": 12e3, "bandwidth_hz": 4e3}


def mission(config):
    return simulate_mission(config, Stopwatch(), lambda *_: None)


def test_no_vehicle_is_in_the_ice_and_none_has_a_fix(tiny):
    open_water, iced = mission(tiny()), mission(tiny(ocean={"ice": 0.8}))
    assert open_water.measurements.gnss_agent.size
    assert iced.measurements.gnss_agent.size == 0  # though 0.8 m is shallower than the antenna reaches
    assert iced.truth.position[..., 2].min() >= 0.8
    assert (iced.truth.status == open_water.truth.status).all()
    assert iced.picture is not None
    np.testing.assert_array_equal(iced.picture["sea_ice_draft"], 0.8)


def test_loss_at_the_ice_is_heard(tiny):
    bounces = {"acoustics": {"max_surface_bounces": 1, "arrival": "strongest"}}
    loud, quiet = (
        mission(tiny(ocean={"ice": 0.8}, **bounces, detection=DETECTION | {"ice_loss_db": loss}))
        for loss in (0.0, 60.0)
    )
    less = loud.hearing.probability - quiet.hearing.probability
    assert np.nanmin(less) > -1e-12
    assert np.nanmax(less) > 0.5
