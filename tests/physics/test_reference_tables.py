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


def solve(name):
    rows = pd.read_csv(REFERENCE / "direct.csv").query("medium == @name").reset_index(drop=True)
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
    return rows, find_eigenrays(medium, *ends, spreading_cutoff_db=None)


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
