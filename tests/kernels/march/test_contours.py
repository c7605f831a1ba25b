"""Marching a field on patches: topology by cells, places by the field, the geometry's contract."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from march_cases import (
    CENTER,
    FLAT,
    area_of,
    assert_sound,
    ball_value,
    box_value,
    lines_of,
    marched,
    random_poses,
    random_waves,
    ring_value,
    shape_field,
    sheet_value,
    squares,
)
from section_oracle import in_palm, rotation

from palpate.kernels.march import contours as march
from palpate.kernels.offsets import PointLimitError
from palpate.kernels.patch import EXACT, Patch
from palpate.render.contour_batch import object_part
from palpate.render.hands.hand import Palm
from palpate.render.objects.functions.expression import box
from palpate.render.objects.functions.implicit_object import ImplicitObject

wp.set_module_options(EXACT)

COARSE = 1.0
"""A grain above any step: tips are not looked for, so that marching squares alone is compared."""


def match_edges(found, points):
    """Cut edges of `squares` at these points."""
    edges = list(found.point)
    where = np.array([found.point[e] for e in edges])
    apart = np.linalg.norm(where[None] - points[:, None], axis=2)
    assert apart.min(axis=1).max() <= 1e-6
    return [edges[k] for k in apart.argmin(axis=1)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(4))
def test_contours_run_cell_by_cell_as_marching_squares_do(seed, device):
    case, poses, palm = random_waves(seed, grain=COARSE), random_poses(6, seed), Palm(0.085, 0.06)
    batch = marched(case.field(device), poses, device, hand=palm, closes=False)
    assert_sound(batch)
    for pose, lines in zip(poses, lines_of(batch), strict=True):
        cells = (17, 12)
        found = squares(case, pose, (0.0425, 0.03), cells)
        passed = []
        for points, _, closed, _ in lines:
            edges = match_edges(found, points)
            assert all(found.after[a] == b for a, b in pairwise(edges))
            if not closed:
                assert edges[0] not in found.after.values()
                assert edges[-1] not in found.after
            passed += edges[:-1] if closed else edges
        assert sorted(passed) == sorted(found.point)
        entries = [rim_place(match_edges(found, line[0][:1])[0], cells) for line in lines if not line[2]]
        assert entries == sorted(entries)
        assert [line[2] for line in lines] == sorted(line[2] for line in lines)  # loops come after


def rim_place(edge, cells):
    i, j, axis = edge
    nu, nv = cells
    if axis == 0:
        return i if j == 0 else 2 * nu + nv - 1 - i
    return nu + j if i == nu else 2 * nu + 2 * nv - 1 - j


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(3))
def test_closed_contours_bound_the_region_and_hold_the_open_ones(seed, device):
    """With a ring of outside around the grid, marching squares close along the boundary by themselves."""
    case, poses = random_waves(seed, level=-0.4 * seed, grain=COARSE), random_poses(6, seed)
    cells = (17, 17)
    batch = marched(case.field(device), poses, device)
    assert_sound(batch)
    assert batch.polyline_closed.all()
    for pose, lines in zip(poses, lines_of(batch), strict=True):
        want = sorted(
            area_of(loop, pose) for loop in ringed_loops(squares(case, pose, (0.0425,) * 2, cells), pose, cells)
        )
        np.testing.assert_allclose(sorted(area_of(line[0], pose) for line in lines), want, atol=1e-9)
        for points, kind, _, _ in lines:
            middle = 0.5 * (points[1:] + points[:-1]).astype(np.float64)
            local = in_palm(middle, pose)[:, :2]
            on_rim = np.abs(np.abs(local).max(axis=1) - 0.0425) < 1e-7
            np.testing.assert_array_equal(on_rim, kind[:-1] == 1)
    opened = marched(case.field(device), poses, device, closes=False)
    parts = object_part(batch)
    for left, right in zip(lines_of(opened), lines_of(parts), strict=True):
        assert line_set(left) == line_set(right)


def line_set(lines):
    """Polylines without their order; a closed one from its lowest point."""
    out = set()
    for points, _, closed, patch in lines:
        rows = [tuple(p) for p in points.tolist()]
        if closed:
            first = rows.index(min(rows))
            rows = rows[first:-1] + rows[: first + 1]
        out.add((tuple(rows), int(closed), int(patch)))
    return out


def ringed_loops(found, pose, cells):
    """Closed loops of points: what leaves the grid goes on along the boundary's nodes that are inside."""
    axes = rotation(pose[3:])
    nodes = [(i, 0) for i in range(cells[0])] + [(cells[0], j) for j in range(cells[1])]
    nodes += [(cells[0] - i, cells[1]) for i in range(cells[0])] + [(0, cells[1] - j) for j in range(cells[1])]

    def place(node):
        a, b = (0.0425 * (2 * node[k] / cells[k] - 1) for k in range(2))
        return pose[:3].astype(np.float64) + a * axes[:, 0] - b * axes[:, 2]

    rank = {rim_place(e, cells): e for e in found.point if is_rim(e, cells)}
    point, after = {**found.point, **{("node", *n): place(n) for n in nodes}}, dict(found.after)
    for k, node in enumerate(nodes):
        if found.inside[node]:
            following = nodes[(k + 1) % len(nodes)]
            after[("node", *node)] = ("node", *following) if found.inside[following] else rank[k]
        elif found.inside[nodes[(k + 1) % len(nodes)]]:
            after[rank[k]] = ("node", *nodes[(k + 1) % len(nodes)])
    loops, left = [], set(after)
    while left:
        loop = [min(left, key=str)]
        while loop[-1] in left:
            left.discard(loop[-1])
            loop.append(after[loop[-1]])
        loops.append(np.array([point[e] for e in loop]))
    return loops


def is_rim(edge, cells):
    i, j, axis = edge
    return (j in (0, cells[1])) if axis == 0 else (i in (0, cells[0]))


def test_no_poses_give_no_contours(device):
    batch = marched(shape_field(ball_value, CENTER, (0.03, 0, 0)), np.zeros((0, 7)), device)
    assert batch.pose_start.tolist() == [0]
    assert batch.point_count == batch.polyline_count == 0


def same(one, two):
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, two.arrays()[name], err_msg=name)


@pytest.mark.exhaustive
@pytest.mark.parametrize("closes", [True, False])
def test_how_poses_are_cut_into_chunks_makes_no_difference(closes, device, monkeypatch):
    case, poses = random_waves(1), random_poses(23)
    whole = marched(case.field(device), poses, device, closes=closes)
    for name, value in (("CPU_TILES", 100), ("GPU_TILES", 100), ("SLOTS_MOST", 900)):
        monkeypatch.setattr(march, name, value)
    same(marched(case.field(device), poses, device, closes=closes), whole)
    same(marched(case.field(device), poses[7:9], device, closes=closes), whole.select(7, 9))


def patches_on(device, halves, origins):
    out = []
    for half, origin in zip(halves, origins, strict=True):
        patch = Patch()
        patch.origin, patch.half = wp.vec3d(*origin), wp.vec2d(half[0] - 1e-12, half[1] - 1e-12)
        patch.u, patch.v, patch.n = wp.vec3d(1.0, 0.0, 0.0), wp.vec3d(0.0, 0.0, -1.0), wp.vec3d(0.0, 1.0, 0.0)
        out.append(patch)
    return wp.array(out, dtype=Patch, device=device)


@pytest.mark.exhaustive
@pytest.mark.parametrize("posed", [False, True])
def test_patches_of_different_sizes_are_as_each_alone(posed, device):
    case = random_waves(2)
    halves = [(0.04, 0.03), (0.008, 0.011), (0.02, 0.005)]
    origins = [(0.0, 0.0, 0.0)] * 3 if posed else [(0.0, 0.0, 0.0), (0.01, 0.002, -0.05), (-0.03, 0.0, 0.0)]
    poses = random_poses(27).reshape(9, 3, 7) if posed else random_poses(9)[:, None]
    together = marched(case.field(device), poses, device, hand=patches_on(device, halves, origins), step=0.003)
    for own in range(3):
        hand = patches_on(device, halves[own : own + 1], origins[own : own + 1])
        alone = marched(case.field(device), poses[:, min(own, poses.shape[1] - 1)], device, hand=hand, step=0.003)
        for lines, want in zip(lines_of(together), lines_of(alone), strict=True):
            mine = [line for line in lines if line[3] == own]
            assert len(mine) == len(want)
            for a, b in zip(mine, want, strict=True):
                np.testing.assert_array_equal(a[0], b[0])
    for lines in lines_of(together):
        assert [line[3] for line in lines] == sorted(line[3] for line in lines)


@pytest.mark.exhaustive
def test_what_a_field_settles_for_whole_tiles_changes_nothing(device):
    poses = random_poses(30)
    for value, size in ((ball_value, (0.03, 0, 0)), (ring_value, (0.03, 0.012, 0)), (box_value, (0.02, 0.03, 0.04))):
        one, two = (shape_field(value, CENTER, size, skips=skips) for skips in (True, False))
        near = np.array([CENTER - 0.045, CENTER + 0.045])
        same(marched(one, poses, device, step=0.001, bounds=near), marched(two, poses, device, step=0.001))


@pytest.mark.exhaustive
def test_a_whole_plane_gives_the_patch_nothing_cuts(device):
    poses = random_poses(40, spread=0.08)
    field, bounds = shape_field(ball_value, CENTER, (0.03, 0, 0)), np.array([CENTER - 0.03, CENTER + 0.03])
    batch = marched(field, poses, device, step=0.001, bounded=False, closes=False, bounds=bounds, hand=Palm(0.01, 0.02))
    assert_sound(batch)
    assert batch.polyline_closed.all()
    for pose, lines in zip(poses, lines_of(batch), strict=True):
        radius = np.sqrt(max(0.03**2 - in_palm(CENTER[None], pose)[0, 2] ** 2, 0.0))
        assert sum(area_of(line[0], pose) for line in lines) == pytest.approx(np.pi * radius**2, rel=0.01, abs=1e-6)


UPWARD = [0.0, 0.0, 0.25, np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)]  # n = +z
DOWNWARD = [0.0, 0.0, 0.25, np.sin(-np.pi / 4), 0.0, 0.0, np.cos(-np.pi / 4)]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("pose", "count"), [(UPWARD, 1), (DOWNWARD, 0)])
def test_a_face_flush_with_the_palm_counts_as_above(pose, count, device):
    """As a mesh's does: the solid below the plane shows its face, the one above does not."""
    field = shape_field(box_value, [0, 0, 0.23], (0.02, 0.02, 0.02))
    for turn in np.random.default_rng(5).uniform(0, 6.3, 8):
        q = np.array(pose[3:])
        spin = np.array([0, 0, np.sin(turn / 2), np.cos(turn / 2)])
        mixed = np.array([*(spin[3] * q[:3] + q[3] * spin[:3] + np.cross(spin[:3], q[:3])), spin[3] * q[3]])
        batch = marched(field, [[*pose[:3], *mixed]], device)
        assert batch.polyline_count == count


@pytest.mark.parametrize(("center", "opened", "closed"), [(0.0, 0, 1), (0.0425 + 0.0425, 0, 0)])
def test_a_side_that_ends_with_the_palm_is_the_hands(center, opened, closed, device):
    field = ImplicitObject(box(0.085, 0.2, 0.2).moved(center, 0.0, 0.2)).field_on(device)
    flat = [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]
    assert marched(field, [flat], device, closes=False).polyline_count == opened
    batch = marched(field, [flat], device)
    assert batch.polyline_count == closed
    assert (batch.kind == 1).all()


@pytest.mark.exhaustive
def test_nodes_on_the_surface_make_no_steps_of_no_length(device):
    """Both edges of the grid that meet at such a node are cut right there."""
    field = shape_field(box_value, [0.0, 0.0, 0.0], (0.02, 0.1, 0.025))
    batch = marched(field, [FLAT], device, hand=Palm(0.08, 0.08))
    assert_sound(batch)
    (line,) = lines_of(batch)[0]
    assert area_of(line[0], np.float32(FLAT)) == pytest.approx(0.04 * 0.05, abs=1e-8)
    assert len(line[0]) == 2 * 7 + 2 * 9 + 5


@pytest.mark.exhaustive
@pytest.mark.parametrize("level", [-1e-6, 1e-6])
def test_the_middle_of_an_ambiguous_cell_decides(level, device):
    """x y < level on 3 x 3 cells: the middle one is ambiguous, and is joined inside if the level is above 0."""
    field = shape_field(sheet_value, [0.0, 0.0, 0.0], (level, 0, 0), skips=False)
    pose = [0.0, 0.0, 0.0, np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)]
    batch = marched(field, [pose], device, hand=Palm(0.03, 0.03), step=0.01)
    assert batch.polyline_count == (1 if level > 0 else 2)
    assert sum(area_of(line[0], np.float32(pose)) for line in lines_of(batch)[0]) == pytest.approx(0.00045, rel=0.1)


@pytest.mark.exhaustive
def test_too_many_points_and_wrong_arguments_are_refused(device, monkeypatch):
    field, poses = shape_field(ball_value, CENTER, (0.03, 0, 0)), random_poses(10)
    count = marched(field, poses, device).point_count
    assert marched(field, poses, device, limit=count).point_count == count
    for tiles in (march.CPU_TILES, 100):  # in one chunk of poses, and in several
        for name in ("CPU_TILES", "GPU_TILES"):
            monkeypatch.setattr(march, name, tiles)
        with pytest.raises(PointLimitError, match=f"exceed the limit of {count - 1}"):
            marched(field, poses, device, limit=count - 1)
    for step in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="step must be a positive length"):
            marched(field, poses, device, step=step)
    with pytest.raises(ValueError, match="too fine for a side"):
        marched(field, poses, device, step=1e-6)
    with pytest.raises(ValueError, match="closed contours need bounded patches"):
        marched(field, poses, device, bounded=False)
    with pytest.raises(ValueError, match="finite bounds"):
        marched(field, poses, device, bounded=False, closes=False, bounds=np.array([[-np.inf] * 3, [np.inf] * 3]))
