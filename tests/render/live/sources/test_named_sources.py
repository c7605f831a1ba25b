"""Sources by the texts of the command line."""

import sys

import numpy as np
import pytest

from palpate.datasets import Y_UP, load_recording, write_sample
from palpate.datasets.errors import RecordingError
from palpate.render import MeshObject, PlaneHand, exploration
from palpate.render.errors import StrategyError, UntrustedCodeError
from palpate.render.live.sources.live_hands import live_hand
from palpate.render.live.sources.named_sources import settings_and_hand, source_of
from palpate.render.live.sources.replay import ReplaySource
from palpate.render.live.sources.udp import UdpSource
from palpate.render.live.sources.ultraleap import UltraleapSource

CUBE = MeshObject.load("cube")
SHORT = {"duration": 0.5, "seed": 4, "model": None}


def test_an_exploration_is_the_object_s_own_with_its_options():
    chosen = source_of("Exploration", CUBE, options=SHORT, loops=True)
    assert np.array_equal(chosen.source.pose, exploration("cube", duration=0.5, seed=4).pose)
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


@pytest.mark.parametrize(
    ("text", "given", "reason"),
    [
        ("exploration", {"alignment": "y-up"}, "--alignment is of a tracker, which exploration is not"),
        ("exploration", {"side": "left"}, "--side is of a tracker"),
        ("udp", {"options": {"seed": 1}}, "--seed is of a synthetic exploration, which udp is not"),
        ("ultraleap", {"options": {"rate": 90.0}}, "--rate is of a synthetic exploration"),
    ],
)
def test_options_of_other_sources_are_refused(text, given, reason):
    with pytest.raises(StrategyError, match=reason):
        source_of(text, CUBE, **given)


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
