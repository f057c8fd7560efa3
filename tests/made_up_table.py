"""A small table and the profile that it is made of."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pymantaray import Water, open_water
from pymantaray.apps.table import TravelTimeTable, build_table, open_table, save_table

SOURCE, RECEIVER, RANGE = (5.0, 105.0, 10.0), (0.0, 400.0, 20.0), (50.0, 4050.0, 200.0)


@pytest.fixture(scope="package")
def water(tmp_path_factory: pytest.TempPathFactory) -> Water:
    """Water with a warm surface layer above a cold one, so that there are shadows."""
    depth = np.linspace(0.0, 1000.0, 41)
    speed = 1500.0 - 30.0 / (1.0 + np.exp(-(depth - 80.0) / 25.0)) + 0.017 * depth
    profile = tmp_path_factory.mktemp("profile") / "profile.csv"
    lines = [f"{z},{c}" for z, c in zip(depth, speed, strict=True)]
    profile.write_text("\n".join(["depth_m,sound_speed", *lines]))
    return open_water(str(profile), bathymetry=1000.0)


@pytest.fixture(scope="package")
def table(water: Water, once: Callable[[str, Callable[[Path], None]], Path]) -> TravelTimeTable:
    """Table of that water."""

    def build(path: Path) -> None:
        save_table(build_table(water, SOURCE, RECEIVER, RANGE, tolerance=0.1), path)

    return open_table(once("table.mtt", build))


@pytest.fixture(scope="package")
def places() -> np.ndarray:
    """Random source depths, receiver depths and ranges within the table."""
    low, high = zip(*(limits[:2] for limits in (SOURCE, RECEIVER, RANGE)), strict=True)
    return np.random.default_rng(3).uniform(low, high, (4000, 3))
