"""Sides along which two patches of a hand touch: what of them both would draw, or neither should, is dropped.

| the two sides | are | hand segments where they touch |
|---|---|---|
| farther apart than `gap` somewhere | two edges of skin | stay |
| nearer, the patches in one plane within `angle`, back to back | no edge of skin | both patches' are dropped |
| nearer, the patches at an angle | one edge | the smaller patch's are dropped (equal ones: the second's) |
"""

import math
from functools import lru_cache

import warp as wp

from ..contours import Contours, find_poses
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT, Frame, Patch, corner, patch_coordinates, require_section_poses, section_frame
from ..section.clip import side_position
from ..section.draw import HAND
from .cut import Parts, room_for_parts

wp.set_module_options(EXACT)

EDGE = wp.constant(wp.float64(4.0e-6))  # [m]; what is this near to a side lies on it; no segment becomes shorter
NONE = wp.constant(-1)


@wp.struct
class SidePair:
    """Two patches and the sides by which they touch."""

    patch: wp.vec2i
    side: wp.vec2i


@wp.struct
class HandPatches:
    """The patches of a hand, how they are joined, and where they are at each pose."""

    pose: wp.array2d[wp.transform]  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch]
    pair: wp.array[SidePair]
    dropped: wp.array3d[wp.vec2d]  # from, to: `side_position` [m], from > to for nothing; shape [pose, pair, 2]


@wp.func
def side_end(f: Frame, half: wp.vec2d, k: int):
    """Corner k of a patch in the array's frame [m], float64."""
    c = corner(k % 4, half)
    return f.origin + c[0] * f.u + c[1] * f.v


@wp.func
def half_along(side: int, half: wp.vec2d):
    """Half the length of a side [m]."""
    return wp.where(side % 2 == 0, half[0], half[1])


@wp.kernel
def _find_touching_sides(hand: HandPatches, cosine: wp.float64, gap: wp.float64):
    """Find where the sides of each pair touch, and on which of the two patches that interval is dropped.

    cosine: of the largest angle between patches in one plane; gap: largest distance between sides that touch [m].
    """
    row, k = wp.tid()
    nothing = wp.vec2d(wp.float64(1.0), wp.float64(-1.0))
    hand.dropped[row, k, 0] = nothing
    hand.dropped[row, k, 1] = nothing
    two = hand.pair[k]
    one = hand.patch[two.patch[0]]
    other = hand.patch[two.patch[1]]
    f = section_frame(hand.pose, hand.patch, row * hand.patch.shape[0] + two.patch[0])
    g = section_frame(hand.pose, hand.patch, row * hand.patch.shape[0] + two.patch[1])
    a = side_end(f, one.half, two.side[0])
    b = side_end(g, other.half, two.side[1])
    along_b = side_end(g, other.half, two.side[1] + 1) - b
    half_a = half_along(two.side[0], one.half)
    half_b = half_along(two.side[1], other.half)
    along_a = (side_end(f, one.half, two.side[0] + 1) - a) / (wp.float64(2.0) * half_a)
    start = wp.dot(b - a, along_a)  # of the other side, along the first one from its start
    reach = wp.dot(along_b, along_a)
    low = wp.max(wp.float64(0.0), wp.min(start, start + reach))
    high = wp.min(wp.float64(2.0) * half_a, wp.max(start, start + reach))
    if high - low > EDGE:
        low_b = (low - start) / reach
        high_b = (high - start) / reach
        apart = wp.max(
            wp.length(b + low_b * along_b - a - low * along_a), wp.length(b + high_b * along_b - a - high * along_a)
        )
        flat = wp.dot(f.n, g.n) >= cosine and reach < wp.float64(0.0)
        first_larger = one.half[0] * one.half[1] >= other.half[0] * other.half[1]
        if apart <= gap + EDGE:
            if flat or not first_larger:
                hand.dropped[row, k, 0] = wp.vec2d(low - half_a, high - half_a)
            if flat or first_larger:
                p = wp.float64(2.0) * half_b * wp.min(low_b, high_b)
                q = wp.float64(2.0) * half_b * wp.max(low_b, high_b)
                hand.dropped[row, k, 1] = wp.vec2d(p - half_b, q - half_b)


@wp.struct
class SideInterval:
    """A segment on a side of its patch."""

    side: int  # NONE if it is on none
    sign: wp.float64  # 1 if it runs counter-clockwise, else -1
    start: wp.float64  # sign * `side_position` of its ends [m]
    stop: wp.float64


@wp.func
def interval_of(f: Frame, half: wp.vec2d, x: wp.vec3, y: wp.vec3):
    """The segment x -> y as an interval of a patch's side."""
    out = SideInterval()
    out.side = NONE
    p3 = patch_coordinates(f, x)
    q3 = patch_coordinates(f, y)
    p = wp.vec2d(p3[0], p3[1])
    q = wp.vec2d(q3[0], q3[1])
    for k in range(4):
        level = wp.where(k % 2 == 0, half[1], half[0])
        away_p = wp.abs(side_position((k + 3) % 4, p) - level)  # a side's line is as far along the side before it
        away_q = wp.abs(side_position((k + 3) % 4, q) - level)
        if out.side == NONE and away_p <= EDGE and away_q <= EDGE:
            out.side = k
            out.start = side_position(k, p)
            out.stop = side_position(k, q)
    out.sign = wp.float64(1.0)
    if out.stop < out.start:
        out.sign = wp.float64(-1.0)
    out.start = out.sign * out.start
    out.stop = out.sign * out.stop
    return out


@wp.func
def next_end(s: SideInterval, own: int, row: int, hand: HandPatches):
    """The first end of a dropped interval after the start of s, by more than EDGE; the end of s if there is none."""
    found = s.stop
    for k in range(hand.pair.shape[0]):
        for r in range(2):
            if hand.pair[k].patch[r] == own and hand.pair[k].side[r] == s.side:
                d = hand.dropped[row, k, r]
                if d[0] < d[1]:
                    for e in range(2):
                        t = s.sign * d[e]
                        if t > s.start + EDGE and t < wp.min(found, s.stop - EDGE):
                            found = t
    return found


@wp.func
def is_dropped(s: SideInterval, stop: wp.float64, own: int, row: int, hand: HandPatches):
    """Whether the middle of s, up to `stop`, lies in a dropped interval."""
    middle = s.sign * wp.float64(0.5) * (s.start + stop)
    for k in range(hand.pair.shape[0]):
        for r in range(2):
            if hand.pair[k].patch[r] == own and hand.pair[k].side[r] == s.side:
                d = hand.dropped[row, k, r]
                if d[0] <= middle and middle <= d[1]:
                    return True
    return False


@wp.func
def interval_at(c: Contours, f: Frame, half: wp.vec2d, i: wp.int64):
    """The segment that starts at a point, if it is of the hand."""
    s = SideInterval()
    s.side = NONE
    if int(c.kind[i]) == HAND:
        s = interval_of(f, half, c.points[i], c.points[i + wp.int64(1)])
    return s


@wp.kernel
def _count_joint_parts(c: Contours, line_pose: wp.array[wp.int32], hand: HandPatches, count: wp.array[wp.int64]):
    """Count the parts into which the ends of dropped intervals divide each segment of a polyline."""
    line = wp.tid()
    base = c.polyline_start[line]
    own = c.polyline_patch[line]
    row = line_pose[line]
    f = section_frame(hand.pose, hand.patch, row * hand.patch.shape[0] + own)
    for k in range(int(c.polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        parts = int(1)
        s = interval_at(c, f, hand.patch[own].half, i)
        if s.side != NONE:
            t = next_end(s, own, row, hand)
            while t < s.stop:
                parts += 1
                s.start = t
                t = next_end(s, own, row, hand)
        count[i] = wp.int64(parts)


@wp.kernel
def _divide_joints(
    # In:
    c: Contours,
    line_pose: wp.array[wp.int32],
    hand: HandPatches,
    start: wp.array[wp.int64],  # offsets of each segment's parts
    # Out:
    parts: Parts,
    keep: wp.array[wp.uint8],  # of each part
):
    """Write where each part begins, and whether it stays."""
    line = wp.tid()
    base = c.polyline_start[line]
    own = c.polyline_patch[line]
    row = line_pose[line]
    f = section_frame(hand.pose, hand.patch, row * hand.patch.shape[0] + own)
    for k in range(int(c.polyline_start[line + 1] - base) - 1):
        i = base + wp.int64(k)
        first = start[i]
        s = interval_at(c, f, hand.patch[own].half, i)
        begin = s.start
        for n in range(int(start[i + wp.int64(1)] - first)):
            part = first + wp.int64(n)
            parts.segment[part] = i
            parts.share[part] = wp.float64(0.0)
            keep[part] = wp.uint8(1)
            if s.side != NONE:
                if n > 0:
                    parts.share[part] = (s.start - begin) / (s.stop - begin)
                t = next_end(s, own, row, hand)
                if is_dropped(s, t, own, row, hand):
                    keep[part] = wp.uint8(0)
                s.start = t


@lru_cache(maxsize=16)
def side_pairs(pairs: tuple[tuple[int, int, int, int], ...], device: str) -> wp.array:
    """Pairs (patch, side, other patch, other side) on a device, dtype SidePair; cached, as live hands keep them."""
    rows = []
    for one, side, other, other_side in pairs:
        pair = SidePair()
        pair.patch, pair.side = wp.vec2i(one, other), wp.vec2i(side, other_side)
        rows.append(pair)
    return wp.array(rows, dtype=SidePair, device=device)


@on_one_device
def divide_joints(
    contours: Contours, pose: wp.array, patch: wp.array, pair: wp.array, *, angle: float, gap: float
) -> tuple[Parts, wp.array]:
    """Divide hand segments where patches touch, and find the parts to drop; see the table above.

    pose: wp.transform, shape [pose, 1 or patch]; patch: Patch, shape [patch]; pair: see `side_pairs`. angle: of patches
    in one plane at most [rad]; gap: between sides that touch at most [m]. Raises ValueError for poses of another shape
    or number. Returns Parts and `keep`, uint8 [part], as `cut_contours` takes them.
    """
    require_section_poses(pose, patch)
    device, pose_count = pose.device, pose.shape[0]
    if contours.pose_start.shape[0] != pose_count + 1:
        raise ValueError(f"contours are of {contours.pose_start.shape[0] - 1} poses, not of {pose_count}")
    hand = HandPatches()
    hand.pose, hand.patch, hand.pair = pose, patch, pair
    hand.dropped = wp.empty((pose_count, pair.shape[0], 2), dtype=wp.vec2d, device=device)
    sides = [hand, wp.float64(math.cos(angle)), wp.float64(gap)]
    launch(_find_touching_sides, (pose_count, pair.shape[0]), sides, [])
    (parts, keep), (parts.start,) = count_then_fill(
        _count_joint_parts,
        _divide_joints,
        contours.polyline_closed.shape[0],
        [contours, find_poses(contours), hand],
        lambda total: [room_for_parts(total, device), wp.empty(total, dtype=wp.uint8, device=device)],
        rows=contours.points.shape[0],
    )
    return parts, keep
