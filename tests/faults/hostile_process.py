"""Tries the hostile files of `hostile_hdf5`, or those that are named; prints a JSON line for each operation on each.

PYTHONPATH=tests/cases python tests/faults/hostile_process.py FOLDER [NAME ...]
"""

import json
import sys
import warnings
from pathlib import Path

import warp as wp
from bounded import ACCEPTED, CLEAR, Refused, outcome_in_child
from hostile_hdf5 import CASES, OPERATIONS, sound, write_case

from palpate.datasets import ContourFile, HandMotion, check_file
from palpate.datasets.focus_files.frame_reader import FrameReader, check_frames, frame_format
from palpate.device import EmulatorBackend
from palpate.device.clock import VirtualClock
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.reports.file_summary import summarise, summarise_frames

wp.config.log_level = wp.LOG_ERROR  # standard output is JSON, and playing starts Warp
SECONDS, RESIDENT_BYTES = 10.0, 3 << 29
"""Time and memory that an operation on a file of 300 kB may take, on a busy machine."""


def check(path, kind):
    problems = check_file(path) if frame_format(path) is None else check_frames(path)
    for problem in problems:
        problem.encode()
    if problems:
        raise Refused("; ".join(problems))


def info(path, kind):
    json.dumps(summarise_frames(path) if frame_format(path) is not None else summarise(path), default=str)


def read(path, kind):
    if kind == "frames":
        with FrameReader(path) as file:
            file.recipe()
            file.focal_points(0, file.frame_count)
    else:
        with ContourFile(path) as file:
            file.attributes, file.header(), file.strategy, file.hand, file.object()
            file.motion(), file.contours(), file.metrics(), file.timing(), file.hand_arrays()
            for first, stop in file.blocks():
                file.contours(first, stop)


def play(path, kind):
    play_file(path, connection=Connection(backend=EmulatorBackend(clock=VirtualClock())))


def motion(path, kind):
    found = HandMotion.load(path)
    assert found.seed is None or isinstance(found.seed, int)


TRIED = {"check": check, "info": info, "read": read, "play": play, "motion": motion}


def shortfall(name, path, operation, outcome):
    """How an outcome falls short of what a case asks for; empty if it does not."""
    case = CASES[name]
    if outcome.kind not in (ACCEPTED, CLEAR):
        return outcome.kind
    if outcome.kind == ACCEPTED:
        return "believed" if operation in case.refusing else ""
    is_named = operation != "check" or not case.message or (case.message in outcome.text and str(path) in outcome.text)
    return "" if len(outcome.text) > 10 and is_named else "refused in other words"


def main():
    folder = Path(sys.argv[1])
    warnings.simplefilter("ignore")
    for kind, operations in OPERATIONS.items():
        path = folder / f"{kind}.h5"
        path.write_bytes(sound(kind))
        for operation in operations:  # here and not in a child: Warp's kernels are loaded once
            TRIED[operation](path, kind)
    for number, name in enumerate(sys.argv[2:] or list(CASES)):
        path = folder / f"{number}.h5"
        write_case(name, path)
        kind = CASES[name].kind
        for operation in OPERATIONS[kind]:
            outcome = outcome_in_child(
                lambda made=path, kind=kind, operation=operation: TRIED[operation](made, kind),
                seconds=SECONDS,
                resident=RESIDENT_BYTES,
            )
            row = {"case": name, "operation": operation, "short": shortfall(name, path, operation, outcome)}
            sys.stdout.write(json.dumps(row | {"outcome": outcome}) + "\n")


if __name__ == "__main__":
    main()
