"""A process that writes a contour file and prints each range that is done.

Arguments: PATH MODE POSES CHUNK, and CALL NAME to be killed as soon as `os.CALL` is about to change a file NAME.
"""

import os
import signal
import sys
from pathlib import Path
from typing import Any

from contour_cases import make_contours, make_header, write_ranges

from palpate.datasets.contour_file.writer import ContourWriter


def die_at(name: str, file: str) -> None:
    real = getattr(os, name)

    def call(*args: Any, **options: Any) -> Any:
        if Path(args[-1]).name == file:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*args, **options)

    setattr(os, name, call)


def write(path: str, mode: str, pose_count: str, chunk: str, *moment: str) -> None:
    contours, step = make_contours(int(pose_count)), int(chunk)
    if moment:
        die_at(*moment)
    with ContourWriter(path, make_header(int(pose_count)), mode=mode) as writer:
        for first, stop in writer.missing():
            for start in range(first, stop, step):
                write_ranges(writer, contours, [(start, end := min(start + step, stop))])
                print("done", start, end, flush=True)  # noqa: T201 - what the test waits for
        writer.seal()


if __name__ == "__main__":
    write(*sys.argv[1:])
