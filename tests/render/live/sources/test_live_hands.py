"""Hands by name, for poses that come live."""

import numpy as np
import pytest

from palpate.datasets import Y_UP
from palpate.datasets.recordings.sample import sample_recording
from palpate.render import HandPatch, MeshHand, Palm, PlaneHand, flat_hand
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import own_skin
from palpate.render.live.sources.live_hands import live_hand, patch_layout

RECORDING = sample_recording(frame_count=3).transformed(Y_UP)


def test_hands_have_names():
    assert live_hand("palm") == Palm()
    assert live_hand("palm", palm=(0.07, 0.09)) == Palm(0.07, 0.09)
    for name in ("mesh", "skin"):
        mesh = live_hand(name)
        assert isinstance(mesh, MeshHand)
        assert mesh.pose_count is None
    own = flat_hand()
    assert live_hand(own) is own


@pytest.mark.parametrize("side", ["left", "right"])
def test_planes_are_palm_and_phalanges_of_an_open_hand_of_the_side(side):
    hand = live_hand("planes", side=side)
    names = [patch.name for patch in hand.patches]
    assert (len(names), names[0], names[-1]) == (15, "palm", "little-distal")
    across = hand.patch_pose[0, names.index("little-distal"), 0] - hand.patch_pose[0, names.index("index-distal"), 0]
    assert (across > 0) == (side == "right")
    breadth = hand.patches[0].width
    assert 0.07 < breadth < 0.1


def test_planes_of_a_recording_have_its_sizes():
    hand = live_hand("planes", recording=RECORDING)
    own = PlaneHand.from_joints(RECORDING.joints_in_hand(), RECORDING.radii(), is_left=False)
    assert [(patch.name, patch.width) for patch in hand.patches] == [(patch.name, patch.width) for patch in own.patches]


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
        live_hand(own_skin(RECORDING))
    with pytest.raises(StrategyError, match="patch 'nose' lies under no bone"):
        patch_layout(PlaneHand((HandPatch("nose", 0.02, 0.02),), (), np.array([[[0, 0, 0, 0, 0, 0, 1.0]]])))
    with pytest.raises(StrategyError, match="--palm is the size of --hand palm, which planes is not"):
        live_hand("planes", palm=(0.1, 0.1))
    with pytest.raises(StrategyError, match="hand must be"):
        live_hand("plains")
