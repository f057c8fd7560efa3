"""Named streams: the same name gives the same draws, any other name other ones."""

import itertools

import numpy as np
import pytest

from pymantaray.errors import GeometryError
from pymantaray.geometry import stream

NAMES = [
    (),
    ("a",),
    ("a", "b"),
    ("b", "a"),
    ("ab",),
    ("a", "b", ""),
    ("a\x1fb",),
    ("", "a"),
    ('a", "b',),
]


def draws(*arguments, n=2000):
    return stream(*arguments).standard_normal(n)


def test_same_arguments_give_the_same_draws():
    np.testing.assert_array_equal(draws(7, 3, "sensing", "A"), draws(7, 3, "sensing", "A"))


@pytest.mark.parametrize(("one", "two"), list(itertools.combinations(NAMES, 2)))
def test_different_names_give_different_draws(one, two):
    assert not np.any(draws(1, 0, *one, n=50) == draws(1, 0, *two, n=50))


def test_seed_and_realization_are_kept_apart():
    seeds = [(0, 0), (0, 1), (1, 0), (1, 1), (2**32, 0), (1, 2**32), (2**32 + 1, 0), (0, 2**32 + 1)]
    first = [float(draws(*pair, "x", n=1)[0]) for pair in seeds]
    assert len(set(first)) == len(seeds)


def test_streams_are_uncorrelated_and_normal():
    """
    Sample correlations of n pairs have standard deviation 1/sqrt(n); 4.5 of it over 190 pairs.
    """
    n = 20_000
    table = np.stack([draws(5, r, "sensing", name, n=n) for r in range(4) for name in "ABCDE"])
    correlation = np.corrcoef(table)[np.triu_indices(20, 1)]
    assert np.abs(correlation).max() < 4.5 / np.sqrt(n)
    np.testing.assert_allclose(table.mean(axis=1), 0.0, atol=4.5 / np.sqrt(n))
    np.testing.assert_allclose(table.var(axis=1), 1.0, atol=4.5 * np.sqrt(2 / n))


@pytest.mark.parametrize(("seed", "realization"), [(-1, 0), (0, -1)])
def test_negative_seeds_are_refused(seed, realization):
    with pytest.raises(GeometryError, match="neither may be negative"):
        stream(seed, realization, "x")
