"""Pictures of radiation pressure: drawn whole, and not over another one."""

import numpy as np
import pytest

from palpate.render import StrategyError
from palpate.render.acoustics.sampled_places import sample_plane
from palpate.render.acoustics.skin_print import SkinPrint
from palpate.render.reports.field_figure import draw_print, draw_volume

LINE = [np.array([[0, 0, 0.2], [0.01, 0.01, 0.2]])]


@pytest.mark.exhaustive
def test_a_volume_is_drawn(tmp_path):
    axis = np.linspace(0, 0.01, 4)
    draw_volume((axis, axis, axis), np.zeros((4, 4, 4)), tmp_path / "volume.svg", title="nothing")
    assert (tmp_path / "volume.svg").stat().st_size > 2000


def test_prints_are_drawn_and_not_overwritten_unasked(tmp_path):
    x, y = np.eye(3)[:2]
    planes = [sample_plane(np.array([m, 0, 0.2]), x, y, (0.02, 0.03), 5e-3) for m in (0.0, 0.03)]
    skin = SkinPrint(planes, [np.ones(plane.shape) for plane in planes], 1.0)
    draw_print(skin, LINE, tmp_path / "print.png", title="two $patches")
    assert (tmp_path / "print.png").stat().st_size > 2000
    with pytest.raises(StrategyError, match="exists"):
        draw_print(skin, LINE, tmp_path / "print.png", title="")
    with pytest.raises(StrategyError, match="must end in one of"):
        draw_print(skin, LINE, tmp_path / "print.gif", title="")
