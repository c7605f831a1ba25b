"""DOLPHIN point lists: written ones are read back to the bit, malformed ones refused with their line."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from palpate.datasets.errors import DatasetError
from palpate.datasets.focus_files.ptlist import PointListError, read_ptlist, write_ptlist

rows = hnp.arrays(
    np.float32, st.tuples(st.integers(1, 30), st.just(4)), elements=st.floats(0, 1, width=32, allow_subnormal=False)
)


@pytest.mark.exhaustive
@given(values=rows, sign=st.sampled_from([-1.0, 1.0]), rate=st.floats(1e-3, 1e6))
@settings(max_examples=50, deadline=None)
def test_what_is_written_is_read_back_to_the_bit(tmp_path_factory, values, sign, rate):
    path = tmp_path_factory.mktemp("points") / "a.PTLIST"
    write_ptlist(path, sign * values[:, :3], values[:, 3], rate)
    found = read_ptlist(path)
    assert np.array_equal(found.position, sign * values[:, :3])
    assert np.array_equal(found.intensity, values[:, 3])
    assert (found.update_rate, found.intensity_peak) == (rate, 1.0)
    assert found.position.dtype == found.intensity.dtype == np.float32


def test_file_is_a_header_and_a_row_a_step(tmp_path):
    path = tmp_path / "a.PTLIST"
    write_ptlist(path, [[0.0, 0.01, 0.2], [0.125, 0.0, 0.25]], [1.0, 0.5], 40_000.0)
    assert path.read_text() == "2,40000,1\n0,0.01,0.2,1\n0.125,0,0.25,0.5\n"


@pytest.mark.parametrize(
    "text",
    [
        "2, 40000, 0.5\n0, 0, 0.2, 1\n0.1, 0, 0.2, 0\n",
        "2\n40000\n0.5\n0 0 0.2 1\n0.1 0 0.2 0",
        "2;40000;0.5\r\n\r\n0;0;0.2;1\r\n\r\n0.1;0;0.2;0\r\n",
        "\ufeff2 40000 5e-1\n0\t0\t2e-1\t1\n1e-1\t0\t0.2\t0\n",
    ],
)
def test_separators_blank_lines_and_headers_of_three_lines_are_read(tmp_path, text):
    path = tmp_path / "a.PTLIST"
    path.write_text(text, encoding="utf-8", newline="")
    found = read_ptlist(path)
    assert found.position == pytest.approx(np.array([[0, 0, 0.2], [0.1, 0, 0.2]]))
    assert found.intensity.tolist() == [1.0, 0.0]
    assert (found.update_rate, found.intensity_peak) == (40_000.0, 0.5)


def test_positions_may_be_in_another_unit(tmp_path):
    path = tmp_path / "a.PTLIST"
    write_ptlist(path, [[0.0, 0.01, 0.2]], [1.0], 40_000.0, unit=1e-3)
    assert "0,10,200,1" in path.read_text()
    assert read_ptlist(path, unit=1e-3).position == pytest.approx(np.array([[0, 0.01, 0.2]]))
    with pytest.raises(PointListError, match=r"line 2: z must lie in -10\.\.10 m, not 200"):
        read_ptlist(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the header must be number of steps, sample rate, maximum intensity, not 0 numbers"),
        ("1,40000\n", "not 2 numbers"),
        ("steps,1\n", "line 1: number of steps expected, not 'steps'"),
        (
            "1,40000,1,7\n0,0,0,1\n",
            "line 1: the header must be number of steps, sample rate, maximum intensity, not 4 numbers",
        ),
        ("1.5,40000,1\n0,0,0,1\n", "the number of steps must be whole and at least 1, not 1.5"),
        ("nan,40000,1\n0,0,0,1\n", "the number of steps must be whole and at least 1, not nan"),
        ("inf,40000,1\n0,0,0,1\n", "the number of steps must be whole and at least 1, not inf"),
        ("0,40000,1\n", "the number of steps must be whole and at least 1, not 0"),
        ("1,0,1\n0,0,0,1\n", "the sample rate must be positive, not 0 Hz"),
        ("1,40000,2\n0,0,0,1\n", "the maximum intensity must lie in 0..1, not 2"),
        ("3,40000,1\n0,0,0,1\n", "the header says 3 steps, but there are 1 rows"),
        ("1,40000,1\n", "the header says 1 steps, but there are 0 rows"),
        ("2,40000,1\n0,0,0,1\n\n0,0,0\n", "line 4: 4 numbers (x, y, z, intensity) expected, not '0,0,0'"),
        ("2,40000,1\n0,0,0,1\n0,zero,0,1\n", "line 3: y must be a number, not 'zero'"),
        ("2,40000,1\n\n0,0,0,1\n0,0,nan,1\n", "line 4: z must lie in -10..10 m, not nan"),
        ("2,40000,1\n0,0,0,1\n0,0,0,1.5\n", "line 3: intensity must lie in 0..1, not 1.5"),
        ("1,40000,1\n0,0,0,1 # a\n", "line 2: 4 numbers"),
    ],
)
def test_malformed_lists_are_refused_with_file_line_and_value(tmp_path, text, told):
    path = tmp_path / "bad.PTLIST"
    path.write_text(text)
    with pytest.raises(PointListError) as error:
        read_ptlist(path)
    assert str(error.value).startswith(f"{path}: ")
    assert told in str(error.value)
    assert isinstance(error.value, DatasetError)


def test_files_that_cannot_be_read_or_written_are_told(tmp_path):
    with pytest.raises(PointListError, match="no such point list"):
        read_ptlist(tmp_path / "none.PTLIST")
    (tmp_path / "binary.PTLIST").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PointListError, match="cannot be read"):
        read_ptlist(tmp_path / "binary.PTLIST")
    with pytest.raises(PointListError, match="cannot be written"):
        write_ptlist(tmp_path / "none" / "a.PTLIST", [[0, 0, 0.2]], [1], 1.0)


@pytest.mark.parametrize(
    ("position", "intensity", "rate", "unit", "told"),
    [
        ([[0, 0, 0.2]], [1.5], 1.0, 1.0, "row 0: intensity must lie in 0..1, not 1.5"),
        ([[0, 0, 0.2], [0, np.nan, 0.2]], [1, 1], 1.0, 1.0, "row 1: y must lie in -10..10 m, not nan"),
        ([[[0, 0, 0.2]] * 2], [[1, 1]], 1.0, 1.0, "one focal point at a time"),
        (np.zeros((0, 3)), [], 1.0, 1.0, "must have a row"),
        ([[0, 0, 0.2]], [1], 0.0, 1.0, "sample rate must be positive, not 0.0 Hz"),
        ([[0, 0, 0.2]], [1], 1.0, 0.0, "unit must be a length in metres above 0, at most 1000, not 0.0"),
    ],
)
def test_what_cannot_be_read_back_is_not_written(tmp_path, position, intensity, rate, unit, told):
    with pytest.raises(PointListError) as error:
        write_ptlist(tmp_path / "a.PTLIST", position, intensity, rate, unit=unit)
    assert told in str(error.value)
    assert not list(tmp_path.iterdir())
