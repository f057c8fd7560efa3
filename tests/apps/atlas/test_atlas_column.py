"""
Errors of one column: those of a study of the same links, those of closed forms, and what they add
up to.
"""

import copy
from dataclasses import replace

import factories
import numpy as np
import pytest
from oracles import direct_travel_time_linear_gradient
from refusals import refused

from pymantaray.acoustics import Medium
from pymantaray.acoustics.ocean_fields import build_medium
from pymantaray.apps.atlas import AtlasLinks
from pymantaray.apps.atlas.blocks import SPLINE, column_errors, medium_at
from pymantaray.apps.atlas.links import CONVENTIONS
from pymantaray.config import parse_study
from pymantaray.config.door.ocean import build_ocean
from pymantaray.errors import AtlasError
from pymantaray.evaluation.ranging_error import range_errors
from pymantaray.ocean import open_ocean
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.records import RayStatus
from pymantaray.sensing import Landmark

PLACE = 15, 25  # row and column of the ocean


def near(ocean, rows, columns):
    return ocean.isel(
        lat=slice(PLACE[0] - rows, PLACE[0] + rows + 1),
        lon=slice(PLACE[1] - columns, PLACE[1] + columns + 1),
    )


def study_errors(path, place, links):
    """
    Range errors that a study centred at a place of a file has of the same links, and their
    statuses.
    """
    tree = copy.deepcopy(factories.TINY)
    tree["ocean"] = {
        "source": [str(path)],
        "centre_lat": place[0],
        "centre_lon": place[1],
        "half_extent_north": links.half_extent,
        "half_extent_east": links.half_extent,
    }
    config = parse_study(tree)
    medium = build_medium(build_ocean(config.ocean, 0.0), config.acoustics.interpolation)
    transmitter, receiver = links.ends()
    truth = factories.trajectories(np.repeat(transmitter[:, None], 5, axis=1))
    marks = [Landmark(name=f"L{i}", position=place) for i, place in enumerate(receiver)]
    ranging = factories.range_fleet(truth, marks, medium)
    n = len(transmitter)
    own = (ranging.attempts.receiver == n + ranging.attempts.transmitter) & (
        ranging.attempts.sample == 4
    )
    assert own.sum() == n  # of each vehicle to the landmark that ends its link
    rows = np.flatnonzero(own)[np.argsort(ranging.attempts.transmitter[own])]
    errors = range_errors(ranging.truth)
    return np.stack([errors.total, errors.reference_speed, errors.bending])[
        :, rows
    ], ranging.status[rows]


@pytest.mark.parametrize(
    "size", [(1 + SPLINE, 2 + SPLINE), (15, 25)], ids=["its own water", "more water"]
)
def test_a_column_is_a_study_of_the_same_links(ocean, links, tmp_path, size):
    path = tmp_path / "ocean.nc"
    near(ocean, *size).to_netcdf(path)
    water = open_ocean(path)
    place = float(water["lat"][size[0]]), float(water["lon"][size[1]])
    own = column_errors(medium_at(GridPoints.of(water), place, links), links)
    parts = np.stack(
        [own.range_error[0], own.reference_speed_error[0], own.bending_error[0]]
    ).reshape(3, -1)
    study, status = study_errors(path, place, links)
    np.testing.assert_array_equal(own.link_status.ravel(), status)
    if size[0] == 1 + SPLINE:  # 3 km reach beyond one row of 4.5 km and two columns of 1.9 km
        np.testing.assert_array_equal(parts, study)
    else:
        np.testing.assert_allclose(
            parts, study, rtol=0.0, atol=1e-6
        )  # m; what a spline's ends still do


def test_a_column_does_not_depend_on_how_much_of_the_ocean_is_at_hand(ocean, links):
    place = float(ocean["lat"][PLACE[0]]), float(ocean["lon"][PLACE[1]])
    one, other = (
        column_errors(medium_at(GridPoints.of(part), place, links), links)
        for part in (ocean, near(ocean, 12, 14))
    )
    for name in one._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_errors_in_a_linear_gradient_are_those_of_circular_arcs(links):
    c, g = 1480.0, 0.02
    medium = Medium.from_profile(
        [0.0, 1000.0], [c, c + g * 1000.0], bottom_depth=1000.0, interpolation="linear"
    )
    own = column_errors(medium, links)
    a, b = links.ends()
    time = direct_travel_time_linear_gradient(a, b, sound_speed_surface=c, gradient=g)
    distance = np.linalg.norm(b - a, axis=-1)
    at_a, at_b = c + g * a[:, 2], c + g * b[:, 2]
    level = at_a == at_b
    mean_slowness = np.where(
        level, 1.0 / at_a, np.log(at_b / at_a) / np.where(level, 1.0, at_b - at_a)
    )
    speeds = [at_a, at_b, 0.5 * (at_a + at_b), 1.0 / mean_slowness, np.full(a.shape[0], 1500.0)]
    for k, speed in enumerate(speeds):
        expected = np.stack(
            [speed * time, distance * speed * mean_slowness, speed * time]
        ) - np.stack([distance, distance, distance * speed * mean_slowness])
        for values, wanted in zip(
            (own.range_error, own.reference_speed_error, own.bending_error), expected, strict=True
        ):
            np.testing.assert_allclose(
                values[k].ravel(), wanted, rtol=0.0, atol=2e-6, err_msg=CONVENTIONS[k]
            )
    assert (own.bending_error <= 0.0).all()
    assert (own.arrivals_within == 1).all()
    assert not own.no_direct_path.any()


def test_parts_add_up_and_the_chord_has_no_reference_speed_error(ocean, links, as_stored):
    place = float(ocean["lat"][PLACE[0]]), float(ocean["lon"][PLACE[1]])
    own = column_errors(medium_at(GridPoints.of(ocean), place, links), links)
    as_stored(own)
    np.testing.assert_allclose(
        own.range_error, own.reference_speed_error + own.bending_error, rtol=0.0, atol=1e-9
    )
    assert np.nanmax(np.abs(own.reference_speed_error[CONVENTIONS.index("chord")])) < 1e-9
    np.testing.assert_array_equal(own.worst_range_error, np.abs(own.range_error).max(axis=-1))


def test_links_without_a_direct_path_are_counted_separately(as_stored):
    # a duct above 100 m under a gradient that bends all else down: nothing direct comes back up far
    # away
    medium = Medium.from_profile([0.0, 100.0, 500.0], [1500.0, 1480.0, 1400.0], bottom_depth=500.0)
    links = AtlasLinks(pairs=((20.0, 20.0), (20.0, 800.0)), distances=(500.0, 9_000.0), bearings=2)
    own = column_errors(medium, links)
    as_stored(own)
    assert (own.link_status[0, 0] == RayStatus.OK).all()
    assert (own.link_status[0, 1] == RayStatus.SHADOW).all()
    assert (own.link_status[1] == RayStatus.OUTSIDE).all()
    np.testing.assert_array_equal(own.no_direct_path, [[0.0, 1.0], [np.nan, np.nan]])
    assert np.isnan(own.range_error[:, 0, 1]).all()
    assert (own.safe_distance <= 500.0).all()  # nothing is claimed where nothing is heard


def test_safe_distance_ends_where_a_range_errs_by_more():
    # at 1500 m/s a speed of 1497 m/s errs by 2 m in a kilometre
    medium = Medium.from_profile([0.0, 1000.0], [1500.0, 1500.0], bottom_depth=1000.0)
    links = AtlasLinks(
        pairs=((50.0, 50.0),),
        distances=(400.0, 1_000.0, 4_000.0),
        bearings=1,
        nominal_sound_speed=1497.0,
        safe=(0.5, 1.0, 5.0, 20.0),
    )
    own = column_errors(medium, links)
    np.testing.assert_array_equal(own.safe_distance[-1], [0.0, 400.0, 1_000.0, 4_000.0])
    assert (own.safe_distance[0] == 4_000.0).all()


def test_arrivals_are_counted_with_reflections_and_ranged_without(links, as_stored):
    medium = Medium.from_profile([0.0, 1000.0], [1500.0, 1500.0], bottom_depth=1000.0)
    most = replace(links, max_surface_bounces=1, max_bottom_bounces=1)
    alone, all_of_them = column_errors(medium, links), column_errors(medium, most)
    as_stored(all_of_them)
    np.testing.assert_array_equal(alone.range_error, all_of_them.range_error)
    np.testing.assert_array_equal(alone.link_status, all_of_them.link_status)
    # direct and by the surface at once, at 3 km those of the bed, too: spreading alone is under 10
    # dB
    assert (all_of_them.arrivals_within[:, 1] == 5).all(), all_of_them.arrivals_within
    few = column_errors(medium, replace(most, within_db=0.0))
    assert (few.arrivals_within == 1).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pairs": ((20.0, -1.0),)}, "pairs: depth is -1 m; it must be 0 m or more, positive down"),
        ({"pairs": ()}, "pairs: shape"),
        ({"distances": (2e3, 1e3)}, "distances: values do not increase"),
        ({"distances": (0.0, 1e3)}, "distances: 0 m is not positive; all values must be positive"),
        ({"safe": ()}, "safe: shape"),
        ({"bearings": 0}, "bearings is 0; it must be at least 1"),
        (
            {"nominal_sound_speed": 0.0},
            "nominal_sound_speed is 0 m/s; it must be finite and positive",
        ),
        ({"within_db": -1.0}, "within_db is -1 dB"),
    ],
)
def test_links_that_cannot_be_are_refused(changes, message):
    refused(AtlasError, message, AtlasLinks, **changes)
