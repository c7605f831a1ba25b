"""HDF5 files as an attacker or a broken disk would make them, as data: how each is made, and what must refuse it.

`CASES` has each file by name; it changes a sound file of one of palpate's formats (`sound`).
"""

import json
import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
from contour_cases import everything, make_contours, write_file
from h5py import ExternalLink, SoftLink, h5d, h5p, h5s, h5t, h5z

from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.motions.hand_motion import HandMotion

POSES = 30
OPERATIONS = {
    "contours": ("check", "info", "read", "play", "motion"),
    "frames": ("check", "info", "read", "play"),
    "motion": ("motion",),
}
CONTOURS = ("check", "read", "play")
"""Those that read contours."""
POSE = ("check", "read", "motion")
"""Those that read poses."""
TEXTS = ("check", "info", "read")
"""Those that read descriptions."""
NOT_PLAYED = ("check", "info", "read", "motion")
HEADER = ("check", "read")
NOT_MOVED = ("check", "info", "read", "play")
"""Those that look at the layout of contours."""
UNREAD = ()
"""What the format does not name: nothing opens it, so no operation needs to refuse it."""


@dataclass(frozen=True)
class Case:
    """A hostile file."""

    kind: str
    make: Callable[[Path], None]
    """Changes a sound file."""
    refusing: tuple[str, ...]
    """Operations that must refuse it; the others may."""
    message: str
    """Part of the sentence with which `check` refuses it."""


CASES: dict[str, Case] = {}


def case(name, make, refusing=None, message="", kind="contours"):
    """Add a file that `make` changes, given its path."""
    CASES[name] = Case(kind, make, OPERATIONS[kind] if refusing is None else refusing, message)


def change(name, edit, refusing=None, message="", kind="contours"):
    """Add a file that `edit` changes, given it open in h5py."""

    def make(path):
        with h5py.File(path, "r+", libver=("v108", "latest")) as file:
            edit(file)

    case(name, make, refusing, message, kind)


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


SOUND = {"contours": _contours, "frames": _frames, "motion": _motion}


# edits


def replaced(file, path, **options):
    """Another dataset in the place of one, with its attributes."""
    attributes = dict(file[path].attrs) if path in file else {}
    if path in file:
        del file[path]
    dataset = file.create_dataset(path, **options)
    dataset.attrs.update(attributes)
    return dataset


def put(path, **options):
    return partial(replaced, path=path, **options)


def link(path, target):
    """Something else in the place of an object: a link, an array, or what `target` finds in the file."""

    def edit(file):
        if path in file:
            del file[path]
        file[path] = target(file) if callable(target) else target

    return edit


def zeros(path, shape):
    """A dataset of zeros of the right type and another shape."""

    def edit(file):
        options = {"fletcher32": True, "chunks": shape} if shape and 0 not in shape else {}
        replaced(file, path, data=np.zeros(shape, file[path].dtype), **options)

    return edit


def unallocated(rows, *paths, **options):
    """Datasets with so many rows that were never written."""

    def edit(file):
        for path in paths:
            rest = file[path].shape[1:]
            replaced(file, path, shape=(rows, *rest), dtype=file[path].dtype, **({"chunks": (8192, *rest)} | options))

    return edit


def virtual(path, source=None):
    """A virtual dataset, on itself or on another file."""

    def edit(file):
        shape, dtype = (file[path].shape, file[path].dtype) if path in file else ((1000,), np.dtype("f4"))
        if path in file:
            del file[path]
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource(source or file.filename, path, shape)
        file.create_virtual_dataset(path, layout)

    return edit


def on_a_fifo(dataset, dtype, *row):
    """A dataset whose bytes lie in a FIFO."""

    def make(path):
        fifo = path.with_name(f"{path.name}.fifo")
        os.mkfifo(fifo)
        with h5py.File(path, "r+") as file:
            replaced(file, dataset, shape=(5, *row), dtype=dtype, external=[(str(fifo), 0, 140)])

    return make


def typed(path, kind):
    """A dataset of any HDF5 type, in the place of one."""

    def edit(file):
        shape, about = file[path].shape, dict(file[path].attrs)
        del file[path]
        h5d.create(file.id, path.encode(), kind() if callable(kind) else kind, h5s.create_simple(shape))
        file[path].attrs.update(about)

    return edit


def filtered(*filters, **options):
    """Kinds of points with filters by name of a property, and the chunk that is written past them."""

    def edit(file):
        del file["/contours/kind"]
        plist = h5p.create(h5p.DATASET_CREATE)
        plist.set_chunk((8,))
        for name, *values in filters:
            getattr(plist, name)(*values)
        h5d.create(file.id, b"/contours/kind", h5t.STD_U8LE, h5s.create_simple((8,)), plist)
        if "chunk" in options:
            file["/contours/kind"].id.write_direct_chunk((0,), options["chunk"]())

    return edit


def one_chunk(content, mask=0, rows=None, **options):
    """Kinds of points in one chunk, whose bytes `content` makes of the rows."""

    def edit(file):
        count = rows or len(file["/contours/kind"])
        new = replaced(file, "/contours/kind", shape=(count,), dtype="u1", chunks=(count,), **options)
        new.id.write_direct_chunk((0,), content(count), mask)

    return edit


def inflating(count):
    """A deflated stream of 3 GB."""
    del count
    deflater = zlib.compressobj(9)
    zeros = bytes(1 << 24)
    return b"".join([*(deflater.compress(zeros) for _ in range(192)), deflater.flush()])


def attribute(path, key, value):
    def edit(file):
        file[path].attrs[key] = value(file) if callable(value) else value

    return edit


def rows(path, where, value):
    def edit(file):
        file[path][where] = value

    return edit


def written(content):
    """Other bytes in place of a file: `content` makes them of the sound ones."""
    return lambda path: path.write_bytes(content(path.read_bytes()))


def in_place(make):
    """Something else than a file, made where it was."""

    def made(path):
        path.unlink()
        make(path)

    return made


def fixed(text):
    raw = text.encode()
    return np.array(raw, h5py.string_dtype("utf-8", max(1, len(raw))))


# links

change(
    "a soft link in place of a dataset",
    lambda f: (f.move("/contours/kind", "/kind"), link("/contours/kind", SoftLink("/kind"))(f)),
    NOT_MOVED,
    message="/contours/kind is a soft link",
)
change("a soft link on itself", link("/object/moved", SoftLink("/object/moved")), HEADER)
change(
    "a link to another file in place of a group",
    link("/object", ExternalLink("/etc/hostname", "/object")),
    TEXTS,
    message="/object is a link to another file",
)
change("a link to another file beside the groups", link("/extra", ExternalLink("other.h5", "/x")), UNREAD)
change("a group that holds the root", link("/contours/self", lambda f: f["/"]), UNREAD)
change("a dataset with two names", link("/extra", lambda f: f["/contours/points"]), UNREAD)
change(
    "a dataset in place of another",
    link("/metrics/length_hand", lambda f: f["/metrics/length"]),
    TEXTS,
    "/metrics/length_hand is /metrics/length once more",
)
change("groups a thousand deep", lambda f: f.create_group("/a" * 1000), UNREAD)
change("names of control characters", link("/\x1b]0;x\x07", np.zeros(1)), UNREAD)
change(
    "names that are not UTF-8",
    lambda f: h5d.create(f.id, b"\xff\xfe", h5t.NATIVE_INT32, h5s.create_simple((1,))),
    UNREAD,
)


def two_groups_that_hold_each_other(file):
    file["/a/b"] = np.zeros(1)
    file["/c/a"] = file["/a"]
    file["/a/c"] = file["/c"]


def a_link_to_a_sound_file(path):
    other = path.with_name(f"{path.name}.other")
    other.write_bytes(sound("contours"))
    with h5py.File(path, "r+") as file:
        link("/motion", ExternalLink(str(other), "/motion"))(file)


change("two groups that hold each other", two_groups_that_hold_each_other, UNREAD)
case("a link to a sound file that lies beside it", a_link_to_a_sound_file)

# data that lie elsewhere, or nowhere

FLETCHER = {"fletcher32": True}
change(
    "a virtual dataset on itself",
    virtual("/contours/points"),
    NOT_MOVED,
    message="/contours/points is a virtual dataset",
)
change("a virtual dataset on itself beside the others", virtual("/extra"), UNREAD)
change("a virtual dataset on a system file", virtual("/metrics/length", "/etc/hostname"), TEXTS)
case(
    "external data on a FIFO",
    on_a_fifo("/contours/kind", "u1"),
    NOT_MOVED,
    message="kind has its data in 1 external files",
)
PASSWORDS, ENDLESS = [("/etc/passwd", 0, 48)], [("/dev/zero", 0, 1 << 20)]
change(
    "external data of a system file",
    put("/object/vertices", shape=(4, 3), dtype="<f4", external=PASSWORDS),
    TEXTS,
    message="/object/vertices has its data in 1 external files",
)
change(
    "external data of a device beside the others", put("/extra", shape=(1 << 20,), dtype="u1", external=ENDLESS), UNREAD
)
change(
    "points of 1e9 rows that were never written",
    unallocated(10**9, "/contours/points"),
    NOT_MOVED,
    message="/contours/points declares 122071 chunks, which a file of",
)
change("lengths of 1e9 rows that were never written", unallocated(10**9, "/metrics/length"), TEXTS)
change(
    "points of 1e9 rows in one piece that were never written",
    put("/contours/points", shape=(10**9, 3), dtype="<f4"),
    NOT_MOVED,
    message="declares 12000000000 bytes, 0 are stored",
)
POSE_FIELDS = [f"/metrics/length{part}" for part in ("", "_hand", "_made", "_object")] + ["/metrics/polylines"]
POSE_FIELDS += ["/motion/pose", "/motion/time", "/object/moved", "/contours/pose_start"]
change("2e8 poses that were never written", unallocated(2 * 10**8, *POSE_FIELDS, **FLETCHER))
change(
    "a chunk of 4 GB that was never written", unallocated(2**32 - 2, "/contours/kind", chunks=(2**32 - 2,)), NOT_MOVED
)
change(
    "offsets that were never written, filled with zeros",
    put("/contours/polyline_start", shape=(5,), dtype="<i8", chunks=(5,), fillvalue=0, **FLETCHER),
    CONTOURS,
)
change("chunks that skip their checksum", one_chunk(lambda n: bytes(n + 4), 0b1, **FLETCHER), CONTOURS)
change("a chunk of which the index tells another length", one_chunk(lambda n: bytes(4), **FLETCHER), CONTOURS)
change("a chunk that inflates to 3 GB", one_chunk(inflating, compression="gzip"), CONTOURS, "/contours/kind is damaged")
change(
    "a chunk of 30 MB that inflates to 3 GB",
    one_chunk(inflating, rows=30_000_000, compression="gzip"),
    CONTOURS,
    "inflates to more than its 30000000 bytes",
)


def only_the_first_chunk_written(file):
    kind = file["/contours/kind"][...]
    new = replaced(file, "/contours/kind", shape=kind.shape, dtype="u1", chunks=(8,), fillvalue=1, **FLETCHER)
    new[:8] = kind[:8]


def all_chunks_in_one_place(path):
    """A tree of chunks whose 64 entries point at the same bytes: 262 kB would be read as gigabytes."""
    with h5py.File(path, "r+", libver=("v108", "latest")) as file:
        new = replaced(file, "/contours/kind", shape=(64 << 13,), dtype="u1", chunks=(1 << 13,))
        new[...] = 1
        offsets = [new.id.get_chunk_info(index).byte_offset for index in range(64)]
    content = path.read_bytes()
    for offset in offsets[1:]:
        content = content.replace(struct.pack("<QQ", 0, offset), struct.pack("<QQ", 0, offsets[0]))
    path.write_bytes(content)


def a_chunk_index_without_end(path):
    """A tree of chunks whose every entry is the same node: 32 entries a level, seven levels, none of them right."""
    with h5py.File(path, "r+", libver=("v108", "latest")) as file:
        new = replaced(file, "/contours/kind", shape=(64,), dtype="u1", chunks=(1,))
        new[...] = 1
        room = file.create_dataset("/room", data=np.zeros(1 << 16, "u1")).id.get_offset()
    content = bytearray(path.read_bytes())
    root = next(
        at for at in range(len(content)) if content[at : at + 5] == b"TREE\1" and content[at + 6 : at + 8] == b"\x40\0"
    )
    key = bytes(content[root + 24 : root + 48])  # bytes, filters that were left out, offsets of a chunk
    wrong = struct.pack("<I", 3) + key[4:]
    below = 1 << 40
    for level in range(7):
        entries = (
            struct.pack("<I", 3) + key[4:8] + struct.pack("<QQ", k, 0) + struct.pack("<Q", below) for k in range(32)
        )
        node = struct.pack("<4sBBHqq", b"TREE", 1, level, 32, -1, -1) + b"".join(entries) + wrong
        at = root if level == 6 else room + 4096 * level
        content[at : at + len(node)] = node
        below = at
    path.write_bytes(content)


def chunk_moved(move):
    """The index of chunks leads elsewhere."""

    def make(path):
        with h5py.File(path) as file:
            at = file["/contours/points"].id.get_chunk_info(0).byte_offset
        content = path.read_bytes()
        assert struct.pack("<Q", at) in content
        path.write_bytes(content.replace(struct.pack("<Q", at), struct.pack("<Q", move(at))))

    return make


change("only the first chunk written, filled with sound values", only_the_first_chunk_written, CONTOURS)
case("all chunks in one place", all_chunks_in_one_place, CONTOURS, "/contours/kind is damaged: 63 of its 64 chunks")
case("a chunk index without end", a_chunk_index_without_end, CONTOURS, "/contours/kind is damaged")
case("a chunk beyond the end", chunk_moved(lambda at: 1 << 40), CONTOURS)
case("a bit in the place of a chunk", chunk_moved(lambda at: at ^ 0x20), CONTOURS)

# types


def enumeration():
    kind = h5t.enum_create(h5t.STD_U8LE)
    kind.enum_insert(b"a", 0)
    return kind


def integer_of_128_bits():
    kind = h5t.STD_I64LE.copy()
    kind.set_size(16)
    kind.set_precision(128)
    return kind


def numpy_type(*words):
    return lambda: h5t.py_create(np.dtype(*words), logical=True)


PAIR = [("x", "f4"), ("y", "f4")]
for name, path, kind, refusing, message in (
    (
        "a compound",
        "/contours/points",
        numpy_type(PAIR),
        NOT_MOVED,
        "/contours/points is of an HDF5 compound of 8 bytes",
    ),
    ("an opaque type", "/contours/kind", lambda: h5t.create(h5t.OPAQUE, 16), NOT_MOVED, ""),
    ("object references", "/contours/polyline_patch", h5t.STD_REF_OBJ, NOT_MOVED, ""),
    ("region references", "/contours/polyline_patch", h5t.STD_REF_DSETREG, NOT_MOVED, ""),
    ("lists of any length", "/contours/points", lambda: h5t.vlen_create(h5t.IEEE_F32LE), NOT_MOVED, ""),
    ("lists of lists", "/metrics/length", lambda: h5t.vlen_create(h5t.vlen_create(h5t.IEEE_F32LE)), TEXTS, ""),
    ("an enumeration", "/contours/kind", enumeration, NOT_MOVED, ""),
    ("true and false", "/contours/polyline_closed", numpy_type(bool), NOT_MOVED, ""),
    ("complex numbers", "/metrics/length", numpy_type("c8"), TEXTS, ""),
    ("bit fields", "/contours/kind", h5t.STD_B8LE, NOT_MOVED, ""),
    ("times", "/motion/time", h5t.UNIX_D32LE, None, ""),
    ("arrays", "/contours/points", lambda: h5t.array_create(h5t.IEEE_F32LE, (3,)), NOT_MOVED, ""),
    ("integers of 128 bits", "/contours/pose_start", integer_of_128_bits, NOT_MOVED, ""),
    ("float16", "/contours/points", h5t.IEEE_F16LE, CONTOURS, ""),
    ("float64", "/contours/points", h5t.IEEE_F64LE, CONTOURS, ""),
    ("big-endian numbers", "/contours/points", h5t.IEEE_F32BE, CONTOURS, ""),
    ("floats", "/contours/pose_start", h5t.IEEE_F64LE, CONTOURS, ""),
    ("text", "/contours/kind", lambda: h5t.py_create(h5py.string_dtype(), logical=True), CONTOURS, ""),
    ("text", "/metrics/length", numpy_type("S8"), TEXTS, ""),
    ("text", "/motion/pose", numpy_type("S8"), NOT_PLAYED, ""),
    ("80-bit floats", "/metrics/length", numpy_type("longdouble"), TEXTS, ""),
):
    change(f"{name} in {path}", typed(path, kind), refusing, message)


def named_type(file):
    file["/type"] = np.dtype("f4")
    shape = file["/contours/points"].shape
    del file["/contours/points"]
    file.create_dataset("/contours/points", shape, file["/type"])


change("a type with a name of its own", link("/type", np.dtype("f4")), UNREAD)
change("a dataset of a type with a name", named_type, NOT_MOVED)

# ranks, counts, values

MOTION = ("check", "info", "read", "play", "motion")
for name, path, shape, refusing in (
    ("points of one dimension", "/contours/points", (100,), CONTOURS),
    ("points of four coordinates", "/contours/points", (100, 4), CONTOURS),
    ("points of no coordinates", "/contours/points", (100, 0), CONTOURS),
    ("points of nine dimensions", "/contours/points", (2,) * 9, NOT_MOVED),
    ("offsets of two dimensions", "/contours/pose_start", (31, 2), CONTOURS),
    ("no offsets", "/contours/pose_start", (0,), CONTOURS),
    ("poses of three dimensions", "/motion/pose", (POSES, 7, 1), POSE),
    ("no poses", "/motion/pose", (0, 7), POSE),
    ("poses of 0 numbers", "/motion/pose", (POSES, 0), POSE),
    ("a scalar in place of points", "/contours/points", (), CONTOURS),
    ("a scalar in place of poses", "/motion/pose", (), MOTION),
    ("a scalar in place of times", "/motion/time", (), MOTION),
    ("lengths of fewer poses", "/metrics/length", (POSES - 1,), HEADER),
    ("lengths of two dimensions", "/metrics/length", (POSES, 2), TEXTS),
    ("times of fewer poses", "/motion/time", (POSES - 3,), POSE),
    ("times of two dimensions", "/motion/time", (POSES, 1), MOTION),
    ("faces of two corners", "/object/faces", (4, 2), HEADER),
    ("timing of one dimension", "/timing/seconds", (3,), HEADER),
    ("kinds of fewer points", "/contours/kind", (5,), CONTOURS),
):
    change(name, zeros(path, shape), refusing)
change("a dataset without values", put("/contours/kind", data=h5py.Empty("u1")), NOT_MOVED)
change("a dataset in place of a group", link("/contours", np.zeros(3)), ("check", "info", "read", "play"))
change("a group in place of a dataset", link("/contours/points", lambda f: f.create_group("/x")), CONTOURS)
change("offsets beyond all points", rows("/contours/polyline_start", -1, 1 << 62), CONTOURS)
change("offsets below zero", rows("/contours/pose_start", 3, -(1 << 63)), CONTOURS)
change("faces of vertices that there are not", rows("/object/faces", 0, 1 << 30), ("check",))

# filters


def deflated_three_times():
    return zlib.compress(zlib.compress(zlib.compress(bytes(1 << 28), 9), 9), 9)


PLUG_IN = ("set_filter", 32015, h5z.FLAG_OPTIONAL, (3,))
change("a filter that is a plug-in", filtered(PLUG_IN), NOT_MOVED, message="/contours/kind has filter 32015")
change(
    "a filter of numbers of bits", put("/contours/kind", data=np.ones(99, "u1"), scaleoffset=4, chunks=(99,)), NOT_MOVED
)
change("deflated three times", filtered(*[("set_deflate", 9)] * 3, chunk=deflated_three_times), NOT_MOVED)

# attributes

DEEP = fixed("[" * 30_000 + "]" * 30_000)
for name, path, key, value, refusing, message in (
    ("a version below zero", "/", "version", np.array([-5, -7], np.int32), CONTOURS, "format version -5.-7"),
    ("a version of text", "/", "version", "1.1", CONTOURS, ""),
    ("a version of one number", "/", "version", 1, CONTOURS, ""),
    ("a version of fractions", "/", "version", np.array([1.0, 1.0]), CONTOURS, ""),
    ("an unknown major version", "/", "version", np.array([2, 0], np.int32), CONTOURS, ""),
    ("a version of 64 bits", "/", "version", np.array([1 << 40, 0]), CONTOURS, ""),
    ("a format of another kind", "/", "format", "palpate secrets", CONTOURS, ""),
    ("a format of numbers", "/", "format", np.arange(3), CONTOURS, ""),
    ("a seed of text", "/", "seed", "seven", NOT_PLAYED, ""),
    ("a seed of a fraction", "/", "seed", 7.5, NOT_PLAYED, ""),
    ("a seed of a list", "/", "seed", np.arange(3), NOT_PLAYED, ""),
    ("an offset of text", "/motion", "offset", "soon", POSE, "offset of /motion is 'soon', expected a finite number"),
    ("an offset of NaN", "/motion", "offset", np.nan, ("check", "motion"), ""),
    ("an offset of a list", "/motion", "offset", np.arange(3.0), POSE, ""),
    ("inserted poses of text", "/", "poses_inserted", "many", TEXTS, ""),
    ("an error of the raw intersection of text", "/", "raw_error", "small", TEXTS, ""),
    ("a strategy of numbers", "/", "strategy", 5, TEXTS, ""),
    ("a strategy that is no object", "/", "strategy", "[1]", TEXTS, ""),
    ("a strategy of unequal names", "/", "strategy", '{"raw": 1, "raw": 2}', TEXTS, ""),
    ("a strategy of no number", "/", "strategy", '{"raw": NaN}', TEXTS, ""),
    ("a strategy of half a character", "/", "strategy", r'{"raw": "\ud800"}', TEXTS, ""),
    ("a strategy of 30,000 lists", "/", "strategy", DEEP, TEXTS, "lists or objects lie 30000 deep"),
    ("a strategy of a million lists", "/", "strategy", "[" * 10**6, TEXTS, ""),
    ("a hand of 30,000 lists", "/hand", "description", DEEP, TEXTS, ""),
    ("stages of 30,000 lists", "/timing", "stages", DEEP, HEADER, ""),
    ("stages that are no names", "/timing", "stages", '{"stages": [[1], {}]}', HEADER, ""),
    ("stages that are no list", "/timing", "stages", '{"stages": 5}', HEADER, ""),
    ("versions of numbers", "/", "versions", '{"palpate": 5}', TEXTS, ""),
    ("a recipe of numbers", "/", "recipe", '{"format": [1, 2]}', ("check",), ""),
    ("a stages order of numbers", "/", "strategy", '{"transform": 5}', (), ""),
    ("a name that is not UTF-8", "/object", "name", np.bytes_(b"\xff\xfe"), TEXTS, ""),
    ("a seed of an enumeration", "/", "seed", np.array(True), NOT_PLAYED, ""),
    ("a name of a compound", "/object", "name", np.zeros(4, [("a", "i4")]), TEXTS, ""),
    ("a seed of three dimensions", "/", "seed", np.zeros((2, 2, 2)), NOT_PLAYED, "seed of / has shape [2, 2, 2]"),
    ("a seed of 64 MB", "/", "seed", np.zeros(1 << 23), NOT_PLAYED, "piece of the file's structure has 67"),
    ("a name of many texts", "/object", "name", np.array(["a"] * 9, object), TEXTS, "is a list of texts of any length"),
    ("64 MB beside the other attributes", "/", "extra", np.zeros(1 << 23), UNREAD, ""),
    ("a seed without a value", "/", "seed", h5py.Empty("f4"), NOT_PLAYED, ""),
    ("references to objects", "/", "seed", lambda f: np.array([f["/object"].ref] * 4, h5py.ref_dtype), NOT_PLAYED, ""),
):
    change(name, attribute(path, key, value), refusing, message)
change(
    "20,000 attributes",
    lambda f: [f["/object"].attrs.__setitem__(f"a{k}", k) for k in range(20_000)],
    UNREAD,
)

# what is no file

LARGER = struct.pack("<Q", 1 << 60)
case("a FIFO", in_place(os.mkfifo), message="is a pipe, a device or a socket")
case("a link to a device", in_place(lambda path: path.symlink_to("/dev/zero")))
case("a folder", in_place(Path.mkdir))
case("an empty file", written(lambda content: b""))
case("a signature alone", written(lambda content: content[:8]))
case("half a file", written(lambda content: content[: len(content) // 2]))
case("a superblock that says a larger file", written(lambda content: content[:28] + LARGER + content[36:]))
case("a sound size of zeros", written(lambda content: bytes(len(content))))

# frames, motions

POSITION, INTENSITY = "/focus/position", "/focus/intensity"
for kind, name, edit in (
    ("frames", "frames of version -1", attribute("/", "version", np.array([-1, 0], np.int32))),
    ("frames", "frames of a rate of text", attribute("/focus", "update_rate", "fast")),
    ("frames", "frames of an endless rate", attribute("/focus", "update_rate", np.inf)),
    ("frames", "frames of 1e9 rows that were never written", unallocated(10**9, POSITION, INTENSITY)),
    ("frames", "frames of 1e9 rows in one piece", put(POSITION, shape=(10**9, 3), dtype="<f4")),
    ("frames", "frames on themselves", virtual(POSITION)),
    ("frames", "frames of complex numbers", put(POSITION, data=np.zeros((50, 3), "c8"))),
    ("frames", "frames of float64", put(POSITION, data=np.zeros((50, 3)))),
    ("frames", "frames without focal points", put(POSITION, data=np.zeros((50, 0, 3), "f4"))),
    ("motion", "a motion of 1e9 poses that were never written", unallocated(10**9, "/motion/pose")),
    ("motion", "a motion of a compound", put("/motion/pose", data=np.zeros(5, [("x", "f4")]))),
    ("motion", "a motion on itself", virtual("/motion/pose")),
    ("motion", "a motion that is a link", link("/motion/pose", SoftLink("/motion/time"))),
    ("motion", "a motion that is a dataset", link("/motion", np.zeros(3))),
    ("motion", "a motion with a time of text", put("/motion/time", data=np.array([b"1.0"] * POSES))),
    ("motion", "a motion whose time is one number", put("/motion/time", data=1.0)),
    ("motion", "a motion of lists of any length", put("/motion/pose", shape=(30,), dtype=h5py.vlen_dtype("f4"))),
    ("motion", "a motion with a seed of text", attribute("/motion", "seed", "x")),
    ("motion", "a motion with a seed of truth", attribute("/motion", "seed", np.bool_(True))),
    ("motion", "a motion with an offset of text", attribute("/motion", "offset", "3")),
    ("motion", "a motion with an offset of a list", attribute("/motion", "offset", np.zeros(1))),
):
    change(name, edit, kind=kind)
change("frames of a recipe of 30,000 lists", attribute("/", "recipe", DEEP), TEXTS, kind="frames")
case("a motion on a FIFO", on_a_fifo("/motion/pose", "<f4", 7), kind="motion")
