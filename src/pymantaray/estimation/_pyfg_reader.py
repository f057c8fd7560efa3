"""Line by line reader of PyFactorGraph text; `pymantaray.estimation.pyfg` is its public face."""

import math
import re
from collections import Counter
from collections.abc import Collection
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation._pyfg_words import (
    AGENT_LETTERS,
    EDGE,
    FLAT,
    FREE_VARIANCE,
    LANDMARK,
    LANDMARK_LETTER,
    LANDMARK_PRIOR,
    POSE,
    POSE_PRIOR,
    RANGE,
    SIGHTING,
    TO_FILE,
)
from pymantaray.estimation._refusals import LARGEST, QUATERNION_TOLERANCE, VARIANCES
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.geometry.se3 import matrix_from_quaternion

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# word: (has a time stamp, number of names, number of values after them, where its quaternion begins)
_GRAMMAR: dict[str, tuple[bool, int, int, int | None]] = {
    POSE: (True, 1, 7, 3),
    LANDMARK: (False, 1, 3, None),
    POSE_PRIOR: (True, 1, 7 + 21, 3),
    LANDMARK_PRIOR: (True, 1, 3 + 6, None),
    EDGE: (True, 2, 7 + 21, 3),
    RANGE: (True, 2, 2, None),
    SIGHTING: (True, 2, 3 + 6, None),
}
_LARGEST_NUMBER = 2**31 - 1  # of a pose; records keep it in 32 bits
_NAME = re.compile(rf"([{AGENT_LETTERS}{LANDMARK_LETTER}])([0-9]+)")
_Row = tuple[int, float, list[str], list[float]]


class Reader:
    """
    Collects the lines of one file and makes a graph of them.

    Parameters
    ----------
    source : str
        Name of the file, for messages.
    leave_out : collection of str
        Words whose lines are checked, counted and left out.
    """

    def __init__(self, source: str, leave_out: Collection[str] = ()) -> None:
        self._source = source
        self._leave_out = frozenset(leave_out)
        self.left_out: Counter[str] = Counter()
        self._rows: dict[str, list[_Row]] = {word: [] for word in _GRAMMAR}  # SIGHTING's stays empty
        self._variable: dict[str, int] = {}

    def take(self, number: int, line: str) -> None:
        """
        Take one line.

        Parameters
        ----------
        number : int
            Number of the line, from 1.
        line : str
            Without its end.
        """
        fields = line.strip(" ").split(" ")
        word = fields[0]
        if word in FLAT:
            self._refuse(number, f"{word}, a graph in two dimensions", "graphs in three dimensions")
        if word not in _GRAMMAR:
            self._refuse(
                number,
                f"begins with {word[:40]!r}",
                f"{', '.join(_GRAMMAR)}, with one space between fields",
            )
        if number == 1 and word not in {POSE, LANDMARK}:
            self._refuse(number, f"begins with {word!r}", f"{POSE} or {LANDMARK} in the first line")
        has_time, n_names, n_values, quaternion = _GRAMMAR[word]
        n_heads = 1 + has_time + n_names
        if len(fields) != n_heads + n_values:
            self._refuse(
                number,
                f"{word} with {len(fields)} fields",
                f"{n_heads + n_values}, with one space between fields",
            )
        try:
            values = [float(f) for f in fields[n_heads:]]
            time = float(fields[1]) if has_time else 0.0
        except ValueError as error:
            self._refuse(number, f"{word}: {str(error)[:80]}", "numbers")
        if not all(map(math.isfinite, values)) or not math.isfinite(time):
            self._refuse(number, f"{word} with a value that is not finite", "finite numbers")
        if "_" in line[len(word) :] or "\t" in line:
            self._refuse(number, f"{word} with an underscore or a tab among its numbers", "digits and spaces")
        if word != RANGE and max(map(abs, values[:3])) > LARGEST:
            self._refuse(
                number, f"{word} with {max(map(abs, values[:3])):g}", f"positions of at most {LARGEST:g} m"
            )
        if max(map(abs, values)) > VARIANCES[1]:
            self._refuse(number, f"{word} with {max(map(abs, values)):g}", f"at most {VARIANCES[1]:g}")
        if quaternion is not None:
            q = values[quaternion : quaternion + 4]
            if abs(math.hypot(*q) - 1.0) > QUATERNION_TOLERANCE:
                self._refuse(number, f"{word}: quaternion {q}", "x y z w of length 1")
        names = self._names(number, word, fields[1 + has_time : n_heads])
        self._check_names(number, word, names)
        if word in self._leave_out:
            self.left_out[word] += 1
        elif word == SIGHTING:
            self._refuse(
                number,
                f"{word}, a landmark's place in a pose's body frame, which the graph has no factor for",
                "the other words; or leave these lines out by choice",
            )
        else:
            self._rows[word].append((number, time, names, values))

    def finish(self) -> tuple[FactorGraph, GraphValues]:
        """
        Make the graph of all lines taken.

        Returns
        -------
        graph : FactorGraph
        values : GraphValues
        """
        poses, landmarks = self._rows[POSE], self._rows[LANDMARK]
        if not poses:
            raise EstimationError(f"{self._source}: no {POSE} in the file; at least one pose is needed")
        for number, _, (name,), _ in [*poses, *landmarks]:
            if name in self._variable:
                self._refuse(number, f"second vertex named {name}", "one vertex for each name")
            self._variable[name] = len(self._variable)
        agents = list(dict.fromkeys(row[2][0][0] for row in poses))
        vertex = _table(poses, 7)
        prior, edge, ranges = (
            _table(self._rows[POSE_PRIOR], 28),
            _table(self._rows[EDGE], 28),
            self._rows[RANGE],
        )
        survey = _table(self._rows[LANDMARK_PRIOR], 9)
        range_values = _table(ranges, 2)
        full, fix, vertical = self._sort_priors(prior)
        prior_pose = self._resolve(self._rows[POSE_PRIOR], 0)
        covariance = _symmetric(prior[:, 7:], 6)
        graph = FactorGraph(
            agent_name=np.array(agents),
            landmark_name=np.array([row[2][0] for row in landmarks], dtype=str),
            pose_agent=np.array([agents.index(row[2][0][0]) for row in poses]),
            pose_number=np.array([int(row[2][0][1:]) for row in poses]),
            pose_time=np.array([row[1] for row in poses]),
            prior_pose=prior_pose[full],
            prior_position=prior[full, :3],
            prior_quaternion=prior[full][:, [6, 3, 4, 5]],
            prior_covariance=covariance[full][:, TO_FILE][:, :, TO_FILE],
            fix_pose=prior_pose[fix],
            fix_position=prior[fix, :3],
            fix_covariance=_turn(covariance[fix, :3, :3], prior[fix][:, [6, 3, 4, 5]]),
            depth_pose=prior_pose[vertical],
            depth=prior[vertical, 2],
            depth_variance=covariance[vertical, 2, 2],
            survey_landmark=self._resolve(self._rows[LANDMARK_PRIOR], 0) - len(poses),
            survey_position=survey[:, :3],
            survey_covariance=_symmetric(survey[:, 3:], 3),
            edge_from=self._resolve(self._rows[EDGE], 0),
            edge_to=self._resolve(self._rows[EDGE], 1),
            edge_quaternion=edge[:, [6, 3, 4, 5]],
            edge_translation=edge[:, :3],
            edge_covariance=_symmetric(edge[:, 7:], 6)[:, TO_FILE][:, :, TO_FILE],
            range_first=self._resolve(ranges, 0),
            range_second=self._resolve(ranges, 1),
            range_distance=range_values[:, 0],
            range_variance=range_values[:, 1],
        )
        values = GraphValues(
            position=vertex[:, :3],
            quaternion=vertex[:, [6, 3, 4, 5]],
            landmark_position=_table(landmarks, 3),
        )
        return graph, values

    def _sort_priors(self, prior: Array) -> tuple[Mask, Mask, Mask]:
        """Tell pose priors, position fixes and depth priors apart by their free axes."""
        variance = np.diagonal(_symmetric(prior[:, 7:], 6), axis1=1, axis2=2)
        free = variance >= FREE_VARIANCE
        # down may be told from across only where the prior's own axes are the world's, up to a turn about down
        level = np.abs(prior[:, 3:5]).max(axis=1, initial=0.0) < 1e-9
        full = np.asarray((~free).all(axis=1))
        fix = (free == np.array([False, False, False, True, True, True])).all(axis=1)
        vertical = (free == np.array([True, True, False, True, True, True])).all(axis=1) & level
        neither = ~(full | fix | vertical)
        if neither.any():
            row = int(np.argmax(neither))
            axes = [
                a for a, f in zip(("x", "y", "z", "rx", "ry", "rz"), free[row].tolist(), strict=True) if f
            ]
            self._refuse(
                self._rows[POSE_PRIOR][row][0],
                f"pose prior with free axes {' '.join(axes)}",
                f"none, or rx ry rz, or x y rx ry rz on level axes (free: variance {FREE_VARIANCE:g} or more)",
            )
        return full, fix, vertical

    def _names(self, number: int, word: str, fields: list[str]) -> list[str]:
        """Names without leading zeros, so that A01 and A1 are the same."""
        names = []
        for field in fields:
            found = _NAME.fullmatch(field)
            if found is None:
                self._refuse(
                    number,
                    f"name {field[:40]!r}",
                    "a capital letter and a number, as A0, or L0 for a landmark",
                )
            digits = found[2].lstrip("0") or "0"
            if len(digits) > 10 or int(digits) > _LARGEST_NUMBER:
                self._refuse(number, f"{word}: number of {field[:40]}", f"numbers up to {_LARGEST_NUMBER}")
            names.append(found[1] + digits)
        return names

    def _check_names(self, number: int, word: str, names: list[str]) -> None:
        landmark = [name[0] == LANDMARK_LETTER for name in names]
        if word in {POSE, POSE_PRIOR, EDGE} and any(landmark):
            self._refuse(number, f"{word} with landmark {names[landmark.index(True)]}", "poses")
        if word in {LANDMARK, LANDMARK_PRIOR} and not all(landmark):
            self._refuse(number, f"{word} with pose {names[0]}", "a landmark, as L0")
        if len(names) == 2 and names[0] == names[1]:
            self._refuse(number, f"{word} from {names[0]} to itself", "two different names")
        if word == SIGHTING and landmark != [False, True]:
            self._refuse(number, f"{word} from {names[0]} to {names[1]}", "a pose, then a landmark")
        if landmark == [True, False]:
            self._refuse(number, f"{word} from {names[0]} to {names[1]}", "the pose first")

    def _resolve(self, rows: list[_Row], which: int) -> NDArray[np.int32]:
        out = np.empty(len(rows), dtype=np.int32)
        for i, (number, _, names, _) in enumerate(rows):
            variable = self._variable.get(names[which])
            if variable is None:
                self._refuse(number, f"name {names[which]}", "names of the file's vertices")
            out[i] = variable
        return out

    def _refuse(self, number: int, found: str, allowed: str) -> NoReturn:
        raise EstimationError(f"{self._source}, line {number}: {found}; allowed: {allowed}")


def _table(rows: list[_Row], n_columns: int) -> Array:
    return np.array([row[3] for row in rows], dtype=float).reshape(-1, n_columns)


def _symmetric(triangle: Array, size: int) -> Array:
    """Matrices of their upper triangles by rows."""
    out = np.zeros((triangle.shape[0], size, size))
    rows, columns = np.triu_indices(size)
    out[:, rows, columns] = triangle
    out[:, columns, rows] = triangle
    return out


def _turn(covariance: Array, quaternion: Array) -> Array:
    """Covariances in the world's axes; untouched, to the last digit, where the axes agree."""
    turned = np.any(quaternion != np.array([1.0, 0.0, 0.0, 0.0]), axis=1)
    rotation = matrix_from_quaternion(quaternion)
    world = rotation @ covariance @ np.swapaxes(rotation, 1, 2)
    return np.where(turned[:, None, None], world, covariance)
