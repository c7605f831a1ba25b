"""HDF5 files as an attacker or a broken disk would make them, each with what must come of it.

`CASES` has a function for each file, by name; it changes a sound file of one of palpate's formats (`SOUND`). A case
says which operations have to refuse the file: all of `OPERATIONS[kind]`, or those that read what is wrong with it.
"""

import hashlib
import json
import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
from contour_cases import everything, make_contours, write_file
from h5py import h5d, h5p, h5s, h5t, h5z

from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.table import write_table

POSES = 30
OPERATIONS = {
    "contours": ("check", "info", "read", "play", "motion"),
    "frames": ("check", "info", "read", "play"),
    "motion": ("motion",),
    "table": ("read",),
    "shard": ("read",),
}


CONTOUR_READERS = ("check", "read", "play")
"""Those that read contours."""


@dataclass(frozen=True)
class Case:
    """A hostile file: how it is made of a sound one, and which operations must refuse it; the others may."""

    kind: str
    make: Callable[[Path], None]
    refusing: tuple[str, ...]


CASES: dict[str, Case] = {}


def case(kind="contours", refusing=None):
    """Add a function that changes a sound file, given its path."""

    def add(make):
        CASES[make.__name__.replace("_", " ")] = Case(kind, make, OPERATIONS[kind] if refusing is None else refusing)
        return make

    return add


def change(name, kind="contours", refusing=None):
    """Add a function that changes a sound file, given it open in h5py."""

    def add(edit):
        def make(path):
            with h5py.File(path, "r+", libver=("v108", "latest")) as file:
                edit(file)

        CASES[name] = Case(kind, make, OPERATIONS[kind] if refusing is None else refusing)
        return edit

    return add


def write_case(name, path):
    """The hostile file of that name."""
    made = CASES[name]
    Path(path).write_bytes(sound(made.kind))
    made.make(Path(path))


@cache
def sound(kind):
    """The bytes of a sound file of a kind."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "sound.h5"
        SOUND[kind](path)
        return path.read_bytes()


def _contours(path):
    contours = make_contours(POSES, intensity=True, dwell=True)
    contours["points"] = contours["points"] * np.float32(0.01) + np.array([0, 0, 0.2], np.float32)
    write_file(path, contours, chunk=11, **everything(POSES))


def _frames(path):
    about = {"format": "palpate focal points", "version": np.array([1, 0], np.int32), "recipe": json.dumps({"a": 1})}
    fields = [FrameField("/focus/position", (3,), "m"), FrameField("/focus/intensity", (), "1")]
    with FrameFile(path, fields, 50, attributes={"/": about, "/focus": {"update_rate": 5000.0}}) as file:
        position = np.tile(np.array([0, 0, 0.2], np.float32), (50, 1))
        file.append({"/focus/position": position, "/focus/intensity": np.ones(50, np.float32)})
        file.publish()


def _motion(path):
    pose = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1.0]), (POSES, 1))
    HandMotion(np.arange(POSES) / 90.0, pose, seed=3).save(path)


def _table(path):
    write_table(path, {"name": ["a", "b", "c"], "r": [1.0, 2.0, 3.0]}, {"maker": "x"}, units={"r": "m"})


def _shard(path):
    write_shard(path, [ShardRow("metrics", "k", 0, {"a": 1})], [{"length": np.arange(5.0)}], maker="x")


SOUND = {"contours": _contours, "frames": _frames, "motion": _motion, "table": _table, "shard": _shard}


# what an edit of a dataset needs


def replace(file, path, *, about=None, **options):
    """Put another dataset in the place of one, with its attributes."""
    attributes = dict(file[path].attrs) if path in file else {}
    if path in file:
        del file[path]
    dataset = file.create_dataset(path, **options)
    dataset.attrs.update(attributes | (about or {}))
    return dataset


def low_level(file, path, kind, shape, plist=None):
    """A dataset of any HDF5 type, in the place of one."""
    if path in file:
        del file[path]
    return h5d.create(file.id, path.encode(), kind, h5s.create_simple(shape), plist)


def unallocated(file, path, rows, **options):
    old = file[path]
    shape = (rows, *old.shape[1:])
    replace(file, path, shape=shape, dtype=old.dtype, **({"chunks": (8192, *old.shape[1:])} | options))


def virtual_on_itself(file, path):
    shape, dtype = (file[path].shape, file[path].dtype) if path in file else ((1000,), np.dtype("f4"))
    if path in file:
        del file[path]
    layout = h5py.VirtualLayout(shape, dtype)
    layout[...] = h5py.VirtualSource(file.filename, path, shape)
    file.create_virtual_dataset(path, layout)


# links


@change("a soft link in place of a dataset")
def _(file):
    file.move("/contours/kind", "/kind")
    file["/contours/kind"] = h5py.SoftLink("/kind")


@change("a soft link on itself")
def _(file):
    file["/extra"] = h5py.SoftLink("/extra")


@change("a link to another file in place of a group")
def _(file):
    del file["/object"]
    file["/object"] = h5py.ExternalLink("/etc/hostname", "/object")


@change("a link to another file beside the groups")
def _(file):
    file["/extra"] = h5py.ExternalLink("other.h5", "/x")


@case()
def a_link_to_a_sound_file_that_lies_beside_it(path):
    other = path.with_name(f"{path.name}.other")
    other.write_bytes(sound("contours"))
    with h5py.File(path, "r+") as file:
        del file["/motion"]
        file["/motion"] = h5py.ExternalLink(str(other), "/motion")


@change("a group that holds the root")
def _(file):
    file["/contours/self"] = file["/"]


@change("two groups that hold each other")
def _(file):
    file["/a/b"] = np.zeros(1)
    file["/c/a"] = file["/a"]
    file["/a/c"] = file["/c"]


@change("a dataset with two names")
def _(file):
    file["/extra"] = file["/contours/points"]


@change("groups a thousand deep")
def _(file):
    group = file
    for _ in range(1000):
        group = group.create_group("a")


@change("names of control characters")
def _(file):
    file["/\x1b]0;x\x07"] = np.zeros(1)


@change("names that are not UTF-8")
def _(file):
    h5d.create(file.id, b"\xff\xfe", h5t.NATIVE_INT32, h5s.create_simple((1,)))


# data that lie elsewhere, or nowhere


@change("a virtual dataset on itself")
def _(file):
    virtual_on_itself(file, "/contours/points")


@change("a virtual dataset on itself beside the others")
def _(file):
    virtual_on_itself(file, "/extra")


@change("a virtual dataset on a system file")
def _(file):
    layout = h5py.VirtualLayout((30,), "f4")
    layout[...] = h5py.VirtualSource("/etc/hostname", "/x", (30,))
    del file["/metrics/length"]
    file.create_virtual_dataset("/metrics/length", layout)


@case()
def external_data_on_a_FIFO(path):
    fifo = path.with_name(f"{path.name}.fifo")
    os.mkfifo(fifo)
    with h5py.File(path, "r+") as file:
        rows = len(file["/contours/kind"])
        replace(file, "/contours/kind", shape=(rows,), dtype="u1", external=[(str(fifo), 0, rows)])


@change("external data of a system file")
def _(file):
    replace(file, "/object/vertices", shape=(4, 3), dtype="<f4", external=[("/etc/passwd", 0, 48)])


@change("external data of a device beside the others")
def _(file):
    replace(file, "/extra", shape=(1 << 20,), dtype="u1", external=[("/dev/zero", 0, 1 << 20)])


@change("points of 1e9 rows that were never written")
def _(file):
    unallocated(file, "/contours/points", 10**9)


@change("lengths of 1e9 rows that were never written")
def _(file):
    unallocated(file, "/metrics/length", 10**9)


@change("points of 1e9 rows in one piece that were never written")
def _(file):
    replace(file, "/contours/points", shape=(10**9, 3), dtype="<f4")


@change("2e8 poses that were never written")
def _(file):
    for path in [f"/metrics/{name}" for name in file["metrics"]] + ["/motion/pose", "/motion/time", "/object/moved"]:
        unallocated(file, path, 2 * 10**8, fletcher32=True)
    unallocated(file, "/contours/pose_start", 2 * 10**8 + 1, fletcher32=True)


@change("rows of which only the first chunk was written, filled with sound values", refusing=CONTOUR_READERS)
def _(file):
    kind = file["/contours/kind"][...]
    new = replace(file, "/contours/kind", shape=kind.shape, dtype="u1", chunks=(8,), fletcher32=True, fillvalue=1)
    new[:8] = kind[:8]


@change("offsets that were never written, filled with zeros", refusing=CONTOUR_READERS)
def _(file):
    replace(file, "/contours/polyline_start", shape=(5,), dtype="<i8", chunks=(5,), fletcher32=True, fillvalue=0)


@change("a chunk of 4 GB that was never written")
def _(file):
    unallocated(file, "/contours/kind", 2**32 - 2, chunks=(2**32 - 2,))


@change("chunks that skip their checksum", refusing=CONTOUR_READERS)
def _(file):
    kind = np.zeros(len(file["/contours/kind"]), "u1")
    new = replace(file, "/contours/kind", shape=kind.shape, dtype="u1", chunks=kind.shape, fletcher32=True)
    new.id.write_direct_chunk((0,), kind.tobytes() + bytes(4), 0b1)


@change("a chunk of which the index tells another length", refusing=CONTOUR_READERS)
def _(file):
    kind = np.zeros(len(file["/contours/kind"]), "u1")
    new = replace(file, "/contours/kind", shape=kind.shape, dtype="u1", chunks=kind.shape, fletcher32=True)
    new.id.write_direct_chunk((0,), bytes(4))


@change("a chunk that inflates to 3 GB", refusing=CONTOUR_READERS)
def _(file):
    rows = len(file["/contours/kind"])
    new = replace(file, "/contours/kind", shape=(rows,), dtype="u1", chunks=(rows,), compression="gzip")
    deflater = zlib.compressobj(9)
    zeros = bytes(1 << 24)
    new.id.write_direct_chunk((0,), b"".join([*(deflater.compress(zeros) for _ in range(192)), deflater.flush()]))


@change("a chunk of 30 MB that inflates to 3 GB", refusing=CONTOUR_READERS)
def _(file):
    rows = 30_000_000
    new = replace(file, "/contours/kind", shape=(rows,), dtype="u1", chunks=(rows,), compression="gzip")
    deflater = zlib.compressobj(9)
    zeros = bytes(1 << 24)
    new.id.write_direct_chunk((0,), b"".join([*(deflater.compress(zeros) for _ in range(192)), deflater.flush()]))


@case(refusing=CONTOUR_READERS)
def all_chunks_in_one_place(path):
    """A tree of chunks whose 64 entries point at the same bytes: 262 kB would be read as gigabytes."""
    with h5py.File(path, "r+", libver=("v108", "latest")) as file:
        new = replace(file, "/contours/kind", shape=(64 << 13,), dtype="u1", chunks=(1 << 13,))
        new[...] = 1
        offsets = [new.id.get_chunk_info(index).byte_offset for index in range(64)]
    content = path.read_bytes()
    for offset in offsets[1:]:
        content = content.replace(struct.pack("<QQ", 0, offset), struct.pack("<QQ", 0, offsets[0]))
    path.write_bytes(content)


@case(refusing=CONTOUR_READERS)
def a_chunk_beyond_the_end(path):
    with h5py.File(path) as file:
        offset = file["/contours/points"].id.get_chunk_info(0).byte_offset
    path.write_bytes(path.read_bytes().replace(struct.pack("<Q", offset), struct.pack("<Q", 1 << 40)))


@case(refusing=CONTOUR_READERS)
def a_bit_in_the_place_of_a_chunk(path):
    with h5py.File(path) as file:
        chunk = file["/contours/points"].id.get_chunk_info(0)
    key = struct.pack("<II", chunk.size, 0)
    content = path.read_bytes()
    places = [at for at in range(len(content)) if content.startswith(key, at)]
    content = bytearray(content)
    for at in places:
        content[at + 8] ^= 0x20
    path.write_bytes(content)


# types


def of_type(name, path, kind, refusing=None):
    @change(f"{name} in {path}", refusing=refusing)
    def _(file):
        shape = file[path].shape
        about = dict(file[path].attrs)
        low_level(file, path, kind() if callable(kind) else kind, shape)
        file[path].attrs.update(about)


def _enum():
    kind = h5t.enum_create(h5t.STD_U8LE)
    kind.enum_insert(b"a", 0)
    return kind


def _wide_int():
    kind = h5t.STD_I64LE.copy()
    kind.set_size(16)
    kind.set_precision(128)
    return kind


of_type("a compound", "/contours/points", lambda: h5t.py_create(np.dtype([("x", "f4"), ("y", "f4")])))
of_type("an opaque type", "/contours/kind", lambda: h5t.create(h5t.OPAQUE, 16))
of_type("object references", "/contours/polyline_patch", h5t.STD_REF_OBJ)
of_type("region references", "/contours/polyline_patch", h5t.STD_REF_DSETREG)
of_type("lists of any length", "/contours/points", lambda: h5t.vlen_create(h5t.IEEE_F32LE))
of_type("lists of lists", "/metrics/length", lambda: h5t.vlen_create(h5t.vlen_create(h5t.IEEE_F32LE)))
of_type("an enumeration", "/contours/kind", _enum)
of_type("true and false", "/contours/polyline_closed", lambda: h5t.py_create(np.dtype(bool), logical=True))
of_type("complex numbers", "/metrics/length", lambda: h5t.py_create(np.dtype("c8"), logical=True))
of_type("bit fields", "/contours/kind", h5t.STD_B8LE)
of_type("times", "/motion/time", h5t.UNIX_D32LE)
of_type("arrays", "/contours/points", lambda: h5t.array_create(h5t.IEEE_F32LE, (3,)))
of_type("integers of 128 bits", "/contours/pose_start", _wide_int)
of_type("float16", "/contours/points", h5t.IEEE_F16LE, CONTOUR_READERS)
of_type("float64", "/contours/points", h5t.IEEE_F64LE, CONTOUR_READERS)
of_type("big-endian numbers", "/contours/points", h5t.IEEE_F32BE, CONTOUR_READERS)
of_type("floats", "/contours/pose_start", h5t.IEEE_F64LE, CONTOUR_READERS)
of_type("text", "/contours/kind", lambda: h5t.py_create(h5py.string_dtype(), logical=True), CONTOUR_READERS)
of_type("text", "/metrics/length", lambda: h5t.py_create(np.dtype("S8")), ("check", "info", "read"))
of_type("text", "/motion/pose", lambda: h5t.py_create(np.dtype("S8")), ("check", "info", "read", "motion"))
of_type("80-bit floats", "/metrics/length", lambda: h5t.py_create(np.dtype("longdouble")))


@change("a type with a name of its own")
def _(file):
    file["/type"] = np.dtype("f4")


@change("a dataset of a type with a name")
def _(file):
    file["/type"] = np.dtype("f4")
    shape = file["/contours/points"].shape
    del file["/contours/points"]
    file.create_dataset("/contours/points", shape, file["/type"])


# ranks and counts


def reshaped(name, path, shape, refusing, dtype=None):
    @change(name, refusing=refusing)
    def _(file):
        old = file[path]
        options = {"fletcher32": True, "chunks": shape} if shape and 0 not in shape else {}
        data = np.zeros(shape, dtype or old.dtype)
        replace(file, path, data=data, **options)


reshaped("points of one dimension", "/contours/points", (100,), CONTOUR_READERS)
reshaped("points of four coordinates", "/contours/points", (100, 4), CONTOUR_READERS)
reshaped("points of no coordinates", "/contours/points", (100, 0), CONTOUR_READERS)
reshaped("points of nine dimensions", "/contours/points", (2,) * 9, OPERATIONS["contours"])
reshaped("offsets of two dimensions", "/contours/pose_start", (31, 2), CONTOUR_READERS)
reshaped("no offsets", "/contours/pose_start", (0,), CONTOUR_READERS)
reshaped("poses of three dimensions", "/motion/pose", (POSES, 7, 1), ("check", "read", "motion"))
reshaped("no poses", "/motion/pose", (0, 7), ("check", "read", "motion"))
reshaped("poses of 0 numbers", "/motion/pose", (POSES, 0), ("check", "read", "motion"))
reshaped("a scalar in place of points", "/contours/points", (), CONTOUR_READERS)
reshaped("a scalar in place of poses", "/motion/pose", (), ("check", "info", "read", "play", "motion"))
reshaped("a scalar in place of times", "/motion/time", (), ("check", "info", "read", "play", "motion"))
reshaped("lengths of fewer poses", "/metrics/length", (POSES - 1,), ("check", "read"))
reshaped("lengths of two dimensions", "/metrics/length", (POSES, 2), ("check", "info", "read"))
reshaped("times of fewer poses", "/motion/time", (POSES - 3,), ("check", "read", "motion"))
reshaped("times of two dimensions", "/motion/time", (POSES, 1), ("check", "info", "read", "play", "motion"))
reshaped("faces of two corners", "/object/faces", (4, 2), ("check", "read"))
reshaped("timing of one dimension", "/timing/seconds", (3,), ("check", "read"))
reshaped("kinds of fewer points", "/contours/kind", (5,), CONTOUR_READERS)


@change("a dataset without values")
def _(file):
    replace(file, "/contours/kind", data=h5py.Empty("u1"))


@change("a dataset in place of a group", refusing=("check", "info", "read", "play"))
def _(file):
    del file["/contours"]
    file["/contours"] = np.zeros(3)


@change("a group in place of a dataset", refusing=CONTOUR_READERS)
def _(file):
    del file["/contours/points"]
    file.create_group("/contours/points")


@change("offsets beyond all points", refusing=CONTOUR_READERS)
def _(file):
    file["/contours/polyline_start"][-1] = 1 << 62


@change("offsets below zero", refusing=CONTOUR_READERS)
def _(file):
    file["/contours/pose_start"][3] = -(1 << 63)


@change("faces of vertices that there are not", refusing=("check",))
def _(file):
    file["/object/faces"][0] = 1 << 30


# filters


@change("a filter that is a plug-in")
def _(file):
    plist = h5p.create(h5p.DATASET_CREATE)
    plist.set_chunk((4,))
    plist.set_filter(32015, h5z.FLAG_OPTIONAL, (3,))
    low_level(file, "/contours/kind", h5t.STD_U8LE, (8,), plist)


@change("a filter of numbers of bits")
def _(file):
    kind = file["/contours/kind"][...]
    replace(file, "/contours/kind", data=kind, scaleoffset=4, chunks=kind.shape)


@change("deflated three times")
def _(file):
    plist = h5p.create(h5p.DATASET_CREATE)
    rows = len(file["/contours/kind"])
    plist.set_chunk((rows,))
    for _ in range(3):
        plist.set_deflate(9)
    low_level(file, "/contours/kind", h5t.STD_U8LE, (rows,), plist)
    content = zlib.compress(zlib.compress(zlib.compress(bytes(1 << 28), 9), 9), 9)
    file["/contours/kind"].id.write_direct_chunk((0,), content)


# attributes


def attribute(name, path, key, value, refusing=None, kind="contours"):
    @change(name, kind, refusing)
    def _(file):
        file[path].attrs[key] = value


def fixed(text):
    raw = text.encode()
    return np.array(raw, h5py.string_dtype("utf-8", max(1, len(raw))))


DEEP = fixed("[" * 30_000 + "]" * 30_000)
OF_HEADER = ("check", "read")
attribute("a version below zero", "/", "version", np.array([-5, -7], np.int32), CONTOUR_READERS)
attribute("a version of text", "/", "version", "1.1", CONTOUR_READERS)
attribute("a version of one number", "/", "version", 1, CONTOUR_READERS)
attribute("a version of fractions", "/", "version", np.array([1.0, 1.0]), CONTOUR_READERS)
attribute("an unknown major version", "/", "version", np.array([2, 0], np.int32), CONTOUR_READERS)
attribute("a version of 64 bits", "/", "version", np.array([1 << 40, 0]), CONTOUR_READERS)
attribute("a format of another kind", "/", "format", "palpate secrets", CONTOUR_READERS)
attribute("a format of numbers", "/", "format", np.arange(3), CONTOUR_READERS)
attribute("a seed of text", "/", "seed", "seven", ("check", "info", "read", "motion"))
attribute("a seed of a fraction", "/", "seed", 7.5, ("check", "info", "read", "motion"))
attribute("a seed of a list", "/", "seed", np.arange(3), ("check", "info", "read", "motion"))
attribute("an offset of text", "/motion", "offset", "soon", ("check", "read", "motion"))
attribute("an offset of NaN", "/motion", "offset", np.nan, ("check", "motion"))
attribute("an offset of a list", "/motion", "offset", np.arange(3.0), ("check", "read", "motion"))
attribute("inserted poses of text", "/", "poses_inserted", "many", ("check", "info", "read"))
attribute("an error of the raw intersection of text", "/", "raw_error", "small", ("check", "info", "read"))
attribute("a strategy of numbers", "/", "strategy", 5, ("check", "info", "read"))
attribute("a strategy that is no object", "/", "strategy", "[1]", ("check", "info", "read"))
attribute("a strategy of unequal names", "/", "strategy", '{"raw": 1, "raw": 2}', ("check", "info", "read"))
attribute("a strategy of no number", "/", "strategy", '{"raw": NaN}', ("check", "info", "read"))
attribute("a strategy of half a character", "/", "strategy", r'{"raw": "\ud800"}', ("check", "info", "read"))
attribute("a strategy of 30,000 lists", "/", "strategy", DEEP, ("check", "info", "read"))
attribute("a hand of 30,000 lists", "/hand", "description", DEEP, ("check", "info", "read"))
attribute("stages of 30,000 lists", "/timing", "stages", DEEP, ("check", "read"))
attribute("stages that are no names", "/timing", "stages", '{"stages": [[1], {}]}', ("check", "read"))
attribute("stages that are no list", "/timing", "stages", '{"stages": 5}', ("check", "read"))
attribute("versions of numbers", "/", "versions", '{"palpate": 5}', ("check", "info", "read"))
attribute("a recipe of numbers", "/", "recipe", '{"format": [1, 2]}', ("check",))
attribute("a stages order of numbers", "/", "strategy", '{"transform": 5}', ())
attribute("a name that is not UTF-8", "/object", "name", np.bytes_(b"\xff\xfe"), ("check", "info", "read"))
attribute("an attribute of an enumeration", "/", "extra", np.array(True))
attribute("an attribute of a compound", "/contours", "extra", np.zeros(4, [("a", "i4")]))
attribute("an attribute of three dimensions", "/", "extra", np.zeros((2, 2, 2)))


@change("an attribute of references")
def _(file):
    file.attrs.create("extra", np.array([file["/object"].ref] * 4, h5py.ref_dtype))


attribute("a strategy of a million lists", "/", "strategy", "[" * 10**6, ("check", "info", "read"))


@change("an attribute of 64 MB")
def _(file):
    file["/"].attrs.create("extra", np.zeros(1 << 23))


@change("20,000 attributes")
def _(file):
    for number in range(20_000):
        file["/object"].attrs[f"a{number}"] = number


@change("an attribute without a value")
def _(file):
    file["/"].attrs["extra"] = h5py.Empty("f4")


# what is no file


@case()
def a_FIFO(path):
    path.unlink()
    os.mkfifo(path)


@case()
def a_link_to_a_device(path):
    path.unlink()
    path.symlink_to("/dev/zero")


@case()
def a_folder(path):
    path.unlink()
    path.mkdir()


@case()
def an_empty_file(path):
    path.write_bytes(b"")


@case()
def a_signature_alone(path):
    path.write_bytes(b"\x89HDF\r\n\x1a\n")


@case()
def half_a_file(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@case()
def a_superblock_that_says_a_larger_file(path):
    content = bytearray(path.read_bytes())
    content[28:36] = struct.pack("<Q", 1 << 60)
    path.write_bytes(content)


@case()
def a_sound_size_of_zeros(path):
    path.write_bytes(bytes(path.stat().st_size))


# files of frames

attribute("frames of version -1", "/", "version", np.array([-1, 0], np.int32), None, "frames")
attribute("frames of a rate of text", "/focus", "update_rate", "fast", None, "frames")
attribute("frames of an endless rate", "/focus", "update_rate", np.inf, None, "frames")
attribute("frames of a recipe of 30,000 lists", "/", "recipe", DEEP, ("check", "info", "read"), "frames")


@change("frames of 1e9 rows that were never written", "frames")
def _(file):
    for path in ("/focus/position", "/focus/intensity"):
        unallocated(file, path, 10**9)


@change("frames of 1e9 rows in one piece that were never written", "frames")
def _(file):
    replace(file, "/focus/position", shape=(10**9, 3), dtype="<f4")
    replace(file, "/focus/intensity", shape=(10**9,), dtype="<f4")


@change("frames on themselves", "frames")
def _(file):
    virtual_on_itself(file, "/focus/position")


@change("frames of complex numbers", "frames")
def _(file):
    replace(file, "/focus/position", data=np.zeros((50, 3), "c8"))


@change("frames of float64", "frames")
def _(file):
    replace(file, "/focus/position", data=np.zeros((50, 3)))


@change("frames without focal points", "frames")
def _(file):
    replace(file, "/focus/position", data=np.zeros((50, 0, 3), "f4"))
    replace(file, "/focus/intensity", data=np.zeros((50, 0), "f4"))


# motions


@change("a motion of 1e9 poses that were never written", "motion")
def _(file):
    unallocated(file, "/motion/pose", 10**9)


@change("a motion of a compound", "motion")
def _(file):
    replace(file, "/motion/pose", data=np.zeros(5, [("x", "f4")]))


@change("a motion on itself", "motion")
def _(file):
    virtual_on_itself(file, "/motion/pose")


@case("motion")
def a_motion_on_a_FIFO(path):
    fifo = path.with_name(f"{path.name}.fifo")
    os.mkfifo(fifo)
    with h5py.File(path, "r+") as file:
        replace(file, "/motion/pose", shape=(5, 7), dtype="<f4", external=[(str(fifo), 0, 140)])


@change("a motion that is a link", "motion")
def _(file):
    del file["/motion/pose"]
    file["/motion/pose"] = h5py.SoftLink("/motion/time")


@change("a motion that is a dataset", "motion")
def _(file):
    del file["/motion"]
    file["/motion"] = np.zeros(3)


@change("a motion with a time of text", "motion")
def _(file):
    replace(file, "/motion/time", data=np.array([b"1.0"] * POSES))


@change("a motion whose time is one number", "motion")
def _(file):
    replace(file, "/motion/time", data=1.0)


@change("a motion of lists of any length", "motion")
def _(file):
    replace(file, "/motion/pose", shape=(30,), dtype=h5py.vlen_dtype("f4"))


attribute("a motion with a seed of text", "/motion", "seed", "x", None, "motion")
attribute("a motion with an offset of text", "/motion", "offset", "3", None, "motion")
attribute("a motion with an offset of a list", "/motion", "offset", np.zeros(1), None, "motion")
attribute("a motion with a seed of truth", "/motion", "seed", np.bool_(True), None, "motion")


# tables


@change("a column of two dimensions", "table")
def _(file):
    file["/wide"] = np.zeros((3, 2))


@change("columns of unequal lengths", "table")
def _(file):
    file["/long"] = np.zeros(5)


@change("a column of 1e9 rows that were never written", "table")
def _(file):
    file.create_dataset("/long", (10**9,), "f8", chunks=(65536,))


@change("a column of a compound", "table")
def _(file):
    file["/odd"] = np.zeros(3, [("a", "i4")])


@change("a column of lists", "table")
def _(file):
    file.create_dataset("/odd", (3,), h5py.vlen_dtype("i4"))


@change("a group among columns", "table")
def _(file):
    file["/odd/inner"] = np.zeros(3)


@change("a scalar among columns", "table")
def _(file):
    file["/odd"] = 5.0


@change("text that is not UTF-8", "table")
def _(file):
    dataset = file.create_dataset("/odd", (3,), h5py.string_dtype())
    dataset[0] = b"\xff\xfe"


@case("table")
def a_million_texts_in_one_place(path):
    count = 1 << 17
    with h5py.File(path, "r+", libver=("v108", "latest")) as file:
        long = file.create_dataset("/text", (1,), h5py.string_dtype())
        long[0] = "x" * 60_000
        begin = long.id.get_offset()
        del file["/name"]
        places = file.create_dataset("/name", (count,), h5py.string_dtype())
        places[...] = np.array([b""] * count, object)
        places[0] = "a"
        at = places.id.get_offset()
    content = bytearray(path.read_bytes())
    content[at : at + 16 * count] = bytes(content[begin : begin + 16]) * count
    path.write_bytes(content)


attribute("a table's version of text", "/", "version", "one", None, "table")
attribute("a table's version of a list", "/", "version", np.arange(3), None, "table")
attribute("a table's version below one", "/", "version", -4, None, "table")
attribute("a table's format of a list", "/", "format", np.arange(3), None, "table")


# shards


def resealed(path, edit):
    """Change a shard's HDF5 file and give it a right checksum again."""
    content = path.read_bytes()[:-56]
    path.write_bytes(content)
    with h5py.File(path, "r+", libver=("v108", "latest")) as file:
        edit(file)
    content = path.read_bytes()
    digest = hashlib.blake2b(content, digest_size=32).digest()
    path.write_bytes(content + struct.pack("<16sQ32s", b"palpate shard 1\n", len(content), digest))


def shard(name, rows=None, payloads=None, edit=None):
    def make(path):
        def change_it(file):
            for key, text in (("rows", rows), ("payloads", payloads)):
                if text is not None:
                    del file[key]
                    file[key] = np.frombuffer(text.encode(), np.uint8)
            if edit:
                edit(file)

        resealed(path, change_it)

    CASES[name] = Case("shard", make, OPERATIONS["shard"])


shard("a shard's rows of 100,000 lists", rows="[" * 10**5 + "]" * 10**5)
shard("a shard's rows that are no rows", rows='{"a": 1}')
shard("a shard's rows of two", rows='[["a", "b"]]')
shard("a shard's rows of numbers", rows="[[1, 2, 3]]")
shard("a shard's rows that are not UTF-8", edit=lambda file: file["rows"].__setitem__(0, 255))
shard("a shard's payload of 100,000 lists", payloads="[" * 10**5 + "]" * 10**5)
shard("a shard's payload that is no object", payloads="[1]")
shard("a shard's rows on themselves", edit=lambda file: virtual_on_itself(file, "/rows"))
shard("a shard's rows of floats", edit=lambda file: replace(file, "/rows", data=np.zeros(9)))
shard("a shard's column of a compound", edit=lambda f: replace(f, "/columns/0/length", data=np.zeros(5, [("a", "i4")])))
shard("a shard's columns that are a dataset", edit=lambda f: replace(f, "/columns", data=np.zeros(5)))
shard("a shard's column never written", edit=lambda f: replace(f, "/columns/0/length", shape=(10**9,), dtype="f8"))
