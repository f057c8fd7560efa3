"""`ocean fetch` as a user calls it, against a server on loopback."""

import pytest
import xarray as xr
from typer.testing import CliRunner

from pymantaray.apps.ocean.fetch_command import app
from pymantaray.ocean import validate_ocean

WINDOW = ["--lat", "73,73.4", "--lon", "-150,-149.5"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Call `fetch` with words in an empty folder; gives the result."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(w) for w in words])


@pytest.mark.network
def test_hycom_is_fetched_by_the_command_of_the_documentation(run, thredds, monkeypatch, as_stored):
    monkeypatch.setenv("MANTARAY_OCEAN_SERVERS", thredds.root)
    words = ["hycom", *WINDOW, "--time", "2014-07-15T12", "--out", "ocean.nc", "-v"]
    result = run(*words)
    assert result.exception is None, result.exception
    assert result.stdout == "ocean.nc\n"
    assert "expt_53.X, 2014-07-15T12:00Z: 11 requests" in result.stderr
    with xr.open_dataset("ocean.nc") as ocean:
        validate_ocean(ocean)
        assert dict(ocean.sizes) == {"depth": 40, "lat": 11, "lon": 8}
    assert "already exists" in str(run(*words).exception)
    words[words.index("2014-07-15T12")] = "2014-06-28T18"
    noted = run(*words, "--force", "--nearest", "--servers", thredds.root)
    assert (
        "warning: 2014-06-28T18:00 does not exist: nearest step 2014-06-28T09:00 used"
        in noted.stderr
    )
    quiet = run(*words, "--force", "--nearest", "--quiet")
    assert (quiet.stdout, quiet.stderr) == ("ocean.nc\n", "")
    as_stored(ocean)


@pytest.mark.parametrize("text", ["73", "73,", "a,b", "1,2,3", ""])
def test_a_pair_that_is_none_is_refused(run, text):
    result = run(
        "hycom", "--lat", text, "--lon", "1,2", "--time", "2014-07-15T12", "--out", "ocean.nc"
    )
    assert result.exit_code == 2
    message = " ".join(result.stderr.replace("│", " ").split())
    assert (
        f"Invalid value for '--lat': {text!r}; it must be 2 numbers separated by commas" in message
    )


@pytest.mark.parametrize("command", ["hycom", "copernicus"])
def test_help_names_every_option(run, command):
    result = run(command, "--help")
    assert result.exit_code == 0
    for option in ("--lat", "--lon", "--time", "--out", "--servers", "--force", "--quiet"):
        assert option in result.stdout
