"""Places on a track: knots of samples, the points and intensities there, and what a fade leaves of these.

As `Cursor` and `Track.at` of the host's sampler.
"""

import warp as wp

from .layout import ONE, STILL, ZERO, DrawnPiece, PoseTrack, SamplingPlan, TrackNodes

BLOCK_SAMPLES = wp.constant(wp.int64(1024))  # a pose that lasts longer is drawn in blocks, whose ages begin anew
TURN_SLACK = wp.constant(wp.float64(1e-9))  # of a turn


@wp.struct
class PoseSchedule:
    """When poses are drawn."""

    motion_start: wp.array[wp.int64]  # offsets into poses, shape [motion + 1]
    first: wp.array[wp.int64]  # first sample of a pose, counted from time 0 of its motion
    number: wp.array[wp.int64]  # the same, counted from the first one drawn
    count: wp.array[wp.int64]  # of samples
    row: wp.array[wp.int64]  # of a pose's first sample among those of all motions, shape [pose]
    time: wp.array[wp.float64]  # of poses [s]
    hold: wp.array[wp.float64]  # age at which a pose starts to fade [s], shape [motion]
    shown: wp.array[wp.int64]  # place in a cycle of the points in the order in which they are shown


@wp.struct
class PoseEntry:
    """Where a pose's drawing begins."""

    drawn: wp.int32  # 1: the pose has contours and samples
    silent: wp.int32  # 1: the sample before is
    before: wp.int64  # the pose drawn before, -1: none
    found: wp.int32  # 1: drawing goes on from where it was; 0: from the start of the contours
    anchor: wp.float64  # knot that the samples are counted from
    index: wp.int64  # of the first sample


@wp.struct
class DrawnTracks:
    """Tracks of all poses, and where drawing begins on each."""

    nodes: TrackNodes
    tracks: wp.array[PoseTrack]
    entries: wp.array[PoseEntry]
    pose: wp.array[wp.transformd]  # hand frame -> array frame
    routes: wp.array[DrawnPiece]  # pieces as they are drawn; those of a pose from the row of its first polyline on
    line: wp.array[wp.int64]  # first polyline of each pose, shape [pose + 1]


@wp.func
def way_at(knots: wp.array[wp.float64], first: wp.int64, count: int, knot: wp.float64):
    """Number of the last node that is reached by a knot."""
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if knots[first + wp.int64(middle)] <= knot:
            low = middle
        else:
            high = middle
    return low


@wp.func
def way_from(knots: wp.array[wp.float64], first: wp.int64, count: int, knot: wp.float64, guess: int):
    """`way_at`, faster where it is the guess or the one behind it."""
    at = first + wp.int64(guess)
    if knots[at] <= knot:
        if guess + 1 >= count:
            return guess
        if knot < knots[at + wp.int64(1)]:
            return guess
        if guess + 2 < count:
            if knots[at + wp.int64(1)] <= knot and knot < knots[at + wp.int64(2)]:
                return guess + 1
    return way_at(knots, first, count, knot)


@wp.func
def point_on(nodes: TrackNodes, track: PoseTrack, way: int, knot: wp.float64):
    """Point of a track at a knot on a way [m], with the rounding of np.interp."""
    at = track.first + wp.int64(way)
    a = nodes.point[at]
    begin = nodes.knot[at]
    if way >= track.count - 1 or begin == knot:
        return a
    step = nodes.point[at + wp.int64(1)] - a
    return (step / (nodes.knot[at + wp.int64(1)] - begin)) * (knot - begin) + a


@wp.func
def level_on(nodes: TrackNodes, track: PoseTrack, way: int, knot: wp.float64):
    """Intensity of a track at a knot on a way."""
    if nodes.intensity.shape[0] == 0:
        return ONE
    at = track.first + wp.int64(way)
    a = nodes.intensity[at]
    begin = nodes.knot[at]
    if way >= track.count - 1 or begin == knot:
        return a
    step = nodes.intensity[at + wp.int64(1)] - a
    return step / (nodes.knot[at + wp.int64(1)] - begin) * (knot - begin) + a


@wp.func
def track_point(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """Point of a track at a knot [m]."""
    return point_on(nodes, track, way_at(nodes.knot, track.first, track.count, knot), knot)


@wp.func
def cycle_knot(plan: SamplingPlan, track: PoseTrack, anchor: wp.float64, index: wp.int64):
    """Knot of a sample, before points are held or reordered."""
    one_sample = track.one_sample
    if plan.pace == STILL:
        one_sample = ZERO
    knot = anchor + one_sample * wp.float64(index % track.repeat)
    if track.turns > 1:
        return wp.mod(knot, track.period)
    if knot >= track.period:
        knot -= track.period
    return knot


@wp.func
def focus_knot(plan: SamplingPlan, track: PoseTrack, knot: wp.float64, focus: int):
    """Knot of one of the focal points, which are spaced evenly from the first one on."""
    if plan.foci == 1:
        return knot
    return wp.mod(knot + track.period * wp.float64(focus) / wp.float64(plan.foci), track.period)


@wp.func
def shown_knot(plan: SamplingPlan, shown: wp.array[wp.int64], track: PoseTrack, knot: wp.float64):
    """Knot that is shown in place of one: that of the point which is held."""
    if plan.points == wp.int64(0):
        return knot
    share = wp.float64(plan.points) / track.period
    turn = wp.int64(wp.floor(knot * share + TURN_SLACK)) % plan.points
    return wp.float64(shown[turn]) / share


@wp.func
def age_of(plan: SamplingPlan, schedule: PoseSchedule, pose: int, sample: wp.int64):
    """Age of a pose at one of its samples, and whether its block of samples ends after `hold` [s]."""
    begin = sample / BLOCK_SAMPLES * BLOCK_SAMPLES
    count = wp.min(schedule.count[pose] - begin, BLOCK_SAMPLES)
    age = wp.float64(schedule.first[pose] + begin) / plan.rate - schedule.time[pose]
    return age + wp.float64(sample - begin) / plan.rate, age + wp.float64(count) / plan.rate


@wp.func
def gain_of(plan: SamplingPlan, age: wp.float64, block_end: wp.float64, hold: wp.float64):
    """What a fade leaves of the intensity."""
    if block_end <= hold:
        return ONE
    return wp.min(wp.max(ONE - (age - hold) / plan.fade, ZERO), ONE)
