"""What is drawn: every segment of the contours once, in the colour of its kind; the array's box."""

import numpy as np
import pytest

pytest.importorskip("viser")

from palpate.render import render, static_pose  # after the skip
from palpate.render.view.live.scene_nodes import contour_segments

COLOURS = {"object": [0xB1, 0x12, 0x1F], "hand": [0x3D, 0x9B, 0xE0]}  # what docs/guide/view.md calls red and blue


def test_segments_have_the_length_and_the_kinds_of_the_contours():
    batch = render("cube", "palm", static_pose([0, 0.06, 0.2]), "cc")
    ends, colours = contour_segments(batch)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert length.sum() == pytest.approx(batch.length()[0], rel=1e-6)
    for kind in ("object", "hand"):
        of_kind = (colours[:, 0] == COLOURS[kind]).all(axis=1)
        assert length[of_kind].sum() == pytest.approx(batch.length(kind)[0], rel=1e-6)
        assert of_kind.any()
