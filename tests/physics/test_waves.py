"""
Rays against waves: impulse responses in a band beside those of a parabolic equation, as
`docs/theory/waves.md` says.
"""

import numpy as np
import pytest

pytest.importorskip("pyram", reason="pyram, the parabolic equation, is not installed")

from waves_beside_rays import (
    LINKS,
    Band,
    Link,
    arctic,
    compare,
    ends,
    fram,
    middle_column,
    parabolic,
    section,
)

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.levels.creeping import creep_along_surface
from pymantaray.records import RayStatus

pytestmark = pytest.mark.slow
NAMES = {link.name: link for link in LINKS}


@pytest.fixture(scope="module")
def beaufort() -> Medium:
    return arctic()


@pytest.fixture(scope="module")
def strait() -> Medium:
    return fram()


def test_the_parabolic_equation_has_the_lloyd_mirror_of_uniform_water() -> None:
    """Source and image below a free surface, in closed form: what the comparison rests on."""
    link = Link("mirror", "", 2000.0, 100.0, 150.0, 600.0)
    depth = np.linspace(0.0, 600.0, 601)
    pressure = parabolic(250.0, link, (depth, np.zeros(1), np.full((601, 1), 1450.0)))
    straight, mirrored = np.hypot(2000.0, 50.0), np.hypot(2000.0, 250.0)
    k = 2.0 * np.pi * 250.0 / 1450.0
    exact = np.exp(1j * k * straight) / straight - np.exp(1j * k * mirrored) / mirrored
    assert abs(pressure / exact - 1.0) < 0.005


def test_two_arrivals_add_up_to_the_waves_phase_and_all(beaufort: Medium) -> None:
    compared = compare(beaufort, NAMES["Beaufort, two arrivals"], Band(250.0, 62.5))
    assert compared.arrivals == 2
    assert compared.misfit < 0.01
    late = compared.time[np.argmax(compared.ray)] - compared.time[np.argmax(compared.wave)]
    assert abs(late) < 0.1 * 0.5 / 62.5


def test_rays_of_a_section_that_varies_add_up_to_its_waves(beaufort: Medium) -> None:
    compared = compare(beaufort, NAMES["Beaufort, section"], Band(250.0, 62.5))
    assert compared.misfit < 0.02


def test_beside_a_caustic_rays_are_too_loud(strait: Medium) -> None:
    """Ray theory without frequency: spreading of -10 dB where waves at 250 Hz have lost 2."""
    compared = compare(strait, NAMES["Fram, beside a caustic"], Band(250.0, 62.5))
    assert 8.0 < 20.0 * np.log10(compared.ray.max() / compared.wave.max()) < 15.0


def test_waves_reach_into_a_shadow_less_with_frequency(strait: Medium) -> None:
    link = NAMES["Fram, shadow 17 m deep"]
    source, receiver = (0.0, 0.0, link.source_depth), (link.distance, 0.0, link.receiver_depth)
    assert find_eigenrays(middle_column(strait), source, receiver).status == RayStatus.SHADOW
    water = section(middle_column(strait), link, 1)
    low, high = (
        abs(parabolic(frequency, link, water)) * link.distance for frequency in (125.0, 500.0)
    )
    assert high < 0.5 * low < 0.5


def test_what_leaks_past_a_caustic_and_along_the_surface_is_the_waves(strait: Medium) -> None:
    """
    Level and time of the leakage model beside the waves' highest peak, as `docs/theory/waves.md`
    has them.
    """
    band = Band(250.0, 62.5)
    for metres, least, most in ((6, -3.0, 3.0), (17, -3.0, 3.0)):
        compared = compare(strait, NAMES[f"Fram, shadow {metres} m deep"], band)
        assert compared.arrivals == 0
        assert compared.leak is not None
        late = compared.leak[1] - compared.time[np.argmax(compared.wave)]
        assert abs(late) < 0.5 * 0.5 / band.width
        assert least < compared.leak[0] - 20.0 * np.log10(compared.wave.max()) < most


def test_sound_creeps_into_the_shadow_of_the_surface_as_waves_do() -> None:
    """
    Water whose sound speed falls by 0.15 m/s a metre, 0.75 km beyond the rays that graze the
    surface.
    """
    water = Medium.from_profile(
        [0.0, 500.0], [1460.0, 1385.0], bottom_depth=500.0, interpolation="linear"
    )
    link = Link("surface", "", 2000.0, 20.0, 20.0, 500.0)
    for frequency in (200.0, 400.0):
        creep = creep_along_surface(water, *ends(link), frequency)
        assert creep is not None
        wave = abs(parabolic(frequency, link, section(water, link, 1))) * link.distance
        assert creep.spreading_db == pytest.approx(-20.0 * np.log10(wave), abs=1.0)
