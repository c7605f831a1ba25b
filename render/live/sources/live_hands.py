"""Hands that move now: by name, or any hand whose shape does not change but for its patches' poses."""

import numpy as np

from ....datasets.hand_model.shape import hand_shape
from ....datasets.known_names import find_name
from ....datasets.recordings.recording import HandRecording
from ...errors import StrategyError
from ...hands.hand import Hand
from ...hands.plane_hand import PlaneHand
from ...intersection.named_inputs import load_hand
from .hand_poses import PatchLayout

LIVE_HANDS = ("palm", "planes", "mesh")
"""Names of hands: a rectangle; palm and phalanges, each moved by its joints; palpate's own skin, flat and rigid."""


def live_hand(
    hand: Hand | str,
    *,
    palm: tuple[float, float] | None = None,
    side: str = "right",
    recording: HandRecording | None = None,
) -> Hand:
    """A hand for live poses.

    hand: palm, planes, mesh (also named skin), the file of a mesh, or a hand. palm: width and length of a palm [m].
    side: of planes. recording: gives planes the sizes of the hand recorded.
    Raises StrategyError for a skin mesh that is articulated: it has a shape for each pose of a recording.

    >>> from palpate.render.live.sources.live_hands import live_hand
    >>> live_hand("planes")
    PlaneHand(15 patches, 13 joints, articulated for 1 pose)
    """
    if not isinstance(hand, str):
        if hand.pose_count is not None and not isinstance(hand, PlaneHand):
            raise StrategyError(f"{hand!r} has a shape for each pose of its motion; a live one is rigid, or of planes")
        return hand
    name = find_name(hand, LIVE_HANDS) or hand
    if name != "planes":
        return load_hand("skin" if name == "mesh" else name, palm)
    if recording is not None:
        return load_hand(name, palm, recording.held())
    if palm is not None:
        raise StrategyError("--palm is the size of --hand palm, which planes is not")
    is_left = side == "left"
    shape = hand_shape(is_left=is_left)
    return PlaneHand.from_joints(shape.joint_pose[None], shape.joint_radius, is_left=is_left)


def patch_layout(hand: Hand) -> PatchLayout | None:
    """The patches of an articulated hand; None for a rigid one. Raises StrategyError for a patch that no bone moves."""
    if not isinstance(hand, PlaneHand) or hand.patch_pose is None:
        return None
    there = ~hand.absent  # a patch that is missing in the first pose may be there in a later one
    rest = hand.patch_pose[np.argmax(there, axis=0), np.arange(hand.patch_count)]
    return PatchLayout.of(tuple(patch.name for patch in hand.patches), rest)
