"""Tries files in processes of their own: what comes of each operation, and how long and how much memory it takes.

    PYTHONPATH=tests/cases python tests/faults/hostile_process.py FOLDER [NAME ...]

makes every hostile file of `hostile_hdf5` there, or those that are named, and prints a JSON line for each operation on
each; `judge` says which of them fall short.
"""

import json
import os
import resource
import select
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from hostile_hdf5 import CASES, OPERATIONS, sound, write_case

from palpate.datasets import ContourFile, HandMotion, check_file
from palpate.datasets.errors import DatasetError
from palpate.datasets.focus_files.frame_reader import FrameReader, check_frames, frame_format
from palpate.datasets.sweeps.shard import read_shard, shard_columns
from palpate.datasets.sweeps.table import column_units, load_table, table_attributes
from palpate.device.boards.emulator.usb_side import EmulatorBackend
from palpate.device.clock import VirtualClock
from palpate.device.errors import DeviceError
from palpate.render.errors import RenderError
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.reports.file_summary import summarise, summarise_frames

LIMIT = 10.0
"""[s] that an operation on a file of 300 kB may take, on a busy machine."""
MEMORY = 3 << 29
"""[byte] that it may take beyond what its process has."""


def check(path, kind):
    problems = check_file(path) if frame_format(path) is None else check_frames(path)
    for problem in problems:
        problem.encode()
    return f"refused: {problems[0]}" if problems else "whole"


def info(path, kind):
    json.dumps(summarise_frames(path) if frame_format(path) is not None else summarise(path), default=str)
    return "done"


def read(path, kind):
    if kind == "frames":
        with FrameReader(path) as file:
            file.recipe()
            file.focal_points(0, file.frame_count)
    elif kind == "table":
        columns, _, _ = load_table(path), table_attributes(path), column_units(path)
        assert len({column.shape for column in columns.values()}) == 1
    elif kind == "shard":
        rows = read_shard(path).rows
        with shard_columns(path) as columns:
            columns.columns(0, rows[0].group, rows[0].key, rows[0].part)
    else:
        with ContourFile(path) as file:
            file.attributes, file.header(), file.strategy, file.hand, file.object()
            file.motion(), file.contours(), file.metrics(), file.timing(), file.hand_arrays()
            for first, stop in file.blocks():
                file.contours(first, stop)
    return "done"


def play(path, kind):
    play_file(path, connection=Connection(backend=EmulatorBackend(clock=VirtualClock())))
    return "done"


def motion(path, kind):
    motion = HandMotion.load(path)
    assert motion.seed is None or isinstance(motion.seed, int)
    assert np.isfinite(motion.pose).all()
    return "done"


TRIED = {"check": check, "info": info, "read": read, "play": play, "motion": motion}


def attempt(operation, path, kind):
    """What comes of an operation, in words: done, whole, refused: ..., or raw: an error that no caller expects."""
    try:
        return TRIED[operation](path, kind)
    except (DatasetError, RenderError, DeviceError) as error:
        return f"refused: {error}"
    except BaseException as error:  # whatever else it is, a user would see it raw
        return f"raw: {type(error).__name__}: {str(error)[:200]}"


def in_child(operation, path, kind):
    """The same from a child: signals and time limits are outcomes, too. With seconds and bytes."""
    receiving, sending = os.pipe()
    begun = time.monotonic()
    child = os.fork()
    if child == 0:
        os.close(receiving)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 1)
        os.dup2(null, 2)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        outcome = attempt(operation, path, kind)
        used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
        os.write(sending, json.dumps([outcome[:2000], used]).encode())
        os._exit(0)
    os.close(sending)
    ready, _, _ = select.select([receiving], [], [], LIMIT)
    if not ready:
        os.kill(child, signal.SIGKILL)
    content = os.read(receiving, 1 << 16)
    os.close(receiving)
    _, status = os.waitpid(child, 0)
    seconds = time.monotonic() - begun
    if not ready:
        return "hang", 0, seconds
    if not content:
        return f"signal {os.WTERMSIG(status)}", 0, seconds
    outcome, used = json.loads(content)
    return outcome, used, seconds


def judge(case, operation, outcome, used):
    """How an outcome falls short of what a case asks for; None if it does not."""
    refused = outcome.startswith("refused: ") and len(outcome) > 20
    if not refused and outcome not in ("done", "whole"):
        return outcome.split(":")[0]
    if used > MEMORY:
        return f"memory {used >> 20} MB"
    return "believed" if not refused and operation in case.refusing else None


def main():
    folder = Path(sys.argv[1])
    names = sys.argv[2:] or list(CASES)
    warnings.simplefilter("ignore")
    for kind, operations in OPERATIONS.items():
        path = folder / f"{kind}.h5"
        path.write_bytes(sound(kind))
        for operation in operations:  # here and not in a child: Warp's kernels are loaded once
            report(f"sound {kind}", operation, attempt(operation, path, kind), None, 0, 0.0)
    for number, name in enumerate(names):
        path = folder / f"{number}.h5"
        write_case(name, path)
        for operation in OPERATIONS[CASES[name].kind]:
            outcome, used, seconds = in_child(operation, path, CASES[name].kind)
            report(name, operation, outcome, judge(CASES[name], operation, outcome, used), used, seconds)


def report(case, operation, outcome, short, used, seconds):
    told = {"case": case, "operation": operation, "outcome": outcome, "short": short}
    sys.stdout.write(json.dumps(told | {"bytes": used, "seconds": round(seconds, 2)}) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
