"""The package's public names: all there, and nothing heavy until one is used."""

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


COMMANDS = """
from pymantaray.cli.main import main
for command in {!r}.split("; "):
    try:
        main(command.split())
    except SystemExit:
        pass
"""
LIGHT = {  # what is done, and what is not imported for it
    "import pymantaray": "numpy xarray numba gtsam",
    "import pymantaray.estimation": "gtsam",
    "import pymantaray.ocean.fetch": "requests pydap copernicusmarine",
    "from pymantaray.acoustics.levels import absorption, loss, sonar": (
        "xarray scipy pandas numba netCDF4"
    ),
    "from pymantaray.acoustics import currents, selection": "xarray scipy pandas numba netCDF4",
    "from pymantaray.acoustics import Medium; Medium.from_profile([0, 9], [1500, 1490],"
    " bottom_depth=5)": "xarray pandas",
    "import pymantaray.apps.study.realization": "xarray pandas pydantic gsw pyproj matplotlib",
    "rays times --help": "numba pandas xarray scipy gsw",
    "study list; study run nosuch; study run broken.toml": "numba gtsam xarray matplotlib scipy",
}  # fmt: skip


@pytest.mark.parametrize("what", LIGHT)
def test_nothing_heavy_is_imported_before_it_is_used(tmp_path, what):
    (tmp_path / "broken.toml").write_text("[study")
    code = what if "import" in what else COMMANDS.format(what)
    code += f"\nimport sys\nprint('imported:', *set({LIGHT[what].split()}) & set(sys.modules))"
    done = python(code, cwd=tmp_path)
    assert done.stdout.splitlines()[-1] == "imported:", done.stderr
