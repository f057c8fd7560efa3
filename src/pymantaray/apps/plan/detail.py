"""
Details of a few designs for figures: errors over time, lost links of each pair, and the mission.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from pymantaray.apps.plan.definition import DeploymentPlan, Design
from pymantaray.apps.plan.evaluate import (
    Errors,
    KeyedPlan,
    detection_probability,
    error_quantile,
    evaluator_of,
)
from pymantaray.apps.study.store import Run
from pymantaray.arrays import Array
from pymantaray.records import Measurements, Trajectories

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class DesignDetail:
    """A design in the waters of a plan: means over the waters, and the mission in the first one."""

    design: Design
    hours: Array
    """Times of the errors, shape (n,). [h]"""
    error_m: Array
    """
    95 % quantile of the errors of the vehicles that count at each time, mean over the waters; NaN
    without a vehicle.
    """
    worst_m: Array
    """The same in the water with the largest error at each time."""
    lost_percent: dict[Pair, float]
    """
    Expected share of lost ranges of each pair of participants in both directions, mean over the
    waters.
    """
    truth: Trajectories
    measurements: Measurements
    ocean: dict[Any, Any]
    """Attributes of the first ocean."""


def detail_of(plan: DeploymentPlan, design: Design) -> DesignDetail:
    """
    Details of a design that does not fail; waters and links of earlier designs in this process are
    used again.
    """
    evaluator = evaluator_of(KeyedPlan(plan.fingerprint, plan))
    first: Run | None = None
    errors = list[Errors]()
    lost = list[dict[Pair, float]]()
    with threadpool_limits(limits=1, user_api="blas"):
        for ocean, member in plan.waters:
            run, error = evaluator.evaluate(design, ocean, member)
            first = first or run
            errors.append(error)
            lost.append(lost_by_pair(run))
    assert first is not None  # a plan has at least one water
    quantiles = np.array([_over_time(error) for error in errors])
    return DesignDetail(
        design=design,
        hours=errors[0].time / 3600.0,
        error_m=quantiles.mean(axis=0),
        worst_m=quantiles.max(axis=0),
        lost_percent=_means(lost),
        truth=first.truth,
        measurements=first.measurements,
        ocean=dict(first.ocean.attrs),
    )


def lost_by_pair(run: Run) -> dict[Pair, float]:
    """Expected share of lost attempts of each pair of participants, in both directions. [%]"""
    m = run.measurements
    probability = detection_probability(run)
    names = [*m.name.tolist(), *m.landmark_name.tolist()]
    ends = np.sort(np.stack([m.range_transmitter, m.range_receiver], axis=1), axis=1)
    pairs, of = np.unique(ends, axis=0, return_inverse=True)
    of = of.reshape(-1)
    heard = np.bincount(of, probability, minlength=len(pairs)) / np.bincount(
        of, minlength=len(pairs)
    )
    return {
        (names[a], names[b]): 100.0 * float(1.0 - h) for (a, b), h in zip(pairs, heard, strict=True)
    }


def _over_time(errors: Errors) -> Array:
    """Quantile of the errors of the vehicles that count at each time."""
    each = zip(errors.bias, errors.covariance, errors.counts, strict=True)
    return np.array([error_quantile(bias[own], covariance[own]) for bias, covariance, own in each])


def _means(tables: Sequence[dict[Pair, float]]) -> dict[Pair, float]:
    """Mean of each pair over the waters in which it has attempts."""
    pairs = dict.fromkeys(pair for table in tables for pair in table)
    return {pair: float(np.mean([t[pair] for t in tables if pair in t])) for pair in pairs}
