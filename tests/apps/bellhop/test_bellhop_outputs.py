"""
Bellhop's own output files, written by the real programs in water of 1500 m/s, mean what geometry
says.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.bellhop import read_bellhop_arrivals, read_bellhop_rays
from pymantaray.errors import AcousticsError

DATA = Path(__file__).parent / "data"
SPEED = 1500.0
SINGLE = 1e-6  # relative; Bellhop writes single precision
BEAM_SPACING = np.radians([3.0, 15.0])  # of the fans in the data, declination and bearing
BEAM_ERROR = 3e-3  # s; a beam this far off its receiver is early or late by less


def grid(arrivals):
    """
    Source depth, bearing, receiver depth and range of every source and receiver, in the order of
    the counts.
    """
    a = arrivals
    axes = (
        a.source_depth,
        a.source_north,
        a.source_east,
        a.receiver_bearing,
        a.receiver_depth,
        a.receiver_range,
    )
    z, _, _, bearing, receiver_z, r = np.meshgrid(*axes, indexing="ij")
    return z, bearing, receiver_z, r


@pytest.mark.parametrize("name", ["bellhop_fan.arr", "bellhop_fan_binary.arr", "bellhop_plane.arr"])
def test_every_arrival_belongs_to_its_source_and_receiver(name):
    arrivals = read_bellhop_arrivals(DATA / name)
    z, bearing, receiver_z, r = (values.ravel()[arrivals.pair] for values in grid(arrivals))
    # the image of the source in the flat boundaries that the arrival touched, at 0 and 2000 m
    images = {(0, 0): z, (1, 0): -z, (0, 1): 4000.0 - z}
    bounces = list(zip(arrivals.surface_bounces, arrivals.bottom_bounces, strict=True))
    assert set(bounces) <= set(images)
    rise = receiver_z - np.array([images[b][i] for i, b in enumerate(bounces)])
    np.testing.assert_allclose(
        arrivals.travel_time, np.hypot(r, rise) / SPEED, rtol=0, atol=5 * BEAM_ERROR
    )
    slope = np.arctan2(rise, r)
    launch = np.where(arrivals.surface_bounces + arrivals.bottom_bounces > 0, -slope, slope)
    assert np.all(np.abs(arrivals.launch_declination - launch) < 1.01 * BEAM_SPACING[0])
    assert np.all(np.abs(arrivals.arrival_declination - slope) < 1.01 * BEAM_SPACING[0])
    if "plane" in name:
        assert np.isnan(arrivals.launch_azimuth).all()
    else:
        assert np.all(np.abs(arrivals.launch_azimuth - bearing) < 1.01 * BEAM_SPACING[1])
        np.testing.assert_allclose(arrivals.arrival_azimuth, arrivals.launch_azimuth, atol=SINGLE)
    np.testing.assert_allclose(arrivals.phase, np.pi * arrivals.surface_bounces, rtol=SINGLE)
    assert np.all(arrivals.amplitude > 0.0)
    assert np.all(arrivals.travel_time_imaginary == 0.0)
    assert np.array_equal(
        np.bincount(arrivals.pair, minlength=arrivals.count.size), arrivals.count.ravel()
    )


@pytest.mark.parametrize("name", ["bellhop_fan.arr", "bellhop_plane.arr"])
def test_first_direct_arrivals_are_the_straight_lines(name):
    arrivals = read_bellhop_arrivals(DATA / name)
    z, _, receiver_z, r = grid(arrivals)
    straight = np.hypot(r, receiver_z - z) / SPEED
    np.testing.assert_allclose(arrivals.first_direct(), straight, rtol=0, atol=BEAM_ERROR)
    # and no two pairs are so alike that a mixed-up order would pass
    assert np.diff(np.unique(straight)).max() > 10 * BEAM_ERROR
    bounced = replace(arrivals, bottom_bounces=np.ones_like(arrivals.bottom_bounces))
    assert np.isnan(bounced.first_direct()).all()


def test_text_and_binary_say_the_same(as_stored):
    text, binary = (
        read_bellhop_arrivals(DATA / f"bellhop_fan{kind}.arr") for kind in ("", "_binary")
    )
    a, b = text.to_dataset(), binary.to_dataset()
    as_stored(a)
    assert set(a) == set(b)
    for name in a.variables:
        np.testing.assert_allclose(a[name], b[name], rtol=SINGLE, err_msg=str(name))
    assert a["travel_time"].attrs["units"] == "s"
    typed = [500, 800], [500], [-250], np.radians([0, 30]), [400, 900], [1000, 2000, 3000]
    for name, values in zip(a["count"].dims, typed, strict=True):
        np.testing.assert_allclose(a[name], values, rtol=SINGLE)
    assert text.frequency == 10_000.0


@pytest.mark.parametrize(("name", "n_rays"), [("bellhop_fan.ray", 12), ("bellhop_plane.ray", 3)])
def test_rays_are_straight_and_mirrored_at_the_boundaries(name, n_rays, as_stored):
    rays = read_bellhop_rays(DATA / name)
    assert rays.launch_declination.size == n_rays
    as_stored(rays)
    # 3-D files hold this angle in radians, 2-D files in degrees
    assert set(np.degrees(rays.launch_declination).round(6)) == {-30.0, 0.0, 30.0}
    for i in range(n_rays):
        nodes = rays.position[rays.ray == i]
        steps = np.diff(nodes, axis=0)
        length = np.linalg.norm(steps, axis=1)
        steps = steps[length > 1e-6] / length[length > 1e-6, None]
        azimuth = rays.launch_azimuth[i]
        np.testing.assert_allclose(np.arctan2(steps[:, 1], steps[:, 0]), azimuth, rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            np.abs(np.arcsin(steps[:, 2])), abs(rays.launch_declination[i]), rtol=0, atol=1e-6
        )
        turns = np.count_nonzero(np.diff(np.sign(steps[:, 2].round(9))))
        assert turns == rays.surface_bounces[i] + rays.bottom_bounces[i]
        assert (nodes[:, 2].min() == 0.0) == (rays.surface_bounces[i] > 0)
    if "fan" in name:
        assert set(np.degrees(rays.launch_azimuth).round(6)) == {-15.0, 45.0}
        assert {tuple(rays.position[rays.ray == i][0]) for i in range(n_rays)} == {
            (500.0, -250.0, 500.0),
            (500.0, -250.0, 800.0),
        }
    else:
        assert np.all(rays.position[:, 1] == 0.0)
    assert rays.to_dataset()["position"].attrs["units"] == "m"


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("plane.arr", b"'2D'", b"10000.0",
         r"starts with '10000\.0'; it must start with '2D' or '3D'"),
        ("plane.arr", b"0.669983149", b"none", "could not convert string to float: 'none'"),
        ("plane.arr", b"  4\n           2", b"  1\n           2",
         "2 arrivals, but the header announces at most 1"),
        ("plane.arr", b" 1   500.000000", b" 1.5   500.000000",
         r"found 1\.5; a count must be here"),
        ("plane.arr", b"\n", b" 1 2 3\n", "3 numbers follow the last arrival"),
        ("plane.ray", b"'rz'", b"'xy'", "neither 'xyz' nor 'rz'"),
        *((name, None, b"", "the file ends early")
          for name in ("plane.arr", "fan_binary.arr", "fan.ray")),
    ],
)  # fmt: skip
def test_damaged_files_are_refused_in_one_line(tmp_path, name, old, new, message):
    content = (DATA / f"bellhop_{name}").read_bytes()
    if old is None:
        content = content[: len(content) * 2 // 3]
    else:
        before, found, after = content.rpartition(old) if old == b"\n" else content.partition(old)
        assert found
        content = before + new + after
    (tmp_path / name).write_bytes(content)
    read = read_bellhop_rays if name.endswith("ray") else read_bellhop_arrivals
    refused(AcousticsError, message, read, tmp_path / name)
    refused(AcousticsError, "no such file", read, tmp_path / "nothing")


def test_repeat_counts_of_other_compilers_are_read(tmp_path, as_stored):
    plain, packed = DATA / "bellhop_plane.arr", tmp_path / "a.arr"
    text = plain.read_text().replace("-6.00000000      -6.00000000", "2*-6.0")
    packed.write_text(text.replace("               0           0\n", " 2*0\n"))
    assert packed.read_text().count("*") > 1
    found, original = (read_bellhop_arrivals(path).to_dataset() for path in (packed, plain))
    assert found.identical(original)
    as_stored(found)
