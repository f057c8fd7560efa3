"""Results of one survey: positions of nodes, covariances, tests and tables."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.budget import error_budget
from pymantaray.apps.locate.checks import check_solution, check_survey
from pymantaray.apps.locate.displacement import (
    Campaign,
    Displacement,
    campaign_of,
    displacement_between,
)
from pymantaray.apps.locate.earth import medium_on_earth
from pymantaray.apps.locate.fit_tests import FitTest, fit_tests, test_table, widening
from pymantaray.apps.locate.gross import reasons
from pymantaray.apps.locate.mirror import Mirror, with_mirrors
from pymantaray.apps.locate.models import average_of_models, candidate_table, solve
from pymantaray.apps.locate.one_way import direct_arrivals
from pymantaray.apps.locate.options import Earth, LocateOptions
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.arrays import Array
from pymantaray.evaluation import unexplained
from pymantaray.geometry.tangent_plane import TangentPlane
from pymantaray.records.digits import show
from pymantaray.records.result_table import ResultTable

_ELLIPSE = math.sqrt(-2.0 * math.log(0.05))  # 95 % of a normal distribution in two dimensions
_INTERVAL = 1.959964
UNEXPLAINED = "unexplained"
"""Status of a node whose position does not explain its pings."""
_LONGEST_TIME = 120.0  # s; two-way time of 90 km, beyond the reach of any transponder
_NOMINAL_SPEED = 1500.0  # m/s; of a survey without pings of the platform
_MIN_PINGS = 3  # per node
_MIN_DEPTH = 0.05  # m; a shallower node counts as above the surface
_CAPTIONS = {
    "nodes": "Positions, standard deviations, 95 % ellipse and depth interval; relative: about the"
    " mean of all nodes",
    "displacement": "Displacement of the nodes since the earlier campaign as one rigid body, with"
    " its 95 % interval",
    "budget": "Contributions to the standard deviations; their squares add up to that of the total",
    "tests": "Chi-square tests: residuals against the stated noise, means of bins against zero, and"
    " the mean position from one half of the pings against that from the other; a correct model"
    " fails any of them with a probability of 1 %",
    "candidates": "Models of sound speed and noise by Akaike's Bayesian information criterion, best"
    " first; the chosen one is the best of those allowed, known is allowed only on request",
    "unknowns": "Other estimated parameters",
    "mirrors": "Both solutions of nodes whose pings lie along one line, with their chi-square",
}
_BRIEF = {
    "nodes": ("sigma_north_m", "sigma_east_m", "sigma_depth_m"),
    "budget": ("node", "source", "north_m", "east_m", "depth_m"),
    "displacement": (
        "axis",
        "displacement_m",
        "sigma_m",
        "correlation_north",
        "correlation_east",
        "correlation_depth",
    ),
    "candidates": (
        "chosen",
        "allowed",
        "sound_speed",
        "sound_speed_memory_s",
        "correlation_ratio",
        "correlation_time_s",
        "abic_difference",
        "sigma_s",
        "effective_parameters",
    ),
}
"""Columns in the terminal and in notebooks."""
_HEADS = {"name": "node", "north": "north [m]", "east": "east [m]", "depth": "depth [m]"}
_HEADS |= {
    f"{before}sigma_{axis}_m": f"{before.replace('_', ' ')}σ {axis} [m]"
    for before in ("", "relative_")
    for axis in ("north", "east", "depth")
}


@dataclass(frozen=True, eq=False)
class Location:
    """
    Positions of the nodes of a survey with covariance, model, tests and tables.

    Attributes
    ----------
    survey : Survey
        Survey, sorted by time.
    solution : SurveySolution
        Values of all unknowns.
    candidates : pandas.DataFrame
        Compared models of sound speed and noise, best first.
    tests : list of FitTest
        Tests of the residuals, and of positions from parts of the pings.
    shift : ndarray, shape (n_nodes, 3)
        Average of the positions over the models minus those of the chosen one. [m]
    spread : ndarray, shape (3 n_nodes, 3 n_nodes)
        Covariance of the positions due to the choice of the model. [m²]
    mirrors : list of Mirror
        Second solutions of nodes whose pings are along one line.
    reason : ndarray of str, shape (n,)
        Reason for each unused ping; empty for used pings.
    notes : tuple of str
        Transducers and nodes outside the water, whose rays end at its boundary.
    earth : str
        Shape of the Earth, and the reason.
    earths : dict
        Probability of ``flat`` and ``sphere`` if the survey does not state the shape, else empty.
    displacement : Displacement, optional
        Displacement since an earlier campaign.
    """

    survey: Survey
    solution: SurveySolution
    candidates: pd.DataFrame
    tests: list[FitTest]
    shift: Array
    spread: Array
    mirrors: list[Mirror]
    reason: NDArray[np.str_]
    notes: tuple[str, ...] = ()
    earth: str = ""
    earths: Mapping[Earth, float] = field(default_factory=dict)
    displacement: Displacement | None = None

    @cached_property
    def covariance(self) -> Array:
        """
        Joint posterior covariance of all positions (3 n_nodes, 3 n_nodes). [m²]

        It includes the choice of the model and the factor for failed tests. The order is north,
        east, depth of each node.
        """
        by_position = self.solution.unknowns.position_map(self.solution.values)
        flat = by_position.reshape(-1, self.solution.unknowns.size)
        plain = flat @ self.solution.posterior.covariance @ flat.T
        return np.asarray(self.widening**2 * (plain + self.spread))

    @property
    def widening(self) -> float:
        """Factor of all standard deviations due to failed tests, at least 1."""
        return widening(self.tests)

    @property
    def positions(self) -> Array:
        """Positions of the nodes, the average over the models (n_nodes, 3). [m]"""
        return self.solution.positions + self.shift

    @property
    def rms(self) -> float:
        """Root mean square of the residuals of the used pings. [s]"""
        return float(np.sqrt(np.mean(self.residual[self.solution.used] ** 2)))

    @property
    def residual(self) -> Array:
        """Measured minus predicted times of all pings, NaN without a ray. [s]"""
        return self.solution.linear.residual

    @property
    def passed(self) -> bool:
        """True if no test of the noise model failed."""
        return all(test.passed for test in self.tests)

    @property
    def hyperparameters(self) -> dict[str, Any]:
        """Selected model: sound speed, noise level, smoothness, correlation between pings."""
        fit = self.solution.posterior
        model = self.solution.model
        correlation = model.correlation
        return {
            "sound_speed": self.solution.unknowns.speed.kind,
            "sound_speed_memory_s": model.memory if np.isfinite(model.memory) else None,
            "sigma_s": fit.sigma,
            "smoothness": dict(fit.hyperparameters),
            "correlation_ratio": correlation.ratio,
            "correlation_time_s": None if model.is_white else correlation.memory,
            "correlation_shared": None if model.is_white else correlation.shared,
            "abic": fit.abic + 2.0 * model.hyperparameters,
        }

    @property
    def selection(self) -> str:
        """Statement of the selection of the sound-speed model."""
        table = self.candidates
        if table.loc[table["allowed"], "sound_speed"].nunique() == 1:
            return "as requested"
        best = table.iloc[0]
        if best["allowed"]:
            return "the model with the largest marginal likelihood (lowest ABIC)"
        difference = table.loc[table["chosen"], "abic_difference"].iloc[0]
        return (
            f"the best allowed model; the ABIC of {best['sound_speed']} is lower by"
            f" {difference:.1f}, but it is never selected automatically"
        )

    def since(self, earlier: Campaign) -> Self:
        """
        Location with the displacement of its nodes since an earlier campaign.

        Parameters
        ----------
        earlier : Campaign
            Earlier campaign, from `read_campaign`; its errors are independent of this one's.

        Returns
        -------
        Location
        """
        return replace(self, displacement=displacement_between(campaign_of(self), earlier))

    @cached_property
    def nodes(self) -> pd.DataFrame:
        """One row per node: position, its uncertainty, pings, residuals, status."""
        survey = self.survey
        used = self.solution.used
        # positions and their standard deviations
        position = self.positions
        count = len(survey.nodes)
        lat, lon = self._geodetic(position)
        depth = position[:, 2]
        sigma = _deviations(self.covariance)
        # standard deviations relative to the mean of all nodes
        about_mean = np.kron(np.eye(count) - 1.0 / count, np.eye(3))
        relative = _deviations(about_mean @ self.covariance @ about_mean.T)
        relative = relative if count > 1 else np.full_like(sigma, np.nan)
        # horizontal ellipses
        joint = self.covariance.reshape(count, 3, count, 3)
        ellipses = np.array([ellipse(joint[k, :2, k, :2]) for k in range(count)])
        # prior positions, and residuals of the pings
        prior = np.array([node.position for node in survey.nodes])
        of_node = [(survey.node == k) | (survey.partner == k) for k in range(count)]
        residuals = [self.residual[rows & used] for rows in of_node]
        rms = [float(np.sqrt(np.mean(r**2))) if r.size else np.nan for r in residuals]
        return pd.DataFrame(
            {
                "name": survey.names,
                "lat": lat,
                "lon": lon,
                "north": position[:, 0],
                "east": position[:, 1],
                "depth": depth,
                "sigma_north_m": sigma[:, 0],
                "sigma_east_m": sigma[:, 1],
                "sigma_depth_m": sigma[:, 2],
                "ellipse_major_m": ellipses[:, 0],
                "ellipse_minor_m": ellipses[:, 1],
                "ellipse_azimuth_deg": ellipses[:, 2],
                "depth_low_m": depth - _INTERVAL * sigma[:, 2],
                "depth_high_m": depth + _INTERVAL * sigma[:, 2],
                "relative_sigma_north_m": relative[:, 0],
                "relative_sigma_east_m": relative[:, 1],
                "relative_sigma_depth_m": relative[:, 2],
                "prior_north": prior[:, 0],
                "prior_east": prior[:, 1],
                "prior_depth": prior[:, 2],
                "n_used": [r.size for r in residuals],
                "n_all": [int(rows.sum()) for rows in of_node],
                "rms_s": rms,
                "status": [self._status(k, r.size) for k, r in enumerate(residuals)],
            }
        )

    @cached_property
    def unexplained(self) -> list[str | None]:
        """
        Reason why the position of each node does not explain its pings; None if it does.

        The limits are those of `pymantaray.evaluation.unexplained`. The stated noise of a ping
        contains that of the platform's positions. All pings with a ray count.
        """
        survey = self.survey
        speed = self.mean_speed
        legs = np.where(survey.direction == TravelDirection.TWO_WAY, 2.0, 1.0)
        error = survey.platform_error
        by_platform = legs * math.hypot(error.horizontal, error.vertical) / speed
        sigma = np.hypot(survey.sigma, by_platform)
        # the clock of a one-way time is unknown, and no sound is heard from far away
        one_way = survey.direction != TravelDirection.TWO_WAY
        water_time = np.minimum(self.solution.legs.travel_time, _LONGEST_TIME)
        time = np.where(one_way, water_time, np.minimum(water_time, survey.travel_time))
        residual = np.where(survey.flagged, np.nan, self.residual)
        out: list[str | None] = []
        for k in range(len(survey.nodes)):
            rows = (survey.node == k) | (survey.partner == k)
            out.append(unexplained(residual[rows], time[rows], sigma[rows]))
        return out

    @property
    def usable(self) -> bool:
        """True if the solver converged and the positions of all nodes explain their pings."""
        return self.solution.settled and not any(self.unexplained)

    def _status(self, k: int, n_used: int) -> str:
        """Status of a node as text; ``ok`` if its position is determined."""
        survey = self.survey
        position = self.positions[k]
        of_node = survey.node == k
        above = survey.transmit_position[of_node & ~survey.between_nodes, 2]
        top = float(np.median(above)) if above.size else -np.inf
        if not self.solution.settled:
            return "not converged"
        if self.unexplained[k] is not None:
            return UNEXPLAINED
        if n_used < _MIN_PINGS:
            no_ray = of_node & ~self.solution.legs.possible
            return "no ray" if no_ray.sum() > 0.5 * of_node.sum() else "too few pings"
        if position[2] <= _MIN_DEPTH:
            return "above the surface"
        if any(mirror.undecided for mirror in self.mirrors if mirror.node == survey.names[k]):
            return "two solutions"
        return "above the platform" if position[2] < top else "ok"

    @cached_property
    def centre(self) -> dict[str, float]:
        """Mean position of all nodes, with its standard deviations."""
        position = self.positions.mean(axis=0)
        count = len(self.survey.nodes)
        mean = np.tile(np.eye(3) / count, count)
        (sigma,) = _deviations(mean @ self.covariance @ mean.T)
        lat, lon = self._geodetic(position[None])
        names = ("north", "east", "depth", "sigma_north_m", "sigma_east_m", "sigma_depth_m")
        values = dict(zip(names, map(float, [*position, *sigma]), strict=True))
        return {"lat": float(lat[0]), "lon": float(lon[0])} | values

    def _geodetic(self, position: Array) -> tuple[Array, Array]:
        """Latitudes and longitudes, NaN without a frame. [degrees]"""
        if self.survey.frame is None:
            return np.full(len(position), np.nan), np.full(len(position), np.nan)
        if self.survey.depth_reference == "plane":
            lat, lon, _ = TangentPlane(self.survey.frame).to_geodetic(position)
            return lat, lon
        return self.survey.frame.to_geodetic(position[:, 0], position[:, 1])

    @cached_property
    def pings(self) -> pd.DataFrame:
        """
        One row per ping: node, times, residual, leverage, geometry, use, and reason if unused.
        """
        survey = self.survey
        solution = self.solution
        transmit_position, _ = solution.transducers()
        transmit_position = np.where(
            survey.between_nodes[:, None],
            self.positions[np.maximum(survey.partner, 0)],
            transmit_position,
        )
        step = transmit_position - self.positions[survey.node]
        # leverage: derivative of the prediction of a ping by its measurement
        covariance = solution.posterior.covariance / solution.posterior.sigma**2
        blocks = [block[:, :-1] for block in solution.whitened_rows()]
        leverage = np.full(len(survey), np.nan)
        leverage[solution.used] = np.concatenate(
            [np.sum((block @ covariance) * block, axis=1) for block in blocks]
        )
        table = pd.DataFrame(
            {
                "line": survey.line,
                "node": np.array(survey.names)[survey.node],
                "time_s": survey.time,
                "travel_time_s": survey.travel_time,
                "residual_s": self.residual,
                "leverage": leverage,
                "range_m": np.hypot(step[:, 0], step[:, 1]),
                "azimuth_deg": np.degrees(np.arctan2(step[:, 1], step[:, 0])) % 360.0,
                "north": transmit_position[:, 0],
                "east": transmit_position[:, 1],
                "used": solution.used,
                "reason": self.reason,
            }
        )
        if not np.isnat(survey.epoch):
            instant = survey.epoch + np.round(1e9 * survey.time).astype("timedelta64[ns]")
            table.insert(2, "time", instant)
        return table

    @cached_property
    def budget(self) -> pd.DataFrame:
        """Contributions to each node's standard deviations, see `error_budget`."""
        return error_budget(self.solution, self.spread, self.widening)

    @cached_property
    def sound_speed(self) -> pd.DataFrame:
        """Mean sound speed minus that of the profile over time; empty if it is known."""
        speed = self.solution.unknowns.speed
        solution = self.solution
        if not speed.terms:
            return pd.DataFrame(columns=["time_s", "change_m_s", "sigma_m_s"])
        first = speed.terms[0]
        start = solution.unknowns.slices["speed"].start
        columns = slice(start, start + first.sd.size)
        time = np.linspace(self.survey.time[0], self.survey.time[-1], 200)
        rows = np.ones((time.size, 1)) if first.spline is None else first.spline.at(time)
        scale = self.mean_speed
        variance = np.einsum(
            "ij,jk,ik->i", rows, solution.posterior.covariance[columns, columns], rows
        )
        change = scale * (rows @ solution.values[columns])
        return pd.DataFrame(
            {
                "time_s": time,
                "change_m_s": change,
                "sigma_m_s": self.widening * scale * np.sqrt(np.maximum(variance, 0.0)),
            }
        )

    @cached_property
    def mean_speed(self) -> float:
        """Median of straight distance over travel time of the used pings. [m/s]"""
        solution = self.solution
        survey = self.survey
        transmit_position, receive_position = solution.transducers()
        node = self.positions[survey.node]
        has_out = survey.direction != TravelDirection.FROM_NODE
        has_back = survey.direction != TravelDirection.TO_NODE
        length = (
            np.linalg.norm(transmit_position - node, axis=1) * has_out
            + np.linalg.norm(receive_position - node, axis=1) * has_back
        )
        rows = solution.used & ~survey.between_nodes
        if not rows.any():
            return _NOMINAL_SPEED
        return float(np.median(length[rows] / solution.legs.travel_time[rows]))

    @cached_property
    def other_unknowns(self) -> pd.DataFrame:
        """Estimated turn-around times, clocks, lever arm and array shift, with their errors."""
        unknowns = self.solution.unknowns
        values = self.solution.values
        variance = np.maximum(np.diag(self.solution.posterior.covariance), 0.0)
        sd = self.widening * np.sqrt(variance)
        slices = unknowns.slices
        names = self.survey.names
        labels = {
            "array": ["array north [m]", "array east [m]", "array depth [m]", "array turn [rad]"],
            "turn_around": [f"{name} turn-around time [s]" for name in names],
            "offset": [f"{name} clock offset [s]" for name in names],
            "drift": [f"{name} clock drift [s/s]" for name in names],
            "lever": [f"lever arm {axis} [m]" for axis in ("forward", "starboard", "down")],
        }
        rows = [
            {
                "unknown": label,
                "value": values[column],
                "sigma": sd[column],
                "prior": unknowns.prior_mean[column],
            }
            for kind, kind_labels in labels.items()
            for label, column in zip(
                kind_labels, range(slices[kind].start, slices[kind].stop), strict=True
            )
            if unknowns.prior_sd[column] > 0.0
        ]
        return pd.DataFrame(rows, columns=["unknown", "value", "sigma", "prior"])

    @property
    def both_sides(self) -> pd.DataFrame:
        """Reported and mirrored position of each node with two solutions, with chi-square."""
        rows = []
        for mirror in self.mirrors:
            reported = self.positions[self.survey.names.index(mirror.node)]
            for solution, position, chi_square in (
                ("reported", reported, mirror.reported_chi_square),
                ("mirrored", (mirror.north, mirror.east, mirror.depth), mirror.chi_square),
            ):
                north, east, depth = map(float, position)
                (lat,), (lon,) = self._geodetic(np.array([position]))
                row = {"node": mirror.node, "solution": solution, "lat": lat, "lon": lon}
                row |= {"north": north, "east": east, "depth": depth, "chi_square": chi_square}
                rows.append(row | {"undecided": mirror.undecided})
        return pd.DataFrame(rows).dropna(axis="columns")

    @property
    def _estimated_lever(self) -> str:
        """Statement of a lever arm that is estimated although it is stated."""
        stated = self.survey.lever.offset
        value = self.solution.unknowns.lever(self.solution.values)
        columns = self.solution.unknowns.slices["lever"]
        variance = np.diag(self.solution.posterior.covariance)[columns]
        axes = [
            f"{name} {value[axis]:+.2f} m (stated {stated[axis]:+.2f}, sigma"
            f" {self.widening * math.sqrt(variance[axis]):.2g})"
            for axis, name in enumerate(("forward", "starboard"))
        ]
        table = self.candidates[self.candidates["allowed"]]
        is_free = table["lever_doubt"] > 0.0
        free, known = (table.loc[rows, "abic"].min() for rows in (is_free, ~is_free))
        return (
            f"The lever arm is estimated because the pings contradict the stated one (ABIC lower by"
            f" {known - free:.1f}): {', '.join(axes)}. Check lever arm and headings, or state the"
            " uncertainty with `lever_sigma`."
        )

    @property
    def warnings(self) -> list[str]:
        """Lines that a reader must know before trusting the positions."""
        table = self.candidates
        lines = [f"Test failed: {test.text}." for test in self.tests if not test.passed]
        if self.widening > 1.0:
            factor = show(self.widening)
            lines.append(
                f"All standard deviations are multiplied by {factor} because of failed tests."
            )
        nodes = self.nodes[["name", "status", "n_used", "n_all"]].itertuples(index=False)
        for (name, status, n_used, n_all), why in zip(nodes, self.unexplained, strict=True):
            if status != "ok":
                reason = f", {why}" if why else ""
                lines.append(f"{name}: {status}{reason}; {n_used} of {n_all} pings used.")
        for mirror in self.mirrors:
            verdict = "the pings do not exclude it" if mirror.undecided else "the pings exclude it"
            north, east, depth = self.positions[self.survey.names.index(mirror.node)]
            lines.append(
                f"{mirror.node}: the pings are along a line; two solutions: reported at north"
                f" {north:.1f}, east {east:.1f}, depth {depth:.1f} m with chi-square"
                f" {mirror.reported_chi_square:.1f}, and mirrored at north {mirror.north:.1f},"
                f" east {mirror.east:.1f}, depth {mirror.depth:.1f} m with a chi-square larger by"
                f" {mirror.chi_square_difference:.1f}: {verdict}."
            )
        if self.solution.model.lever_doubt > 0.0:
            lines.append(self._estimated_lever)
        elif "lever_doubt" in table and bool(
            table["allowed"].to_numpy()[table["lever_doubt"].argmax()]
        ):
            lines.append(
                "The pings do not exclude that the lever arm or the headings are wrong; this is in"
                " the standard deviations. Check both, or state an uncertainty with `lever_sigma`."
            )
        return lines + ([] if self.displacement is None else self.displacement.notes)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """All tables by name, in the order of the page; empty ones are left out."""
        moved = pd.DataFrame() if self.displacement is None else self.displacement.table
        frames = {
            "nodes": self.nodes,
            "displacement": moved.dropna(axis="columns"),
            "budget": self.budget[
                (self.budget[["north_m", "east_m", "depth_m"]] > 0.0).any(axis=1)
            ],
            "tests": test_table(self.tests),
            "candidates": self.candidates,
            "unknowns": self.other_unknowns,
            "mirrors": self.both_sides,
            "sound_speed": self.sound_speed,
            "pings": self.pings,
        }
        coordinates = ("north", "east") if self.survey.frame is None else ("lat", "lon")
        brief = _BRIEF | {"nodes": ("name", *coordinates, "depth", *_BRIEF["nodes"])}
        unsure = [name for name in ("earth", "lever_doubt") if name in self.candidates]
        brief["candidates"] = (*_BRIEF["candidates"][:3], *unsure, *_BRIEF["candidates"][3:])
        return {
            name: ResultTable(
                name,
                frame,
                _CAPTIONS.get(name, ""),
                brief=brief.get(name, ()),
                words=_HEADS | ({"name": "test"} if name == "tests" else {}),
                folded=name == "candidates",
            )
            for name, frame in frames.items()
            if len(frame)
        }


def _deviations(covariance: Array) -> Array:
    """Standard deviations (n, 3) of a covariance (3 n, 3 n)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(-1, 3))


def ellipse(covariance: Array) -> tuple[float, float, float]:
    """
    Semi-axes of the 95 % ellipse of north and east [m], and the major axis's azimuth. [degrees]
    """
    values, vectors = np.linalg.eigh(covariance)
    minor, major = np.sqrt(np.maximum(values, 0.0)) * _ELLIPSE
    azimuth = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0
    return float(major), float(minor), azimuth


def ellipse_points(row: Mapping[Any, Any], count: int) -> Array:
    """North and east (count, 2) of the 95 % ellipse of a row of nodes about its centre. [m]"""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    along = row["ellipse_major_m"] * np.cos(angle)
    across = row["ellipse_minor_m"] * np.sin(angle)
    azimuth = np.radians(row["ellipse_azimuth_deg"])
    north = along * np.cos(azimuth) - across * np.sin(azimuth)
    east = along * np.sin(azimuth) + across * np.cos(azimuth)
    return np.column_stack([north, east])


def locate(survey: Survey, medium: Medium, options: LocateOptions | None = None) -> Location:
    """
    Estimate the positions of a survey's nodes.

    Parameters
    ----------
    survey : Survey
        Survey from `read_survey` or from arrays.
    medium : Medium
        Sound speed, in the survey's frame unless it is horizontally uniform. `LocateOptions.earth`
        defines the shape of the Earth: by default a sphere if the survey has a geographic frame,
        else the average over a plane and a sphere.
    options : LocateOptions, optional
        Options of the solver.

    Returns
    -------
    Location
        Positions with covariance. Nodes without rays or with too few pings have a status; unused
        pings have a reason.

    Raises
    ------
    LocateError
        If units or signs are impossible, the profile ends above a node, or the model explains no
        ping.

    Examples
    --------
    Continues the example of `pymantaray.apps.locate`:

    >>> from pymantaray.apps.locate import LocateOptions, locate
    >>> location = locate(survey, water, LocateOptions(speed_model="known", earth="flat"))
    >>> location.usable, location.positions.round(1).tolist()
    (True, [[30.0, -20.0, 1300.0]])
    """
    # prepare
    selected = options or LocateOptions()
    water = medium_on_earth(survey, medium, selected.earth)
    check_survey(survey, water.medium)
    direct = direct_arrivals(survey, water.medium)
    survey = survey.assign(flagged=survey.flagged | (direct.reason != ""))
    # solve
    solution, candidates, solver = solve(
        survey, water.medium, selected, direct.position, water.on_sphere
    )
    solution, mirrors = with_mirrors(solver, solution)
    average = average_of_models(candidates, selected.kinds, solution)
    medium = solver.medium_of(solution.model)
    of_halves = average
    if average.earths:
        # the Earth below both halves of a survey is the same
        on_this_earth = [one for one in candidates if one.model.earth == solution.model.earth]
        of_halves = average_of_models(on_this_earth, selected.kinds, solution)
    # judge
    of_modes = () if selected.modes is None else selected.modes.notes
    notes = (*of_modes, *medium.notes, *check_solution(solution, medium))
    reason = np.where(direct.reason != "", direct.reason, reasons(solution, medium))
    return Location(
        survey,
        solution,
        candidate_table(candidates, selected.kinds, solution),
        fit_tests(solution, of_halves.spread),
        average.shift,
        average.spread,
        mirrors,
        reason,
        notes,
        water.decided(average.earths, average.deeper),
        average.earths,
    )
