"""A paced writer on a virtual clock: what boards recorded is compared with what was to be played, frame by frame."""

from array import array

import numpy as np
import pytest

from palpate.device import VirtualClock, array_model, encode_frames
from palpate.device.boards.discovery import open_link
from palpate.device.errors import SafetyLimitError
from palpate.device.live.paced_writer import FADED, HELD, LATE, PacedWriter, WriterPace
from palpate.device.live.ring import DrawnContent, FrameRing, StoredContent
from palpate.device.playing.limits import Dose, Guard, Limits
from palpate.device.registry import emulated_backend

DIVIDER = 4  # 10 kHz
PERIOD_NS = 100_000
MS = 1_000_000
NO_LIMITS = Limits(on_time_max=None, duty_max=None)


class Bench:
    """A writer, its boards' clock, and what the boards played."""

    def __init__(self, name="emulator", *, limits=NO_LIMITS, count=1, record=60_000):
        self.model = array_model(name)
        self.clock = VirtualClock()
        self.buses = [emulated_backend(name, clock=self.clock, record=record) for _ in range(count)]
        self.links = [open_link(self.model, backend=bus) for bus in self.buses]
        for link in self.links:
            link.start(DIVIDER)
        self.board = self.buses[0].board()
        self.base = self.board.frames_played
        self.emitted, self.skipped, self.of_newest = [], [], []
        self.writer = PacedWriter(
            self.links,
            DIVIDER,
            pace=WriterPace(),
            limits=limits,
            began_ns=lambda number: self.board.began_ns(self.base + number),
            emitted=self.note_emission,
            skipped=lambda *span: self.skipped.append(span),
        )
        sizes = [self.model.frame_bytes] * count
        self.ring = FrameRing(sizes, frame_count=40, slot_count=200)
        self.guard = Guard(NO_LIMITS, self.model)

    def note_emission(self, is_current, *pose):
        self.of_newest.append(is_current)
        self.emitted.append(pose)

    def frames(self, levels):
        """Frames whose amplitudes are these, the same focus in all."""
        delay = np.zeros((len(levels), self.model.transducer_count), np.float32)
        return encode_frames(delay, np.asarray(levels, np.float32), array=self.model)

    def stored(self, levels, **more):
        frames = self.frames(levels)
        doses = self.guard.measure(array("B", frames.tobytes()), 40)
        data = memoryview(frames.tobytes())
        start_ns = more.pop("start_ns", self.clock.now_ns() + PERIOD_NS)
        return StoredContent(
            [data] * len(self.links),
            [self.model.frame_bytes] * len(self.links),
            [doses] * len(self.links),
            slice_frames=40,
            start_ns=start_ns,
            **more,
        )

    def draw(self, first, levels, **more):
        """Put a slice, as the process that draws does."""
        frames = self.frames(levels)
        (dose,) = self.guard.measure(array("B", frames.tobytes()), len(frames))
        assert self.ring.put(first, len(frames), [frames] * len(self.links), [dose] * len(self.links), **more)

    def run(self, milliseconds, *, late=0.0):
        """Step whenever the writer asks for it; late: how much later than that it is called [ms]."""
        end_ns = self.clock.now_ns() + round(milliseconds * MS)
        while self.clock.now_ns() < end_ns:
            next_ns = self.writer.step()
            self.clock.sleep_until_ns(min(max(next_ns, self.clock.now_ns()) + round(late * MS) + 1, end_ns))

    @property
    def played(self):
        """Level of the first transducer in each frame that the first board played since the start, and when [ns]."""
        frames = self.board.played
        offset = 1 if self.model.name == "emulator" else 256
        return (frames[:, offset] & 0x7F if offset > 1 else frames[:, offset]), self.board.played_ns


def on(count, level=1.0):
    return [level] * count


@pytest.mark.parametrize("name", ["emulator", "pat16"])
def test_a_stored_content_is_played_whole_in_order_and_then_silent(name):
    bench = Bench(name)
    steps = np.linspace(0.1, 1.0, 300)
    bench.writer.play(bench.stored(steps))
    bench.run(60)
    level, _ = bench.played
    (places,) = np.nonzero(level)
    shown = level[places[0] : places[-1] + 1]
    offset = 1 if name == "emulator" else 256
    wanted = bench.frames(steps)[:, offset]
    np.testing.assert_array_equal(shown, wanted)
    assert not bench.board.emitting
    assert bench.writer.tally.frames == 300
    assert bench.skipped == []
    assert bench.writer.is_idle


def test_contents_follow_each_other_and_repeat():
    bench = Bench()
    bench.writer.play(bench.stored(on(50), repeats=3))
    bench.run(30)
    bench.writer.play(bench.stored(on(20, 0.5)))
    bench.run(20)
    level, _ = bench.played
    assert (level == 255).sum() == 150
    assert (level == 128).sum() == 20


def test_a_pose_that_is_reported_late_is_none_of_the_content_that_plays_next():
    bench = Bench()
    bench.writer.play(bench.stored(on(10)))
    bench.writer.step()
    bench.clock.sleep_until_ns(bench.clock.now_ns() + 5 * MS)  # all has been played, and nothing was reported yet
    bench.writer.play(bench.stored(on(10, 0.5)))
    bench.run(20)
    assert bench.of_newest == [False, True]
    level, began_ns = bench.played
    starts = [began_ns[np.flatnonzero(level == value)[0]] for value in (255, 128)]
    assert [when for _, _, when in bench.emitted] == starts


def test_a_frame_is_played_at_its_time_and_its_pose_is_reported():
    bench = Bench()
    bench.ring.start_ns = bench.clock.now_ns() + 3 * MS
    bench.writer.play(DrawnContent(bench.ring))
    bench.draw(0, on(40), pose_number=0, stamp_ns=5)
    bench.run(2)
    bench.draw(40, on(40, 0.5), pose_number=1, stamp_ns=6)
    bench.run(20)
    level, began_ns = bench.played
    first = began_ns[np.flatnonzero(level)[0]]
    assert abs(first - bench.ring.start_ns) <= PERIOD_NS
    assert bench.of_newest == [True, True]
    second = began_ns[np.flatnonzero(level == 128)[0]]
    assert second - first == 40 * PERIOD_NS
    assert [(number, stamp) for number, stamp, _ in bench.emitted] == [(0, 5), (1, 6)]
    assert [when for _, _, when in bench.emitted] == [first, second]


def test_what_is_late_is_left_out_and_what_follows_is_in_time():
    bench = Bench()
    bench.ring.start_ns = start_ns = bench.clock.now_ns() + PERIOD_NS
    bench.writer.play(DrawnContent(bench.ring))
    bench.draw(0, on(40))
    bench.run(10)  # played after 4 ms; then the array holds
    bench.draw(40, on(40, 0.25))
    bench.draw(80, on(40, 0.5))
    bench.run(20)
    level, began_ns = bench.played
    late = (level == 64).sum()
    assert late == 0  # all 40 of it were due before 8 ms
    place = np.flatnonzero(level == 128)[0]
    skipped = sum(count for _, count, why in bench.skipped if why == LATE)
    assert abs(began_ns[place] - (start_ns + (40 + skipped) * PERIOD_NS)) <= PERIOD_NS
    assert (level == 128).sum() == 80 - skipped


@pytest.mark.parametrize("stall", [1, 7, 13, 19])
def test_stalls_add_no_lag(stall):
    bench = Bench()
    bench.ring.start_ns = start_ns = bench.clock.now_ns() + PERIOD_NS
    bench.writer.play(DrawnContent(bench.ring))
    for number in range(40):
        if number % 8 == 5:
            bench.clock.advance(stall * 1e-3)
        due = (bench.clock.now_ns() - start_ns) // PERIOD_NS
        first = max(due, 0) // 10 * 10
        bench.draw(first + 10, on(10, 1.0 if number % 2 else 0.5), pose_number=number, stamp_ns=first)
        bench.run(1)
    bench.run(10)
    lag = [began_ns - (start_ns + (stamp + 10) * PERIOD_NS) for _, stamp, began_ns in bench.emitted]
    assert len(lag) > 10
    assert max(lag) <= stall * MS  # no more than the one stall that it met
    assert lag[-1] <= PERIOD_NS


def test_an_array_that_gets_nothing_holds_fades_and_is_off():
    bench = Bench()
    bench.ring.start_ns = start_ns = bench.clock.now_ns() + PERIOD_NS
    bench.writer.play(DrawnContent(bench.ring))
    bench.draw(0, on(40))
    bench.run(20)
    assert bench.board.playing[1] == 255  # held: 4 ms of content, then 20 ms of hold
    bench.run(25)
    assert 0 < bench.board.playing[1] < 255
    bench.run(30)
    assert not bench.board.emitting
    kinds = {why: sum(count for _, count, own in bench.skipped if own == why) for why in (LATE, HELD, FADED)}
    assert kinds[LATE] == 0
    assert 195 <= kinds[HELD] <= 210
    assert kinds[FADED] > 300
    assert bench.writer.tally.stalls == 1
    assert start_ns > 0


def test_content_that_comes_again_is_played_in_time_without_a_pause():
    bench = Bench()
    bench.ring.start_ns = start_ns = bench.clock.now_ns() + PERIOD_NS
    bench.writer.play(DrawnContent(bench.ring))
    bench.draw(0, on(40))
    bench.run(200)
    bench.draw(2050, on(40, 0.5))
    bench.run(20)
    level, began_ns = bench.played
    place = np.flatnonzero(level == 128)[0]
    assert abs(began_ns[place] - (start_ns + 2050 * PERIOD_NS)) <= PERIOD_NS
    assert (level == 128).sum() >= 40


def test_a_pat16_stays_aligned_while_nothing_plays():
    bench = Bench("pat16")
    bench.run(5000)
    before_ns = bench.clock.now_ns()
    bench.writer.play(bench.stored(on(40)))
    bench.run(10)
    level, began_ns = bench.played
    first = began_ns[np.flatnonzero(level)[0]]
    assert first - before_ns < 2 * MS  # an alignment takes 1.3 s
    assert (level == 64).sum() == 40


def test_a_stop_ends_a_content_after_what_was_written():
    bench = Bench()
    bench.writer.play(bench.stored(on(3000)))
    bench.run(50)
    bench.writer.stop()
    bench.run(10)
    level, _ = bench.played
    assert 480 <= (level == 255).sum() <= 500 + 61  # 50 ms, and at most the lead
    assert not bench.board.emitting


def test_a_limit_ends_it_and_is_told_before():
    bench = Bench(limits=Limits(on_time_max=1.0))
    bench.writer.play(bench.stored(on(20_000)))
    bench.run(900)
    (guard,) = bench.writer.guards
    (sentence,) = guard.near(bench.clock.now_ns(), 0.8)
    assert sentence.startswith("on_time_max: it will be stopped in 0 s unless it is silent for 1 s")
    with pytest.raises(SafetyLimitError, match=r"more than 1 s without a pause"):
        bench.run(300)


def test_a_duty_that_nears_its_limit_is_told():
    guard = Guard(Limits(on_time_max=None, duty_max=0.5, duty_window=1.0), array_model("emulator"))
    guard.admit(Dose(4500, 0, 4499, 4500.0, 1.0), 0, PERIOD_NS)
    (sentence,) = guard.near(450 * MS, 0.8)
    assert sentence == "duty_max: its mean duty over 1 s is 0.45, and it will be stopped above 0.5"


def test_two_arrays_play_the_same_frames():
    bench = Bench(count=2)
    bench.writer.play(bench.stored(np.linspace(0.1, 1.0, 100)))
    bench.run(30)
    first, second = (bus.board().played for bus in bench.buses)
    first, second = first[first[:, 1] > 0], second[second[:, 1] > 0]
    assert len(first) == 100
    np.testing.assert_array_equal(first, second)


class SlowLink:
    """A link whose array takes frames at 99 % of their rate; the rest waits on the way."""

    def __init__(self, link, clock):
        self._link, self._clock = link, clock
        self._began_ns = None
        self._handed = 0

    def __getattr__(self, name):
        return getattr(self._link, name)

    def write(self, data, **more):
        self._began_ns = self._began_ns or self._clock.now_ns()
        self._handed += len(data) // self._link.array.frame_bytes
        self._link.write(data, **more)

    @property
    def bytes_under_way(self):
        if self._began_ns is None:
            return 0
        taken = (self._clock.now_ns() - self._began_ns) * 0.99 / PERIOD_NS
        return max(round(self._handed - taken) - self._link.array.fifo_frames, 0) * self._link.array.frame_bytes


def test_an_array_whose_clock_is_slower_gets_fewer_frames_and_no_lag():
    bench = Bench("pat16")
    slow = SlowLink(bench.links[0], bench.clock)
    writer = PacedWriter(
        [slow], DIVIDER, pace=WriterPace(), limits=NO_LIMITS, skipped=lambda *span: bench.skipped.append(span)
    )
    bench.writer = writer
    writer.play(bench.stored(on(20_000)))
    bench.run(1500)
    left_out = sum(count for _, count, _ in bench.skipped)
    assert 60 <= left_out <= 150 + 20  # 1 % of 15,000, less what may wait
    waiting = slow.bytes_under_way // bench.model.frame_bytes
    assert waiting <= 60 - 34 + 20 + 40  # lead less FIFO, the margin, and one slice


def test_a_board_that_does_not_say_when_a_frame_began_does_not_keep_later_ones_from_being_reported():
    bench = Bench()
    bench.writer.play(bench.stored(on(10)))
    bench.base = 10**9  # a frame that is never played
    bench.run(1100)
    assert bench.emitted == []
    bench.base = 0
    bench.writer.play(bench.stored(on(10)))
    bench.run(20)
    assert len(bench.emitted) == 1


def test_an_array_with_a_long_queue_and_a_slower_clock_gets_no_lag():
    """A bridge holds 4096 samples, so a clock that is 2 % slower than the host's would add 20 ms of lag a second."""

    class SlowClock:
        name = "slow"

        def __init__(self, clock):
            self._clock = clock

        def now_ns(self):
            return int(self._clock.now_ns() * 0.98)

        def sleep_until_ns(self, time_ns):
            self._clock.sleep_until_ns(int(time_ns / 0.98))

    clock, model = VirtualClock(), array_model("stratos")
    bridge = emulated_backend("stratos", clock=SlowClock(clock))
    with open_link(model, backend=bridge, clock=clock) as link:
        link.start(DIVIDER)
        frame = np.array([[0, 0, 0.2, 1]], np.float32)
        data = memoryview(np.repeat(frame, 20_000, axis=0).tobytes())
        doses = Guard(NO_LIMITS, model).measure(array("B", data.tobytes()), 10)
        writer = PacedWriter([link], DIVIDER, pace=WriterPace(), limits=NO_LIMITS)
        start_ns = clock.now_ns() + PERIOD_NS
        writer.play(StoredContent([data], [16], [doses], slice_frames=10, start_ns=start_ns))
        waiting = []
        while not writer.is_idle and clock.now_ns() < 3_000 * MS:
            clock.sleep_until_ns(writer.step())
            waiting.append(link.status().fifo_frames)
    lead, behind = 60, 20  # 6 and 2 ms at 10 kHz
    assert max(waiting) <= lead + behind + 2 * 10  # and the slice that is written
    assert 300 <= writer.tally.late <= 500  # about 2 % of 20,000
