"""What a viewer shows of a live run: hands look as those of files, and the state follows from the pose's age."""

import numpy as np
import pytest

from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.motions.hand_motion import PALM_DOWN
from palpate.render import MeshHand, Palm, SamplingStrategy, flat_hand, render
from palpate.render.hands.stored_hand import HandLooks
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.drawn_log import LoggedPose
from palpate.render.live.moment import LiveScene, moment_of
from palpate.render.live.moment_slot import DRAWING, RESTING, WAITING, CopiedMoment
from palpate.render.live.renderer_process import LiveRendering
from palpate.render.live.sources.named_sources import live_hand
from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.strategies.intersection_strategy import strategy_of

POSE = np.array([0.01, 0, 0.2, *PALM_DOWN], np.float32)
HOLD, FADE = 0.1, 0.02  # [s]
DUE = 5_000_000_000  # [ns]
TETRAHEDRON = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]], float)
HANDS = {
    "palm": lambda: Palm(width=0.07),
    "rigid planes": flat_hand,
    "planes": lambda: live_hand("planes"),
    "mesh": lambda: MeshHand(
        TETRAHEDRON, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], glabrous=[True, True, True, False]
    ),
}


def rendering(hand=None):
    return LiveRendering(
        solid=solid_of("cube"),
        hand=hand or Palm(),
        strategy=strategy_of("cc"),
        sampling=SamplingStrategy(hold=HOLD, fade=FADE),
        drive=DriveStrategy(),
    )


@pytest.mark.parametrize("name", HANDS)
def test_a_hand_looks_as_that_of_a_file(name, tmp_path):
    hand = HANDS[name]()
    batch = render("cube", hand, POSE[None])
    with ContourFile(batch.save(tmp_path / "own.h5")) as file:
        looks = HandLooks(file)
        look = looks.at(0, POSE)
    scene = LiveScene.of(rendering(hand))
    patch_pose = None if scene.is_rigid else hand.patch_pose[0]
    own = scene.look(POSE, patch_pose)
    np.testing.assert_array_equal(own.patches, look.patches)
    np.testing.assert_array_equal(own.vertices, look.vertices)
    assert own.is_rendered is look.is_rendered is scene.is_skin
    np.testing.assert_array_equal(scene.hand_faces, looks.faces)
    np.testing.assert_array_equal(scene.glabrous, looks.glabrous)
    assert scene.is_rigid is looks.is_rigid
    assert len(own.patches) + len(own.vertices) > 0


def moment(age, *, state=DRAWING, is_lost=False, copied=True):
    """A moment whose pose is so old [s]."""
    focus = FocalPoints(np.ones((2, 3), np.float32), np.ones(2, np.float32))
    batch = render("cube", "palm", POSE[None], "cc").numpy()
    own = CopiedMoment(3, 0, 1.5, DUE, LoggedPose(7, 4, DUE - 1_000_000, POSE, None), batch, 0, focus)
    return moment_of(
        own if copied else None,
        (state, is_lost, DUE),
        LiveScene.of(rendering()),
        hold=HOLD,
        now_ns=DUE + round(age * 1e9),
        number=3,
        latency=None,
        poses=5,
        frames=6,
        dropped=7,
    )


@pytest.mark.parametrize(
    ("age", "is_lost", "state"),
    [
        (-0.004, False, "tracking"),
        (0.049, False, "tracking"),
        (0.051, False, "held"),
        (0.01, True, "held"),
        (HOLD + FADE - 1e-3, False, "held"),
        (HOLD + FADE + 1e-3, False, "faded"),
        (HOLD + FADE + 1e-3, True, "no hand"),
        (60.0, False, "faded"),
    ],
)
def test_the_state_follows_from_the_age_of_the_pose_and_from_what_the_tracker_sees(age, is_lost, state):
    own = moment(age, is_lost=is_lost)
    assert own.state == state
    assert own.time == 1.5
    if state == "no hand":
        assert (own.hand_pose, own.hand, own.pose_number, own.stamp) == (None, None, None, None)
        assert (len(own.contours), own.contours.point_count, len(own.focus.intensity)) == (1, 0, 0)
    else:
        np.testing.assert_array_equal(own.hand_pose, POSE)
        assert own.contours.point_count == 5
        assert len(own.focus.intensity) == 2
        assert (own.pose_number, own.stamp) == (4, pytest.approx(4.999))
        assert own.hand.patches.shape == (1, 4, 3)
        assert own.hand is own.hand  # worked out once
    assert (own.number, own.poses, own.frames, own.dropped) == (3, 5, 6, 7)
    assert "\n" not in repr(own)


def test_before_the_first_pose_there_is_no_hand_and_at_rest_no_moment():
    assert moment(0, state=WAITING, copied=False).state == moment(0, state=WAITING).state == "no hand"
    assert moment(0, state=RESTING) is None
    assert moment(0, copied=False).state == "no hand"  # it is drawn, and nobody has copied it yet
