"""Half-edges on disk: the same contours as without them, never read for another mesh, damage is found."""

import gc

import numpy as np
import pytest
import trimesh

from palpate.kernels.section.half_edges import HalfEdges
from palpate.render import MeshObject, render
from palpate.render.objects.mesh import kept_edges

PARTS = ("vertices", "faces", "order", "twin")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of its own, where half-edges are kept, however fast they are made."""
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setattr(kept_edges, "SECONDS_LEAST", 0.0)
    return tmp_path / "meshes"


@pytest.fixture
def made(monkeypatch):
    """The number of triangles of each mesh whose half-edges were made, not read."""
    seen = []

    class Counted(HalfEdges):
        def __init__(self, vertices, faces):
            seen.append(len(faces))
            super().__init__(vertices, faces)

    monkeypatch.setattr(kept_edges, "HalfEdges", Counted)
    return seen


def ball(subdivisions=2):
    """A sphere of 40 mm, whose faces are in no order of space."""
    mesh = trimesh.creation.icosphere(subdivisions, radius=0.04)
    shuffled = np.random.default_rng(3).permutation(len(mesh.faces))
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces)[shuffled]


def require_same(one, two):
    """Assert that two have the same bytes."""
    for name in PARTS:
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    assert one.boxes.centre.tobytes() == two.boxes.centre.tobytes()
    assert one.boxes.half.tobytes() == two.boxes.half.tobytes()
    assert np.array_equal(one.link, two.link)
    assert np.array_equal(one.rank, two.rank)


@pytest.mark.parametrize("rim", [0, 1])  # triangles left out: open edges have no twin
def test_what_is_read_is_what_was_made(folder, made, rim):
    vertices, faces = ball()
    first = kept_edges.edges_of_mesh(vertices, faces[rim:], "a mesh")
    second = kept_edges.edges_of_mesh(vertices, faces[rim:], "a mesh")
    assert made == [320 - rim]
    assert first.open_count == 3 * rim
    require_same(first, second)
    require_same(first, HalfEdges(vertices, faces[rim:]))


@pytest.mark.exhaustive  # two collections of all that pytest holds
def test_contours_are_the_same_bits(folder, made):
    poses = np.array([[0.0, 0.01, 0.2, 0.0, 0.0, 0.0, 1.0], [0.01, 0.0, 0.18, 0.5, 0.5, 0.5, 0.5]], np.float32)
    both = []
    for _ in range(2):  # half-edges are shared as long as an object has them
        batch = render(MeshObject(*ball(), at=(0, 0, 0.2)), "palm", poses, "cc")
        both.append(batch.points.tobytes() + batch.polyline_start.tobytes())
        assert batch.polyline_count == 2
        gc.collect()
    assert both[0] == both[1]
    assert made == [320]


@pytest.mark.parametrize("change", ["identity", "a source", "off"])
def test_another_mesh_or_version_never_reads_it(folder, made, change, monkeypatch):
    kept_edges.edges_of_mesh(*ball(), "a mesh")
    if change == "a source":
        monkeypatch.setattr(kept_edges, "maker_digest", lambda *_: b"another version of palpate")
    elif change == "off":
        monkeypatch.setenv("PALPATE_CACHE", "off")
    kept_edges.edges_of_mesh(*ball(), "another" if change == "identity" else "a mesh")
    assert made == [320, 320]


@pytest.mark.parametrize("name", ["order", "twin", "centre", "half"])
@pytest.mark.parametrize("fault", ["missing", "short", "repeated", "negative"])
def test_an_entry_that_is_of_no_such_mesh_is_made_anew(folder, made, name, fault):
    whole = kept_edges.edges_of_mesh(*ball(), "a mesh")
    (entry,) = folder.iterdir()
    with np.load(entry) as kept:
        arrays = dict(kept)
    if fault == "missing":
        del arrays[name]
    elif fault == "short":
        arrays[name] = arrays[name][:-1]
    elif name in ("centre", "half"):
        arrays[name] = arrays[name].ravel()
    else:
        arrays[name][5] = arrays[name][6] if fault == "repeated" else -7
    np.savez(entry, **arrays)
    require_same(whole, kept_edges.edges_of_mesh(*ball(), "a mesh"))
    assert made == [320, 320]
    kept_edges.edges_of_mesh(*ball(), "a mesh")
    assert made == [320, 320]  # it was rewritten
