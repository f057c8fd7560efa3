"""Table of the measurements with the largest influence on the estimates of a run."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pymantaray.apps.study.graphs import noisy_graphs
from pymantaray.errors import EstimationError
from pymantaray.estimation import GraphValues
from pymantaray.estimation.solvers.influence import MEASURES, factor_influence, worst_factors

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run

_KINDS = ("fix", "survey", "range")
_ROWS = 10  # of each measure


def influence_table(run: "Run") -> pd.DataFrame:
    """
    Fixes, surveys and ranges with the largest residual, leverage and Cook's distance in realization
    0, by condition.
    """
    noisy = run.noisy_measurements(0)
    estimates = run.estimates
    tables = []
    graphs = noisy_graphs(run, noisy)
    for row, condition in enumerate(estimates.condition.tolist()):
        position = estimates.position[row, 0].reshape(-1, 3)
        if condition not in graphs or not np.isfinite(position).all():  # the solve failed
            continue
        graph = graphs[condition]
        quaternion = estimates.quaternion[row, 0].reshape(-1, 4).astype(float)
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        values = GraphValues(position, quaternion, estimates.landmark_position[row, 0])
        try:
            influence = factor_influence(graph, values, kinds=_KINDS)
        except EstimationError:
            continue
        for measure in MEASURES:
            worst = worst_factors(influence, measure, _ROWS)
            tables.append(worst.assign(condition=condition, largest=measure))
    columns = ["condition", "largest", "kind", "first", "second", "time_s", *MEASURES]
    return (
        pd.concat(tables, ignore_index=True)[columns] if tables else pd.DataFrame(columns=columns)
    )
