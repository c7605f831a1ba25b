"""Patches of every hand on a device have the bits of `Setting.frames`: rigid hands' are made there."""

import numpy as np
import pytest
from transform_cases import a_setting, random_poses

from palpate.datasets.hand_model.shape import hand_shape
from palpate.render import MeshHand, Palm, PlaneHand
from palpate.render.hands.plane_hand import flat_hand


def a_hand(kind, rng):
    if kind == "palm":
        return Palm(0.08, 0.1)
    if kind == "skin":
        shape = hand_shape(detail=1)
        return MeshHand(shape.vertices, shape.faces, glabrous=shape.glabrous)
    hand = flat_hand()
    if kind == "planes":
        return hand
    own = random_poses(rng, 50 * hand.patch_count).reshape(50, hand.patch_count, 7)
    own[3, 2] = np.nan
    return PlaneHand(hand.patches, patch_pose=own)


@pytest.mark.parametrize("kind", ["palm", "planes", "articulated", "skin"])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_patches_have_the_bits_of_the_frames(kind, count, device, rng):
    pose = random_poses(rng, count)
    pose[:, 3:] *= rng.uniform(0.999, 1.001, (count, 1)).astype(np.float32)
    setting = a_setting(pose, hand=a_hand(kind, rng), device=device)
    patches = setting.patches
    for name in ("origin", "u", "v", "n", "half"):
        values = getattr(patches, name).numpy()
        np.testing.assert_array_equal(values, getattr(setting.frames, name).reshape(values.shape), err_msg=name)
    assert patches.origin.shape == (count, setting.hand.patch_count)
