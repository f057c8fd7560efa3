"""
Made-up surveys whose truth is known: closed-form travel times in a linear profile, rotations
written out, made without the package's code.
"""

from dataclasses import dataclass

import numpy as np
import pyproj
from oracles import direct_travel_time_linear_gradient

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import LeverArm, Node, Survey

SURFACE_SPEED, GRADIENT = 1480.0, 0.017


def direct_time(a, b):
    """Travel time of the direct ray between places. [s]"""
    return direct_travel_time_linear_gradient(
        a, b, sound_speed_surface=SURFACE_SPEED, gradient=GRADIENT
    )


def to_world(attitude, vector):
    """
    Body vector (forward, starboard, down) of headings, pitches and rolls in north, east, down,
    written out.
    """
    h, p, r = attitude.T
    f, s, d = vector
    ch, sh, cp, sp, cr, sr = np.cos(h), np.sin(h), np.cos(p), np.sin(p), np.cos(r), np.sin(r)
    return np.column_stack(
        [
            ch * cp * f + (ch * sp * sr - sh * cr) * s + (ch * sp * cr + sh * sr) * d,
            sh * cp * f + (sh * sp * sr + ch * cr) * s + (sh * sp * cr - ch * sr) * d,
            -sp * f + cp * sr * s + cp * cr * d,
        ]
    )


@dataclass
class Campaign:
    """What a ship measured, and the truth behind it."""

    names: list
    prior: np.ndarray  # (k, 3) m
    prior_sigma: np.ndarray  # (k, 3)
    truth: np.ndarray  # (k, 3)
    node: np.ndarray
    time: np.ndarray  # s
    two_way: np.ndarray  # s
    antenna: tuple  # positions (n, 3) at transmission and reception
    attitude: tuple  # (n, 3) rad
    lever: tuple
    gross: np.ndarray


def sailed(time, radius, speed=2.0):
    """
    Place (n, 3) and heading of a ship that sails circles of two radii and a cross over them, 1 m
    waves.
    """
    turn = speed / radius * time
    lap = np.floor(turn / (2.0 * np.pi)).astype(int) % 3
    size = np.choose(lap, [radius, 0.5 * radius, radius])
    angle = np.where(lap == 2, np.pi / 4.0, turn)
    along = np.where(lap == 2, np.cos(turn), 1.0)
    north, east = size * along * np.cos(angle), size * along * np.sin(angle)
    return np.column_stack([north, east, -12.0 + 0.5 * np.sin(2.0 * np.pi * time / 8.0)])


def make_campaign(
    seed,
    *,
    depth=1300.0,
    radius=900.0,
    nodes=3,
    pings=200,
    interval=45.0,
    sigma=1e-4,
    lever=(6.0, -2.5, 20.0),
    lever_sigma=(0.0, 0.0, 0.0),
    turn_around=0.013,
    turn_around_sigma=0.0,
    drift=3e-4,
    gross=0.03,
    prior_sigma=(5.0, 5.0, 5.0),
    truth=None,
):
    """
    Ping each node in turn; the fraction by which the water is faster than the profile is a red sum
    of waves of rms drift.
    """
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * (np.arange(nodes) + 0.2) / nodes
    prior = np.column_stack(
        [500.0 * np.cos(angle), 500.0 * np.sin(angle), depth + 12.0 * np.arange(nodes)]
    )
    drawn = prior + rng.normal(size=prior.shape) * prior_sigma
    truth = drawn if truth is None else truth
    arm = np.asarray(lever) + rng.normal(size=3) * lever_sigma
    delay = turn_around + rng.normal(size=nodes) * turn_around_sigma
    time = np.repeat(interval * np.arange(pings), nodes) + np.tile(1.5 * np.arange(nodes), pings)
    node = np.tile(np.arange(nodes), pings)
    span = time[-1]
    period = span * np.exp(rng.uniform(np.log(0.1), np.log(2.0), 12))
    size = rng.normal(size=12) * period
    size *= np.sqrt(2.0 / np.sum(period**2))
    phase = rng.uniform(0.0, 2.0 * np.pi, 12)

    def fraction(t):
        return drift * np.sum(
            size * np.sin(2.0 * np.pi * np.asarray(t)[..., None] / period + phase), axis=-1
        )

    def attitude_at(t):
        heading = 2.0 / radius * t + np.pi / 2.0
        pitch = np.radians(1.5) * np.sin(2.0 * np.pi * t / 7.0)
        return np.column_stack(
            [heading, pitch, np.radians(2.5) * np.sin(2.0 * np.pi * t / 11.0 + 1.0)]
        )

    def transducer_at(t):
        return sailed(t, radius) + to_world(attitude_at(t), arm)

    both = direct_time(transducer_at(time), truth[node]) * 2.0
    for _ in range(4):  # the reception depends on the time that is measured
        received = time + both + delay[node]
        out = direct_time(transducer_at(time), truth[node]) * np.exp(-fraction(time))
        back = direct_time(transducer_at(received), truth[node]) * np.exp(-fraction(received))
        both = out + back
    received = time + both + delay[node]
    bad = rng.random(time.size) < gross
    measured = both + delay[node] + rng.normal(0.0, sigma, time.size)
    measured[bad] += rng.choice([-1.0, 1.0], bad.sum()) * rng.uniform(0.02, 0.6, bad.sum())
    return Campaign(
        [f"N{k + 1}" for k in range(nodes)],
        prior,
        np.tile(prior_sigma, (nodes, 1)),
        truth,
        node,
        time,
        measured,
        (sailed(time, radius), sailed(received, radius)),
        (attitude_at(time), attitude_at(received)),
        (tuple(map(float, lever)), tuple(map(float, lever_sigma))),
        bad,
    )


def water():
    """The campaign's profile as a medium."""
    depth = np.array([0.0, 3000.0])
    return Medium.from_profile(
        depth, SURFACE_SPEED + GRADIENT * depth, bottom_depth=3000.0, interpolation="linear"
    )


def survey_of(campaign, *, turn_around=0.013, turn_around_sigma=0.0, sigma=None, **changes):
    """A campaign as the solver takes it, with what it knows beforehand."""
    nodes = [
        Node(name, tuple(place), tuple(spread), turn_around, turn_around_sigma)
        for name, place, spread in zip(
            campaign.names, campaign.prior, campaign.prior_sigma, strict=True
        )
    ]
    fields = {
        "nodes": nodes,
        "node": campaign.node,
        "time": campaign.time,
        "travel_time": campaign.two_way,
        "transmit_position": campaign.antenna[0],
        "receive_position": campaign.antenna[1],
        "transmit_attitude": campaign.attitude[0],
        "receive_attitude": campaign.attitude[1],
        "lever": LeverArm(*campaign.lever),
        "sigma": [] if sigma is None else np.full(campaign.time.size, sigma),
    }
    return Survey(**(fields | changes))


def profile_csv(folder, name="cast.csv", head="depth_m,sound_speed", step=250.0):
    """The campaign's profile as a table; its path."""
    depth = np.arange(0.0, 3001.0, step)
    path = folder / name
    path.write_text(
        "\n".join([head, *(f"{z:g},{SURFACE_SPEED + GRADIENT * z:.9f}" for z in depth)]) + "\n"
    )
    return path


SITE = (34.96, 139.26)


def write_garpos(campaign, folder, *, end="\r\n", lever_sigma=(0.0, 0.0, 0.0)):
    """
    A campaign in the files of GARPOS, its ini file in a folder of its own; the ini file's path.
    """
    (folder / "obsdata").mkdir(parents=True, exist_ok=True)
    (folder / "initcfg" / "SITE").mkdir(parents=True, exist_ok=True)
    profile_csv(folder / "obsdata", "SITE-svp.csv", "depth,speed")
    columns = (
        "SET,LN,MT,TT,ResiTT,TakeOff,gamma,flag,ST,ant_e0,ant_n0,ant_u0,head0,pitch0,roll0,"
        "RT,ant_e1,ant_n1,ant_u1,head1,pitch1,roll1"
    )
    rows = ["# made for a test", f",{columns}"]
    for i, time in enumerate(campaign.time):
        ends = []
        for place, attitude in zip(campaign.antenna, campaign.attitude, strict=True):
            north, east, down = place[i]
            angles = np.degrees(attitude[i])
            ends.append(
                f"{east:.5f},{north:.5f},{-down:.5f},"
                f"{angles[0] % 360.0:.6f},{angles[1]:.6f},{angles[2]:.6f}"
            )
        two_way = campaign.two_way[i]
        name = campaign.names[campaign.node[i]]
        rows.append(
            f"{i},S01,L01,{name},{two_way - 0.013:.7f},0.0,0.0,0.0,False,"
            f"{30000.0 + time:.6f},{ends[0]},"
            f"{30000.0 + time + two_way:.6f},{ends[1]}"
        )
        if i % 50 == 49:
            rows.append("")
    (folder / "obsdata" / "SITE-obs.csv").write_bytes((end.join(rows) + end).encode())
    stations = "\n".join(
        f" {name}_dPos = {p[1]:.4f} {p[0]:.4f} {-p[2]:.4f} {s[1]:.4f} {s[0]:.4f} {s[2]:.4f} 0.0"
        " 0.0 0.0"
        for name, p, s in zip(campaign.names, campaign.prior, campaign.prior_sigma, strict=True)
    )
    f, s, d = campaign.lever[0]
    text = f"""[Obs-parameter]
 Site_name   = SITE
 Date(UTC)   = 2019-03-15
 SoundSpeed  = ./obsdata/SITE-svp.csv

[Data-file]
 datacsv     = ./obsdata/SITE-obs.csv
 N_shot      = {campaign.time.size}

[Site-parameter]
 Latitude0   = {SITE[0]}
 Longitude0  = {SITE[1]}
 Height0     = 43.00
 Stations    = {" ".join(campaign.names)}
# Array_cent :   'cntpos_E'  'cntpos_N'  'cntpos_U'
 Center_ENU  = 0.0 0.0 -1300.0

[Model-parameter]
# MT_Pos : 'stapos_E' 'stapos_N' 'stapos_U' 'sigma_E' 'sigma_N' 'sigma_U' 'cov_NU' 'cov_UE' 'cov_EN'
{stations}
 dCentPos    = 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0
 ATDoffset   = {f} {s} {d} {lever_sigma[0]} {lever_sigma[1]} {lever_sigma[2]} 0.0 0.0 0.0
"""
    path = folder / "initcfg" / "SITE" / "SITE-initcfg.ini"
    path.write_bytes(text.replace("\n", end).encode())
    return path


def write_obsrange(
    folder,
    *,
    seed=1,
    deep=2500.0,
    drop=(-5.2, -132.5),
    offset=(140.0, -230.0),
    name="S01",
    hemisphere=None,
):
    """
    Survey text as of Scripps for one node, some events without an answer and two gross errors; path
    and true place.
    """
    rng = np.random.default_rng(seed)
    turn = np.linspace(0.0, 1.8 * np.pi, 60)
    place = np.column_stack([1700.0 * np.cos(turn), 1700.0 * np.sin(turn), np.zeros(60)])
    place[::6, :2] *= 0.3
    truth = np.array([*offset, deep])
    ms = 1e3 * (2.0 * direct_time(place, truth) * (1.0 - 2e-3) + 0.013) + rng.normal(0.0, 0.3, 60)
    ms[[10, 40]] += [480.0, -300.0]
    lon, lat = pyproj.Proj(proj="aeqd", lat_0=drop[0], lon_0=drop[1], ellps="WGS84")(
        place[:, 1], place[:, 0], inverse=True
    )
    lines = [
        "Ranging data taken on:  2018-04-24 05:12:37.553000",
        "Cruise:                 test",
        f"Site:                   {name}",
        "Instrument:             ",
        f"Drop Point (Latitude):  {drop[0]}",
        f"Drop Point (Longitude): {drop[1] if hemisphere is None else hemisphere * drop[1]}",
        f"Depth (meters):         {deep + 40.0:g}",
        "Comment:                ",
        "==================================================",
        "",
    ]
    for i in range(60):
        if i % 9 == 4:
            lines.append("Event skipped - Timeout or Badly formatted data was received")
        clock = f"2018:114:{6 + i // 60:02d}:{i % 60:02d}:30"
        lines.append(
            f" {ms[i]:.0f} msec. Lat: {int(abs(lat[i]))} {abs(lat[i]) % 1.0 * 60.0:.5f}"
            f" {'S' if lat[i] < 0 else 'N'}  Lon: {int(abs(lon[i]))} {abs(lon[i]) % 1.0 * 60.0:.5f}"
            f" {'W' if lon[i] < 0 else 'E'}  Alt: 29.42 Time(UTC): {clock}"
        )
    path = folder / f"{name}.txt"
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode())
    return path, truth


def write_gnatss(campaign, folder, *, geoid=-26.0):
    """
    A campaign in the files of GNATSS, positions those of the transducer; the configuration's path.
    """
    frame = pyproj.Proj(proj="aeqd", lat_0=SITE[0], lon_0=SITE[1], ellps="GRS80")
    to_xyz = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    arm, k = np.array(campaign.lever[0]), len(campaign.names)
    ends = [p + to_world(a, arm) for p, a in zip(campaign.antenna, campaign.attitude, strict=True)]
    positions, ping_rows = [], []
    starts = campaign.time.reshape(-1, k)
    for ping in range(len(starts)):
        for column in range(k):
            i = ping * k + column
            stamp = np.datetime64("2023-06-26T00:00:00", "ns") + np.timedelta64(
                round(1e9 * campaign.time[i]), "ns"
            )
            answers = ["0"] * k
            answers[column] = f"{1e6 * campaign.two_way[i]:.0f}"
            day, clock = str(stamp).split("T")
            ping_rows.append(f"26-JUN-23 {clock[:12]}   " + "   ".join(answers))
            since = (stamp - np.datetime64("2000-01-01T12:00:00", "ns")) / np.timedelta64(1, "s")
            for time, place in ((since, ends[0][i]), (since + campaign.two_way[i], ends[1][i])):
                lon, lat = frame(place[1], place[0], inverse=True)
                xyz = to_xyz.transform(lon, lat, geoid - place[2])
                variances = "1e-6 0 0 0 1e-6 0 0 0 1e-6"
                positions.append(f"{time:.7f} {xyz[0]:.5f} {xyz[1]:.5f} {xyz[2]:.5f} {variances}")
            assert day == "2023-06-26"
    (folder / "pxp_tt").write_text("\n".join(ping_rows) + "\n")
    (folder / "POS_FREED_TRANS_TWTT").write_text("\n".join(positions) + "\n")
    levels = np.arange(0.0, 3001.0, 250.0)
    (folder / "ctd").write_text(
        "".join(f"{-z:.4f} {SURFACE_SPEED + GRADIENT * z:.6f}\n" for z in levels)
    )
    entries = []
    for place in campaign.prior:
        lon, lat = frame(place[1], place[0], inverse=True)
        entries.append(
            f"    - lat: {lat:.9f}\n      lon: {lon:.9f}\n      height: {geoid - place[2]:.4f}\n  "
            "    internal_delay: 0.013"
        )
    path = folder / "config.yaml"
    path.write_text(
        "site_id: TEST\nsolver:\n  transponders:\n"
        + "\n".join(entries)
        + f"\n  geoid_undulation: {geoid}\n  array_center:\n    lat: {SITE[0]}\n    lon:"
        f" {SITE[1]}\n"
        "  travel_times_variance: 1e-10\n  transducer_delay_time: 0.0\n  input_files:\n   "
        " sound_speed:\n      path: ./ctd\n"
        "    travel_times:\n      path: ./pxp_tt\n    gps_solution:\n      path:"
        " ./POS_FREED_TRANS_TWTT\n"
    )
    return path


def write_table(campaign, folder, *, unit="s"):
    """A campaign as our own tables of pings and nodes, in local metres; both paths."""
    size = 1.0 if unit == "s" else 1000.0
    head = (
        f"time,node,two_way_time_{unit},north_m,east_m,depth_m,heading_deg,pitch_deg,roll_deg,north_rx_m,east_rx_m,"
        "depth_rx_m,heading_rx_deg,pitch_rx_deg,roll_rx_deg,use"
    )
    rows = ["# pings of a test", head]
    for i, time in enumerate(campaign.time):
        cells = [
            f"{time:.6f}",
            campaign.names[campaign.node[i]],
            f"{size * campaign.two_way[i]:.7f}",
        ]
        for place, attitude in zip(campaign.antenna, campaign.attitude, strict=True):
            cells += [f"{x:.5f}" for x in place[i]] + [f"{x:.6f}" for x in np.degrees(attitude[i])]
        rows.append(",".join([*cells, "yes"]))
    pings, nodes = folder / "pings.csv", folder / "nodes.csv"
    pings.write_text("\n".join(rows) + "\n")
    lines = ["name,north_m,east_m,depth_m,sigma_horizontal_m,sigma_depth_m,turn_around_ms"]
    lines += [
        f"{name},{p[0]:.4f},{p[1]:.4f},{p[2]:.4f},5,5,13"
        for name, p in zip(campaign.names, campaign.prior, strict=True)
    ]
    nodes.write_text("\n".join(lines) + "\n")
    return pings, nodes
