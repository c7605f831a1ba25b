"""How the fuzzer damages a valid file: bytes of any file, and the structure of the formats that it knows."""

import gzip
import io
import json
import random
import re
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

DEEP = 100_000
"""Levels of nesting, more than any recursion limit."""
CONTROL = "\x1b]0;title\x07\x1b[2J\r\nerror: forged\x00"
"""Characters that would rename a terminal, clear it and forge a line in it."""
PIPE = "pipe"
"""A FIFO beside every case's files: opening it waits for ever."""

Damage = Callable[[bytes, random.Random], bytes]


RAW = ("NaN", "-Infinity", "1e999", "1" * 5000, "[" * DEEP + "]" * DEEP, '{"x":' * DEEP + "1" + "}" * DEEP)
STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**30, 0.5, -0.0, 1e-320, 1e30, 1e308, "", "nan", "x",
    [], {}, [[]], [None], [1, "x"], {"x": 1}, [[1.0, 2.0], [3.0]], CONTROL, "[red]x[/red] [/]", "../../etc/passwd",
    "/dev/zero", PIPE, "\ud800", "é" * 40_000, *(f"@raw{number}@" for number in range(len(RAW))),
)  # fmt: skip
WORDS = (
    "", "nan", "inf", "-1", "1e999", "1e30", "0", "1" * 5000, "9" * 19, "x", CONTROL, "\ufeff", '"', "'", "[", "{",
    "true", "[" * DEEP, "-0", "0x10", "1_0", "1.5", "é", "\u2028", "[/red]", "../../etc/passwd", PIPE,
)  # fmt: skip

# bytes of any file


def flip_bits(content: bytes, rng: random.Random) -> bytes:
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.choice((0, 1, rng.randrange(len(content)), len(content) - 1))]


def other_block(content: bytes, rng: random.Random) -> bytes:
    """A block removed, inserted, or replaced by zeros (as a disk that lost a sector does), ones, noise, other bytes."""
    size = min(rng.choice((1, 2, 8, 64, 512, 4096)), len(content))
    at, begin = (rng.randrange(len(content) - size + 1) for _ in range(2))
    at -= at % size if size >= 512 else 0
    block = rng.choice((bytes(size), b"\xff" * size, rng.randbytes(size), content[begin : begin + size], b""))
    return content[:at] + block + content[at + size * rng.choice((0, 1, 1)) :]


def strange_integer(content: bytes, rng: random.Random) -> bytes:
    """A count, size or address of a header, more likely than elsewhere near the beginning."""
    size = rng.choice((2, 4, 8))
    at = rng.randrange(max(1, min(len(content), rng.choice((64, 1024, len(content)))) - size))
    value = rng.choice((0, 1, 2**7, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1)) % 2 ** (8 * size)
    return content[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + content[at + size :]


def strange_token(content: bytes, rng: random.Random) -> bytes:
    """A word of a text replaced or removed."""
    words = list(re.finditer(rb"[^\s,;=\[\]{}()/]+", content))
    if not words:
        return other_block(content, rng)
    word = rng.choice(words)
    return content[: word.start()] + rng.choice(WORDS).encode() + content[word.end() :]


def strange_line(content: bytes, rng: random.Random) -> bytes:
    """A line of a text removed, repeated, emptied, joined with the next one, or made long."""
    lines = content.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    line = lines[at]
    lines[at] = rng.choice((b"", line * 2, line * 1000, b"\n", line.rstrip(b"\r\n"), line.rstrip() * 2000 + b"\n"))
    return b"".join(lines)


BYTES: tuple[Damage, ...] = (flip_bits, cut, other_block, other_block, other_block, strange_integer)
TEXT: tuple[Damage, ...] = (strange_token, strange_token, strange_line)


def damaged_bytes(content: bytes, rng: random.Random, *, is_text: bool) -> bytes:
    if not content:
        return rng.randbytes(16)
    way = rng.choice((*BYTES, *TEXT, *TEXT, *TEXT) if is_text else BYTES)
    head = next((content.find(end) + len(end) for end in (b"\n\n", b"end_header\n") if end in content[:4096]), None)
    if way in TEXT and head and b"\0" in content[head:]:  # a header of text before binary data
        return way(content[:head], rng) + content[head:]
    return way(content, rng)


# JSON, GLB, archives, arrays


def strange_json(content: bytes, rng: random.Random) -> bytes:
    """Some nodes of a JSON document replaced, removed, repeated or renamed."""
    try:
        document = json.loads(content)
    except ValueError:
        return flip_bits(content, rng)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        document = strange_node(document, rng)
    return json_text(document).encode()


def strange_node(document: Any, rng: random.Random) -> Any:
    """The document with one node changed; a path is walked down at random, so that upper nodes are met often."""
    if not isinstance(document, dict | list) or not document or rng.random() < 0.15:
        return rng.choice(STRANGE)
    key = rng.choice(list(document) if isinstance(document, dict) else range(len(document)))
    child, change = document[key], rng.random()
    if isinstance(child, dict | list) and child and rng.random() < 0.75:
        document[key] = strange_node(child, rng)
    elif change < 0.65:
        document[key] = rng.choice(STRANGE)
    elif change < 0.8:
        del document[key]
    elif isinstance(document, dict):
        document[rng.choice(("x", "", CONTROL, "__class__", "modules", key + "x"))] = child
    else:
        document[key:key] = [child] * rng.choice((1, 3, 1000))
    return document


def json_text(document: Any) -> str:
    """JSON in which the marks of `RAW` are replaced by text that no encoder would write."""
    escaped = json.dumps(document)
    text = escaped if "\\ud800" in escaped else json.dumps(document, ensure_ascii=False)  # UTF-8 has no half surrogates
    return re.sub(r'"@raw(\d)@"', lambda mark: RAW[int(mark[1])], text)


def strange_glb(content: bytes, rng: random.Random) -> bytes:
    """The JSON of a GLB changed, lengths corrected."""
    magic, version, _, size = struct.unpack_from("<4sIII", content)
    text = strange_json(content[20 : 20 + size], rng)
    text += b" " * (-len(text) % 4)
    rest = content[20 + size :]
    return struct.pack("<4sIII4s", magic, version, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def strange_member(content: bytes, rng: random.Random) -> bytes:
    """A member of a ZIP archive renamed, removed, or damaged inside with a right CRC."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as old:
            members = {info.filename: old.read(info) for info in old.infolist()}
    except (zipfile.BadZipFile, EOFError, OSError):
        return flip_bits(content, rng)
    name, change = rng.choice(sorted(members)), rng.random()
    if change < 0.2:
        members[rng.choice(("../x", "/tmp/x", CONTROL, "x" * 300, name + "x"))] = members.pop(name)
    elif change < 0.3:
        del members[name]
    elif change < 0.65 and name.endswith(".npy"):
        members[name] = strange_array(members[name], rng)
    else:
        members[name] = damaged_bytes(members[name], rng, is_text=name.endswith((".model", ".xml", ".rels", ".json")))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for own, inside in members.items():
            new.writestr(own, inside)
    return out.getvalue()


def strange_array(content: bytes, rng: random.Random) -> bytes:
    """A .npy file of another type, rank or size; or one whose header declares more than there is."""
    if rng.random() < 0.3:
        shape = rng.choice(("(1000000000,)", "(100000, 100000)", "(-1,)", "(2, 2, 2, 2, 2)", "()", "(0,)"))
        return re.sub(rb"'shape': \([^)]*\)", f"'shape': {shape}".encode(), content)
    values = np.load(io.BytesIO(content))
    out = io.BytesIO()
    np.save(out, strange_values(values if values.dtype.kind in "iufb" else np.zeros(3), rng))
    return out.getvalue()


TYPES = ("f4", "f8", "f2", ">f4", "i1", "i4", "i8", "u1", "u8", "?", "c8", "c16", "S4", "M8[s]", "V4")


def strange_values(values: np.ndarray, rng: random.Random) -> np.ndarray:
    """Numbers of another type, rank or size; some or all of them outside every range; no numbers."""
    limits = (0, -1, np.iinfo(values.dtype).max) if values.dtype.kind in "iu" else (np.nan, np.inf, -1.0, 1e30, 0, 3e38)
    strange, every = rng.choice(limits), rng.choice((1, 3, 7, max(values.size, 1)))
    with np.errstate(all="ignore"):
        number = np.array(strange).astype(values.dtype)
        changed = [
            lambda: values.astype(rng.choice(TYPES)),
            lambda: np.concatenate([values.reshape(-1), values.reshape(-1)]),
            lambda: values[..., None],
            lambda: values.reshape(-1),
            lambda: values[:0] if values.ndim else np.zeros(0),
            lambda: values[:-1] if values.ndim else values,
            lambda: number,
            lambda: np.zeros(3, [("x", "f4"), ("y", "i4")]),
            lambda: np.array(CONTROL.replace("\0", "").encode()),
            *[lambda: np.where(np.arange(values.size).reshape(values.shape) % every == 0, number, values)] * 4,
        ]
        return rng.choice(changed)()


# SQLite, as a hostile writer would change it; `hostile_hdf5` has HDF5 files of such writers


def damage_sqlite(path: Path, rng: random.Random) -> str:
    """Change one value of a database to one of another type, or a row, a table, or the file's marks."""
    values = (None, -1, 2**62, "x", "", CONTROL, b"\xff", 1.5, "{}", "[]", "../../etc/passwd", "[" * DEEP)
    with sqlite3.connect(path, isolation_level=None) as database:
        table = rng.choice(
            [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        )
        column = rng.choice([row[1] for row in database.execute(f'PRAGMA table_info("{table}")')])
        first, mark = (
            f'WHERE rowid = (SELECT rowid FROM "{table}" LIMIT 1)',
            rng.choice(("user_version", "application_id")),
        )
        change = rng.choice(
            (
                *[f'UPDATE "{table}" SET "{column}" = ? {first}'] * 3,
                f'DROP TABLE "{table}"',
                f'DELETE FROM "{table}" {first}',
                f"PRAGMA {mark} = {rng.choice((0, 7, -1))}",
            )
        )
        database.execute(change, (rng.choice(values),) if "?" in change else ())
    database.close()
    return f"structure: {change}"


# any file, by its suffix

TEXT_SUFFIXES = (
    ".csv", ".json", ".toml", ".obj", ".ptlist", ".pat", ".py", ".off", ".gltf", ".nhdr", ".mtl", ".dae", ".xyz",
)  # fmt: skip


def _strange_gzip(content: bytes, rng: random.Random) -> bytes:
    return gzip.compress(damaged_bytes(gzip.decompress(content), rng, is_text=False), mtime=0)


STRUCTURED: dict[str, Damage] = {
    ".json": strange_json, ".gltf": strange_json, ".glb": strange_glb, ".npy": strange_array, ".gz": _strange_gzip,
    ".npz": strange_member,
}  # fmt: skip


def damage(path: Path, rng: random.Random) -> str:
    """Damage a file in place; how it was done begins with `structure` where checksums may be right."""
    content = path.read_bytes()
    try:
        how = _damage(path, content, rng)
    except Exception:  # of the libraries that write such a file, where they cannot write this change
        path.write_bytes(flip_bits(content, rng))
        how = "bytes"
    for _ in range(rng.choice((0, 0, 0, 0, 1, 2))):
        path.write_bytes(damaged_bytes(path.read_bytes(), rng, is_text=False))
        how += " and bytes"
    return how


def _damage(path: Path, content: bytes, rng: random.Random) -> str:
    suffix = path.suffix.lower()
    if suffix == ".sqlite" and rng.random() < 0.5:
        return damage_sqlite(path, rng)
    if suffix in STRUCTURED and rng.random() < 0.7:
        path.write_bytes(STRUCTURED[suffix](content, rng))
        return f"structure: {STRUCTURED[suffix].__name__}"
    is_text = suffix in TEXT_SUFFIXES or content[:4] == b"NRRD" or content[:6] in (b"solid ", b"ply\nfo")
    path.write_bytes(damaged_bytes(content, rng, is_text=is_text))
    return "bytes"
