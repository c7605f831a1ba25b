"""Which of the hands that a tracker sees is followed.

| asked for | followed |
|---|---|
| any | the first hand that is seen, as long as it is there, whatever else comes; then the next one |
| left, right | the same, among hands of that side; a tracker that does not say the side is taken at its only hand |

A hand is followed by its id. A tracker that loses a hand and finds it again may give it another id: that is the next
hand. A hand is gone when a frame comes without it; one that is not said to be gone, in a source that sends each hand on
its own, is gone after ABSENT.
"""

from collections.abc import Sequence
from typing import Final

from .hand_frame import SeenHand

ANY: Final = "any"
SIDES: Final = ("any", "left", "right")
ABSENT = 0.25
"""A hand of which nothing has come for so long, while another one is seen, is no longer followed [s]."""


class HandSelection:
    """Chooses a hand, frame by frame. side: any, left or right."""

    def __init__(self, side: str = ANY) -> None:
        self._side = side
        self._followed: tuple[str | None, str] | None = None
        self._seen = 0.0  # when the followed hand was seen [s], on the source's clock

    @property
    def followed(self) -> str:
        """Id of the hand that is followed; empty for none."""
        return "" if self._followed is None else self._followed[1]

    def ignores(self, hand: SeenHand) -> bool:
        """Whether a hand that comes on its own is another one than the hand that is followed."""
        if hand.is_lost:
            return False
        if not self._is_wanted(hand):
            return True
        is_other = self._followed is not None and (hand.side, hand.hand_id) != self._followed
        return is_other and abs(hand.time - self._seen) <= ABSENT

    def chosen(self, hands: Sequence[SeenHand], time: float) -> SeenHand:
        """The hand that is followed, among all of one time [s]; a frame without hand if there is none."""
        there = [hand for hand in hands if not hand.is_lost and self._is_wanted(hand)]
        same = [hand for hand in there if (hand.side, hand.hand_id) == self._followed]
        hand = next(iter(same or there), None)
        if hand is None:
            self._followed = None
            return SeenHand(time)
        self._followed, self._seen = (hand.side, hand.hand_id), time
        return hand

    def _is_wanted(self, hand: SeenHand) -> bool:
        return self._side == ANY or hand.side in (None, self._side)
