"""Travel times of a survey's pings and their derivatives by all positions, from exact eigenrays."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pymantaray.acoustics import Medium, find_eigenrays, trace_paths, travel_time_sensitivity
from pymantaray.apps.locate.earth import in_plane, water_ends
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.arrays import Array
from pymantaray.ocean.modes import VerticalModes
from pymantaray.records import Arrivals, RayStatus

_BOUNDARY_MARGIN = 1e-3  # m; minimum distance of ends from the boundaries of the water


@dataclass(frozen=True, eq=False)
class Legs:
    """
    Travel time in the water of each ping, summed over its legs, and derivatives by the positions.

    ``out`` and ``back`` (n,) are the fractions of the two legs in the time; 0 for a leg that a
    one-way time does not have.
    """

    travel_time: Array
    """Travel time without turn-around time and clock; NaN without a ray. [s]"""
    node_gradient: Array
    """Derivative by the position of the node, (n, 3). [s/m]"""
    transmit_gradient: Array
    """
    Derivative by the platform's position at transmission, (n, 3); zeros for pings between nodes.
    [s/m]
    """
    receive_gradient: Array
    """Derivative by the platform's position at reception, (n, 3). [s/m]"""
    partner_gradient: Array
    """
    Derivative by the position of the other node, (n, 3); zeros for pings of the platform. [s/m]
    """
    status: NDArray[np.int64]
    """`RayStatus` of the worse leg."""
    modes: Array
    """Derivative by the amplitudes of sound-speed modes (n, n_modes). [s per m/s]"""
    curvature: Array | None = None
    """Travel time on a sphere minus this one (n,), if the shape of the Earth is unknown. [s]"""

    @property
    def possible(self) -> NDArray[np.bool_]:
        """True for pings with a ray, (n,)."""
        return np.isfinite(self.travel_time)


def transducers(survey: Survey, lever: Array) -> tuple[Array, Array]:
    """
    Positions (n, 3) of the transducer at transmission and reception. [m]

    The lever arm is forward, starboard, down.
    """
    at_transmission, at_reception = _rotations(survey)
    return (
        survey.transmit_position + at_transmission.apply(lever),
        survey.receive_position + at_reception.apply(lever),
    )


def lever_gradients(survey: Survey, legs: Legs) -> Array:
    """Derivative of the travel times by the lever arm (n, 3). [s/m]"""
    at_transmission, at_reception = _rotations(survey)
    return np.asarray(
        at_transmission.apply(legs.transmit_gradient, inverse=True)
        + at_reception.apply(legs.receive_gradient, inverse=True)
    )


def _rotations(survey: Survey) -> tuple[Rotation, Rotation]:
    """Rotations from body (forward, starboard, down) to north, east, down at both instants."""
    return (
        Rotation.from_euler("ZYX", survey.transmit_attitude),
        Rotation.from_euler("ZYX", survey.receive_attitude),
    )


def with_curvature(legs: Legs, on_sphere: Legs) -> Legs:
    """Travel times on a plane with their change on a sphere."""
    return replace(
        legs,
        travel_time=np.where(on_sphere.possible, legs.travel_time, np.nan),
        status=np.maximum(legs.status, on_sphere.status),
        curvature=on_sphere.travel_time - legs.travel_time,
    )


def extrapolate(survey: Survey, legs: Legs, nodes: Array, lever: Array) -> Legs:
    """
    Travel times after small changes of nodes (n_nodes, 3) and lever arm [m], to first order.

    For a change d at range r, the error is about d² / 2r divided by the sound speed: 0.2 us for 0.3
    m at 200 m.
    """
    by_node = np.sum(legs.node_gradient * nodes[survey.node], axis=1)
    by_partner = np.sum(legs.partner_gradient * nodes[np.maximum(survey.partner, 0)], axis=1)
    by_lever = lever_gradients(survey, legs) @ lever if np.any(lever) else 0.0
    return replace(legs, travel_time=legs.travel_time + by_node + by_partner + by_lever)


def predict(
    survey: Survey,
    medium: Medium,
    position: Array,
    lever: Array,
    modes: VerticalModes | None = None,
) -> Legs:
    """
    Travel times for nodes at positions (n_nodes, 3) [m] and a lever arm [m].

    One call of the eigenray solver finds all rays.
    """
    n = len(survey)
    transmit_position, receive_position = transducers(survey, lever)
    between_nodes = survey.between_nodes
    partner = position[np.maximum(survey.partner, 0)]
    start = np.where(between_nodes[:, None], partner, transmit_position)
    end = np.where(between_nodes[:, None], partner, receive_position)
    # a leg out starts at the platform at transmission, a leg back at the platform at reception;
    # both end at the node, because travel times are reciprocal
    two_way = survey.direction == TravelDirection.TWO_WAY
    direction = survey.direction
    has_out = direction != TravelDirection.FROM_NODE
    has_back = (direction != TravelDirection.TO_NODE) & ~(between_nodes & two_way)
    out = np.flatnonzero(has_out)
    back = np.flatnonzero(has_back)
    node = position[survey.node]
    ends = np.concatenate([start[out], end[back]]), np.concatenate([node[out], node[back]])
    first_end, second_end = (_clip(end, medium) for end in water_ends(survey, medium, *ends))
    echoes = survey.echoes[np.concatenate([out, back])]
    first_end[echoes] = second_end[echoes]
    first_end[echoes, 2] = 0.0
    first_end = _clip(first_end, medium)  # the surface, or the underside of ice
    arrivals = find_eigenrays(medium, first_end, second_end)
    first = arrivals.first()
    rows = np.concatenate([out, back])
    # both legs between two nodes at rest are one ray
    weight = np.where((between_nodes & two_way)[rows], 2.0, 1.0)
    time = np.zeros(n)
    np.add.at(time, rows, weight * first.travel_time)
    gradients = np.zeros((4, n, 3))
    node_gradient, transmit_gradient, receive_gradient, partner_gradient = gradients
    by_other, by_node = (
        weight[:, None] * in_plane(survey, medium, end, slowness)
        for end, slowness in zip(
            ends, (-first.source_slowness, first.receiver_slowness), strict=True
        )
    )
    at_transmission, at_reception = np.split(by_other, [out.size])
    np.add.at(node_gradient, rows, by_node)
    transmit_gradient[out] = np.where(between_nodes[out, None], 0.0, at_transmission)
    receive_gradient[back] = np.where(between_nodes[back, None], 0.0, at_reception)
    is_pair = between_nodes & ~survey.echoes  # an echo's point of reflection is above the node
    np.add.at(partner_gradient, rows, np.where(is_pair[rows, None], by_other, 0.0))
    status = np.zeros(n, dtype=np.int64)
    np.maximum.at(status, rows, first.status.astype(np.int64))
    impossible = status != RayStatus.OK
    time[impossible] = np.nan
    gradients[:, impossible] = 0.0
    by_modes = np.zeros((n, 0 if modes is None else len(modes.modes)))
    if modes is not None:
        by_amplitude = _sensitivity(medium, (first_end, second_end), arrivals, modes)
        np.add.at(by_modes, rows, weight[:, None] * by_amplitude)
    return Legs(
        travel_time=time,
        node_gradient=node_gradient,
        transmit_gradient=transmit_gradient,
        receive_gradient=receive_gradient,
        partner_gradient=partner_gradient,
        status=status,
        modes=by_modes,
    )


def _sensitivity(
    medium: Medium, ends: tuple[Array, Array], arrivals: Arrivals, modes: VerticalModes
) -> Array:
    """Derivative of each link's first travel time by the modes' amplitudes; 0 without one."""
    links, rows = np.unique(arrivals.link, return_index=True)
    out = np.zeros((len(ends[0]), len(modes.modes)))
    if links.size:
        paths = trace_paths(medium, *ends, arrivals)
        all_rows = travel_time_sensitivity(paths, lambda position: modes.at(position[:, 2]).T)
        out[links] = all_rows[rows]
    return out


def _clip(position: Array, medium: Medium) -> Array:
    """Clip the depths of positions to the water, as the solver requires."""
    out = np.array(position)
    top = medium.surface_depth(out)
    bed = medium.bottom_depth(out)
    out[:, 2] = np.clip(
        out[:, 2],
        top + _BOUNDARY_MARGIN,
        np.maximum(bed - _BOUNDARY_MARGIN, top + _BOUNDARY_MARGIN),
    )
    return out
