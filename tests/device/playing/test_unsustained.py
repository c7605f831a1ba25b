"""What is refused before it is played: contents at a rate that an array cannot keep up."""

from __future__ import annotations

from array import array
from collections.abc import Iterator

import numpy as np
import pytest

from palpate.device import ArrayModel, Player, UpdateRateError, VirtualClock, array_model, encode_frames, open_link
from palpate.device.playing.player import within_reach
from palpate.device.registry import emulated_backend


def wire(model: ArrayModel, on: list[float], *, delay: float = 0.0) -> array[int]:
    """Frames of one pattern at these amplitudes."""
    shape = (len(on), model.transducer_count)
    return array("B", encode_frames(np.full(shape, delay), np.array(on), array=model).tobytes())


@pytest.mark.parametrize(("name", "divider"), [("pat16", 3), ("sonicsurface", 258), ("emulator", 1)])
def test_blocks_at_a_rate_that_is_kept_up_are_passed_on_as_they_are(name: str, divider: int) -> None:
    model = array_model(name)
    blocks = [wire(model, [1.0, 1.0]), wire(model, [1.0], delay=0.5)]
    assert within_reach(blocks, model, divider) is blocks


def test_a_burst_becomes_one_block() -> None:
    model = array_model("pat16")
    block = wire(model, [1.0] * 14)
    (whole,) = within_reach([block, block], model, 2)
    assert whole == block + block
    with pytest.raises(UpdateRateError, match="beyond 28 frames it needs divider 3 or more"):
        within_reach([block, block, wire(model, [1.0])], model, 2)


def test_one_pattern_and_off_alternate_for_as_long_as_wanted_and_are_taken_one_block_after_the_other() -> None:
    model = array_model("sonicsurface")
    taken: list[int] = []

    def blocks() -> Iterator[array[int]]:
        for number in range(100):
            taken.append(number)
            yield wire(model, [0.0, 1.0, 1.0, 0.0])

    checked = iter(within_reach(blocks(), model, 10))
    assert taken == [0]
    assert len(next(checked)) == 4 * model.frame_bytes
    assert taken == [0]
    assert len(list(checked)) == 99


def test_another_pattern_is_refused_with_the_number_of_its_frame() -> None:
    model = array_model("sonicsurface")
    good, bad = wire(model, [0.0, 1.0]), wire(model, [0.0, 0.0, 1.0], delay=0.5)
    with pytest.raises(UpdateRateError, match="but frame 4 has another pattern"):
        list(within_reach([good, bad], model, 10))
    with pytest.raises(UpdateRateError, match="but frame 2 has another pattern"):
        within_reach([good + wire(model, [1.0], delay=0.5)], model, 10)  # at once


@pytest.mark.parametrize(("name", "divider"), [("pat16", 2), ("sonicsurface", 10)])
def test_a_refusal_comes_before_the_link_is_started(name: str, divider: int) -> None:
    model = array_model(name)
    bus = emulated_backend(name, clock=VirtualClock())
    with open_link(model, backend=bus) as link:
        opened = link.bytes_sent
        player = Player(link)
        content = wire(model, [1.0] * 20) + wire(model, [1.0] * 20, delay=0.5)
        with pytest.raises(UpdateRateError):
            player.play([content], update_rate=model.update_rate(divider))
        assert link.bytes_sent == opened
        assert player.report is None
