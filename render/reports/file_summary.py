"""What is in a contour file, in numbers."""

from pathlib import Path

import numpy as np

from ...datasets.contour_file.live_summary import summarise_run
from ...datasets.contour_file.reader import ContourFile
from ...datasets.focus_files.frame_reader import DRIVES, WIRE_FRAMES, FrameReader
from ...datasets.motions.facing import SHARE_ANGLES, facing_angles
from ...datasets.motions.last_pose import INTERVALS_LOOKED_AT, end_of_motion
from ...datasets.storage.schema import PRUNED_NAMES
from ..contour_input import takes_batches
from ..focal_spot import FARTHEST, HEIGHT_DEFAULT, NEAREST, focal_width
from ..sampling.draw_frequency import file_pauses, frequencies_by_time
from ..sampling.strategy import DEFAULT
from ..validation import require_path

NEIGHBOURS = 8  # of a place that are looked at first
POSES_SAMPLED = 100  # of a file, evenly spaced: the share of all of them differs by a few percent
STEPS_A_WIDTH = 6  # points along a contour in a focal width
ALONG_WIDTHS = 2.0  # farther along one contour, places that are near each other are two strokes, and not a bend


def fused_share(file: ContourFile) -> float | None:
    """Share of the contours' length nearer than a focal width to another contour, or to another part of their own.

    Of POSES_SAMPLED poses with contours. The width is that of the default array's focal point at the mean height of
    their points, or at 0.2 m where the array cannot focus. None where no pose has contours.
    """
    found = [first + np.flatnonzero(file.metrics(first, stop)["length"] > 0) for first, stop in file.done]
    drawn = np.concatenate([*found, np.zeros(0, np.int64)])  # poses with contours, of those that are done
    if not len(drawn):
        return None
    chosen = drawn[np.unique(np.linspace(0, len(drawn) - 1, min(POSES_SAMPLED, len(drawn))).round().astype(np.int64))]
    poses = [file.contours(pose, pose + 1) for pose in chosen.tolist()]
    height = float(np.mean(np.concatenate([one["points"][:, 2] for one in poses])))
    width = focal_width(height if 2.0 * NEAREST < height < FARTHEST / 2.0 else HEIGHT_DEFAULT).width
    near = whole = 0
    for one in poses:
        found = fused_places(one["points"], one["polyline_start"], width)
        near, whole = near + int(found.sum()), whole + len(found)
    return near / whole if whole else None


def fused_places(points: np.ndarray, polyline_start: np.ndarray, width: float) -> np.ndarray:
    """Which places are nearer than `width` [m] to another contour of the pose; bool [place].

    points: [m], shape [point, 3]; polyline_start: shape [polyline + 1]. Places are evenly spaced along the contours,
    STEPS_A_WIDTH in a width. Two places of one contour count if they are farther than ALONG_WIDTHS along it.
    """
    from scipy.spatial import KDTree  # a tenth of a second that only this needs

    places, along, loop, polyline = [], [], [], []
    for k, (first, stop) in enumerate(zip(polyline_start[:-1].tolist(), polyline_start[1:].tolist(), strict=True)):
        own = points[first:stop].astype(np.float64)
        reached = np.concatenate([[0.0], np.linalg.norm(np.diff(own, axis=0), axis=1).cumsum()])
        count = max(1, round(STEPS_A_WIDTH * reached[-1] / width))
        middle = (np.arange(count) + 0.5) * reached[-1] / count
        places.append(np.stack([np.interp(middle, reached, own[:, axis]) for axis in range(3)], axis=1))
        along.append(middle)
        is_closed = len(own) > 2 and np.array_equal(own[0], own[-1])
        loop.append(np.full(count, reached[-1] if is_closed else np.inf))
        polyline.append(np.full(count, k))
    if not places:
        return np.zeros(0, bool)
    at, way, total, of = map(np.concatenate, (places, along, loop, polyline))
    near = np.zeros(len(at), bool)

    def note(one: np.ndarray, other: np.ndarray) -> None:
        apart = np.abs(way[one] - way[other])
        apart = np.minimum(apart, total[one] - apart)
        counts = (of[one] != of[other]) | (apart > ALONG_WIDTHS * width)
        near[one[counts]] = near[other[counts]] = True

    tree = KDTree(at)
    # The nearest neighbours decide nearly all places of a filled contact, which has hundreds within the width of each.
    found = tree.query(at, NEIGHBOURS, distance_upper_bound=np.nextafter(width, np.inf))[1]
    note(*(own[found.ravel() < len(at)] for own in (np.repeat(np.arange(len(at)), NEIGHBOURS), found.ravel())))
    rest = np.flatnonzero(~near)
    others = tree.query_ball_point(at[rest], width)
    note(np.repeat(rest, [len(own) for own in others]), np.array([k for own in others for k in own], np.int64))
    return near


PARTS = {"thing": "object", "hand": "hand", "motion": "motion", "strategy": "strategy", "sampling": "sampling"}
"""What of a sweep's recipe a file of frames is of."""

POSES_AT_ONCE = 1 << 20
DRAW_FREQUENCIES = (
    "draw_frequency", "draw_frequency_p05", "draw_frequency_median", "draw_frequency_p95",
    "draw_frequency_of_mean_length",
)  # fmt: skip
"""The headline is the first: the mean over poses with contours. The last is that of their mean length."""


def length_ratio(length: float, length_object: float) -> float | None:
    """r = mean |CC| / mean |OC| from means (or sums) over the same poses, empty ones included; None without OC."""
    return length / length_object if length_object > 0 else None


def draw_frequencies(length: np.ndarray, pause: np.ndarray | float = 0.0) -> dict[str, float | None]:
    """Draw frequencies [Hz] of the default sampling strategy over poses with contours.

    length: of each pose's contours [m]. pause: what they pause in a cycle [s]. docs/guide/sampling.md has the
    definitions; None where there is no pose.
    """
    if len(length) == 0:
        return dict.fromkeys(DRAW_FREQUENCIES)
    frequency = frequencies_by_time(length, pause)
    low, median, high = np.quantile(frequency, [0.05, 0.5, 0.95]).tolist()
    of_mean = 1.0 / float(np.mean(length.astype(np.float64) / DEFAULT.speed + pause))
    return dict(zip(DRAW_FREQUENCIES, [float(frequency.mean()), low, median, high, of_mean], strict=True))


@takes_batches
def summarise(path: str | Path) -> dict:
    """Counts, lengths [m], the strategy and who made it; `r` where the file holds closed contours.

    Of a file that is not sealed, the poses done so far. Raises ContourFileError for what is no contour file.

    >>> from palpate.render import render, static_pose, summarise
    >>> facts = summarise(render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True))
    >>> facts["object"]["name"], facts["poses"], round(float(facts["length_mean"]), 3)  # round a palm of 85 mm [m]
    ('cube', 1, 0.34)
    """
    require_path(path, "the contour file")
    with ContourFile(path) as file:
        done = sum(stop - first for first, stop in file.done)
        totals, faced, removed = np.zeros(4), np.zeros(len(SHARE_ANGLES), np.int64), dict.fromkeys(PRUNED_NAMES, 0.0)
        lengths: list[np.ndarray] = []  # of poses with contours
        pauses = [np.zeros(0)]
        for first, stop in file.done:
            for a in range(first, stop, POSES_AT_ONCE):
                metrics = file.metrics(a, min(stop, a + POSES_AT_ONCE))
                names = ("length", "length_object", "length_hand", "length_made")
                totals += [metrics[name].sum(dtype=np.float64) for name in names]
                for stage in PRUNED_NAMES:
                    if f"removed_{stage}" in metrics:
                        removed[stage] += metrics[f"removed_{stage}"].sum(dtype=np.float64)
                lengths.append(metrics["length"][metrics["length"] > 0])
                pauses.append(file_pauses(file, a + np.flatnonzero(metrics["length"] > 0)))
                pose = file.motion(a, a + len(metrics["length"]))["pose"]
                angle = facing_angles(pose[metrics["length"] > 0])
                faced += np.array([np.count_nonzero(angle <= np.radians(degrees)) for degrees in SHARE_ANGLES])
        drawn = sum(map(len, lengths))
        mean = totals / max(done, 1)
        solid = file.object()
        out = {
            "path": str(path),
            "sealed": file.sealed,
            "poses": file.pose_count,
            "poses_done": done,
            "poses_drawn": drawn,
            "polylines": file.polyline_count,
            "points": file.point_count,
            "duration": _duration(file),
            "length_mean": mean[0],
            "length_mean_drawn": totals[0] / drawn if drawn else None,
            "length_longest": max((float(part.max(initial=0.0)) for part in lengths), default=0.0),
            "length_object_mean": mean[1],
            "length_hand_mean": mean[2],
            **{
                f"facing_share_{degrees}": int(count) / drawn if drawn else None
                for degrees, count in zip(SHARE_ANGLES, faced, strict=True)
            },
            **draw_frequencies(np.concatenate([*lengths, np.zeros(0, np.float32)]), np.concatenate(pauses)),
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
        out["fused_share"] = fused_share(file)
        if (run := summarise_run(file)) is not None:
            out["live"] = run
        if file.sealed:
            out["bytes"] = Path(path).stat().st_size
            out["bytes_per_pose"] = out["bytes"] / max(file.pose_count, 1)
        return out


def _duration(file: ContourFile) -> float | None:
    """Duration of a file's motion [s]; None for poses without time, and for one pose."""
    head, count = file.motion(0, INTERVALS_LOOKED_AT + 1), file.pose_count
    if "time" not in head or count < 2:
        return None
    return end_of_motion(head["time"], float(file.motion(count - 1, count)["time"][0]))


def summarise_frames(path: str | Path) -> dict:
    """What a file of frames is: how many, at which rate, of what; of prepared frames also what their making counted.

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
        if file.format == WIRE_FRAMES:
            return out | _wire_facts(file) | {"bytes": Path(path).stat().st_size}
        if file.format == DRIVES:
            out["arrays"] = file.described("/array", "names")
        else:
            out["foci"] = file.foci
        out |= {name: part["name"] for name, part in parts.items() if "name" in part}
        return out | {"maker": file.text("/", "maker"), "bytes": Path(path).stat().st_size}


def _wire_facts(file: FrameReader) -> dict:
    """Arrays of prepared frames, and how and with what result they were made."""
    count = file.described("/wire", "count")
    jumps = count.get("jumps") if isinstance(count, dict) else None
    return {
        "arrays": file.described("/array", "names"),
        "identities": file.described("/array", "identities"),
        "jumps": sum(jumps.values()) if isinstance(jumps, dict) else None,
        "refused": file.whole("/wire", "refused"),
        "switched": file.whole("/wire", "switched"),
        "sampling": file.described("/", "sampling"),
        "drive": file.described("/", "drive"),
        "device": file.text("/", "device"),
        "versions": file.described("/", "versions"),
    }
