"""The package's public names: all there, and nothing heavy until one is used."""

import json

import pytest
from factories import python

import pymantaray


def test_every_public_name_can_be_had():
    for name in pymantaray.__all__:
        assert getattr(pymantaray, name) is not None
    assert set(pymantaray.__all__) < set(dir(pymantaray))
    assert pymantaray.__all__ == sorted(pymantaray.__all__)


def test_unknown_names_are_unknown():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = pymantaray.nonsense


LIBRARY = {  # what is done in one process in this order, and what is not imported by then
    "import pymantaray": "numpy xarray numba gtsam",
    "import pymantaray.ocean.fetch": "requests pydap copernicusmarine",
    "from pymantaray.acoustics.levels import absorption, loss, sonar": (
        "xarray scipy pandas numba netCDF4"
    ),
    "from pymantaray.acoustics import currents, selection": "xarray scipy pandas numba netCDF4",
    "from pymantaray.acoustics import Medium; Medium.from_profile([0, 9], [1500, 1490],"
    " bottom_depth=5)": "xarray pandas",
    "import pymantaray.estimation": "gtsam",
    "import pymantaray.apps.study.realization": "xarray pandas pydantic gsw pyproj matplotlib",
    "import pymantaray; pymantaray.open_water('synthetic:beaufort').at_start": "matplotlib gtsam",
    "import pymantaray.apps.study.runner": "matplotlib gtsam",
    "import xarray; from pymantaray.records import write_netcdf;"
    " write_netcdf(xarray.Dataset(), 'x.nc')": "distributed",
}
COMMANDS = {
    "--help": "numpy pymantaray.apps.study.command",
    "study list; study run nosuch; study run broken.toml": "numba gtsam xarray matplotlib scipy",
    "rays times --help": "numba pandas xarray scipy gsw",
}
DO = """
import json, sys
def command(words):
    from pymantaray.cli.main import main
    for one in words.split("; "):
        try:
            main(one.split())
        except SystemExit:
            pass
for what, heavy in json.loads(sys.argv[1]).items():
    (exec if "import" in what else command)(what)
    print("imported:", what, *set(heavy.split()) & set(sys.modules))
"""


@pytest.mark.parametrize("light", [LIBRARY, COMMANDS], ids=["library", "commands"])
def test_nothing_heavy_is_imported_before_it_is_used(tmp_path, light):
    (tmp_path / "broken.toml").write_text("[study")
    done = python(DO, json.dumps(light), cwd=tmp_path)
    told = [line for line in done.stdout.splitlines() if line.startswith("imported: ")]
    assert told == [f"imported: {what}" for what in light], done.stderr
