"""What is in a contour file, in numbers."""

from pathlib import Path

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.focus_files.frame_reader import DRIVES, FrameReader
from ...datasets.storage.schema import PRUNED_NAMES
from ..sampling.contour_sampling import SamplingStrategy

PARTS = {"thing": "object", "hand": "hand", "motion": "motion", "strategy": "strategy", "sampling": "sampling"}
"""What of a sweep's recipe a file of frames is of."""

POSES_AT_ONCE = 1 << 20


def length_ratio(length: float, length_object: float) -> float | None:
    """r = mean |CC| / mean |OC| from means (or sums) over the same poses, empty ones included; None without OC."""
    return length / length_object if length_object > 0 else None


def summarise(path: str | Path) -> dict:
    """Counts, lengths [m], the strategy and who made it; `r` where the file holds closed contours.

    Of a file that is not sealed, the poses done so far. Raises ContourFileError for what is no contour file.
    """
    with ContourFile(path) as file:
        done = sum(stop - first for first, stop in file.done)
        totals, removed = np.zeros(4), dict.fromkeys(PRUNED_NAMES, 0.0)
        drawn = 0
        longest = 0.0
        for first, stop in file.done:
            for a in range(first, stop, POSES_AT_ONCE):
                metrics = file.metrics(a, min(stop, a + POSES_AT_ONCE))
                names = ("length", "length_object", "length_hand", "length_made")
                totals += [metrics[name].sum(dtype=np.float64) for name in names]
                for stage in PRUNED_NAMES:
                    if f"removed_{stage}" in metrics:
                        removed[stage] += metrics[f"removed_{stage}"].sum(dtype=np.float64)
                drawn += int(np.count_nonzero(metrics["length"]))
                longest = max(longest, float(metrics["length"].max(initial=0.0)))
        mean = totals / max(done, 1)
        time = _times(file)
        solid = file.object()
        speed = SamplingStrategy().speed
        out = {
            "path": str(path),
            "sealed": file.sealed,
            "poses": file.pose_count,
            "poses_done": done,
            "poses_drawn": drawn,
            "polylines": file.polyline_count,
            "points": file.point_count,
            "duration": None
            if time is None or len(time) < 2
            else float(time[-1] + np.median(np.diff(time), overwrite_input=True)),
            "length_mean": mean[0],
            "length_mean_drawn": totals[0] / drawn if drawn else None,
            "length_longest": longest,
            "length_object_mean": mean[1],
            "length_hand_mean": mean[2],
            "draw_frequency": speed * drawn / totals[0] if totals[0] > 0 else None,
            "strategy": file.strategy,
            "hand": file.hand,
            "object": {
                "name": solid["name"],
                "triangles": len(solid["faces"]),
                "hash": solid["hash"],
                "placement": solid["placement"],
                **solid["representation"],
            },
            **file.attributes,
        }
        if any(f"removed_{stage}" in file.optional for stage in PRUNED_NAMES):
            out["removed_mean"] = {
                stage: total / max(done, 1) for stage, total in removed.items() if f"removed_{stage}" in file.optional
            }
        transform = file.strategy.get("transform")
        if isinstance(transform, list) and "close" in transform:
            out["r"] = length_ratio(totals[0], totals[1])
        if file.sealed:
            out["bytes"] = Path(path).stat().st_size
            out["bytes_per_pose"] = out["bytes"] / max(file.pose_count, 1)
        return out


def _times(file: ContourFile) -> np.ndarray | None:
    """Times of all poses [s], shape [pose], without the poses, which take more memory; None for poses without time."""
    spans = [(a, min(file.pose_count, a + POSES_AT_ONCE)) for a in range(0, file.pose_count, POSES_AT_ONCE)]
    if "time" not in file.motion(*spans[0]):
        return None
    time = np.empty(file.pose_count)
    for first, stop in spans:
        time[first:stop] = file.motion(first, stop)["time"]
    return time


def summarise_frames(path: str | Path) -> dict:
    """What a file of focal points or drives that a sweep keeps is: how many, at which rate, and of what.

    Raises ContourFileError for another file.
    """
    with FrameReader(path) as file:
        recipe = file.recipe()
        parts = {name: recipe[part] for part, name in PARTS.items() if isinstance(recipe.get(part), dict)}
        out = {
            "path": str(path),
            "holds": file.format.removeprefix("palpate "),
            "frames": file.frame_count,
            "update_rate": file.update_rate,
            "duration": file.frame_count / file.update_rate,
        }
        if file.format == DRIVES:
            out["arrays"] = file.described("/array", "names")
        else:
            out["foci"] = file.foci
        out |= {name: part["name"] for name, part in parts.items() if "name" in part}
        return out | {"maker": file.text("/", "maker"), "bytes": Path(path).stat().st_size}
