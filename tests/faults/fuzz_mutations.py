"""How the fuzzer damages a valid file: bytes of any file, and the structure of JSON, text, archives and GLB."""

import gzip
import io
import json
import random
import re
import struct
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

DEEP = 100_000
"""Levels of nesting, more than any recursion limit."""
CONTROL = "\x1b]0;title\x07\x1b[2J\r\nerror: forged\x00"
"""What would rename a terminal, clear it and forge a line in it."""
PIPE = "pipe"
"""A FIFO beside every case's files: whoever opens it waits for ever."""
BOMB_BYTES = 1_500_000_000
"""What a compressed file of some megabytes, or a header of some bytes, can say that it holds."""

Damage = Callable[[bytes, random.Random], bytes]


class Raw(str):
    """Text that stands in JSON as it is, though no encoder would write it."""


STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**30, 0.5, -0.0, 1e-320, 1e30, 1e308, "", "nan", "x",
    [], {}, [[]], [None], [1, "x"], {"x": 1}, [[1.0, 2.0], [3.0]], CONTROL, "[red]x[/red] [/]", "../../etc/passwd",
    "/dev/zero", PIPE, "\ud800", "é" * 40_000, Raw("NaN"), Raw("-Infinity"), Raw("1e999"), Raw("1" * 5000),
    Raw("[" * DEEP + "]" * DEEP), Raw('{"x":' * DEEP + "1" + "}" * DEEP),
)  # fmt: skip


def flip_bits(content: bytes, rng: random.Random) -> bytes:
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def fill_block(content: bytes, rng: random.Random) -> bytes:
    """As a disk that lost a sector, or never wrote a page: mostly zeros, sometimes ones."""
    out = bytearray(content)
    size = min(rng.choice((1, 4, 16, 64, 512, 4096)), len(out))
    first = rng.randrange(len(out) - size + 1)
    if size >= 512:
        first -= first % size
    out[first : first + size] = bytes([rng.choice((0, 0, 0xFF))]) * size
    return bytes(out)


def cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.choice((0, 1, rng.randrange(len(content)), len(content) - 1))]


def insert(content: bytes, rng: random.Random) -> bytes:
    at, size = rng.randrange(len(content) + 1), rng.choice((1, 2, 8, 100, 4096))
    begin = rng.randrange(len(content))
    added = rng.randbytes(size) if rng.random() < 0.5 else content[begin : begin + size]
    return content[:at] + added + content[at:]


def remove(content: bytes, rng: random.Random) -> bytes:
    at, size = rng.randrange(len(content)), rng.choice((1, 2, 8, 100, 4096))
    return content[:at] + content[at + size :]


def swap_blocks(content: bytes, rng: random.Random) -> bytes:
    size = max(1, min(rng.choice((1, 8, 64, 512, 4096)), len(content) // 2))
    a, b = sorted(rng.randrange(0, len(content) // size) * size for _ in range(2))
    if b < a + size:
        return flip_bits(content, rng)
    return content[:a] + content[b : b + size] + content[a + size : b] + content[a : a + size] + content[b + size :]


def strange_integer(content: bytes, rng: random.Random) -> bytes:
    """A count, size or address of a header, more likely than elsewhere near the beginning."""
    size = rng.choice((2, 4, 8))
    at = rng.randrange(max(1, min(len(content), rng.choice((64, 1024, len(content)))) - size))
    value = rng.choice((0, 1, 2**7, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1)) % 2 ** (8 * size)
    return content[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + content[at + size :]


BYTES: tuple[Damage, ...] = (flip_bits, fill_block, cut, insert, remove, swap_blocks, strange_integer)


def strange_token(content: bytes, rng: random.Random) -> bytes:
    """A word of a text replaced, removed or repeated."""
    words = list(re.finditer(rb"[^\s,;=\[\]{}()/]+", content))
    if not words:
        return insert(content, rng)
    word = rng.choice(words)
    value = rng.choice(
        ("", "nan", "inf", "-1", "1e999", "1e30", "0", "1" * 5000, "9" * 19, "x", CONTROL, "\ufeff", '"', "'", "[", "{",
         "true", "[" * DEEP, "-0", "0x10", "1_0", "1.5", "é", "\u2028", "[/red]", "../../etc/passwd", PIPE)
    ).encode()  # fmt: skip
    return content[: word.start()] + value + content[word.end() :]


def strange_line(content: bytes, rng: random.Random) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    change = rng.choice(("remove", "repeat", "swap", "empty", "join", "long"))
    if change == "remove":
        del lines[at]
    elif change == "repeat":
        lines[at:at] = [lines[at]] * rng.choice((1, 2, 1000))
    elif change == "swap":
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif change == "join":
        lines[at] = lines[at].rstrip(b"\r\n")
    else:
        lines[at] = b"\n" if change == "empty" else lines[at].rstrip() * 2000 + b"\n"
    return b"".join(lines)


TEXT: tuple[Damage, ...] = (strange_token, strange_token, strange_line)


def strange_json(content: bytes, rng: random.Random) -> bytes:
    """Some nodes of a JSON document replaced, removed, repeated or renamed."""
    try:
        document = json.loads(content)
    except ValueError:
        return flip_bits(content, rng)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        document = strange_node(document, rng)
    return json_text(document).encode()


def json_text(document: Any) -> str:
    """JSON with raw pieces in it."""
    raw: list[str] = []

    def plain(node: Any) -> Any:
        if isinstance(node, Raw):
            raw.append(str(node))
            return f"@raw{len(raw) - 1}@"
        if isinstance(node, dict):
            return {str(key): plain(value) for key, value in node.items()}
        return [plain(value) for value in node] if isinstance(node, list) else node

    changed = plain(document)
    escaped = json.dumps(changed)
    text = escaped if "\\ud800" in escaped else json.dumps(changed, ensure_ascii=False)  # UTF-8 has no half surrogates
    for number, piece in enumerate(raw):
        text = text.replace(f'"@raw{number}@"', piece)
    return text


def strange_node(document: Any, rng: random.Random) -> Any:
    """The document with one node changed; a path is walked down at random, so that upper nodes are met often."""
    if not isinstance(document, dict | list) or not document or rng.random() < 0.15:
        return rng.choice(STRANGE)
    keys = list(document) if isinstance(document, dict) else list(range(len(document)))
    key = rng.choice(keys)
    child = document[key]
    if isinstance(child, dict | list) and child and rng.random() < 0.75:
        document[key] = strange_node(child, rng)
        return document
    change = rng.random()
    if change < 0.65:
        document[key] = rng.choice(STRANGE)
    elif change < 0.8:
        del document[key]
    elif isinstance(document, dict):
        document[rng.choice(("x", "", CONTROL, "__class__", "modules", key + "x"))] = child
    else:
        document[key:key] = [child] * rng.choice((1, 3, 1000))
    return document


def strange_glb(content: bytes, rng: random.Random) -> bytes:
    """The JSON of a GLB changed, lengths corrected."""
    magic, version, _, size = struct.unpack_from("<4sIII", content)
    text = strange_json(content[20 : 20 + size], rng)
    text += b" " * (-len(text) % 4)
    rest = content[20 + size :]
    return struct.pack("<4sIII4s", magic, version, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def strange_member(content: bytes, rng: random.Random) -> bytes:
    """A member of a ZIP archive damaged inside, its CRC being right."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as old:
            members = {info.filename: old.read(info) for info in old.infolist()}
    except (zipfile.BadZipFile, EOFError, OSError):
        return flip_bits(content, rng)
    name = rng.choice(sorted(members))
    change = rng.random()
    if change < 0.2:
        members[rng.choice(("../x", "/tmp/x", CONTROL, "x" * 300, name + "x"))] = members.pop(name)
    elif change < 0.3:
        del members[name]
    elif change < 0.65 and name.endswith(".npy"):
        members[name] = strange_array(members[name], rng)
    elif members[name]:
        members[name] = damaged_bytes(members[name], rng, is_text=name.endswith((".model", ".xml", ".rels", ".json")))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for own, inside in members.items():
            new.writestr(own, inside)
    return out.getvalue()


def strange_array(content: bytes, rng: random.Random) -> bytes:
    """A .npy file of another type, rank or size; or one whose header says more than there is."""
    if rng.random() < 0.3:
        shape = rng.choice(("(1000000000,)", "(100000, 100000)", "(-1,)", "(2, 2, 2, 2, 2)", "()", "(0,)"))
        return re.sub(rb"'shape': \([^)]*\)", f"'shape': {shape}".encode(), content)
    values = np.load(io.BytesIO(content))
    numbers = values if values.dtype.kind in "iufb" else np.zeros(3)
    changed = rng.choice(
        [
            lambda: numbers.astype(rng.choice(("f8", "f2", "i1", "u8", "c16", "?", ">f4", "S3", "U3", "M8[s]", "V4"))),
            lambda: numbers[..., None],
            lambda: numbers.reshape(-1),
            lambda: numbers.reshape(-1)[:0],
            lambda: np.array(rng.choice((0.0, np.nan, 1e30, -1))),
            lambda: np.where(np.arange(max(numbers.size, 1)).reshape(numbers.shape or (1,)) % 7 == 0, np.nan, numbers),
            lambda: np.full(numbers.shape, rng.choice((np.inf, np.nan, -1, 1e30, 1e308, 0))),
            lambda: np.zeros(3, [("x", "f4"), ("y", "i4")]),
            lambda: np.array(CONTROL),
        ]
    )
    out = io.BytesIO()
    with np.errstate(all="ignore"):
        np.save(out, changed())
    return out.getvalue()


@cache
def bomb(suffix: str, is_honest: bool, member: int) -> bytes:
    """A small file that holds `BOMB_BYTES`, and says so if it is honest; or one that only says so."""
    zeros, count = bytes(1 << 20), BOMB_BYTES >> 20
    sizes = (1000, 1000, BOMB_BYTES // 10**6) if is_honest else (9, 8, 10)
    out = io.BytesIO()
    if suffix in (".npz", ".zip", ".3mf"):
        own = {".npz": ("values.npy", "t.npy", "vertices.npy"), ".zip": ("box.stl", "box.obj", "box.ply")}
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            name = own.get(suffix, ("3D/3dmodel.model",) * 3)[member]
            with archive.open(name, "w", force_zip64=True) as stream:
                if suffix == ".npz":
                    head = {"descr": "|u1", "fortran_order": False, "shape": (1000, 1000, BOMB_BYTES // 10**6)}
                    np.lib.format.write_array_header_1_0(stream, head)
                for _ in range(count if is_honest else 1):
                    stream.write(zeros)
        return out.getvalue()
    if suffix == ".nrrd":
        told = " ".join(map(str, sizes)).encode()
        out.write(b"NRRD0005\ntype: uint8\ndimension: 3\nsizes: %b\nspacings: 1 1 1\nencoding: gzip\n\n" % told)
    with gzip.GzipFile(fileobj=out, mode="wb", compresslevel=1, mtime=0) as stream:
        if suffix == ".gz":
            stream.write(nifti_head(sizes))
        for _ in range(count):
            stream.write(zeros)
    return out.getvalue()


def nifti_head(sizes: tuple[int, int, int]) -> bytes:
    """Of a NIfTI-1 file of bytes: its own length, rank and sizes, type, where values begin, mark."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *sizes, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 2, 8)
    struct.pack_into("<f", head, 108, 352.0)
    head[344:348] = b"n+1\0"
    return bytes(head)


def damaged_bytes(content: bytes, rng: random.Random, *, is_text: bool) -> bytes:
    if not content:
        return rng.randbytes(16)
    ways = (*BYTES, *TEXT, *TEXT, *TEXT) if is_text else BYTES
    way = rng.choice(ways)
    head = next((content.find(end) + len(end) for end in (b"\n\n", b"end_header\n") if end in content[:4096]), None)
    if way in TEXT and head and b"\0" in content[head:]:  # a header of text before binary data
        return way(content[:head], rng) + content[head:]
    return way(content, rng)


TEXT_SUFFIXES = {
    ".csv", ".json", ".toml", ".obj", ".ptlist", ".pat", ".py", ".off", ".gltf", ".nhdr", ".mtl", ".dae", ".xyz",
}  # fmt: skip


def damage(path: Path, rng: random.Random) -> str:
    """Damage a file in place; the way it was done, `bytes` where checksums are not made right again."""
    content = path.read_bytes()
    suffix = path.suffix.lower()
    structured: dict[str, Damage] = {".json": strange_json, ".gltf": strange_json, ".glb": strange_glb}
    structured |= dict.fromkeys((".npz", ".3mf", ".zip"), strange_member)
    structured |= {".npy": strange_array, ".gz": _inside_gzip}
    is_text = suffix in TEXT_SUFFIXES or content[:4] == b"NRRD" or content[:6] in (b"solid ", b"ply\nfo")
    if suffix in (".npz", ".gz", ".zip", ".3mf", ".nrrd") and rng.random() < 0.04:
        path.write_bytes(bomb(suffix, rng.random() < 0.5, rng.randrange(3)))
        return "structure:bomb"
    if suffix in structured and rng.random() < 0.7:
        path.write_bytes(structured[suffix](content, rng))
        return f"structure:{structured[suffix].__name__}"
    path.write_bytes(damaged_bytes(content, rng, is_text=is_text))
    return "bytes"


def _inside_gzip(content: bytes, rng: random.Random) -> bytes:
    try:
        inside = gzip.decompress(content)
    except (OSError, EOFError):
        return flip_bits(content, rng)
    return gzip.compress(damaged_bytes(inside, rng, is_text=False), mtime=0)
