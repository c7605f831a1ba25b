"""Insets by manifold3d's polygon offsets (Clipper2): another algorithm, and another library than the kernels' own."""

import numpy as np
from manifold3d import CrossSection, FillRule, JoinType

UNIT = 1e-3  # [m] that polygons are handed to manifold3d in: it works to 1e-8 of its unit
ROUND = 64  # segments of a full turn around a corner


def inset_loops(loops: list[np.ndarray], distance: float) -> list[np.ndarray]:
    """Loops around what is at least so far inside a region [m]; outer ones by area, the largest first, then holes.

    loops: counter-clockwise around the region, clockwise around holes; [m], each of shape [point, 2].
    """
    region = CrossSection([loop / UNIT for loop in loops], FillRule.Positive)
    left = region.offset(-distance / UNIT, JoinType.Round, 2.0, ROUND)
    origin = loops[0][0]
    out = [UNIT * np.asarray(loop, np.float64) for loop in left.to_polygons()]
    out = [np.roll(loop, -int(np.argmin(np.linalg.norm(loop - origin, axis=1))), axis=0) for loop in out]
    return sorted(out, key=lambda loop: (-signed_area(loop), *loop[0].tolist()))


def signed_area(loop: np.ndarray) -> float:
    """Area inside a loop, negative if it runs clockwise [m2]."""
    following = np.roll(loop, -1, axis=0)
    return 0.5 * float((loop[:, 0] * following[:, 1] - following[:, 0] * loop[:, 1]).sum())
