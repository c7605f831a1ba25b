"""A frame at lower levels is the frame that the codec makes of lower amplitudes."""

import numpy as np
import pytest

from palpate.device import array_model, encode_frames
from palpate.device.codec import is_emitting
from palpate.device.registry import kind_of

STEPS = 16


def faded_frames(frame, model):
    return kind_of(model).layout.faded(frame, model.transducer_count, STEPS)


@pytest.mark.parametrize("name", ["emulator", "pat16"])
def test_a_faded_frame_is_that_of_a_lower_amplitude(name):
    model = array_model(name)
    delay = np.random.default_rng(1).uniform(0, 1, (1, model.transducer_count)).astype(np.float32)
    (frame,) = encode_frames(delay, [1.0], array=model)
    faded = np.frombuffer(b"".join(faded_frames(frame.tobytes(), model)), np.uint8).reshape(STEPS, -1)
    layout = kind_of(model).layout
    levels = layout.levels
    for step in range(1, STEPS):
        level = levels.count * (STEPS - step) // STEPS
        (wanted,) = encode_frames(delay, levels.amplitude[[level]], array=model)
        np.testing.assert_array_equal(faded[step - 1][layout.level_at], wanted[layout.level_at])
        difference = faded[step - 1][layout.delay_at].astype(int) - wanted[layout.delay_at]
        turned = (difference + layout.turn // 2) % layout.turn - layout.turn // 2
        assert np.abs(turned).max() <= 1  # half a step of a pulse's start is rounded otherwise
        assert is_emitting(faded[[step - 1]], array=model)[0]
    assert faded[-1].tobytes() == layout.off_frame(model.frame_bytes).tobytes()


def test_an_array_that_only_switches_goes_off_at_once():
    model = array_model("sonicsurface")
    (frame,) = encode_frames(np.zeros((1, model.transducer_count)), [1.0], array=model)
    faded = faded_frames(frame.tobytes(), model)
    assert len(faded) == STEPS
    assert not is_emitting(np.frombuffer(b"".join(faded), np.uint8).reshape(STEPS, -1), array=model).any()
