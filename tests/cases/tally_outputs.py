"""Outputs of a tally, filled with 7: a test sees what a kernel left unwritten."""

import warp as wp

from palpate.kernels.metrics.tally import METRICS


def empty(pose_count, device):
    value = wp.full((len(METRICS) + 1, pose_count), 7.0, dtype=wp.float32, device=device)
    return value, wp.full(pose_count, 7.0, dtype=wp.float64, device=device)
