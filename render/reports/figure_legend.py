"""What the marks of a picture of contours mean: a handle for each mark that is in it."""

from collections.abc import Sequence
from typing import Any

from ...datasets.storage.schema import KIND_NAMES
from ...device.array import ArrayModel
from ..contour_batch import ContourBatch
from ..hands.hand import Palm
from ..hands.mesh_hand import MeshHand
from .array_overview import DISC
from .contour_lines import WIDTH, varies
from .picture_style import COLOURS, FAINT, INK
from .scene_drawing import HAND_EDGE, HAND_FILL, SceneSource

TEXTS = {"object": "object's contour", "hand": "hand's boundary inside it", "made": "made by a stage"}


def legend_handles(
    sources: Sequence[SceneSource],
    batches: Sequence[ContourBatch],
    models: Sequence[ArrayModel],
    shown: Sequence[ArrayModel],
) -> list[Any]:
    """Handles of the marks that scenes have.

    models: arrays that were asked for; shown: those that are near enough to be drawn.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {int(k) for batch in batches for k in batch.kind.tolist()}
    handles: list[Any] = [
        Line2D([], [], color=COLOURS[name], lw=WIDTH, label=TEXTS[name])
        for k, name in enumerate(KIND_NAMES)
        if k in kinds
    ]
    if any(varies(batch) for batch in batches):
        handles.append(Line2D([], [], color=COLOURS["made" if 2 in kinds else "object"], lw=0.7, alpha=0.5,
                              label="thin and pale: weak"))  # fmt: skip
    if any(batch.dwell is not None and (batch.dwell > 0).any() for batch in batches):
        handles.append(Line2D([], [], color=INK, marker="o", ls="", ms=4.5, mec="white", label="pause"))
    hands = [source.hand for source in sources]
    if any(not isinstance(hand, MeshHand) for hand in hands):
        handles.append(
            Patch(fc=(*_rgb(COLOURS["palm"]), 0.35), ec=COLOURS["palm"], lw=0.8, label="skin that was rendered")
        )
    if any(isinstance(hand, Palm | MeshHand) for hand in hands):
        rendered = all(isinstance(hand, MeshHand) for hand in hands)
        handles.append(Patch(fc=(*_rgb(HAND_FILL), 0.5), ec=HAND_EDGE, lw=0.7,
                             label="hand that was rendered" if rendered else "a hand, to show the pose"))  # fmt: skip
    handles.append(Patch(fc="#c3cad4", ec="none", label="object"))
    for model in models:
        there = any(model is other for other in shown)
        text = f"{model.name}, {len(model.position)} transducers" if there else f"{model.name}: too far away to show"
        handles.append(Line2D([], [], marker="o", ls="", ms=4, mfc=DISC, mec="none", label=text))
    if len(sources[0].pose) > 1:
        look, text = {"lw": 0.5, "ls": "-"}, "way of the palm; moments shown"
    else:
        look, text = {"ls": ""}, "palm at the moment shown"
    handles.append(Line2D([], [], color=FAINT, marker="o", ms=6, mfc="white", mec=INK, mew=0.7, label=text, **look))
    return handles


def _rgb(colour: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(colour)
