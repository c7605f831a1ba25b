"""Poses inserted interval by interval: each is halved by itself, and its contours are rendered for it alone."""

import numpy as np

from palpate.datasets.rigid import slerp

LEAST, HOLD, SPACINGS = 25e-6, 0.1, 4


def moves_far(these, those, distance):
    """Whether a point of polylines, each [point, 3], is farther from those of the next pose than a distance [m]."""
    spacing = distance / SPACINGS
    ends = [(line[:-1].astype(float), line[1:].astype(float)) for line in those]
    a, b = (np.concatenate(parts) for parts in zip(*ends, strict=True)) if ends else (np.zeros((0, 3)),) * 2
    if not len(a):
        return False
    for line in these:
        for p, q in zip(line[:-1].astype(float), line[1:].astype(float), strict=True):
            count = int(np.ceil(np.linalg.norm(q - p) / spacing))
            for k in range(count + 1):
                if segments_apart(p + k / max(count, 1) * (q - p), a, b) > distance - spacing / 2:
                    return True
    return False


def segments_apart(p, a, b):
    """A point's distance from the nearest of segments [m]."""
    along = b - a
    share = ((p - a) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-30)
    return np.linalg.norm(p - a - np.clip(share, 0, 1)[:, None] * along, axis=1).min()


def middle(p, q):
    """The pose halfway, float32."""
    p, q = p.astype(float), q.astype(float)
    turn = slerp(p[None, 3:], q[None, 3:], np.array([[0.5]]))[0]
    return np.concatenate([p[:3] + 0.5 * (q[:3] - p[:3]), turn]).astype(np.float32)


def insert(contours, time, pose, distance):
    """Times and poses with those inserted; contours: gives the polylines of one pose."""
    gap = max(HOLD, 2.0 * np.median(np.diff(time)))
    rows = [(time[0], pose[0])]
    for k in range(len(time) - 1):
        ends = (time[k], pose[k]), (time[k + 1], pose[k + 1])
        if time[k + 1] - time[k] <= gap:
            rows += halved(contours, *ends, distance)
        rows.append(ends[1])
    times, poses = zip(*rows, strict=True)
    return np.array(times), np.array(poses)


def halved(contours, begin, end, distance):
    """The poses to be inserted into one interval, in the order of time."""
    lasting = end[0] - begin[0]
    wanted = lasting > HOLD or moves_far(contours(begin[1]), contours(end[1]), distance)
    if not wanted or lasting / 2 < LEAST:
        return []
    centre = (0.5 * (begin[0] + end[0]), middle(begin[1], end[1]))
    before = halved(contours, begin, centre, distance)
    return [*before, centre, *halved(contours, centre, end, distance)]
