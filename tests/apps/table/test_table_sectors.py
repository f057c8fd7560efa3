"""Tables of water that varies horizontally: one part per sector of bearing, in Python and in C."""

import numpy as np
import pytest
from table_reader import COMPILER, bits_of, compiled, read

from pymantaray import Water
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.table import CellStatus, TravelTimeTable, build_table, save_table
from pymantaray.errors import OnlineError

NODE, SECTORS = (300.0, -200.0), 4
LIMITS = (20.0, 60.0), (20.0, 120.0), (100.0, 1500.0)


def _water(faster: float) -> Water:
    """
    Water that is faster in the north and slower in the east, by an amount that also depends on
    depth.
    """
    axis, depth = np.linspace(-2500.0, 2500.0, 11), np.linspace(0.0, 300.0, 16)
    north, east, z = np.meshgrid(axis, axis, depth, indexing="ij")
    speed = 1490.0 - 0.03 * z + faster * (0.01 * north - 0.005 * east) * (1.0 + z / 300.0)
    return Water(Medium.from_grid(axis, axis, depth, speed, bathymetry=300.0))


@pytest.fixture(scope="module")
def sectored() -> TravelTimeTable:
    """Table with four sectors and the standard deviation over two oceans."""
    return build_table(
        _water(1.0), *LIMITS, tolerance=0.2, node=NODE, sectors=SECTORS, ensemble=[_water(1.2)]
    )


def test_a_bearing_selects_the_water_of_its_sector(sectored: TravelTimeTable, as_stored) -> None:
    rng = np.random.default_rng(4)
    low, high = np.array(LIMITS).T
    places = rng.uniform(low, high, (400, 3))
    sector = rng.integers(0, SECTORS, len(places))
    central = sector * (2.0 * np.pi / SECTORS)
    source = np.column_stack(
        [np.full(len(places), NODE[0]), np.full(len(places), NODE[1]), places[:, 0]]
    )
    along = places[:, 2:] * np.column_stack([np.cos(central), np.sin(central)])
    receiver = np.column_stack([source[:, :2] + along, places[:, 1]])
    medium, _ = _water(1.0).at_start
    time = find_eigenrays(medium, source, receiver).first().travel_time
    bearing = central + rng.uniform(-0.49, 0.49, len(places)) * 2.0 * np.pi / SECTORS
    for turns in (-1, 0, 2):
        found = sectored.horizontal_range(
            places[:, 0], places[:, 1], time, bearing + 2.0 * np.pi * turns
        )
        assert np.all(found.status == CellStatus.DIRECT)
        assert np.abs(found.horizontal_range - places[:, 2]).max() < sectored.tolerance
        assert found.range_sigma.min() >= 0.0
        assert found.range_sigma.max() > 0.1
    opposite = sectored.horizontal_range(places[:, 0], places[:, 1], time, central + np.pi)
    far = places[:, 2] > 500.0
    assert (
        np.nanmedian(np.abs(opposite.horizontal_range - places[:, 2])[far])
        > 5.0 * sectored.tolerance
    )
    as_stored([found, opposite, sectored.shares()])


def test_sectors_that_are_too_large_together_are_refused() -> None:
    water = _water(1.0)
    one = build_table(water, *LIMITS, tolerance=0.2, node=NODE)
    limit = int(1.5 * one.tree.nbytes)
    words = rf"more than {limit / 1e3:.0f} kB .*`tolerance=0\.8`.* fewer `sectors`"
    with pytest.raises(OnlineError, match=words):
        build_table(water, *LIMITS, tolerance=0.2, node=NODE, sectors=SECTORS, max_bytes=limit)


def test_a_bearing_that_is_not_finite_is_outside_without_a_warning(
    sectored: TravelTimeTable,
) -> None:
    for bearing in (np.nan, np.inf):
        assert sectored.travel_time(30.0, 50.0, 500.0, bearing).status[0] == CellStatus.OUTSIDE
        assert sectored.horizontal_range(30.0, 50.0, 0.3, bearing).status[0] == CellStatus.OUTSIDE


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_the_c_reader_returns_the_same_bits_in_every_sector(
    sectored: TravelTimeTable, tmp_path
) -> None:
    low, high = np.array(LIMITS).T
    rng = np.random.default_rng(5)
    places = rng.uniform(0.9 * low, 1.1 * high, (2000, 3))
    bearing = np.concatenate(
        [rng.uniform(-20.0, 20.0, 1990), np.arange(-3, 4) * np.pi / 4.0, [np.nan, np.inf, -np.inf]]
    )
    save_table(sectored, tmp_path / "table.mtt")
    four = np.column_stack([places, bearing])
    there, back = read(compiled(tmp_path, "-O2"), tmp_path / "table.mtt", four)
    np.testing.assert_array_equal(there, bits_of(sectored.travel_time(*four.T)))
    times = four[:, 2] / 1500.0
    np.testing.assert_array_equal(
        back, bits_of(sectored.horizontal_range(four[:, 0], four[:, 1], times, bearing))
    )
    assert np.isin(there[:, 0], (CellStatus.DIRECT, CellStatus.OUTSIDE)).all()
