"""Counted random numbers: Philox as NumPy has it, in any order, uniform and bell-shaped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.datasets.motions.counter_random import bell, philox, uniform

WORD = st.integers(0, 2**64 - 1)


@given(key=st.tuples(WORD, WORD), counter=st.tuples(st.integers(0, 2**64 - 2), WORD, WORD, WORD))
def test_words_are_those_of_numpys_philox(key, counter):
    """NumPy adds 1 to the first word before it makes a block."""
    other = np.random.Philox(key=np.array(key, np.uint64), counter=np.array(counter, np.uint64)).random_raw(4)
    first, *rest = counter
    np.testing.assert_array_equal(philox(key, np.array([first + 1, *rest], np.uint64)), other)


def test_numbers_do_not_depend_on_what_is_made_with_them():
    together = uniform((3, 4), np.arange(1000), 5)
    assert np.array_equal(together[700], uniform((3, 4), 700, 5))
    assert np.array_equal(together[::-1], uniform((3, 4), np.arange(1000)[::-1], 5))


def test_uniform_numbers_are_uniform_and_bells_have_their_moments():
    values = uniform((1, 2), np.arange(50_000), 3)
    assert 0 <= values.min() < values.max() < 1
    assert values.mean(axis=0) == pytest.approx(np.full(4, 0.5), abs=0.005)
    assert np.abs(np.corrcoef(values.T) - np.eye(4)).max() < 0.02
    own = bell((1, 2), np.arange(50_000), 4)
    assert (abs(own).max(), own.mean(), own.std()) == pytest.approx((2.0, 0.0, 0.97), abs=0.02)
