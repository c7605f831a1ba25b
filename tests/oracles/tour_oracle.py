"""Points thinned one after the other, and a short path through them by every reversal and every moved run, in NumPy."""

import numpy as np

RUN_MOST = 3  # points that are moved at once


def thinned(points, separation):
    """Points of which each is at least the separation from all kept before it; and the farthest, if but one is."""
    kept = []
    for x in points.astype(np.float64):
        if all(((x - y) ** 2).sum() >= separation**2 for y in kept):
            kept.append(x)
    if len(kept) == 1:
        far = np.linalg.norm(points.astype(np.float64) - kept[0], axis=1)
        kept += [points[far.argmax()].astype(np.float64)] if far.max() > 0 else []
    return np.array(kept).reshape(-1, 3)


def path_of(points, closes):
    """An order of the points that no reversal and no moved run of up to three points shortens."""
    ways = np.linalg.norm(points[:, None].astype(float) - points[None], axis=2)
    if not closes:  # a closed path through one more point, at no distance from any
        ways = np.pad(ways, (0, 1))
    order = nearest_order(ways, len(points))
    while True:
        candidates = changed_orders(order)
        lengths = ways[candidates, np.roll(candidates, -1, axis=1)].sum(axis=1)
        best = lengths.argmin()
        if lengths[best] >= ways[order, np.roll(order, -1)].sum() - 1e-9:
            break
        order = candidates[best]
    first = int(np.flatnonzero(order == (0 if closes else len(points)))[0])
    return np.roll(order, -first)[0 if closes else 1 :]


def nearest_order(ways, count):
    """From the first point always to the nearest that is left; the point that opens a path last."""
    order = [0]
    while len(order) < count:
        left = np.setdiff1d(np.arange(count), order)
        order.append(int(left[ways[order[-1], left].argmin()]))
    return np.array(order + list(range(count, len(ways))))


def changed_orders(order):
    """All orders by one reversal, or by one run moved elsewhere, either way round."""
    n, out = len(order), []
    for i in range(n):
        for j in range(i + 1, n):
            out.append(np.concatenate([order[:i], order[i : j + 1][::-1], order[j + 1 :]]))
    for size in range(1, min(RUN_MOST, n - 2) + 1):
        for i in range(n):
            turned = np.roll(order, -i)
            run, rest = turned[:size], turned[size:]
            for j in range(1, len(rest)):
                out += [np.concatenate([rest[:j], part, rest[j:]]) for part in (run, run[::-1])]
    return np.array(out if out else [order])


def length_on(points, order, closes):
    """Length of a path [m]."""
    path = points[order].astype(float)
    if closes:
        path = np.concatenate([path, path[:1]])
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
