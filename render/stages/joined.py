"""Stage "joined": where patches of a hand touch, what is drawn once, or not at all."""

import math

import numpy as np
import warp as wp

from ...kernels.stages.joint import divide_joints, side_pairs
from ..contour_batch import ContourBatch
from ..hands.plane_hand import PlaneHand
from .registry import Option, Setting, prune_stage
from .segment_removal import cut_batch

ANGLE = math.radians(10.0)
JOINT_GAP = 0.005  # [m]; about half a focal width: sides this near are one to the skin


@prune_stage("joined", on="device", angle=Option(ANGLE, 0.0, math.pi / 2, "rad"), gap=Option(JOINT_GAP, 0.0, 0.1, "m"))
def drop_joined_sides(
    batch: ContourBatch, setting: Setting, *, angle: float, gap: float
) -> tuple[ContourBatch, np.ndarray]:
    """Drop hand segments on sides by which patches touch.

    Where the two sides of a joint are within `gap` [m] of each other, hand segments on them are dropped from both
    patches while these are in one plane within `angle` [rad], else from the smaller one. Other hands, and other
    segments, stay as they are. Returns the length removed [m], shape [pose].
    """
    hand = setting.hand
    if not isinstance(hand, PlaneHand) or not hand.joints or batch.polyline_count == 0:
        return batch, np.zeros(batch.pose_count, np.float32)
    pose = wp.array(hand.section_poses(setting.pose, setting.first), dtype=wp.transform, device=setting.device)
    pairs = [(hand.patch_index(j.patch), j.side, hand.patch_index(j.other), j.other_side) for j in hand.joints]
    joint_sides = side_pairs(pairs, setting.device)
    parts, keep = divide_joints(batch.by_name(), pose, hand.on(setting.device), joint_sides, angle=angle, gap=gap)
    return cut_batch(batch, keep, parts=parts)
