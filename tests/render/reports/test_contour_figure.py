"""The picture of contour files: what is in it, read back by XML and by matplotlib, and what is refused."""

import re
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from palpate.datasets import ContourFile, HandMotion, static_pose
from palpate.render import Palm, PalpateWarning, StrategyError, draw_figure, load_strategy, record, render
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.reports.contour_figure import contour_figure, shown_rows

TIME = np.arange(91) / 30.0
UPRIGHT = static_pose([0, 0, 0.2]).pose[0, 3:]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """OC and CC of a cube through which a palm sinks for 3 s, sideways; it leaves the cube after 2 s."""
    folder = tmp_path_factory.mktemp("sinks")
    z = np.interp(TIME, [0, 2, 3], [0.24, 0.16, 0.02])
    pose = np.column_stack([0.03 + 0.01 * TIME, 0 * z, z, np.tile(UPRIGHT, (91, 1))]).astype(np.float32)
    motion, cube = HandMotion(TIME, pose), MeshObject.load("cube")
    for name in ("oc", "cc"):
        record(folder / f"{name}.h5", cube, Palm(), motion, load_strategy(name))
    return [folder / "oc.h5", folder / "cc.h5"]


def scenes(figure):
    """Axes of scenes by their titles, then those of further rows."""
    return [axes for axes in figure.axes if any(isinstance(own, LineCollection) for own in axes.collections)]


def texts(figure):
    """Every text of a figure."""
    return [text.get_text() for text in figure.findobj(lambda own: hasattr(own, "get_text")) if text.get_text()]


@pytest.mark.exhaustive
def test_each_file_has_a_row_at_the_times_asked_for_at_one_scale(files):
    figure = contour_figure(files, times=[0.5, 1.5])
    shown = scenes(figure)
    assert len(shown) == 4
    assert [text for text in texts(figure) if text.endswith(" s")] == ["a 0.50 s", "b 1.50 s"]
    sizes = {(round(np.ptp(axes.get_xlim()), 6), round(np.ptp(axes.get_ylim()), 6)) for axes in shown}
    assert len(sizes) == 1  # [mm]
    (wide, tall), box = sizes.pop(), shown[0].get_position()
    inches = np.array(figure.get_size_inches()) * [box.width, box.height]
    assert wide / inches[0] == pytest.approx(tall / inches[1], rel=1e-6)  # millimetres are as long across as up
    assert {"oc", "cc", "object's contour", "hand's boundary inside it", "object"} <= set(texts(figure))


def test_lines_over_time_are_the_files_lengths_and_moments_are_marked(files):
    figure = contour_figure({"first": files[0], "second": files[1]}, times=[1.5])
    (plot,) = [axes for axes in figure.axes if axes.get_title(loc="left") == "length of the contours [mm]"]
    for path, label in zip(files, ("first", "second"), strict=True):
        (line,) = [own for own in plot.lines if own.get_label() == label]
        with ContourFile(path) as file:
            np.testing.assert_allclose(line.get_ydata(), 1e3 * file.metrics()["length"], rtol=1e-6)
            np.testing.assert_allclose(line.get_xdata(), file.motion()["time"])
    marked = [line.get_xdata()[0] for line in plot.lines if str(line.get_label()).startswith("_")]
    np.testing.assert_allclose(marked, [1.5])


def test_the_contours_drawn_are_those_of_the_file_as_seen_by_the_palm(files):
    shown = scenes(contour_figure(files[1:], times=[1.0], view="palm"))[0]
    lines = [own for own in shown.collections if isinstance(own, LineCollection)][-1]
    drawn = np.concatenate([path.vertices for path in lines.get_paths()])
    with ContourFile(files[1]) as file:
        pose, points = file.motion(30, 31)["pose"][0], file.contours(30, 31)["points"]
    frames = Palm().frames(pose[None])
    expected = 1e3 * np.stack([points @ frames.u[0, 0], points @ frames.v[0, 0]], axis=1)
    for place in expected:
        assert np.abs(drawn - place).max(axis=1).min() < 1e-3  # [mm]


@pytest.mark.exhaustive
def test_without_times_moments_are_distinct_and_have_contours(files):
    figure = contour_figure(files)
    titles = [text for text in texts(figure) if re.fullmatch(r"[a-f] [\d.]+ s", text)]
    times = [float(title.split()[1]) for title in titles]
    assert len(titles) == 3
    assert times == sorted(times)
    assert np.diff(times).min() > 0.3
    assert max(times) < 2.6
    assert set(titles) <= set(texts(contour_figure(files)))


@pytest.mark.exhaustive
def test_an_svg_has_text_and_lines_and_is_the_same_each_time(files, tmp_path):
    for name in ("a.svg", "b.svg"):
        draw_figure({"$x$ <&": files[1]}, tmp_path / name, times=[1.0])
    content = (tmp_path / "a.svg").read_text()
    assert content == (tmp_path / "b.svg").read_text()
    found = {
        "".join(text.itertext()).strip()
        for text in ElementTree.fromstring(content).iter()
        if text.tag.endswith("}text")
    }
    assert {"50 mm", "a 1.00 s", "time [s]"} <= found or {"100 mm", "a 1.00 s", "time [s]"} <= found
    assert any("$x$ <&" in text for text in found)
    assert "<image" not in content  # nothing is pixels
    assert len(content) < 500_000


@pytest.mark.exhaustive
def test_a_pdf_embeds_fonts_whose_text_can_be_searched(files, tmp_path):
    draw_figure(files, tmp_path / "a.pdf", times=[1.0])
    content = (tmp_path / "a.pdf").read_bytes()
    assert b"/Type42" not in content
    assert b"/CIDFontType2" in content or b"/TrueType" in content
    assert b"/Subtype /Type3" not in content
    assert len(content) < 300_000


def test_arrays_near_are_drawn_and_others_named(files):
    near = contour_figure(files[1:], times=[1.0], array="pat16")
    assert "pat16, 256 transducers" in texts(near)


@pytest.mark.exhaustive
def test_an_array_that_is_far_from_the_object_does_not_shrink_it(tmp_path):
    far = MeshObject.load("cube", at=(0, 0, 3.0))
    path = render(far, Palm(), static_pose([0.04, 0, 3.0]), "cc").save(tmp_path / "far.h5")
    figure = contour_figure([path])
    assert "emulator: too far away to show" in texts(figure)
    assert np.ptp(figure.axes[0].get_ylim()) < 500  # [mm]


@pytest.mark.exhaustive
def test_a_moment_without_contour_is_warned_of_and_refused_if_it_is_the_only_one(files):
    with pytest.warns(PalpateWarning, match=r"3.00 s: no contour there; the nearest one is at 2\.\d\d s"):
        figure = contour_figure(files[:1], times=[1.0, 3.0])
    assert texts(figure).count("no contour") == 1
    with pytest.raises(StrategyError, match="no contour there"):
        contour_figure(files[:1], times=[3.0])


def test_a_hand_that_never_meets_the_object_is_drawn_as_it_is(tmp_path):
    path = render("cube", Palm(), static_pose([0, 0, 0.6]), "cc").save(tmp_path / "away.h5")
    with pytest.warns(PalpateWarning, match=r"away\.h5 holds no contour"):
        assert "no contour" in texts(contour_figure([path]))
    with (
        pytest.warns(PalpateWarning, match="holds no contour"),
        pytest.raises(StrategyError, match="the hand never meets the object"),
    ):
        contour_figure([path], times=[0])


def test_files_of_nothing_too_many_and_unlike_ones_are_refused(files, tmp_path):
    other = render("tube", Palm(), static_pose([0, 0, 0.2]), "cc").save(tmp_path / "tube.h5")
    with pytest.raises(StrategyError, match="another object"):
        contour_figure([files[0], other])
    with pytest.raises(StrategyError, match="up to 8 files, not 9"):
        contour_figure([files[0]] * 9)
    for nothing in ([], {}, str(files[0])):
        with pytest.raises(StrategyError, match="files must be given"):
            contour_figure(nothing)


def test_of_an_unfinished_file_what_is_done_is_drawn(tmp_path):
    motion = HandMotion(np.arange(4000) / 90, np.tile([0.03, 0, 0.2, *UPRIGHT], (4000, 1)).astype(np.float32))
    path = tmp_path / "part.h5"

    def stop(done, total):
        if 0 < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(path, MeshObject.load("cube"), Palm(), motion, load_strategy("cc"), memory=5_000_000, progress=stop)
    with ContourFile(path) as file:
        reached = file.done[-1][1]
        assert 0 < reached < 4000
    assert len(scenes(contour_figure([path]))) == 1  # a hand that rests
    with pytest.raises(StrategyError, match="is not done yet; palpate render --resume goes on"):
        contour_figure([path], times=[3999 / 90])


def test_long_lines_keep_their_extremes():
    length = np.random.default_rng(2).random(100_000)
    length[70_001] = 5.0
    length[:3000] = np.nan
    rows = shown_rows(length, 1000)
    assert len(rows) <= 1000
    assert 70_001 in rows
    assert (np.diff(rows) > 0).all()
    assert np.nanmin(length[rows]) == np.nanmin(length)
    assert shown_rows(length[:50]).tolist() == list(range(50))


@pytest.mark.exhaustive
def test_nothing_warns(files, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_figure(files, tmp_path / "a.png")
    with pytest.raises(StrategyError, match="exists"):
        draw_figure(files, tmp_path / "a.png")
