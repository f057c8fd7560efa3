"""Slow errors of water, positions and clocks as Gauss-Markov processes, and their sizes."""

from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np
import pandas as pd

from pymantaray.apps.replay.baselines import pairs_of_depths
from pymantaray.apps.replay.candidates import GRADIENT
from pymantaray.apps.replay.event_data import HOUR
from pymantaray.apps.replay.options import PredictionOptions
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.filters.gauss_markov import Processes

_SHARED = np.sqrt(0.5)  # half of the variance of the water is common to all pairs of depths
_SOUND_SPEED = 1450.0  # m/s, for sizes only
_DAY = 86400.0
PARTS = ("water", "position", "pair", "clock")
"""Parts of the learned correction of a travel time, in the order of `Design`."""


@dataclass(frozen=True)
class ErrorSizes:
    """
    Standard deviations and time scales of slow errors, and the error that nothing explains.

    Each field is positive; the defaults are where the search for the largest likelihood begins.
    """

    water: float = 4e-4
    """Constant relative error of the sound speed of a pair of depths."""
    water_varying: float = 4e-4
    water_hours: float = 6.0
    position_m: float = 0.7
    """Constant error of each horizontal coordinate of a node."""
    position_varying_m: float = 0.5
    position_hours: float = 8.0
    pair_m: float = 0.3
    """Varying error of a pair that neither water nor positions explain."""
    pair_hours: float = 3.0
    clock_s: float = 2e-4
    rate_s_per_day: float = 5e-5
    unexplained_s: float = 4e-4

    @classmethod
    def prior_of(cls, options: PredictionOptions) -> Self:
        """Return the defaults, or the errors of positions and sound speed of the options."""
        sizes = cls()
        if options.position_sigma > 0.0:
            sizes = replace(sizes, position_m=options.position_sigma)
        if options.sound_speed_sigma > 0.0:
            sizes = replace(sizes, water=options.sound_speed_sigma / _SOUND_SPEED)
        return sizes

    @property
    def logarithms(self) -> Array:
        """Natural logarithms of the fields."""
        return np.log([getattr(self, field.name) for field in fields(self)])

    @classmethod
    def from_logarithms(cls, values: Array) -> Self:
        """Return the sizes with some logarithms."""
        return cls(*np.exp(values).tolist())


LOG_SCALE = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 0.5, 1.0, 0.5, 1.5, 1.5, 1.0])
"""Scales of the prior Cauchy distributions of the logarithms of `ErrorSizes`."""


class Design(NamedTuple):
    """Processes that contribute to the travel time of each event, and their factors."""

    names: pd.DataFrame
    """One row per process: its ``part``, ``name``, ``kind`` and ``unit``."""
    columns: Indices
    """(n_events, m)"""
    values: Array
    """Travel time per unit of the process (n_events, m). [s]"""
    part: Indices
    """Part of each of the m terms, an index of `PARTS`."""

    @classmethod
    def of(cls, events: pd.DataFrame, candidates: pd.DataFrame) -> Self:
        """
        Design of events.

        Parameters
        ----------
        events : pandas.DataFrame
            Events of a `Replay`.
        candidates : pandas.DataFrame
            As from `predict_draws`.
        """
        n = len(events)
        nodes = sorted(set(events["source"]) | set(events["receiver"]))
        pairs, pair = np.unique(events["pair"].to_numpy(dtype=str), return_inverse=True)
        depths, depth = pairs_of_depths(events)
        names: list[tuple[str, str, str, str]] = []
        columns: list[Indices] = []
        values: list[Array] = []
        part: list[int] = []

        def add(
            what: tuple[str, str, str], labels: list[str], terms: list[tuple[Indices, Array]]
        ) -> None:
            """Add one process per label, and its terms."""
            first = len(names)
            names.extend((what[0], label, what[1], what[2]) for label in labels)
            for index, factor in terms:
                columns.append(first + index)
                values.append(factor)
                part.append(PARTS.index(what[0]))

        travel_time = _mean_of(candidates, "travel_time_s", n)
        nothing = np.zeros(n, dtype=np.int64)
        for kind in ("water", "water_varying"):
            add(("water", kind, "1"), ["all"], [(nothing, -_SHARED * travel_time)])
            add(("water", kind, "1"), depths, [(depth, -_SHARED * travel_time)])
        ends = [np.searchsorted(nodes, events[end]) for end in ("receiver", "source")]
        signs = (1.0, -1.0)
        along = _mean_of(candidates, GRADIENT[0], n)
        bearing = np.radians(events["bearing_deg"].to_numpy())
        is_other = (events["source"] != events["receiver"]).to_numpy(dtype=float)
        for kind in ("position", "position_varying"):
            for axis, cosine in (("north", np.cos(bearing)), ("east", np.sin(bearing))):
                labels = [f"{node} {axis}" for node in nodes]
                factor = is_other * along * cosine
                terms = [(end, sign * factor) for end, sign in zip(ends, signs, strict=True)]
                add(("position", kind, "m"), labels, terms)
        add(("pair", "pair", "m"), list(pairs), [(pair, along)])
        days = (events["time_s"] - 0.5 * (events["time_s"].min() + events["time_s"].max())) / _DAY
        for kind, factor in (("clock", np.ones(n)), ("rate", days.to_numpy())):
            terms = [(end, sign * is_other * factor) for end, sign in zip(ends, signs, strict=True)]
            add(("clock", kind, "s" if kind == "clock" else "s/d"), nodes, terms)
        table = pd.DataFrame(names, columns=["part", "name", "kind", "unit"])
        return cls(table, np.stack(columns, 1), np.stack(values, 1), np.array(part))

    @property
    def water(self) -> tuple[list[str], Array]:
        """
        Pairs of depths, and the relative error of their sound speeds by the processes: a matrix
        with one row per pair of depths.
        """
        water = self.names[self.names["part"] == "water"]
        depths = [name for name in water["name"].unique() if name != "all"]
        weights = np.zeros((len(depths), len(self.names)))
        for row, depth in enumerate(depths):
            weights[row, water.index[water["name"].isin(["all", depth])]] = _SHARED
        return depths, weights

    def processes(self, sizes: ErrorSizes) -> Processes:
        """Processes with some sizes."""
        constant = np.inf
        of_kind = {
            "water": (sizes.water, constant),
            "water_varying": (sizes.water_varying, sizes.water_hours * HOUR),
            "position": (sizes.position_m, constant),
            "position_varying": (sizes.position_varying_m, sizes.position_hours * HOUR),
            "pair": (sizes.pair_m, sizes.pair_hours * HOUR),
            "clock": (sizes.clock_s, constant),
            "rate": (sizes.rate_s_per_day, constant),
        }
        sigma, time_scale = np.array([of_kind[kind] for kind in self.names["kind"]]).T
        return Processes(sigma, time_scale)


def _mean_of(candidates: pd.DataFrame, name: str, events: int) -> Array:
    """Mean of a column over the candidates of each event, 0 without any."""
    at = candidates["event"].to_numpy(dtype=np.int64)
    total = np.bincount(at, candidates[name].to_numpy(), minlength=events)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=events), 1))
