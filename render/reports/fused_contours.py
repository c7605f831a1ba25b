"""Contours nearer to each other than a focal point is wide: a hand feels them as one band."""

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ..focal_spot import FARTHEST, HEIGHT_DEFAULT, NEAREST, focal_width

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
