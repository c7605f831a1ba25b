"""Poses of several motions, one motion after the other, on a device."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from .poses import ExploredPoses, PoseRows, explored_rows


def joined_rows(ranges: Sequence[tuple[PoseRows, int, int]], device: str) -> np.ndarray | wp.array:
    """Poses first..stop of several motions, one after the other: on the host if all are there, else on the device."""
    explored = [(poses, first, stop) for poses, first, stop in ranges if isinstance(poses, ExploredPoses)]
    models = {poses.model for poses, _, _ in explored}
    if len(explored) == len(ranges) and len(models) < 2:  # as a rule: one launch instead of one for each motion
        return explored_rows(explored, device)
    rows = [poses.rows(first, stop, device) for poses, first, stop in ranges]
    if len(rows) == 1:
        return rows[0]
    if all(isinstance(own, np.ndarray) for own in rows):
        return np.concatenate(rows)
    out = wp.empty(sum(len(own) for own in rows), dtype=wp.transform, device=device)
    at = 0
    for own in rows:
        source = wp.array(own, dtype=wp.transform, device=device) if isinstance(own, np.ndarray) else own
        wp.copy(out, source, dest_offset=at, count=len(own))
        at += len(own)
    return out
