"""What the marks of a picture of contours mean: an entry for each mark that is in it."""

from collections.abc import Sequence
from typing import Any

from ...datasets.storage.schema import KIND_NAMES
from ...device.array import ArrayModel
from ..contour_batch import ContourBatch
from ..hands.hand import Palm
from ..hands.mesh_hand import MeshHand
from .array_overview import DISC
from .contour_lines import WIDTH, varies
from .picture_page import Entry
from .picture_style import COLOURS, DASHES, FAINT, HAND_DASHES, INK, LINES, paler
from .scene_drawing import HAND_EDGE, HAND_FILL, SceneSource

TEXTS = {"object": "object's contour", "hand": "hand's boundary inside it", "made": "made by a stage"}
SCALE = (0.0, 0.25, 0.5, 0.75, 1.0)  # intensities that the legend shows


def legend_entries(
    sources: Sequence[SceneSource],
    batches: Sequence[ContourBatch],
    models: Sequence[ArrayModel] = (),
    shown: Sequence[ArrayModel] = (),
    *,
    overview: bool = False,
) -> list[Entry]:
    """The marks that scenes of these batches have, and their meanings.

    models: arrays that were asked for; shown: those that are near enough to be drawn. overview: whether there is one.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {int(k) for batch in batches for k in batch.kind.tolist()}
    named = {name: TEXTS[name] for k, name in enumerate(KIND_NAMES) if k in kinds}
    look = {name: {"color": COLOURS[name], "lw": WIDTH, "solid_capstyle": "butt"} for name in named}
    dashes = {"hand": (0, HAND_DASHES)}
    entries: list[Entry] = [
        (Line2D([], [], ls=dashes.get(name, "-"), dash_capstyle="round", **look[name]), text)
        for name, text in named.items()
    ]
    if any(varies(batch) for batch in batches):
        colour = COLOURS["made" if 2 in kinds else "object"]
        bar = [Line2D([], [], color=paler(colour, s), lw=2 * WIDTH, solid_capstyle="butt") for s in SCALE]
        entries.append((tuple(bar), "intensity 0 to 1: paler is weaker"))
    if any(batch.dwell is not None and (batch.dwell > 0).any() for batch in batches):
        entries.append((Line2D([], [], color=INK, marker="o", ls="", ms=4.5, mec="white"), "pause"))
    hands = [source.hand for source in sources]
    if any(not isinstance(hand, MeshHand) for hand in hands):
        entries.append(
            (Patch(fc=(*to_rgb(COLOURS["palm"]), 0.35), ec=COLOURS["palm"], lw=0.8), "skin that was rendered")
        )
    if any(isinstance(hand, Palm | MeshHand) for hand in hands):
        rendered = all(isinstance(hand, MeshHand) for hand in hands)
        text = "hand that was rendered" if rendered else "a hand, to show the pose"
        entries.append((Patch(fc=(*to_rgb(HAND_FILL), 0.5), ec=HAND_EDGE, lw=0.7), text))
    entries.append((Patch(fc="#c3cad4", ec="none"), "object"))
    for model in models:
        there = any(model is other for other in shown)
        text = f"{model.name}, {len(model.position)} transducers" if there else f"{model.name}: too far away to show"
        entries.append((Line2D([], [], marker="o", ls="", ms=4, mfc=DISC, mec="none"), text))
    if overview:
        moves = len(sources[0].pose) > 1
        text = "way of the palm, moments" if moves else "palm at the moment"
        way = {"color": FAINT, "lw": 0.5, "ls": "-" if moves else ""}
        entries.append((Line2D([], [], marker="o", ms=6, mfc="white", mec=INK, mew=0.7, **way), text))
    return entries


def line_look(k: int) -> dict[str, Any]:
    """Colour and dashes of file k's line over time."""
    return {"color": LINES[k % len(LINES)], "ls": DASHES[(k // len(LINES) + k) % len(DASHES)]}


def line_entries(labels: Sequence[str]) -> list[Entry]:
    """Whose the lines over time are; nothing for one file, whose name stands above."""
    from matplotlib.lines import Line2D

    return (
        [(Line2D([], [], lw=0.9, **line_look(k)), label) for k, label in enumerate(labels)] if len(labels) > 1 else []
    )
