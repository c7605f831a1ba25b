"""A loop's sides as bits of words: all segments are clipped at once, as `segment_of` clips one."""

import warp as wp

from ..patch import BOTTOM, LEFT, RIGHT, TOP

UNIT = wp.constant(wp.uint32(1))


@wp.struct
class SideWords:
    """Crossings and segments of a loop, as clipping needs them. Segment k runs from crossing k to the next one."""

    bottom: wp.uint32  # bit k: crossing k lies on or beyond that side (`outcode`)
    right: wp.uint32
    top: wp.uint32
    left: wp.uint32
    corner0: wp.uint32  # bit k: that corner lies to the left of segment k, or on it, if `needs_left`
    corner1: wp.uint32
    corner2: wp.uint32
    corner3: wp.uint32
    unclear: wp.uint32  # bit k: where segment k enters or leaves may be, in float32, a crossing or a corner


@wp.struct
class ClippedSegments:
    """Segments that enter and leave, and their sides; bit k stands for segment k."""

    enters: wp.uint32
    enter_low: wp.uint32  # the lower bit of the side's number
    enter_high: wp.uint32
    leaves: wp.uint32
    leave_low: wp.uint32
    leave_high: wp.uint32
    ahead: wp.uint32  # those that wind around corner 0: by +1, and
    back: wp.uint32  # by -1


@wp.func
def unit_of(k: int):
    """The word in which only bit k is set."""
    return UNIT << wp.uint32(k)


@wp.func
def word_if(condition: bool, word: wp.uint32):
    """The word, or 0."""
    return wp.where(condition, word, wp.uint32(0))


@wp.func
def mark_crossing(words: SideWords, bit: wp.uint32, code: int):
    """Set a crossing's bit in the words of the sides that it lies on or beyond."""
    out = words
    out.bottom = words.bottom | word_if((code & BOTTOM) != 0, bit)
    out.right = words.right | word_if((code & RIGHT) != 0, bit)
    out.top = words.top | word_if((code & TOP) != 0, bit)
    out.left = words.left | word_if((code & LEFT) != 0, bit)
    return out


@wp.func
def mark_corners(words: SideWords, bit: wp.uint32, left: int):
    """Set a segment's bit in the words of the corners to its left."""
    out = words
    out.corner0 = words.corner0 | word_if((left & 1) != 0, bit)
    out.corner1 = words.corner1 | word_if((left & 2) != 0, bit)
    out.corner2 = words.corner2 | word_if((left & 4) != 0, bit)
    out.corner3 = words.corner3 | word_if((left & 8) != 0, bit)
    return out


@wp.func
def word_of_next(word: wp.uint32, first: int, last: int):
    """Bit k of a loop's word becomes that of the next crossing; the loop's crossings are first..last."""
    return (word >> UNIT) | (((word >> wp.uint32(first)) & UNIT) << wp.uint32(last))


@wp.func
def crossed_word(
    p: wp.uint32,
    q: wp.uint32,
    p_after: wp.uint32,
    apart_after: wp.uint32,
    p_before: wp.uint32,
    apart_before: wp.uint32,
    end: wp.uint32,
    start: wp.uint32,
):
    """The segments that cross a side, as `crossed_sides`; p, q: words of their ends, then of the sides beside it.

    end, start: words of the corners in which the side ends and starts.
    """
    apart = p ^ q
    ends = (apart_after & ~(end ^ q)) | ~(apart_after | p_after)
    starts = (apart_before & (start ^ q)) | ~(apart_before | p_before)
    return apart & ends & starts


@wp.func
def clip_segments(w: SideWords, first: int, last: int):
    """Clip the segments first..last, which are a loop."""
    bottom = word_of_next(w.bottom, first, last)
    right = word_of_next(w.right, first, last)
    top = word_of_next(w.top, first, last)
    left = word_of_next(w.left, first, last)
    b = bottom ^ w.bottom
    r = right ^ w.right
    t = top ^ w.top
    l = left ^ w.left
    own = (wp.uint32(2) << wp.uint32(last)) - (UNIT << wp.uint32(first))
    meets = own & ~((w.bottom & bottom) | (w.right & right) | (w.top & top) | (w.left & left))
    side0 = crossed_word(w.bottom, bottom, w.right, r, w.left, l, w.corner1, w.corner0) & meets
    side1 = crossed_word(w.right, right, w.top, t, w.bottom, b, w.corner2, w.corner1) & meets
    side2 = crossed_word(w.top, top, w.left, l, w.right, r, w.corner3, w.corner2) & meets
    side3 = crossed_word(w.left, left, w.bottom, b, w.top, t, w.corner0, w.corner3) & meets
    out = ClippedSegments()
    out.leave_low = (side1 & right) | (side3 & left)
    out.leave_high = (side2 & top) | (side3 & left)
    out.leaves = (side0 & bottom) | out.leave_low | out.leave_high
    out.enter_low = (side1 & w.right) | (side3 & w.left)
    out.enter_high = (side2 & w.top) | (side3 & w.left)
    out.enters = (side0 & w.bottom) | out.enter_low | out.enter_high
    turns = own & b & ((l & ~(w.corner0 ^ bottom)) | (w.left & ~l))  # as `winding_step`
    out.ahead = turns & bottom
    out.back = turns & w.bottom
    return out


@wp.func
def side_at(low: wp.uint32, high: wp.uint32, k: int):
    """Side of segment k from the words of its two bits."""
    return int(((low >> wp.uint32(k)) & UNIT) | (((high >> wp.uint32(k)) & UNIT) << UNIT))


@wp.func
def segments_at(present: wp.uint32, low: wp.uint32, high: wp.uint32, side: int):
    """The segments whose side is this one."""
    return present & wp.where((side & 1) != 0, low, ~low) & wp.where((side & 2) != 0, high, ~high)
