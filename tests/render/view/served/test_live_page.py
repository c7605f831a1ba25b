"""The page of a live run, fed by moments that a test makes, and by a run in processes of its own."""

import json
import math

import numpy as np
import pytest
from page_oracle import decoded

from palpate.render import SamplingStrategy, load_rig, render, static_pose
from palpate.render.live.counts import Durations
from palpate.render.live.moment import LiveMoment, LiveScene
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.view.served.live_page import LivePage, path_of
from palpate.render.view.served.page_server import PageRequest, message_of

POSE = np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32)


@pytest.fixture(scope="module")
def scene():
    from palpate.render.hands.hand import Palm
    from palpate.render.objects.mesh.solid_mesh import MeshObject

    cube = MeshObject.load("cube")
    return LiveScene(
        object_name="cube",
        vertices=cube.vertices,
        faces=cube.faces,
        strategy={"raw": "section"},
        sampling=SamplingStrategy(),
        hand=Palm(0.085, 0.085),
        hand_vertices=np.zeros((0, 3), np.float32),
        hand_faces=np.zeros((0, 3), np.int32),
        glabrous=np.zeros(0, bool),
        is_skin=False,
    )


def moment_of(scene, number, **values):
    values = {"state": "tracking", "time": 1.5, "hand_pose": POSE} | values
    counts = {"latency": Durations(math.nan, math.nan, math.nan), "poses": 1, "frames": 100, "dropped": 3}
    return LiveMoment(number=number, scene=scene, **values, **counts)


def ask(page, **request):
    sent = []
    page.answer(PageRequest(request), lambda described, packer: sent.append(message_of(described, packer)))
    size = int.from_bytes(sent[0][:4], "little")
    return decoded(json.loads(sent[0][4 : 4 + size]), sent[0][4 + size :])


def test_a_newer_moment_has_its_contours_and_an_old_one_only_the_state_of_the_run(scene):
    batch = render("cube", "palm", static_pose(POSE[:3]), "cc")
    page = LivePage(lambda: scene, lambda: moment_of(scene, 7, contours=batch), load_rig("emulator"))
    answer = ask(page, ask="now", after=6)
    (block,) = answer["files"]
    assert block["contours"]["points"].tolist() == batch.points.tolist()
    assert block["poses"]["length"][0] == pytest.approx(0.34)
    assert (answer["state"], answer["time"], answer["latency"]) == ("tracking", 1.5, [None, None])
    assert (answer["dropped"], answer["frames"]) == (3, 100)
    assert "files" not in ask(page, ask="now", after=7)


def test_without_a_hand_or_a_run_there_is_nothing_to_draw(scene):
    page = LivePage(lambda: scene, lambda: moment_of(scene, 7, hand_pose=None, state="no hand"), load_rig("emulator"))
    assert ask(page, ask="now", after=-1)["state"] == "no hand"
    assert "files" not in ask(page, ask="now", after=-1)
    resting = LivePage(lambda: scene, lambda: None, load_rig("emulator"))
    assert ask(resting, ask="now", after=-1) == {"kind": "now", "state": "resting"}


def test_another_scene_has_another_number(scene):
    from dataclasses import replace

    shown = [scene]
    page = LivePage(lambda: shown[0], lambda: moment_of(shown[0], 7), load_rig("emulator"))
    first = ask(page, ask="open")
    assert (first["kind"], first["files"][0]["object"]) == ("live", "cube")
    assert ask(page, ask="now", after=0)["scene"] == first["scene"]
    shown[0] = replace(scene, object_name="other")
    assert ask(page, ask="now", after=0)["scene"] != first["scene"]
    assert ask(page, ask="open")["files"][0]["object"] == "other"


def test_of_thinned_focal_points_a_longer_step_is_no_jump(scene):
    """At 40 kHz every third sample is there: 0.5 mm apart at 7 m/s, not 0.175 mm."""
    from dataclasses import replace

    fast = replace(scene, sampling=SamplingStrategy(update_rate=40_000.0))
    x = 0.000525 * np.arange(440)
    focus = FocalPoints(np.stack([x, 0 * x, 0.2 + 0 * x], axis=1).astype(np.float32), np.ones(440, np.float32))
    path = path_of(moment_of(fast, 1, focus=focus))
    assert path.rate == pytest.approx(40_000 / 3)
    assert not path.jump.any()
    assert not path.hop.any()
    assert path_of(moment_of(fast, 1)) is None
