"""Every direct row of the reference tables: times by solvers that share no code with this package."""

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
    rows = pd.read_csv(REFERENCE / "direct.csv").query("medium == @name")[links].reset_index(drop=True)
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
        rows[[f"{end}_north", f"{end}_east", f"{end}_depth"]].to_numpy() for end in ("source", "receiver")
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


@pytest.mark.parametrize("name", MEDIA[:4])
def test_every_bounce_free_eigenray_of_the_multipath_table(name):
    rows, arrivals = solve(name)
    table = pd.read_csv(REFERENCE / "multipath.csv").query(
        "medium == @name and surface_bounces == 0 and bottom_bounces == 0"
    )
    for link, label in enumerate(rows.link):
        expected = table[table.link == label].sort_values(["travel_time_s", "launch_angle_deg"])
        mine = arrivals.link == link
        np.testing.assert_allclose(
            np.sort(arrivals.travel_time[mine]), expected.travel_time_s, rtol=0, atol=1e-9, err_msg=str(label)
        )
        np.testing.assert_array_equal(
            np.sort(arrivals.turning_points[mine]), np.sort(expected.turning_points)
        )


def test_spreading_agrees_with_finite_difference_ray_tubes():
    for name in MEDIA:
        rows, arrivals = solve(name)
        links, at = np.unique(arrivals.link, return_index=True)
        ratio = arrivals.source_sound_speed / arrivals.receiver_sound_speed
        # the table's tube is not made reciprocal
        mine = arrivals.spreading_db[at] - 10 * np.log10(ratio[links])
        np.testing.assert_allclose(mine, rows.spreading_db[links], atol=0.25)


def compare_with_the_multipath_table(name, links=slice(None)):
    """Rows that are missed or invented among those with at most three reflections, and the largest error of time."""
    rows, arrivals = solve(name, 3, 3, links=links)
    table = pd.read_csv(REFERENCE / "multipath.csv").query("medium == @name")
    most = 2 if name == "a_iso" else 3  # that table's rows of three reflections are missing
    missed, errors = [], []
    total = arrivals.surface_bounces + arrivals.bottom_bounces
    invented = set(np.flatnonzero(total <= most))
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
            invented.remove(mine[int(np.argmin(gap))])
    names = ("link", "surface_bounces", "bottom_bounces", "travel_time")
    return missed, [tuple(getattr(arrivals, n)[i] for n in names) for i in invented], np.array(errors)


@pytest.mark.parametrize("links", [slice(0, 20, 7), pytest.param(slice(None), marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", MEDIA[:4])
def test_every_bounced_eigenray_of_the_multipath_table(name, links):
    """None missed, none invented, with up to three reflections; the ones with more than the table's are not judged."""
    missed, invented, errors = compare_with_the_multipath_table(name, links)
    assert not missed
    assert not invented
    assert len(errors) > 12
    assert errors.max() < 1e-8
