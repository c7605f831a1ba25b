"""The process that draws, run in this one: the newest pose wins, and what is drawn is what sampling its poses gives."""

import functools
import os
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.datasets.motions.hand_motion import PALM_DOWN, HandMotion
from palpate.device import array_model
from palpate.device.live.ring import FrameRing
from palpate.device.registry import kind_of
from palpate.render import Palm, SamplingStrategy, render
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.drawn_log import LoggedPose
from palpate.render.live.instant import POSE_INTERVAL
from palpate.render.live.moment_slot import DRAWING, RESTING, WAITING, MomentSlot, MomentTap
from palpate.render.live.renderer_process import FRESH_NS, RAMP, LiveRenderer, LiveRendering, RendererSettings
from palpate.render.live.sources.messages import PoseMessage
from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.sampler import Sampler, sample_contours
from palpate.render.strategies.intersection_strategy import strategy_of

RATE = 10_000.0
LEAD = 6e-3
MS = 1_000_000  # [ns]
BEGAN = 5_000 * MS  # an instant of the clock [ns]


@functools.cache
def rendering(solid="tube", strategy="cc", **sampling):
    return LiveRendering(
        solid=solid_of(solid),
        hand=Palm(),
        strategy=strategy_of(strategy),
        sampling=SamplingStrategy(update_rate=RATE, **sampling),
        drive=DriveStrategy(),
    )


class Drawing:
    """A renderer on a clock of its own, with a ring that is emptied as it is filled."""

    def __init__(self, *renderings, intensity=1.0, slice_frames=40, slots=64, lead=LEAD):
        model = array_model("emulator")
        self.now_ns, self.records, self.slices = BEGAN, [], []
        self.ring = FrameRing([model.frame_bytes], frame_count=slice_frames, slot_count=slots)
        self.wake_fd = os.eventfd(0, os.EFD_NONBLOCK)
        self.settings = RendererSettings(
            renderings=renderings or (rendering(),),
            kinds=(kind_of(model),),
            arrays=(model,),
            lead=lead,
            intensity=intensity,
            first_number=1000,
            realtime=False,
            slice_frames=slice_frames,
            ring_fd=self.ring.fd,
            wake_fd=self.wake_fd,
            pose_fd=-1,
            control_fd=-1,
            log_fd=None,
            moment_fd=-1,
        )
        log = SimpleNamespace(add=self.records.append, flush=lambda: None)
        self.moments = MomentSlot()
        tap = MomentTap(self.moments, RATE)
        self.renderer = LiveRenderer(self.settings, self.ring, log, tap=tap, clock_ns=lambda: self.now_ns)

    def step(self, milliseconds=0.0):
        """Let time pass, draw, and take what was drawn as a writer does; returns when it wants to be called again."""
        self.now_ns += round(milliseconds * MS)
        next_ns = self.renderer.step()
        self.renderer.show()
        self.take()
        return next_ns

    def take(self):
        while (piece := self.ring.take()) is not None:
            first, count, number, stamp_ns, blocks, _ = piece
            data = None if blocks is None else bytes(blocks[0])
            self.slices.append((first, count, number, stamp_ns, data))
            self.ring.done()

    def feel(self, pose, age=4.0, **fields):
        """A pose comes that is so old [ms]."""
        message = PoseMessage(self.now_ns - round(age * MS), 0.0, pose, **fields)
        self.renderer.take([message])
        return message

    @property
    def poses(self):
        return [record for record in self.records if isinstance(record, LoggedPose)]

    @property
    def points(self):
        return [record for record in self.records if not isinstance(record, LoggedPose)]

    def require_sampled_again(self, own=None):
        """What was drawn is, bit for bit, what rendering and sampling the poses that were logged gives."""
        own = own or self.settings.renderings[0]
        points, first = self.points, 0
        for row in points:
            assert row.first == first
            first += len(row.intensity)
        position = np.concatenate([row.position for row in points]).reshape(first, -1, 3)
        intensity = np.concatenate([row.intensity for row in points])
        time = np.array([pose.first for pose in self.poses]) / RATE
        motion = HandMotion(time, np.array([pose.pose for pose in self.poses]))
        batch = render(own.solid, own.hand, motion, own.strategy)
        blocks = sample_contours(
            [batch],
            motion.pose,
            time,
            first / RATE,
            Sampler(own.sampling, revisits=False),
            hold=max(own.sampling.hold, 2 * POSE_INTERVAL),
        )
        again = list(blocks)
        np.testing.assert_array_equal(np.concatenate([row.position for row in again]).reshape(position.shape), position)
        np.testing.assert_array_equal(np.concatenate([row.intensity for row in again]), intensity)


@contextmanager
def drawing(*renderings, **fields):
    own = Drawing(*renderings, **fields)
    try:
        yield own
    finally:
        own.ring.close()
        own.moments.close()
        os.close(own.wake_fd)


def pose_at(x, z=0.2):
    return np.array([x, 0.0, z, *PALM_DOWN])


def move(own, seconds, *, rate=90.0, jitter=0.0, seed=0, speed=0.05):
    """Poses at a rate, their times off by a part of their interval, while the renderer is called each millisecond."""
    rng, start = np.random.default_rng(seed), own.now_ns
    due = [k / rate + rng.uniform(-0.5, 0.5) * jitter / rate for k in range(int(seconds * rate))]
    for k in range(int(seconds * 1e3)):
        while due and due[0] * 1e3 <= k:
            own.feel(pose_at(speed * due.pop(0)))
        own.step(start / MS + k - own.now_ns / MS)


def test_the_newest_pose_wins_and_takes_effect_at_the_first_sample_that_is_not_drawn():
    with drawing() as own:
        own.renderer.begin(None)
        own.step()
        assert own.slices == []  # no pose has come
        own.feel(pose_at(0))
        own.step()
        drawn = sum(piece[1] for piece in own.slices)
        assert drawn == (LEAD - 2e-3) * RATE  # sample 0 is due 2 ms after its pose: as far as the lead, no further
        own.feel(pose_at(0.001))
        newest = own.feel(pose_at(0.002))
        own.step(1)
        assert own.renderer.counts["superseded"] == 1
        assert [(pose.first, pose.number, pose.stamp_ns) for pose in own.poses[1:]] == [(drawn, 1001, newest.stamp_ns)]
        assert own.poses[1].pose[0] == np.float32(0.002)
        assert [piece[2] for piece in own.slices if piece[2] is not None] == [1000, 1001]
        own.require_sampled_again()


@pytest.mark.parametrize(("rate", "jitter"), [(90.0, 0.6), (60.0, 0.9), (1200.0, 0.5)])
def test_what_is_drawn_is_what_its_poses_give_when_they_are_rendered_and_sampled(rate, jitter):
    with drawing() as own:
        own.renderer.begin(None)
        move(own, 0.12, rate=rate, jitter=jitter)
        assert len(own.poses) > 5
        firsts = [piece[0] for piece in own.slices]
        assert firsts == list(np.cumsum([0, *(piece[1] for piece in own.slices)])[:-1])  # none left out, none twice
        own.require_sampled_again()


def test_slices_never_reach_further_than_the_lead():
    with drawing() as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        for k in range(30):
            next_ns = own.step(0.7)
            ahead_ns = own.ring.start_ns + sum(piece[1] for piece in own.slices) * 100_000 - own.now_ns
            assert ahead_ns <= LEAD * 1e9 + 100_000, k  # one sample more: the one that is due just before
            assert own.now_ns <= next_ns <= own.now_ns + 2 * MS


def test_what_is_late_after_a_stall_is_drawn_but_not_handed_over():
    with drawing() as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.step()
        own.step(1)
        before = sum(piece[1] for piece in own.slices)
        own.feel(pose_at(0.003))
        own.step(50)
        after = own.slices[-1][0] + own.slices[-1][1] - (own.slices[0][0] + before)
        handed = sum(piece[1] for piece in own.slices) - before
        late = next(piece[0] for piece in own.slices if piece[0] >= before + 1) - before
        assert after == handed + late
        assert late == 500 - 60  # 50 ms, less the lead that had been drawn
        assert own.poses[1].first == before + late  # the pose that came meanwhile begins with what is in time
        own.require_sampled_again()


def test_a_hand_that_is_lost_is_held_fades_and_is_silent_and_is_found_again():
    with drawing() as own:
        own.renderer.begin(None)
        move(own, 0.03)
        own.renderer.take([PoseMessage(own.now_ns, 0.0, None)])
        for _ in range(50):
            own.step(4)
        assert own.slices[-1][4] is None  # silent slices carry no frames
        assert own.slices[0][4] is not None
        own.feel(pose_at(0.001))
        own.step(1)
        assert own.slices[-1][4] is not None
        own.require_sampled_again()


def test_a_refused_first_pose_begins_nothing_and_a_later_one_leaves_the_one_before():
    bad = np.array([np.nan, 0, 0.2, *PALM_DOWN])
    with drawing() as own:
        own.renderer.begin(None)
        own.feel(bad)
        own.step()
        assert own.renderer.base is None
        assert own.slices == []
        own.feel(pose_at(0))
        own.step(1)
        own.feel(bad)
        own.step(1)
        own.feel(pose_at(0), patch_pose=np.zeros((2, 7), np.float32))
        own.step(1)
        assert own.renderer.counts["refused"] == 3
        assert own.renderer.counts["drawn"] == len(own.poses) == 1
        assert ["finite" in fault or "patch_pose" in fault for fault in own.renderer.faults] == [True] * 3
        own.step(1)
        assert own.slices[-1][4] is not None
        own.require_sampled_again()


def test_a_new_intensity_is_reached_in_ten_milliseconds_and_a_stop_fades_as_long():
    with drawing(intensity=0.5) as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.step()
        assert {float(value) for row in own.points for value in row.gain} == {0.5}
        own.renderer.set_intensity(1.0)
        for _ in range(8):
            own.step(1)
        gain = np.concatenate([row.gain if row.gain is not None else np.ones(len(row.intensity)) for row in own.points])
        rising = gain[(gain > 0.5) & (gain < 1.0)]
        assert len(rising) == 0.5 * RAMP * RATE - 1
        np.testing.assert_allclose(np.diff(rising), 1 / (RAMP * RATE), atol=1e-6)
        assert own.points[-1].gain is None  # 1 throughout
        own.renderer.stop()
        assert own.renderer.stopped_at is None
        own.renderer.set_intensity(1.0)  # does not keep it from stopping
        for _ in range(30):
            own.step(1)
        stopped = own.renderer.stopped_at
        assert stopped == own.slices[-1][0] + own.slices[-1][1]
        falling = np.concatenate([row.gain for row in own.points if row.gain is not None])[-110:]
        assert (np.diff(falling) <= 0).all()
        assert falling[-1] == 0
        own.feel(pose_at(0.01))
        own.step(20)
        assert own.renderer.stopped_at == stopped  # nothing is drawn any more
        own.require_sampled_again()


def test_after_a_rest_a_run_begins_with_sample_0_and_the_intensity_that_was_set_meanwhile():
    with drawing() as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.step()
        own.renderer.stop()
        for _ in range(20):
            own.step(1)
        own.renderer.rest()
        own.renderer.set_intensity(0.25)
        own.feel(pose_at(0.001))
        own.feel(pose_at(0.002))
        assert own.renderer.counts["superseded"] == 0  # between runs no pose counts
        own.step(FRESH_NS / MS + 10)
        assert own.renderer.base is None
        own.records.clear()
        own.slices.clear()
        own.ring.start_ns = 0
        own.renderer.begin(None)
        own.step()
        assert own.slices == []  # the pose from before is too old
        own.feel(pose_at(0.003))
        own.step()
        assert own.slices[0][0] == own.poses[0].first == own.renderer.base == 0
        assert own.poses[0].number > 1000
        assert float(own.points[0].gain[0]) == 0.25
        own.require_sampled_again()


def test_a_stop_before_the_first_pose_is_a_stop():
    with drawing() as own:
        own.renderer.begin(None)
        own.step()
        own.renderer.stop()
        assert own.renderer.stopped_at == 0
        own.feel(pose_at(0))
        own.step(1)
        assert own.slices == []


def test_what_takes_over_begins_where_the_other_one_stopped_and_rises():
    with drawing() as own:
        own.ring.start_ns = own.now_ns - 100 * MS
        own.renderer.begin(1000)  # of which the last was due now: too late for what is drawn now
        own.feel(pose_at(0))
        own.step()
        base = own.renderer.base
        assert base == 1000 + LEAD * RATE  # what is drawn at all is drawn within the lead
        own.step(1)
        assert own.slices[0][0] == base
        assert own.points[0].first == 0
        assert own.points[0].gain[0] == pytest.approx(1 / (RAMP * RATE))
        own.require_sampled_again()


def test_what_takes_over_before_the_other_one_began_begins_a_run():
    """Else the writer would wait for a start that nobody sets."""
    with drawing() as own:
        own.renderer.begin(0)
        own.feel(pose_at(0))
        own.step()
        assert own.renderer.base == own.slices[0][0] == 0
        assert own.ring.start_ns == own.now_ns + 2 * MS


def test_more_samples_than_a_slice_has_are_cut_and_a_full_ring_is_counted():
    with drawing(slice_frames=7, slots=4) as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.renderer.step()  # 40 samples, which nobody takes
        assert own.renderer.counts["slices_lost"] == 2
        own.take()
        assert [piece[:2] for piece in own.slices] == [(0, 7), (7, 7), (14, 7), (21, 7)]
        own.step(1)
        own.require_sampled_again()  # what was lost was drawn


def test_without_a_viewer_nothing_is_copied_and_with_one_the_newest_pose_as_it_is_rendered():
    with drawing(rendering(), rendering("cube", "corners")) as own:
        own.renderer.begin(None, index=1)
        own.step()
        assert own.moments.noted()[0] == WAITING
        move(own, 0.1)
        assert own.moments.copied == 0
        for count in (1, 2):
            own.moments.ask(own.now_ns)
            own.feel(pose_at(0.03 * count))
            own.step(40)
            read, last = own.moments.read(), own.poses[-1]
            assert (own.moments.copied, read.number, read.index) == (count, count, 1)
            assert read.pose[:3] == last[:3]
            own_rendering = own.settings.renderings[1]
            again = render(own_rendering.solid, Palm(), last.pose[None], own_rendering.strategy)
            given, found = again.arrays(), read.contours.arrays()
            assert given.keys() == found.keys()
            for name, value in given.items():
                np.testing.assert_array_equal(found[name], value)
        assert len(read.contours.points) > 4
        assert read.time * RATE == own.points[-1].first + len(own.points[-1].intensity)
        due_ns = own.ring.start_ns + last.first * MS // 10
        assert own.moments.noted() == (DRAWING, False, due_ns)
        own.renderer.take([PoseMessage(own.now_ns, 0.0, None)])
        own.step(1)
        assert own.moments.noted() == (DRAWING, True, due_ns)
        own.feel(pose_at(0))
        own.step(1)
        assert own.moments.noted()[1] is False


def test_a_viewer_sees_the_focal_points_that_are_handed_over():
    with drawing(intensity=0.5) as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.step()
        own.moments.ask(own.now_ns)
        own.step(0)
        for _ in range(60):
            own.feel(pose_at(0))
            own.moments.ask(own.now_ns)
            own.step(1)
        focus = own.moments.read().focus
        drawn = np.concatenate([row.position for row in own.points])
        last = round(own.moments.read().time * RATE)
        np.testing.assert_array_equal(focus.position, drawn[last - len(focus.position) : last])
        assert len(focus.position) == round(RATE / 30)
        assert set(focus.intensity.tolist()) == {0.5}


def test_a_viewer_is_told_that_nothing_is_drawn_any_more():
    with drawing() as own:
        own.renderer.begin(None)
        own.feel(pose_at(0))
        own.moments.ask(own.now_ns)
        own.step()
        assert own.moments.noted()[0] == DRAWING
        own.renderer.stop()
        for _ in range(20):
            own.step(1)
        assert own.moments.noted()[0] == RESTING
        copied = own.moments.copied
        own.renderer.rest()
        own.renderer.begin(None)
        own.moments.ask(own.now_ns)
        own.step(40)
        assert own.moments.noted()[0] == WAITING
        assert own.moments.copied == copied
        assert own.moments.read() is None  # that of the run before is not shown again
