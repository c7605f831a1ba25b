"""The model of the PAT board, by bytes written by hand, and what the codec's bytes make it emit."""

from __future__ import annotations

import numpy as np
import pytest
from board_outputs import pat_drives
from drive_cases import turned
from hypothesis import given, settings
from hypothesis import strategies as st
from umockdev_session import write_pat_file

from palpate.device.array import ArrayModel
from palpate.device.boards.pat16.model import PatBoard
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.registry import array_model

FRAME = 512
TICK = 25_000  # [ns]
SECOND = 1_000_000_000
SWITCHED_ON = 10 * SECOND


def wire(
    count: int = 1,
    *,
    duty: int = 64,
    phase: int | np.ndarray | None = None,
    divider: int | None = None,
    led: int | None = None,
) -> np.ndarray:
    """Frames as the board takes them, shape [count, 512]; their phases numbered if not given."""
    frames = np.zeros((count, FRAME), np.uint8)
    frames[:, :256] = (np.arange(count)[:, None] if phase is None else phase) & 0x7F
    frames[:, 256:] = duty
    frames[:, 0] |= 0x80
    if divider is not None:
        frames[:, 26:34] |= np.unpackbits(np.array([divider], np.uint8), bitorder="little") * np.uint8(0x80)
        frames[:, 34] |= 0x80
    if led is not None:
        bits = np.unpackbits(np.array([led], "<u4").view(np.uint8), bitorder="little")[:24]
        frames[:, 1:25] |= bits * np.uint8(0x80)
        frames[:, 25] |= 0x80
    return frames


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def board(clock: VirtualClock) -> PatBoard:
    return PatBoard(clock, record=100_000, on_for_ns=SWITCHED_ON)


def send(board: PatBoard, data: np.ndarray | bytes) -> int:
    return board.accept(memoryview(data if isinstance(data, bytes) else data.tobytes()))


def pour(board: PatBoard, data: bytes, late_ns: int = 0, every_ns: int | None = None) -> None:
    """As a bus does: bytes wait on it until there is room; the host looks up late, or again and again."""
    left, since_ns = memoryview(data), board.clock.now_ns()
    while left:
        left = left[board.accept(left, since_ns=since_ns) :]
        if left:
            board.clock.sleep_until_ns(
                board.clock.now_ns() + every_ns if every_ns else board.room_at_ns(len(left)) + late_ns
            )
            assert board.fifo_bytes <= 28 * FRAME  # and looking on changes nothing


def advance(clock: VirtualClock, time_ns: int) -> None:
    clock.sleep_until_ns(clock.now_ns() + time_ns)


def test_a_pulse_begins_at_the_phase_and_lasts_the_duty(board: PatBoard) -> None:
    frame = wire(duty=0)
    frame[0, [5, 6, 7]] = 10, 100, 3
    frame[0, [256 + 5, 256 + 6, 256 + 7]] = 64, 64, 1
    send(board, frame)
    high = {pin: set(np.flatnonzero(board.output(pin))) for pin in (4, 5, 6, 7)}
    assert high == {4: set(), 5: set(range(10, 74)), 6: {*range(100, 128), *range(36)}, 7: {3}}


def test_the_fundamental_told_is_that_of_the_pulse(board: PatBoard) -> None:
    random = np.random.default_rng(1)
    frame = wire(phase=random.integers(0, 128, 256), duty=0)
    frame[0, 256:] = random.integers(1, 65, 256)
    send(board, frame)
    [delay], [amplitude] = pat_drives(frame)
    for pin in range(0, 256, 5):
        middle_of_count = np.exp(-2j * np.pi * (np.arange(128) + 0.5) / 128)
        fundamental = (board.output(pin) * middle_of_count).sum() * np.sin(np.pi / 128)
        assert turned(-np.angle(fundamental) / (2 * np.pi) - delay[pin]) < 1e-9
        assert abs(fundamental) == pytest.approx(amplitude[pin], abs=1e-9)


# FrameBufferController compares divcnt, of 8 bits, with divider - 1: 0 - 1 is 255, so 0 is 256.
@pytest.mark.parametrize(("loaded", "divider"), [(1, 1), (4, 4), (157, 157), (255, 255), (0, 256)])
def test_the_divider_is_that_of_the_frame_that_loads_it(
    board: PatBoard, clock: VirtualClock, loaded: int, divider: int
) -> None:
    send(board, np.concatenate([wire(2), wire(1, divider=loaded), wire(2)]))
    advance(clock, 3 * 255 * 4 * TICK)
    assert np.diff(board.played_ns).tolist() == [4 * TICK, 4 * TICK, divider * TICK, divider * TICK]
    assert board.divider == divider


def test_the_led_takes_24_bits_when_told(board: PatBoard, clock: VirtualClock) -> None:
    without_load = wire(1, led=0xFFFFFF)
    without_load[0, 25] &= 0x7F
    send(board, without_load)
    assert board.led is None
    send(board, wire(1, led=0x12AB40))
    advance(clock, 4 * TICK)
    assert board.led == 0x12AB40


def test_a_frame_is_taken_when_it_is_complete_and_not_before(board: PatBoard, clock: VirtualClock) -> None:
    data = wire(phase=9).tobytes()
    send(board, data[:511])
    advance(clock, 1000 * TICK)
    assert (board.frames_played, board.fifo_bytes) == (0, 511)
    send(board, data[511:])
    assert (board.frames_played, board.fifo_bytes) == (1, 0)
    assert board.playing.tobytes() == data


def test_nothing_is_read_above_28_frames(board: PatBoard, clock: VirtualClock) -> None:
    send(board, wire(1))  # is taken at once; the next is due after 4 ticks
    assert send(board, wire(40)) == 28 * FRAME
    assert send(board, wire(1)) == 0
    assert board.room_at_ns(1) == board.room_at_ns(FRAME) == clock.now_ns() + 4 * TICK
    assert board.room_at_ns(5 * FRAME) == clock.now_ns() + 5 * 4 * TICK
    advance(clock, 4 * TICK)
    assert send(board, wire(40)) == FRAME
    assert board.bytes_received == 30 * FRAME


def test_a_starved_board_plays_its_last_frame_on_and_the_model_counts(board: PatBoard, clock: VirtualClock) -> None:
    send(board, wire(1))
    advance(clock, 4 * TICK)
    assert (board.underruns, board.emitting) == (0, True)
    advance(clock, 6 * TICK)
    assert (board.underruns, board.starved_ns, board.frames_played) == (1, 6 * TICK, 1)
    send(board, wire(2, duty=1))
    assert board.lateness_ns.tolist() == [0, 6 * TICK]
    advance(clock, 4 * TICK)
    assert (board.underruns, board.starved_ns) == (1, 6 * TICK)
    assert board.lateness_ns.tolist() == [0, 6 * TICK, 0]


def test_a_torn_frame_is_cleared_after_a_second_and_not_before(board: PatBoard, clock: VirtualClock) -> None:
    send(board, wire(1, phase=1))  # the FIFO falls short of a frame now
    send(board, wire(1).tobytes()[:300])
    advance(clock, SECOND - 1)
    assert (board.fifo_bytes, board.bytes_cleared) == (300, 0)
    advance(clock, 1)
    assert (board.fifo_bytes, board.bytes_cleared) == (0, 300)
    send(board, wire(1, phase=2))
    assert board.playing.tobytes() == wire(1, phase=2).tobytes()


def test_the_second_begins_anew_only_with_a_whole_frame(board: PatBoard, clock: VirtualClock) -> None:
    half = wire().tobytes()[:256], wire().tobytes()[256:]
    for pause, frames in ((4 * SECOND // 10, 2), (6 * SECOND // 10, 1)):
        before = board.frames_played
        send(board, wire())
        advance(clock, pause)
        send(board, half[0])
        advance(clock, pause)  # 0.8 s or 1.2 s after the whole frame: bytes that came since then do not count
        send(board, half[1])
        assert board.frames_played == before + frames


def test_bytes_count_from_when_they_were_on_the_bus_not_from_when_the_host_looks(
    board: PatBoard, clock: VirtualClock
) -> None:
    send(board, wire(1))
    send(board, wire(1).tobytes()[:300])
    since_ns = clock.now_ns() + 9 * SECOND // 10
    advance(clock, 2 * SECOND)  # the torn frame would have been cleared, had its rest not come
    assert board.accept(memoryview(wire(1).tobytes()[300:]), since_ns=since_ns) == 212
    assert board.played_ns.tolist() == [0, since_ns]
    assert board.bytes_cleared == 0


# What follows is worked by hand from the published states (CommandReader.vhd, FrameBufferController.vhd).


def test_a_block_of_zeros_is_taken_and_skipped(board: PatBoard, clock: VirtualClock) -> None:
    send(board, np.concatenate([wire(1), np.zeros((2, FRAME), np.uint8), wire(1)]))
    advance(clock, 20 * TICK)
    assert (board.blocks_taken, board.frames_played, board.bytes_skipped) == (4, 2, 2 * FRAME)
    # taken at 0, at the end of the 4th carrier period, and so on: a block takes its time whatever it holds
    assert board.played_ns.tolist() == [0, 3 * 4 * TICK]


@pytest.mark.parametrize("ahead", [1, 100, 511])
def test_off_the_grid_every_second_frame_is_dropped_and_the_last_never_plays(
    board: PatBoard, clock: VirtualClock, ahead: int
) -> None:
    # Frame 0 ends inside block 1. The start byte of frame 1 comes while frame 0 is swapped in, so it is not looked
    # at, and the rest of frame 1 has no byte with a flag. Frame 2 begins inside block 2, and so on. What fills no block
    # stays in the FIFO: the last frame is an off frame, and the array stays on.
    frames = np.concatenate([wire(9), wire(1, duty=0)])
    send(board, bytes(ahead) + frames.tobytes())
    advance(clock, SECOND // 2)
    assert board.played.tobytes() == frames[0::2].tobytes()
    assert (board.emitting, board.fifo_bytes, board.bytes_lost) == (True, ahead, 5)
    advance(clock, 9 * SECOND)
    assert board.emitting


def test_a_clear_puts_the_grid_where_the_next_byte_is_and_leaves_the_reader_where_it_was(
    board: PatBoard, clock: VirtualClock
) -> None:
    send(board, bytes(100) + wire(1, phase=7).tobytes())  # 412 bytes of the frame are read, 100 are left
    advance(clock, SECOND)
    assert (board.fifo_bytes, board.bytes_cleared, board.torn_bytes) == (0, 100, 412)
    send(board, wire(2, phase=3))
    advance(clock, SECOND // 2)
    # 100 bytes of the first complete the torn frame, the next one is lost, the others are skipped; the second plays
    assert board.frames_played == 2
    assert board.played[0].tobytes() == wire(1, phase=7).tobytes()[:412] + wire(1, phase=3).tobytes()[:100]
    assert board.played[1].tobytes() == wire(1, phase=3).tobytes()


def test_a_clear_that_falls_into_a_write_shifts_the_grid() -> None:
    board = fed_by_a_chip()
    send(board, wire(1, phase=1))
    advance(board.clock, SECOND // 1000)
    advance(board.clock, board.next_clear_ns - board.clock.now_ns() - 300 * 125)  # 125 ns a byte
    send(board, wire(1, phase=2))
    advance(board.clock, SECOND // 2)
    assert (board.frames_played, board.bytes_cleared, board.fifo_bytes) == (1, 300, 212)


def test_the_clear_comes_each_second_on_an_empty_fifo_too(board: PatBoard, clock: VirtualClock) -> None:
    send(board, wire(1))
    begin_ns = clock.now_ns()
    advance(clock, 5 * SECOND + SECOND // 2)
    send(board, bytes(10))
    assert board.next_clear_ns == begin_ns + 6 * SECOND
    advance(clock, SECOND // 2)
    assert (board.fifo_bytes, board.bytes_cleared) == (0, 10)


def test_a_divider_holds_as_soon_as_its_byte_is_read_though_the_frame_is_not_complete(
    board: PatBoard, clock: VirtualClock
) -> None:
    send(board, bytes(400) + wire(1, divider=200).tobytes())
    advance(clock, SECOND // 2)
    assert (board.divider, board.frames_played, board.torn_bytes) == (200, 0, 112)


def test_after_power_up_frames_wait_for_a_second_and_the_off_frame(clock: VirtualClock) -> None:
    board = PatBoard(clock, record=10)
    assert send(board, wire(40)) == 28 * FRAME
    advance(clock, SECOND)
    assert board.frames_played == 0
    advance(clock, FRAME * 20)  # the off frame is read, a byte a clock of 50 MHz
    assert board.frames_played == 1
    assert board.played_ns.tolist() == [SECOND + FRAME * 20]


def test_from_power_up_until_the_off_frame_all_pins_emit_in_phase_at_full_drive(clock: VirtualClock) -> None:
    # amplituderam.mif of OpenMPD_Hardware at d3b4e57: 16 words of 32 values of 7 bits, 0x81020408... = 64 each.
    word = int("81020408102040" * 4, 16)
    values = [word >> 7 * place & 0x7F for place in range(32)]
    assert set(values) == {64}
    board = PatBoard(clock)
    assert board.emitting
    delay, amplitude = pat_drives(board.playing[None])
    assert (amplitude == 1).all()
    assert np.ptp(delay) == 0
    assert board.output(0).sum() == 64
    advance(clock, SECOND + FRAME * 20 - 1)
    assert board.emitting
    advance(clock, 1)
    assert not board.emitting
    assert not board.playing.any()
    assert board.underruns == 0


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(1, 40_000), min_size=1, max_size=12),
    st.integers(1, 8),
    st.integers(0, 60_000_000),
)
def test_a_host_that_looks_up_late_changes_nothing(sizes: list[int], divider: int, late_ns: int) -> None:
    whole = sum(sizes) // FRAME
    frames = np.concatenate([wire(whole, divider=divider), wire(1, duty=0)])
    data = frames.tobytes()[: sum(sizes)]
    played = []
    for late in (0, late_ns):
        board = PatBoard(VirtualClock(), record=100_000, chip_bytes=1024, on_for_ns=SWITCHED_ON)
        pour(board, data, late)
        advance(board.clock, 60 * divider * TICK)
        assert board.played.tobytes() == frames[:whole].tobytes()
        assert board.bytes_received == len(data)
        assert (np.diff(board.played_ns) == divider * TICK).all()
        played.append(board.played_ns.tolist())
    assert played[0] == played[1]


def fed_by_a_chip() -> PatBoard:
    return PatBoard(VirtualClock(), record=100_000, chip_bytes=1024, byte_rate=8e6, on_for_ns=SWITCHED_ON)


@pytest.mark.parametrize(("divider", "keeps_up"), [(4, True), (3, True), (2, False), (1, False)])
@pytest.mark.parametrize("late_ns", [0, 300_000])
def test_the_chip_keeps_up_with_divider_3_and_not_with_less(divider: int, keeps_up: bool, late_ns: int) -> None:
    board = fed_by_a_chip()
    frames = np.concatenate([wire(600, divider=divider), wire(1, duty=0)])
    pour(board, frames.tobytes(), late_ns)
    advance(board.clock, SECOND)
    assert board.played.tobytes() == frames.tobytes()
    rate = 1e9 / np.diff(board.played_ns[:600]).mean()  # frames a second
    assert rate == pytest.approx(40e3 / divider if keeps_up else 8e6 / 512, rel=0.01)
    # The first frame is taken as it comes, and is due to be followed at the end of a carrier period: up to 14 us before
    # the second has passed the chip.
    assert not keeps_up or board.lateness_ns[1] <= 14_000
    assert board.lateness_ns[2:].any() != keeps_up


@pytest.mark.parametrize(("count", "late"), [(28, None), (45, None), (80, 45)])
@pytest.mark.parametrize("every_ns", [None, 5_000])
def test_a_burst_at_divider_1_lasts_as_long_as_a_full_fifo_does(
    count: int, late: int | None, every_ns: int | None
) -> None:
    board = fed_by_a_chip()
    # Held back by a frame that lasts for 6.4 ms, so that the FIFO is full when the burst begins. From then on frame
    # k is due after k x 25 us, but has passed the chip after (k - 27) x 64 us: too late from k = 45 on.
    burst = np.concatenate([wire(1, divider=255, duty=0), wire(count, divider=1), wire(1, duty=0)])
    pour(board, burst.tobytes(), every_ns=every_ns)
    advance(board.clock, SECOND)
    assert board.played.tobytes() == burst.tobytes()
    starved = np.flatnonzero(board.lateness_ns[1 : 1 + count])
    assert (starved[0] if len(starved) else None) == late


def test_what_has_not_passed_the_chip_is_purged() -> None:
    board = fed_by_a_chip()
    assert send(board, wire(40)) == 1024
    assert send(board, wire(1)) == 0
    advance(board.clock, 64_000)  # 512 bytes at 8 MB/s
    board.purge_chip()
    advance(board.clock, SECOND // 2)
    assert (board.frames_played, board.fifo_bytes) == (1, 0)


# What the codec's bytes make this board emit. A board file of random wiring and calibration tells both sides.


@pytest.fixture(scope="module")
def wiring(tmp_path_factory: pytest.TempPathFactory) -> tuple[ArrayModel, np.ndarray, np.ndarray, np.ndarray]:
    """A board of random wiring; pin, own delay [turns] and amplitude factor of each of its transducers."""
    path = tmp_path_factory.mktemp("pat") / "board.pat"
    place, own_delay, gain = write_pat_file(path, serial="TEST0001", seed=7)
    model = array_model("pat16", calibration=path)
    apart = np.linalg.norm(model.position[:, None].astype(np.float64) - place, axis=2)
    assert apart.min(axis=1).max() < 1e-6
    pin = apart.argmin(axis=1)
    return model, pin, own_delay[pin], gain[pin]


def test_every_transducer_emits_the_delay_meant_for_it(wiring: tuple) -> None:
    model, pin, own_delay, gain = wiring
    random = np.random.default_rng(3)
    delay, amplitude = random.random((200, 256), np.float32), random.random((200, 256), np.float32)
    board = PatBoard(VirtualClock(), record=200, on_for_ns=SWITCHED_ON)
    pour(board, encode_frames(delay, amplitude, array=model).tobytes())
    advance(board.clock, SECOND)
    begun, strength = pat_drives(board.played)
    # A constant of a quarter of a turn is that of a full pulse's middle; where a duty is 0 there is no pulse.
    apart = turned(begun[:, pin] + own_delay - 0.25 - delay)
    assert apart[strength[:, pin] > 0].max() <= 1 / 128
    # half a step of duty, at its steepest pi / 128 in amplitude
    assert np.abs(strength[:, pin] - amplitude * gain).max() <= 0.5 * np.pi / 128 + 1e-6
