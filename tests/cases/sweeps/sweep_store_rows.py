"""Rows of a store whose payloads and columns follow from their keys, and a process that writes them for ever.

Run as `python sweep_store_rows.py FOLDER SEED COUNT [CALL]`: writes and records COUNT shards and prints each one's name
and its rows once it is recorded. CALL: it kills itself there, in the fifth shard ("sync", "replace", "discard").
"""

import os
import resource
import signal
import sys
from contextlib import contextmanager

import numpy as np

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import record as record_module
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.store import SweepStore

MAKER = "palpate 0.1.0 test"


def payload(group, key, part):
    return {"poses": part + 1, "stat": {group: [1, part / 7, float(len(key)), -1.5, 2.25]}, "name": f"{key}ü"}


def pose_columns(key, part):
    poses = np.arange(part * 10, part * 10 + 10)
    return {"pose": poses, "length": (poses / 7).astype(np.float32), "drawn": poses % 3 > 0}


def row(group, key, part):
    return ShardRow(group, key, part, payload(group, key, part))


def write_rows(path, places, *, maker=MAKER, columns=True):
    """A shard of (group, key, part); those of the group poses have columns."""
    own = [pose_columns(key, part) if group == "poses" and columns else None for group, key, part in places]
    write_shard(path, [row(*place) for place in places], own, maker=maker)


def places_of(seed, number):
    """Three parts of a shard; every third shard has columns."""
    group = "poses" if number % 3 == 0 else "contours"
    return [(group, f"key{seed}-{number // 6}", number * 3 + part) for part in range(3)]


@contextmanager
def file_size_limit(size):
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, old[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)


def kill_at(call):
    """Have this process die like by kill -9 where a shard is recorded: before a call takes effect."""

    def die(*args):
        os.kill(os.getpid(), signal.SIGKILL)

    def die_after(*args):
        os.rename(*args)
        die()

    if call == "replace":
        record_module.os = type("os", (), {"replace": staticmethod(die_after), "kill": os.kill})
    else:
        setattr(record_module, call, die)


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def main(folder, seed, count, call=None):
    with SweepStore(folder, maker=MAKER) as store:
        say("open")
        for number in range(int(count)):
            if number >= 5 and call:
                kill_at(call)
            name = f"shards/{seed}-{number}.h5"
            places = places_of(seed, number)
            write_rows(store.folder / name, places)
            try:
                added = store.record(name)
            except SweepStoreError as error:
                say("error", error)
                continue
            say("recorded", seed, number, added)


if __name__ == "__main__":
    main(*sys.argv[1:])
