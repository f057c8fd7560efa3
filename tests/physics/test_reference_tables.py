"""
Every direct row of the reference tables: times by solvers that share no code with this package.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import RayStatus

REFERENCE = Path(__file__).parents[3] / "shared" / "data" / "reference"
pytestmark = pytest.mark.skipif(not REFERENCE.is_dir(), reason=f"no reference data at {REFERENCE}")
MEDIA = ["a_iso", "b_lingrad", "c_munk", "d_beaufort", "e_front_eddy", "f_fram"]


def solve(name, *most, links=slice(None)):
    rows = (
        pd.read_csv(REFERENCE / "direct.csv").query("medium == @name")[links].reset_index(drop=True)
    )
    with np.load(REFERENCE / f"medium_{name}.npz") as m:
        medium = Medium.from_grid(
            m["north"],
            m["east"],
            m["depth"],
            m["sound_speed"],
            bathymetry=m["bathymetry"],
            interpolation="linear",
        )
    ends = [
        rows[[f"{end}_north", f"{end}_east", f"{end}_depth"]].to_numpy()
        for end in ("source", "receiver")
    ]
    return rows, find_eigenrays(medium, *ends, *most, spreading_cutoff_db=None)


@pytest.mark.parametrize("name", MEDIA)
def test_first_direct_arrivals_agree_none_missed_none_invented(name):
    rows, arrivals = solve(name)
    first = arrivals.first()
    exists = rows.travel_time_s.notna().to_numpy()
    assert np.array_equal(first.status == RayStatus.OK, exists)
    # a to d are exact layer integrals; e and f fixed-step shooting
    atol = 1e-9 if name[0] in "abcd" else 1e-7
    np.testing.assert_allclose(
        first.travel_time[exists], rows.travel_time_s[exists].to_numpy(), rtol=0, atol=atol
    )
    np.testing.assert_allclose(
        first.source_sound_speed, rows.source_sound_speed.to_numpy(), rtol=0, atol=1e-3
    )
    assert np.array_equal(np.bincount(arrivals.link, minlength=len(rows)), rows.direct_eigenrays)


def test_spreading_agrees_with_finite_difference_ray_tubes():
    for name in MEDIA:
        rows, arrivals = solve(name)
        links, at = np.unique(arrivals.link, return_index=True)
        ratio = arrivals.source_sound_speed / arrivals.receiver_sound_speed
        # the table's tube is not made reciprocal
        mine = arrivals.spreading_db[at] - 10 * np.log10(ratio[links])
        np.testing.assert_allclose(mine, rows.spreading_db[links], atol=0.25)


def compare_with_the_multipath_table(name, bounces, links):
    """
    Rows that are missed or invented, up to a number of reflections, and the errors of
    time.
    """
    rows, arrivals = solve(name, bounces, bounces, links=links)
    table = pd.read_csv(REFERENCE / "multipath.csv").query("medium == @name")
    # that table's rows of three reflections are missing
    most = min(bounces, 2) if name == "a_iso" else bounces
    if bounces == 0:
        table = table.query("surface_bounces == 0 and bottom_bounces == 0")
    missed, errors = [], []
    invented = set(np.flatnonzero(arrivals.surface_bounces + arrivals.bottom_bounces <= most))
    for link, label in enumerate(rows.link):
        for row in table[table.link == label].itertuples():
            mine = np.flatnonzero(
                (arrivals.link == link)
                & (arrivals.surface_bounces == row.surface_bounces)
                & (arrivals.bottom_bounces == row.bottom_bounces)
                & (np.abs(arrivals.travel_time - row.travel_time_s) < 1e-6)
                & (np.abs(np.degrees(arrivals.launch_angle) - row.launch_angle_deg) < 1e-3)
            )
            mine = [i for i in mine if i in invented]
            if not mine:
                missed.append((label, row.surface_bounces, row.bottom_bounces, row.travel_time_s))
                continue
            gap = np.abs(arrivals.travel_time[mine] - row.travel_time_s)
            errors.append(gap.min())
            best = mine[int(np.argmin(gap))]
            invented.remove(best)
            if bounces == 0:
                assert arrivals.turning_points[best] == row.turning_points
    names = ("link", "surface_bounces", "bottom_bounces", "travel_time")
    return (
        missed,
        [tuple(getattr(arrivals, n)[i] for n in names) for i in invented],
        np.array(errors),
    )


@pytest.mark.parametrize(("bounces", "links", "least", "bar"), [
    (0, slice(None), 10, 1e-9),
    (3, slice(0, 20, 7), 12, 1e-8),
    pytest.param(3, slice(None), 12, 1e-8, marks=pytest.mark.slow),
])  # fmt: skip
@pytest.mark.parametrize("name", MEDIA[:4])
def test_every_eigenray_of_the_multipath_table(name, bounces, links, least, bar):
    """
    None missed, none invented; the ones with more reflections than the table's are not judged.
    """
    missed, invented, errors = compare_with_the_multipath_table(name, bounces, links)
    assert not missed
    assert not invented
    assert len(errors) > least
    assert errors.max() < bar


def test_a_root_that_rough_rays_misplace_is_found():
    grid = np.load(REFERENCE / "medium_f_fram.npz")
    medium = Medium.from_grid(
        *(grid[name] for name in ("north", "east", "depth", "sound_speed")),
        bathymetry=grid["bathymetry"],
    )
    # a fan's rays from the deeper end, 0.2 m wrong beside the root, change sign in one interval,
    # finer ones in the next
    ends = [37043.49132, 11542.51169, 3.940598838], [37958.085605715, 13474.271104446, 59.484725231]
    for source, receiver in (ends, ends[::-1]):
        arrivals = find_eigenrays(medium, source, receiver)
        assert arrivals.status.tolist() == [RayStatus.OK]
        assert arrivals.travel_time == pytest.approx(1.485250369, abs=1e-7)
