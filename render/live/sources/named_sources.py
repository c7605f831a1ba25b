"""Sources of live poses by the texts of the command line, and the hands that they move.

| text | source |
|---|---|
| exploration | a synthetic exploration of the object, in real time |
| a file | a motion of poses, or a recording of joints, in real time |
| udp, udp:PORT, udp:HOST:PORT | datagrams (docs/formats/live-poses.md) |
| ultraleap, ultraleap:ws://HOST:PORT/v6.json | an Ultraleap tracker |
| MODULE:NAME | what `NAME()` of a module gives: a `PoseSource` |
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ....datasets.hand_model.shape import hand_shape
from ....datasets.known_names import find_name, likely_name
from ....datasets.recordings.alignment import Alignment
from ....datasets.recordings.files import load_recording
from ....datasets.recordings.recording import HandRecording
from ...errors import StrategyError
from ...hands.hand import Hand
from ...hands.plane_hand import PlaneHand
from ...intersection.named_inputs import (
    EXPLORATION,
    is_exploration,
    is_recording,
    load_hand,
    load_motion,
    refuse_options,
)
from ...objects.solid import Solid
from ...trust.permission import UNNAMED, AllowCode
from ...trust.user_code import find_installed, run_all
from .hand_frame import PoseSource
from .hand_poses import PatchLayout
from .pose_stream import ANY
from .replay import ReplaySource
from .source_process import SourceSettings
from .udp import UdpSource
from .ultraleap import UltraleapSource

if TYPE_CHECKING:
    from .shaping import PoseShaping

UDP, ULTRALEAP = "udp", "ultraleap"
_KINDS = {UDP: UdpSource.at, ULTRALEAP: UltraleapSource.at}
_MODULE = re.compile(r"(?P<module>[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")


class ChosenSource(NamedTuple):
    """A source by its text."""

    source: PoseSource
    is_aligned: bool
    """Whether its poses are in the array's frame already."""
    recording: HandRecording | None = None
    """The recording that it plays, whose hand has sizes of its own."""


def source_of(
    text: str, solid: Solid, *, side: str = ANY, alignment: Alignment | None = None, allow_code: AllowCode = False
) -> ChosenSource:
    """The source that a text names, by the table above; a text that does not name one raises StrategyError.

    side, alignment: of recordings and trackers. allow_code: whether a module that is named may run. What has an end
    begins again after it.
    """
    word, _, rest = text.partition(":")
    kind = find_name(word, tuple(_KINDS))
    if kind is not None and not Path(text).exists():
        return ChosenSource(_KINDS[kind](rest), is_aligned=False)
    if not is_exploration(text) and is_recording(text):
        recording = load_recording(text, hand=None if side == ANY else side, alignment=alignment)
        return ChosenSource(ReplaySource.of_recording(recording, loops=True), True, recording)
    named = _MODULE.fullmatch(text)
    if named and not Path(text).exists():
        return ChosenSource(_made_by(named["module"], named["name"], allow_code), is_aligned=False)
    if not is_exploration(text) and not Path(text).suffix:
        meant = likely_name(word, (EXPLORATION, *_KINDS))
        raise StrategyError(
            f"{text}: is no source of poses{meant}: give {EXPLORATION}, a motion or a recording, {UDP}, "
            f"{UDP}:HOST:PORT, {ULTRALEAP}, or MODULE:NAME of a source of your own"
        )
    refuse_options({"alignment": alignment, "side": None if side == ANY else side}, "of a tracker", text)
    return ChosenSource(ReplaySource.of_motion(load_motion(text, solid, {}), loops=True), is_aligned=True)


def settings_and_hand(
    source: PoseSource | str,
    hand: Hand | str,
    solid: Solid,
    *,
    side: str = ANY,
    alignment: Alignment | None = None,
    shaper: "PoseShaping | None" = None,
    realtime: bool = False,
    allow_code: AllowCode = False,
) -> tuple[SourceSettings, Hand]:
    """What `start_source` takes, and the hand to draw on, of what a user gives.

    source: a text of `source_of`, or a source. hand: as `live_hand` takes it. Other arguments: as `source_of` and
    `SourceSettings` have them.
    """
    if isinstance(source, str):
        chosen = source_of(source, solid, side=side, alignment=alignment, allow_code=allow_code)
    else:
        chosen = ChosenSource(source, is_aligned=False)
    own = live_hand(hand, is_left=side == "left", recording=chosen.recording)
    if chosen.is_aligned:
        side, alignment = ANY, None  # chosen and aligned when it was loaded
    return SourceSettings(chosen.source, alignment, side, patch_layout(own), shaper, realtime), own


def live_hand(hand: Hand | str, *, is_left: bool = False, recording: HandRecording | None = None) -> Hand:
    """A hand for live poses.

    hand: as `load_hand` takes it, or a hand. is_left: of planes. recording: gives planes the sizes of its hand.
    Raises StrategyError for a skin mesh that is articulated: it has a shape for each pose of a recording.

    >>> from palpate.render.live.sources.named_sources import live_hand
    >>> live_hand("planes")
    PlaneHand(15 patches, 13 joints, articulated for 1 pose)
    """
    if not isinstance(hand, str):
        if hand.pose_count is not None and not isinstance(hand, PlaneHand):
            raise StrategyError(f"{hand!r} has a shape for each pose of its motion; a live one is rigid, or of planes")
        return hand
    if find_name(hand, ("planes",)) is None or recording is not None:
        return load_hand(hand, None, None if recording is None else recording.held())
    shape = hand_shape(is_left=is_left)
    return PlaneHand.from_joints(shape.joint_pose[None], shape.joint_radius, is_left=is_left)


def patch_layout(hand: Hand) -> PatchLayout | None:
    """The patches of an articulated hand; None for a rigid one. Raises StrategyError for a patch that no bone moves."""
    if not isinstance(hand, PlaneHand) or hand.patch_pose is None:
        return None
    there = ~hand.absent  # a patch that is missing in the first pose may be there in a later one
    rest = hand.patch_pose[np.argmax(there, axis=0), np.arange(hand.patch_count)]
    return PatchLayout.of(tuple(patch.name for patch in hand.patches), rest)


def _made_by(module: str, name: str, allow_code: AllowCode) -> PoseSource:
    """What a factory of a module makes."""
    try:
        (found,) = run_all([find_installed(module, UNNAMED)], allow_code)
    except (ImportError, OSError) as error:
        raise StrategyError(f"{module}:{name}: the module cannot be imported: {error}") from error
    factory = getattr(found, name, None)
    if not callable(factory):
        raise StrategyError(f"{module}:{name}: {module} has no function or class {name}")
    source = factory()
    if not isinstance(source, PoseSource):
        raise StrategyError(
            f"{module}:{name}() gave {source!r:.60}, which is no PoseSource: docs/formats/live-poses.md describes these"
        )
    return source
