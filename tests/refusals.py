"""What cannot be done is refused in one line; how every test says so."""

import pytest


def refused(error, message, call, *arguments, **options):
    """A call ends in an error of one line in which the pattern is found."""
    with pytest.raises(error, match=message) as caught:
        call(*arguments, **options)
    assert "\n" not in str(caught.value)
