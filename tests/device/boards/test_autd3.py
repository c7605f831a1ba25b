"""An AUTD3 plays the frames it is sent: the vendor's own firmware emulator records what each transducer does."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from palpate.device.boards.autd3.link import BANK_FRAMES_MAX, Autd3Link
from palpate.device.codec import encode_frames, off_frame
from palpate.device.errors import DeviceTimeoutError, FrameError, LinkError, UpdateRateError
from palpate.device.registry import array_model

vendor = pytest.importorskip("autd3", reason="the vendor's package autd3 is not installed")
pytest.importorskip("autd3_emulator", reason="the vendor's package autd3-emulator is not installed")
client = pytest.importorskip("palpate.device.boards.autd3.vendor_client")
recorder = pytest.importorskip("autd3_recorder")
assert_plays, is_emitting = recorder.assert_plays, recorder.is_emitting

MODEL = array_model("autd3")
PERIOD_NS = recorder.PERIOD_NS


@pytest.fixture
def recording() -> Iterator[Callable[..., recorder.RecordingChannel]]:
    made: list[recorder.RecordingChannel] = []

    def make(**options: int) -> recorder.RecordingChannel:
        made.append(recorder.RecordingChannel(**options))
        return made[-1]

    yield make
    for channel in made:
        channel.dispose()


def test_from_power_up_the_vendors_emulated_device_is_silent_until_it_is_sent_something(
    recording: Callable[..., recorder.RecordingChannel],
) -> None:
    channel = recording()
    channel.sleep_until_ns(80 * PERIOD_NS)
    recorded = channel.record()
    assert len(recorded) == 80
    assert not is_emitting(recorded).any()


def _link(channel: recorder.RecordingChannel) -> Autd3Link:
    return Autd3Link(MODEL, client.Controller(channel, who="autd3"))


def _random_frames(count: int, *, uniform: bool, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    delay = random.uniform(0, 1, (count, 249))
    amplitude = np.full(count, 0.5) if uniform else random.uniform(0.05, 1, (count, 249))
    return encode_frames(delay, amplitude, array=MODEL)


def _wire(frames: np.ndarray) -> array:
    return array("B", frames.tobytes())


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize(("divider", "count"), [(1, 1500), (7, 1201), (4, 2500), (4, 1), (4, 2)])
def test_each_frame_is_played_for_its_time_without_a_gap_between_banks(divider, count, uniform, recording):
    channel = recording()
    link = _link(channel)
    frames = _random_frames(count, uniform=uniform)
    link.start(divider)
    for start in range(0, count, 131):
        link.write(_wire(frames[start : start + 131]))
    assert link.drain()
    assert (link.bytes_under_way, link.bytes_sent) == (0, frames.nbytes)
    channel.sleep_until_ns(channel.now_ns() + 20_000_000)
    link.send_off()
    recorded = channel.record()
    emitting = np.flatnonzero(is_emitting(recorded))
    assert_plays(recorded[emitting[0] :], frames, divider)
    assert emitting[-1] - emitting[0] == count * divider - 1
    assert link.underruns == 0


@pytest.mark.exhaustive
def test_an_array_that_starves_is_silent_and_the_gap_is_counted(recording):
    channel = recording()
    link = _link(channel)
    frames = _random_frames(2000, uniform=True)
    link.start(4)
    link.write(_wire(frames[:1000]))
    channel.sleep_until_ns(channel.now_ns() + 300_000_000)
    link.write(_wire(frames[1000:]))
    status = link.status()
    link.drain()
    recorded = channel.record()
    emitting = np.flatnonzero(is_emitting(recorded))
    gap = int(np.diff(emitting).max()) - 1
    assert_plays(recorded[emitting[0] :], frames[:1000], 4)
    assert_plays(recorded[emitting[0] + 4000 + gap :], frames[1000:], 4)
    assert (link.underruns, status.underruns, status.starved_periods) == (1, 1, gap // 4)


def test_a_slow_network_starves_only_a_rate_that_it_cannot_carry(recording):
    """A full datagram takes 120 us at 100 Mbit/s: 10 kHz of any frames, 40 kHz of none."""
    for divider, starves in ((4, False), (1, True)):
        channel = recording(datagram_ns=120_000)
        link = _link(channel)
        link.start(divider)
        link.write(_wire(_random_frames(3 * BANK_FRAMES_MAX, uniform=False)))
        link.drain()
        assert (link.underruns > 0) == starves


@pytest.mark.exhaustive
def test_off_is_at_once_although_a_bank_waits_for_its_time(recording):
    channel = recording()
    link = _link(channel)
    frames = _random_frames(3000, uniform=False)
    link.start(4)
    link.write(_wire(frames), abandon=lambda: channel.now_ns() > 200_000_000)
    channel.sleep_until_ns(channel.now_ns() + PERIOD_NS)
    assert link.status().level > 0
    assert link.bytes_under_way > 0
    off_ns = channel.now_ns()
    link.send_off()
    sent = link.bytes_sent // 498 - 1
    assert (link.bytes_under_way, link.status().level, link.status().fifo_frames) == (0, 0, 0)
    channel.sleep_until_ns(channel.now_ns() + 300_000_000)
    recorded = channel.record()
    emitting = np.flatnonzero(is_emitting(recorded))
    assert emitting[-1] == off_ns // PERIOD_NS - 1
    assert sent == -(-(emitting[-1] + 1 - emitting[0]) // 4)
    assert 0 < sent < 3000
    assert_plays(recorded[emitting[0] :], frames[: sent - 1], 4)


def test_a_link_plays_again_after_off_at_another_rate(recording):
    channel = recording()
    link = _link(channel)
    first, second = _random_frames(150, uniform=True, seed=2), _random_frames(150, uniform=False, seed=3)
    link.start(10)
    link.write(_wire(first), abandon=lambda: True)
    assert not link.drain(abandon=lambda: True)
    link.cancel()
    channel.sleep_until_ns(channel.now_ns() + 60_000_000)  # in which the first would be played, had it not been dropped
    link.start(2)
    link.write(_wire(second))
    link.drain()
    recorded = channel.record()
    emitting = np.flatnonzero(is_emitting(recorded))
    assert emitting[-1] - emitting[0] == 299
    assert_plays(recorded[emitting[0] :], second, 2)


def test_the_array_is_left_as_at_power_up_its_smoothing_too(recording):
    channel = recording()
    link = _link(channel)
    link.start(4)
    link.write(_wire(_random_frames(50, uniform=True)))
    link.drain()
    link.close()
    focus = vendor.commands.Pattern(client.PhaseBuffer.from_array(np.full((1, 249), 200, np.uint8)), 255)
    silent = channel.now_ns() // PERIOD_NS
    channel.send(focus)
    channel.sleep_until_ns(channel.now_ns() + 2_000_000)
    recorded = channel.record()[silent:]
    assert 0 < recorded[1, 249] < recorded[-1, 249]


def test_vendor_positions_are_the_models_but_for_the_origin():
    theirs = vendor.geometry.Geometry([vendor.geometry.Autd3()])[0].positions() * 1e-3
    np.testing.assert_allclose(theirs - recorder.ORIGIN, MODEL.position, atol=1e-7)


def test_the_vendors_field_peaks_at_the_focal_point(recording):
    channel = recording()
    link = _link(channel)
    point = np.array([0.03, -0.02, 0.2])
    distance = np.linalg.norm(MODEL.position - point, axis=1)
    link.start(4)
    link.write(_wire(encode_frames([(-distance * 40e3 / 343.0) % 1] * 100, np.ones(100), array=MODEL)))
    link.drain()
    np.testing.assert_allclose(channel.peak(channel.now_ns() - 5_000_000, point), point, atol=1e-4)


@pytest.mark.exhaustive
def test_a_loop_that_is_shorter_than_a_bank_is_sent_once_and_plays_at_40_khz(recording):
    """A full datagram takes 120 us at 100 Mbit/s, so not even phases alone could be sent again and again."""
    channel = recording(datagram_ns=120_000)
    link = _link(channel)
    loop = _random_frames(300, uniform=True)
    frames = np.concatenate([np.tile(loop, (20, 1)), off_frame(array=MODEL)[None]])
    link.start(1)
    link.write(_wire(frames))
    link.drain()
    recorded = channel.record()
    emitting = np.flatnonzero(is_emitting(recorded))
    gap = int(np.diff(emitting).max()) - 1
    assert_plays(recorded[emitting[0] :], frames[:900], 1)
    assert_plays(recorded[emitting[0] + 900 + gap :], frames[900:], 1)
    assert link.underruns == 1  # the second bank can be filled only when the first is played
    assert channel.datagrams < 2 * 180 + 100  # a bank's phases are 180, and there are two


@pytest.mark.parametrize("code", ["TIMEOUT", "DEVICE"])
def test_errors_of_the_vendors_do_not_leave(code, recording):
    channel = recording()
    link = _link(channel)
    link.start(4)
    channel.failing = _vendor_error(code)
    with pytest.raises(DeviceTimeoutError if code == "TIMEOUT" else LinkError, match="array autd3 "):
        link.write(_wire(_random_frames(1000, uniform=True)))
    with pytest.raises(LinkError):
        link.send_off()
    link.close()


def _vendor_error(code: str) -> vendor.Autd3Error:
    error = vendor.Autd3Error("something happened")
    error.code = getattr(vendor.Autd3Error, code)
    return error


def test_what_cannot_be_played_is_refused(recording):
    channel = recording()
    link = _link(channel)
    with pytest.raises(UpdateRateError, match="65536"):
        link.start(65536)
    with pytest.raises(FrameError, match="499 bytes"):
        link.write(array("B", bytes(499)))
    assert channel.sends == 0


def test_the_package_takes_firmware_of_its_own_series_only():
    # docs/guide/boards.md says which firmware that is; the vendor's package knows.
    assert vendor.FirmwareVersion.SUPPORTED_SERIES == (0, 12)
    assert not vendor.ClientConfig().require_supported_firmware  # so it has to be asked for, as `Controller` does
