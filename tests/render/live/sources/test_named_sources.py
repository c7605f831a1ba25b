"""Sources by the texts of the command line."""

import sys

import numpy as np
import pytest

from palpate.datasets import Y_UP, load_recording, write_sample
from palpate.datasets.errors import RecordingError
from palpate.datasets.recordings.sample import sample_recording
from palpate.render import HandPatch, MeshObject, Palm, PlaneHand, exploration, flat_hand
from palpate.render.errors import StrategyError, UntrustedCodeError
from palpate.render.intersection.named_inputs import own_skin
from palpate.render.live.sources.named_sources import live_hand, patch_layout, settings_and_hand, source_of
from palpate.render.live.sources.replay import ReplaySource
from palpate.render.live.sources.udp import UdpSource
from palpate.render.live.sources.ultraleap import UltraleapSource

CUBE = MeshObject.load("cube")


def test_an_exploration_is_the_object_s_own_again_and_again():
    chosen = source_of("Exploration", CUBE)
    assert np.array_equal(chosen.source.pose, exploration("cube").pose)
    assert chosen.source.loops
    assert chosen.is_aligned


def test_a_motion_and_a_recording_are_files(tmp_path):
    motion = exploration("cube", duration=0.5).save(tmp_path / "motion.csv")
    chosen = source_of(str(motion), CUBE)
    assert isinstance(chosen.source, ReplaySource)
    assert chosen.recording is None
    recording = write_sample("openxr", tmp_path / "hand.json")
    chosen = source_of(str(recording), CUBE, alignment=Y_UP, side="right")
    assert np.array_equal(chosen.source.pose, load_recording(recording, alignment=Y_UP).skin_pose())
    with pytest.raises(RecordingError, match="no hand 'left'"):
        source_of(str(recording), CUBE, side="left")
    with pytest.raises(StrategyError, match="--alignment is of a tracker, which exploration is not"):
        source_of("exploration", CUBE, alignment="y-up")


def test_trackers_have_names_and_addresses():
    assert source_of("udp", CUBE).source == UdpSource()
    assert source_of("udp:6001", CUBE).source == UdpSource(port=6001)
    assert source_of("UDP:0.0.0.0:6001", CUBE).source == UdpSource("0.0.0.0", 6001)
    assert source_of("ultraleap", CUBE).source == UltraleapSource()
    assert source_of("ultraleap:ws://h:1/v7.json", CUBE).source == UltraleapSource("ws://h:1/v7.json")


def test_a_module_of_the_users_own_runs_with_permission_alone(monkeypatch):
    monkeypatch.delitem(sys.modules, "live_senders", raising=False)  # one that is imported has run already
    with pytest.raises(UntrustedCodeError, match="this would run code: live_senders"):
        source_of("live_senders:two_palms", CUBE)
    assert len(source_of("live_senders:two_palms", CUBE, allow_code=True).source.seen) == 2


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("explorations", r"is no source of poses \(did you mean 'exploration'\?\): give exploration, a mot"),
        ("palm", "is no source of poses"),
        ("hand.mp4", "is no motion"),
        ("live_senders:nothing", "live_senders has no function or class nothing"),
        ("live_senders:DOWN", "live_senders has no function or class DOWN"),
        ("live_senders:no_source", r"no_source\(\) gave 3, which is no PoseSource"),
        ("no_module_like_this:x", "the module cannot be imported"),
    ],
)
def test_a_text_that_names_no_source_is_refused(text, reason):
    with pytest.raises(StrategyError, match=reason):
        source_of(text, CUBE, allow_code=True)


def test_settings_and_hand_fit_each_other(tmp_path):
    settings, hand = settings_and_hand("udp", "planes", CUBE, side="left", alignment="y-up", realtime=True)
    assert settings.patches.names == tuple(patch.name for patch in hand.patches)
    assert (settings.side, settings.alignment, settings.realtime) == ("left", "y-up", True)
    settings, hand = settings_and_hand(UdpSource(), "palm", CUBE)
    assert settings.patches is None
    recording = str(write_sample("openxr", tmp_path / "hand.json"))
    settings, hand = settings_and_hand(recording, "planes", CUBE, alignment=Y_UP, side="right")
    assert (settings.side, settings.alignment) == ("any", None)
    assert isinstance(hand, PlaneHand)
    assert hand.patches != live_hand("planes").patches


@pytest.mark.parametrize("side", ["left", "right"])
def test_planes_are_palm_and_phalanges_of_an_open_hand_of_the_side(side):
    hand = live_hand("planes", is_left=side == "left")
    names = [patch.name for patch in hand.patches]
    assert (len(names), names[0], names[-1]) == (15, "palm", "little-distal")
    across = hand.patch_pose[0, names.index("little-distal"), 0] - hand.patch_pose[0, names.index("index-distal"), 0]
    assert (across > 0) == (side == "right")
    breadth = hand.patches[0].width
    assert 0.07 < breadth < 0.1


def test_the_layout_has_names_and_places_of_articulated_patches_alone():
    assert patch_layout(Palm()) is None
    assert patch_layout(flat_hand()) is None
    hand = live_hand("planes")
    layout = patch_layout(hand)
    assert layout.names == tuple(patch.name for patch in hand.patches)
    assert np.array_equal(layout.rest, hand.patch_pose[0])


def test_a_patch_that_the_first_pose_lacks_rests_where_a_later_one_has_it():
    pose = np.zeros((2, 2, 7))
    pose[..., 6] = 1.0
    pose[1, 1, 0] = 0.05
    pose[0, 1] = np.nan
    layout = patch_layout(PlaneHand((HandPatch("palm", 0.08, 0.1), HandPatch("index-distal", 0.02, 0.02)), (), pose))
    assert np.allclose(layout.rest[1], pose[1, 1])


def test_hands_that_cannot_be_live_are_refused():
    with pytest.raises(StrategyError, match="has a shape for each pose of its motion"):
        live_hand(own_skin(sample_recording(frame_count=3).transformed(Y_UP)))
    with pytest.raises(StrategyError, match="patch 'nose' lies under no bone"):
        patch_layout(PlaneHand((HandPatch("nose", 0.02, 0.02),), (), np.array([[[0, 0, 0, 0, 0, 0, 1.0]]])))
    with pytest.raises(StrategyError, match="hand must be"):
        live_hand("plains")
