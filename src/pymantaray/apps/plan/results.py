"""
Results of a plan: scores over an ensemble of waters, table of designs with their Pareto front, the
best design as a study file, and sentences with numbers.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

from pymantaray.apps.plan.definition import DeploymentPlan, Design, FreeRange
from pymantaray.apps.plan.evaluate import Scores
from pymantaray.arrays import Array
from pymantaray.config import load_study
from pymantaray.config.common import NONE
from pymantaray.config.door.study import build_study
from pymantaray.config.load import BASE, preset_names
from pymantaray.records import whole_file
from pymantaray.records.result_table import ResultTable

if TYPE_CHECKING:
    import pandas as pd

# largest difference of near-optimal designs, as a share of the best value of the first objective
_NEAR = 0.1
_SCORES = [name for name in Scores._fields if name != "failure"]
_YES = ("no", "yes")
_WORDS = {
    "error_m": "95 % error [m]",
    "bias_rmse_m": "RMS bias [m]",
    "worst_error_m": "95 % error, worst tenth [m]",
    "worst_lost_percent": "lost, worst tenth [%]",
    "worst_front": "front, worst tenth",
}
COLUMNS = {
    "error": "error_m",
    "lost": "lost_percent",
    "heard_by_two": "heard_by_two_percent",
    "cost": "cost",
}
"""Score of each objective."""
LARGER_IS_BETTER = frozenset(["heard_by_two_percent"])
WORST = 0.1
"""Share of the waters that ``worst_score`` takes."""


@dataclass(frozen=True, eq=False)
class PlanResults:
    """
    Evaluated designs of a plan.

    Parameters
    ----------
    plan : DeploymentPlan
    designs : sequence of mapping
        Values of the free keys of each design.
    scores : sequence of sequence of Scores
        Scores of each design in each ocean.
    base : sequence of Scores
        Scores of the study as it is.
    """

    plan: DeploymentPlan
    designs: Sequence[Design]
    scores: Sequence[Sequence[Scores]]
    base: Sequence[Scores]

    def losses(self, ranked_by: str) -> Array:
        """
        Return the values that the objectives minimize.

        Parameters
        ----------
        ranked_by : {"mean", "worst-tenth"}
            Mean over all waters, or over the worst tenth of them.

        Returns
        -------
        ndarray, shape (n_designs, n_objectives)
        """
        objectives = self.plan.section.objectives
        return np.array([[loss_of(o, s, ranked_by) for o in objectives] for s in self.scores])

    @cached_property
    def front(self) -> NDArray[np.bool_]:
        """Mask of designs on the Pareto front of the objectives, in the mean over the waters."""
        return pareto_front(self.losses("mean"))

    @cached_property
    def worst_front(self) -> NDArray[np.bool_]:
        """
        Mask of designs on the Pareto front of the objectives, in the mean over the worst tenth of
        the waters.
        """
        return pareto_front(self.losses("worst-tenth"))

    @cached_property
    def best(self) -> int:
        """
        Number of the design with the best first objective; the others decide between equal designs.
        """
        order = self.losses(self.plan.section.ranked_by)
        usable = [k for k, row in enumerate(order) if np.isfinite(row).all()] or range(len(order))
        return min(usable, key=lambda k: np.nan_to_num(order[k], nan=np.inf).tolist())

    @cached_property
    def notes(self) -> list[str]:
        """Notes of the readers of the oceans, before random errors, and of trajectories."""
        from pymantaray.apps.study.mission import notes_of

        notes: list[str] = []
        for number in dict.fromkeys(ocean for ocean, _ in self.plan.waters):
            study = build_study(self.plan.study(self.designs[self.best], number))
            ocean = study.ocean.open(study.sound.interpolation)
            notes += notes_of(ocean, study.sound.medium(ocean))
            existing = study.fleet.existing
            notes += [] if existing is None else existing.tracks.notes
        return list(dict.fromkeys(notes))

    @cached_property
    def near(self) -> NDArray[np.bool_]:
        """
        Mask of designs whose first objective is within 10 % of the best, by its size; the best
        design is one of them.
        """
        losses = self.losses(self.plan.section.ranked_by)[:, 0]
        with np.errstate(invalid="ignore"):
            return np.asarray(losses - losses[self.best] <= _NEAR * abs(losses[self.best]))

    @cached_property
    def frame(self) -> "pd.DataFrame":
        """
        All designs in the order of the search: free keys, mean scores, with several waters the
        worst tenth, fronts, status.
        """
        import pandas as pd

        rows = []
        for k, (design, scores) in enumerate(zip(self.designs, self.scores, strict=True)):
            row: dict[str, Any] = {**design, **{name: mean_score(scores, name) for name in _SCORES}}
            if len(scores) > 1:
                row |= {f"worst_{COLUMNS[o]}": worst_score(scores, COLUMNS[o]) for o in COLUMNS}
            failure = next((one.failure for one in scores if one.failure), "")
            row["front"] = _YES[int(self.front[k])]
            if len(scores) > 1:
                row["worst_front"] = _YES[int(self.worst_front[k])]
            rows.append({**row, "status": failure or "OK"})
        return pd.DataFrame(rows)

    @property
    def base_row(self) -> dict[str, float]:
        """Scores of the study as it is, by the columns of `frame`."""
        row = {name: mean_score(self.base, name) for name in _SCORES}
        return row | {f"worst_{COLUMNS[o]}": worst_score(self.base, COLUMNS[o]) for o in COLUMNS}

    @cached_property
    def table(self) -> ResultTable:
        """Designs, sorted by the first objective."""
        objectives = [COLUMNS[objective] for objective in self.plan.section.objectives]
        order = np.argsort(self.losses(self.plan.section.ranked_by)[:, 0], kind="stable")
        several = len(self.base) > 1
        worst = [f"worst_{name}" for name in objectives] if several else []
        fronts = ["front", "worst_front"] if several else ["front"]
        failed = ["status"] if (self.frame["status"] != "OK").any() else []
        return ResultTable(
            "designs",
            self.frame.iloc[order].reset_index(drop=True),
            f"Designs of {self.plan.base.study.name}, {int(self.front.sum())} of"
            f" {len(self.designs)} on the front",
            brief=[
                *self.plan.keys,
                *dict.fromkeys([*objectives, *worst, "bias_rmse_m"]),
                *fronts,
                *failed,
            ],
            words=_WORDS,
        )

    @cached_property
    def sentences(self) -> list[str]:
        """
        Statements about the best design, compared with the study as it is, and about designs that
        are nearly as good.
        """
        design = self.designs[self.best]
        words = ", ".join(f"{key} = {_shown(value)}" for key, value in design.items())
        scores = self.scores[self.best]
        section = self.plan.section
        out = [f"Best design: {words}."]
        of = "all vehicles" if section.error_of is None else f"vehicle {section.error_of}"
        for name, text, unit in (
            ("error_m", f"95 % of the position errors of {of} are below", " m"),
            ("lost_percent", self._links, " % of the ranges"),
            ("heard_by_two_percent", "At least two receivers hear", " % of the pings"),
            ("cost", "The deployment costs", ""),
        ):
            if name == "cost" and not any(one.cost for one in scores):
                continue
            now = mean_score(scores, name)
            before = mean_score(self.base, name)
            if np.isfinite(now):
                digits = ",.6g" if name == "cost" else ".3g"
                out.append(f"{text} {now:{digits}}{unit}{_instead(now, before, unit, digits)}.")
        # free numbers whose best value is a limit of their range
        at_limits = [
            f"The best {key} is the {'lower' if design[key] == limits.low else 'upper'} limit of"
            " its range; a wider range may be better."
            for key, limits in self.plan.ranges.items()
            if isinstance(limits, FreeRange) and design[key] in (limits.low, limits.high)
        ]
        return [*out, *self._of_ensemble(), *self._of_one_number(), *at_limits]

    @property
    def _links(self) -> str:
        name = self.plan.section.lost_of
        return "All links lose" if name is None else f"{name} loses"

    def _of_one_number(self) -> list[str]:
        """
        Sentences about the values of the only free number: where links are lost, and which designs
        are nearly as good.
        """
        values = [next(iter(design.values())) for design in self.designs]
        if len(self.plan.keys) > 1 or not all(isinstance(v, int | float) for v in values):
            return []
        key = self.plan.keys[0]
        numbers = np.array(values, dtype=float)
        out = [
            _step(
                key,
                numbers,
                np.array([mean_score(s, "lost_percent") for s in self.scores]),
                self._links,
            )
        ]
        near = self.near
        objective = self.plan.section.objectives[0]
        if near.sum() > 1:
            low = numbers[near].min()
            high = numbers[near].max()
            inside = int(np.sum((numbers >= low) & (numbers <= high)))
            out.append(
                f"{int(near.sum())} of the {inside} designs with {key} from {_shown(low)} to"
                f" {_shown(high)} are within 10 % of the best {objective.replace('_', ' ')}."
            )
        return [line for line in out if line]

    def _of_ensemble(self) -> list[str]:
        """Sentence about the worst tenth of the waters."""
        scores = self.scores[self.best]
        if len(scores) == 1:
            return []
        count = int(np.ceil(WORST * len(scores)))
        which = "the worst of them" if count == 1 else f"the worst {count} of them"
        now = worst_score(scores, "error_m")
        instead = _instead(now, worst_score(self.base, "error_m"), " m", ".3g")
        return [
            (
                f"These are means over {len(scores)} waters; in {which} the 95 % error is {now:.3g}"
                f" m{instead}."
            )
        ]

    def write_best(self, out: str | Path, *, replace: bool = False) -> None:
        """
        Write the best design as a study file that changes the file of the plan.

        Parameters
        ----------
        out : str or pathlib.Path
            TOML file to write; its ``base`` is the file of the plan, relative to its folder.
        replace : bool
            Whether an existing file is replaced.

        Raises
        ------
        WriteError
            If the file exists already, or cannot be written.
        """
        path = Path(out)
        plan = self.plan
        new = plan.study(self.designs[self.best])
        source = plan.source
        if source not in preset_names():
            source = os.path.relpath(os.path.realpath(source), os.path.realpath(path.parent))
        given: dict[str, Any] = {"exclude_none": True, "exclude_unset": True}
        changes = difference(load_study(plan.source).model_dump(**given), new.model_dump(**given))
        changes.setdefault("study", {})["description"] = " ".join(self.sentences[:1])
        with whole_file(path, replace=replace) as temporary:
            temporary.write_text(tomli_w.dumps({BASE: source, **changes}), encoding="utf-8")


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """
    Changes that make one tree of another, for a file with a ``base``.

    Entries of lists with the same names are changed by name; other lists are replaced.

    Examples
    --------
    >>> difference({"a": 1, "b": [{"name": "A", "z": 1}]}, {"a": 1, "b": [{"name": "A", "z": 2}]})
    {'b': {'A': {'z': 2}}}
    """
    out: dict[str, Any] = dict.fromkeys(old.keys() - new.keys(), NONE)
    for key, value in new.items():
        before = old.get(key)
        if before == value:
            continue
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            out[key] = difference(before, value)
        elif _names(value) and _names(value) == _names(before):
            pairs = zip(before, value, strict=True)  # type: ignore[arg-type]
            out[key] = {b["name"]: d for a, b in pairs if (d := difference(a, b))}
        else:
            out[key] = value
    return out


def _names(entries: Any) -> list[str]:
    """Names of the entries of a list; empty if it is no list of named entries."""
    if not isinstance(entries, list | tuple) or not all(
        isinstance(e, Mapping) and "name" in e for e in entries
    ):
        return []
    return [entry["name"] for entry in entries]


def _step(key: str, values: Array, lost: Array, links: str) -> str:
    """
    Sentence about the value that best separates few from many lost links; empty if there are too
    few designs or no difference.
    """
    order = np.argsort(values)
    order = order[np.isfinite(lost[order])]
    values = values[order]
    lost = lost[order]
    splits = [k for k in range(1, values.size) if values[k] > values[k - 1]]
    if not splits or np.ptp(lost) == 0.0:
        return ""
    k = min(splits, key=lambda k: lost[:k].var() * k + lost[k:].var() * (lost.size - k))
    return (
        f"{links} {lost[k:].mean():.3g} % of the ranges on average with {key} of"
        f" {_shown(values[k])} or more, and {lost[:k].mean():.3g} % with {_shown(values[k - 1])} or"
        " less."
    )


def _instead(now: float, before: float, unit: str, digits: str) -> str:
    """Comparison with the study as it is; empty if its value is the same or missing."""
    same = not np.isfinite(before) or f"{now:{digits}}" == f"{before:{digits}}"
    return "" if same else f" instead of {before:{digits}}{unit.partition(' of ')[0]}"


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, int | float) else str(value)


def mean_score(scores: Sequence[Scores], column: str) -> float:
    """Mean of a score over the waters; NaN if the design fails in one."""
    return float(np.mean([getattr(one, column) for one in scores]))


def worst_score(scores: Sequence[Scores], column: str) -> float:
    """
    Mean of a score over the worst tenth of the waters, at least one; NaN if the design fails in one
    water.
    """
    values = np.sort([getattr(one, column) for one in scores])
    if column not in LARGER_IS_BETTER:
        values = values[::-1]
    worst = values[: int(np.ceil(WORST * len(values)))]
    return float(worst.mean()) if np.isfinite(values).all() else np.nan


def loss_of(objective: str, scores: Sequence[Scores], ranked_by: str = "mean") -> float:
    """Value that an objective minimizes: the mean over the waters, or that over the worst tenth."""
    column = COLUMNS[objective]
    value = mean_score(scores, column) if ranked_by == "mean" else worst_score(scores, column)
    return (-1.0 if column in LARGER_IS_BETTER else 1.0) * value


def pareto_front(losses: ArrayLike) -> NDArray[np.bool_]:
    """
    Mask of the designs that no other design dominates.

    Parameters
    ----------
    losses : array_like, shape (n_designs, n_objectives)
        Each objective is minimized. A design with NaN is not on the front.

    Returns
    -------
    ndarray of bool, shape (n_designs,)

    Examples
    --------
    >>> pareto_front([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]).tolist()
    [True, True, False]
    """
    values = np.asarray(losses, dtype=float)
    usable: NDArray[np.bool_] = np.isfinite(values).all(axis=1)
    front: NDArray[np.bool_] = usable.copy()
    for k in np.flatnonzero(usable):
        no_worse = (values[usable] <= values[k]).all(axis=1)
        front[k] = not (no_worse & (values[usable] < values[k]).any(axis=1)).any()
    return front
