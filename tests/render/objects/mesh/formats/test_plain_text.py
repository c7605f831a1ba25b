"""Line ends of every system, and numbers that are read all or not at all."""

import numpy as np
import pytest

from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.polygons import numbers_of, plain_text


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_lines_end_alike(end):
    assert plain_text(b"\xef\xbb\xbfa" + end + b"b" + end) == b"a\nb\n"


def test_numbers_are_read_as_python_reads_them(rng):
    texts = [repr(float(x)) for x in rng.normal(size=200) * 10.0 ** rng.integers(-300, 300, 200)] + ["+1", "1.", ".5"]
    found = numbers_of([" ".join(texts[:100]).encode(), "\t".join(texts[100:]).encode()])
    assert numbers_of([b"", b" \t"]).tolist() == []
    assert found.tolist() == [float(text) for text in texts]


@pytest.mark.parametrize(
    ("line", "kind", "said"),
    [
        (b"0,5 1 2", np.float64, "'0,5 1 2' must hold numbers with decimal points, not commas"),
        (b"1 2 # three", np.float64, "must hold numbers"),
        (b"1 2.5", np.int64, "must hold whole numbers"),
    ],
)
def test_the_line_that_is_wrong_is_shown(line, kind, said):
    with pytest.raises(MeshError, match=said):
        numbers_of([b"1 2 3", line, b"4"], kind)
