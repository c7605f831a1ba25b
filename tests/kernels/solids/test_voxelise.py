"""Meshes as voxels against slow sums over all triangles: closed, open, dirty ones; distances, holes, bad input."""

import numpy as np
import pytest
import trimesh
from depth_oracle import windings
from mesh_cases import CLOSED, MIDDLE, OPEN_OR_ODD, bowl, built_in, flipped, merged, moved, triangle
from scipy.ndimage import label

from palpate.kernels.solids.voxelise import GridNodes, cross_columns, measure_distances, wind_nodes
from palpate.render import MeshObject, Placement
from palpate.render.errors import MeshError, PalpateWarning, VoxelError
from palpate.render.objects.voxels.voxel_object import VoxelObject
from palpate.render.objects.voxels.voxeliser import voxelise, voxelise_file

pytestmark = pytest.mark.filterwarnings("ignore:.*open edges")  # most meshes here have holes, which loading reports


def node_points(nodes):
    index = np.stack(np.meshgrid(*(np.arange(n) for n in nodes.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    return nodes.origin + index * nodes.spacing


def grid_over(vertices, count=(9, 8, 10), margin=0.004, shift=0.0):
    low, high = vertices.min(axis=0) - margin + shift, vertices.max(axis=0) + margin
    return GridNodes(low, (high - low) / (np.array(count) - 1), count)


def distances(points, vertices, faces):
    """To the nearest of all triangles (trimesh)."""
    return trimesh.proximity.closest_point_naive(trimesh.Trimesh(vertices, faces, process=False), points)[1]


def meshed(name):
    vertices, faces = (CLOSED | OPEN_OR_ODD)[name]()
    return MeshObject(vertices, faces, name=name)


@pytest.mark.exhaustive(after=1)
@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.parametrize("name", CLOSED)
def test_crossings_are_inside_where_the_winding_number_is_above_a_half(name, device):
    thing = meshed(name)
    vertices = thing.vertices.astype(float)
    nodes = grid_over(vertices, shift=0.00123)
    inside = cross_columns(vertices, thing.faces, nodes, odd=False, device=device)
    expected = windings(vertices, thing.faces, node_points(nodes)) > 0.5
    np.testing.assert_array_equal(inside.ravel() > 0, expected)
    assert 0 < expected.sum() < len(expected)
    odd = cross_columns(vertices, thing.faces, nodes, odd=True, device=device)
    np.testing.assert_array_equal(odd, inside)  # of simple surfaces


@pytest.mark.parametrize("name", ["cube", "tube", "dog", "shell"])
def test_columns_through_vertices_and_edges_do_not_leak(name, device):
    thing = meshed(name)
    vertices = thing.vertices.astype(float)
    steps = []
    for axis in range(2):  # columns exactly through vertices' x and y
        there = np.unique(vertices[:, axis])
        for low in there[:: max(1, len(there) // 4)]:
            for other in there[:: max(1, len(there) // 3)]:
                if other > low:
                    steps.append((axis, low, other - low))
    for axis, low, step in steps:
        spacing = np.full(3, 0.011)
        spacing[axis] = step
        origin = vertices.min(axis=0) - 2 * spacing + [0.0011, 0.0013, 0.0007]
        origin[axis] = low - 2 * step
        shape = tuple(int(n) for n in np.ceil((vertices.max(axis=0) - origin) / spacing) + 3)
        inside = cross_columns(vertices, thing.faces, GridNodes(origin, spacing, shape), odd=False, device=device)
        assert not inside[:, :, -1].any()
        assert not inside[:, :, 0].any()
        points = node_points(GridNodes(origin, spacing, shape))[inside.ravel() > 0]
        assert ((points >= vertices.min(axis=0) - 1e-9) & (points <= vertices.max(axis=0) + 1e-9)).all()


def test_columns_along_edges_do_not_leak_however_they_round(rng, device):
    """Both triangles of an edge give the same answer to columns that are on it but for rounding."""
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    corners = rng.normal(size=(60, 4, 3))
    for vertices in corners:
        if np.linalg.det(vertices[1:] - vertices[0]) < 0:
            vertices[:2] = vertices[1::-1].copy()
        one, two = (np.array([0, 0, 0, 1, 1, 2]), np.array([1, 2, 3, 2, 3, 3]))
        share = rng.uniform(0.1, 0.9, 6)[:, None]
        for at in (1 - share) * vertices[one] + share * vertices[two]:
            nodes = GridNodes(np.array([at[0], at[1], -9.0]), np.array([1e-9, 1e-9, 9.0]), (1, 1, 3))
            inside = cross_columns(vertices, faces, nodes, odd=False, device=device)
            assert not inside[0, 0, 2]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", [*OPEN_OR_ODD, "sphere", "shell", "egg box"])
def test_winding_numbers_are_the_sum_over_triangles(name, device):
    vertices, faces = (OPEN_OR_ODD | CLOSED)[name]()
    vertices = vertices.astype(float)
    nodes = grid_over(vertices, count=(7, 8, 6), margin=0.02, shift=0.00123)
    found = wind_nodes(vertices, faces, nodes, device).ravel()
    expected = windings(vertices, faces, node_points(nodes))
    assert np.abs(found - expected).max() < 0.1
    assert np.abs(found - expected).mean() < 0.01
    near = np.abs(expected - 0.5) < 0.1
    assert np.abs(found - expected)[near].max(initial=0.0) < 5e-3


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["cube", "dog", "fan", "soup"])
def test_distances_are_to_the_nearest_point(name, device):
    vertices, faces = (OPEN_OR_ODD | CLOSED)[name]()
    vertices = vertices.astype(float)
    nodes = grid_over(vertices, count=(7, 6, 7))
    expected = distances(node_points(nodes), vertices, faces)
    found = measure_distances(vertices, faces, nodes, band=1.0, device=device)
    np.testing.assert_allclose(found.ravel(), expected, atol=2e-7)
    cut = measure_distances(vertices, faces, nodes, band=0.005, device=device)
    np.testing.assert_allclose(cut.ravel(), np.minimum(expected, 0.005), atol=2e-7)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("spacing", "count"), [(0.0006, (100, 205, 4)), (0.0001, (320, 700, 3))])
def test_long_thin_triangles_lose_no_precision(spacing, count, device):
    """The cylinder is the truth: 130 mm high triangles, 0.5 mm wide, of which Warp's float32 search mistakes some."""
    inner, outer, height = 0.035, 0.06, 0.13
    tube = trimesh.creation.annulus(r_min=inner, r_max=outer, height=height, sections=400)
    mesh = MeshObject(tube.vertices + MIDDLE, tube.faces)
    facet = outer * (1 - np.cos(np.pi / 400))
    nodes = GridNodes(np.array([-0.0612, -0.0612, 0.1763]), np.full(3, spacing), count)
    x = node_points(nodes)
    radius = np.hypot(x[:, 0], x[:, 1])
    exact = np.minimum(np.abs(radius - inner), np.abs(radius - outer))
    found = measure_distances(mesh.vertices.astype(float), mesh.faces, nodes, band=4 * spacing, device=device).ravel()
    near = exact < spacing * np.sqrt(3) - facet
    assert near.sum() > 1000
    assert np.abs(found - exact)[near].max() <= facet + 1e-8


@pytest.mark.exhaustive
def test_distance_and_occupancy_are_the_mesh_in_numpy(device):
    thing = MeshObject(*built_in("dog"))
    nodes_per = {}
    for kind in ("distance", "occupancy"):
        voxels = voxelise(thing, spacing=(0.008, 0.006, 0.007), kind=kind, device=device)
        nodes = GridNodes(voxels.affine[:3, 3], np.diag(voxels.affine)[:3], voxels.values.shape)
        points = node_points(nodes)
        vertices = thing.vertices.astype(float)
        inside = windings(vertices, thing.faces, points) > 0.5
        np.testing.assert_array_equal(voxels.values.ravel() < 0, inside)
        nodes_per[kind] = (points, inside, voxels)
    points, inside, voxels = nodes_per["distance"]
    far = distances(points, thing.vertices.astype(float), thing.faces)
    np.testing.assert_allclose(voxels.values.ravel(), np.where(inside, -far, far), atol=2e-7)


@pytest.mark.exhaustive
def test_an_open_bowl_is_closed_over_its_rim_without_leaks(device):
    thing = MeshObject(*bowl(), name="bowl")
    with pytest.raises(MeshError, match="open edges"):
        thing.require_closed()
    voxels = voxelise(thing, spacing=0.004, device=device)
    inside = voxels.values < 0
    whole = voxelise(MeshObject(*built_in("sphere")), spacing=0.004, device=device)
    assert label(inside)[1] == label(~inside)[1] == 1
    assert 0.6 * whole.inside_count < voxels.inside_count < 0.8 * whole.inside_count
    assert (voxels.bounds[0] >= thing.bounds[0] - 1e-6).all()
    assert (voxels.bounds[1] <= thing.bounds[1] + [1e-6, 1e-6, 0.01]).all()
    assert voxels.source["sign"] == "winding"
    assert voxels.source["hole_points"] > 100
    for axis in range(3):  # a distance everywhere, across what closes the mouth too
        assert np.abs(np.diff(voxels.values, axis=axis)).max() <= 0.004 * (1 + 1e-4)


def test_bodies_of_an_open_mesh_that_face_inwards_are_turned_and_counted(device):
    one, two = moved(bowl(), scale=0.4, by=(-0.03, 0, 0)), moved(bowl(), scale=0.4, by=(0.03, 0, 0))
    right = voxelise(MeshObject(*merged(one, two)), spacing=0.004, device=device)
    with pytest.warns(PalpateWarning, match="1 of its bodies"):
        turned = voxelise(MeshObject(*merged(one, flipped(two))), spacing=0.004, device=device)
    np.testing.assert_array_equal(turned.values < 0, right.values < 0)
    np.testing.assert_allclose(turned.values, right.values, atol=1e-7)
    assert turned.source["bodies_turned"] == 1


@pytest.mark.parametrize("kind", ["distance", "occupancy"])
def test_bodies_that_overlap_in_an_open_mesh_leave_no_voids_where_nodes_lie_on_them(kind, device):
    """In binary fractions, so that whole layers of nodes lie on faces of one box that are within the other."""
    one, two = (
        trimesh.creation.box((1 / 16,) * 3, transform=trimesh.transformations.translation_matrix((x, 0, 0.25)))
        for x in (0, 1 / 32)
    )
    vertices, faces = merged((one.vertices, one.faces), (two.vertices, two.faces))
    end = (vertices[faces][:, :, 0] == 1 / 16).all(axis=1)
    thing = MeshObject(vertices, np.delete(faces, np.flatnonzero(end)[0], axis=0), name="torn")
    voxels = voxelise(thing, spacing=1 / 256, kind=kind, device=device)
    assert voxels.source["sign"] == "winding"
    assert label(voxels.values >= 0)[1] == 1
    whole = trimesh.Trimesh(*voxels.outline_mesh(), process=False)
    assert whole.body_count == 1
    assert whole.volume == pytest.approx((1 / 16) ** 2 * 3 / 32, rel=0.02 if kind == "distance" else 0.2)


def test_parity_serves_a_closed_surface_whose_sides_do_not_agree(device):
    """Four faces of an octahedron and its three middle squares: one side only, but every column crosses it in pairs."""
    vertices = MIDDLE + 0.05 * np.concatenate([np.eye(3), -np.eye(3)])
    thin = [[0, 1, 2], [0, 4, 5], [3, 1, 5], [3, 4, 2]]
    squares = [[0, 1, 3, 4], [1, 2, 4, 5], [2, 3, 5, 0]]
    faces = thin + [t for a, b, c, d in squares for t in ([a, b, c], [a, c, d])]
    thing = MeshObject(vertices, np.array(faces))
    assert thing.report.crossed_edges
    with pytest.raises(MeshError, match="needs sides that agree"):
        voxelise(thing, spacing=0.01, sign="crossings", device=device)
    voxels = voxelise(thing, spacing=0.0038, device=device)  # no node lies where the octants meet
    assert voxels.source["sign"] == "parity"
    index = np.argwhere(voxels.values < 0)
    points = index @ voxels.affine[:3, :3].T + voxels.affine[:3, 3] - MIDDLE
    assert (np.prod(np.sign(points), axis=1) >= 0).mean() > 0.99  # the four octants under the four faces
    assert np.abs(points).sum(axis=1).max() < 0.05
    assert voxels.inside_count * 0.0038**3 == pytest.approx(4 * 0.05**3 / 6, rel=0.1)


def test_a_missing_dimension_and_other_bad_input_are_named(device):
    cube = MeshObject(*built_in("cube"), name="cube")
    cases = [
        ({"spacing": 0.0}, VoxelError, "spacing must be one or three positive lengths in metres, not 0.0"),
        ({"spacing": (0.01, -1, 0.01)}, VoxelError, "spacing"),
        ({"spacing": np.nan}, VoxelError, "spacing"),
        ({"spacing": (0.01, 0.01)}, VoxelError, "spacing"),
        ({"spacing": 1e-5}, VoxelError, "13005 x 13005 x 13005 voxels; 715827882 are allowed"),
        ({"spacing": 0.01, "margin": -1.0}, VoxelError, "margin"),
        ({"spacing": 0.01, "band": 0.001}, VoxelError, "band must be at least two voxels, 0.02 m, not 0.001"),
        ({"spacing": 0.01, "kind": "labels"}, VoxelError, "kind"),
        ({"spacing": 0.01, "sign": "normal"}, VoxelError, "sign must be one of auto, crossings, parity, winding"),
    ]
    cases += [
        ({"spacing": "fine"}, VoxelError, "spacing must be one or three .* 'fine'"),
        ({"spacing": 0.01, "margin": "wide"}, VoxelError, "margin must be a length .* 'wide'"),
        ({"spacing": 0.01, "band": "wide"}, VoxelError, "band must be .* 'wide'"),
        ({"spacing": 0.01, "kind": None}, VoxelError, "kind must be .* not None"),
        ({"spacing": 0.01, "sign": ["auto"]}, VoxelError, "sign must be one of"),
    ]
    for options, error, message in cases:
        with pytest.raises(error, match=message):
            voxelise(cube, device=device, **options)
    for unknown in ("abacus", "cuda:99", 3.5):
        with pytest.raises(VoxelError, match=r"device must be one of cpu.*, not "):
            voxelise(cube, spacing=0.01, device=unknown)
    with pytest.raises(VoxelError, match="a MeshObject is voxelised, not 5"):
        voxelise(5, spacing=0.01, device=device)
    with pytest.raises(MeshError, match="needs a closed surface; it has 44 open edges"):
        voxelise(MeshObject(*bowl()), spacing=0.01, sign="parity", device=device)
    with pytest.raises(VoxelError, match="too open to hold anything"):
        voxelise(MeshObject(*triangle()), spacing=0.005, device=device)
    thin = MeshObject(*moved(built_in("cube"), scale=0.01))
    with pytest.raises(VoxelError, match="thinner than the spacing"):
        voxelise(thin, spacing=(0.01, 0.01, 0.013), margin=0.02, device=device)


def test_a_band_changes_nothing_near_the_surface(device):
    thing = MeshObject(*built_in("tube"))
    one = voxelise(thing, spacing=0.005, device=device)
    two = voxelise(thing, spacing=0.005, band=0.012, device=device)
    np.testing.assert_allclose(two.values, np.clip(one.values, -0.012, 0.012), atol=1e-8)


def test_a_file_of_voxels_is_made_of_a_mesh_file(tmp_path, device):
    said = voxelise_file(
        "tube", tmp_path / "tube.npz", spacing=0.005, device=device, placement=Placement(at=(0, 0, 0.3))
    )
    voxels = VoxelObject.load(tmp_path / "tube.npz")
    assert said["inside"] == voxels.inside_count
    np.testing.assert_allclose(voxels.bounds.mean(axis=0), [0, 0, 0.3], atol=1e-6)
    np.testing.assert_allclose(np.ptp(voxels.bounds, axis=0), 0.13, atol=2e-3)
