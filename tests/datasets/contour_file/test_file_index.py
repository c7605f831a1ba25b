"""What is written past libhdf5 is what it would have written: checksums, the superblock's end, indices of chunks."""

import io
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from contour_cases import small_chunks

from palpate.datasets.contour_file.assembly import Assembly, write_assembly
from palpate.datasets.storage.checksum import fletcher32, lookup3
from palpate.datasets.storage.chunk_index import NO_ADDRESS, ChunkTable, index_nodes
from palpate.datasets.storage.hdf5 import Hdf5Reader
from palpate.datasets.storage.hdf5_columns import image_of
from palpate.datasets.storage.schema import CONTOURS

ROOM = 1 << 17
POINTS, KIND = CONTOURS[0], CONTOURS[1]


def libhdf5_fletcher(content):
    with h5py.File("image", "w", driver="core", backing_store=False) as file:
        dataset = file.create_dataset("x", data=content, chunks=content.shape, fletcher32=True)
        file.flush()
        return int.from_bytes(dataset.id.read_direct_chunk((0,))[1][-4:], "little")


def test_fletcher32_is_that_of_libhdf5(rng):
    for size in (1, 2, 3, 719, 720, 721, 4094, 4096, 4097, 65536, 98304, 98305, 229376):
        contents = [np.full(size, fill, np.uint8) for fill in (0, 255, 1)]
        for content in (*contents, rng.integers(0, 256, size, np.uint8)):
            assert fletcher32(content[None])[0] == libhdf5_fletcher(content), (size, content[0])


def test_fletcher32_of_several_contents_is_that_of_each(rng):
    contents = rng.integers(0, 256, (5, 6000), np.uint8)
    assert fletcher32(contents).tolist() == [libhdf5_fletcher(content) for content in contents]
    with pytest.raises(ValueError, match="at most 16777216 bytes, not 16777217"):
        fletcher32(np.zeros((1, (1 << 24) + 1), np.uint8))


def test_lookup3_is_that_of_libhdf5_and_of_its_author(tmp_path):
    assert lookup3(b"") == 0xDEADBEEF
    assert lookup3(b"Four score and seven years ago") == 0x17770551
    with h5py.File(tmp_path / "a.h5", "w", libver=("v108", "v108")) as file:
        file.create_group("a")
    image = (tmp_path / "a.h5").read_bytes()
    assert lookup3(image[:44]) == int.from_bytes(image[44:48], "little")


def test_an_image_with_the_checksum_of_another_flag_is_given_the_right_one():
    """libhdf5 1.14 gives such: the flag (byte 11) says that nobody writes the file, the checksum is of the flag set."""
    with h5py.File("image", "w", driver="core", backing_store=False, libver=("v108", "v108")) as file:
        file.attrs["x"] = 7
        file.flush()
        right = file.id.get_file_image()
    of_another = lookup3(right[:11] + b"\1" + right[12:44])
    wrong = right[:44] + of_another.to_bytes(4, "little") + right[48:]
    with pytest.raises(OSError, match="checksum"):
        h5py.File(io.BytesIO(wrong), "r")
    given = SimpleNamespace(flush=lambda: None, id=SimpleNamespace(get_file_image=lambda: wrong))
    with h5py.File(io.BytesIO(image_of(given)), "r") as file:
        assert file.attrs["x"] == 7


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("chunk_count", [1, 63, 64, 65, 128, 4096, 4097, 9000])
def test_libhdf5_finds_every_chunk_through_the_index(tmp_path, rng, chunk_count):
    """Up to 64 chunks are in the root, up to 4096 below it, more below these."""
    path = tmp_path / "a.h5"
    count = 3 * chunk_count - 1 if chunk_count > 1 else 2
    rows = {POINTS: rng.random((count, 3)).astype(np.float32), KIND: rng.integers(0, 3, count, np.uint8)}
    with small_chunks(3):
        assembly = Assembly(ROOM)
        for spec, content in rows.items():
            assembly.add(spec, content)
        write_assembly(path, assembly, ROOM, ROOM, fresh=True)
    with h5py.File(path) as file:
        for spec, content in rows.items():
            assert file[spec.path].id.get_num_chunks() == chunk_count
            np.testing.assert_array_equal(file[spec.path][...], content)
            for row in rng.integers(0, count, 20):
                np.testing.assert_array_equal(file[spec.path][row], content[row])
            assert file[spec.path].fletcher32


def test_libhdf5_goes_on_with_the_index(tmp_path, rng):
    """Another program may change a sealed file."""
    path, rows = tmp_path / "a.h5", rng.integers(0, 3, 1000, np.uint8)
    with small_chunks(3):
        assembly = Assembly(ROOM)
        assembly.add(KIND, rows)
        write_assembly(path, assembly, ROOM, ROOM, fresh=True)
    with h5py.File(path, "r+") as file:
        file[KIND.path][::7] = 2
        file["more"] = np.arange(10_000)
    rows[::7] = 2
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file[KIND.path][...], rows)
        np.testing.assert_array_equal(file["more"][...], np.arange(10_000))


def test_the_root_of_an_index_is_that_of_libhdf5(tmp_path, rng):
    """Byte for byte, but for where the chunks lie."""
    path, rows = tmp_path / "a.h5", rng.random((20, 3)).astype(np.float32)
    with small_chunks(7):
        assembly = Assembly(ROOM)
        assembly.add(POINTS, rows)
        write_assembly(path, assembly, ROOM, ROOM, fresh=True)
    with h5py.File(tmp_path / "b.h5", "w", libver=("v108", "v108")) as file:
        file.create_dataset("x", data=rows, chunks=(7, 3), fletcher32=True)
    roots = []
    for file in (path, tmp_path / "b.h5"):
        content = file.read_bytes()
        at = content.index(b"TREE")
        entry = np.dtype([("key", "S32"), ("child", "<u8")])
        entries = np.frombuffer(content, entry, 3, at + 24)
        roots.append((content[at : at + 24], entries["key"].tolist(), content[at + 144 : at + 144 + 32]))
    assert roots[0] == roots[1]


@pytest.mark.parametrize("chunk_count", [65, 200, 5000])
def test_nodes_know_their_neighbours_and_where_they_end(chunk_count):
    table = ChunkTable(range(chunk_count), [1] * chunk_count, (7, 3), 4)
    root, nodes = index_nodes(table, 10_000)
    node = np.dtype(
        [("head", "S4"), ("type", "u1"), ("level", "u1"), ("count", "<u2"), ("left", "<u8"), ("right", "<u8")]
    )
    entry = np.dtype([("size", "<u4"), ("mask", "<u4"), ("offset", "<u8", 3), ("child", "<u8")])
    found = {10_000 + k * len(root): content for k, content in enumerate(nodes)}
    read = {at: np.frombuffer(content, node, 1)[0] for at, content in found.items()}
    keys = {at: np.frombuffer(content + bytes(8), entry, read[at]["count"] + 1, 24) for at, content in found.items()}
    for at, head in read.items():
        after = head["right"]
        last = keys[at]["offset"][-1]
        if after == NO_ADDRESS:
            np.testing.assert_array_equal(last, [7 * chunk_count, 3, 4])
        else:
            assert read[after]["left"] == at
            assert read[after]["level"] == head["level"]
            np.testing.assert_array_equal(last, keys[after]["offset"][0])
    assert sum(head["left"] == NO_ADDRESS for head in read.values()) == np.frombuffer(root, node, 1)[0]["level"]


def test_a_lost_chunk_is_refused(tmp_path, rng):
    path = tmp_path / "a.h5"
    with small_chunks(3):
        assembly = Assembly(ROOM)
        assembly.add(KIND, rng.integers(0, 3, 30, np.uint8))
        write_assembly(path, assembly, ROOM, ROOM, fresh=True)
    content = bytearray(path.read_bytes())
    root = content.index(b"TREE")
    content[root + 24 : root + 28] = bytes(4)  # the first chunk's size
    path.write_bytes(content)
    with Hdf5Reader(path) as file, pytest.raises(Exception, match="9 of its 10 chunks can be where its index says"):
        file.read(KIND.path)
