"""Pictures of radiation pressure: drawn whole, at one scale, with the width of a focal point, not over another one."""

import numpy as np
import pytest

from palpate.render import StrategyError
from palpate.render.acoustics.sampled_places import sample_plane
from palpate.render.acoustics.skin_print import SkinPrint
from palpate.render.reports.field_figure import draw_fields, fields_figure, print_picture, volume_picture

LINE = [np.array([[0, 0, 0.2], [0.01, 0.01, 0.2]])]


def printed(most, side=0.02, focal_width=0.0101):
    """A print on two patches; most: largest pressure [Pa]; side: of a patch [m]."""
    x, y = np.eye(3)[:2]
    planes = [sample_plane(np.array([m, 0, 0.2]), x, y, (side, 0.03), 5e-3) for m in (0.0, 0.03)]
    skin = SkinPrint(planes, [np.full(plane.shape, most) for plane in planes], 1.0)
    return print_picture(skin, LINE, title="two $patches", focal_width=focal_width)


def volume(most):
    """A volume of one pressure [Pa]."""
    axis = np.linspace(0, 0.05, 4)
    return volume_picture((axis, axis, axis), np.full((4, 4, 4), most), title="a cube", focal_width=0.0143)


def panels(figure):
    """Axes of panels, which are all but the bar of colours."""
    return figure.axes[:-1]


def bars(figure):
    """Lengths of the bars that show focal widths [mm], and labels."""
    lines = [line for axes in panels(figure) for line in axes.lines if line.get_gid() == "focal width"]
    return [float(np.ptp(line.get_xdata())) for line in lines], [t.get_text() for a in panels(figure) for t in a.texts]


def test_two_prints_have_one_scale_of_colour_and_of_space():
    figure = fields_figure([printed(2.0), printed(5.0, side=0.028, focal_width=0.0143)], width="double", font_size=7)
    first, second = panels(figure)
    images = [image for axes in (first, second) for image in axes.collections]
    assert {image.get_clim() for image in images} == {(0.0, 5.0)}
    for one, other in ((first.get_xlim(), second.get_xlim()), (first.get_ylim(), second.get_ylim())):
        assert np.ptp(one) == pytest.approx(np.ptp(other))
    box, (wide, tall) = first.get_window_extent(), (np.ptp(first.get_xlim()), np.ptp(first.get_ylim()))
    assert box.width / wide == pytest.approx(box.height / tall, rel=1e-6)  # millimetres are as long across as up
    assert second.get_window_extent().width == pytest.approx(box.width)
    assert bars(figure) == (pytest.approx([10.1, 10.1, 14.3, 14.3]), ["focal width 10.1 mm", "focal width 14.3 mm"])
    assert figure.axes[-1].get_xlim() == pytest.approx((0.0, 5.0))


def test_a_volume_has_three_sides_and_one_bar_a_file():
    figure = fields_figure([volume(0.0), volume(3.0)], width=None, font_size=None)
    assert len(panels(figure)) == 6
    assert len({axes.get_window_extent().y0.round(3) for axes in panels(figure)}) == 2  # a row for each file
    assert {image.get_clim() for axes in panels(figure) for image in axes.collections} == {(0.0, 3.0)}
    assert bars(figure)[1] == ["focal width 14.3 mm"] * 2


@pytest.mark.parametrize("width", ["single", "ieee-double"])
@pytest.mark.parametrize("shown", [[printed(1.0)], [volume(1.0)], [printed(1.0), printed(2.0)]], ids=range(3))
def test_texts_of_a_field_lie_inside_and_are_as_large_as_asked(width, shown):
    figure = fields_figure(shown, width=width, font_size=9)
    figure.draw_without_rendering()
    texts = [
        *figure.texts,
        *(text for axes in figure.axes for text in (*axes.texts, axes.xaxis.label, axes.yaxis.label)),
    ]
    for text in texts:
        assert text.get_fontsize() >= 9
        box, edge = text.get_window_extent(), figure.bbox
        assert box.x0 >= edge.x0
        assert box.x1 <= edge.x1
        assert box.y0 >= edge.y0
        assert box.y1 <= edge.y1
    boxes = [axes.get_window_extent() for axes in figure.axes]
    assert not any(box.overlaps(text.get_window_extent()) for box in boxes for text in figure.texts)


def test_pictures_are_not_overwritten_unasked(tmp_path):
    draw_fields([printed(1.0)], tmp_path / "print.svg", width=0.1)
    content = (tmp_path / "print.svg").read_text()
    assert "two $patches" in content
    assert f'width="{0.1 / 0.0254 * 72:.3f}'[:12] in content
    with pytest.raises(StrategyError, match="exists"):
        draw_fields([printed(1.0)], tmp_path / "print.svg")
    with pytest.raises(StrategyError, match="must end in one of"):
        draw_fields([printed(1.0)], tmp_path / "print.gif")
