"""Repaired meshes on disk: the same result, never an error, nothing left behind, no more than the bound."""

import os
import subprocess
import sys

import numpy as np
import pytest

from palpate.render import MeshObject
from palpate.render.objects.mesh import kept_arrays, kept_repairs


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of its own, which keeps whatever is repaired, however fast."""
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setattr(kept_repairs, "SECONDS_LEAST", 0.0)
    return tmp_path / "meshes"


@pytest.fixture
def repairs(monkeypatch):
    """The number of triangles of each mesh that was repaired, not read."""
    seen, repair = [], kept_repairs.repair_mesh

    def counted(vertices, faces, *rest):
        seen.append(len(faces))
        return repair(vertices, faces, *rest)

    monkeypatch.setattr(kept_repairs, "repair_mesh", counted)
    return seen


def two_boxes():
    """Two unit cubes that overlap, one inside out, a wall inside and a triangle twice: much to repair."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads])
    vertices = np.concatenate([corners, corners + np.array([0.5, 0.25, 0.125])])
    return 0.1 * vertices, np.concatenate([faces, faces[:, ::-1] + 8, faces[:1]])


def same(one, two):
    """Whether two objects have the same bytes and the same report."""
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()
    assert one.report == two.report
    assert one.edges.twin.tobytes() == two.edges.twin.tobytes()
    return True


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_what_is_read_is_what_was_repaired(folder, repairs):
    first = MeshObject(*two_boxes())
    second = MeshObject(*two_boxes())
    assert repairs == [25]  # the second time nothing is
    assert first.report.bodies_united == 2
    assert same(first, second)
    third = MeshObject(two_boxes()[0].astype(np.float32), two_boxes()[1].astype(np.int32))  # 0.1 is another number
    assert repairs == [25, 25]
    assert third.report.bodies_united == 2


@pytest.mark.exhaustive(after=1)
@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.parametrize(
    "change", [{"solid": "even-odd"}, {"weld": 1e-6}, {"fill_holes": 0.01}, "a vertex", "a face", "a source"]
)
def test_another_mesh_option_or_version_never_reads_it(folder, repairs, change, monkeypatch):
    vertices, faces = two_boxes()
    MeshObject(vertices, faces)
    options = {}
    if change == "a vertex":
        vertices[3, 1] = np.nextafter(vertices[3, 1], 1)
    elif change == "a face":
        faces[4] = np.roll(faces[4], 1)
    elif change == "a source":
        monkeypatch.setattr(kept_repairs, "maker_digest", lambda *_: b"another version of palpate")
    else:
        options = change
    MeshObject(vertices, faces, **options)
    assert len(repairs) == 2


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.parametrize("kept", [0.0, 0.9])
def test_a_truncated_entry_is_repaired_anew_and_rewritten(folder, repairs, kept):
    first = MeshObject(*two_boxes())
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(whole[: int(kept * len(whole))])
    assert same(first, MeshObject(*two_boxes()))
    assert repairs == [25, 25]
    assert entry.stat().st_size == len(whole)
    MeshObject(*two_boxes())
    assert len(repairs) == 2


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_no_flipped_byte_changes_what_is_loaded(folder, rng):
    first = MeshObject(*two_boxes())
    (entry,) = folder.iterdir()
    whole = bytearray(entry.read_bytes())
    for place in rng.choice(len(whole), 60, replace=False):
        bad = whole.copy()
        bad[place] ^= 0x10
        entry.write_bytes(bad)
        assert same(first, MeshObject(*two_boxes()))


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_a_folder_that_cannot_be_written_and_a_full_disk_give_no_error(tmp_path, monkeypatch, folder, repairs):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "file"))
    MeshObject(*two_boxes())
    monkeypatch.setenv("PALPATE_CACHE", str(folder))

    def full(path, content):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(kept_arrays, "write_file", full)
        MeshObject(*two_boxes())
    assert list(folder.iterdir()) == []
    assert len(repairs) == 2


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_the_switch_the_place_and_fast_repairs(tmp_path, monkeypatch, repairs):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.setattr(kept_repairs, "SECONDS_LEAST", 0.0)
    monkeypatch.setenv("PALPATE_CACHE", "off")
    MeshObject(*two_boxes())
    assert list(tmp_path.iterdir()) == []
    monkeypatch.delenv("PALPATE_CACHE")
    assert kept_arrays.kept_folder() == tmp_path / "xdg" / "palpate" / "meshes"
    monkeypatch.setattr(kept_repairs, "SECONDS_LEAST", 1e9)
    MeshObject(*two_boxes())
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the XDG base directory specification
    monkeypatch.setenv("HOME", str(tmp_path))
    assert kept_arrays.kept_folder() == tmp_path / ".cache" / "palpate" / "meshes"
    assert len(repairs) == 2


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_entries_used_least_lately_are_deleted_and_nothing_else(folder, monkeypatch, repairs):
    folder.mkdir()
    other = folder / "thesis.pdf"
    other.write_bytes(bytes(100_000))
    os.utime(other, (0, 0))
    left = folder / f"{'0' * 64}.npz.0123456789ab.tmp"  # of a process that was killed
    left.write_bytes(bytes(50_000))
    os.utime(left, (0, 0))
    vertices, faces = two_boxes()
    for k in range(3):
        MeshObject(vertices + k, faces)
    entries = sorted(folder.glob("*.npz"))
    for k, path in enumerate(entries):
        os.utime(path, (100 + k, 100 + k))
    size = entries[0].stat().st_size
    monkeypatch.setattr(kept_arrays, "BYTES_MOST", 3 * size + size // 2)
    MeshObject(vertices + 3, faces)
    assert other.exists()
    assert not left.exists()
    assert not entries[0].exists()
    assert all(path.exists() for path in entries[1:])
    assert len(list(folder.glob("*.npz"))) == 3


@pytest.mark.exhaustive
def test_ctrl_c_while_a_mesh_is_loading_leaves_nothing_behind(tmp_path):
    script = (
        "import numpy as np, signal, os, sys\n"
        "from palpate.render.terminal import console; from palpate.render.objects.mesh import kept_repairs\n"
        "from palpate.render.objects.mesh.solid_mesh import MeshObject\n"
        "kept_repairs.SECONDS_LEAST = 0.0\n"
        "def watch(stage, done, total):\n"
        "    if stage == sys.argv[1]:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "def command():\n"
        "    return MeshObject.load('rock', watch=watch) and 0\n"
        "sys.exit(console.run(command, as_json=False))\n"
    )
    for stage in ("welding", "nesting"):
        environment = {**os.environ, "PALPATE_CACHE": str(tmp_path / "meshes")}
        run = subprocess.run(
            [sys.executable, "-c", script, stage], capture_output=True, text=True, env=environment, timeout=120
        )
        assert run.returncode == 1, run.stderr
        assert run.stderr.strip().endswith("error: interrupted")
        assert not (tmp_path / "meshes").exists()


@pytest.mark.exhaustive
def test_ctrl_c_while_a_render_is_loading_writes_no_file(tmp_path):
    script = (
        "import contextlib, os, signal, sys\n"
        "from palpate.render.terminal import bars\n"
        "from palpate.render.cli.app import main\n"
        "def watch(stage, done, total):\n"
        "    if stage in ('bodies', 'exploration'):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "bars.loading_bar = lambda title, quiet: contextlib.nullcontext(watch)\n"
        "main()\n"
    )
    arguments = ("render", "cube", "exploration", "--duration", "10000", "-o", "out.h5")
    run = subprocess.run(
        [sys.executable, "-c", script, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 1
    assert run.stderr.strip().endswith("error: interrupted")
    assert list(tmp_path.iterdir()) == []
