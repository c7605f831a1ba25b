"""Keyed crossings -> oriented polylines, by key alone: no coordinate is ever compared."""

import warp as wp

from .patch import EXACT
from .ragged import Polylines, empty_polylines, offsets_of
from .slice import Crossings
from .winged import OPEN

wp.set_module_options(EXACT)

NONE = wp.constant(-1)
LOOSE = wp.constant(1)  # marks the first point of a polyline in `begin`
CLOSED = wp.constant(2)


@wp.func
def place_of(key: wp.array[wp.int32], base: wp.int64, count: int, wanted: int):
    """Place of a key among a section's ascending keys, NONE if it is not there."""
    low = int(0)
    high = count
    while low < high:
        middle = (low + high) // 2
        if key[base + wp.int64(middle)] < wanted:
            low = middle + 1
        else:
            high = middle
    if low < count:
        if key[base + wp.int64(low)] == wanted:
            return low
    return NONE


@wp.kernel
def _link_crossings(
    # In:
    crossings: Crossings,
    # Out:
    after: wp.array[wp.int32],  # place of the next crossing within the section, NONE at an open end, shape [crossing]
    before: wp.array[wp.int32],  # place of the one before, NONE at an open start, shape [crossing], comes as NONE
):
    """Turn keys into places."""
    section = wp.tid()
    base = crossings.section_start[section]
    count = int(crossings.section_start[section + 1] - base)
    for i in range(count):
        j = int(NONE)
        wanted = crossings.next_key[base + wp.int64(i)]
        if wanted != OPEN:
            j = place_of(crossings.key, base, count, wanted)
        after[base + wp.int64(i)] = j
        if j != NONE:
            before[base + wp.int64(j)] = i


@wp.kernel
def _chain_crossings(
    # In:
    section_start: wp.array[wp.int64],
    after: wp.array[wp.int32],
    before: wp.array[wp.int32],
    # Out:
    order: wp.array[wp.int32],  # place of the crossing at each rank, shape [crossing]
    begin: wp.array[wp.int32],  # LOOSE or CLOSED at a polyline's first rank, comes as 0, shape [crossing]
    seen: wp.array[wp.uint8],  # scratch, comes as 0, shape [crossing]
    polyline_count: wp.array[wp.int64],  # shape [section + 1]
):
    """Walk each section's chains, the one with the smallest key first; a loop starts at its smallest key."""
    section = wp.tid()
    base = section_start[section]
    count = int(section_start[section + 1] - base)
    rank = int(0)
    polylines = int(0)
    for i in range(count):
        if seen[base + wp.int64(i)] == wp.uint8(0):
            first = int(i)
            back = before[base + wp.int64(i)]
            while back != NONE and back != i:
                first = back
                back = before[base + wp.int64(first)]
            if back == i:
                first = i
                begin[base + wp.int64(rank)] = CLOSED
            else:
                begin[base + wp.int64(rank)] = LOOSE
            j = int(first)
            while j != NONE:
                seen[base + wp.int64(j)] = wp.uint8(1)
                order[base + wp.int64(rank)] = j
                rank += 1
                j = after[base + wp.int64(j)]
                if j == first:
                    j = NONE
            polylines += 1
    polyline_count[section] = wp.int64(polylines)


@wp.kernel
def _gather_chains(
    # In:
    crossings: Crossings,
    order: wp.array[wp.int32],
    begin: wp.array[wp.int32],
    # Out:
    out: Polylines,
):
    """Write the points in the order of the walk."""
    section = wp.tid()
    base = crossings.section_start[section]
    count = int(crossings.section_start[section + 1] - base)
    polyline = out.section_start[section]
    for rank in range(count):
        i = base + wp.int64(rank)
        j = base + wp.int64(order[i])
        if begin[i] != 0:
            out.polyline_start[polyline] = i
            out.side[polyline] = wp.vec2i(NONE, NONE)
            if begin[i] == CLOSED:
                out.closed[polyline] = wp.uint8(1)
            polyline += wp.int64(1)
        out.point[i] = crossings.point[j]
        out.key[i] = crossings.key[j]
    if section == crossings.section_start.shape[0] - 2:
        out.polyline_start[polyline] = base + wp.int64(count)


def chain_crossings(crossings: Crossings) -> Polylines:
    """Join crossings into polylines; those of a watertight mesh are all closed."""
    section_count = crossings.section_start.shape[0] - 1
    total = crossings.key.shape[0]
    device = crossings.key.device
    after = wp.empty(total, dtype=wp.int32, device=device)
    before = wp.full(total, -1, dtype=wp.int32, device=device)
    wp.launch(_link_crossings, section_count, inputs=[crossings], outputs=[after, before], device=device)
    order = wp.empty(total, dtype=wp.int32, device=device)
    begin = wp.zeros(total, dtype=wp.int32, device=device)
    seen = wp.zeros(total, dtype=wp.uint8, device=device)
    count = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    wp.launch(
        _chain_crossings,
        section_count,
        inputs=[crossings.section_start, after, before],
        outputs=[order, begin, seen, count],
        device=device,
    )
    section_start, polyline_count = offsets_of(count)
    out = empty_polylines(section_start, polyline_count, total)
    wp.launch(_gather_chains, section_count, inputs=[crossings, order, begin], outputs=[out], device=device)
    return out
