"""A process that writes a contour file, to be killed or to run out of disk; prints what it has done.

Arguments: `write PATH MODE POSES CHUNK`, or `fill FOLDER`, where FOLDER is a small filesystem of its own.
"""

import os
import sys
from pathlib import Path

from contour_cases import make_contours, make_header, write_ranges

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError


def say(*words: object) -> None:
    os.write(1, (" ".join(map(str, words)) + "\n").encode())


def write(path: str, mode: str, pose_count: str, chunk: str) -> None:
    contours, step = make_contours(int(pose_count)), int(chunk)
    with ContourWriter(path, make_header(int(pose_count)), mode=mode) as writer:
        for first, stop in writer.missing():
            for start in range(first, stop, step):
                end = min(start + step, stop)
                write_ranges(writer, contours, [(start, end)])
                say("done", start, end)
        say("sealing")
        writer.seal()
    say("sealed")


def fill(folder: str) -> None:
    """Run into the full disk twice, in a log and in sealing, making room after each."""
    path, ballast = Path(folder) / "out.h5", Path(folder) / "ballast"
    contours = make_contours(400)
    occupy(ballast, keep=180_000)
    with ContourWriter(path, make_header(400)) as writer:
        try:
            write_ranges(writer, contours, ((first, first + 20) for first in range(0, 400, 20)))
        except ContourFileError as error:
            say("log:", error)
        say("done", 400 - sum(stop - first for first, stop in writer.missing()))
    ballast.unlink()
    with ContourWriter(path, make_header(400), mode="resume") as writer:
        say("resumed", 400 - sum(stop - first for first, stop in writer.missing()), len(writer.repairs))
        write_ranges(writer, contours, writer.missing())
        occupy(ballast, keep=50_000)
        try:
            writer.seal()
        except ContourFileError as error:
            say("seal:", error)
    ballast.unlink()
    with ContourWriter(path, make_header(400), mode="resume") as writer:
        say("missing", writer.missing(), writer.repairs)
        writer.seal()
    say("check", check_file(path))


def occupy(ballast: Path, *, keep: int) -> None:
    """Leave `keep` bytes free."""
    state = os.statvfs(ballast.parent)
    ballast.write_bytes(bytes(max(0, state.f_bavail * state.f_frsize - keep)))


if __name__ == "__main__":
    {"write": write, "fill": fill}[sys.argv[1]](*sys.argv[2:])
