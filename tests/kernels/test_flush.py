"""Palms that rest on faces, or whose sides run along them: one outcome, however object and palm are turned together.

What is known without the code: turning and moving object and hand together changes nothing (symmetry); the outline of
a square face; and NumPy's section of the mesh as the rule takes it (`oracles.cut_mesh` with `flush`).
"""

from fractions import Fraction

import numpy as np
import pytest
from drawing import LEVEL_AXES, SEARCHES, STRATEGIES, assert_same_bits, draw, patch_array, surface_on
from mesh_cases import CLOSED, generic_poses
from scipy.spatial.transform import Rotation
from section_oracle import cut_mesh

from palpate.datasets.shapes.built_in import shape
from palpate.kernels.patch import resolve_flush
from palpate.render import ImplicitObject, IntersectionStrategy, MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.objects.functions.expression import box

pytestmark = pytest.mark.filterwarnings("ignore:.*reaches behind the array:palpate.render.errors.PalpateWarning")

TOLERANCE = 1e-5  # [m]
HALF = np.array([0.0425, 0.0425])
N_UP = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # a level palm whose n is +z
N_DOWN = Rotation.from_euler("x", np.pi) * N_UP


def solid_about_origin(name):
    """Vertices [m] around their middle, faces, and the height of the upper face."""
    vertices, faces = shape(name)
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return vertices, faces, vertices[:, 2].max()


def rigid_motions(count, distance, seed):
    """Any turns, and places at a distance from the array's origin [m]."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    place = distance * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return Rotation.random(count, random_state=seed), place


def carried(turns, places, offset, level=N_UP):
    """Poses of a palm that is carried along, float32, shape [pose, 7]."""
    return np.hstack([places + turns.apply(offset), (turns * level).as_quat()]).astype(np.float32)


def lengths_at_rest(name, palm, offset, strategy, *, distance=0.2, count=60, seed=1, level=N_UP, device="cpu"):
    """Lengths [m] of a palm that rests on an object, both turned and placed together: object still, and moving."""
    vertices, faces, _ = solid_about_origin(name)
    turns, places = rigid_motions(count, distance, seed)
    poses = carried(turns, places, offset, level)
    still = [
        render(MeshObject(turn.apply(vertices) + place, faces), palm, pose[None], strategy, device=device).length()[0]
        for turn, place, pose in zip(turns, places, poses, strict=True)
    ]
    moved = np.hstack([places, turns.as_quat()]).astype(np.float32)
    thing = MeshObject(vertices + np.array([0.0, 0.0, 0.2]), faces)
    return np.array(still), render(thing, palm, poses, strategy, object_pose=moved, device=device).length()


@pytest.mark.exhaustive
@pytest.mark.parametrize("level", [N_UP, N_DOWN], ids=["out", "in"])
@pytest.mark.parametrize(("name", "across"), [("cube", 0.0), ("tube", 0.0525)])
def test_a_resting_palm_gives_one_outcome_however_it_is_turned_with_the_object(name, across, level, device):
    top = solid_about_origin(name)[2]
    for side in (0.01, 0.04, 0.2):
        for strategy in (open_contour(), closed_contour()):
            offset = [across, 0.0, top]
            options = {"count": 40, "seed": int(1000 * side), "level": level, "device": device}
            lengths = np.concatenate(lengths_at_rest(name, Palm(side, side), offset, strategy, **options))
            assert np.ptp(lengths) < TOLERANCE
    assert lengths[0] == 0.0 or lengths[0] > 0.5  # all of the face's outline, or nothing


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:motion. positions reach:palpate.render.RecordingWarning")
@pytest.mark.parametrize("distance", [0.1, 0.5, 5.0, 100.0])
def test_a_resting_palm_has_one_outcome_at_any_distance_where_float32_can_tell(distance, device):
    spacing = float(np.spacing(np.float32(distance)))
    for lengths in lengths_at_rest("cube", Palm(0.04, 0.04), [0, 0, 0.065], closed_contour(), distance=distance):
        assert lengths == pytest.approx(0.16, abs=TOLERANCE + 20 * spacing)


@pytest.mark.exhaustive
def test_a_palm_whose_side_runs_along_a_face_has_one_outcome(device):
    """The contour along the side is hand kind, and so never part of OC."""
    offset = [0.065 - 0.02, 0.0, 0.03]
    for strategy, length in ((open_contour(), 0.0), (closed_contour(), 0.16)):
        for lengths in lengths_at_rest("cube", Palm(0.04, 0.04), offset, strategy, device=device):
            assert lengths == pytest.approx(length, abs=TOLERANCE)


def test_turning_and_moving_object_and_hand_together_changes_no_length(device):
    vertices, faces, _ = solid_about_origin("tube")
    hands = generic_poses(30, 4).astype(np.float64)
    hands[:, :3] -= [0, 0, 0.2]
    turns, places = rigid_motions(6, 0.3, 2)
    for strategy in (open_contour(), closed_contour()):
        lengths = []
        for turn, place in zip(turns, places, strict=True):
            quaternion = (turn * Rotation.from_quat(hands[:, 3:])).as_quat()
            poses = np.hstack([turn.apply(hands[:, :3]) + place, quaternion]).astype(np.float32)
            thing = MeshObject(turn.apply(vertices) + place, faces)
            lengths.append(render(thing, Palm(), poses, strategy, device=device).length())
        assert np.ptp(lengths, axis=0).max() < TOLERANCE
        assert np.max(lengths) > 0.1


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("name", "fewest"), [("cube", 5), ("tube", 30), ("dog", 15), ("comb", 40)])
def test_sections_are_those_of_the_mesh_as_the_rule_takes_it(name, fewest, device):
    """With the largest flush most sections change; the oracle decides each vertex in float64, both methods agree.

    Contours that run to and fro along an edge on the plane are drawn, and the oracle has them if they have an area.
    """
    mesh, poses, flush = CLOSED[name](), generic_poses(60, 9), 1e-3
    surface, patch = surface_on(mesh, device), resolve_flush(patch_array(HALF, device), flush=flush)
    drawn = {strategy: draw(surface, poses, patch, strategy, "scan") for strategy in STRATEGIES}
    for strategy, traced in drawn.items():
        assert_same_bits(traced, draw(surface, poses, patch, strategy, "tree"))
    changed = 0
    for i, pose in enumerate(poses):
        cuts = [cut_mesh(*mesh, pose, HALF, flush=flush, lift=lift) for lift in (0.0, 1e-11)]
        lengths = drawn["oc"].length[i].sum(), drawn["cc"].length[i].sum()
        off = [max(abs(lengths[0] - cut.oc_length), abs(lengths[1] - cut.cc_length)) for cut in cuts]
        assert min(off) < 2 * TOLERANCE
        changed += abs(cuts[0].oc_length - cut_mesh(*mesh, pose, HALF).oc_length) > TOLERANCE
    assert changed > fewest


def level_box(top, right):
    """A box whose upper face and right side are at these places [m], which float32 holds exactly."""
    vertices, faces = shape("cube")
    low, high = np.array([-0.0625, -0.0625, -0.125]), np.array([float(right), 0.0625, float(top)])
    vertices = np.where(vertices > vertices.mean(axis=0), high, low)
    assert set(map(Fraction, vertices[:, 2].astype(np.float32).tolist())) >= {Fraction(top)}
    return vertices.astype(np.float32), faces


@pytest.mark.parametrize("method", SEARCHES)
def test_what_is_flush_and_what_is_not_is_one_float32_apart(method, device):
    """In binary fractions nothing rounds: a vertex `flush` below the plane is on it, a float32 step lower not."""
    flush, step, half = Fraction(1, 2**14), Fraction(1, 2**37), Fraction(1, 32)
    level = patch_array([float(half)] * 2, device, LEVEL_AXES, rim=0.0)
    patch, pose = resolve_flush(level, flush=float(flush)), np.array([[0, 0, 0, 0, 0, 0, 1]], np.float32)
    whole = float(8 * half)

    def cc_length(top, right):
        return draw(surface_on(level_box(top, right), device), pose, patch, "cc", method).length[0]

    far = Fraction(1, 16)
    assert cc_length(-flush, far).sum() == pytest.approx(whole, abs=1e-7)
    assert cc_length(-flush - step, far).sum() == 0.0
    on_side, inside = half - flush + Fraction(1, 2**29), half - flush - Fraction(1, 2**29)
    assert cc_length(far, on_side)[0] == 0.0  # all of it is hand kind
    assert cc_length(far, inside)[0] == pytest.approx(float(2 * half), abs=1e-7)


@pytest.mark.parametrize("articulated", [False, True])
def test_every_patch_of_a_hand_rests(articulated, device):
    """Two patches side by side on a face, whose poses are rounded once more where the hand is articulated."""
    patches = tuple(HandPatch(name, 0.03, 0.03, (x, 0, 0, 0, 0, 0, 1)) for name, x in (("a", -0.02), ("b", 0.02)))
    vertices, faces, top = solid_about_origin("cube")
    turns, places = rigid_motions(200, 0.2, 6)
    poses = carried(turns, places, [0, 0, top])
    own = np.tile([patch.pose for patch in patches], (len(poses), 1, 1)) if articulated else None
    hand = PlaneHand(patches, (), own)
    moved = np.hstack([places, turns.as_quat()]).astype(np.float32)
    thing = MeshObject(vertices + np.array([0.0, 0.0, 0.2]), faces)
    lengths = render(thing, hand, poses, closed_contour(), object_pose=moved, device=device).length()
    assert lengths == pytest.approx(0.24, abs=TOLERANCE)


@pytest.mark.exhaustive
def test_a_palm_on_the_face_of_a_function_gives_one_outcome(device):
    """A box as a function, moved with the palm: the grid lies `flush` below the plane, beyond what rounding does."""
    cube = ImplicitObject(box(0.13, 0.13, 0.13).moved(0, 0, 0.2))
    turns, places = rigid_motions(60, 0.2, 7)
    moved = np.hstack([places, turns.as_quat()]).astype(np.float32)
    strategy = IntersectionStrategy(prune=("outside",), transform=("close",), step=0.004)
    lengths = render(
        cube, Palm(0.04, 0.04), carried(turns, places, [0, 0, 0.065]), strategy, object_pose=moved, device=device
    )
    assert lengths.length() == pytest.approx(0.16, abs=1e-4)


@pytest.mark.parametrize("upper", [True, False])
def test_a_convex_edge_touched_from_outside_is_drawn_there_and_back_or_not_at_all(upper):
    """A square beam on its edge; a palm of 85 mm at its highest or lowest line, turned both ways.

    Drawn is what a plane moved inwards by less than `flush` cuts: a strip of no width, 85 mm there and 85 mm back.
    """
    vertices, faces = shape("cube")
    vertices = vertices - vertices.mean(axis=0)
    turned = Rotation.from_euler("x", np.pi / 4).apply(vertices * [2.0, 1.0, 1.0])
    beam = MeshObject(turned, faces)
    height = beam.vertices[:, 2].max() if upper else beam.vertices[:, 2].min()
    poses = np.array([[0, 0, height, *turn.as_quat()] for turn in (N_UP, N_DOWN)], np.float32)
    batch = render(beam, Palm(), poses, closed_contour())
    assert batch.length() == pytest.approx([0.17, 0.0] if upper else [0.0, 0.17], abs=1e-6)
    points = batch.points.astype(float)
    assert np.ptp(points[:, 1:], axis=0).max() < 1e-6  # on one line: no area
