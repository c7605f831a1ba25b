"""Draw frequencies of poses: by hand, as the sampler counts them, and the same number wherever one is shown."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from page_oracle import decoded

from palpate.datasets.contour_file.reader import ContourFile
from palpate.render import exploration, render, static_pose, summarise
from palpate.render.reports.contour_figure import contour_figure
from palpate.render.sampling.draw_frequency import file_frequencies, pauses_of, pose_frequencies
from palpate.render.sampling.presets import PRESETS, preset
from palpate.render.sampling.sampler import Sampler
from palpate.render.sampling.strategy import Dwell, Gap, SamplingStrategy
from palpate.render.view.file_scene import FileScene
from palpate.render.view.packing import Packer
from palpate.render.view.page.payload import pack_poses
from palpate.render.view.series import window_around


def paused_square():
    """A square of 280 mm around that pauses for 20 ms at each corner; none; and a dot that pauses but has no length."""
    dot = ([[0.1, 0, 0.2], [0.1, 0, 0.2]], False)
    batch = batch_of([[(square(0.07), True)], [], [(square(0.07), True), dot]])
    return replace(batch, dwell=np.full(batch.point_count, 0.02, np.float32))


def test_a_square_of_40_ms_with_four_pauses_of_20_ms_is_drawn_every_120_ms():
    batch = paused_square()
    assert pauses_of(batch) == pytest.approx([0.08, 0.0, 0.08], rel=1e-6)
    assert pose_frequencies(batch) == pytest.approx([1 / 0.12, np.nan, 1 / 0.12], rel=1e-6, nan_ok=True)
    back = SamplingStrategy(dwell=Dwell(time=0.005))  # the strategy's own pauses come where the contours have none
    assert pose_frequencies(replace(batch, dwell=None), back)[0] == pytest.approx(1 / 0.06, rel=1e-6)


def test_an_open_line_there_and_back_takes_twice_its_length():
    batch = batch_of([[([[0, 0, 0.2], [0.07, 0, 0.2]], False)]])
    assert pose_frequencies(batch, SamplingStrategy(gap=Gap(kind="pendulum")))[0] == pytest.approx(50.0)
    assert pose_frequencies(batch, SamplingStrategy(gap=Gap(kind="return", speed=14.0)))[0] == pytest.approx(1 / 0.015)


@pytest.mark.parametrize("paused", [False, True])
@pytest.mark.parametrize("name", [*PRESETS, "finite"])
def test_the_frequency_of_a_pose_is_what_its_sampler_counts(name, paused):
    ring, line = (circle(0.02, count=48), True), ([[0.03, 0, 0.2], [0.03, 0.03, 0.2], [0.05, 0.03, 0.2]], False)
    batch = batch_of([[ring, line]])
    dwell = np.where(np.arange(batch.point_count) % 10 == 0, 0.004, 0.0)
    dwell[48] = dwell[0]  # the seam
    batch = replace(batch, dwell=dwell.astype(np.float32) if paused else None)
    strategy = SamplingStrategy(dwell=Dwell(time=0.003), gap=Gap(kind="close")) if name == "finite" else preset(name)
    sampler = Sampler(strategy)
    sampler.draw(batch[:1], still(1)[0], 30)
    assert pose_frequencies(batch, strategy)[0] == pytest.approx(sampler.count.draw_frequency(strategy.update_rate))


def test_a_palm_of_85_mm_that_pauses_at_its_corners_is_drawn_at_7_8_hz_wherever_it_is_shown(tmp_path):
    """340 mm at 7 m/s and four pauses of 20 ms are 128.6 ms: 1286 samples of 0.1 ms."""
    batch = render("cube", "palm", static_pose([0, 0, 0.2]), "corner-pauses")
    path = batch.save(tmp_path / "paused.h5")
    for facts in (summarise(path), batch.facts()):
        assert facts["draw_frequency"] == facts["draw_frequency_median"] == pytest.approx(10_000 / 1286)
    assert summarise(path)["draw_frequency_of_mean_length"] == pytest.approx(1 / (0.34 / 7 + 0.08), rel=1e-6)
    assert batch.sample("stm", duration=1.0).draw_frequency == pytest.approx(10_000 / 1286)
    with FileScene(path) as scene:
        assert window_around(scene, 0).draw_frequency == pytest.approx([10_000 / 1286])
        block, _ = pack_poses(scene, [0], packer := Packer(exact=True))
        shown = decoded(block["poses"], packer.content())["draw_frequency"]
        assert shown == pytest.approx([10_000 / 1286])


@pytest.mark.exhaustive
def test_an_exploration_with_pauses_has_one_draw_frequency_in_figure_facts_and_what_is_drawn(tmp_path):
    """`corner-pauses` on the tube, against a sum of lengths and of the file's own pauses, polyline by polyline."""
    batch = render("tube", "palm", exploration("tube", duration=4.0, rate=40.0, seed=1), "corner-pauses")
    path = batch.save(tmp_path / "paused.h5")
    points, start = batch.points.astype(float), batch.polyline_start
    expected = np.full(len(batch), np.nan)
    for pose, (a, b) in enumerate(itertools.pairwise(batch.pose_start)):
        seconds = 0.0
        for line in range(a, b):
            own = slice(start[line], start[line + 1])
            seconds += np.linalg.norm(np.diff(points[own], axis=0), axis=1).sum() / 7.0
            seconds += batch.dwell[own][int(batch.polyline_closed[line]) :].sum()
        if seconds:
            expected[pose] = 10_000 / np.ceil(10_000 * seconds - 1e-3)
    drawn = np.isfinite(expected)
    assert expected[drawn].mean() < 0.5 * (7.0 / batch.length()[drawn].astype(float)).mean()
    for facts in (summarise(path), batch.facts()):
        assert facts["draw_frequency"] == pytest.approx(expected[drawn].mean(), rel=1e-6)
        assert facts["draw_frequency_median"] == pytest.approx(np.median(expected[drawn]), rel=1e-6)
    assert batch.sample("stm").draw_frequency == pytest.approx(expected[drawn].mean(), rel=0.01)
    (axes,) = [axes for axes in contour_figure([path], array=None).axes if "frequency" in axes.get_title(loc="left")]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), expected, rtol=1e-6)
    rows, returns = np.flatnonzero(drawn)[::2], preset("fast-return")
    with ContourFile(path) as file:
        np.testing.assert_allclose(file_frequencies(file, rows), expected[rows], rtol=1e-6)
        by_cycles = file_frequencies(file, rows, returns)
    np.testing.assert_allclose(by_cycles, pose_frequencies(batch.numpy(), returns)[rows], rtol=1e-6)
