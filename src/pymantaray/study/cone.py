"""Links that a fan of limited width loses, from the arrivals of a run."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.evaluation import dropout_table
from pymantaray.records import RayStatus
from pymantaray.sensing import link_positions
from pymantaray.sensing.receptions import AlongRays, Direction, admitted, receptions_of, within_cone

if TYPE_CHECKING:
    from pymantaray.study.store import Run

WIDTHS_DEG = (30.0, 15.0)  # the paper's cone of 15 degrees, as +-15 and as 15 in total
_PAPER = {  # dropouts by study and kind of link, as docs/paper.md quotes them [%]
    "beaufort": {"station-keeping to float": 3.6, "float to float": 0.4, "all links": 1.0},
    "fram": {"station-keeping to float": 29.5, "float to float": 1.7, "all links": 6.8},
}


def has_cone_table(run: "Run") -> bool:
    """True if every arrival is detected and each range is one transmission, so that arrivals alone determine dropouts."""
    return run.config.detection is None and run.config.ranging.timing == "one-way"


def cone_table(run: "Run") -> pd.DataFrame:
    """Dropouts [%] by kind of link if transmitters send at all angles, and in fans of several widths about the chord."""
    configured = run.config.acoustics.cone_deg
    widths = sorted({*WIDTHS_DEG, *([] if configured is None else [configured])}, reverse=True)
    table = pd.DataFrame()
    for width in (None, *widths):
        status = _status_in(run, None if width is None else math.radians(width))
        part = dropout_table(replace(run.measurements, range_status=status), run.truth)
        if table.empty:
            table = part[["category", "attempts"]].copy()
        name = "all_angles_percent" if width is None else f"fan_{width:g}_deg_percent"
        table[name] = part["percent"]
    paper = _PAPER.get(run.config.study.name)
    return table if paper is None else table.assign(paper_percent=table["category"].map(paper))


def _status_in(run: "Run", cone: float | None) -> NDArray[np.int8]:
    """Status of each attempt if the fan of its transmitter is a cone [rad], None for all angles."""
    m, links, arrivals = run.measurements, run.links, run.arrivals
    receptions = receptions_of(arrivals, AlongRays(None, None))
    if cone is not None:
        source, receiver = (
            link_positions(run.truth, m.landmark_position, links, end) for end in ("first", "second")
        )
        receptions = within_cone(receptions, source, receiver, cone)
    heard = np.zeros((2, links.sample.size), dtype=bool)
    kept = admitted(receptions, run.config.acoustics.arrival)
    heard[(receptions.direction[kept] == Direction.BACK).astype(int), receptions.link[kept]] = True
    ends = np.stack([m.range_sample, *np.sort([m.range_transmitter, m.range_receiver], axis=0)], axis=-1)
    rows = np.stack([links.sample, links.first, links.second], axis=-1)
    _, number = np.unique(np.concatenate([rows, ends]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    link_of = np.full(number.max(initial=-1) + 1, -1)
    link_of[number[: len(rows)]] = np.arange(len(rows))
    link = link_of[number[len(rows) :]]
    back = (m.range_transmitter > m.range_receiver).astype(int)
    has = (link >= 0) & heard[back, link] if len(rows) else np.zeros(link.size, dtype=bool)
    lost = np.where(m.range_status == RayStatus.OK, np.int8(RayStatus.SHADOW), m.range_status)
    return np.asarray(np.where(has, np.int8(RayStatus.OK), lost))
