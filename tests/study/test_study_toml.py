"""The TOML emitter: whatever it writes, `tomllib` reads back to the same values."""

import datetime as dt
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.study.toml import dumps

SCALARS = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(st.characters(codec="utf-8")),
    st.datetimes(),
)
KEYS = st.text(st.characters(codec="utf-8"), max_size=8)
TREES = st.dictionaries(
    KEYS,
    st.recursive(
        st.one_of(SCALARS, st.lists(SCALARS)),
        lambda inner: st.one_of(
            st.dictionaries(KEYS, inner, max_size=3),
            st.lists(st.dictionaries(KEYS, inner, max_size=3), min_size=1, max_size=3),
        ),
        max_leaves=12,
    ),
)


@settings(derandomize=True, max_examples=150, deadline=None)
@given(TREES)
def test_what_is_written_reads_back(tree):
    assert tomllib.loads(dumps(tree)) == tree


def test_none_is_left_out_and_long_arrays_wrap():
    long = [f"file-{i}-with-a-long-name.nc" for i in range(6)]
    text = dumps({"a": None, "b": {"c": None, "d": long}})
    assert "a" not in tomllib.loads(text)
    assert tomllib.loads(text)["b"] == {"d": long}
    assert max(map(len, text.splitlines())) < 60


def test_what_toml_has_no_form_for_is_refused():
    with pytest.raises(TypeError, match="cannot write date as TOML"):
        dumps({"a": dt.date(2014, 7, 15)})
