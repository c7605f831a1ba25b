"""Places on a track: knots of samples, the points and intensities there, and what a fade leaves of these."""

import warp as wp

from .layout import ONE, STILL, TICKS, ZERO, DrawnSection, PoseSchedule, PoseTrack, SamplingPlan, TrackNodes

TURN_SLACK = wp.constant(wp.float64(1e-9))  # of a turn


@wp.struct
class TrackWay:
    """A way of a track from a node to the next."""

    a: wp.int32  # node
    b: wp.int32  # the next one
    begin: wp.float64  # knot at the first node
    end: wp.float64  # knot at the next one
    section: wp.int32  # number of the section that it is in
    number: wp.int32  # of the way in the section, else in the track


@wp.func
def plain_way(nodes: TrackNodes, track: PoseTrack, number: int):
    """A way by its number, of a track without sections."""
    way = TrackWay()
    way.a = track.first + number
    way.b = way.a + 1
    way.begin = nodes.knot[way.a]
    way.end = nodes.knot[way.b]
    way.number = number
    return way


@wp.func
def way_at(knots: wp.array[wp.float64], first: int, count: int, knot: wp.float64):
    """Number of the last node that is reached by a knot."""
    low = int(0)
    high = count
    while high - low > 1:
        middle = (low + high) // 2
        if knots[first + middle] <= knot:
            low = middle
        else:
            high = middle
    return low


@wp.func
def section_way(nodes: TrackNodes, track: PoseTrack, section: int, number: int, begin: wp.float64):
    """A way of a section by its number, from its knot on; the one behind the last leads to the next section."""
    own = nodes.section[track.section + section]
    ways = own.stop - own.start
    turn = number % (2 * ways)
    i = wp.min(turn, 2 * ways - turn)
    j = wp.where(turn < ways, i + 1, i - 1)
    way = TrackWay()
    way.a = track.first + own.start + i
    way.b = track.first + own.start + j
    way.begin = begin
    way.end = begin
    way.section = section
    way.number = number
    if number == ways * own.passes:
        way.b = track.first + nodes.section[track.section + section + 1].start
    else:
        way.end += section_duration(nodes, track, own.scale, wp.max(way.a, way.b))
    return way


@wp.func
def section_duration(nodes: TrackNodes, track: PoseTrack, scale: wp.float64, at: int):
    """Knots that the way to a node, or back from there, takes in a section."""
    duration = nodes.knot[at] * scale
    piece = way_piece(nodes, at - 1, at)
    if track.pieces > 1 and piece >= 0:
        duration = duration * nodes.stretch[track.line + piece]
    return duration


@wp.func
def way_piece(nodes: TrackNodes, a: int, b: int):
    """Number of the piece that the way from a node to another is on, -1: on none."""
    piece = int(nodes.piece[a])
    if piece != int(nodes.piece[b]):
        piece = int(-1)
    return piece


@wp.func
def ways_of(section: DrawnSection):
    """Number of ways of a section, all passes together."""
    return (section.stop - section.start) * section.passes


@wp.func
def has_next(nodes: TrackNodes, track: PoseTrack, way: TrackWay):
    """Whether a way is not the last one of a track."""
    if track.sections == 0:
        return way.number + 2 < track.count
    if way.section + 1 < track.sections:
        return True
    return way.number + 1 < ways_of(nodes.section[track.section + way.section])


@wp.func
def next_way(nodes: TrackNodes, track: PoseTrack, way: TrackWay):
    """The way behind one that is not the last."""
    if track.sections == 0:
        return plain_way(nodes, track, way.number + 1)
    if way.number < ways_of(nodes.section[track.section + way.section]):
        return section_way(nodes, track, way.section, way.number + 1, way.end)
    return section_way(nodes, track, way.section + 1, 0, way.end)


@wp.func
def section_at(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """Number of the section of a track that is drawn at a knot."""
    low = int(0)
    high = int(track.sections)
    while high - low > 1:
        middle = (low + high) // 2
        if nodes.section[track.section + middle].begin <= knot:
            low = middle
        else:
            high = middle
    return low


@wp.func
def section_end(nodes: TrackNodes, track: PoseTrack, section: int):
    """Knot at which a section ends."""
    if section + 1 < track.sections:
        return nodes.section[track.section + section + 1].begin
    return track.period


@wp.func
def is_on(way: TrackWay, knot: wp.float64):
    """Whether a knot lies on a way."""
    return way.begin <= knot and knot < way.end


@wp.func
def find_way(nodes: TrackNodes, track: PoseTrack, knot: wp.float64, guess: TrackWay):
    """The way on which a knot lies; found faster if it is one soon behind a guess. No guess: `TrackWay()`."""
    way = guess
    known = guess.a != guess.b and guess.begin <= knot
    if track.sections == 0:
        if known and knot >= guess.end and has_next(nodes, track, guess):
            way = plain_way(nodes, track, guess.number + 1)
        if not known or knot >= way.end:
            number = way_at(nodes.knot, track.first, track.count, knot)
            way = plain_way(nodes, track, wp.min(number, track.count - 2))
        return way
    section = section_at(nodes, track, knot)
    if not known or section != guess.section:
        own = nodes.section[track.section + section]
        way = section_way(nodes, track, section, 0, own.begin)
    while knot >= way.end and has_next(nodes, track, way):
        way = next_way(nodes, track, way)
    return way


@wp.func
def step_of(nodes: TrackNodes, way: TrackWay):
    """From a way's node to the next [m]."""
    return nodes.point[way.b] - nodes.point[way.a]


@wp.func
def point_on(nodes: TrackNodes, way: TrackWay, knot: wp.float64):
    """Point of a track at a knot on a way [m]."""
    if knot >= way.end:
        return nodes.point[way.b]
    a = nodes.point[way.a]
    if way.begin == knot:
        return a
    return ((nodes.point[way.b] - a) / (way.end - way.begin)) * (knot - way.begin) + a


@wp.func
def level_on(nodes: TrackNodes, way: TrackWay, knot: wp.float64):
    """Intensity of a track at a knot on a way."""
    if nodes.intensity.shape[0] == 0:
        return ONE
    if knot >= way.end:
        return nodes.intensity[way.b]
    a = nodes.intensity[way.a]
    if way.begin == knot:
        return a
    return (nodes.intensity[way.b] - a) / (way.end - way.begin) * (knot - way.begin) + a


@wp.func
def track_point(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """Point of a track at a knot [m]."""
    return point_on(nodes, find_way(nodes, track, knot, TrackWay()), knot)


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
def shown_knot(plan: SamplingPlan, shown: wp.array[wp.int32], track: PoseTrack, knot: wp.float64):
    """Knot that is shown in place of one: that of the point which is held."""
    if plan.points == 0:
        return knot
    share = wp.float64(plan.points) / track.period
    turn = int(wp.floor(knot * share + TURN_SLACK)) % plan.points
    return wp.float64(shown[turn]) / share


@wp.func
def age_of(schedule: PoseSchedule, pose: int, sample: int):
    """Age of a pose at one of its samples [ticks]."""
    return wp.float64(schedule.first[pose] + wp.int64(sample)) * TICKS - schedule.time[pose]


@wp.func
def gain_of(plan: SamplingPlan, age: wp.float64, hold: wp.float64):
    """What a fade leaves of the intensity; age, hold: [ticks]."""
    if age <= hold:
        return ONE
    return wp.min(wp.max(ONE - (age - hold) / plan.fade, ZERO), ONE)
