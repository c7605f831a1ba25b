"""Where a live run's poses come from, and the hand that they move: by name, or given."""

from typing import Any

from ..hands.hand import Hand
from ..intersection.named_inputs import hand_of
from ..motions.explorations.explored import exploration
from ..objects.solid import Solid
from .sources.hand_frame import PoseSource
from .sources.replay import ReplaySource
from .sources.source_process import SourceSettings


def source_settings(
    source: str | PoseSource,
    *,
    hand: Hand | str,
    solid: Solid,
    side: str | None = None,
    alignment: Any = None,
    prediction: float = 0.0,
    smoothing: float = 0.0,
    realtime: bool = True,
) -> tuple[SourceSettings, Hand]:
    """Settings of the source's process, and the hand."""
    own = hand_of(hand)
    if source == "exploration":
        source = ReplaySource.of_motion(exploration(solid.bounds, duration=60.0, rate=90.0), loops=True)
    return SourceSettings(source, alignment=alignment, realtime=realtime), own
