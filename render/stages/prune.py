"""Prune stages: what a focal point could not make felt, or the array not reach, is removed and its length counted.

| stage | removes |
|---|---|
| off-skin | what lies farther from the skin than a focal radius |
| close-together | what runs beside a longer contour, too near to be told from it |
| small | loops and pieces too short to be felt as such |
| turned-away | the contours of patches that face away from the array |
| hidden | what too little of the array can see past the rest of the hand |

Every length that depends on what can be felt is by default a multiple of the focal width, FWHM of p^2 across the focus
(`focal_width`): docs/guide/pruning.md has the numbers and where they come from.
"""

import math
from typing import Any

import numpy as np
import warp as wp

from ...kernels.stages.cut import divide_segments
from ...kernels.stages.prune import Patches, keep_long, keep_patches, part_off_skin
from ...kernels.stages.prune_crowded import Beside, thin_contours
from ...kernels.stages.prune_hidden import Aperture, see_past_mesh, see_past_patches
from ..contour_batch import ContourBatch
from ..hands.hand import PatchFrames
from .registry import Option, Setting, prune_stage
from .segment_removal import cut_batch

Pruned = tuple[ContourBatch, np.ndarray]

ARRAY_SIDE = 0.168  # [m]; 16 transducers at 10.5 mm
PARTS_A_DISTANCE = 8  # how finely segments are judged, by the distance that is asked about


def patches_on(frames: PatchFrames, device: str) -> Any:
    """A hand's patches at every pose on a device, as kernels take them."""
    patches = Patches()
    for name in ("origin", "u", "v", "n"):
        setattr(patches, name, wp.array(getattr(frames, name).astype(np.float64), dtype=wp.vec3d, device=device))
    patches.half = wp.array(frames.half.astype(np.float64), dtype=wp.vec2d, device=device)
    return patches


@prune_stage("off-skin", on="device", radius=Option(None, 0.0, 1.0, "m", widths=0.5))
def prune_off_skin(batch: ContourBatch, setting: Setting, *, radius: float) -> Pruned:
    """Remove what lies farther than a focal radius from every patch of the hand.

    Segments are cut exactly where they pass that distance. Contours on a hand mesh lie on its skin and all stay.
    """
    if is_mesh(setting):
        return batch, np.zeros(batch.pose_count, np.float32)
    patches = patches_on(setting.frames, setting.device)
    parts, keep = part_off_skin(batch.points, batch.polyline_start, batch.pose_start, patches, radius)
    return cut_batch(batch, keep, parts=parts)


@prune_stage(
    "close-together",
    on="device",
    distance=Option(None, 1e-4, 1.0, "m", widths=1.49),
    angle=Option(math.pi / 6, 0.0, math.pi / 2, "rad"),
    apart=Option(None, 0.0, 10.0, "m", widths=2.98),
    across=Option(False),
)
def prune_close_together(
    batch: ContourBatch, setting: Setting, *, distance: float, angle: float, apart: float, across: bool
) -> Pruned:
    """Remove what runs beside a longer contour, nearer than two strokes can be told apart.

    distance: between the two [m]; angle: by which directions may differ [rad]; apart: two places of one contour are
    compared if they are farther than this apart along it [m]; across: whether contours on different patches are
    compared. Judged in parts of an eighth of the distance at most: see `kernels.prune_close`.
    """
    rule = Beside()
    rule.distance, rule.parallel = wp.float64(distance), wp.float64(math.cos(angle))
    rule.apart, rule.patches = wp.float64(apart), int(across)
    parts = divide_segments(batch.points, batch.polyline_start, distance / PARTS_A_DISTANCE)
    lines = (batch.points, batch.polyline_start, batch.polyline_patch, batch.polyline_closed)
    return cut_batch(batch, thin_contours(*lines, batch.pose_start, parts, rule), parts=parts)


@prune_stage(
    "small",
    on="device",
    perimeter=Option(None, 0.0, 100.0, "m", widths=math.pi),
    length=Option(None, 0.0, 100.0, "m", widths=1.0),
)
def prune_small(batch: ContourBatch, setting: Setting, *, perimeter: float, length: float) -> Pruned:
    """Remove loops and open pieces too short to be felt as anything but a point.

    perimeter: the least of a loop [m], by default that of the focus itself; length: the least of an open piece [m].
    """
    lines = (batch.points, batch.polyline_start, batch.polyline_closed)
    return cut_batch(batch, keep_long(*lines, length, perimeter))


@prune_stage("turned-away", on="device", angle=Option(math.pi / 3, 0.0, math.pi, "rad"))
def prune_turned_away(batch: ContourBatch, setting: Setting, *, angle: float) -> Pruned:
    """Remove the contours of patches whose skin faces away from the array.

    angle: the most between the skin's normal and the way from the patch's middle to the array's [rad]. A hand mesh
    counts as its palm's plane.
    """
    facing = facing_angle(setting.frames, setting.array_position)
    kept = wp.array((facing <= angle).astype(np.uint8), dtype=wp.uint8, device=setting.device)
    lines = (batch.polyline_start, batch.polyline_patch, batch.pose_start)
    return cut_batch(batch, keep_patches(*lines, kept, batch.point_count))


def facing_angle(frames: PatchFrames, array_position: np.ndarray) -> np.ndarray:
    """Angle between a patch's skin normal, -n, and the way from its middle to a point [rad], shape [pose, patch].

    NaN for a patch that is not there; 0 for one that lies in the point.
    """
    way = np.asarray(array_position, np.float64) - frames.origin
    along = -np.sum(frames.n * way, axis=-1)
    return np.arctan2(np.linalg.norm(np.cross(frames.n, way), axis=-1), along)


@prune_stage(
    "hidden",
    on="device",
    share=Option(0.5, 0.0, 1.0),
    aperture=Option(ARRAY_SIDE, 0.0, 10.0, "m"),
    lines=Option(8, 1, 64),
    grain=Option(None, 1e-4, 1.0, "m", widths=0.25),
)
def prune_hidden(
    batch: ContourBatch, setting: Setting, *, share: float, aperture: float, lines: int, grain: float
) -> Pruned:
    """Remove what less than half of the array sees past the hand.

    share: the least of sight lines that must be free, 0..1; aperture: side of the array's face [m]; lines: sight lines
    along a side; grain: judged in parts no longer than this [m], by both their ends. A hand mesh hides what lies behind
    any of its triangles.
    """
    parts = divide_segments(batch.points, batch.polyline_start, grain)
    face = aperture_at(setting.array_position, setting.array_normal, aperture, lines)
    least = math.ceil(share * lines * lines - 1e-9)
    where = (batch.points, batch.polyline_start)
    if is_mesh(setting):
        hand: Any = setting.hand
        rows = slice(0, 1) if hand.pose_count is None else slice(setting.first, setting.first + len(setting.pose))
        keep = see_past_mesh(
            *where, batch.pose_start, parts, hand.vertices[rows], hand.faces, setting.pose, face, least
        )
    else:
        patches = patches_on(setting.frames, setting.device)
        keep = see_past_patches(*where, batch.pose_start, parts, patches, face, least)
    return cut_batch(batch, keep, parts=parts)


def aperture_at(position: np.ndarray, normal: np.ndarray, side: float, count: int) -> Any:
    """Points over a square face, `count` a side, each in the middle of its share; its sides nearest to x and y."""
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    u = np.cross([0.0, 1.0, 0.0] if abs(n[1]) < 0.9 else [0.0, 0.0, 1.0], n)
    u *= side / count / np.linalg.norm(u)
    face = Aperture()
    face.middle, face.u, face.v = wp.vec3d(*map(float, position)), wp.vec3d(*u), wp.vec3d(*np.cross(n, u))
    face.count = count
    return face


def is_mesh(setting: Setting) -> bool:
    """Whether the hand is a triangulated skin."""
    return hasattr(setting.hand, "skin_on")
