"""Paths through points, and the raw intersection "contact"."""

from itertools import permutations

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from tour_oracle import length_on, path_of, thinned

from palpate.datasets.shapes.built_in import shape
from palpate.kernels.tours.tour import POINTS_MOST, thin_points, tour_points
from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import MeshError, PalpateWarning, StrategyError
from palpate.render.hands.hand import Palm
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.intersection.contact_tour import contact_contours
from palpate.render.objects.mesh.solid_mesh import MeshObject

FLAT = np.array([0.0, 0.0, 0.2, np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)])  # in the plane z = 0.2


def on_device(groups, device):
    rows = np.concatenate([np.zeros((0, 3)), *groups]).astype(np.float32)
    start = np.concatenate([[0], np.cumsum([len(g) for g in groups])]).astype(np.int64)
    return wp.array(rows, dtype=wp.vec3, device=device), wp.array(start, dtype=wp.int64, device=device)


def toured(groups, device, *, separation=1e-6, closes=True):
    """Paths of each group, None for none, and how many had a single point."""
    tours = tour_points(*thin_points(*on_device(groups, device), separation=separation), closes=closes)
    batch = ContourBatch.of_sections(tours.contours, 1).numpy()
    assert (batch.kind == 2).all()
    assert (batch.polyline_closed == closes).all()
    assert batch.polyline_start[-1] == batch.point_count
    lines = [batch.polylines_of(pose) for pose in range(batch.pose_count)]
    return [line[0] if line else None for line in lines], tours.single_count


def length_of(path):
    return np.linalg.norm(np.diff(np.asarray(path, np.float64), axis=0), axis=1).sum()


@pytest.mark.parametrize("separation", [0.003, 0.02, 0.5])
def test_points_are_thinned_one_after_the_other(separation, device, rng):
    groups = [rng.uniform(0, 0.06, (n, 3)).astype(np.float32) for n in (0, 1, 2, 300, 40, 0)]
    kept, start = thin_points(*on_device(groups, device), separation=separation)
    kept, start = kept.numpy().reshape(-1, 3), start.numpy()
    for k, group in enumerate(groups):
        np.testing.assert_array_equal(kept[start[k] : start[k + 1]], thinned(group, separation).astype(np.float32))


@pytest.mark.exhaustive
@pytest.mark.parametrize("closes", [True, False])
def test_paths_of_few_points_are_the_shortest_or_nearly(closes, device, rng):
    groups = [rng.uniform(0, 0.05, (n, 3)).astype(np.float32) for n in (2, 3, 4, 5, 6, 7, 7, 7, 7)]
    for path, group in zip(toured(groups, device, closes=closes)[0], groups, strict=True):
        whole = [[*order, *order[:closes]] for order in permutations(range(len(group)))]
        best = min(length_of(group[order]) for order in whole)
        assert best <= length_of(path) + 1e-9 <= 1.05 * best + 2e-9


def flat_grid(rng):
    """Points of a disc on a grid in a tilted plane, thinned as those of a palm are."""
    u, v = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    x = 0.0025 * np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2)
    x = x[np.linalg.norm(x - rng.uniform(0, 0.05, 2), axis=1) < rng.uniform(0.01, 0.04)]
    return thinned((x[:, :1] * u + x[:, 1:] * v + 0.2).astype(np.float32), 0.008).astype(np.float32)


@pytest.mark.parametrize("closes", [True, False])
def test_paths_are_as_short_as_those_of_every_exchange(closes, device, rng):
    """Beside the oracle, which tries every reversal and move of a run: shorter or longer, but not in the mean."""
    groups = [rng.uniform(0, 0.08, (n, 3)).astype(np.float32) for n in (4, 6, 9, 14, 18)]
    groups += [g for g in (flat_grid(rng) for _ in range(12)) if 3 < len(g) < 20]
    ratios = []
    for path, group in zip(toured(groups, device, closes=closes)[0], groups, strict=True):
        points = path[:-1] if closes else path
        assert sorted(map(tuple, points.tolist())) == sorted(map(tuple, group.tolist()))
        ratios.append(length_of(path) / length_on(group, path_of(group, closes), closes))
    assert np.mean(ratios) < 1.01
    assert max(ratios) < 1.2


@pytest.mark.parametrize("closes", [True, False])
def test_many_points_are_each_visited_once_on_a_short_path(closes, device, rng):
    groups = [np.pad(rng.uniform(0, 1, (n, 2)), ((0, 0), (0, 1))).astype(np.float32) for n in (300, POINTS_MOST)]
    for path, group in zip(toured(groups, device, closes=closes)[0], groups, strict=True):
        points = path[:-1] if closes else path
        assert sorted(map(tuple, points.tolist())) == sorted(map(tuple, group.tolist()))
        shortest = 0.7124 * np.sqrt(len(group)) * (1 + 0.33 / np.sqrt(len(group)))  # of random points, in the mean
        assert length_of(path) < 1.1 * shortest


def test_few_points_have_a_path_or_are_counted(device):
    a, b = [0.1, 0.2, 0.3], [0.1, 0.2, 0.31]
    groups = [np.array(g, np.float32).reshape(-1, 3) for g in ([], [a], [a, a, a], [a, b], [a, b, a])]
    for closes in (True, False):
        paths, single = toured(groups, device, separation=0.05, closes=closes)
        assert [None if p is None else p.tolist() for p in paths[:3]] == [None] * 3
        assert single == 2
        for path in paths[3:]:
            np.testing.assert_array_equal(path, np.float32([a, b, a][: 2 + closes]))
    assert toured([], device) == ([], 0)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 60), st.booleans())
def test_a_path_is_its_own_and_needs_no_neighbours(seed, count, closes):
    rng = np.random.default_rng(seed)
    groups = [rng.uniform(0, 0.05, (n, 3)).astype(np.float32) for n in (count, 0, 5)]
    together, _ = toured(groups, "cpu", separation=0.008, closes=closes)
    for group, path in zip(groups, together, strict=True):
        (alone,), _ = toured([group], "cpu", separation=0.008, closes=closes)
        np.testing.assert_array_equal(alone, path)
        if path is not None and len(path) > 2 + closes:
            points = path[:-1] if closes else path
            between = np.linalg.norm(points[:, None].astype(float) - points[None], axis=2)
            assert between[~np.eye(len(points), dtype=bool)].min() >= 0.008


def batch_of(thing, hand, pose, device, *, first=0, step=0.002, **options):
    contours = contact_contours(thing, hand, np.float32(pose), first, device=device, step=step, **options)
    return ContourBatch.of_sections(contours, hand.patch_count).numpy()


@pytest.fixture(scope="module")
def sphere():
    return MeshObject.load("sphere")


@pytest.mark.exhaustive
def test_a_palm_through_a_sphere_is_toured_where_it_is_inside(sphere, device):
    lower, far = FLAT.copy(), FLAT.copy()
    lower[2], far[0] = 0.23, 1.0
    batch = batch_of(sphere, Palm(), [FLAT, far, lower], device)
    np.testing.assert_array_equal(np.diff(batch.pose_start), [1, 0, 1])
    radius = np.linalg.norm(sphere.vertices - [0, 0, 0.2], axis=1).max()
    for pose, height in ((0, 0.2), (2, 0.23)):
        (path,) = batch.polylines_of(pose)
        np.testing.assert_allclose(path[:, 2], height, atol=1e-7)
        assert np.linalg.norm(path - [0, 0, 0.2], axis=1).max() < radius
        between = np.linalg.norm(path[:-1, None].astype(float) - path[None, :-1], axis=2)
        assert between[~np.eye(len(between), dtype=bool)].min() >= 0.008
        np.testing.assert_array_equal(path[0], path[-1])
    opened = batch_of(sphere, Palm(), [FLAT], device, closes=False, separation=0.02)
    assert opened.polyline_closed.tolist() == [0]
    assert opened.point_count < 0.3 * batch.select(0, 1).point_count


def test_several_patches_share_one_path(sphere, device):
    patches = [
        HandPatch("palm", 0.04, 0.04, (-0.02, 0, 0, 0, 0, 0, 1)),
        HandPatch("tip", 0.03, 0.03, (0.03, 0, 0, 0, 0, 0, 1)),
    ]
    batch = batch_of(sphere, PlaneHand(tuple(patches)), [FLAT, FLAT], device, step=0.004)
    assert batch.pose_start.tolist() == [0, 1, 2]
    (path,) = batch.polylines_of(1)
    assert path[:, 0].min() < -0.03
    assert path[:, 0].max() > 0.03


def test_skin_of_a_mesh_hand_inside_a_sphere(sphere, device):
    """A sheet of two triangles, refined: the same points of skin as a palm has, more or less."""
    corner = 0.0425 * np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1.0]])
    hand = MeshHand(corner.astype(np.float32), np.array([[0, 2, 1], [0, 3, 2]]), glabrous=np.ones(2, bool))
    path = batch_of(sphere, hand, [FLAT], device, step=0.003).polylines_of(0)[0]
    palm = batch_of(sphere, Palm(), [FLAT], device, step=0.003).polylines_of(0)[0]
    np.testing.assert_allclose(path[:, 2], 0.2, atol=1e-7)
    assert len(path) == pytest.approx(len(palm), rel=0.25)


def test_a_single_point_is_told(device):
    cube = MeshObject.load("cube")
    top = cube.bounds[1, 2]
    tip = [*cube.bounds[1, :2] + 0.0424, top - 0.01, *FLAT[3:]]  # a corner of the palm only
    with pytest.warns(PalpateWarning, match="contact: at 1 of 2 poses a single point touches"):
        batch = batch_of(cube, Palm(), [tip, FLAT], device, step=0.005)
    assert np.diff(batch.pose_start).tolist() == [0, 1]


def test_what_is_not_a_contact_is_refused(sphere):
    for step in (0.0, np.nan, "fine", None, True, 10**400):
        with pytest.raises(StrategyError, match="contact: step must be a positive length"):
            batch_of(sphere, Palm(), [FLAT], "cpu", step=step)
    for separation in (-1.0, "wide", None):
        with pytest.raises(StrategyError, match="contact: separation must be"):
            batch_of(sphere, Palm(), [FLAT], "cpu", separation=separation)
    with pytest.raises(StrategyError, match="contact: step of"):
        batch_of(sphere, Palm(), [FLAT], "cpu", step=1e-6)


@pytest.mark.filterwarnings("ignore:.*open edges")
def test_an_open_object_is_refused_by_the_name_of_what_needs_it_closed():
    vertices, faces = shape("cube")
    torn = MeshObject(vertices + np.array([0, 0, 0.2]), faces[1:], name="torn")
    with pytest.raises(MeshError, match='raw "contact" needs an object with an inside: torn'):
        contact_contours(torn, Palm(), np.array([FLAT]), step=0.002)
