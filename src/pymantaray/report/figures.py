"""The figures of a run, each with its caption, in the order of the report."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from pymantaray.report.ends import range_ends
from pymantaray.report.figures_consistency import consistency_over_time
from pymantaray.report.figures_estimators import error_and_consistency
from pymantaray.report.figures_fleet import factor_graph, fleet_layout
from pymantaray.report.figures_ocean import ray_picture, sound_speed_profiles
from pymantaray.report.figures_ranging import dropout_map, range_error_histogram, range_error_split
from pymantaray.report.figures_trajectory import ApePanel, error_over_time, pooled_ape, quartiles_shaded
from pymantaray.report.figures_unknowns import unknowns_before_and_after
from pymantaray.report.findings import Findings
from pymantaray.report.style import DISTINCT


@dataclass(frozen=True)
class Plate:
    """
    A figure to be made.

    Parameters
    ----------
    name : str
        File name without its ending.
    caption : str
        Without the note that an ocean is synthetic; `full_caption` has it.
    draw : callable
        Makes the figure.
    synthetic : bool
        Whether any ocean that it shows is made up.
    """

    name: str
    caption: str
    draw: Callable[[], Figure]
    synthetic: bool

    @property
    def full_caption(self) -> str:
        """Caption that says so where the ocean is synthetic."""
        return f"{self.caption} Synthetic ocean." if self.synthetic else self.caption


def run_plates(found: Findings) -> list[Plate]:
    """
    Figures of one run.

    Parameters
    ----------
    found : Findings

    Returns
    -------
    list of Plate
        Without the ray picture where the run holds none.
    """
    run, header = found.run, found.header
    truth, measurements = run.truth, run.measurements
    marks = (measurements.landmark_name, measurements.landmark_position)
    count = len(run.estimates.realization)
    runs = "1 realization" if count == 1 else f"{count} realizations"
    conditions: tuple[str, ...] = run.config.study.conditions
    own = len(found.errors) - len(conditions) > DISTINCT  # too many lines for one panel
    errors = {name: e for name, e in found.errors.items() if name in conditions or not own}
    shaded = ", quartiles shaded" if quartiles_shaded(errors) else ""
    whose = "; estimators are in the next figure" if own else ""
    heard = int(np.isfinite(found.ranges.total).sum())
    plates = [
        (
            "sound_speed",
            (
                "Sound speed against depth over the whole region: mean of each level (line), least to greatest"
                " (shaded); (a) all depths, (b) the upper part."
            ),
            lambda: sound_speed_profiles([(found.region, run.profile)], header),
        ),
        (
            "fleet_layout",
            (
                "Fleet layout: (a) start positions and drift in plan, (b) start (dotted line downward to the"
                " vehicle's greatest depth) and track, (c) depth against time. Colour is each vehicle's greatest"
                " depth; a vehicle that stays at the surface is black."
            ),
            lambda: fleet_layout(truth, marks, header),
        ),
        (
            "ray_picture",
            (
                "Sound on the link that bends most: sound speed (blue), sea bed (brown, where it is not far below),"
                " direct eigenrays (orange), the straight chord (dashed) and other rays from the same source (grey)."
            ),
            lambda: ray_picture(run.ray_picture, header),
        ),
        (
            "factor_graph",
            (
                "Factor graph at the true positions: chains of poses coloured by the vehicle's greatest depth,"
                f" the {heard:,} ranges that were heard in grey."
            ),
            lambda: factor_graph(truth, measurements, header),
        ),
        (
            "range_error",
            (
                f"Signed range error, refracted minus straight, of {heard:,} ranges: mean (orange), zero (dashed)"
                " and fitted normal (black), with linear and logarithmic counts."
            ),
            lambda: range_error_histogram([(found.region, found.ranges.total)], header),
        ),
        (
            "range_error_split",
            (
                "Exact split of the range error: (a, b) the part from the reference speed, because the sound speed"
                " at the transmitter is not the path's mean, and the part from the bending of the ray; (c) bending"
                " at its own scale."
            ),
            lambda: range_error_split(
                measurements.straight_range, found.ranges.reference_speed, found.ranges.bending, header
            ),
        ),
        (
            "dropouts",
            (
                f"All {measurements.range_status.size:,} range attempts by (a) distance and depth difference and"
                " (b) the depths of both ends; dropouts coloured by their cause."
            ),
            lambda: dropout_map(*range_ends(truth, measurements), measurements.range_status, header),
        ),
        (
            "ape_pooled",
            (
                f"Absolute position error of all vehicles, times and {runs} of the noise by ranging"
                " condition, without alignment; mean solid, quartiles dashed; (a) logarithmic scale, (b) linear"
                " scale, which ends where the conditions other than odometry do."
            ),
            lambda: pooled_ape(
                [
                    ApePanel("logarithmic scale", found.errors, log=True),
                    ApePanel("linear scale", found.errors, log=False),
                ],
                header,
            ),
        ),
        (
            "error_over_time",
            (
                f"Position error of each vehicle over time: median of {runs}{shaded}{whose};"
                " GNSS fixes are marked at the bottom."
            ),
            lambda: error_over_time(truth.time, truth.name.tolist(), errors, found.fixes, header),
        ),
    ]
    if run.config.estimators:
        plates.append(
            (
                "estimators",
                (
                    f"What each estimator is worth, over {runs}: (a) root mean square of the position error over"
                    " all poses, dashed that of straight ranges; (b) squared error of the fleet's horizontal positions in the"
                    " covariance that the estimator gives, by its degrees of freedom: median over the epochs, least to greatest,"
                    " and the 95 % bounds of a consistent estimator in grey."
                ),
                lambda: error_and_consistency(
                    found.tables["ate_pooled"], found.tables.get("consistency_per_epoch"), header
                ),
            )
        )
    if "consistency_per_epoch" in found.tables:
        plates.append(
            (
                "consistency",
                (
                    f"Consistency over {runs} at fixed epochs: (a) squared error of the fleet's horizontal"
                    " positions in their joint covariance, (b) squared innovation of the ranges of a ping, each by its"
                    " degrees of freedom; where they are drawn, (c, d) the same near the bounds. A consistent estimator"
                    " is at 1 on average and inside the grey 95 % bounds; empty markers are outside."
                ),
                lambda: consistency_over_time(found.tables["consistency_per_epoch"], header),
            )
        )
    if "unknowns" in found.tables:
        plates.append(
            (
                "unknowns",
                (
                    f"Sound-speed modes and clocks estimated with the poses, over {runs}: standard deviation"
                    " that the estimator gives (blue) and error of its estimate (orange), both by the standard deviation"
                    " beforehand (grey line): on it the ranges say nothing."
                ),
                lambda: unknowns_before_and_after(found.tables["unknowns"], header),
            )
        )
    return [
        Plate(name, caption, draw, found.synthetic)
        for name, caption, draw in plates
        if name != "ray_picture" or found.has_ray_picture
    ]
