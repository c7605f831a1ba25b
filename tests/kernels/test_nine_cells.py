"""The table object {mesh, voxels, function} x hand {palm, patches, skin}: the same contour for the same solid."""

from functools import cache, partial
from itertools import product

import numpy as np
import pytest
from cells import (
    MIDDLE,
    SOLIDS,
    SPACING_BINARY,
    STEP,
    grazing,
    mesh_of,
    opened,
    palm,
    parts_of,
    region_of,
    solid_of,
    worst_deviations,
)
from mesh_cases import generic_poses
from scipy.spatial.transform import Rotation

from palpate.render import IntersectionStrategy, closed_contour, render
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand

EXCLUDED_MOST = 0.1
OTHER_LOOPS_MOST = 0.15  # of voxels of 0 and 1, thin and grazing sections included; elsewhere checked pose by pose
TOLERANCE = 6e-5  # [m]; of the fine mesh that stands for the exact solid
GRAZING = 35.0  # [degree]
MARCHED = IntersectionStrategy(prune=("outside",), transform=("close",), step=STEP)


def tilted(axis, degrees, *at):
    """A pose in the hand's frame."""
    return (*at, *Rotation.from_euler(axis, degrees, degrees=True).as_quat())


FINGERS = PlaneHand(
    (
        HandPatch("palm", 0.085, 0.085),
        HandPatch("index-proximal", 0.02, 0.04, tilted("x", 20, 0.02, 0.004, -0.06)),
        HandPatch("thumb-distal", 0.03, 0.05, tilted("z", 40, -0.05, -0.01, 0.0)),
    )
)


def flat_skin():
    """The palm's rectangle as two triangles, oriented outwards: the skin faces -Y."""
    half = 0.0425
    corners = np.array([[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]])
    return MeshHand(corners, np.array([[0, 2, 1], [0, 3, 2]]), step=STEP)


HANDS = {"palm": palm, "planes": lambda: FINGERS, "skin": flat_skin}


@cache
def poses_of(name, count):
    poses = generic_poses(count, SOLIDS.index(name) + 11, spread=0.035)
    poses[:, :3] += np.array(MIDDLE, np.float32) - poses[:, :3].mean(axis=0)
    return poses


@cache
def exact_regions(hand_name, name, count):
    """Per pose and patch: the exact region, its rings' area, and the pose of the patch."""
    hand = HANDS["palm"]() if hand_name == "skin" else HANDS[hand_name]()
    poses = poses_of(name, count)
    batch = render(mesh_of(name), hand, poses, closed_contour())
    return [
        [(*region_of(batch, pose, row, patch), pose) for patch, pose in enumerate(patch_poses(hand, row_pose))]
        for row, row_pose in enumerate(poses)
    ]


def patch_poses(hand, pose):
    """Pose of each patch in the array frame, float32, shape [patch, 7]."""
    frames = hand.frames(pose[None], 0)
    axes = np.stack([frames.u[0], frames.n[0], -frames.v[0]], axis=-1)
    quaternion = Rotation.from_matrix(axes).as_quat()
    return np.concatenate([frames.origin[0], quaternion], axis=1)


def judged(found, exact, *, feature, limit_smooth, limit_corner, voxel=0.0, left_out=None):
    """Whether a pose counts, having checked it if it does.

    voxel: of occupancy, whose surface is right to a voxel only [m]; left_out: where it grazes the plane it is farther
    off in it, and makes loops of its own.
    """
    (region, rings, area), (wanted, wanted_rings, wanted_area, _) = found, exact
    if wanted.is_empty:
        assert region.area <= (4 * voxel) ** 2
        return True
    kept, complete = opened(wanted, feature)
    if not complete:
        return False
    if not voxel:
        assert len(rings) == len(wanted_rings)
        assert parts_of(region) == parts_of(wanted)
    slack = TOLERANCE + 0.3 * voxel
    assert abs(area - wanted_area) <= 0.01 * abs(wanted_area) + slack * wanted.length
    smooth, corner = worst_deviations(region, wanted, kept, feature, left_out=left_out)
    assert smooth <= limit_smooth + TOLERANCE
    assert corner <= limit_corner + TOLERANCE
    return True


CASES = [("mesh", "palm", "cube", 6), *product(("mesh", "voxels", "implicit", "binary"), HANDS, SOLIDS, [60])]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("representation", "hand_name", "name", "count"), CASES)
def test_every_cell_gives_the_contour_of_the_solid(representation, hand_name, name, count):
    hand, poses = HANDS[hand_name](), poses_of(name, count)
    batch = render(solid_of(representation, name), hand, poses, MARCHED)
    limits = {"feature": STEP, "limit_smooth": 0.5 * STEP, "limit_corner": STEP}
    if representation == "binary":
        limits = {"feature": SPACING_BINARY} | dict.fromkeys(("limit_smooth", "limit_corner"), 1.5 * SPACING_BINARY)
        limits["voxel"] = SPACING_BINARY
    counted = excluded = other_loops = 0
    for row, patches in enumerate(exact_regions(hand_name, name, count)):
        for patch, exact in enumerate(patches):
            if representation == "binary":  # the surface is within a voxel, but where it grazes the plane that is far
                limits["left_out"] = partial(grazing, pose=exact[3], name=name, degrees=GRAZING)
            found = region_of(batch, exact[3], row, patch)
            excluded += not judged(found, exact, **limits)
            counted += 1
            other_loops += len(found[1]) != len(exact[1])
    assert counted >= count
    assert excluded <= EXCLUDED_MOST * counted
    assert other_loops <= OTHER_LOOPS_MOST * counted
