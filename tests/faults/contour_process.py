"""A process that writes a contour file and prints each range that is done. Arguments: PATH MODE POSES CHUNK."""

import os
import sys

from contour_cases import make_contours, make_header, write_ranges

from palpate.datasets.contour_file.writer import ContourWriter


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


if __name__ == "__main__":
    write(*sys.argv[1:])
