"""What a source saw -> messages: clock, choice of the hand, plausibility, poses, shaping; no more than can be used.

It reads no clock and no socket: whatever comes is given with the time of its arrival.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from ....datasets.recordings.alignment import Alignment
from .clock_map import ClockMap
from .hand_frame import Seen, SeenHand, SourceFault
from .hand_poses import HandPoses, PatchLayout
from .messages import PoseMessage
from .plausibility import Implausible

if TYPE_CHECKING:
    from .shaping import PoseShaping  # scipy.signal takes seconds to import, and only smoothing needs it

ANY: Final = "any"
SIDES: Final = ("any", "left", "right")
ABSENT = 0.25
"""A hand of which nothing has come for so long, while another one is seen, is no longer followed [s]."""
FAULT_PERIOD_NS = 10_000_000_000
"""A fault that goes on is reported again after this time [ns], with its count."""
KINDS_MOST = 256  # of faults that are told apart: a source may invent them
SPACING_NS = 1_000_000
"""Poses come no faster than one in this time [ns], on average: more of them change nothing that is felt."""
BURST = 3  # poses that may come at once: a tracker's late frame, and the next one in time


class FaultLog:
    """Faults by kind: the first is reported, those after it are counted and reported together."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, int]] = {}  # kind: reported when [ns], how often since

    def reported(self, fault: SourceFault, now_ns: int) -> str:
        """The sentence that is to be reported now; empty if the fault is only counted."""
        if fault.kind not in self._seen and len(self._seen) == KINDS_MOST:
            return ""
        last_ns, count = self._seen.get(fault.kind, (now_ns - FAULT_PERIOD_NS, 0))
        if now_ns - last_ns < FAULT_PERIOD_NS:
            self._seen[fault.kind] = (last_ns, count + 1)
            return ""
        self._seen[fault.kind] = (now_ns, 0)
        return f"{fault.text} ({count + 1:,} times since it was reported last)" if count else fault.text


class HandSelection:
    """Chooses a hand, frame by frame. side: any, left or right; a hand of no known side is one of the side asked for.

    The first hand of the side is followed by its id as long as it is there, whatever else comes; then the next one. A
    tracker that loses a hand and finds it again may give it another id: that is the next hand. A hand is gone when a
    frame comes without it, or, in a source that sends each hand on its own, when nothing of it came for ABSENT.
    """

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


class PoseStream:
    """Messages of one source, frame by frame.

    clock: of the source. alignment: tracker's frame -> array's. side: any, left or right. patches: of an articulated
    hand. shaper: of poses.
    """

    def __init__(
        self,
        clock: str,
        *,
        alignment: Alignment | None = None,
        side: str = ANY,
        patches: PatchLayout | None = None,
        shaper: "PoseShaping | None" = None,
    ) -> None:
        self._clock = ClockMap(clock)
        self._selection = HandSelection(side)
        self._side = side
        self._poses = HandPoses(alignment, patches)
        self._shaper = shaper
        self._faults = FaultLog()
        self._skipped = 0
        self._allowed_ns = 0  # a pose may go from then on [ns]: one burst before the spacing is kept
        self._followed = ""
        self._is_lost = False

    def taken(self, seen: Seen, arrival_ns: int) -> list[PoseMessage]:
        """Messages for what came at a time [ns]; none as long as there is nothing to send."""
        if isinstance(seen, SourceFault):
            self._skipped += seen.left_out
            return self._reports(seen, arrival_ns)
        if isinstance(seen, SeenHand):
            hands: Sequence[SeenHand] = (seen,)
            if self._selection.ignores(seen):
                is_alone = not self._selection.followed and seen.side is not None
                return self._reports(self._other_side(seen.side), arrival_ns) if is_alone else []
        else:
            hands = seen
        if not hands:
            return []
        time = hands[0].time
        mapped = self._clock.stamp(time, arrival_ns)
        messages = self._reports(mapped.fault, arrival_ns)
        if mapped.restarted:
            self._restart()
        if mapped.stamp_ns is None or not self._may_go(arrival_ns):
            self._skipped += 1
            return messages
        hand = self._selection.chosen(hands, time)
        others = [other.side for other in hands if hand.is_lost and not other.is_lost]
        if others:
            messages += self._reports(self._other_side(others[0]), arrival_ns)
        try:
            return [*messages, self._message(hand, mapped.stamp_ns)]
        except Implausible as error:
            self._skipped += 1
            return [*messages, *self._reports(error.fault, arrival_ns)]

    def lost(self, stamp_ns: int) -> PoseMessage:
        """The message that the tracker sees no hand."""
        if self._shaper is not None and not self._is_lost:
            self._shaper.reset()
        self._is_lost = True
        return self._counted(PoseMessage(stamp_ns, self._clock.last, None))

    def _message(self, hand: SeenHand, stamp_ns: int) -> PoseMessage:
        """The message for the hand that is followed; raises Implausible."""
        if hand.is_lost:
            return self.lost(stamp_ns)
        if self._selection.followed != self._followed:
            self._followed = self._selection.followed
            self._restart()
        pose, patch_pose = self._poses.posed(hand)
        if pose is None:  # joints are there, but not those that the palm's place follows from
            return self.lost(stamp_ns)
        if self._shaper is not None:
            pose = self._shaper.shaped(stamp_ns * 1e-9, pose)
        self._is_lost = False
        return self._counted(PoseMessage(stamp_ns, hand.time, pose, patch_pose))

    def _other_side(self, side: str | None) -> SourceFault:
        return SourceFault("other side", f"side: only a {side} hand is seen, and a {self._side} one is asked for")

    def _restart(self) -> None:
        self._poses.restart()
        if self._shaper is not None:
            self._shaper.reset()

    def _may_go(self, now_ns: int) -> bool:
        """Whether a pose may go now: BURST at once, one in SPACING_NS on average."""
        if now_ns < self._allowed_ns:
            return False
        self._allowed_ns = max(self._allowed_ns, now_ns - BURST * SPACING_NS) + SPACING_NS
        return True

    def _reports(self, fault: SourceFault | None, now_ns: int) -> list[PoseMessage]:
        """A message with a fault and no pose, which says nothing about the hand; none if it is only counted."""
        text = "" if fault is None or not fault.text else self._faults.reported(fault, now_ns)
        return [self._counted(PoseMessage(now_ns, self._clock.last, None, fault=text))] if text else []

    def _counted(self, message: PoseMessage) -> PoseMessage:
        """The message with the frames skipped before it."""
        skipped, self._skipped = self._skipped, 0
        return replace(message, skipped=skipped) if skipped else message
