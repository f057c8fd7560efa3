"""Travel-time tables: error bound, outcomes, inversion, files, and failure paths."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles import cf_errors
from refusals import refused

from pymantaray import Water
from pymantaray.acoustics import choose_arrivals, find_eigenrays
from pymantaray.apps.table import CellStatus, TravelTimeTable, build_table, open_table, save_table
from pymantaray.apps.table.build import Box, build_tree
from pymantaray.apps.table.cells import REFERENCE_SLOWNESS
from pymantaray.apps.table.samples import NO_ARRIVAL, Radial, Samples
from pymantaray.errors import OnlineError

WITH_RANGE = (CellStatus.DIRECT, CellStatus.BOUNCED, CellStatus.AMBIGUOUS)
POCKET, POCKET_SIZE = (
    np.array([28.1, 53.1, 1390.6]),
    np.array([2.0, 3.0, 10.0]),
)  # centre and semi-axes [m]


@pytest.fixture(scope="module")
def solved(water: Water, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Travel time of the first direct ray at random places, and the horizontal slowness at the
    receiver.
    """
    medium, _ = water.at_start
    source, receiver = np.zeros((2, len(places), 3))
    source[:, 2], receiver[:, 2], receiver[:, 0] = places.T
    arrivals = find_eigenrays(medium, source, receiver)
    time, slowness = np.full((2, len(places)), np.nan)
    link, row = choose_arrivals(arrivals, "direct")
    time[link], slowness[link] = arrivals.travel_time[row], arrivals.receiver_slowness[row, 0]
    return time, slowness


def test_ranges_err_by_less_than_the_bound(
    table: TravelTimeTable, places: np.ndarray, solved
) -> None:
    time, slowness = solved
    ranges = table.horizontal_range(places[:, 0], places[:, 1], time)
    ok = np.isin(ranges.status, WITH_RANGE)
    error = np.abs(ranges.horizontal_range - places[:, 2])[ok] * np.minimum(
        slowness[ok] * 1500.0 / 0.1, 1.0
    )
    assert ok.mean() > 0.88
    assert error.max() < table.tolerance


def test_no_range_in_a_shadow_and_no_shadow_at_an_arrival(
    table: TravelTimeTable, places: np.ndarray, solved
) -> None:
    time, _ = solved
    found = table.travel_time(*places.T)
    assert np.all(np.isfinite(time[np.isin(found.status, WITH_RANGE)]))
    shadow = found.status == CellStatus.SHADOW
    assert shadow.sum() > 50
    assert np.all(np.isnan(time[shadow]))
    assert (found.status == CellStatus.BORDER).mean() < 0.06


def test_range_and_travel_time_are_inverse(
    table: TravelTimeTable, places: np.ndarray, as_stored
) -> None:
    there = table.travel_time(*places.T)
    back = table.horizontal_range(places[:, 0], places[:, 1], there.travel_time)
    ok = np.isin(there.status, WITH_RANGE)
    np.testing.assert_allclose(back.horizontal_range[ok], places[ok, 2], atol=1e-8)
    np.testing.assert_array_equal(back.status[ok], there.status[ok])
    as_stored([there, back, table.tree, table.shares()])


def _two_arrivals(places: np.ndarray, _progress=None) -> Samples:
    """
    Straight rays at 1,500 m/s, and arrivals that are earlier by up to 1 m in a small ellipsoid
    only.
    """
    off = (places - POCKET) / POCKET_SIZE
    lead = ((off * off).sum(axis=1) - 1.0) / 1500.0  # s, of the straight ray
    by_place = 2.0 * off / POCKET_SIZE / 1500.0
    straight = np.hypot(places[:, 1] - places[:, 0], places[:, 2])
    unit = (
        np.column_stack([places[:, :2] @ [[1.0, -1.0], [-1.0, 1.0]], places[:, 2]])
        / straight[:, None]
    )
    second = np.minimum(lead, 0.0)
    gradient = (by_place * (lead < 0.0)[:, None] - (second / straight)[:, None] * unit) / straight[
        :, None
    ]
    zero = np.zeros(len(places), dtype=np.int64)
    return Samples(
        value=1500.0 * second / straight,
        gradient=1500.0 * gradient,
        straight=straight,
        slowness=unit[:, 2] / 1500.0 + by_place[:, 2] * (lead < 0.0),
        family=zero,
        bounces=np.zeros((len(places), 2), dtype=np.int64),
        several=zero == 0,
        lead=np.abs(lead),
        lead_gradient=np.sign(lead)[:, None] * by_place,
    )


def test_a_small_region_with_an_earlier_arrival_is_found(as_stored) -> None:
    box = Box((0.0, 0.0, 1000.0), (100.0, 200.0, 2000.0), (5.0, 5.0, 20.0))
    table = TravelTimeTable(box.lower, box.upper, 0.05, build_tree(box, [_two_arrivals], 0.05))
    places = POCKET + POCKET_SIZE * np.random.default_rng(2).uniform(-5.0, 5.0, (40_000, 3))
    solved = _two_arrivals(places)
    assert (solved.value < 0.0).sum() > 100
    found = table.travel_time(*places.T)
    ok = np.isin(found.status, WITH_RANGE)
    time = (1.0 + solved.value) / 1500.0 * solved.straight
    assert ok.sum() > 100
    assert np.abs(found.travel_time - time)[ok].max() * 1500.0 < table.tolerance
    assert table.shares()["border"] < 0.01
    as_stored([found, table.tree])


def _island(places: np.ndarray, _progress=None) -> Samples:
    """Arrivals at 1,500 m/s in a small ellipsoid only, with a shadow all around."""
    inside = (((places - [30.0, 55.0, 1400.0]) / [6.0, 6.0, 29.0]) ** 2).sum(axis=1) < 1.0
    straight = np.hypot(places[:, 1] - places[:, 0], places[:, 2])
    n = len(places)
    return Samples(
        value=np.where(inside, 0.0, np.nan),
        gradient=np.where(inside[:, None], np.zeros((n, 3)), np.nan),
        straight=straight,
        slowness=places[:, 2] / straight / 1500.0,
        family=np.where(inside, 0, NO_ARRIVAL),
        bounces=np.zeros((n, 2), dtype=np.int64),
        several=np.zeros(n, dtype=bool),
        lead=np.full(n, np.inf),
        lead_gradient=np.zeros((n, 3)),
    )


def test_arrivals_in_a_small_region_within_a_shadow_are_found(as_stored) -> None:
    box = Box((0.0, 0.0, 1000.0), (100.0, 200.0, 2000.0), (5.0, 5.0, 20.0))
    table = TravelTimeTable(box.lower, box.upper, 0.05, build_tree(box, [_island], 0.05))
    places = [30.0, 55.0, 1400.0] + np.array([6.0, 6.0, 29.0]) * np.random.default_rng(6).uniform(
        -0.57, 0.57, (2000, 3)
    )
    assert np.isfinite(_island(places).value).all()
    assert not np.any(table.travel_time(*places.T).status == CellStatus.SHADOW)
    assert table.shares()["shadow"] > 0.99
    as_stored([table.tree, table.shares()])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("column", "name", "step"),
    [
        (0, "range_by_source_depth", 1e-3),
        (1, "range_by_receiver_depth", 1e-3),
        (2, "range_by_time", 1e-6),
    ],
)
def test_derivatives_equal_differences(
    table: TravelTimeTable, column: int, name: str, step: float
) -> None:
    at = np.array([[31.2, 77.7, 0.9], [60.1, 303.3, 1.3], [12.3, 155.5, 1.9]])
    shift = np.zeros(3)
    shift[column] = step
    high, low = (
        table.horizontal_range(*(at + sign * shift).T).horizontal_range for sign in (1.0, -1.0)
    )
    derivative = getattr(table.horizontal_range(*at.T), name)
    np.testing.assert_allclose((high - low) / (2.0 * step), derivative, rtol=1e-5, atol=1e-6)


def test_exchanged_depths_have_the_arrival_solved_from_the_source(water: Water) -> None:
    medium, _ = water.at_start
    radial = Radial(medium)
    places = np.array([[10.0, 60.0, 900.0], [60.0, 10.0, 900.0], [35.0, 35.0, 400.0]])
    samples = radial(places)
    source, receiver = np.zeros((2, len(places), 3))
    source[:, 2], receiver[:, 2], receiver[:, 0] = places.T
    arrivals = find_eigenrays(medium, source, receiver, canonical=False)
    link, row = choose_arrivals(arrivals, "direct")
    assert link.size == len(places)
    distance = np.hypot(places[:, 1] - places[:, 0], places[:, 2])
    time = (samples.value + 1.0) * REFERENCE_SLOWNESS * distance
    np.testing.assert_allclose(time, arrivals.travel_time[row], rtol=0.0, atol=1e-9)
    down = (places[:, 1] - places[:, 0]) / distance
    mean = (samples.value + 1.0) * REFERENCE_SLOWNESS
    by_depth = samples.gradient[:, :2] * REFERENCE_SLOWNESS * distance[:, None]
    by_depth += mean[:, None] * np.column_stack([-down, down])
    np.testing.assert_allclose(
        by_depth,
        np.column_stack([-arrivals.source_slowness[row, 2], arrivals.receiver_slowness[row, 2]]),
        rtol=0.0,
        atol=1e-9,
    )


def test_faster_water_means_a_longer_range(table: TravelTimeTable, as_stored) -> None:
    at = table.horizontal_range(50.0, 200.0, [1.0, 1.02])
    assert at.range_by_scale[0] == pytest.approx(
        np.diff(at.horizontal_range)[0] / np.log(1.02), rel=0.02
    )
    as_stored(at)


@pytest.mark.parametrize("name", ["table.nc", "table.mtt"])
def test_files_return_the_same_table(
    table: TravelTimeTable, places: np.ndarray, tmp_path: Path, name: str
) -> None:
    save_table(table, tmp_path / name)
    read = open_table(tmp_path / name)
    assert (read.lower, read.upper, read.tolerance) == (table.lower, table.upper, table.tolerance)
    for column, other in zip(table.tree, read.tree, strict=True):
        np.testing.assert_array_equal(column, other)
    assert (tmp_path / name).stat().st_size < 200_000
    expected, found = table.travel_time(*places.T), read.travel_time(*places.T)
    np.testing.assert_array_equal(expected.travel_time, found.travel_time)


def test_a_table_prints_its_cells_and_limits(table: TravelTimeTable) -> None:
    text = repr(table)
    assert text.startswith(f"<TravelTimeTable: {table.tree.status.size:,} cells, source depth ")
    assert f"receiver depth {table.lower[1]:g} to {table.upper[1]:g} m" in text
    assert text.endswith(f"error below {table.tolerance:g} m>")


def test_damaged_files_are_refused_in_one_line(table: TravelTimeTable, tmp_path: Path) -> None:
    save_table(table, tmp_path / "table.mtt")
    content = (tmp_path / "table.mtt").read_bytes()
    rng = np.random.default_rng(1)
    damaged = [content[:50], content[:-1000], b"", b"MANTATAB"]
    for position in rng.integers(8, 88 + 4 * table.tree.branch.size, 60):
        damaged.append(
            content[:position]
            + bytes([content[position] ^ int(rng.integers(1, 256))])
            + content[position + 1 :]
        )
    refusals = []
    for number, wrong in enumerate(damaged):
        path = tmp_path / f"{number}.mtt"
        path.write_bytes(wrong)
        try:
            open_table(path).travel_time(50.0, 100.0, 1000.0)
        except OnlineError as error:
            refusals.append(str(error))
    assert len(refusals) == len(damaged)
    assert not any("\n" in text for text in refusals)


def test_every_flipped_bit_is_refused_in_both_forms(table: TravelTimeTable, tmp_path: Path) -> None:
    """
    A flip in the storage of NetCDF may also hit bytes that hold nothing; then all values are those
    of the table.
    """
    rng = np.random.default_rng(2)
    for name in ("table.mtt", "table.nc"):
        save_table(table, tmp_path / name)
        content = (tmp_path / name).read_bytes()
        for bit in rng.integers(0, 8 * len(content), 60):
            wrong = bytearray(content)
            wrong[bit // 8] ^= 1 << bit % 8
            (tmp_path / name).write_bytes(wrong)
            try:
                read = open_table(tmp_path / name)
            except OnlineError:
                continue
            assert name == "table.nc", bit
            for column, other in zip(table.tree, read.tree, strict=True):
                np.testing.assert_array_equal(column, other)
            assert (read.lower, read.upper, read.tolerance) == (
                table.lower,
                table.upper,
                table.tolerance,
            )


@pytest.mark.parametrize("change", ["flipped", "longer", "of another format"])
def test_a_table_without_its_checksum_says_so(
    table: TravelTimeTable, tmp_path: Path, change: str
) -> None:
    path = tmp_path / "table.mtt"
    save_table(table, path)
    content = bytearray(path.read_bytes())
    if change == "flipped":
        content[-200] ^= 1
    elif change == "longer":
        content += b"0"
    else:
        content[8] = 1
    path.write_bytes(content)
    message = (
        "format 1; this version reads format 2"
        if change == "of another format"
        else "its bytes do not have their checksum"
    )
    refused(OnlineError, message, open_table, path)


def test_a_netcdf_table_of_other_values_is_refused(table: TravelTimeTable, tmp_path: Path) -> None:
    import xarray as xr

    save_table(table, tmp_path / "table.nc")
    assert not cf_errors([tmp_path / "table.nc"])
    with xr.open_dataset(tmp_path / "table.nc") as data:
        data.load()
    value = data["value"].copy()
    value[0, 0] += np.float32(1e-3)
    other = data.assign_attrs(record=json.dumps({"earth": "sphere"}))
    moved = data.assign_attrs(lower=[x + 1.0 for x in data.attrs["lower"]])
    for changed in (data.assign(value=value), other, moved):
        changed.to_netcdf(tmp_path / "changed.nc")
        refused(
            OnlineError,
            "its values do not have their checksum",
            open_table,
            tmp_path / "changed.nc",
        )


def test_sigma_is_that_of_two_oceans(water: Water, tmp_path: Path, as_stored) -> None:
    faster = tmp_path / "faster.csv"
    depth = np.linspace(0.0, 1000.0, 41)
    speed = 1500.0 - 30.0 / (1.0 + np.exp(-(depth - 80.0) / 25.0)) + 0.017 * depth
    rows = [f"{z},{c * 1.001}" for z, c in zip(depth, speed, strict=True)]
    faster.write_text("\n".join(["depth_m,sound_speed", *rows]))
    from pymantaray import open_water

    other = open_water(str(faster), bathymetry=1000.0)
    limits = ((40.0, 60.0), (100.0, 300.0), (500.0, 1500.0))
    table = build_table(water, *limits, tolerance=0.5, ensemble=[other])
    found = table.horizontal_range(50.0, 150.0, 0.6)
    # two oceans that differ by 0.1 % have a standard deviation of 0.1 % / sqrt(2)
    assert found.range_sigma[0] == pytest.approx(
        found.range_by_scale[0] * 1e-3 / np.sqrt(2.0), rel=0.01
    )
    as_stored([found, table.tree])


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (((10.0, 5.0), (0.0, 100.0), (10.0, 100.0)), "source_depth"),
        (((0.0, 5.0), (0.0, 100.0), (0.0, 100.0)), "positive lower limit"),
        (((0.0, 5.0), (0.0, 100.0, 200.0), (10.0, 100.0)), "receiver_depth"),
        (((0.0, 5.0), (0.0, float("nan")), (10.0, 100.0)), "receiver_depth"),
    ],
)
def test_wrong_limits_are_refused(water: Water, limits, words: str) -> None:
    with pytest.raises(OnlineError, match=words):
        build_table(water, *limits)


def test_progress_grows_to_all_work_of_all_sectors(water: Water) -> None:
    told: list[tuple[str, int, int]] = []
    limits = (0.0, 40.0), (0.0, 60.0), (50.0, 400.0)
    build_table(
        water, *limits, tolerance=1.0, sectors=2, progress=lambda *words: told.append(words)
    )
    done = [part for _, part, _ in told]
    assert done == sorted(done)
    assert {(stage, total) for stage, _, total in told} == {("table", 200)}
    assert {100, 200} <= set(done)


@pytest.mark.parametrize("members", [1, 3])
def test_half_way_the_work_that_is_left_is_known_within_a_factor_of_2(
    water: Water, members: int
) -> None:
    """Work is counted in places that are solved; most of it is at the borders of shadows."""
    medium, _ = water.at_start
    box = Box((0.0, 0.0, 50.0), (120.0, 400.0, 3050.0), (5.0, 12.5, 50.0))
    solved, told = [0], []

    def counted(places, progress):
        before = solved[0]

        def count(done, total):
            solved[0] = before + len(places) * done / total
            progress(done, total)

        samples = radial(places, count)
        solved[0] = before + len(places)
        return samples

    radial = Radial(medium)
    build_tree(
        box, [counted] * members, 0.5, progress=lambda share: told.append((share, solved[0]))
    )
    share, work = np.array(told).T
    part = work / solved[0]
    assert (share[-1], part[-1]) == (1.0, 1.0)
    assert (np.diff(share) >= 0.0).all()
    for where in (0.5, 0.75):
        row = np.flatnonzero(part >= where)[0]
        assert part[row] < where + 0.1  # also while many places are solved at once
        left = (1.0 - share[row]) / share[row] * part[row]
        assert 0.5 < left / (1.0 - part[row]) < 2.0


def test_a_table_that_would_be_too_large_is_refused(water: Water) -> None:
    with pytest.raises(OnlineError, match="larger error"):
        build_table(water, (0.0, 40.0), (0.0, 60.0), (50.0, 900.0), tolerance=1e-3, max_bytes=4_000)
