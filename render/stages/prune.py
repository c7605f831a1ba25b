"""Prune stages remove what cannot be felt or what the array cannot reach, and measure the length removed.

| stage | removes |
|---|---|
| off-skin | what lies farther from the skin than a focal radius |
| close-together | what runs beside a longer contour, too near to be felt as separate |
| small | loops and pieces too short to be felt as such |
| turned-away | the contours of patches that face away from the array |
| hidden | what too little of the array can see past the rest of the hand |
| joined | sides of patches that touch, which would be drawn twice or inside the hand |

Every length that depends on what can be felt is by default a multiple of the focal width, FWHM of p^2 across the focus
(`focal_width`): docs/guide/pruning.md has the numbers and where they come from.
"""

import math
from typing import Any

import numpy as np
import warp as wp

from ...kernels.one_device import require_one_device
from ...kernels.stages.cut import cut_contours, divide_segments, measure_removed, spread_keep
from ...kernels.stages.joint import divide_joints, side_pairs
from ...kernels.stages.prune import keep_long, keep_patches, part_off_skin
from ...kernels.stages.prune_crowded import Beside, thin_contours
from ...kernels.stages.prune_hidden import Aperture, see_past_mesh, see_past_patches
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..hands.hand import PatchFrames
from ..hands.plane_hand import PlaneHand
from .registry import Option, prune_stage
from .setting import Setting

Pruned = tuple[ContourBatch, np.ndarray]

ARRAY_SIDE = 0.168  # [m]; 16 transducers at 10.5 mm
PARTS_A_DISTANCE = 8  # a segment is tested in parts of at most this share of the distance
JOINT_ANGLE = math.radians(10.0)
JOINT_GAP = 0.005  # [m]; about half a focal width: sides this near are one to the skin


def cut_batch(batch: ContourBatch, keep: Any, *, parts: Any = None) -> tuple[ContourBatch, np.ndarray]:
    """A batch without the segments whose `keep` is 0, and the length removed of each pose [m], float32, shape [pose].

    keep: one value for the segment that starts at each point, bool or uint8, shape [point], on the host or device as
    the batch; the value at a polyline's last point is ignored. parts: for a batch on a device, `Parts` into which
    segments are divided; `keep` then has one value for each part. Rules of cutting: see `kernels.stages.cut`.
    Raises StrategyError for a `keep` of another length, MixedDevicesError for arrays on another device than the batch.

    >>> from palpate.render import cut_batch, render, static_pose
    >>> batch = render("cube", "palm", static_pose([0, 0, 0.2]))  # a square of 0.085 m, its middle at x = 0
    >>> left, removed = cut_batch(batch, batch.points[:, 0] < 0)  # segments that start at x < 0
    >>> left.length().round(3), removed.round(3)  # [m]
    (array([0.17], dtype=float32), array([0.17], dtype=float32))
    """
    on_host = not batch.on_device
    if not on_host:
        require_one_device(batch=batch, keep=keep, parts=parts)
    else:
        keep = np.ascontiguousarray(np.asarray(keep) != 0).astype(np.uint8)
        batch, keep = batch.to("cpu"), wp.array(keep, dtype=wp.uint8, device="cpu")
    wanted = batch.point_count if parts is None else parts.segment.shape[0]
    if keep.shape != (wanted,):
        raise StrategyError(f"keep must have shape [{wanted}], one entry a segment, not {list(keep.shape)}")
    contours = batch.struct
    if parts is None:
        parts = divide_segments(contours)
        keep = spread_keep(parts, keep)
    out = ContourBatch.from_struct(cut_contours(contours, keep, parts))
    return (out.numpy() if on_host else out), measure_removed(contours, parts, keep).numpy()


@prune_stage("off-skin", on="device", radius=Option(None, 0.0, 1.0, "m", widths=0.5))
def prune_off_skin(batch: ContourBatch, setting: Setting, *, radius: float) -> Pruned:
    """Remove what lies farther than a focal radius from every patch of the hand.

    Segments are cut exactly where they pass that distance. Contours on a hand mesh lie on its skin and all stay.
    """
    if is_mesh(setting):
        return batch, np.zeros(batch.pose_count, np.float32)
    parts, keep = part_off_skin(batch.struct, setting.patches, radius)
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
    compared. Segments are tested in parts of at most an eighth of the distance: see `kernels.stages.prune_crowded`.
    """
    rule = Beside()
    rule.distance, rule.parallel = wp.float64(distance), wp.float64(math.cos(angle))
    rule.apart, rule.patches = wp.float64(apart), int(across)
    parts = divide_segments(batch.struct, distance / PARTS_A_DISTANCE)
    return cut_batch(batch, thin_contours(batch.struct, parts, rule), parts=parts)


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
    return cut_batch(batch, keep_long(batch.struct, length, perimeter))


@prune_stage("turned-away", on="device", angle=Option(math.pi / 3, 0.0, math.pi, "rad"))
def prune_turned_away(batch: ContourBatch, setting: Setting, *, angle: float) -> Pruned:
    """Remove the contours of patches whose skin faces away from the array.

    angle: the most between the skin's normal and the line from the patch's middle to the array's [rad]. A hand mesh
    counts as its palm's plane.
    """
    facing = facing_angle(setting.frames, setting.array_position)
    stays = wp.array((facing <= angle).astype(np.uint8), dtype=wp.uint8, device=setting.device)
    return cut_batch(batch, keep_patches(batch.struct, stays))


def facing_angle(frames: PatchFrames, array_position: np.ndarray) -> np.ndarray:
    """Angle between a patch's skin normal, -n, and the line from its middle to a point [rad], shape [pose, patch].

    NaN for a patch that is not there; 0 for one that lies in the point.
    """
    to_point = np.asarray(array_position, np.float64) - frames.origin
    along = -np.sum(frames.n * to_point, axis=-1)
    return np.arctan2(np.linalg.norm(np.cross(frames.n, to_point), axis=-1), along)


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
    along a side; grain: segments are tested in parts no longer than this [m], at both ends of each part. A hand mesh
    hides what lies behind any of its triangles.
    """
    parts = divide_segments(batch.struct, grain)
    face = aperture_at(setting.array_position, setting.array_normal, aperture, lines)
    least = math.ceil(share * lines * lines - 1e-9)
    if is_mesh(setting):
        hand: Any = setting.hand
        rows = slice(0, 1) if hand.pose_count is None else slice(setting.first, setting.first + len(setting.pose))
        keep = see_past_mesh(batch.struct, parts, hand.vertices[rows], hand.faces, setting.pose, face, least)
    else:
        keep = see_past_patches(batch.struct, parts, setting.patches, face, least)
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


@prune_stage(
    "joined", on="device", angle=Option(JOINT_ANGLE, 0.0, math.pi / 2, "rad"), gap=Option(JOINT_GAP, 0.0, 0.1, "m")
)
def drop_joined_sides(
    batch: ContourBatch, setting: Setting, *, angle: float, gap: float
) -> tuple[ContourBatch, np.ndarray]:
    """Drop hand segments on sides by which patches touch.

    Where the two sides of a joint are within `gap` [m] of each other, hand segments on them are dropped from both
    patches while these are in one plane within `angle` [rad], else from the smaller one. Other hands, and other
    segments, stay as they are. Returns the length removed [m], shape [pose].
    """
    hand = setting.hand
    if not isinstance(hand, PlaneHand) or not hand.joints or batch.polyline_count == 0:
        return batch, np.zeros(batch.pose_count, np.float32)
    pose = wp.array(hand.section_poses(setting.pose, setting.first), dtype=wp.transform, device=setting.device)
    numbers = {patch.name: k for k, patch in enumerate(hand.patches)}
    pairs = tuple((numbers[j.patch], j.side, numbers[j.other], j.other_side) for j in hand.joints)
    joint_sides = side_pairs(pairs, setting.device)
    parts, keep = divide_joints(batch.struct, pose, hand.on(setting.device), joint_sides, angle=angle, gap=gap)
    return cut_batch(batch, keep, parts=parts)
