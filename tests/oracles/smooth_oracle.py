"""Chaikin's corner cutting in NumPy, polyline by polyline."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from polyline_oracle import without_repeats


def smooth(batch, *, rounds, reach=0.01):
    """A batch as the stage "smooth" leaves it."""
    for _ in range(rounds):
        batch = cut_corners(batch, reach)
    return without_repeats(batch)


def cut_corners(batch, reach):
    """Every segment without a quarter at each end, at most `reach`; ends of open polylines stay."""
    out = {name: [] for name in ("points", "kind", "intensity", "dwell") if getattr(batch, name) is not None}
    counts = []
    for k, (a, b) in enumerate(pairwise(batch.polyline_start.tolist())):
        own = {name: getattr(batch, name)[a:b] for name in out}
        rows = cut_line(own, batch.polyline_closed[k] != 0, reach)
        counts.append(len(rows["kind"]))
        for name in out:
            out[name].append(rows[name])
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    none = {name: getattr(batch, name)[:0] for name in out}
    return replace(batch, polyline_start=start, **{name: np.concatenate([*out[name], none[name]]) for name in out})


def cut_line(own, closed, reach):
    """The rows of one polyline, each of whose segments leaves two points."""
    if len(own["kind"]) < 2:
        return {name: values[:0] for name, values in own.items()}
    p = own["points"].astype(np.float64)
    step = p[1:] - p[:-1]
    cutoff = np.minimum(0.25, reach / np.maximum(np.linalg.norm(step, axis=1), 1e-30))
    part = np.stack([cutoff, 1.0 - cutoff], axis=1)
    if not closed:
        part[0, 0], part[-1, 1] = 0.0, 1.0
    out = {"points": (p[:-1, None] + part[..., None] * step[:, None]).astype(np.float32).reshape(-1, 3)}
    out["kind"] = np.repeat(own["kind"][:-1], 2)
    if "intensity" in own:
        value = own["intensity"]
        mixed = value[:-1, None] + part * (value[1:] - value[:-1])[:, None]
        out["intensity"] = mixed.astype(np.float32).reshape(-1)
    if "dwell" in own:
        out["dwell"] = np.stack([own["dwell"][:-1], np.zeros(len(step), np.float32)], axis=1).reshape(-1)
        if not closed:
            out["dwell"][-1] = own["dwell"][-1]
    if closed:
        out = {name: np.concatenate([values, values[:1]]) for name, values in out.items()}
        out["kind"][-1] = out["kind"][-2]
    return out
