"""Which transformations can follow which: what makes no sense is refused before anything is rendered.

| stage | needs | refused behind |
|---|---|---|
| hatch, inset | contours that enclose something | "outside" without "close"; "hatch"; raw "contact" |
| ellipse, circle, centroid | | stages of intensity and dwell, whose work they would throw away (hatch, inset too) |
| edges | object's and hand's edges apart | ellipse, circle, centroid, hatch, inset; raw "contact" |

A stage of a user's own may do anything: nothing is refused on account of what stands before it.
"""

from collections.abc import Sequence

from ..errors import StrategyError

SHAPES = ("ellipse", "circle", "centroid")  # draw loops anew
FILLS = ("hatch", "inset")  # need loops
WEIGHTS = ("corners", "edges", "depth")  # set intensity or dwell
NEUTRAL = ("close", "identity", "resample", "simplify", "smooth")
TOURS = ("contact",)  # raw stages that give a path over a surface


def require_order(raw: str, prune: Sequence[str], transform: Sequence[str]) -> None:
    """Raise StrategyError, naming both stages, for an order of transformations that makes no sense."""
    encloses = raw == "section" and ("outside" not in prune or "close" in transform)
    has_kinds = raw not in TOURS
    why = f'raw "{raw}"' if raw in TOURS else '"outside" without "close"'
    weighted = ""
    for name in transform:
        if name in FILLS and not encloses:
            raise StrategyError(f'transform: "{name}" fills what closed contours enclose, and {why} leaves none')
        if name in SHAPES + FILLS and weighted:
            raise StrategyError(
                f'transform: "{name}" draws new contours and would throw away what "{weighted}" did: put it before'
            )
        if name == "edges" and not has_kinds:
            raise StrategyError(f'transform: "edges" tells edges of object and hand apart, and {why} leaves none')
        if name in SHAPES + FILLS:
            encloses, has_kinds, why = name != "hatch", False, f'"{name}"'
        elif name in WEIGHTS:
            weighted = name
        elif name not in NEUTRAL:  # a user's
            encloses, has_kinds, weighted = True, True, ""
