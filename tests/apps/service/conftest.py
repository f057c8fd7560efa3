"""Services in small waters, and a mission of the study `factories.TINY` to hold them against."""

import threading

import numpy as np
import pytest
from factories import TINY

from pymantaray.acoustics import Medium, Sonar
from pymantaray.apps.service import RangingService, make_server
from pymantaray.apps.study.mission import range_fleet, simulate_fleet
from pymantaray.config import parse_study
from pymantaray.config.door.study import build_study
from pymantaray.sensing import Detector, ReceptionOptions, TwoWay

SONAR = Sonar(source_level_db=170.0, frequency_hz=25e3, bandwidth_hz=4e3, noise=45.0)


@pytest.fixture(scope="session")
def medium():
    """A duct over a flat bed, with a shadow below it."""
    depth = np.array([0.0, 60.0, 120.0, 300.0, 900.0])
    speed = np.array([1452.0, 1446.0, 1455.0, 1449.0, 1460.0])
    return Medium.from_profile(depth, speed, bottom_depth=900.0)


@pytest.fixture(scope="session")
def service(medium):
    return RangingService(medium)


@pytest.fixture(scope="session")
def loud(medium):
    """Two-way, with a sonar and one reflection at either boundary."""
    reception = ReceptionOptions(
        max_surface_bounces=1, max_bottom_bounces=1, detector=Detector(SONAR)
    )
    return RangingService(medium, reception=reception, timing=TwoWay(turn_around=0.25))


@pytest.fixture(scope="session")
def serve():
    """Serve from a thread until the tests are over, and tell the port."""
    servers = []

    def one(service):
        server = make_server(service)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        servers.append(server)
        return server.effective_port

    yield one
    for server in servers:
        server.task_dispatcher.shutdown()
        server.trigger.pull_trigger(server.close)


@pytest.fixture(scope="session")
def links():
    """A source, and receivers in a box of 4 km, a few of them out of the water."""

    def draw(n, seed=0):
        rng = np.random.default_rng(seed)
        return rng.uniform((-2e3, -2e3, 5.0), (2e3, 2e3, 880.0)), rng.uniform(
            (-2e3, -2e3, -50.0), (2e3, 2e3, 950.0), (n, 3)
        )

    return draw


@pytest.fixture(scope="session")
def fly():
    """Configuration, truth, landmarks and ranges without noise of TINY with other sections."""

    def one(**sections):
        tree = TINY | {name: TINY.get(name, {}) | section for name, section in sections.items()}
        config = parse_study(tree, "tiny")
        study = build_study(config)
        ocean = study.ocean.open()
        truth = simulate_fleet(study.fleet, ocean)
        ranging = range_fleet(study.ranging, ocean, study.sound.medium(ocean), truth)
        return config, truth, list(study.ranging.landmarks), ranging

    return one


@pytest.fixture(scope="session")
def varying(fly):
    """
    What `fly` gives where the water varies and carries sound, which leaks: there and back with a
    sonar.
    """
    return fly(
        ocean={"time_varying": True},
        mission={"duration_h": 2.0},
        acoustics={"currents": True},
        ranging={"timing": "two-way"},
        detection={
            "source_level_db": 165.0,
            "frequency_hz": 25e3,
            "bandwidth_hz": 4e3,
            "absorption": "thorp",
            "leakage": True,
            "scatter_db": 30.0,
        },
    )


@pytest.fixture(scope="session")
def in_varying(varying):
    """Service in that water."""
    return RangingService(varying[0])
