"""Arrays of a page, read back by an oracle that shares no code with it."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from page_oracle import array_of

from palpate.render.view.packing import STEP, Packer


def through(store, *arguments):
    packer = Packer()
    described = store(packer, *arguments)
    return array_of(described, zlib.decompress(base64.b64decode(packer.text()))), described


@pytest.mark.parametrize("codec", ["f8", "f4", "u4", "u2", "u1"])
def test_numbers_come_back_as_they_are(codec, rng):
    values = rng.integers(0, 256, (7, 3)) if codec[0] == "u" else rng.normal(size=(7, 3)).astype(codec)
    back, _ = through(Packer.numbers, values, codec)
    assert back.tolist() == values.tolist()


@given(arrays(np.uint16, st.tuples(st.integers(0, 30), st.integers(1, 4))))
def test_whole_numbers_come_back_whatever_their_steps(values):
    back, _ = through(Packer.steps, values, 0.0, 1.0)
    assert back.tolist() == values.tolist()


@pytest.mark.parametrize("extent", [0.0, 1e-6, 0.3, 0.65])
def test_positions_are_rounded_to_a_hundredth_of_a_millimetre(extent, rng):
    values = 5.0 + extent * rng.random((500, 3))
    back, described = through(Packer.positions, values)
    assert described["step"] == STEP == 1e-5
    assert np.abs(back - values).max() <= 0.5e-5 + 1e-12


def test_positions_over_65_cm_apart_take_larger_steps_that_are_described(rng):
    values = np.array([[0.0, 0.0, 0.0], [6.5535, 1.0, 0.5], [3.2, 6.5535, 0.1]])
    back, described = through(Packer.positions, values)
    assert described["step"] == pytest.approx(1e-4, rel=1e-12)
    assert np.abs(back - values).max() <= 0.5e-4 + 1e-9


@pytest.mark.parametrize("count", [1 << 16, (1 << 16) + 1])
def test_indices_are_exact_also_where_16_bits_do_not_hold_them(count):
    values = np.array([[0, count - 1, 7], [count - 1, 0, 1]])
    back, _ = through(Packer.indices, values, count)
    assert back.tolist() == values.tolist()


def test_the_same_content_is_stored_once():
    packer, values = Packer(), np.arange(30.0).reshape(10, 3)
    first, again, other = packer.positions(values), packer.positions(values), packer.positions(values[:5])
    assert first == again
    assert other["at"] == 2 * 30  # bytes of each number are two
