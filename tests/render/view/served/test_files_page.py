"""What the page gets for each request, decoded by an oracle, beside the files."""

import json

import numpy as np
import pytest
from page_oracle import decoded

from palpate.render import ContourFile, HandMotion, exploration, load_rig, render, static_pose
from palpate.render.errors import StrategyError
from palpate.render.view.file_scene import FileScene
from palpate.render.view.served.files_page import PLOTTED_MOST, FilesPage
from palpate.render.view.served.page_server import PageRequest, message_of


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """The same motion at 90 and at 60 poses a second, and a pose without time."""
    folder = tmp_path_factory.mktemp("served")
    made = []
    for name, rate in (("cc", 90.0), ("oc", 60.0)):
        motion = exploration("tube", duration=1.0, rate=rate, seed=1)
        made.append(render("tube", "palm", motion, name).save(folder / f"{name}.h5"))
    return [*made, render("tube", "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "still.h5")]


@pytest.fixture
def page(paths):
    """A page of some of the files, by their numbers."""
    opened = []

    def show(*numbers):
        scenes = [FileScene(paths[number]) for number in numbers]
        opened.extend(scenes)
        return FilesPage(scenes, load_rig("emulator"))

    yield show
    for scene in opened:
        scene.close()


def ask(page, **request):
    sent = []
    page.answer(PageRequest(request), lambda described, packer: sent.append(message_of(described, packer)))
    assert len(sent) == 1
    size = int.from_bytes(sent[0][:4], "little")
    return decoded(json.loads(sent[0][4 : 4 + size]), sent[0][4 + size :])


def test_a_pose_has_the_contours_of_the_file_exactly(page, paths):
    answer = ask(page(0), ask="moment", pose=[54])
    with ContourFile(paths[0]) as file:
        arrays, motion, metrics = file.contours(54, 55), file.motion(54, 55), file.metrics(54, 55)
    (block,) = answer["files"]
    assert answer["poses"] == [54]
    assert answer["time"] == motion["time"][0] == block["poses"]["time"][0]
    assert block["contours"]["points"].tolist() == arrays["points"].tolist()
    assert block["contours"]["kind"].tolist() == arrays["kind"].tolist()
    assert block["poses"]["length"][0] == metrics["length"][0]
    assert block["poses"]["hand_pose"].tolist() == motion["pose"].tolist()


def test_both_files_show_the_same_time(page):
    both = page(0, 1)
    for pose in (0, 45, 89):
        assert ask(both, ask="moment", pose=[pose])["poses"] == [pose, int(pose / 90 * 60 + 1e-9)]
    assert ask(both, ask="moment", time=0.5)["poses"] == [45, 30]
    assert ask(both, ask="moment", time=-5)["poses"] == [0, 0]
    assert ask(both, ask="moment", time=1e9)["poses"] == [89, 59]


def test_the_slider_reaches_the_end_of_the_file_that_lasts_longest(paths, tmp_path):
    longer = render("tube", "palm", exploration("tube", duration=3.0, rate=50.0, seed=1), "cc").save(tmp_path / "l.h5")
    with FileScene(paths[0]) as short, FileScene(longer) as long:
        page = FilesPage([short, long], load_rig("emulator"))
        opened = ask(page, ask="open")["timeline"]
        assert (opened["file"], opened["count"], opened["end"]) == (1, 150, pytest.approx(149 / 50))
        assert ask(page, ask="moment", pose=[149])["poses"] == [89, 149]
        assert ask(page, ask="moment", pose=[25])["poses"] == [45, 25]


def test_beside_a_file_without_times_poses_go_by_their_number(page):
    both = page(0, 2)
    opened = ask(both, ask="open")["timeline"]
    assert (opened["by_pose"], opened["begin"], opened["end"]) == (True, 0, 89)
    assert ask(both, ask="moment", pose=[7])["poses"] == [7, 0]
    assert ask(both, ask="moment", time=7.9)["poses"] == [7, 0]


def test_it_opens_with_names_labels_and_the_longest_pose(page, paths):
    opened = ask(page(0, 1), ask="open")
    with ContourFile(paths[0]) as file:
        length, last = file.metrics()["length"], file.motion()["time"][-1]
    assert [file["name"] for file in opened["files"]] == ["cc.h5", "oc.h5"]
    assert [file["label"] for file in opened["files"]] == ["cc", "oc"]
    assert opened["timeline"] == {
        "file": 0,
        "count": 90,
        "by_pose": False,
        "begin": 0.0,
        "end": last,
        "start": int(length.argmax()),
    }
    assert (opened["done"], opened["is_sealed"]) == ([90, 60], True)
    assert opened["overview"] is None  # plots show all poses


def test_of_more_poses_than_plots_show_those_around_the_moment_are_given(tmp_path):
    poses = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1.0]), (PLOTTED_MOST + 500, 1))
    motion = HandMotion(np.arange(len(poses)) / 1000.0, poses)
    path = render("cube", "palm", motion, "cc").save(tmp_path / "long.h5")
    with FileScene(path) as scene:
        page = FilesPage([scene], load_rig("emulator"))
        (series,) = ask(page, ask="series", poses=[700])["files"]
        (overview,) = ask(page, ask="open")["overview"]
    assert overview["length"].tolist() == pytest.approx([0.34] * 600)
    assert overview["time"][[0, -1]].tolist() == pytest.approx([0.0, 1.497], abs=0.001)
    assert not series["is_whole"]
    assert series["clock"][[0, -1]].tolist() == pytest.approx([0.2, 1.2])


@pytest.mark.parametrize(
    ("request_values", "sentence"),
    [
        ({"ask": "other"}, "ask must be one of open, moment"),
        ({"ask": "moment", "pose": [90]}, r"pose must be one whole number of 0\.\.89, not \[90\]"),
        ({"ask": "pressure", "poses": [1], "where": "off"}, "where must be one of skin, plane"),
    ],
)
def test_absurd_values_are_refused_by_name(page, request_values, sentence):
    with pytest.raises(StrategyError, match=sentence):
        ask(page(0), **request_values)


def test_a_whole_file_has_no_news_but_that_it_is_whole(page):
    assert ask(page(0), ask="news", done=[90])["is_sealed"]
