"""Damages a sweep's store, and counts what reading it gives: right, an error, or something wrong."""

import shutil
from collections import Counter
from pathlib import Path

import numpy as np
from sweep_store_rows import MAKER, places_of, write_rows

from palpate.datasets.errors import DatasetError
from palpate.datasets.sweeps.shard import read_shard
from palpate.datasets.sweeps.store import SweepStore

BLOCKS = (16, 64, 512, 4096)
RECIPE_SHARDS, LEFT_SHARDS = 18, 2


def damaged(content, chance):
    """The bytes of a file with one damage of a random kind, and its name."""
    kinds = (_flip, _byte, _zeros, _ones, _cut, _lose, _swap, _copy)
    kind = kinds[chance.integers(len(kinds))]
    return kind(content, chance), kind.__name__.strip("_")


def _place(content, chance, size=1):
    """A place for a block of a size; blocks of a page or a sector lie where these do."""
    at = int(chance.integers(max(1, len(content) - size)))
    return at // size * size if size >= 512 else at


def _flip(content, chance):
    at = _place(content, chance)
    return content[:at] + bytes([content[at] ^ (1 << int(chance.integers(8)))]) + content[at + 1 :]


def _byte(content, chance):
    at = _place(content, chance)
    return content[:at] + chance.bytes(1) + content[at + 1 :]


def _zeros(content, chance, filling=b"\0"):
    size = int(chance.choice(BLOCKS))
    at = _place(content, chance, size)
    return content[:at] + filling * len(content[at : at + size]) + content[at + size :]


def _ones(content, chance):
    return _zeros(content, chance, b"\xff")


def _cut(content, chance):
    return content[: _place(content, chance)]


def _lose(content, chance):
    """Bytes from the middle are gone, and what follows moves up."""
    size = int(chance.choice(BLOCKS))
    at = _place(content, chance, size)
    return content[:at] + content[at + size :]


def _swap(content, chance):
    size = int(chance.choice(BLOCKS))
    a, b = sorted((_place(content, chance, size), _place(content, chance, size)))
    if b < a + size or b + size > len(content):
        return _zeros(content, chance)
    return content[:a] + content[b : b + size] + content[a + size : b] + content[a : a + size] + content[b + size :]


def _copy(content, chance):
    """A block that was never written: the disk has what another place has."""
    size = int(chance.choice(BLOCKS))
    a, b = _place(content, chance, size), _place(content, chance, size)
    block = content[a : a + size]
    return (content[:b] + block + content[b + len(block) :])[: len(content)]


def make_store(folder):
    """A store of 54 parts, 18 of them with columns, two shards that nobody recorded yet, and a failure."""
    with SweepStore(folder, maker=MAKER) as store:
        for number in range(RECIPE_SHARDS + LEFT_SHARDS):
            name = f"shards/1-{number}.h5"
            write_rows(store.folder / name, places_of(1, number))
            if number < RECIPE_SHARDS:
                store.record(name)
        store.record_failure("0123abcd", "object: it is open")


def keys_of(folder):
    """Every (group, key) of a store."""
    with SweepStore(folder, mode="read") as store:
        rows = store._manifest.run('SELECT DISTINCT "group", key FROM part')
    return [(str(group), str(key)) for group, key in rows]


def read_store(folder, keys):
    """All that a store tells of what it has; a part is left out of `done` only if it is of no other."""
    with SweepStore(folder, mode="read") as store:
        return {
            "makers": store.makers(),
            "done": store.done(keys),
            "results": list(store.results(keys)),
            "columns": {(group, key): list(store.column_parts(key, group=group)) for group, key in keys},
            "failed": store.failed(),
        }


def read_path(path, keys):
    """What a file, or the store of a file of a store, gives."""
    if path.parent.name == "shards":
        shard = read_shard(path)
        return shard.maker, shard.rows, shard.columns
    return read_store(path.parent if path.name == "store.sqlite" else path.parent.parent, keys)


def alike(a, b):
    """Whether two readings are the same to the bit."""
    if isinstance(a, np.ndarray):
        same = isinstance(b, np.ndarray) and (a.dtype, a.shape) == (b.dtype, b.shape)
        return same and (list(a) == list(b) if a.dtype == object else a.tobytes() == b.tobytes())
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(alike(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(alike, a, b))
    return type(a) is type(b) and (a == b or a != a)


def outcome_of(read, expected):
    """What came of a reading: "right", "error" (one that says what is wrong), "raw error" or "WRONG"."""
    try:
        found = read()
    except DatasetError:
        return "error", ""
    except Exception as error:
        return "raw error", f"{type(error).__name__}: {error}"
    return ("right", "") if alike(expected, found) else ("WRONG", _difference(expected, found))


def _difference(a, b):
    if isinstance(a, dict) and isinstance(b, dict):
        return ", ".join(str(key) for key in {*a, *b} if key not in a or key not in b or not alike(a[key], b[key]))
    return "values"


def files_of(folder):
    """The files of a store that are read, each with its kind."""
    files = [(sub, path) for sub in ("columns", "shards") for path in sorted((folder / sub).glob("*.*"))]
    return [("store.sqlite", folder / "store.sqlite"), *files]


class Damages:
    """Damages of a store, one at a time, each in a copy of its own."""

    def __init__(self, original, scratch, seed):
        self.original, self.scratch = Path(original), Path(scratch)
        self.chance = np.random.default_rng(seed)
        self.keys = keys_of(self.original)
        self.files = files_of(self.original)
        self.kinds = sorted({kind for kind, _ in self.files})
        self.expected = {path: read_path(path, self.keys) for _, path in self.files}
        self.counts = Counter()
        self.told = []

    def once(self, number):
        """Damage one file, kind after kind; what came of reading it, which is counted."""
        kind = self.kinds[number % len(self.kinds)]
        paths = [path for own, path in self.files if own == kind]
        path = paths[self.chance.integers(len(paths))]
        content = path.read_bytes()
        changed, how = damaged(content, self.chance)
        copy = self.copy() / path.relative_to(self.original)
        copy.write_bytes(changed)
        outcome, what = outcome_of(lambda: read_path(copy, self.keys), self.expected[path])
        self.counts[kind, outcome] += 1
        if outcome not in ("right", "error"):
            at = next((k for k, (a, b) in enumerate(zip(content, changed, strict=False)) if a != b), len(changed))
            self.told.append(f"{number}: {outcome}: {path.name}, {how} at {at}: {what}")
        return outcome

    def copy(self):
        """A fresh copy of the store."""
        target = self.scratch / "damaged"
        shutil.rmtree(target, ignore_errors=True)
        return Path(shutil.copytree(self.original, target))
