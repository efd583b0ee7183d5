"""Counting bits against Python's own integers."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from coevo.compiled import entry
from coevo.soccer.bits import ones, sum_of_places, zeros_above, zeros_below


@entry
def count(word):
    """Call from Python what only compiled code can call."""
    return ones(word), zeros_above(word), zeros_below(word), sum_of_places(word)


@given(st.integers(0, 2**64 - 1))
@example(0)
@example(2**64 - 1)
def test_bits_are_counted(word):
    places = [place for place in range(64) if word >> place & 1]
    above, below = (63 - places[-1], places[0]) if places else (64, 64)
    assert count(np.uint64(word)) == (len(places), above, below, sum(places))
