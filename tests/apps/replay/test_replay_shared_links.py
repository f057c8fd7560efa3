"""Links that events share, against links that are solved for each event."""

import numpy as np
from arctic import BOTTOM, DEPTH, cast

from pymantaray import Water
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.replay import Events, replay_events
from pymantaray.apps.replay.draws import draw_groups
from pymantaray.sensing import ReceptionOptions


def test_times_of_shared_links_are_those_of_each_event(as_stored):
    """Both directions of a pair whose ends move by metres."""
    rng = np.random.default_rng(1)
    n = 24
    source = np.array([0.0, 0.0, 30.0]) + rng.normal(0.0, [3.0, 3.0, 0.3], (n, 3))
    receiver = np.array([1500.0, 900.0, 90.0]) + rng.normal(0.0, [3.0, 3.0, 0.3], (n, 3))
    back = np.arange(n) % 2 == 1
    source, receiver = (
        np.where(back[:, None], receiver, source),
        np.where(back[:, None], source, receiver),
    )
    medium = Medium.from_profile(DEPTH, cast(), bottom_depth=BOTTOM, ice_draft=1.5)
    events = Events(
        time=60.0 * np.arange(n),
        source=np.where(back, "B", "A"),
        receiver=np.where(back, "A", "B"),
        source_position=source,
        receiver_position=receiver,
        travel_time=np.full(n, 1.2),
        geographic=False,
    )
    water = Water(medium, reception=ReceptionOptions(15.0, 2), uniform=True)
    replay = replay_events(events, water, "persist")
    rays = find_eigenrays(medium, source, receiver, 2)
    late = []
    for row in replay.candidates.itertuples():
        own = (rays.link == row.event) & (rays.surface_bounces == row.surface_bounces)
        if own.any():
            late.append(np.abs(rays.travel_time[own] - row.travel_time_s).min())
    assert len(late) > 0.9 * len(replay.candidates)
    assert np.quantile(late, 0.9) < 5e-6
    distance = np.linalg.norm(receiver - source, axis=1)
    np.testing.assert_allclose(replay.events["distance_m"], distance)
    as_stored([replay.events, replay.candidates])


def test_every_draw_is_left_out_once_beside_its_mirror_image(as_stored):
    everything, *without = draw_groups(16)
    left_out = [np.setdiff1d(everything, members) for members in without]
    assert [pair.tolist() for pair in left_out] == [[2 * k, 2 * k + 1] for k in range(8)]
    everything, *without = draw_groups(35)
    left_out = [np.setdiff1d(everything, members) for members in without]
    np.testing.assert_array_equal(np.sort(np.concatenate(left_out)), everything)
    assert all(np.isin(group // 2 * 2, group).all() for group in left_out)
    assert len(draw_groups(1)) == len(draw_groups(7)) == 1
    as_stored(draw_groups(16))
