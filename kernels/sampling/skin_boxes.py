"""Boxes around focal points on the skin: of each focal point one a pose, and one for sixteen samples in a row."""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .cursor import PoseSchedule
from .layout import INFINITE, ONE, TWO, ZERO

wp.set_module_options(EXACT)

REVISIT_RADIUS = 5e-3  # [m], as in render/sampling/revisits.py
NEAR = wp.constant(wp.float64(REVISIT_RADIUS**2))  # [m^2]
SURELY_NEAR = wp.constant(wp.float64((1.001 * REVISIT_RADIUS) ** 2))  # [m^2]; no rounding leaves a near sample out
GROUP = wp.constant(wp.int64(16))  # samples in a row that have a box
EMPTY, FAR, NEARBY = (wp.constant(k) for k in range(3))  # what a box is to a place


@wp.struct
class SkinSamples:
    """Focal points, and the boxes around them on the skin; a pose's first box is around all its samples."""

    position: wp.array2d[wp.vec3]  # [m], array frame, shape [sample, focus]
    intensity: wp.array2d[wp.float32]
    pose: wp.array[wp.transformd]  # hand frame -> array frame
    low: wp.array2d[wp.vec3d]  # [m], hand frame, of what is drawn, shape [box, focus]; above `high` if nothing is
    high: wp.array2d[wp.vec3d]
    rests: wp.array[wp.int32]  # 1: in every sample of a pose that is drawn the same focal points are, where they were


@wp.struct
class HandFrame:
    """Axes and origin of a hand frame in the array frame."""

    across: wp.vec3d
    up: wp.vec3d
    along: wp.vec3d
    at: wp.vec3d  # [m]


@wp.func
def frame_of(pose: wp.transformd):
    """The frame of a hand pose."""
    frame = HandFrame()
    q = wp.transform_get_rotation(pose)
    x = q[0]
    y = q[1]
    z = q[2]
    w = q[3]
    frame.across = wp.vec3d(ONE - TWO * (y * y + z * z), TWO * (x * y + z * w), TWO * (x * z - y * w))
    frame.up = wp.vec3d(TWO * (x * y - z * w), ONE - TWO * (x * x + z * z), TWO * (y * z + x * w))
    frame.along = wp.vec3d(TWO * (x * z + y * w), TWO * (y * z - x * w), ONE - TWO * (x * x + y * y))
    frame.at = wp.transform_get_translation(pose)
    return frame


@wp.func
def in_order(a: wp.vec3d, b: wp.vec3d):
    """Scalar product, summed in order."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


@wp.func
def on_skin(frame: HandFrame, p: wp.vec3):
    """A point of the array frame in a hand frame [m]."""
    off = wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2])) - frame.at
    return wp.vec3d(in_order(frame.across, off), in_order(frame.up, off), in_order(frame.along, off))


@wp.func
def first_box(schedule: PoseSchedule, pose: wp.int64):
    """First box of a pose; before it is room for those of all earlier ones."""
    return wp.int64(2) * pose + schedule.row[pose] / GROUP


@wp.func
def first_drawn(skin: SkinSamples, begin: wp.int64, stop: wp.int64):
    """The first sample from one on that draws a focal point; `stop` if none does."""
    row = begin
    drawn = int(0)
    while row < stop and drawn == 0:
        for focus in range(skin.intensity.shape[1]):
            if skin.intensity[row, focus] > 0.0:
                drawn = int(1)
        if drawn == 0:
            row += wp.int64(1)
    return row


@wp.func
def is_at_rest(skin: SkinSamples, first: wp.int64, stop: wp.int64):
    """Whether every sample that is drawn is as the first one: the same focal points at the same places."""
    row = first + wp.int64(1)
    while row < stop:
        silent = int(1)
        same = int(1)
        for focus in range(skin.intensity.shape[1]):
            shown = skin.intensity[row, focus] > 0.0
            if shown:
                silent = int(0)
            if shown != (skin.intensity[first, focus] > 0.0):
                same = int(0)
            elif shown and not (skin.position[row, focus] == skin.position[first, focus]):
                same = int(0)
        if silent == 0 and same == 0:
            return 0
        row += wp.int64(1)
    return 1


@wp.func
def box_around(
    skin: SkinSamples,
    frame: HandFrame,
    first: wp.int64,
    stop: wp.int64,
    focus: int,
):
    """Least and greatest coordinates of a focal point among samples, where it is drawn [m]."""
    least = wp.vec3d(INFINITE, INFINITE, INFINITE)
    most = -least
    row = first
    while row < stop:
        if skin.intensity[row, focus] > 0.0:
            point = on_skin(frame, skin.position[row, focus])
            least = wp.min(least, point)
            most = wp.max(most, point)
        row += wp.int64(1)
    return least, most


@wp.kernel
def _box_samples(
    # In:
    schedule: PoseSchedule,
    skin: SkinSamples,
    # Out:
    low: wp.array2d[wp.vec3d],
    high: wp.array2d[wp.vec3d],
    rests: wp.array[wp.int32],
):
    """Put boxes around the samples of a pose; around all at once if they rest."""
    pose = wp.tid()
    frame = frame_of(skin.pose[pose])
    stop = schedule.row[pose] + schedule.count[pose]
    drawn = first_drawn(skin, schedule.row[pose], stop)
    still = is_at_rest(skin, drawn, stop)
    rests[pose] = still
    begin = schedule.row[pose]
    if still == 1:
        begin = drawn
        stop = wp.min(drawn + wp.int64(1), stop)
    own = first_box(schedule, wp.int64(pose))
    for focus in range(skin.intensity.shape[1]):
        least = wp.vec3d(INFINITE, INFINITE, INFINITE)
        most = -least
        row = begin
        box = own
        while row < stop:
            a, b = box_around(skin, frame, row, wp.min(row + GROUP, stop), focus)
            least = wp.min(least, a)
            most = wp.max(most, b)
            box += wp.int64(1)
            if still == 0:
                low[box, focus] = a
                high[box, focus] = b
            row += GROUP
        low[own, focus] = least
        high[own, focus] = most


@wp.func
def nearness(skin: SkinSamples, box: wp.int64, place: wp.vec3d):
    """Whether a sample in a box may be near to a place: EMPTY, FAR or NEARBY."""
    out = int(EMPTY)
    for focus in range(skin.low.shape[1]):
        if out != NEARBY and skin.low[box, focus][0] <= skin.high[box, focus][0]:
            out = FAR
            low = skin.low[box, focus] - place
            high = place - skin.high[box, focus]
            off = wp.max(wp.max(low, high), wp.vec3d(ZERO, ZERO, ZERO))
            if in_order(off, off) < SURELY_NEAR:
                out = NEARBY
    return out


@wp.func
def square_to(skin: SkinSamples, frame: HandFrame, row: wp.int64, place: wp.vec3d):
    """Square distance of the nearest drawn focal point of a sample from a place [m^2]; negative if none is drawn."""
    least = -ONE
    for focus in range(skin.intensity.shape[1]):
        if skin.intensity[row, focus] > 0.0:
            off = on_skin(frame, skin.position[row, focus]) - place
            square = in_order(off, off)
            if least < ZERO or square < least:
                least = square
    return least


def skin_samples(schedule: PoseSchedule, pose: wp.array, position: wp.array, intensity: wp.array) -> SkinSamples:
    """Focal points, and the boxes around them in the hand frame."""
    device, foci = position.device, position.shape[1]
    boxes = 2 * pose.shape[0] + position.shape[0] // 16
    skin = SkinSamples()
    skin.position, skin.intensity, skin.pose = position, intensity, pose
    skin.low = wp.empty((boxes, foci), dtype=wp.vec3d, device=device)
    skin.high = wp.empty((boxes, foci), dtype=wp.vec3d, device=device)
    skin.rests = wp.empty(pose.shape[0], dtype=wp.int32, device=device)
    outputs = [skin.low, skin.high, skin.rests]
    wp.launch(_box_samples, pose.shape[0], inputs=[schedule, skin], outputs=outputs, device=device, block_dim=BLOCK)
    return skin
