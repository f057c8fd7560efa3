"""What acoustics cannot do is refused in one line that names the value and what is allowed."""

import numpy as np
import pytest
import xarray as xr
from factories import DUCT, DUCT_DEPTH as Z, make_arrivals
from refusals import refused

from pymantaray.acoustics import (
    Absorption,
    BoundarySurface,
    Currents,
    FluidBottom,
    GrainSizeBottom,
    IceCover,
    Medium,
    SeaSurface,
    Sonar,
    WenzNoise,
    find_eigenrays,
    link_loss_db,
    select,
    smooth_profile,
    thin_profile,
)
from pymantaray.apps.bellhop import BellhopOptions, HalfSpace
from pymantaray.errors import AcousticsError

LINK = (Medium.from_profile(Z, DUCT, bottom_depth=3500.0), [0.0, 0.0, 10.0], [1e3, 0.0, 10.0])
BED = {"bottom_depth": 1000.0}
ARRIVALS = make_arrivals([0, 0, 0])
AXIS = np.linspace(-10e3, 10e3, 5)


def links(source=LINK[1], receiver=LINK[2], **options):
    return find_eigenrays(LINK[0], source, receiver, **options)


def profile(speed, depth=Z[:3], **options):
    return Medium.from_profile(depth, speed, **BED | options)


def current(velocity=((((0.0, 0.0),),),), **axes):
    axes = {"north": np.zeros(1), "east": np.zeros(1), "depth": np.zeros(1)} | axes
    return Currents(**axes, velocity=np.array(velocity))


def short_bed():
    """A bed on axes of its own that do not reach over the water."""
    own, c = np.linspace(-9e3, 9e3, 3), np.full((5, 5, 2), 1500.0)
    bed = BoundarySurface(np.full((3, 3), 2e3), own, own)
    return Medium.from_grid(AXIS, AXIS, [0.0, 4e3], c, bathymetry=bed)


def salty(depth=(0.0,), temperature=(5.0,), salinity=(35.0,), **options):
    return Absorption.from_profile(depth, temperature, salinity, **options)


NOWHERE = xr.Dataset(coords={"north": [0.0], "east": [0.0], "depth": [0.0, 1.0]})
REFUSED = {
    "depth: values do not increase after 10; they must strictly increase": (
        lambda: profile([1500.0] * 3, [0.0, 10.0, 10.0])
    ),
    "depth: 1 level; a medium needs at least 2": lambda: profile([1500.0], [0.0]),
    r"1\.5 to 1\.5 m/s; it must be 1000 to 2500 m/s in sea water; check the units": (
        lambda: profile([1.5] * 3)
    ),
    "1 of 3 values are not finite; fill or remove them": lambda: profile([1500.0, 1500.0, np.nan]),
    r"shape is \(1, 1, 2\); it must be \(1, 1, 3\)": lambda: profile([1500.0] * 2),
    "a profile has one dimension": lambda: profile([[1500.0] * 3]),
    "'cubic'; allowed are 'smooth' and 'linear'": (
        lambda: profile([1500.0] * 3, interpolation="cubic")
    ),
    "ice_draft: -1 m; it must be 0 m or more": lambda: profile([1500.0] * 3, ice_draft=-1.0),
    "lacks sound_speed, sea_floor_depth": lambda: Medium.from_dataset(NOWHERE),
    r"bathymetry: north -9000 to 9000 m; it must extend over the water, -10000 to 10000 m": (
        short_bed
    ),
    "max_surface_bounces is -1; it must be a whole number from 0 to 15": (
        lambda: links(max_surface_bounces=-1)
    ),
    r"max_bottom_bounces is 1\.5; it must be a whole number": lambda: links(max_bottom_bounces=1.5),
    r"source has shape \(2, 3\), receiver \(1, 3\)": lambda: links([LINK[1]] * 2),
    r"source has shape \(1, 2\); it must be \(n_links, 3\)": lambda: links([0.0, 0.0]),
    "receiver: 1 coordinates are not finite": lambda: links(receiver=[np.nan, 0.0, 10.0]),
    "tolerance is 0": lambda: links(tolerance=0.0),
    "lacks water_temp, salinity; use the": lambda: Absorption.from_dataset(NOWHERE),
    "'urick'; allowed: francois-": lambda: salty(formula="urick"),
    r"temperature: shape is \(1,\); it must be \(2,\)": (
        lambda: salty([0.0, 1.0], [5.0], [35.0, 35.0])
    ),
    "depth: values do not increase after 0; they must strictly increase": (
        lambda: salty([0.0, 0.0], [5.0, 5.0], [35.0, 35.0])
    ),
    "salinity is -2; it must be finite and zero or positive": lambda: salty(salinity=[-2.0]),
    "absorption is -1 dB/km; it must be finite and zero or positive": (
        lambda: Absorption.constant(-1.0)
    ),
    r"shape is \(1, 1, 2, 2\); it must be \(1, 1, 1, 2\)": lambda: current(np.zeros((1, 1, 2, 2))),
    "velocity: 2 of 2 values are not finite": lambda: current(np.full((1, 1, 1, 2), np.nan)),
    "2 components .* above 10 m/s": lambda: current(np.full((1, 1, 1, 2), 20.0)),
    "currents: depth: values do not increase": lambda: current(depth=np.ones(2)),
    "lacks current_north, current_east": lambda: Currents.from_dataset(NOWHERE),
    "FluidBottom: density is -1; it must be finite and positive": lambda: FluidBottom(1600.0, -1.0),
    "density is 1.8 kg/m3; sediments have at least 500; multiply a density in g/cm3 by 1000": (
        lambda: FluidBottom(1600.0, 1.8)
    ),
    "attenuation_db_per_wavelength is nan dB; it must be": (
        lambda: FluidBottom(1600.0, 1800.0, np.nan)
    ),
    "'mud' is unknown; allowed: clay, silt": lambda: FluidBottom.standard("mud"),
    "grain_size is 9.5 phi; the model is for -1 to 9": lambda: GrainSizeBottom(9.5),
    "wind_speed is -3 m/s": lambda: SeaSurface(-3.0),
    "IceCover: db_per_bounce is -1 dB": lambda: IceCover(-1.0),
    "'eckart'; allowed: 'bubbles' and 'coherent'": lambda: SeaSurface(3.0, "eckart"),
    "depth: values do not increase after 2; they must strictly increase": (
        lambda: thin_profile([0.0, 2.0, 1.0], [1500.0] * 3)
    ),
    "not finite; fill or remove them": lambda: thin_profile([0.0, 1.0], [1500.0, np.nan]),
    "at least 2": lambda: thin_profile([0.0], [1500.0]),
    "tolerance is 0 m/s; it must be finite and positive": (
        lambda: thin_profile([0.0, 1.0], [1500.0] * 2, tolerance=0.0)
    ),
    "allows 21 m, its widest gap, to 49.5": (
        lambda: smooth_profile(np.r_[0:50, 70:100], np.full(80, 1500.0))
    ),
    "arrival rule 'loudest'; allowed are direct, first, strongest, direct-or-first": (
        lambda: select(ARRIVALS, "loudest")
    ),
    r"loss_db: shape \(1,\); 3 arrivals need one value each": (
        lambda: select(ARRIVALS, "strongest", loss_db=[1.0])
    ),
    r"delay: shape \(3, 1\); 3 arrivals": lambda: select(ARRIVALS, "first", delay=np.zeros((3, 1))),
    "wind_speed is -1 m/s": lambda: WenzNoise(wind_speed=-1.0),
    r"shipping is 1\.5; it must be from 0 to 1": lambda: WenzNoise(shipping=1.5),
    "frequency_hz is 0 Hz; it must be finite and positive": (
        lambda: WenzNoise().level_db([10.0, 0.0])
    ),
    "band of 20 Hz about 10 Hz": lambda: WenzNoise().band_level_db(10.0, 20.0),
    "source_level_db is inf; it must be finite": lambda: Sonar(np.inf, 25e3, 5e3),
    "Sonar: noise is nan": lambda: Sonar(185.0, 25e3, 5e3, np.nan),
    "spread_db is -1 dB; it must be finite and zero or positive": (
        lambda: Sonar(185.0, 25e3, 5e3, spread_db=-1.0)
    ),
    "band of 60000 Hz about 25000 Hz": lambda: Sonar(185.0, 25e3, 60e3),
    r"loss_db has shape \(2,\), link \(1,\)": lambda: link_loss_db([1.0, 2.0], [0], 1),
    "link: 0 to 3; must lie in 0 to 2": lambda: link_loss_db([1.0, 2.0], [0, 3], 3),
    "'rms'; allowed are 'strongest' and 'sum'": lambda: link_loss_db([1.0], [0], 1, combine="rms"),
    "sound_speed is -1": lambda: HalfSpace(sound_speed=-1.0, density_g_per_cm3=1.0),
    "beams 1, cone": lambda: BellhopOptions(beams=1),
    "beams 1000000000, cone": lambda: BellhopOptions(beams=10**9),
    "cone 4 rad": lambda: BellhopOptions(cone=4.0),
    "run: .tl.; allowed": lambda: BellhopOptions(run="tl"),
    "bottom: .mud.; allowed": lambda: BellhopOptions(bottom="mud"),
    "frequency 0.0 Hz": lambda: BellhopOptions(frequency=0.0),
    "step -1 m": lambda: BellhopOptions(step=-1),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_is_refused(message):
    refused(AcousticsError, message, REFUSED[message])
