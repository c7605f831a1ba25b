"""Joined sides: patches that tile a rectangle draw that rectangle, an edge is drawn once, what is apart stays."""

import numpy as np
import pytest
import warp as wp
from mesh_cases import generic_poses
from scipy.spatial.transform import Rotation

from palpate.render import IntersectionStrategy, MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.hands.plane_hand import HandPatch, PatchJoint, PlaneHand, flat_hand
from palpate.render.intersection.mesh_section import intersect
from palpate.render.stages.prune import JOINT_GAP, drop_joined_sides
from palpate.render.stages.setting import Setting

ANGLE = np.radians(10.0)


def raw_contours(thing, hand, pose, strategy, device):
    section = wp.array(hand.section_poses(pose, 0), dtype=wp.transform, device=device)
    return intersect(thing, hand, section, strategy)[0]


def joined_contours(thing, hand, pose, strategy, device, *, angle=ANGLE, gap=JOINT_GAP):
    """Contours before and after, on the host, and the length removed."""
    raw = raw_contours(thing, hand, pose, strategy, device)
    setting = Setting(thing, hand, pose, 0, device, 0.0086, 0.002)
    after, removed = drop_joined_sides(raw, setting, angle=angle, gap=gap)
    return raw.numpy(), after.numpy(), removed


def segments_of(batch):
    """Ends [segment, 2, 3], kind, patch and pose of all segments."""
    last = batch.polyline_start[1:] - 1
    first = np.setdiff1d(np.arange(batch.point_count), last)
    line = np.searchsorted(batch.polyline_start, first, side="right") - 1
    pose = np.searchsorted(batch.pose_start, line, side="right") - 1
    ends = np.stack([batch.points[first], batch.points[first + 1]], axis=1).astype(np.float64)
    return ends, batch.kind[first], batch.polyline_patch[line], pose


def test_a_flat_hand_draws_the_outline_of_its_union_in_a_convex_solid(device):
    shapely = pytest.importorskip("shapely")
    hand, thing = flat_hand(), MeshObject.load("sphere")
    patches = [k for k, patch in enumerate(hand.patches) if "thumb" not in patch.name]
    hand = PlaneHand(tuple(hand.patches[k] for k in patches), tuple(j for j in hand.joints if "thumb" not in j.patch))
    pose = generic_poses(60, 4, spread=0.05)
    frames, here = hand.frames(pose), np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    union = shapely.union_all([shapely.Polygon(c[:, [0, 2]] * [1, -1]) for c in hand.corners(here)[0]], grid_size=1e-9)
    assert union.geom_type == "Polygon"
    whole = raw_contours(thing, Palm(1.0, 1.0), pose, open_contour(), device).numpy()
    _, after, _ = joined_contours(thing, hand, pose, closed_contour(), device)
    compared = 0
    for i in range(len(pose)):
        lines = whole.polylines_of(i)
        expected = 0.0
        if lines:
            away = lines[0].astype(np.float64) - pose[i, :3]
            section = shapely.Polygon(np.stack([away @ frames.u[i, 0], away @ frames.v[i, 0]], axis=1))
            expected = section.intersection(union).length
        assert after.length()[i] == pytest.approx(expected, abs=1e-5)
        compared += expected > 0.1
    assert compared > 20


def hinge(bend, apart=0.0, *, width=0.03, aside=0.0):
    """A palm of 80 x 100 mm and a finger at its side 2, bent by an angle [degree] and so far apart [m]."""
    turn = Rotation.from_euler("x", -bend, degrees=True)
    middle = np.array([aside, 0, -0.05 - apart]) + turn.apply([0, 0, -0.02])
    finger = HandPatch("finger", width, 0.04, (*middle, *turn.as_quat()))
    return PlaneHand((HandPatch("palm", 0.08, 0.1), finger), (PatchJoint("palm", 2, "finger", 0),))


INSIDE = np.array([[0, 0, 1.0, 0, 0, 0, 1]], np.float32)


def large_cube():
    """520 mm wide, around INSIDE."""
    cube = MeshObject.load("cube")
    return MeshObject(((cube.vertices - [0, 0, 0.2]) * 4 + [0, 0, 1.0]).astype(np.float32), cube.faces)


def removed_inside(hand, device, **options):
    """Length that each patch loses, of its whole boundary inside a cube [m]."""
    before, after, removed = joined_contours(large_cube(), hand, INSIDE, closed_contour(), device, **options)
    lost = np.zeros(2)
    for batch, sign in ((before, 1), (after, -1)):
        ends, kind, patch, _ = segments_of(batch)
        assert (kind == 1).all()
        np.add.at(lost, patch, sign * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    assert removed[0] == pytest.approx(lost.sum(), abs=1e-6)
    return lost


@pytest.mark.parametrize(
    ("bend", "apart", "lost"),
    [
        (0, 0, (0.03, 0.03)),
        (9.9, 0, (0.03, 0.03)),
        (10.1, 0, (0, 0.03)),  # an edge, drawn once: by the larger patch
        (-60, 0, (0, 0.03)),
        (90, 0, (0, 0.03)),
        (0, 0.0049, (0.03, 0.03)),
        (0, 0.0051, (0, 0)),
        (45, 0.0051, (0, 0)),
    ],
)
def test_sides_are_dropped_by_angle_and_distance(bend, apart, lost, device):
    np.testing.assert_allclose(removed_inside(hinge(bend, apart), device), lost, atol=1e-6)


def test_patches_on_top_of_each_other_are_an_edge_and_not_one_plane(device):
    folded = HandPatch("finger", 0.03, 0.04, (0, 0, -0.05 + 0.02, 0, 0, 0, 1))  # its side 2 under the palm's side 2
    hand = PlaneHand((HandPatch("palm", 0.08, 0.1), folded), (PatchJoint("palm", 2, "finger", 2),))
    np.testing.assert_allclose(removed_inside(hand, device), [0, 0.03], atol=1e-6)


def test_a_joint_may_be_told_from_either_side(device):
    pose, thing = generic_poses(100, 5, spread=0.03), MeshObject.load("cube")
    hand = hinge(30)
    turned = PlaneHand(hand.patches, tuple(PatchJoint(j.other, j.other_side, j.patch, j.side) for j in hand.joints))
    one, two = (joined_contours(thing, h, pose, closed_contour(), device) for h in (hand, turned))
    np.testing.assert_allclose(one[2], two[2], atol=1e-6)
    assert one[2].sum() > 0.1


def test_other_hands_and_hands_without_joints_keep_everything(device):
    pose, thing = generic_poses(20, 6, spread=0.02), MeshObject.load("cube")
    for hand in (Palm(), PlaneHand(hinge(0).patches)):
        before, after, removed = joined_contours(thing, hand, pose, closed_contour(), device)
        assert not removed.any()
        assert removed.dtype == np.float32
        for name, array in before.arrays().items():
            assert array.tobytes() == after.arrays()[name].tobytes()


def covered(begin, end, stretches):
    """How much of begin..end the union of stretches covers."""
    total, done = 0.0, begin
    for low, high in sorted(stretches):
        total += max(0.0, min(high, end) - max(low, done))
        done = max(done, min(high, end))
    return total


def dropped_slowly(joint, hand, corners, frames, angle, gap):
    """Oracle: stretches of sides that a joint drops in one pose, by (patch, side), from the side's start."""
    one, two = (hand.patch_index(joint.patch), joint.side), (hand.patch_index(joint.other), joint.other_side)
    (a, b), (c, d) = ((corners[k, s], corners[k, (s + 1) % 4]) for k, s in (one, two))
    along = (b - a) / np.linalg.norm(b - a)
    s, t = (c - a) @ along, (d - a) @ along
    low, high = max(0.0, min(s, t)), min(np.linalg.norm(b - a), max(s, t))
    if high <= low:
        return {}
    shares = [(x - s) / (t - s) for x in (low, high)]
    if max(np.linalg.norm(c + q * (d - c) - a - x * along) for q, x in zip(shares, (low, high), strict=True)) > gap:
        return {}
    stretches = {one: (low, high), two: tuple(sorted(q * np.linalg.norm(d - c) for q in shares))}
    if frames[one[0]] @ frames[two[0]] >= np.cos(angle) and t < s:
        return stretches
    sizes = [hand.patches[k].width * hand.patches[k].length for k, _ in (one, two)]
    loser = one if sizes[0] < sizes[1] else two
    return {loser: stretches[loser]}


def removed_slowly(batch, hand, pose, angle, gap):
    """Oracle: length of hand segments on joined sides, segment by segment [m], shape [pose]."""
    corners, frames = hand.corners(pose), hand.frames(pose)
    found = [
        [dropped_slowly(joint, hand, corners[i], frames.n[i], angle, gap) for joint in hand.joints]
        for i in range(len(pose))
    ]
    removed = np.zeros(len(pose))
    for (p, q), kind, patch, row in zip(*segments_of(batch), strict=True):
        for side in range(4) if kind == 1 else ():
            a, b = corners[row, patch, side], corners[row, patch, (side + 1) % 4]
            along = (b - a) / np.linalg.norm(b - a)
            if max(np.linalg.norm(np.cross(along, x - a)) for x in (p, q)) < 2e-6:
                begin, end = sorted(((p - a) @ along, (q - a) @ along))
                removed[row] += covered(begin, end, [d[patch, side] for d in found[row] if (patch, side) in d])
                break
    return removed


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("rigid", [True, False])
def test_removed_lengths_are_those_of_the_oracle(rigid, device):
    pose, thing, hand = generic_poses(60, 8, spread=0.04), MeshObject.load("tube"), flat_hand()
    if not rigid:  # every phalanx shaken by up to 3 mm and some 10 degrees
        rng = np.random.default_rng(9)
        own = np.tile(np.array([patch.pose for patch in hand.patches]), (len(pose), 1, 1))
        own[..., :3] += rng.uniform(-0.002, 0.002, own[..., :3].shape)
        shake = Rotation.from_rotvec(rng.normal(0, 0.06, (own[..., 0].size, 3)))
        own[..., 3:] = (shake * Rotation.from_quat(own[..., 3:].reshape(-1, 4))).as_quat().reshape(own[..., 3:].shape)
        hand = PlaneHand(hand.patches, hand.joints, own)
    before, _, removed = joined_contours(thing, hand, pose, closed_contour(), device)
    expected = removed_slowly(before, hand, pose, ANGLE, JOINT_GAP)
    np.testing.assert_allclose(removed, expected, atol=1e-5)
    assert (expected > 0.001).sum() > 20


@pytest.mark.parametrize("name", ["hatch", "inset", "ellipse", "circle", "centroid"])
def test_regions_that_are_filled_or_replaced_stay_whole(name):
    hand = flat_hand()
    bare = PlaneHand(hand.patches)
    thing = MeshObject.load("sphere")
    strategy = IntersectionStrategy(prune=("outside",), transform=("close", name))
    pose = np.array([[0, -0.02, 0.2, 0.7071068, 0, 0, 0.7071068]], np.float32)
    joined, apart = (render(thing, some, pose, "cc").length()[0] for some in (hand, bare))
    assert joined < apart - 0.02  # sides by which patches touch are in the sphere
    one, other = (render(thing, some, pose, strategy) for some in (hand, bare))
    assert one.point_count > 10
    np.testing.assert_array_equal(one.points, other.points)
