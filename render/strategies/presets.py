"""Intersection strategies by name, beside oc and cc, with what each is for.

Martinez et al. 2019 compared ten such strategies; only the first, oc, is known in full, so none here has their letters.
"""

from collections.abc import Callable, Mapping
from functools import partial

from ..stages.registry import Stage
from .intersection_strategy import PRESETS, IntersectionStrategy

OUTLINES = {
    "oc": "open contours: the object's outline on the skin (Martinez et al. 2019, A)",
    "cc": "closed contours: the contact's outline, hand edges too (Mulot et al. 2024)",
}


def whole_outline() -> IntersectionStrategy:
    """The whole outline of the object in the hand's plane, on the skin or not."""
    return IntersectionStrategy()


def closed_then(*transform: Stage | str) -> IntersectionStrategy:
    """CC and what is made of it."""
    return IntersectionStrategy(prune=("outside",), transform=("close", *transform))


def of_closed(*transform: Stage | str) -> Callable[[], IntersectionStrategy]:
    """A preset: CC and what is made of it."""
    return partial(closed_then, *transform)


CLOSED: Mapping[str, tuple[str, Callable[[], IntersectionStrategy]]] = {
    "corners": ("closed contours, strong at corners (after Martinez et al. 2019)", of_closed("corners")),
    "corner-pauses": (
        "closed contours, the focal point pausing 20 ms at corners",
        of_closed(Stage("corners", {"level": 1.0, "dwell": 0.02})),
    ),
    "edges": ("closed contours, the object's edges strong, the hand's weak", of_closed("edges")),
    "simplified": ("closed contours without vertices that nobody feels", of_closed("simplify")),
    "smooth": ("closed contours with rounded corners", of_closed("smooth")),
    "inset": ("outline of the contact, half a focal width farther in", of_closed("inset")),
    "hatch": ("the contact filled with parallel lines", of_closed("hatch")),
    "inset-hatch": (
        "the contact, half a focal width farther in, filled with lines",
        of_closed("inset", "hatch"),
    ),
    "ellipse": ("an ellipse of the contact's area and direction", of_closed("ellipse")),
    "pca-ellipse": (
        "an ellipse of 1.5 standard deviations of each contact (after shinolab)",
        of_closed(Stage("ellipse", {"of": "moments", "scale": 0.75})),
    ),
    "circle": ("a circle of the contact's area", of_closed("circle")),
    "centroid": ("a point at the contact's centroid, circling by 3 mm", of_closed("centroid")),
    "depth": ("closed contours, the stronger the deeper the skin is in the object", of_closed("depth")),
    "depth-hatch": (
        "the contact filled with lines, each point as strong as it is deep",
        of_closed("hatch", Stage("depth", {"at": "point"})),
    ),
}
OTHERS: Mapping[str, tuple[str, Callable[[], IntersectionStrategy]]] = {
    "whole": ("the object's whole outline in the hand's plane, on the skin or not", whole_outline),
    "mammoth": (
        "a path over skin inside the object (after Maunsbach et al. 2024)",
        partial(IntersectionStrategy, raw="contact"),
    ),
}
PRESET_LINES: dict[str, str] = {**OUTLINES, **{name: line for name, (line, _) in {**OTHERS, **CLOSED}.items()}}
"""What each preset draws, in one line."""

PRESETS.update({name: make for name, (_, make) in {**OTHERS, **CLOSED}.items()})
