"""Animated pictures, read back by Pillow: when frames are, how long they last, and what would fit."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from palpate.datasets import HandMotion, static_pose
from palpate.render import Palm, StrategyError, draw_animation, load_strategy, record
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.reports import contour_animation
from palpate.render.reports.contour_animation import FRAMES_MOST, AnimationFrames, frames_of
from palpate.render.reports.shown_moments import MotionMoments

RED = np.array([177, 18, 31])  # an object's contour


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """OC of a cube that a palm enters from above after 1 s of 2."""
    time = np.arange(181) / 90.0
    z = np.interp(time, [0, 1, 2], [0.28, 0.265, 0.18])
    pose = np.column_stack([0.06 + 0 * z, 0 * z, z, np.tile(static_pose([0, 0, 0]).pose[0, 3:], (181, 1))])
    path = tmp_path_factory.mktemp("enters") / "oc.h5"
    record(path, MeshObject.load("cube"), Palm(), HandMotion(time, pose.astype(np.float32)), load_strategy("oc"))
    return path


def moments(duration, rate=90.0):
    count = round(duration * rate) + 1
    pose = np.tile(static_pose([0, 0, 0.2]).pose, (count, 1))
    return MotionMoments(pose, np.arange(count) / rate)


@pytest.mark.exhaustive
def test_a_gif_plays_in_real_time_and_shows_contours_when_there_are_some(file, tmp_path):
    shown = []
    frames = draw_animation(
        [file], tmp_path / "a.gif", width=360, progress=lambda done, total: shown.append((done, total))
    )
    assert frames.rate == 12.5
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == len(frames.poses) == 26
        assert gif.size[0] == 360
        assert gif.info["loop"] == 0
        red, delays = [], []
        for k in range(gif.n_frames):
            gif.seek(k)
            delays.append(gif.info["duration"])
            pixels = np.asarray(gif.convert("RGB")).astype(int)
            scene = pixels[20 : int(0.6 * len(pixels))]  # the legend is red, too
            red.append(int((np.abs(scene - RED).max(axis=2) < 40).sum()))
    assert set(delays) == {80}  # [ms]
    assert shown == [(k + 1, 26) for k in range(26)]
    entered = np.arange(26) * 0.08 > 1.15
    assert max(np.array(red)[np.arange(26) * 0.08 < 1.0]) == 0
    assert min(np.array(red)[entered]) > 10


def test_frames_are_at_even_times_whatever_the_rate_of_the_poses():
    frames = frames_of(moments(10.0, 90.0), 2.0, 5.0, 20.0, "a.h5")
    np.testing.assert_allclose(frames.poses / 90.0, 2.0 + np.arange(len(frames.poses)) / 20.0, atol=1 / 90)
    assert len(frames.poses) == 61
    slow = frames_of(moments(10.0, 2.0), None, None, 10.0, "a.h5")  # a pose is shown until the next one begins
    np.testing.assert_array_equal(slow.poses, np.arange(len(slow.poses)) // 5)


def test_a_long_motion_gets_fewer_frames_a_second_by_itself():
    usual, long = (frames_of(moments(t), None, None, None, "a.h5") for t in (10.0, 100.0))
    assert usual.rate == 12.5
    assert len(long.poses) <= FRAMES_MOST
    assert long.rate == pytest.approx(3.0, rel=0.02)


def test_too_many_frames_are_refused_with_what_fits():
    with pytest.raises(StrategyError, match="0 to 60 s are 3001 frames at 50 Hz") as told:
        frames_of(moments(60.0), None, None, 50.0, "a.h5")
    assert "up to 600: 11.98 s fit, or the whole at 9 Hz" in str(told.value)
    assert len(frames_of(moments(60.0), 0.0, 11.98, 50.0, "a.h5").poses) <= FRAMES_MOST
    assert len(frames_of(moments(60.0), None, None, 9.0, "a.h5").poses) <= FRAMES_MOST


@pytest.mark.parametrize(
    ("start", "stop", "rate", "message"),
    [
        (-1.0, None, None, "time -1 s is outside a.h5, which has times 0 to 10 s"),
        (None, 11.0, None, "time 11 s is outside"),
        (None, float("nan"), None, "outside"),
        (5.0, 5.0, None, "must end after it begins"),
        (None, None, 51.0, "frame rate must lie in 0.5..50 Hz"),
        (None, None, 0.1, "frame rate must lie in"),
    ],
)
def test_ranges_that_cannot_be_shown_are_refused(start, stop, rate, message):
    with pytest.raises(StrategyError, match=message):
        frames_of(moments(10.0), start, stop, rate, "a.h5")


def test_poses_without_times_are_a_frame_each():
    still = MotionMoments(moments(1.0).pose, None)
    frames = frames_of(still, 10, 20, 10.0, "a.h5")
    assert frames.poses.tolist() == list(range(10, 21))
    with pytest.raises(StrategyError, match=r"pose 91 is outside a\.h5, which has poses 0 to 90"):
        frames_of(still, 0, 91, None, "a.h5")


def test_too_many_pixels_are_refused_with_what_fits(file, tmp_path, monkeypatch):
    monkeypatch.setattr(contour_animation, "PIXELS_MOST", 1e6)
    with pytest.raises(StrategyError, match=r"frames fit, or a width of \d+ pixels") as told:
        draw_animation([file], tmp_path / "a.gif", width=720)
    assert not (tmp_path / "a.gif").exists()
    assert "up to 1" in str(told.value)


def test_other_pictures_and_many_files_are_refused(file, tmp_path):
    with pytest.raises(StrategyError, match=r"must end in one of \.gif"):
        draw_animation([file], tmp_path / "a.png")
    with pytest.raises(StrategyError, match="up to 3 files, not 4"):
        draw_animation([file] * 4, tmp_path / "a.gif")
    with pytest.raises(StrategyError, match="width"):
        draw_animation([file], tmp_path / "a.gif", width=10_000)
    (tmp_path / "a.gif").write_bytes(b"kept")
    with pytest.raises(StrategyError, match="exists"):
        draw_animation([file], tmp_path / "a.gif")
    assert (tmp_path / "a.gif").read_bytes() == b"kept"


@pytest.mark.exhaustive
@pytest.mark.parametrize("view", ["palm", "top"])
def test_the_white_around_scenes_is_white_and_two_files_stand_side_by_side(file, tmp_path, view):
    draw_animation({"left": file, "right": file}, tmp_path / "a.gif", start=1.5, stop=1.8, width=400, view=view)
    with Image.open(tmp_path / "a.gif") as gif:
        gif.seek(2)
        pixels = np.asarray(gif.convert("RGB"))
    assert (pixels[-1, -1] == 255).all()
    left, right = np.split(pixels[30:150].min(axis=2) < 200, 2, axis=1)
    assert left.sum() == pytest.approx(right.sum(), rel=0.35)
    assert right.sum() > 500


class Stage:
    """Frames of many greys, with a contour's red in a corner."""

    renderings = SimpleNamespace(lengths=[np.ones(4)])

    def pixels(self, index):
        pixels = np.random.default_rng(index).integers(0, 240, (60, 60, 1)).repeat(3, axis=2).astype(np.uint8)
        pixels[:5, :5] = RED
        return pixels


def test_a_gif_plays_in_real_time_and_has_contours_colours_though_its_own_are_few():
    content = contour_animation._gif(Stage(), AnimationFrames(np.arange(4), 8), None)
    with Image.open(io.BytesIO(content)) as gif:
        assert (gif.n_frames, gif.info["duration"]) == (4, 80)  # [ms]
        gif.seek(2)
        pixels = np.asarray(gif.convert("RGB"))
    assert (pixels[:5, :5] == RED).all()
    assert np.abs(pixels.astype(int) - Stage().pixels(2)).max() < 20


@pytest.mark.exhaustive
def test_contours_keep_their_colours_though_a_gif_has_few(file, tmp_path):
    draw_animation([file], tmp_path / "a.gif", start=1.5, stop=1.7)
    with Image.open(tmp_path / "a.gif") as gif:
        pixels = np.asarray(gif.convert("RGB")).astype(int)
    assert (pixels[20 : int(0.6 * len(pixels))] == RED).all(axis=2).sum() > 50
