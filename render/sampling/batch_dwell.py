"""Dwell maps of many motions, counted on the device that their focal points are on."""

import numpy as np

from ...kernels.sampling.dwelling import cell_row, count_cells
from .batch_sampling import MotionSamples
from .metrics import DwellMap, cell_edges


def dwell_maps(
    samples: MotionSamples, update_rate: float, *, width: float = 0.085, length: float = 0.085, cell: float = 1e-3
) -> list[DwellMap]:
    """The dwell map of each motion; the numbers have the meanings that they have for `dwell_map`."""
    across, along = cell_edges(width, cell), cell_edges(length, cell)
    poses = samples.poses
    rows = (cell_row(float(edges[0]), float(edges[-1]), len(edges) - 1) for edges in (across, along))
    cells = count_cells(poses.schedule, poses.motion, poses.pose, samples.position, samples.intensity, *rows).numpy()
    shared = samples.intensity.shape[1] * update_rate
    out = []
    for row, total in zip(cells, np.diff(samples.sample_start).tolist(), strict=True):
        time = row[:-1].reshape(len(across) - 1, len(along) - 1) / shared
        out.append(
            DwellMap(time, across, along, float(row[-1]) / shared, total / update_rate - float(row.sum()) / shared)
        )
    return out
