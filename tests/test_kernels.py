"""Each kernel against its own slow oracle, on every device; clip and close also on the patch's own lines."""

import numpy as np
import pytest
import shapely
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles import section_links, walk

from palpate.kernels.chain import chain_crossings
from palpate.kernels.clip import clip_polylines
from palpate.kernels.close import close_polylines
from palpate.kernels.measure import measure_contours
from palpate.kernels.patch import Patch
from palpate.kernels.ragged import HAND, Polylines
from palpate.kernels.slice import CrossingLimitError, Crossings, slice_mesh
from palpate.kernels.winged import OPEN, wing_edges
from palpate.render import MeshObject, Palm

EDGES = 1000  # keys below it are mesh edges, in tests that make their own polylines
once_a_device = settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])


def random_poses(count, seed):
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.hstack([rng.uniform(-0.06, 0.06, (count, 3)) + np.array([0, 0, 0.2]), quaternion]).astype(np.float32)


def patches(device, half=(1.0, 1.0)):
    patch = Patch()
    patch.u, patch.v, patch.n = wp.vec3d(1.0, 0.0, 0.0), wp.vec3d(0.0, 1.0, 0.0), wp.vec3d(0.0, 0.0, 1.0)
    patch.half = wp.vec2d(*half)
    return wp.array([patch], dtype=Patch, device=device)


def sliced(name, poses, device):
    thing = MeshObject.load(name)
    pose = wp.array(poses, dtype=wp.transform, device=device)
    return thing, slice_mesh(thing.on(device), pose, Palm().on(device))


@pytest.mark.parametrize("name", ["cube", "tube", "dog"])
def test_slicing_finds_every_crossing_and_what_follows_it(name, device):
    poses = random_poses(40, 1)
    thing, crossings = sliced(name, poses, device)
    start, key = crossings.section_start.numpy(), crossings.key.numpy()
    after, point = crossings.next_key.numpy(), crossings.point.numpy()
    ends = thing.edges.end
    for i, pose in enumerate(poses):
        expected, follower = section_links(thing.vertices, thing.faces, pose)
        rows = slice(start[i], start[i + 1])
        found = [tuple(ends[k]) for k in key[rows]]
        assert found == sorted(expected)
        assert [tuple(ends[k]) for k in after[rows]] == [follower[edge] for edge in found]
        wanted = np.array([expected[edge] for edge in found]).reshape(-1, 2)
        np.testing.assert_allclose(point[rows], wanted, atol=2e-6)


def test_slicing_refuses_more_crossings_than_there_is_room_for(device):
    poses = random_poses(40, 1)
    thing, crossings = sliced("tube", poses, device)
    total = crossings.key.shape[0]
    pose = wp.array(poses, dtype=wp.transform, device=device)
    assert slice_mesh(thing.on(device), pose, Palm().on(device), limit=total).key.shape[0] == total
    with pytest.raises(CrossingLimitError, match=f"{total} crossings.*limit of {total - 1}"):
        slice_mesh(thing.on(device), pose, Palm().on(device), limit=total - 1)


@once_a_device
@given(data=st.data())
def test_chains_are_walked_like_the_oracle_walks(data, device):
    """Sections of random loops and open chains over random keys."""
    sections = data.draw(
        st.lists(st.lists(st.tuples(st.integers(1, 6), st.booleans()), max_size=5), min_size=1, max_size=4)
    )
    start, key, after, expected = [0], [], [], []
    for section in sections:
        count = sum(size for size, _ in section)
        keys = data.draw(st.permutations(range(0, 3 * count, 3)))
        follower, first = {}, 0
        for size, closed in section:
            chain = keys[first : first + size]
            follower |= dict(zip(chain, [*chain[1:], chain[0] if closed else OPEN], strict=True))
            first += size
        expected.append(follower)
        key += sorted(follower)
        after += [follower[k] for k in sorted(follower)]
        start.append(len(key))
    crossings = Crossings()
    crossings.section_start = wp.array(np.array(start, np.int64), device=device)
    crossings.key = wp.array(np.array(key, np.int32), device=device)
    crossings.next_key = wp.array(np.array(after, np.int32), device=device)
    crossings.point = wp.array(
        np.array(key, np.float32)[:, None] * np.ones((1, 2), np.float32), dtype=wp.vec2d, device=device
    )
    lines = chain_crossings(crossings)
    section_start, polyline_start = lines.section_start.numpy(), lines.polyline_start.numpy()
    got_key, closed = lines.key.numpy(), lines.closed.numpy()
    np.testing.assert_array_equal(lines.point.numpy()[:, 0], got_key)
    for i, follower in enumerate(expected):
        got = [
            (got_key[polyline_start[j] : polyline_start[j + 1]].tolist(), bool(closed[j]))
            for j in range(section_start[i], section_start[i + 1])
        ]
        ends = {k: v for k, v in follower.items() if v != OPEN}
        lone = [([k], False) for k, v in follower.items() if v == OPEN and k not in ends.values()]
        chains = [(chain, loop) for chain, loop in walk(ends)] + lone
        assert got == sorted(chains, key=lambda chain: min(chain[0]))


grid = st.integers(-12, 12).map(
    lambda i: i / 8
)  # the patch reaches from -1 to 1: corners and sides are hit all the time
fine = st.floats(-1.5, 1.5, width=32)


@st.composite
def regions(draw, coordinate):
    """A valid polygon, sometimes with a hole, as loops with the inside on the left."""
    corners = np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=9)))
    around = corners - corners.mean(axis=0)
    ring = shapely.Polygon(corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")])
    outer = shapely.orient_polygons(ring) if ring.is_valid and ring.area > 1e-3 else shapely.box(-0.5, -1.5, 1.25, 1.0)
    loops = [np.array(outer.exterior.coords)[:-1]]
    hole = shapely.Polygon(draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=5)))
    if hole.is_valid and hole.area > 1e-3 and outer.contains_properly(hole):
        loops.append(np.array(shapely.orient_polygons(hole).exterior.coords)[:-1][::-1])
    return [np.roll(loop, draw(st.integers(0, len(loop) - 1)), axis=0).astype(np.float32) for loop in loops]


def lines_of(loops, device):
    lines = Polylines()
    count = [len(loop) for loop in loops]
    total = sum(count)
    lines.section_start = wp.array(np.array([0, len(loops)], np.int64), device=device)
    lines.polyline_start = wp.array(np.concatenate([[0], np.cumsum(count)]).astype(np.int64), device=device)
    lines.closed = wp.array(np.ones(len(loops), np.uint8), device=device)
    lines.side = wp.full(len(loops), wp.vec2i(-1, -1), dtype=wp.vec2i, device=device)
    lines.point = wp.array(np.concatenate(loops), dtype=wp.vec2d, device=device)
    lines.key = wp.array(np.arange(total, dtype=np.int32), device=device)
    lines.kind = wp.zeros(total, dtype=wp.uint8, device=device)
    return lines


def found_in(lines):
    """Length by kind, of a section's polylines, and how many there are that are longer than rounding."""
    start, closed, kind = lines.polyline_start.numpy(), lines.closed.numpy(), lines.kind.numpy()
    length, count = np.zeros(2), 0
    for j in range(len(closed)):
        rows = slice(start[j], start[j + 1])
        points = lines.point.numpy()[rows].astype(float)
        points = np.vstack([points, points[:1]]) if closed[j] else points
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        np.add.at(length, kind[rows][: len(steps)], steps)
        count += steps.sum() > 1e-5
    return length, count


def check_region(loops, device, *, counts):
    lines, patch = lines_of(loops, device), patches(device)
    pieces, winding = clip_polylines(lines, patch, EDGES)
    closed = close_polylines(pieces, patch, EDGES, winding)
    region = shapely.Polygon(loops[0].astype(float), [loop.astype(float) for loop in loops[1:]])
    box = shapely.box(-1, -1, 1, 1)
    inner = shapely.intersection(region.boundary, box).difference(box.boundary)
    both = shapely.intersection(region, box)
    solid = [g for g in shapely.get_parts(both) if g.geom_type == "Polygon" and g.area > 0]
    oc, oc_count = found_in(pieces)
    cc, cc_count = found_in(closed)
    assert oc[0] == pytest.approx(inner.length, abs=2e-5)
    assert cc.sum() == pytest.approx(sum(g.length for g in solid), abs=2e-5)
    assert cc[0] == pytest.approx(oc[0], abs=1e-6)
    assert closed.closed.numpy().all()
    assert set(closed.kind.numpy()) <= {0, HAND}
    if counts:
        lines = [g for g in shapely.get_parts(shapely.line_merge(inner)) if g.length > 1e-5]
        assert oc_count == len(lines)
        assert cc_count == sum(1 + len(g.interiors) for g in solid if g.length > 1e-5)


@once_a_device
@given(loops=regions(grid))
def test_regions_on_the_patchs_own_lines_are_clipped_and_closed_as_defined(loops, device):
    check_region(loops, device, counts=False)


@once_a_device
@given(loops=regions(fine))
def test_regions_anywhere_are_clipped_and_closed_as_shapely_does(loops, device):
    points = np.concatenate(loops)
    near = np.abs(np.abs(points) - 1).min() < 1e-5
    steps = [np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).min() for loop in loops]
    check_region(loops, device, counts=not near and min(steps) > 1e-4 and not passes_corner(loops))


def passes_corner(loops):
    """Whether a contour comes nearer to a corner of the patch than float32 can tell."""
    corners = shapely.points([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    return min(shapely.LinearRing(loop.astype(float)).distance(corners).min() for loop in loops) < 1e-5


def test_contours_of_tiny_triangles_are_chained_by_key_not_by_place(device):
    """A sphere of 20 um at 0.2 m: float32 merges its points, and still every section is one closed loop."""
    sphere = MeshObject.load("sphere")
    tiny = (sphere.vertices - np.array([0, 0, 0.2], np.float32)) * np.float32(1.5e-4)
    thing = MeshObject(tiny + np.array([0.07, 0.03, 0.2]), sphere.faces)
    pose = random_poses(60, 4)
    pose[:, :3] = [0.07, 0.03, 0.2]
    crossings = slice_mesh(thing.on(device), wp.array(pose, dtype=wp.transform, device=device), Palm().on(device))
    lines = chain_crossings(crossings)
    assert (np.diff(lines.section_start.numpy()) == 1).all()
    assert lines.closed.numpy().all()


def test_lengths_are_those_of_numpy(device, rng):
    points = rng.normal(size=(50, 3)).astype(np.float32)
    kind = rng.integers(0, 3, 50).astype(np.uint8)
    line, pose = np.array([0, 2, 30, 50]), np.array([0, 1, 1, 3])
    got = measure_contours(
        wp.array(points, dtype=wp.vec3, device=device),
        wp.array(kind, device=device),
        wp.array(line.astype(np.int64), device=device),
        wp.array(pose.astype(np.int64), device=device),
    ).numpy()
    expected = np.zeros((3, 3))
    for i, j in [(0, 0), (2, 1), (2, 2)]:
        for k in range(line[j], line[j + 1] - 1):
            expected[i, kind[k]] += np.linalg.norm(points[k + 1].astype(float) - points[k])
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_edges_shared_by_more_than_two_triangles_are_listed_once_a_pair():
    fan = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5], [0, 1, 6]]
    edges = wing_edges(np.array(fan))
    shared = (edges.end == [0, 1]).all(axis=1)
    assert shared.sum() == 3
    assert edges.face[shared].tolist() == [[0, 1], [2, 3], [4, OPEN]]
    assert edges.open_count == len(edges.end) - 2
