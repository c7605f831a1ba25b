"""How the fuzzer changes HDF5, SQLite and Parquet: as a hostile writer would, all checksums being right."""

import hashlib
import json
import random
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from fuzz_mutations import CONTROL, DEEP, PIPE, strange_json

TRAILER = struct.Struct("<16sQ32s")
"""Of a shard, by docs/formats/sweep-store.md: mark, length, BLAKE2b-256."""

STRANGE_ATTRIBUTES: tuple[Callable[[], Any], ...] = (
    lambda: 0,
    lambda: -1,
    lambda: np.int64(2**62),
    lambda: np.uint64(2**64 - 1),
    lambda: np.nan,
    lambda: 1e30,
    lambda: True,
    lambda: "x",
    lambda: "",
    lambda: CONTROL.replace("\x00", ""),
    lambda: "[red]x[/] [/nothing]",
    lambda: np.bytes_(b"\xff\xfe\x80"),
    lambda: np.array([1, 2, 3], np.int32),
    lambda: np.array([-5, -7], np.int32),
    lambda: np.array([99, 0], np.int32),
    lambda: np.array([1.0, 0.0]),
    lambda: np.zeros((2, 2)),
    lambda: np.zeros(0),
    lambda: h5py.Empty("f8"),
    lambda: h5py.Empty("S1"),
    lambda: np.array(["a", "b"], dtype=h5py.string_dtype()),
    lambda: np.zeros(2, [("x", "f4"), ("y", "i4")]),
    lambda: np.zeros(1, h5py.ref_dtype),
    lambda: np.array((1 << 15) * "x", dtype=h5py.string_dtype()),
    lambda: "{",
    lambda: "[]",
    lambda: '{"kind": "palm"}',
    lambda: "[" * DEEP,
    lambda: '{"x": ' * 5000 + "1" + "}" * 5000,
    lambda: '{"stages": [1, null, "x"]}',
    lambda: '{"x": ' + "1" * 5000 + "}",
    lambda: "é" * 20_000,
)

TYPES = ("f4", "f8", "f2", ">f4", "i1", "i4", "i8", "u1", "u8", "?", "c8", "S4", "V3")


def damage_hdf5(path: Path, rng: random.Random) -> str:
    """Change one or two objects of an HDF5 file; a shard's own digest is made right."""
    content = path.read_bytes()
    is_shard = content[-TRAILER.size :].startswith(b"palpate shard ")
    mark = content[-TRAILER.size : -TRAILER.size + 16]
    names: list[str] = []
    try:
        with h5py.File(path, "r+", locking=False) as file:
            for _ in range(rng.choice((1, 1, 2))):
                names.append(_change(file, rng, path))
                if names[-1] in ("relinked", "unallocated", "outside") or "group" in names[-1]:
                    break  # changing more would read it
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:  # what h5py cannot write is not written
        names.append(f"refused {type(error).__name__}")
    if is_shard:
        image = path.read_bytes().removesuffix(content[-TRAILER.size :])
        path.write_bytes(image + TRAILER.pack(mark, len(image), hashlib.blake2b(image, digest_size=32).digest()))
    return f"structure:{'+'.join(names)}"


def _change(file: h5py.File, rng: random.Random, path: Path) -> str:
    places: list[str] = ["/"]
    file.visit(lambda name: places.append(f"/{name}"))
    name = rng.choice(places)
    found: Any = file[name]
    if len(found.attrs) and rng.random() < (0.4 if name != "/" else 0.9):
        return _change_attribute(found, rng)
    if name == "/":
        return _change_attribute(found, rng) if len(found.attrs) else "nothing"
    if isinstance(found, h5py.Group):
        return _change_group(file, name, rng)
    way = rng.choice((_retyped, _reshaped, _revalued, _revalued, _relinked, _unallocated, _outside))
    attributes = {key: found.attrs[key] for key in found.attrs}
    way(file, name, rng, path)
    if name in file and isinstance(file.get(name, getlink=True), h5py.HardLink):
        for key, value in attributes.items():
            file[name].attrs[key] = value
    return way.__name__.strip("_")


def _change_attribute(found: Any, rng: random.Random) -> str:
    key = rng.choice(sorted(found.attrs))
    old = found.attrs[key]
    if rng.random() < 0.1:
        del found.attrs[key]
        return "attribute removed"
    text = old.decode(errors="replace") if isinstance(old, bytes) else old
    if isinstance(text, str) and text.startswith(("{", "[")) and rng.random() < 0.6:
        del found.attrs[key]
        found.attrs[key] = strange_json(text.encode(), rng).decode(errors="replace").replace("\x00", "")
        return "attribute json"
    value = rng.choice(STRANGE_ATTRIBUTES)()
    if isinstance(value, str) and len(value) > 60_000:
        value = np.bytes_(value[:60_000].encode()[:60_000])
    del found.attrs[key]
    found.attrs[key] = value
    return "attribute"


def _change_group(file: h5py.File, name: str, rng: random.Random) -> str:
    change = rng.choice(("removed", "dataset", "loop", "external"))
    del file[name]
    if change == "dataset":
        file[name] = np.zeros(3)
    elif change == "loop":
        file[name] = h5py.SoftLink(name)
    elif change == "external":
        file[name] = h5py.ExternalLink("/etc/passwd", name)
    return f"group {change}"


def _put(file: h5py.File, name: str, values: Any) -> None:
    del file[name]
    file.create_dataset(name, data=values)


def _retyped(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    del path
    values = file[name][()]
    with np.errstate(all="ignore"):
        if rng.random() < 0.2:
            _put(file, name, np.array(["x"] * 3, dtype=h5py.string_dtype()))
        elif rng.random() < 0.2:
            _put(file, name, np.zeros(3, [("x", "f4")]))
        else:
            _put(file, name, np.asarray(values).astype(rng.choice(TYPES)))


def _reshaped(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    del path
    values = np.asarray(file[name][()])
    options = [values[..., None], values.reshape(-1), values[:0], values[:-1] if values.ndim else values]
    options += [values.reshape(-1)[0] if values.size else np.array(0), np.concatenate([values, values])]
    _put(file, name, rng.choice(options)) if values.ndim else _put(file, name, np.zeros(3))


def _revalued(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    del path
    dataset = file[name]
    values = np.array(dataset[()])
    if values.size == 0 or values.dtype.kind not in "iuf":
        return
    flat = values.reshape(-1)
    where = rng.choice((slice(None), slice(0, 1), slice(-1, None), slice(None, None, 3)))
    if values.dtype.kind == "f":
        flat[where] = rng.choice((np.nan, np.inf, -1.0, 1e30, 0.0, 3e38))
    else:
        limits = np.iinfo(values.dtype)
        flat[where] = rng.choice((0, 1, 2, limits.max, limits.min, limits.max // 2))
    dataset[...] = flat.reshape(values.shape)


def _relinked(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    others = [other for other in _datasets(file) if other != name] or [name]
    target = rng.choice(others)
    del file[name]
    file[name] = rng.choice(
        (h5py.SoftLink(target), h5py.SoftLink(name), h5py.SoftLink("/nowhere"), h5py.ExternalLink(path.name, target))
    )


def _unallocated(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    del path
    old = file[name]
    dtype, rest = old.dtype, old.shape[1:]
    count = rng.choice((10**6, 10**9, 2 * 10**8, 2**40))
    del file[name]
    file.create_dataset(name, shape=(count, *rest), dtype=dtype, chunks=(8192, *rest) if rng.random() < 0.5 else None)


def _outside(file: h5py.File, name: str, rng: random.Random, path: Path) -> None:
    """A dataset that is virtual, on itself or on nothing; or whose bytes lie in a file of the system."""
    old = file[name]
    dtype, shape = old.dtype, old.shape or (3,)
    del file[name]
    if rng.random() < 0.5:
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource(rng.choice((".", path.name, "nowhere.h5")), name, shape, dtype)
        file.create_virtual_dataset(name, layout)
    else:
        where = rng.choice(("/etc/passwd", "/dev/zero", "nowhere.raw", str(path.with_name(PIPE))))
        size = int(np.prod(shape)) * dtype.itemsize
        file.create_dataset(name, shape, dtype, external=[(where, 0, size)])


def _datasets(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(lambda name, found: names.append(f"/{name}") if isinstance(found, h5py.Dataset) else None)
    return names


def damage_sqlite(path: Path, rng: random.Random) -> str:
    """Change one value of a database to one of another type, or a row, a table, or what the file says that it is."""
    with sqlite3.connect(path, isolation_level=None) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice(tables)
        columns = [row[1] for row in database.execute(f'PRAGMA table_info("{table}")')]
        column = rng.choice(columns)
        change = rng.choice(("value", "value", "value", "drop", "delete", "pragma"))
        try:
            if change == "value":
                value = rng.choice(
                    (None, -1, 2**62, "x", "", CONTROL, b"\xff", 1.5, "{}", "[]", "../../etc/passwd", "[" * DEEP)
                )
                database.execute(
                    f'UPDATE "{table}" SET "{column}" = ? WHERE rowid = (SELECT rowid FROM "{table}" LIMIT 1)', (value,)
                )
            elif change == "drop":
                database.execute(f'DROP TABLE "{table}"')
            elif change == "delete":
                database.execute(f'DELETE FROM "{table}" WHERE rowid = (SELECT rowid FROM "{table}" LIMIT 1)')
            else:
                database.execute(f"PRAGMA {rng.choice(('user_version', 'application_id'))} = {rng.choice((0, 7, -1))}")
        except sqlite3.Error:
            change = "refused"
    database.close()
    return f"structure:sqlite {change}"


def damage_parquet(path: Path, rng: random.Random) -> str:
    """A column of another type, or other metadata."""
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    at = rng.randrange(table.num_columns)
    name, count = table.column_names[at], table.num_rows
    values = rng.choice(
        (["x"] * count, [None] * count, [[1, 2]] * count, [{"x": 1}] * count, [b"\xff"] * count, [2**62] * count)
    )
    change = rng.choice(("type", "type", "name", "metadata", "drop"))
    if change == "type":
        table = table.set_column(at, name, [values])
    elif change == "name":
        table = table.rename_columns([CONTROL if own == name else own for own in table.column_names])
    elif change == "metadata":
        own = rng.choice((b"{", b"[]", b"\xff", b'{"format": 1}', json.dumps({"version": [1]}).encode()))
        table = table.replace_schema_metadata({"palpate": own})
    else:
        table = table.drop_columns([name])
    pyarrow.parquet.write_table(table, path)
    return f"structure:parquet {change}"
