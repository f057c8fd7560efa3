"""
Direct rays of long links in water with fronts, against `section_fan.SectionFan` in three
dimensions, from both ends.
"""

import numpy as np
import pytest
from lost_rays import (
    GULF_STREAM,
    TIME,
    Look,
    found_rays,
    gulf_stream,
    is_strong,
    lost_rays,
    missing,
    random_links,
    rays_near,
    several_extrema,
)
from section_fan import SectionFan

from pymantaray.acoustics import find_eigenrays
from pymantaray.acoustics._kernels.layout import RESOLVED, Settings
from pymantaray.acoustics.solving import solve_on_processor
from pymantaray.records import RayStatus

UNEVEN = 0.5  # dB; near caustics, levels of fans and of arrivals differ by this
# Medium, source, receiver, half width of the fans [rad], and for each end the launch angle [rad]
# and the number of strong rays of its fan
LINKS = {
    "pair-10.6-km": (
        "gulf",
        [25992.294627925134, -353.9894510816084, 29.40877845206357],
        [31771.837320483246, 8484.59726516544, 16.17829473859785],
        5e-4,
        (0.00918, 2),
        (0.026639, 1),
    ),
    "pair-16.0-km": (
        "gulf",
        [-5449.904026922159, -10938.3048553845, 91.35674907103316],
        [7766.610433266085, -1961.0104919617934, 714.402832664827],
        5e-4,
        (-0.0046, 2),
        (-0.236307, 2),
    ),
    "pair-18.1-km": (
        "gulf",
        [27739.25957582415, 37091.577130574864, 136.72025480766305],
        [13377.669308929115, 48047.588696741994, 564.3731367440163],
        2e-4,
        (-0.004938, 1),
        (-0.1385, 2),
    ),
    "first-arrival-13.2-km": (
        "gulf",
        [20400.714397459764, -18346.378385115764, 87.03015561601399],
        [22825.95458605578, -5350.353862787515, 255.2433591055462],
        5e-5,
        (0.020947, 1),
        (-0.15815, 1),
    ),
    "among-14-17.6-km": (
        2,
        [-26671.236508263377, 34476.98167652465, 165.70425589512942],
        [-16881.57867741653, 19901.944467708476, 125.19015079996366],
        1e-4,
        (-0.02123, 2),
        (-0.031961, 1),
    ),
    "pair-19.6-km": (
        2,
        [31899.741015739102, 9999.064585639917, 227.70004135939055],
        [34014.69708852573, -9521.214446111499, 111.73301855615159],
        2e-4,
        (0.0184, 2),
        (0.02307, 2),
    ),
    "among-6-15.4-km": (
        6,
        [12825.683537687219, 7247.447325910973, 163.10909113734937],
        [11717.111668681897, -8127.9454255268355, 152.56646250627756],
        5e-5,
        (0.027184, 2),
        (0.016985, 1),
    ),
    "among-4-25.4-km": (
        6,
        [-23910.96432846976, -7470.755732656136, 455.54650510426796],
        [-13716.650020940382, -30779.294083872053, 196.88480392956325],
        2e-4,
        (-0.03635, 2),
        (0.011255, 1),
    ),
    "among-18-22.5-km": (
        5,
        [-12996.539980576494, 16679.78268664253, 181.75600892320568],
        [8763.566572005395, 10950.100219900223, 45.466015354178026],
        5e-5,
        (0.053811, 1),
        (-0.004351, 1),
    ),
    "steep-miss-23.4-km": (
        4,
        [24042.985293172395, -13378.090251032513, 481.68404836],
        [12817.496809060002, -33951.84684209, 306.49585982],
        2e-5,
        (-0.01084, 1),
        (0.062762, 1),
    ),
    "other-layer-19.4-km": (
        7,
        [3431.9504454434064, -15202.04225112336, 132.21643246670334],
        [-15984.523955468881, -15630.338352799072, 397.3969642370017],
        2e-4,
        (0.05438643, 1),
        (-0.06137362, 1),
    ),
    "pair-7.6-km": (
        5,
        [1330.86500815, 31036.41182393, 83.55665371],
        [7897.84340705, 27175.67226516, 145.4570526],
        4e-5,
        (0.016421, 1),
        (-0.023483, 2),
    ),
    # between two rays that pass the receiver on one side, and a middle ray that cubics predict
    "pair-7.5-km": (
        "gulf",
        [12699.276820294865, 26038.19777807616, 128.4763505412683],
        [6603.0619295243805, 30473.17883546913, 290.0004529997517],
        5e-5,
        (0.003315, 1),
        (-0.087425, 2),
    ),
}
FAR_PAIR = (
    [4144.207364179347, -6422.1708682477, 179.90831307438054],
    [-5040.537512378474, -32533.825752213874, 214.55801361802384],
)


def medium_of(name):
    if name != "gulf":
        return several_extrema(name)
    if not GULF_STREAM.is_file():
        pytest.skip(f"no Gulf Stream file at {GULF_STREAM}")
    return gulf_stream()


@pytest.mark.slow
@pytest.mark.parametrize(
    "link",
    LINKS,
)
def test_rays_that_fans_find_from_either_end_are_found(link):
    """
    They were lost: horizontal refraction moves launch angles farther than the distance of two rays.
    """
    name, source, receiver, half_width, *views = LINKS[link]
    medium, ends = medium_of(name), (np.array(source), np.array(receiver))
    fan, found = SectionFan(medium), [find_eigenrays(medium, *pair) for pair in (ends, ends[::-1])]
    np.testing.assert_array_equal(found[0].travel_time, found[1].travel_time)
    for (angle, number), pair, arrivals in zip(views, (ends, ends[::-1]), found, strict=True):
        rays = rays_near(fan, *pair, angle, Look(TIME, UNEVEN, half_width, 301))
        assert is_strong(rays).sum() == number
        assert missing(rays, found_rays(arrivals), TIME, UNEVEN) == []


def test_rays_that_turn_in_another_layer_are_found_from_either_end():
    """
    Neighbours of equal slopes pass the receiver 700 m below it and turn 45 m deeper; from this end
    all five rays were lost.
    """
    name, source, receiver, *_ = LINKS["other-layer-19.4-km"]
    for ends in ((source, receiver), (receiver, source)):
        arrivals = find_eigenrays(medium_of(name), *map(np.array, ends), canonical=False)
        assert arrivals.complete.all()
        assert arrivals.travel_time.size == 5


def test_a_far_link_with_arrivals_has_the_rays_of_both_ends():
    """
    The fan of one end meets a curve of rays that the fan of the other end does not meet, and both
    searches seem complete.
    """
    source, receiver = map(np.array, FAR_PAIR)
    medium, both = several_extrema(2), ((source, receiver), (receiver, source))
    one, other = (found_rays(find_eigenrays(medium, *ends, canonical=False)) for ends in both)
    assert len(missing(one, other)) == 1
    found = found_rays(find_eigenrays(medium, source, receiver))
    assert missing(one, found) == missing(other, found) == []


def test_far_links_need_both_ends_if_fronts_focus_their_rays():
    """
    The fan of such a link has rays whose cross-track offset decreases with their cross-track
    slowness; that of the other link, of 23 km and with 12 arrivals, has none.
    """
    medium, settings = several_extrema(2), Settings(15.0, 1e-3, canonical=True, shallower=False)
    even = random_links(medium, 1, [9, 2], 12e3, 30e3)
    ends = (np.array([far, *near]) for far, near in zip(FAR_PAIR, even, strict=True))
    (results,) = solve_on_processor(medium.domain(), None, settings, *ends, threads=1)
    assert (results.counts >= 10).all()
    assert 0.0 < results.info[0, RESOLVED] < 1.0
    assert results.info[1, RESOLVED] == 1.0


@pytest.mark.parametrize(("name", "number"), [(1, 34), (2, 300), (3, 265)])
def test_searches_from_both_ends_are_complete_and_agree(name, number):
    """
    Narrow caustics, places of exit that jump and steep changes of the cross-track slowness do not
    end a search before it is complete.
    """
    medium = several_extrema(name)
    links = random_links(medium, number, [4101, name], 6e3)
    ends = [end[-1:] for end in links]
    one, other = (find_eigenrays(medium, *pair, canonical=False) for pair in (ends, ends[::-1]))
    assert one.complete.all()
    assert other.complete.all()
    assert one.travel_time.size > 3
    assert one.travel_time == pytest.approx(other.travel_time, abs=1e-7)


def test_the_other_end_finds_the_ray_of_a_folded_search():
    source = np.array([15527.339087846281, -6716.33675777106, 129.5028867243823])
    receiver = np.array([3159.9861333226945, 12143.671831188141, 107.65844948445161])
    medium = several_extrema(6)
    one = find_eigenrays(medium, source, receiver, canonical=False)
    assert (one.status == RayStatus.UNRESOLVED).all()
    assert find_eigenrays(medium, source, receiver).travel_time == pytest.approx(
        [15.0026697], abs=2e-7
    )


@pytest.mark.slow
def test_horizontal_refraction_changes_the_width_of_a_ray_tube():
    """
    The level is 15.06 dB; without the change of the cross-track slowness with the launch angle it
    would be 15.7 dB.
    """
    links = random_links(several_extrema(2), 900, [2026, 2])
    ends = links.source[875], links.receiver[875]
    medium = several_extrema(2)
    arrivals = find_eigenrays(medium, *ends[::-1], spreading_cutoff_db=18.0, canonical=False)
    (ray,) = np.flatnonzero(np.abs(arrivals.travel_time - 13.6321425) < 2e-7)
    near = rays_near(
        SectionFan(medium), *ends[::-1], arrivals.launch_angle[ray], Look(TIME, 0.1, 2e-6)
    )
    assert near.spreading == pytest.approx([arrivals.spreading_db[ray]], abs=0.1)


@pytest.mark.parametrize(
    "name",
    [pytest.param("gulf", marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow), 4],
)
def test_levels_from_both_ends_are_equal(name):
    """
    Reciprocity; derivatives in the plane of the link alone gave levels that differed by up to 7 dB.
    """
    medium = medium_of(name)
    links = random_links(medium, 36, 8, shortest=12e3)
    one, other = (
        find_eigenrays(medium, *ends, canonical=False) for ends in (links, links.exchanged())
    )
    times = np.round(one.travel_time, 7)[:, None] == np.round(other.travel_time, 7)
    here, there = np.nonzero(times & (one.link[:, None] == other.link))
    strong = one.spreading_db[here] < 12.0
    assert strong.sum() >= 10
    np.testing.assert_allclose(one.spreading_db[here], other.spreading_db[there], atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gulf", 2, 6])
def test_neither_end_of_random_links_to_30_km_finds_a_lost_ray(name):
    medium = medium_of(name)
    source, receiver = random_links(medium, 100, [4, 99 if name == "gulf" else name])
    arrivals, back = (
        find_eigenrays(medium, *ends) for ends in ((source, receiver), (receiver, source))
    )
    for column in ("status", "travel_time", "complete"):
        np.testing.assert_array_equal(getattr(arrivals, column), getattr(back, column))
    found = found_rays(arrivals)
    for ends in ((source, receiver), (receiver, source)):
        assert lost_rays(found_rays(find_eigenrays(medium, *ends, canonical=False)), found) == []


@pytest.mark.slow
def test_a_link_is_unresolved_exactly_if_its_search_is_incomplete():
    """Some links of each kind beyond 20 km, solved from one end only."""
    medium = several_extrema(6)
    links = random_links(medium, 60, 4, shortest=20e3)
    arrivals = find_eigenrays(medium, *links, canonical=False)
    bare = np.bincount(arrivals.link, minlength=60) == 0
    assert 0 < (bare & ~arrivals.complete).sum() < bare.sum()
    np.testing.assert_array_equal(
        arrivals.status == RayStatus.UNRESOLVED, bare & ~arrivals.complete
    )
    both = find_eigenrays(medium, *links)
    assert (both.complete >= arrivals.complete).all()
    assert both.complete.sum() > arrivals.complete.sum()
