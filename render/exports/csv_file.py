"""CSV: a row for each point of a contour, which spreadsheets and pandas read."""

from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.storage.schema import KIND_NAMES
from .pose_choice import ExportBlock, Progress, chosen_blocks

HEADER = "pose,time [s],polyline,x [m],y [m],z [m],kind,intensity"


def write_csv(file: ContourFile, chosen: range, temporary: Path, *, watch: Progress) -> dict[str, Any]:
    """Write a row for each point of the chosen poses; returns counts. Raises OSError.

    Numbers are the shortest that read back to the same bits. A pose without contours has no row; time is empty where
    poses have none.
    """
    time = file.motion(chosen.start, chosen.stop).get("time")
    polylines = points = done = 0
    with temporary.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(HEADER + "\n")
        for block in chosen_blocks(file, chosen):
            moments = None if time is None else time[block.number - chosen.start]
            stream.writelines(_rows(block, moments))
            polylines += len(block.contours["polyline_closed"])
            points += len(block.contours["points"])
            done += len(block.number)
            watch(done, len(chosen))
    return {"polylines": polylines, "points": points}


def _rows(block: ExportBlock, time: np.ndarray | None) -> list[str]:
    """Lines of a block."""
    contours = block.contours
    polylines, points = np.diff(contours["pose_start"]), np.diff(contours["polyline_start"])
    pose = np.repeat(np.arange(len(polylines)), polylines)  # of each polyline
    place = np.arange(len(pose)) - contours["pose_start"][pose]
    moments = [""] * len(polylines) if time is None else [repr(t) for t in time.tolist()]
    heads = [
        f"{number},{moments[k]},{line},"
        for number, k, line in zip(block.number[pose].tolist(), pose.tolist(), place.tolist(), strict=True)
    ]
    where = contours["points"].astype(str)  # of float32: the shortest text of each number
    level = contours["intensity"].astype(str) if "intensity" in contours else ["1.0"] * len(where)
    kinds = np.array(KIND_NAMES)[contours["kind"]]
    return [
        f"{heads[line]}{x},{y},{z},{kind},{intensity}\n"
        for line, (x, y, z), kind, intensity in zip(
            np.repeat(np.arange(len(pose)), points).tolist(), where.tolist(), kinds.tolist(), list(level), strict=True
        )
    ]
