"""A frame at lower levels, in plain Python: the writer's own way out when nothing new comes."""

from __future__ import annotations

from ..array import ArrayModel
from ..registry import kind_of


def faded_frames(frame: bytes, model: ArrayModel, step_count: int) -> list[bytes]:
    """The frame at falling levels, the last of them off; delays stay, so the focal point does.

    A board that can only switch has no levels between: for it, all of them are off.
    """
    layout = kind_of(model).layout
    off = layout.off_frame(model.frame_bytes).tobytes()
    if layout.level_at is None:
        return [off] * step_count
    delays, levels = layout.bytes_of(model.frame_bytes, model.transducer_count)
    pairs = list(zip(delays, levels or (), strict=True))
    steps: list[bytes] = []
    for number in range(1, step_count):
        faded = bytearray(frame)
        for delay_at, level_at in pairs:
            level = frame[level_at]
            faded[level_at] = lower = level * (step_count - number) // step_count
            if layout.later:  # a narrower pulse begins later, so that its middle stays
                fixed = layout.fixed.get(delay_at, 0)
                start = (frame[delay_at] & ~fixed) + int((level - lower) * layout.later)
                faded[delay_at] = start % layout.turn | fixed
        steps.append(bytes(faded))
    return [*steps, off]
