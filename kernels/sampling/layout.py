"""Layout of batch sampling: the strategy as numbers, contours of many poses, and tracks laid over them.

The model is the host's sampler, render/sampling: the same operations in the same order in float64. Its sums of squares
come in two orders, that of `np.einsum` and that of `np.linalg.norm`; so there are two functions for a length here.
"""

import warp as wp

ZERO, HALF, ONE, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 0.5, 1.0, 2.0))
INFINITE = wp.constant(wp.float64(1e300))  # [m]; longer than any way
TINY = wp.constant(wp.float64(1e-30))  # [m^2]; least divisor
SEAM = wp.constant(wp.float64(1e-3))  # of a sample, as in the strategy
SPEED, FREQUENCY, CAPPED, STILL = (wp.constant(k) for k in range(4))  # kinds of pace
AS_GIVEN, REVERSED, BEGUN = (wp.constant(k) for k in range(3))  # ways to draw a piece


@wp.struct
class SamplingPlan:
    """A sampling strategy as numbers; flags are 0 or 1."""

    speed: wp.float64  # [m/s]
    rate: wp.float64  # focal points a second [Hz]
    pace: wp.int32
    fixed: wp.int64  # samples a cycle of pace FREQUENCY
    fewest: wp.int64  # samples a cycle of pace CAPPED
    most: wp.int64
    lowest: wp.float64  # draw frequency of pace CAPPED [Hz]
    points: wp.int64  # points a cycle; 0: one a sample
    points_least: wp.int64  # samples a cycle at least, so that every point is shown
    foci: wp.int32
    threshold: wp.float64  # a longer step is a jump [m]
    ordinary: wp.float64  # longest step at the nominal speeds [m]
    circle_step: wp.float64  # most that a small circle adds to a step [m]
    circle_radius: wp.float64  # [m]; 0: none
    circle_turns: wp.float64  # a sample
    wave: wp.int32  # amplitude modulation: 0 none, 1 sine, 2 square
    wave_turns: wp.float64  # a sample
    wave_depth: wp.float64
    fade: wp.float64  # how long one takes [ticks]
    restarts: wp.int32  # continuity "jump"
    finishes: wp.int32  # continuity "finish"
    plain: wp.int32  # a cycle's duration depends on arc length alone
    shortest: wp.int32  # the route has the shortest jumps; 0: it is as given
    margin: wp.float64  # share by which the jumps of a kept route may grow
    closes: wp.int32  # open pieces are closed by their chord
    turns_back: wp.int32  # open pieces are drawn there and back
    returns: wp.int32  # between pieces the focal point runs
    return_speed: wp.float64  # [m/s]
    pendulum: wp.int32  # the whole cycle is drawn there and back
    passes: wp.int32  # nodes of a cycle at a vertex at most: how often it is passed, twice that with pauses
    dwell_time: wp.float64  # of each pause at a corner [s]; 0: pauses take a share of the cycle, or there are none
    dwell_ratio: wp.float64  # of the time at corners to that between them
    corner_cosine: wp.float64  # of the least angle of a corner
    sections: wp.int32  # that a cycle is divided into; 0: it is not
    section_speed: wp.float64  # within one [m/s]
    section_share: wp.float64  # of the cycle, for the sections with a corner together
    frequency: wp.float64  # cycles a second of pace FREQUENCY [Hz]


@wp.struct
class DrawnPiece:
    """A polyline of non-zero length, and how it is drawn."""

    line: wp.int64  # number of the polyline
    mode: wp.int32  # AS_GIVEN, REVERSED or BEGUN
    after: wp.int32  # first vertex behind the point where a BEGUN loop begins
    before: wp.int32  # the vertices 1..before - 1 come last
    at: wp.vec3d  # where a BEGUN loop begins [m]
    level: wp.float64  # intensity there
    earlier: wp.int32  # number of the same piece in the route before, -1: none
    mark: wp.vec4d  # middle and size [m], by which it is recognised


@wp.struct
class RouteRows:
    """Pieces of all poses; those of a pose stand at the rows of its polylines, or the first of them."""

    given: wp.array[DrawnPiece]  # as the batch has them
    drawn: wp.array[DrawnPiece]  # in the order in which they are drawn
    candidate: wp.array[DrawnPiece]  # in the order of the route that was searched for
    span: wp.array[wp.float64]  # length, later duration, of a piece; room for sums
    door: wp.array2d[wp.vec3d]  # room for starts that are looked at [m], shape [run, DOORS]
    room: wp.array[wp.int32]  # room of a search, ROOM a run
    sums: wp.array[wp.float64]  # room of a search [m], SUMS a run


@wp.struct
class DrawnSection:
    """A part of a track that is passed to and fro an odd number of times before the next one is."""

    start: wp.int32  # first node, counted from the track's
    stop: wp.int32  # last node
    passes: wp.int32
    corner: wp.int32  # 1: there is one in it
    begin: wp.float64  # knot
    scale: wp.float64  # knots that a second takes at the nominal speeds


@wp.struct
class TrackNodes:
    """Nodes of the tracks of all poses."""

    knot: wp.array[wp.float64]  # when each is reached, from 0; with sections how long the way to it takes [s]
    point: wp.array[wp.vec3d]  # [m]
    intensity: wp.array[wp.float64]  # of length 0 where it is 1 everywhere
    piece: wp.array[wp.int32]  # number of its piece in the route, -1: of none
    pause: wp.array[wp.float64]  # room for the pause there [s]; of length 0 if there is none anywhere
    corner: wp.array[wp.uint8]  # room for whether it is a corner to pause at
    section: wp.array[DrawnSection]  # of all tracks; of length 0 if there are none
    stretch: wp.array[wp.float64]  # by which ways on each piece take longer in sections, by the pieces' rows


@wp.struct
class PoseTrack:
    """A cycle of focal points over a pose's contours."""

    first: wp.int64  # node
    count: wp.int32  # of nodes; 0: nothing is drawn
    period: wp.float64  # in the unit of the knots
    one_sample: wp.float64  # from a sample to the next, in that unit
    repeat: wp.int64  # samples after which they lie where they lay before
    turns: wp.int32  # cycles until then
    pieces: wp.int32  # in the route
    single: wp.int32  # 1: every sample is on piece 0
    least: wp.float64  # jumps of the shortest route known [m]
    ordinary: wp.float64  # longest step along it, jumps left out [m]
    pauses: wp.int32  # ways on which the focal point rests
    sections: wp.int32  # that its nodes are drawn in; 0: they are drawn one after the other
    section: wp.int64  # row of the first section
    line: wp.int64  # row of the first piece


@wp.struct
class FocusPlace:
    """Where the focal point is, such that it can be found on another track."""

    pose: wp.int64  # drawn last, -1: none
    point: wp.vec3d  # [m]
    direction: wp.vec3d  # of its motion; zero: none is known
    silent: wp.int32  # 1: the last sample was
    rested: wp.float64  # how much of a pause is over, 0..1; negative in motion
    beside: wp.int32  # 1 shortly behind a pause, -1 shortly before one, else 0
    middle: wp.vec3d  # of the section that is drawn [m]
    through: wp.float64  # how much of the section's time is over, 0..1


@wp.func
def squared(d: wp.vec3d):
    """Square length [m^2], summed as by np.einsum: x and z first."""
    return (d[0] * d[0] + d[2] * d[2]) + d[1] * d[1]


@wp.func
def product(a: wp.vec3d, b: wp.vec3d):
    """Scalar product, summed as by np.einsum: x and z first."""
    return (a[0] * b[0] + a[2] * b[2]) + a[1] * b[1]


@wp.func
def distance(a: wp.vec3d, b: wp.vec3d):
    """Distance [m], summed as by np.linalg.norm: in order."""
    d = b - a
    return wp.sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2])


@wp.func
def sum_few(values: wp.array[wp.float64], first: wp.int64, count: int):
    """Sum of at most 128 values, added as by np.sum."""
    if count < 8:
        total = ZERO
        for i in range(count):
            total += values[first + wp.int64(i)]
        return total
    part = wp.zeros(shape=8, dtype=wp.float64)
    whole = count - count % 8
    for i in range(whole):
        part[i % 8] = part[i % 8] + values[first + wp.int64(i)]
    total = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]))
    for i in range(whole, count):
        total += values[first + wp.int64(i)]
    return total


@wp.func
def sum_of(values: wp.array[wp.float64], first: wp.int64, count: int):
    """Sum of values, added as by np.sum: halves that are whole blocks of eight, down to 128 values."""
    right = wp.zeros(shape=32, dtype=wp.int32)  # how many values the other half has; 0: it is being summed
    left = wp.zeros(shape=32, dtype=wp.float64)  # sum of the half before it
    depth = int(0)
    at = first
    left_over = count
    total = ZERO
    busy = int(1)
    while busy == 1:
        while left_over > 128:
            half = left_over // 2
            half -= half % 8
            right[depth] = left_over - half
            depth += 1
            left_over = half
        total = sum_few(values, at, left_over)
        at += wp.int64(left_over)
        while depth > 0 and right[wp.max(depth - 1, 0)] == 0:
            depth -= 1
            total = left[depth] + total
        if depth == 0:
            busy = 0
        else:
            left[depth - 1] = total
            left_over = right[depth - 1]
            right[depth - 1] = 0
    return total


@wp.func
def samples_of(plan: SamplingPlan, seconds: wp.float64):
    """Samples of a cycle that takes so long at the nominal speeds [s]."""
    count = wp.int64(1)
    if plan.pace == FREQUENCY:
        count = plan.fixed
    elif plan.pace != STILL:
        count = wp.int64(wp.ceil(seconds * plan.rate - SEAM))
        if plan.pace == CAPPED:
            count = wp.min(wp.max(count, plan.fewest), plan.most)
    return wp.max(wp.max(count, plan.points_least), wp.int64(1))
