"""Dwell maps of many motions: how many samples are drawn on each cell of the palm's plane.

In whole samples, so that blocks of samples may be counted one after the other.
"""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .focus import turned
from .layout import PoseSchedule

wp.set_module_options(EXACT)

BORDER = wp.constant(wp.float64(1e-6))  # [m] a point so near to a border of a map lies on it


@wp.struct
class CellRow:
    """Equal cells in a row."""

    first: wp.float64  # lower edge of the first [m]
    last: wp.float64  # upper edge of the last [m]
    count: wp.int32
    density: wp.float64  # cells a metre


@wp.func
def cell_of(row: CellRow, place: wp.float64):
    """Number of the cell that a place is in [m], -1: in none."""
    if not (place >= row.first - BORDER and place <= row.last + BORDER):
        return int(-1)
    return wp.min(int(wp.floor((place - row.first + BORDER) * row.density)), row.count - 1)


@wp.kernel
def _count_cells(
    # In:
    schedule: PoseSchedule,
    pose: wp.array[wp.transformd],  # hand frame -> array frame
    position: wp.array2d[wp.vec3],  # [m], array frame, shape [sample, focus]
    intensity: wp.array2d[wp.float32],
    across: CellRow,  # along u = X of the hand frame
    along: CellRow,  # along v = -Z
    # Out:
    cells: wp.array2d[wp.int32],  # drawn focal points in each cell, the last: in none; [motion, cell + 1]; zeros
):
    """Count the focal points of a pose by cell."""
    i = wp.tid()
    at = wp.transform_get_translation(pose[i])
    q = wp.transform_get_rotation(pose[i])
    back = wp.quatd(-q[0], -q[1], -q[2], q[3])
    row = schedule.row[i]
    stop = row + schedule.count[i]
    while row < stop:
        for focus in range(position.shape[1]):
            if intensity[row, focus] > 0.0:
                p = position[row, focus]
                off = wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2])) - at
                skin = turned(back, off)
                u = cell_of(across, skin[0])
                v = cell_of(along, -skin[2])
                cell = across.count * along.count
                if u >= 0 and v >= 0:
                    cell = u * along.count + v
                wp.atomic_add(cells, int(schedule.motion[i]), cell, 1)
        row += 1


def cell_row(first: float, last: float, count: int) -> CellRow:
    """Equal cells between two edges [m]."""
    row = CellRow()
    row.first, row.last, row.count, row.density = first, last, count, count / (last - first)
    return row


def count_cells(
    schedule: PoseSchedule,
    pose: wp.array,
    position: wp.array,
    intensity: wp.array,
    across: CellRow,
    along: CellRow,
    motions: int,
    poses: int,
) -> wp.array:
    """Drawn focal points in each cell of the palm's plane, and beyond, int32, shape [motion, cell + 1].

    motions, poses: how many there are; the arrays may have room for more.
    """
    cells = wp.zeros((motions, across.count * along.count + 1), dtype=wp.int32, device=position.device)
    wp.launch(
        _count_cells,
        poses,
        inputs=[schedule, pose, position, intensity, across, along],
        outputs=[cells],
        device=position.device,
        block_dim=BLOCK,
    )
    return cells
