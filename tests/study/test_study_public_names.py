"""The package's public names: all there, and nothing heavy until one is used."""

import subprocess
import sys

import pytest

import pymantaray


def test_every_public_name_can_be_had():
    for name in pymantaray.__all__:
        assert getattr(pymantaray, name) is not None
    assert set(pymantaray.__all__) < set(dir(pymantaray))
    assert pymantaray.__all__ == sorted(pymantaray.__all__)


def test_unknown_names_are_unknown():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = pymantaray.nonsense


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, pymantaray; print([m for m in ('numpy', 'xarray', 'numba', 'gtsam') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
