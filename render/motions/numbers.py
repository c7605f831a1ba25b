"""What sampling comes to over a motion: jumps by cause, revisits, silence, dwell; counted as `palpate play` does."""

from ..hands.hand import Hand, Palm
from ..sampling.metrics import DwellMap, SamplingCount

CELL = 1e-3  # of the dwell map [m]
OTHER_HAND = (0.2, 0.25)  # of the dwell map of a hand that is no rectangle, around the palm's middle [m]
CAUSES = {"jumps_polyline": "polyline", "jumps_order": "order", "jumps_pose": "pose", "jumps_reentry": "re-entry"}
NUMBERS = (
    *CAUSES,
    "jump_length",
    "jumps_per_second",
    "hops_per_second",
    "step_longest",
    "silent_share",
    "revisit_rate",
    "draw_frequency",
    "dwell_spread",
    "dwell_area",
)
"""Of a motion; docs/formats/sweep-files.md describes each."""


def dwell_grid(hand: Hand) -> dict[str, float]:
    """Size of the dwell map of a hand, and of its cells [m], as `dwell_map` takes them."""
    width, length = (hand.width, hand.length) if isinstance(hand, Palm) else OTHER_HAND
    return {"width": width, "length": length, "cell": min(CELL, width, length)}


def sampling_numbers(count: SamplingCount, dwell: DwellMap, update_rate: float) -> dict[str, float | int | None]:
    """`NUMBERS` of a motion, and its samples, from what was counted while it was sampled."""
    seconds = count.samples / update_rate
    return {
        **{name: count.jumps[cause] for name, cause in CAUSES.items()},
        "jump_length": count.jump_length,
        "jumps_per_second": sum(count.jumps.values()) / seconds,
        "hops_per_second": sum(count.hops.values()) / seconds,
        "step_longest": count.step_longest,
        "silent_share": count.silent / count.samples,
        "revisit_rate": count.revisit_rate,
        "draw_frequency": count.draw_frequency(update_rate),
        "dwell_spread": dwell.spread if dwell.area else None,
        "dwell_area": dwell.area,
        "samples": count.samples,
    }
