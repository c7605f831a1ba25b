"""Structs that the kernels of sampling share: the strategy as numbers, routes, cycles, and the state of a motion.

A motion is sampled span by span. A span has any number of its poses, and begins where the one before ended: what is
needed of the poses before is the motion's state. So focal points and counts do not depend on how a motion is cut.
"""

import warp as wp

ZERO, HALF, ONE, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 0.5, 1.0, 2.0))
INFINITE = wp.constant(wp.float64(1e300))  # [m]; longer than any distance
SAME_PLACE = wp.constant(wp.float64(1e-24))  # [m^2]
TINY = wp.constant(wp.float64(1e-30))  # [m^2]; least divisor
CYCLE_MOST = wp.constant(wp.float64(2.0**53))  # samples; a contour of so many is no contour, but shall not overflow
SEAM = wp.constant(wp.float64(1e-3))  # of a sample, as in the strategy
TICKS = wp.constant(wp.float64(1 << 20))  # of a sample: ages are counted in them, as in render/sampling/plan.py
SPEED, FREQUENCY, CAPPED, STILL = (wp.constant(k) for k in range(4))  # kinds of pace
AS_GIVEN, REVERSED, BEGUN = (wp.constant(k) for k in range(3))  # modes of a DrawnPiece


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
    points: wp.int32  # points a cycle; 0: one a sample
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
    plain: wp.int32  # a cycle's duration depends on arc length alone
    shortest: wp.int32  # the route has the shortest jumps; 0: it is as given
    margin: wp.float64  # share by which jumps may be longer in the order of the pose before
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

    line: wp.int32  # number of the polyline; in a motion's state counted from the pose's first one
    mode: wp.int32  # AS_GIVEN, REVERSED or BEGUN
    after: wp.int32  # first vertex behind the point where a BEGUN loop begins
    before: wp.int32  # the vertices 1..before - 1 come last
    at: wp.vec3d  # where a BEGUN loop begins [m]
    level: wp.float64  # intensity there
    earlier: wp.int32  # number of the same piece in the route before, -1: none
    mark: wp.vec4d  # middle and size [m], by which it is recognised
    start: wp.vec3d  # its first vertex as drawn [m], by which the next pose draws it alike; of several pieces only
    end: wp.vec3d  # its last one


@wp.struct
class RouteRows:
    """Pieces of all poses; those of a pose stand at the rows of its polylines, or the first of them."""

    given: wp.array[DrawnPiece]  # as the batch has them
    drawn: wp.array[DrawnPiece]  # in the order in which they are drawn; behind them those of the motions' states
    candidate: wp.array[DrawnPiece]  # in the order of the route that was searched for
    span: wp.array[wp.float64]  # length, later duration, of a piece
    start: wp.array2d[wp.vec3d]  # room for candidate starts [m], shape [run, STARTS_MOST]
    room: wp.array[wp.int32]  # room of a search, ROOM a run
    sums: wp.array[wp.float64]  # room of a search [m], SUMS a run


@wp.struct
class DrawnSection:
    """A part of a cycle that is passed to and fro an odd number of times before the next one is."""

    start: wp.int32  # first node, counted from the cycle's
    stop: wp.int32  # last node
    passes: wp.int32
    corner: wp.int32  # 1: there is one in it
    begin: wp.float64  # curve parameter there
    scale: wp.float64  # by which the nominal duration of each segment is multiplied


@wp.struct
class CycleNodes:
    """Nodes of the cycles of all poses.

    The curve parameter grows along a cycle as time does: it is the time since the first node at the nominal speeds [s],
    or the arc length [m] where that alone decides when a node is reached.
    """

    parameter: wp.array[wp.float64]  # of each node, from 0; with sections the duration of the segment to it [s]
    point: wp.array[wp.vec3d]  # [m]
    intensity: wp.array[wp.float64]  # of length 0 where it is 1 everywhere
    piece: wp.array[wp.int32]  # number of its piece in the route, -1: of none
    pause: wp.array[wp.float64]  # room for the pause there [s]; of length 0 if there is none anywhere
    corner: wp.array[wp.uint8]  # room for whether it is a corner to pause at
    section: wp.array[DrawnSection]  # of all cycles; of length 0 if there are none
    slowdown: wp.array[wp.float64]  # factor of durations on each piece in sections, by the pieces' rows


@wp.struct
class PoseCycle:
    """A cycle of focal points over a pose's contours."""

    first: wp.int32  # node
    count: wp.int32  # of nodes; 0: nothing is drawn
    period: wp.float64  # in the unit of the curve parameter
    samples: wp.int64  # a cycle
    one_sample: wp.float64  # from a sample to the next, in that unit
    repeat: wp.int64  # samples after which they lie where they lay before
    turns: wp.int32  # cycles until then
    pieces: wp.int32  # in the route
    single: wp.int32  # 1: every sample is on piece 0
    least: wp.float64  # jumps of the shortest route known [m]
    ordinary: wp.float64  # longest step along it, jumps left out [m]
    pauses: wp.int32  # segments on which the focal point rests
    sections: wp.int32  # that its nodes are drawn in; 0: they are drawn one after the other
    section: wp.int32  # row of the first section
    line: wp.int32  # row of the first piece


@wp.struct
class PoseSchedule:
    """When poses are drawn."""

    motion_start: wp.array[wp.int32]  # offsets into poses, shape [motion + 1]
    first: wp.array[wp.int64]  # first sample of a pose, counted from time 0 of its motion
    number: wp.array[wp.int64]  # the same, counted from the first one of all spans
    count: wp.array[wp.int32]  # of samples
    row: wp.array[wp.int32]  # of a pose's first sample among those of all motions in the span, shape [pose]
    motion: wp.array[wp.int32]  # number of each pose's motion
    time: wp.array[wp.float64]  # of poses [ticks]
    hold: wp.array[wp.float64]  # age at which a pose starts to fade [ticks], shape [motion]
    goes_on: wp.array[wp.int32]  # 1: the motion's first pose is the last one of the span before, shape [motion]
    shown: wp.array[wp.int32]  # place in a cycle of the points in the order in which they are shown


@wp.struct
class FocusPlace:
    """Place of the focal point, described such that it can be found on another cycle."""

    drawn: wp.int32  # 1: something has been drawn
    silent: wp.int32  # 1: the last sample was
    shape: wp.int64  # of the contours drawn last, see `shape_of`
    point: wp.vec3d  # [m]
    direction: wp.vec3d  # of its motion; zero: none is known
    rested: wp.float64  # how much of a pause is over, 0..1; negative in motion
    beside: wp.int32  # 1 shortly behind a pause, -1 shortly before one, else 0
    middle: wp.vec3d  # of the section that is drawn [m]
    through: wp.float64  # how much of the section's time is over, 0..1


@wp.struct
class PoseEntry:
    """Start of a pose's drawing."""

    drawn: wp.int32  # 1: the pose has contours and samples
    again: wp.int32  # 1: it goes on from the span before
    silent: wp.int32  # 1: the sample before is
    first: wp.int32  # 1: nothing has been drawn before
    before: wp.int32  # the pose drawn before in this span, -1: none
    found: wp.int32  # 1: drawing goes on from where it was; 0: from the start of the contours
    anchor: wp.float64  # curve parameter that the samples are counted from
    index: wp.int64  # of the pose's first sample


@wp.struct
class DrawnCycles:
    """Cycles of all poses, and where drawing begins on each."""

    nodes: CycleNodes
    cycles: wp.array[PoseCycle]
    entries: wp.array[PoseEntry]
    pose: wp.array[wp.transformd]  # hand frame -> array frame
    routes: wp.array[DrawnPiece]  # pieces as they are drawn; those of a pose from the row of its first polyline on


@wp.struct
class StepCount:
    """Numbers of what happens in samples; vectors have one of each cause, see CAUSES in render/sampling/metrics.py."""

    silent: wp.int64
    held: wp.int64
    jumps: wp.vec4l
    jump_lengths: wp.vec4d  # [m]
    hops: wp.vec4l
    hops_longest: wp.vec4d  # [m]
    step_longest: wp.float64  # [m]
    felt: wp.int32  # samples of a pose up to the last one that no fade has ended, those in between too
    lost: wp.int32  # 1: a fade has ended one of these
    absence: wp.int64  # most samples from one on a piece to the next on it


@wp.struct
class MotionState:
    """State of a motion after a span, and counts of its samples."""

    place: FocusPlace
    anchor: wp.float64  # of the pose drawn last, see PoseEntry
    index: wp.int64  # of the next sample on its cycle
    pieces: wp.int32  # in its route
    sizes: wp.int64  # of its polylines, see `sizes_of`
    least: wp.float64  # jumps of the shortest route known [m]
    lost: wp.int32  # 1: none of its pieces is known any more, because silence followed
    samples: wp.int64
    drawn: wp.int64
    cycles: wp.float64
    cycles_before: wp.float64  # on earlier poses' contours
    on_cycle: wp.int64  # samples on the current pose's contours
    steps: StepCount
    absence: wp.int64  # most samples from one on a piece that is there from pose to pose to the next on it


@wp.struct
class SamplerState:
    """States of motions, and what of them has several rows."""

    motion: wp.array[MotionState]
    shown: wp.array2d[wp.vec3d]  # the last focal points [m], shape [motion, focus]
    last: wp.array2d[wp.vec3d]  # the same before points are held or reordered, without small circles
    piece: wp.array[DrawnPiece]  # of the pose drawn last, `room` rows a motion
    seen: wp.array[wp.int64]  # sample in which each piece was drawn last, or before which it appeared
    room: wp.int32


@wp.func
def squared(d: wp.vec3d):
    """Square length [m^2]."""
    return wp.dot(d, d)


@wp.func
def distance(a: wp.vec3d, b: wp.vec3d):
    """Distance [m]."""
    return wp.length(b - a)


@wp.func
def part_of(step: wp.vec3d, off: wp.vec3d):
    """The place on a segment nearest to a point, 0..1; off: from the segment's start to the point [m]."""
    return wp.min(wp.max(wp.dot(off, step) / wp.max(squared(step), TINY), ZERO), ONE)


@wp.func
def without_rounding(step: wp.vec3d, part: wp.float64):
    """A place on a segment, 0..1; an end but for rounding is that end, so that a focal point at rest stays there."""
    square = squared(step)
    if part * part * square < SAME_PLACE:
        return ZERO
    if (ONE - part) * (ONE - part) * square < SAME_PLACE:
        return ONE
    return part


@wp.func
def samples_of(plan: SamplingPlan, seconds: wp.float64):
    """Samples of a cycle that takes so long at the nominal speeds [s]."""
    count = wp.int64(1)
    if plan.pace == FREQUENCY:
        count = plan.fixed
    elif plan.pace != STILL:
        count = wp.int64(wp.min(wp.ceil(seconds * plan.rate - SEAM), CYCLE_MOST))
        if plan.pace == CAPPED:
            count = wp.min(wp.max(count, plan.fewest), plan.most)
    return wp.max(wp.max(count, plan.points_least), wp.int64(1))
