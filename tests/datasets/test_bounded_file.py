"""Files of strangers: pipes, bombs, lying headers and names that lead elsewhere are refused, in one sentence."""

import bz2
import gzip
import io
import json
import os
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest
from gltf_files import GltfFile
from hypothesis import given
from hypothesis import strategies as st

from palpate.datasets.array_file import ONLY, read_arrays
from palpate.datasets.bounded_file import (
    LIMIT_VARIABLE,
    FileBoundError,
    file_beside,
    open_regular,
    read_content,
    read_text,
    unpack,
)
from palpate.datasets.errors import MotionError, RecordingError, SweepStoreError
from palpate.datasets.focus_files.ptlist import PointListError, read_ptlist
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.recordings.alignment import alignment_pose
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.sweeps.table import load_table, write_table
from palpate.device.boards.pat16.board_file import read_pat
from palpate.device.errors import CalibrationError
from palpate.render.cli.trust_commands import code_of
from palpate.render.errors import ImplicitError, MeshError, PlanError, StrategyError, VoxelError
from palpate.render.hands.given_mesh import read_hand, region_of
from palpate.render.intersection.named_inputs import is_recording
from palpate.render.objects.functions.expression import load_expression
from palpate.render.objects.mesh.solid_mesh import read_mesh
from palpate.render.objects.voxels.files import read_volume
from palpate.render.playback.placed_arrays import load_rig
from palpate.render.sampling.presets import load_sampling
from palpate.render.strategies.intersection_strategy import load_strategy
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.plan.recipe import digest_source
from palpate.render.trust.user_code import CODE_MOST

LIMIT = 2_000_000  # of these tests [byte]
BOMB = bytes(20 * LIMIT)
READERS = {
    "a.csv": (HandMotion.load, MotionError),
    "b.csv": (load_recording, RecordingError),
    "a.npz": (load_recording, RecordingError),
    "a.json": (load_recording, RecordingError),
    "b.json": (alignment_pose, RecordingError),
    "c.json": (load_expression, ImplicitError),
    "d.json": (lambda path: load_strategy(str(path)), StrategyError),
    "e.json": (lambda path: load_sampling(str(path)), StrategyError),
    "f.json": (lambda path: load_rig(str(path)), StrategyError),
    "a.toml": (lambda path: load_plans([path], []), PlanError),
    "a.ptlist": (read_ptlist, PointListError),
    "a.parquet": (load_table, SweepStoreError),
    "a.pat": (read_pat, CalibrationError),
    "a.stl": (read_mesh, MeshError),
    "a.glb": (read_hand, MeshError),
    "a.txt": (lambda path: region_of(np.zeros((3, 3)), np.zeros((1, 3)), path, 90.0), MeshError),
    "a.npy": (read_volume, VoxelError),
    "v.npz": (read_volume, VoxelError),
    "a.nrrd": (read_volume, VoxelError),
    "a.nii": (read_volume, VoxelError),
    "a.nii.gz": (read_volume, VoxelError),
    "a.nvdb": (read_volume, VoxelError),
    "g.stl": (lambda path: digest_source(str(path)), PlanError),
}


@pytest.fixture(autouse=True)
def limit(monkeypatch):
    monkeypatch.setenv(LIMIT_VARIABLE, str(LIMIT // 10**6))


@pytest.fixture
def peak():
    """Memory that Python and NumPy have taken at most since the test began [byte]."""
    pytest.importorskip("trimesh")  # which takes more than any of these files may
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


# --- what is opened ------------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_refused_by_every_reader_without_waiting_for_its_writer(name, tmp_path):
    read, error = READERS[name]
    os.mkfifo(tmp_path / name)
    with pytest.raises(error, match=r"regular file|is_recording"):
        read(tmp_path / name)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", sorted(set(READERS) - {"a.pat"}))
def test_a_file_beyond_the_budget_is_refused_before_it_is_read(name, tmp_path, peak):
    read, error = READERS[name]
    with (tmp_path / name).open("wb") as file:
        file.truncate(400 * LIMIT)
    with pytest.raises(error, match=f"more than the {LIMIT} that one file may: {LIMIT_VARIABLE}=800"):
        read(tmp_path / name)
    assert peak() < 10 * LIMIT


@pytest.mark.parametrize("name", ["notes.py:ball", "notes.py", "strategy.json"])
def test_a_file_of_code_is_bounded_before_anybody_permits_it(name, tmp_path, peak):
    """Under the budget of data, as code is listed in dry runs too."""
    with (tmp_path / "notes.py").open("wb") as file:
        file.truncate(CODE_MOST + 1)
    (tmp_path / "strategy.json").write_text('{"raw": "section", "modules": ["notes"]}')
    with pytest.raises((ImplicitError, StrategyError), match=f"more than the {CODE_MOST} that"):
        code_of(str(tmp_path / name))
    assert peak() < CODE_MOST


def test_devices_sockets_folders_and_pipes_are_no_regular_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/null", tmp_path / "pipe"):
        with pytest.raises(FileBoundError, match="is no regular file"):
            open_regular(path)
    with pytest.raises(OSError, match="directory"):
        open_regular(tmp_path)
    assert not is_recording(str(tmp_path / "pipe"))


def test_a_limit_that_is_no_number_of_megabytes_is_named(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"x")
    for text in ("0", "-1", "2.5", "many", "9" * 40):
        monkeypatch.setenv(LIMIT_VARIABLE, text)
        with pytest.raises(FileBoundError, match=f"{LIMIT_VARIABLE} must be a whole number of megabytes"):
            read_content(tmp_path / "a")
    monkeypatch.delenv(LIMIT_VARIABLE)
    assert read_content(tmp_path / "a") == b"x"


@pytest.mark.exhaustive
@given(st.text())
def test_text_is_read_as_python_reads_it(text):
    path = f"/dev/shm/palpate-{os.getpid()}" if os.path.isdir("/dev/shm") else f"text-{os.getpid()}"
    try:
        with open(path, "w", encoding="utf-8-sig", newline="") as file:
            file.write(text)
        with open(path, encoding="utf-8-sig") as file:
            assert read_text(path) == file.read()
    finally:
        os.unlink(path)


# --- what is unpacked ----------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("pack", "codec"), [(gzip.compress, "gzip"), (bz2.compress, "bzip2"), (zlib.compress, "zlib")])
def test_what_unpacks_to_more_than_the_budget_is_refused_within_it(pack, codec, peak):
    packed = pack(BOMB)
    assert unpack(pack(b"palpate"), codec, 7) == b"palpate"
    with pytest.raises(FileBoundError, match="takes more than the 6 bytes that are declared"):
        unpack(pack(b"palpate"), codec, 6)
    with pytest.raises(FileBoundError, match="what is packed in it takes"):
        unpack(packed, codec)
    with pytest.raises(ValueError, match="damaged where it is packed"):
        unpack(b"\x1f\x8b" + packed[3:40], codec)
    assert peak() < 5 * LIMIT + len(packed)


def zipped(members):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return content.getvalue()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("read", [read_volume, load_recording])
@pytest.mark.parametrize("name", ["values", "affine", "t"])
def test_arrays_are_judged_by_their_headers(read, name, tmp_path, peak):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **{"values": np.zeros((3, 3, 3)), "affine": np.eye(4), name: np.zeros(10 * LIMIT, "u1")})
    assert path.stat().st_size < LIMIT
    with pytest.raises((VoxelError, RecordingError), match="what its arrays hold takes"):
        read(path)
    assert peak() < 45 * LIMIT  # tracemalloc counts the arrays that this test made, too


def test_an_array_of_another_size_than_its_file_is_refused_before_it_is_made(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000, 10), }"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header + b"\n" + bytes(64)
    (tmp_path / "a.npy").write_bytes(content)
    (tmp_path / "a.npz").write_bytes(zipped({"t.npy": content}))
    for name in ("a.npy", "a.npz"):
        with pytest.raises(ValueError, match=r"does not fit the 14\d bytes"):
            read_arrays(tmp_path / name)
    np.save(tmp_path / "b.npy", np.arange(6.0).reshape(2, 3).T)
    np.testing.assert_array_equal(read_arrays(tmp_path / "b.npy")[ONLY], np.arange(6.0).reshape(2, 3).T)


@pytest.mark.exhaustive
def test_volumes_that_are_packed_are_judged_too(tmp_path):
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    small = (np.ones((9, 9, 9)), np.eye(4))
    image = nibabel.Nifti1Image(*small).to_bytes()
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(image + BOMB))
    nrrd.write(str(tmp_path / "a.nrrd"), small[0])
    head = (tmp_path / "a.nrrd").read_bytes().partition(b"\n\n")[0] + b"\n\n"
    (tmp_path / "a.nrrd").write_bytes(head + gzip.compress(BOMB))
    for name, bound in (
        ("a.nii.gz", f"more than the {352 + 8 * 9**3} bytes that are declared"),
        ("a.nrrd", f"more than the {8 * 9**3} bytes that are declared"),
    ):
        with pytest.raises(VoxelError, match=f"what is packed in it takes.*({bound})"):
            read_volume(tmp_path / name)
    (tmp_path / "b.nrrd").write_bytes(head + gzip.compress(bytes(8 * 9**3 + 1)))
    with pytest.raises(VoxelError, match="more than the 5832 bytes that are declared"):
        read_volume(tmp_path / "b.nrrd")
    whole = np.arange(27.0).tobytes()
    raw = head.replace(b"gzip", b"raw").replace(b"9 9 9", b"3 3 3")
    (tmp_path / "d.nrrd").write_bytes(raw + whole + b"more")
    with pytest.raises(VoxelError, match="more data than its sizes"):
        read_volume(tmp_path / "d.nrrd")
    last = head.replace(b"9 9 9", b"3 3 3\nbyte skip: -1")  # the data are the last bytes of what is packed
    (tmp_path / "e.nrrd").write_bytes(last + gzip.compress(b"before" + whole))
    assert read_volume(tmp_path / "e.nrrd").values.T.tobytes() == whole
    large = nibabel.Nifti1Image(np.zeros((80, 80, 80), np.int16), np.eye(4))
    large.header.set_slope_inter(2.0, 1.0)  # so that each of 2 bytes becomes one of 8
    (tmp_path / "c.nii.gz").write_bytes(gzip.compress(large.to_bytes()))
    with pytest.raises(VoxelError, match=f"what its values hold takes {8 * 80**3} bytes"):
        read_volume(tmp_path / "c.nii.gz")


def test_a_packed_grid_of_nanovdb_is_judged(tmp_path):
    front = struct.pack("<QIHH", 0x324244566F6E614E, 32 << 21, 1, 1) + bytes(176)
    packed = zlib.compress(BOMB)
    (tmp_path / "a.nvdb").write_bytes(front + struct.pack("<Q", len(packed)) + packed)
    with pytest.raises(VoxelError, match="what is packed in it takes more than the 0 bytes that are declared"):
        read_volume(tmp_path / "a.nvdb")
    front = front[:16] + struct.pack("<Q", 1 << 62) + front[24:]
    (tmp_path / "b.nvdb").write_bytes(front + struct.pack("<Q", len(packed)) + packed)
    with pytest.raises(VoxelError, match=f"what is packed in it takes {LIMIT + 1} bytes"):
        read_volume(tmp_path / "b.nvdb")


@pytest.mark.exhaustive
def test_a_parquet_table_of_one_value_a_billion_times_is_judged_by_its_rows(tmp_path):
    pytest.importorskip("pyarrow")
    write_table(tmp_path / "a.parquet", {"a": np.zeros(3 * LIMIT)})
    assert (tmp_path / "a.parquet").stat().st_size < LIMIT
    with pytest.raises(SweepStoreError, match="its table takes"):
        load_table(tmp_path / "a.parquet")
    write_table(tmp_path / "b.parquet", {"a": ["x" * 20_000] * 10_000, "b": ["y", None] * 5_000})
    columns = load_table(tmp_path / "b.parquet")  # 200 MB, were each text one of its own
    assert len({id(text) for text in columns["a"]}) == 1
    assert columns["a"][7] == "x" * 20_000
    assert list(columns["b"][:2]) == ["y", ""]


def test_a_parquet_text_that_is_no_utf_8_is_named(tmp_path):
    pytest.importorskip("pyarrow")
    write_table(tmp_path / "a.parquet", {"a": ["palpate"]})
    content = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "a.parquet").write_bytes(content.replace(b"palpate", b"\xff" * 7, 1))
    with pytest.raises(SweepStoreError, match=r"a\.parquet cannot be read"):
        load_table(tmp_path / "a.parquet")


# --- what is parsed ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.json", "b.json", "c.json", "d.json", "e.json", "f.json"])
def test_json_nested_too_deeply_is_named(name, tmp_path):
    read, error = READERS[name]
    for text in ("[" * 9_000, '{"of":' * 9_000, "[" * 9_000 + "]" * 9_000, "[" * 900 + "]" * 900):
        (tmp_path / name).write_text(text)
        with pytest.raises(error):
            read(tmp_path / name)
    (tmp_path / name).write_text("[" * 9_000 + "]" * 9_000)
    with pytest.raises(error, match="deep in each other"):
        read(tmp_path / name)


def test_a_line_without_an_end_is_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"x,y,z,qx,qy,qz,qw\n" + b"0," * (LIMIT // 3))
    with pytest.raises(MotionError, match="line 2: has more than 1048576 characters"):
        HandMotion.load(tmp_path / "a.csv")


@pytest.mark.exhaustive
def test_a_csv_of_short_numbers_is_counted_as_the_table_it_becomes(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"x,y,z,qx,qy,qz,qw\n" + b"0,0,0,0,0,0,1\n" * (LIMIT // 15))
    with pytest.raises(MotionError, match="the table in it takes"):
        HandMotion.load(tmp_path / "a.csv")


def test_text_meshes_are_judged_by_the_memory_that_parsing_takes(tmp_path, peak):
    (tmp_path / "a.off").write_bytes(b"OFF\n30000 1 0\n" + b"0 0 1\n" * 30_000 + b"3 0 1 2\n")
    with pytest.raises(MeshError, match="what its text holds takes"):
        read_mesh(tmp_path / "a.off")
    assert peak() < 3 * LIMIT


# --- what another file names ---------------------------------------------------------------------


def test_a_name_leads_to_no_other_folder(tmp_path):
    folder, secret = tmp_path / "in", tmp_path / "secret"
    (folder / "below").mkdir(parents=True)
    for path in (secret, folder / "a", folder / "below" / "b"):
        path.write_bytes(b"x")
    (folder / "link").symlink_to(secret)
    (folder / "inner").symlink_to(folder / "a")
    (folder / "loop").symlink_to(folder / "loop")
    os.mkfifo(folder / "pipe")
    for name in ("../secret", str(secret), str(folder / "a"), "link", "below/../../secret"):
        with pytest.raises(FileBoundError, match="must lie in the folder of head"):
            file_beside(folder / "head.nhdr", name)
    for name in ("pipe", "missing", "below", "", "loop", "a\0b", "n" * 300):
        with pytest.raises(FileBoundError, match="names the file"):
            file_beside(folder / "head.nhdr", name)
    assert file_beside(folder / "head.nhdr", "below/b") == folder / "below" / "b"
    assert file_beside(folder / "head.nhdr", "inner") == folder / "a"


@pytest.mark.parametrize("name", ["../secret.raw", "/dev/zero", "link.raw", "pipe.raw"])
def test_headers_of_volumes_and_scenes_name_files_of_their_folder_only(name, tmp_path):
    pytest.importorskip("nrrd")
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "secret.raw").write_bytes(bytes(27 * 8))
    (folder / "link.raw").symlink_to(tmp_path / "secret.raw")
    os.mkfifo(folder / "pipe.raw")
    head = f"NRRD0004\ntype: double\ndimension: 3\nsizes: 3 3 3\nencoding: raw\nendian: little\ndata file: {name}\n\n"
    (folder / "a.nhdr").write_text(head)
    scene = GltfFile()
    scene.mesh()
    (folder / "a.gltf").write_text(json.dumps(scene.tree | {"buffers": [{"uri": name, "byteLength": 48}]}))
    for path, read, error in (("a.nhdr", read_volume, VoxelError), ("a.gltf", read_mesh, MeshError)):
        with pytest.raises(error, match=r"names the file .*(folder|regular)"):
            read(folder / path)
        with pytest.raises(PlanError, match=r"names the file .*(folder|regular)"):
            digest_source(str(folder / path))
