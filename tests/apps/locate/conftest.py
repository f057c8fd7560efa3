"""Surveys that are located once for several commands."""

import pytest

from pymantaray.apps.locate import locate


@pytest.fixture
def located_once(monkeypatch):
    """Commands that locate a survey have the result of the first of them."""
    results = []

    def first(*arguments, **options):
        if not results:
            results.append(locate(*arguments, **options))
        return results[0]

    monkeypatch.setattr("pymantaray.apps.locate.locate", first)
