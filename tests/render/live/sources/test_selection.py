"""Of two hands one is followed as long as it is there."""

import pytest
from live_senders import palm_at

from palpate.render.live.sources.hand_frame import SeenHand
from palpate.render.live.sources.selection import ABSENT, HandSelection


def hand(side, hand_id, at=0.0):
    return SeenHand(at, side, hand_id, palm_at(at))


def followed(selection, *hands, at=0.0):
    return selection.chosen([one._replace(time=at) for one in hands] or [SeenHand(at)], at).hand_id


LEFT, RIGHT, OTHER = hand("left", "1"), hand("right", "2"), hand("right", "3")


@pytest.mark.parametrize(("side", "first"), [("any", "1"), ("left", "1"), ("right", "2")])
def test_the_first_hand_of_the_side_is_followed(side, first):
    assert followed(HandSelection(side), LEFT, RIGHT, OTHER) == first


def test_a_hand_is_followed_as_long_as_it_is_there_whatever_the_order():
    selection = HandSelection()
    found = [
        followed(selection, *hands) for hands in ([RIGHT], [LEFT, RIGHT], [OTHER, RIGHT, LEFT], [LEFT], [RIGHT, LEFT])
    ]
    assert found == ["2", "2", "2", "1", "1"]


def test_after_a_frame_without_hands_the_next_one_is_followed():
    selection = HandSelection("right")
    assert [followed(selection, *hands) for hands in ([RIGHT, OTHER], [], [LEFT], [OTHER, RIGHT])] == ["2", "", "", "3"]


def test_a_hand_whose_side_the_tracker_does_not_say_is_taken_as_asked():
    assert followed(HandSelection("left"), hand(None, "7")) == "7"


def test_the_same_id_on_the_other_side_is_another_hand():
    selection = HandSelection()
    followed(selection, hand("left", "1"))
    assert followed(selection, hand("right", "5"), hand("right", "1")) == "5"


def test_a_hand_that_comes_on_its_own_is_ignored_until_the_followed_one_is_gone():
    selection = HandSelection()
    followed(selection, RIGHT, at=10.0)
    assert selection.ignores(LEFT._replace(time=10.0 + 0.9 * ABSENT))
    assert not selection.ignores(RIGHT._replace(time=10.1))
    assert not selection.ignores(LEFT._replace(time=10.0 + 1.1 * ABSENT))
    assert not selection.ignores(SeenHand(10.1))


def test_a_hand_of_the_other_side_on_its_own_is_ignored():
    assert HandSelection("right").ignores(LEFT)
