"""Repaired meshes and half-edges on disk: the same bytes, never of another mesh, damage found, within the bound."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.kernels.section.half_edges import HalfEdges
from palpate.render import MeshObject
from palpate.render.objects.mesh import cache

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of its own, which keeps whatever is made, however fast."""
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setattr(cache, "REPAIR_SECONDS", 0.0)
    monkeypatch.setattr(cache, "EDGES_SECONDS", 0.0)
    return tmp_path / "meshes"


@pytest.fixture
def repairs(monkeypatch):
    """The number of triangles of each mesh that was repaired, not read."""
    seen, repair = [], cache.repair_mesh
    monkeypatch.setattr(cache, "repair_mesh", lambda v, f, *rest: (seen.append(len(f)), repair(v, f, *rest))[1])
    return seen


@pytest.fixture
def made(monkeypatch):
    """The number of triangles of each mesh whose half-edges were made, not read."""
    seen = []

    class Counted(HalfEdges):
        def __init__(self, vertices, faces):
            seen.append(len(faces))
            super().__init__(vertices, faces)

    monkeypatch.setattr(cache, "HalfEdges", Counted)
    return seen


def two_boxes():
    """Two unit cubes that overlap, one inside out, a wall inside and a triangle twice: much to repair."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads])
    vertices = np.concatenate([corners, corners + np.array([0.5, 0.25, 0.125])])
    return 0.1 * vertices, np.concatenate([faces, faces[:, ::-1] + 8, faces[:1]])


def ball():
    """A sphere of 40 mm, whose faces are in no order of space."""
    mesh = trimesh.creation.icosphere(2, radius=0.04)
    shuffled = np.random.default_rng(3).permutation(len(mesh.faces))
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces)[shuffled]


def require_same(one, two):
    """Assert that two objects have the same bytes and the same report."""
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()
    assert one.report == two.report


def require_same_edges(one, two):
    """Assert that two HalfEdges have the same bytes."""
    for name in ("vertices", "faces", "order", "twin", "link", "rank"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    assert one.boxes.centre.tobytes() == two.boxes.centre.tobytes()
    assert one.boxes.half.tobytes() == two.boxes.half.tobytes()


@pytest.mark.parametrize(
    ("sources", "maker"),
    [(cache.REPAIR_SOURCES, "render/objects/mesh/repair.py"), (cache.EDGES_SOURCES, "kernels/section/half_edges.py")],
)
def test_every_source_that_decides_about_the_result_is_in_the_key(sources, maker):
    found, waiting = set(), [ROOT / maker]
    while waiting:
        path = waiting.pop()
        found.add(path)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = path.parents[node.level - 1]
                named = base.joinpath(*(node.module or "").split(".")).with_suffix(".py")
                waiting += [named] if named.exists() and named not in found else []
    assert {str(path.relative_to(ROOT)) for path in found} == set(sources)


def test_what_is_read_is_what_was_repaired(folder, repairs):
    first = MeshObject(*two_boxes())
    require_same(first, MeshObject(*two_boxes()))
    assert repairs == [25]  # the second time nothing is
    assert first.report.bodies_united == 2
    third = MeshObject(two_boxes()[0].astype(np.float32), two_boxes()[1].astype(np.int32))  # 0.1 is another number
    assert repairs == [25, 25]
    assert third.report.bodies_united == 2


@pytest.mark.parametrize("rim", [0, 1])  # triangles left out: open edges have no twin
def test_half_edges_that_are_read_are_those_that_were_made(folder, made, rim):
    vertices, faces = ball()
    first, second = (cache.edges_of_mesh(vertices, faces[rim:], "a mesh") for _ in range(2))
    assert made == [320 - rim]
    assert first.open_count == 3 * rim
    require_same_edges(first, second)
    require_same_edges(first, HalfEdges(vertices, faces[rim:]))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("change", [{"solid": "even-odd"}, {"weld": 1e-6}, {"fill_holes": 0.01}, "a vertex", "a face"])
def test_another_mesh_or_option_never_reads_it(folder, repairs, change):
    vertices, faces = two_boxes()
    MeshObject(vertices, faces)
    if change == "a vertex":
        vertices[3, 1] = np.nextafter(vertices[3, 1], 1)
    elif change == "a face":
        faces[4] = np.roll(faces[4], 1)
    MeshObject(vertices, faces, **(change if isinstance(change, dict) else {}))
    assert len(repairs) == 2


@pytest.mark.parametrize("change", ["identity", "a source", "off"])
def test_another_version_never_reads_it(folder, made, repairs, change, monkeypatch):
    for name in ("a mesh", "another" if change == "identity" else "a mesh"):
        cache.edges_of_mesh(*ball(), name)
        MeshObject(*two_boxes())
        if change == "a source":
            monkeypatch.setattr(cache, "maker_digest", lambda *_: b"another version of palpate")
        elif change == "off":
            monkeypatch.setenv("PALPATE_CACHE", "off")
    assert made == [320, 320]
    assert len(repairs) == 1 + (change != "identity")


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_a_truncated_entry_is_repaired_anew_and_rewritten(folder, repairs, share):
    first = MeshObject(*two_boxes())
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(whole[: int(share * len(whole))])
    require_same(first, MeshObject(*two_boxes()))
    assert entry.stat().st_size == len(whole)
    MeshObject(*two_boxes())
    assert repairs == [25, 25]


@pytest.mark.exhaustive
def test_no_flipped_byte_changes_what_is_loaded(folder, rng):
    first = MeshObject(*two_boxes())
    (entry,) = folder.iterdir()
    whole = bytearray(entry.read_bytes())
    for place in rng.choice(len(whole), 60, replace=False):
        bad = whole.copy()
        bad[place] ^= 0x10
        entry.write_bytes(bad)
        require_same(first, MeshObject(*two_boxes()))


@pytest.mark.parametrize(
    ("name", "fault"),
    [("order", "repeated"), ("order", "short"), ("twin", "missing"), ("twin", "negative"), ("half", "short")],
)
def test_an_entry_that_is_of_no_such_mesh_is_made_anew(folder, made, name, fault):
    whole = cache.edges_of_mesh(*ball(), "a mesh")
    (entry,) = folder.iterdir()
    with np.load(entry) as kept:
        arrays = dict(kept)
    if fault == "missing":
        del arrays[name]
    elif fault == "short":
        arrays[name] = arrays[name][:-1]
    else:
        arrays[name][5] = arrays[name][6] if fault == "repeated" else -7
    np.savez(entry, **arrays)
    for _ in range(2):  # it was rewritten
        require_same_edges(whole, cache.edges_of_mesh(*ball(), "a mesh"))
        assert made == [320, 320]


def test_a_folder_that_cannot_be_written_and_a_full_disk_give_no_error(tmp_path, monkeypatch, folder, repairs):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "file"))
    MeshObject(*two_boxes())
    monkeypatch.setenv("PALPATE_CACHE", str(folder))

    def full(path, content):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(cache, "write_file", full)
        MeshObject(*two_boxes())
    assert list(folder.iterdir()) == []
    assert len(repairs) == 2


def test_the_place_and_fast_repairs(tmp_path, monkeypatch, repairs):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("PALPATE_CACHE", raising=False)
    assert cache.kept_folder() == tmp_path / "xdg" / "palpate" / "meshes"
    monkeypatch.setattr(cache, "REPAIR_SECONDS", 1e9)
    MeshObject(*two_boxes())
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the XDG base directory specification
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache.kept_folder() == tmp_path / ".cache" / "palpate" / "meshes"


def test_entries_used_least_lately_are_deleted_and_nothing_else(folder, monkeypatch):
    folder.mkdir()
    other = folder / "thesis.pdf"
    other.write_bytes(bytes(100_000))
    left = folder / f"{'0' * 64}.npz.0123456789ab.tmp"  # of a process that was killed
    left.write_bytes(bytes(50_000))
    for path in (other, left):
        os.utime(path, (0, 0))
    vertices, faces = two_boxes()
    for k in range(3):
        MeshObject(vertices + k, faces)
    entries = sorted(folder.glob("*.npz"))
    for k, path in enumerate(entries):
        os.utime(path, (100 + k, 100 + k))
    size = entries[0].stat().st_size
    monkeypatch.setattr(cache, "BYTES_MOST", 3 * size + size // 2)
    MeshObject(vertices + 3, faces)
    assert other.exists()
    assert not left.exists()
    assert [path.exists() for path in entries] == [False, True, True]
    assert len(list(folder.glob("*.npz"))) == 3


@pytest.mark.exhaustive
def test_ctrl_c_while_a_mesh_is_loading_leaves_nothing_behind(tmp_path):
    script = (
        "import signal, os, sys\n"
        "from palpate.render.terminal import console; from palpate.render.objects.mesh import cache\n"
        "from palpate.render.objects.mesh.solid_mesh import MeshObject\n"
        "cache.REPAIR_SECONDS = 0.0\n"
        "def watch(stage, done, total):\n"
        "    if stage == 'nesting':\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.exit(console.run(lambda: MeshObject.load('rock', watch=watch) and 0, as_json=False))\n"
    )
    environment = {**os.environ, "PALPATE_CACHE": str(tmp_path / "meshes")}
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, timeout=120)
    assert run.returncode == 1, run.stderr
    assert run.stderr.strip().endswith("error: interrupted")
    assert not (tmp_path / "meshes").exists()
