"""Paths of the eigenrays of a run."""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import RayPaths, trace_paths
from pymantaray.apps.study.mission import medium_of_run
from pymantaray.apps.study.store import Run
from pymantaray.records import Arrivals
from pymantaray.sensing.ranging import link_positions


def run_rays(run: Run) -> RayPaths | None:
    """
    Trace the arrivals of a run in the water at their pings; without reflections at a rough surface.

    None if there are none, or if the water varies and its files are missing or have changed.
    """
    water = medium_of_run(run)
    links = run.links
    arrivals = run.arrivals
    landmarks = run.measurements.landmark_position
    if water is None or not arrivals.link.size:
        return None
    source, receiver = (
        link_positions(run.truth, landmarks, links, end) for end in ("first", "second")
    )
    parts = []
    for sample in np.unique(links.sample[arrivals.link]).tolist():
        medium = water(float(run.truth.time[sample]))
        chosen = np.flatnonzero(links.sample == sample)
        rows = np.flatnonzero(links.sample[arrivals.link] == sample)
        if medium.surface.roughness is not None:
            rows = rows[arrivals.surface_bounces[rows] == 0]
        some = _selected(arrivals, chosen, rows)
        paths = trace_paths(medium, source[chosen], receiver[chosen], some)
        parts.append(replace(paths, arrival=rows[paths.arrival]))
    return RayPaths.stack(parts)


def _selected(arrivals: Arrivals, links: NDArray[np.intp], rows: NDArray[np.intp]) -> Arrivals:
    """Arrivals of increasing links, in rows of these links."""
    own = {
        item.name: getattr(arrivals, item.name)[
            rows if item.metadata["dims"][0] == "arrival" else links
        ]
        for item in fields(Arrivals)
    }
    return Arrivals(**own | {"link": np.searchsorted(links, own["link"])})
