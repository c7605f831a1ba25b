"""The writer's process: it plays what it is told to, and switches the array off whatever ends it."""

import os
import signal
import subprocess
import sys
import time
from array import array

import numpy as np
import pytest

from palpate.device import array_model, encode_frames
from palpate.device.errors import DeviceError, DeviceNotFoundError, NoBackendError, SafetyLimitError, UpdateRateError
from palpate.device.live.writer_handle import WriterHandle, error_of
from palpate.device.live.writer_process import ArrayRequest
from palpate.device.playing.limits import Guard, Limits
from palpate.device.registry import kind_of

RATE = 10e3
NO_LIMITS = Limits(on_time_max=None, duty_max=None)


def request(name="emulator", **more):
    model = array_model(name)
    return ArrayRequest(kind=kind_of(model), model=model, **{"emulated": True} | more)


def stimulus(handle, seconds):
    """Frames at full drive, and their doses."""
    model = handle.arrays[0].model
    count = round(seconds * RATE)
    frames = encode_frames(np.zeros((count, model.transducer_count)), np.ones(count), array=model).tobytes()
    doses = Guard(NO_LIMITS, model).measure(array("B", frames), handle.slice_frames)
    return [memoryview(frames)], [doses]


def heard(handle, event, timeout=5.0):
    """The next message of a name; others are dropped."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        for message in handle.messages(0.1):
            if message["event"] == event:
                return message
            assert message["event"] != "gone", event
    raise AssertionError(f"no {event} within {timeout} s")


def last_words(handle):
    """All messages until the process is gone."""
    words = {}
    while "gone" not in words:
        for message in handle.messages(5.0):
            words[message.pop("event")] = message
    return words


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.exhaustive
def test_a_stimulus_begins_at_once_and_the_array_is_off_at_the_end():
    with WriterHandle([request()], update_rate=RATE, realtime=False) as handle:
        assert handle.ready["emission"] == "board"
        number = handle.load(*stimulus(handle, 0.03))
        assert heard(handle, "loaded")["number"] == number
        called_ns = time.monotonic_ns()
        handle.send("play", number=number)
        began = heard(handle, "began")
        assert 0 < began["onset_ns"] - called_ns < 50e6
        assert heard(handle, "ended")["frames"] == 300
    words = last_words(handle)
    (own,) = words["off"]["arrays"]
    assert (own["array"], own["off_sent"], own["off_confirmed"]) == ("emulator", True, True)
    assert own["on_time"] == pytest.approx(0.03, abs=5e-3)
    handle.release()


def test_a_stop_ends_a_stimulus():
    with WriterHandle([request()], update_rate=RATE, realtime=False) as handle:
        number = handle.load(*stimulus(handle, 1.0))
        handle.send("play", number=number)
        heard(handle, "began")
        handle.send("stop")
        assert heard(handle, "ended", 1.0)["frames"] < 5000
    handle.release()


def test_a_limit_switches_the_array_off_and_says_so():
    limits = Limits(on_time_max=0.05)
    with WriterHandle([request()], update_rate=RATE, limits=limits, realtime=False) as handle:
        handle.send("play", number=handle.load(*stimulus(handle, 0.5)))
        failed = heard(handle, "failed")
        error = error_of(failed)
        assert isinstance(error, SafetyLimitError)
        assert "more than 0.05 s without a pause of 1 s (on_time_max)" in str(error)
        assert last_words(handle)["off"]["arrays"][0]["off_confirmed"] is True
    handle.release()


def test_a_signal_that_ends_the_process_switches_the_array_off():
    with WriterHandle([request()], update_rate=RATE, realtime=False) as handle:
        handle.send("play", number=handle.load(*stimulus(handle, 1.0)))
        heard(handle, "began")
        os.kill(handle.process_id, signal.SIGTERM)
        words = last_words(handle)
        assert words["off"]["arrays"][0]["off_confirmed"] is True
        assert words["failed"]["kind"] == "SystemExit"
    handle.release()


def test_a_writer_whose_parent_is_killed_ends():
    code = (
        "import time; from palpate.device import array_model; from palpate.device.registry import kind_of; "
        "from palpate.device.live.writer_handle import WriterHandle; "
        "from palpate.device.live.writer_process import ArrayRequest; model = array_model('emulator'); "
        "request = ArrayRequest(kind=kind_of(model), model=model, emulated=True); "
        "handle = WriterHandle([request], update_rate=1e4); print(handle.process_id, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        writer = int(parent.stdout.readline())
        assert is_alive(writer)
        parent.kill()
        end = time.monotonic() + 3.0
        while is_alive(writer) and time.monotonic() < end:
            time.sleep(0.02)
        assert not is_alive(writer)


@pytest.mark.exhaustive
def test_an_array_that_is_not_there_raises_what_opening_it_raises():
    with pytest.raises((DeviceNotFoundError, NoBackendError)):
        WriterHandle([request("pat16", emulated=False, uncalibrated=True)], update_rate=RATE)


def test_a_rate_that_is_kept_up_for_a_burst_only_is_refused():
    with pytest.raises(UpdateRateError, match=r"pat16 keeps up 40000 Hz for a burst only: .*13333\.3 Hz at most"):
        WriterHandle([request("pat16")], update_rate=40e3)


def test_an_error_of_another_kind_is_told_with_its_kind():
    error = error_of({"kind": "ZeroDivisionError", "text": "division by zero"})
    assert type(error) is DeviceError
    assert str(error) == "the process that writes to the array failed: ZeroDivisionError: division by zero"
