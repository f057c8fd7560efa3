"""Page of ranges under rough ice, where the paths of reflected rays are not available."""

import json

import pandas as pd

from pymantaray.apps.ranges import measure
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.page import mission_rays


def test_rays_of_the_page_under_rough_ice_have_no_reflections(tmp_path, as_stored):
    (tmp_path / "cast.csv").write_text("depth,sound_speed\n0,1434\n100,1442\n400,1455\n1000,1465\n")
    poses = pd.DataFrame(
        {
            "time": [0.0, 600.0] * 2,
            "vehicle": ["A", "A", "B", "B"],
            "depth": [30.0, 30.0, 60.0, 60.0],
        }
    )
    poses["north"], poses["east"] = [0.0, 100.0, 1500.0, 1500.0], 0.0
    smooth, run = (
        measure(
            poses, str(tmp_path / "cast.csv"), 600.0,
            bathymetry=1000.0, ice=1.5, max_surface_bounces=2, centre=(74.5, -140.0), **rough,
        )
        for rough in ({}, {"ice_slope_deg": 0.5})
    )  # fmt: skip
    assert run.arrivals.surface_bounces.max() > 0
    (section,) = json.loads(mission_rays(RunResults(smooth)))
    assert section["surface"] == smooth.arrivals.surface_bounces.tolist() == [0, 1]
    sections = json.loads(mission_rays(RunResults(run)))
    assert sections
    assert all(section["surface"] == [0] for section in sections)
    as_stored(sections)
    as_stored({name: run.tables[name].frame for name in ("dropouts", "range_error")}, name="tables")
