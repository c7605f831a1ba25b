"""A flat, open hand of planes, for whoever has recorded none."""

import numpy as np

from .hand import IDENTITY, require_sides
from .plane_hand import HandPatch, PlaneHand, phalanx_joints

BREADTH, HAND_LENGTH = 0.085, 0.187  # [m]; near the means of adults in ANSUR II, which are 78..90 and 181..193 mm
PALM_SHARE = 0.56  # of the hand's length, from the wrist to the middle finger's crease
# Shares read off an open hand's tracked joints, rounded: of the middle finger's length and of the palm's width.
FINGER_SHAPES = {"index": (0.91, 0.245), "middle": (1.0, 0.245), "ring": (0.93, 0.23), "little": (0.74, 0.195)}
PHALANX_SHARES = {"proximal": (0.45, 1.0), "intermediate": (0.29, 0.95), "distal": (0.26, 0.87)}  # of a finger
THUMB_SHAPES = {"proximal": (0.17, 0.28), "distal": (0.13, 0.25)}  # of the hand's length, of the palm's width
THUMB_ANGLE = np.radians(40.0)  # away from the other fingers


def flat_hand(width: float = BREADTH, length: float = HAND_LENGTH, *, is_left: bool = False) -> PlaneHand:
    """A flat, open hand of 15 patches: palm, three phalanges of each finger, two of the thumb; all in one plane.

    width: across the palm [m]; length: from the wrist to the tip of the middle finger [m]. The proportions are
    plausible ones for adults, no measurement of anybody. Raises StrategyError for sides that are no size for skin.

    >>> from palpate.render import flat_hand
    >>> hand = flat_hand(length=0.18)
    >>> hand
    PlaneHand(15 patches, 13 joints, rigid)
    >>> [patch.name for patch in hand.patches if patch.name.startswith("index")]
    ['index-proximal', 'index-intermediate', 'index-distal']
    """
    require_sides("hand", width, length)
    palm = PALM_SHARE * length
    little = -1.0 if is_left else 1.0  # X points to the little finger on a right hand, to the thumb on a left one
    patches = [HandPatch("palm", width, palm)]
    gap = width * (1.0 - sum(share for _, share in FINGER_SHAPES.values())) / (len(FINGER_SHAPES) - 1)
    edge = -width / 2
    for finger, (length_share, width_share) in FINGER_SHAPES.items():
        whole, across = length_share * (length - palm), width_share * width
        x, z = little * (edge + across / 2), -palm / 2
        for part, (along_share, across_share) in PHALANX_SHARES.items():
            along = along_share * whole
            place = (x, 0.0, z - along / 2, *IDENTITY[3:])
            patches.append(HandPatch(f"{finger}-{part}", across_share * across, along, place))
            z -= along
        edge += across + gap
    patches += _flat_thumb(width, length, little)
    return PlaneHand(tuple(patches), phalanx_joints([patch.name for patch in patches]))


def _flat_thumb(width: float, length: float, little: float) -> list[HandPatch]:
    """The thumb's two phalanges, beside the palm and turned away from the fingers."""
    sine, cosine = np.sin(THUMB_ANGLE), np.cos(THUMB_ANGLE)
    along = np.array([-little * sine, 0.0, -cosine])  # to its tip
    turn = (0.0, float(np.sin(little * THUMB_ANGLE / 2)), 0.0, float(np.cos(THUMB_ANGLE / 2)))
    start = np.array([-little * (width / 2 + THUMB_SHAPES["proximal"][1] * width / 2 * cosine), 0.0, 0.02 * length])
    patches = []
    for part, (length_share, width_share) in THUMB_SHAPES.items():
        middle = start + along * length_share * length / 2
        patches.append(
            HandPatch(f"thumb-{part}", width_share * width, length_share * length, (*middle.tolist(), *turn))
        )
        start = start + along * length_share * length
    return patches
