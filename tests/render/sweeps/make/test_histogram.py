"""Quantiles from histograms are NumPy's within their error; merging in any order gives the same."""

import json

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.kernels.metrics.tally import count_bins
from palpate.render.sweeps.make.histogram import BINS, BITS, HIGHEST, LOWEST, describe, merge, quantiles

ERROR = 2.0 ** -(BITS + 1)
PERCENTS = (1, 5, 25, 50, 75, 95, 99)
LENGTHS = st.lists(st.floats(0.0, 80.0, width=32), min_size=1, max_size=60)


def counted(values):
    """Bins of values, by the kernel."""
    span = [wp.array([own], dtype=wp.int64, device="cpu") for own in (0, len(values))]
    start = wp.array([0, 1], dtype=wp.int64, device="cpu")
    value = wp.array(np.asarray(values, np.float32), device="cpu")
    return count_bins(value, *span, start, lowest=LOWEST, highest=HIGHEST, bits=BITS).numpy()[0]


def assert_close(got, want, greatest):
    """Within half a bin; 0 is exact, below and above the range it is in the bin there."""
    if want == 0.0 or want >= 2.0**HIGHEST:
        assert got == (greatest if want else 0.0)
    else:
        assert got == pytest.approx(want, rel=ERROR, abs=2.0 ** (LOWEST - 1))


@settings(max_examples=25)
@given(values=LENGTHS)
def test_a_quantile_is_that_of_the_sorted_values(values):
    count = merge([json.loads(json.dumps(*describe(counted(values)[None])))])
    assert count.sum() == len(values)
    ordered = np.sort(values)
    got = quantiles(count, PERCENTS, ordered[0], ordered[-1])
    for value, percent in zip(got, PERCENTS, strict=True):
        assert_close(value, ordered[max(0, -(-percent * len(values) // 100) - 1)], ordered[-1])


def test_many_lengths_have_numpys_quantiles(rng):
    values = np.concatenate([rng.gamma(3.0, 0.08, 90_001), np.zeros(30_000)]).astype(np.float32)
    got = quantiles(counted(values), PERCENTS, 0.0, values.max())
    want = np.quantile(values, np.array(PERCENTS) / 100, method="inverted_cdf")
    assert want[0] == got[0] == 0.0
    np.testing.assert_allclose(got, want, rtol=ERROR)
    assert max(abs(a / b - 1) for a, b in zip(got[3:], want[3:], strict=True)) > 1e-5  # the error is real


@settings(max_examples=25)
@given(values=LENGTHS, order=st.permutations(range(4)))
def test_parts_merge_in_any_order(values, order):
    parts = describe(np.stack([counted(part) for part in np.array_split(values, 4)]))
    np.testing.assert_array_equal(merge(parts[k] for k in order), counted(values))


def test_equal_lengths_are_exact_and_none_have_no_quantile():
    assert quantiles(counted([0.3] * 9), PERCENTS, 0.3, 0.3) == [0.3] * len(PERCENTS)
    assert quantiles(np.zeros(BINS, int), (50,), 0.0, 0.0) == [None]
    empty = [0, 0, 0, 0, 0, 0]
    listed = [empty, [2, 0, 0, 5, 1, 0], empty, empty, [0, 0, 0, 0, 0, 7], [1, 0, 0, 0, 0, 0], empty]
    assert describe(np.array(listed)) == [[], [2, -2, 5, 1], [], [], [-5, 7], [1], []]
    assert describe(np.zeros((0, BINS), int)) == []
