"""Rows that are counted, then written: offsets, memory for all, and a limit checked before memory is allocated."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.contours import Contours
from palpate.kernels.offsets import PointLimitError, count_then_fill, device_of, scan_counts


@wp.kernel
def _count(size: wp.array[wp.int64], count: wp.array[wp.int64]):
    """As many rows as asked."""
    count[wp.tid()] = size[wp.tid()]


@wp.kernel
def _fill(size: wp.array[wp.int64], start: wp.array[wp.int64], step: int, out: wp.array[wp.int64]):
    """Multiples of a step."""
    for k in range(int(size[wp.tid()])):
        out[start[wp.tid()] + wp.int64(k)] = wp.int64(step * k)


@wp.kernel
def _count_or_fill(
    size: wp.array[wp.int64], start: wp.array[wp.int64], count: wp.array[wp.int64], out: wp.array[wp.int64]
):
    """The same with a step of 10 in one kernel."""
    for k in range(int(size[wp.tid()])):
        if start.shape[0] > 0:
            out[start[wp.tid()] + wp.int64(k)] = wp.int64(10 * k)
        else:
            count[wp.tid()] = wp.int64(k + 1)


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("sizes", [[], [0], [2, 0, 3, 1]])
def test_rows_are_written_behind_each_other(sizes, both, device):
    asked, taken = wp.array(sizes, dtype=wp.int64, device=device), []

    def room(total):
        taken.append(total)
        return [wp.empty(total, dtype=wp.int64, device=device)]

    kernels = (_count_or_fill, None) if both else (_count, _fill)
    more = {"blank": [None]} if both else {"more": [10]}
    (out,), (start,) = count_then_fill(*kernels, len(sizes), [asked], room, rows=len(sizes), **more)
    assert start.numpy().tolist() == np.cumsum([0, *sizes]).tolist()
    assert out.numpy().tolist() == [10 * k for size in sizes for k in range(size)]
    assert taken == [sum(sizes)]
    if sum(sizes):
        with pytest.raises(PointLimitError, match=f"{sum(sizes)} points exceed the limit of {sum(sizes) - 1}"):
            count_then_fill(*kernels, len(sizes), [asked], room, rows=len(sizes), limit=sum(sizes) - 1, **more)
        assert len(taken) == 1  # no memory was allocated


def test_the_limit_is_that_of_the_first_counts(device):
    one, many = (wp.array([n, 0], dtype=wp.int64, device=device) for n in (1, 9))
    assert scan_counts(one, many, limit=1)[1] == [1, 9]
    with pytest.raises(PointLimitError):
        scan_counts(many, one, limit=8)


def test_a_device_is_that_of_the_first_array_also_within_a_struct(device):
    contours = Contours()
    contours.kind = wp.zeros(3, dtype=wp.uint8, device=device)
    assert device_of([None, 3, contours]) == wp.get_device(device)
    assert device_of([None, Contours()]) is None
