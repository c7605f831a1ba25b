"""The hand's patches at poses, made on a device."""

import numpy as np
import warp as wp
from transform_cases import a_setting, random_poses

from palpate.kernels.stages.prune import place_patches
from palpate.render.hands.plane_hand import flat_hand


def test_placing_again_at_the_identity_changes_nothing(device, rng):
    setting = a_setting(random_poses(rng, 1), hand=flat_hand(), device=device)
    still = wp.array([[0, 0, 0, 0, 0, 0, 1]], dtype=wp.transform, device=device)
    again = place_patches(still, setting.patches)
    np.testing.assert_array_equal(again.origin.numpy(), setting.patches.origin.numpy())
    np.testing.assert_array_equal(again.n.numpy(), setting.patches.n.numpy())
