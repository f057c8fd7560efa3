"""Unknowns of a survey: the columns of its linear system, by name, with their priors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pymantaray.apps.locate.options import Arrangement, Earth
from pymantaray.apps.locate.sound_speed import SoundSpeed
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.apps.locate.travel_times import Legs
from pymantaray.arrays import Array

_ARRAY_SIGMA = (3.0, 3.0, 3.0, 0.05)  # m, m, m, rad; shift and rotation of a rigid array


@dataclass(frozen=True, eq=False)
class SurveyUnknowns:
    """
    Columns of the linear system of a survey for a model of the sound speed.

    In this order: three coordinates of each node, shift and rotation of a rigid array, turn-around
    time, clock offset and clock drift of each node, lever arm, curvature of the Earth (0 or 1),
    coefficients of the sound speed. Known values have a prior standard deviation of 0.

    ``earth`` is one of two possible shapes; None if there is one only. ``lever_doubt``
    is the prior standard deviation of errors of the stated horizontal lever arm, which also
    contain the effect of a wrong heading; 0 without doubt. [m]
    """

    survey: Survey
    speed: SoundSpeed
    arrangement: Arrangement = "free"
    earth: Earth | None = None
    lever_doubt: float = 0.0

    @property
    def slices(self) -> dict[str, slice]:
        """Columns of each kind of unknown."""
        k = len(self.survey.nodes)
        sizes = {
            "position": 3 * k,
            "array": 4,
            "turn_around": k,
            "offset": k,
            "drift": k,
            "lever": 3,
            "curvature": 0 if self.earth is None else 1,
            "speed": self.speed.size,
        }
        out = {}
        start = 0
        for name, size in sizes.items():
            out[name] = slice(start, start + size)
            start += size
        return out

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.slices["speed"].stop)

    @property
    def prior_mean(self) -> Array:
        """Prior means of all columns."""
        nodes = self.survey.nodes
        mean = np.zeros(self.size)
        mean[self.slices["position"]] = np.ravel([node.position for node in nodes])
        mean[self.slices["turn_around"]] = [node.turn_around for node in nodes]
        mean[self.slices["lever"]] = self.survey.lever.offset
        mean[self.slices["curvature"]] = float(self.earth == "sphere")
        return mean

    @property
    def prior_sd(self) -> Array:
        """
        Prior standard deviations of all columns.

        Those of smooth sound-speed terms are for hyperparameters of 1.
        """
        nodes = self.survey.nodes
        sd = np.zeros(self.size)
        if self.arrangement == "free":
            sd[self.slices["position"]] = np.ravel([node.sigma for node in nodes])
        else:
            sd[self.slices["array"]] = self.survey.rigid or _ARRAY_SIGMA
        one_way = self.survey.direction != TravelDirection.TWO_WAY
        for k, node in enumerate(nodes):
            has_clock = one_way & ((self.survey.node == k) | (self.survey.partner == k))
            sd[self.slices["turn_around"].start + k] = node.turn_around_sigma
            if has_clock.any():
                sd[self.slices["offset"].start + k] = node.offset_sigma
                sd[self.slices["drift"].start + k] = node.drift_sigma
        sd[self.slices["lever"]] = self.survey.lever.sigma
        if self.lever_doubt > 0.0:
            start = self.slices["lever"].start
            sd[start : start + 2] = self.lever_doubt
        speed = [term.sd for term in self.speed.terms]
        if self.speed.modes is not None:
            speed.append(np.sqrt(self.speed.modes.variance))
        sd[self.slices["speed"]] = np.concatenate([np.empty(0), *speed])
        return sd

    @property
    def groups(self) -> dict[str, NDArray[np.int64]]:
        """Columns whose prior standard deviations a hyperparameter multiplies."""
        out: dict[str, list[int]] = {}
        start = self.slices["speed"].start
        for term in self.speed.terms:
            columns = (start + np.flatnonzero(term.scaled)).tolist()
            if columns:
                out.setdefault(term.group, []).extend(columns)
            start += term.sd.size
        return {name: np.array(members) for name, members in out.items()}

    def scaled_sd(self, hyperparameters: Mapping[str, float]) -> Array:
        """Prior standard deviations for hyperparameters."""
        sd = self.prior_sd
        for name, columns in self.groups.items():
            sd[columns] *= hyperparameters[name]
        return sd

    def positions(self, values: Array) -> Array:
        """Positions of the nodes (n_nodes, 3). [m]"""
        nodes = values[self.slices["position"]].reshape(-1, 3)
        north, east, depth, angle = values[self.slices["array"]]
        centre = nodes.mean(axis=0)
        offset = nodes - centre
        cos = np.cos(angle)
        sin = np.sin(angle)
        rotation = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(centre + offset @ rotation + [north, east, depth])

    def position_map(self, values: Array) -> Array:
        """Derivative of the positions by all columns (n_nodes, 3, size)."""
        k = len(self.survey.nodes)
        out = np.zeros((k, 3, self.size))
        array = self.slices["array"].start
        for axis in range(3):
            out[np.arange(k), axis, 3 * np.arange(k) + axis] = 1.0
            out[:, axis, array + axis] = 1.0
        offset = self.positions(values) - self.positions(values).mean(axis=0)
        out[:, 0, array + 3] = -offset[:, 1]
        out[:, 1, array + 3] = offset[:, 0]
        return out

    def lever(self, values: Array) -> Array:
        """Lever arm forward, starboard, down. [m]"""
        return np.asarray(values[self.slices["lever"]])

    def speed_values(self, values: Array) -> tuple[Array, Array]:
        """Coefficients of the fraction gamma, and amplitudes of modes [m/s]."""
        coefficients = values[self.slices["speed"]]
        n_modes = 0 if self.speed.modes is None else len(self.speed.modes.modes)
        fraction, amplitudes = np.split(coefficients, [coefficients.size - n_modes])
        return fraction, amplitudes

    def slowing(self, values: Array) -> Array:
        """Factor ``exp(-gamma)`` of every ping's travel time in the water."""
        return np.asarray(
            np.exp(-self.speed.fraction(self.speed_values(values)[0], len(self.survey)))
        )

    def water_times(self, values: Array, legs: Legs) -> Array:
        """Travel times in the profile on the Earth of the values; NaN without a ray. [s]"""
        if legs.curvature is None:
            return legs.travel_time
        return np.asarray(legs.travel_time + values[self.slices["curvature"]] * legs.curvature)

    def predict_times(self, values: Array, legs: Legs) -> Array:
        """Predicted times; NaN without a ray. [s]"""
        survey = self.survey
        k = self.survey.node
        answered = (survey.direction == TravelDirection.TWO_WAY) & ~survey.echoes
        clock = self.clock_signs()
        time_since_start = survey.time - survey.time[0]
        time = self.water_times(values, legs) * self.slowing(values)
        time = time + legs.modes @ self.speed_values(values)[1]
        time = time + np.where(answered, values[self.slices["turn_around"]][k], 0.0)
        offset = values[self.slices["offset"]]
        drift = values[self.slices["drift"]]
        for sign, node in clock:
            time = time + sign * (offset[node] + drift[node] * time_since_start)
        return np.asarray(time)

    def clock_signs(self) -> list[tuple[Array, NDArray[np.int64]]]:
        """Sign of the clock of each end in a one-way time (received minus sent), and its node."""
        survey = self.survey
        node_sign = np.zeros(len(survey))
        node_sign[survey.direction == TravelDirection.TO_NODE] = 1.0
        node_sign[survey.direction == TravelDirection.FROM_NODE] = -1.0
        partner_sign = np.where(survey.between_nodes, -node_sign, 0.0)
        return [(node_sign, survey.node), (partner_sign, np.maximum(survey.partner, 0))]
