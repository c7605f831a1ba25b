"""The process that draws: the newest pose becomes contours, focal points and frames, no further ahead than wanted.

It draws in slices of a millisecond up to `lead` ahead of the present, and at once when a pose comes. So a pose takes
effect at the first sample that was not drawn before, and nothing that was drawn is ever replaced. While no pose comes,
the last one is held, fades and is silent, as `SamplingStrategy.hold` and `.fade` say.

| told | |
|---|---|
| `go` | begin rendering `index` with the next pose; `base`: its first sample in the ring, None where a run begins |
| `listen` | take poses of the source already, so that the last one is known |
| `intensity` | of all focal points from now on, 0..1; reached within 10 ms |
| `stop` | fade within 10 ms, then draw nothing more; `hands_over`: leave the source's poses to another process |
| `end` | the end of the process |

| tells | |
|---|---|
| `ready` | prepared: how long a pose takes, and whether the process is scheduled in real time |
| `poses` | counts of poses that were drawn, superseded, refused or lost, a few times a second |
| `fault` | what is wrong with the source or a pose |
| `began` | the number of the first sample in the ring |
| `stopped` | the number of the first sample in the ring that was not drawn |
| `failed` | kind of the error and its sentence |
"""

import json
import os
import pickle
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...datasets.errors import DatasetError
from ...datasets.motions.hand_motion import PALM_DOWN
from ...device.array import ArrayModel
from ...device.array_kind import ArrayKind
from ...device.live.realtime import RENDERER_PRIORITY, enter_realtime, stop_collecting
from ...device.live.ring import FrameRing
from ...device.playing.limits import Dose, Guard, Limits
from ...device.registry import array_kinds, register_array
from ..errors import RenderError
from ..hands.hand import Hand
from ..hands.plane_hand import PlaneHand
from ..objects.solid import Solid
from ..playback.drive import Driver, DriveStrategy
from ..runtime.warp_start import start_warp
from ..sampling.metrics import FocalPoints
from ..sampling.strategy import SamplingStrategy
from ..stages.registry import known_stages, register_stage
from ..strategies.intersection_strategy import IntersectionStrategy
from .drawn_log import DrawnLog, LoggedPoints, LoggedPose
from .instant import POSE_INTERVAL, Instant, checked_pose
from .moment_slot import DRAWING, RESTING, WAITING, MomentSlot, MomentTap
from .sources.messages import PoseMessage, received_messages
from .sources.shipped_settings import unship

SLICE_NS = 1_000_000  # between slices while no pose comes
FRESH_NS = 30_000_000  # a pose so young is where the hand is
START_NS = 2_000_000  # from the first pose to sample 0
RAMP = 10e-3  # [s] in which an intensity changes
STATE_PERIOD = 0.25  # [s]
TRIED_POSES = 40
SLOW_SHARE = 0.15  # of the lead that a pose takes, from which on samples of the pose before go first
DRAIN_TIMEOUT = 3.0  # [s] that a reader of records has at the end
QUICK_SHARE = 0.5  # of the lead that a pose may take


@dataclass(frozen=True, kw_only=True)
class LiveRendering:
    """What is rendered."""

    solid: Solid
    hand: Hand
    strategy: IntersectionStrategy
    sampling: SamplingStrategy
    drive: DriveStrategy

    @property
    def hold(self) -> float:
        """Age from which a pose fades [s], as `Instant` has it."""
        return max(self.sampling.hold, 2.0 * POSE_INTERVAL)


@dataclass(frozen=True, kw_only=True)
class RendererSettings:
    """All that the process is started with."""

    renderings: tuple[LiveRendering, ...]
    kinds: tuple[ArrayKind, ...]
    arrays: tuple[ArrayModel, ...]
    lead: float
    intensity: float
    first_number: int
    """Of its poses; numbers of all processes of a run differ."""
    realtime: bool
    slice_frames: int
    ring_fd: int
    wake_fd: int
    pose_fd: int
    control_fd: int
    log_fd: int | None
    moment_fd: int
    """Memory for moments that a viewer shows."""


class LiveRenderer:
    """Draws poses into a ring; `step` is called when something came, or when it says so.

    tap: lets a viewer see what is drawn. clock_ns: gives the time [ns]; a test passes one of its own.
    """

    def __init__(
        self,
        settings: RendererSettings,
        ring: FrameRing,
        log: DrawnLog | None,
        *,
        tap: MomentTap,
        clock_ns: Any = time.monotonic_ns,
    ) -> None:
        self.counts = {
            "drawn": 0, "superseded": 0, "refused": 0, "skipped": 0, "slices_lost": 0, "frames_on": 0, "records_lost": 0
        }  # fmt: skip
        self.faults: list[str] = []
        self.is_lost = False
        """The tracker sees no hand, or its source has ended."""
        self._settings, self._ring, self._log, self._clock_ns = settings, ring, log, clock_ns
        self._tap = tap
        self._index = 0  # of the rendering
        self._last: LoggedPose | None = None  # the pose that is drawn
        (self._rate,) = {own.sampling.update_rate for own in settings.renderings}
        self._period_ns = round(1e9 / self._rate)
        self._lead_ns = round(settings.lead * 1e9)
        self._guards = [Guard(Limits(on_time_max=None, duty_max=None), model) for model in settings.arrays]
        self.base: int | None = None
        """Number in the ring of sample 0; None before it."""
        self._drawn = 0  # samples
        self._pose_number = settings.first_number
        self._newest: PoseMessage | None = None
        self._begun: tuple[int | None, int] = None, 0  # number and stamp of a pose none of whose samples was put
        self._pose_first = -1  # sample of the last pose
        self._intensity = self._wanted = self._gain = settings.intensity
        self._is_stopping = False
        self._was_silent = True
        self._asked_base: int | None = None
        self._is_waiting = False  # for the first pose, from which it draws
        self._is_slow = False  # whether a pose takes so long that the writer needs more samples before
        self._all = [self._made(own) for own in settings.renderings]
        self._instant, self._driver = self._all[0]

    def _made(self, own: LiveRendering) -> tuple[Instant, Driver]:
        instant = Instant(own.solid, own.hand, own.strategy, own.sampling)
        return instant, Driver(self._settings.arrays, own.drive, update_rate=self._rate)

    def try_poses(self) -> dict[str, float]:
        """Draw poses about the objects' middles, so that memory and code are there; how long the slowest takes [s]."""
        tried = [self._tried(own, *made) for own, made in zip(self._settings.renderings, self._all, strict=True)]
        p50, longest = np.max(tried, axis=0).tolist()
        self._is_slow = p50 > SLOW_SHARE * self._settings.lead
        return {"pose_seconds": p50, "pose_seconds_max": longest}

    def _tried(self, own: LiveRendering, instant: Instant, driver: Driver) -> tuple[float, float]:
        """Middle and longest duration of a pose [s]."""
        self._driver = driver
        middle = own.solid.bounds.mean(axis=0)
        rng, times = np.random.default_rng(0), []
        patch_pose = None
        if isinstance(own.hand, PlaneHand) and own.hand.patch_pose is not None:
            patch_pose = own.hand.patch_pose[0]
        count = max(1, SLICE_NS // self._period_ns)
        for number in range(TRIED_POSES):
            offset = np.diff(own.solid.bounds, axis=0)[0] * rng.uniform(-0.3, 0.3, 3)
            began = time.perf_counter()
            focus = instant.draw(
                np.array([*(middle + offset), *PALM_DOWN]),
                time=number * count / self._rate,
                until=(number + 1) * count / self._rate,
                patch_pose=patch_pose,
            )
            self._packed(focus)
            times.append(time.perf_counter() - began)
        instant.reset()
        driver.reset()
        warm = sorted(times[TRIED_POSES // 4 :])
        return warm[len(warm) // 2], warm[-1]

    def begin(self, base: int | None, index: int = 0) -> None:
        """Draw a rendering from the next pose on, or from one that is fresh."""
        self._instant, self._driver = self._all[index]
        self._index, self._last = index, None
        self._tap.begin()
        self.base, self._drawn, self._pose_first, self._asked_base = None, 0, -1, base
        self._gain = self._wanted = self._intensity
        self._is_waiting, self._is_stopping, self._was_silent = True, False, True
        if self._newest is not None and self._clock_ns() - self._newest.stamp_ns > FRESH_NS:
            self._newest = None

    def rest(self) -> None:
        """Be ready to begin again."""
        self.base, self._is_waiting = None, False
        for instant, driver in self._all:
            if instant.contours is not None:
                instant.reset()
                driver.reset()

    def stop(self) -> None:
        """Fade, then draw nothing more."""
        self._wanted, self._is_stopping = 0.0, True
        self._is_waiting = False  # a pose that comes now begins nothing

    def set_intensity(self, value: float) -> None:
        """Intensity of all focal points from now on, 0..1; while they fade to a stop, of those after the next start."""
        self._intensity = value
        if not self._is_stopping:
            self._wanted = value

    @property
    def stopped_at(self) -> int | None:
        """Number in the ring of the first sample that is not drawn any more, once all has faded."""
        if not self._is_stopping or (self.base is not None and self._gain > 0):
            return None
        return self._drawn + (self.base or 0)

    def take(self, messages: list[PoseMessage]) -> None:
        """Note what the source has sent: the newest pose wins."""
        for message in messages:
            self.counts["skipped"] += message.skipped
            if message.fault:
                self.faults.append(message.fault)
            if message.pose is not None:
                self.counts["superseded"] += self._newest is not None and self.base is not None
                self._newest = message
                self.is_lost = False
            elif message.is_lost:
                self.is_lost = True

    def step(self) -> int:
        """Draw what is wanted by now; returns when to be called again at the latest [ns]."""
        now_ns = self._clock_ns()
        if self._log is not None:
            self._log.flush()
        if self.base is None and not self._start(now_ns):
            return now_ns + round(STATE_PERIOD * 1e9)
        if self.stopped_at is not None:
            return now_ns + round(STATE_PERIOD * 1e9)
        if self._newest is not None and self._drawn > self._pose_first:
            if self._instant.contours is not None:
                # what is late is of the pose before; a slow pose is worked out while the writer has samples
                self._draw_until(now_ns, now_ns + self._lead_ns if self._is_slow else now_ns)
            self._meet(self._newest)
            now_ns = self._clock_ns()
        if self._instant.contours is None:  # the first pose was refused: wait for another
            self.base, self._is_waiting = None, True
            return now_ns + round(STATE_PERIOD * 1e9)
        self._draw_until(now_ns, now_ns + self._lead_ns)
        return self._start_ns + (self._drawn * self._period_ns) - self._lead_ns + SLICE_NS

    def _start(self, now_ns: int) -> bool:
        """Begin with the first pose; False while there is none."""
        if self._newest is None or not self._is_waiting:
            return False
        self._is_waiting = False
        if self._asked_base is None or not self._ring.start_ns:  # the second: nothing has been drawn by others yet
            self.base = 0
            self._ring.start_ns = now_ns + START_NS
        else:
            passed = -((self._ring.start_ns - now_ns - self._lead_ns) // self._period_ns)
            self.base, self._gain = max(self._asked_base, passed), 0.0
        self._start_ns = self._ring.start_ns + self.base * self._period_ns
        return True

    def _due(self, time_ns: int) -> int:
        """Samples that are due before a time [ns]."""
        return -((self._start_ns - time_ns) // self._period_ns)

    def _meet(self, message: PoseMessage) -> None:
        """Take a pose, from the next sample on; one that is refused leaves the pose before."""
        self._newest = None
        time = self._drawn / self._rate
        try:
            pose = settled_pose(message.pose)
            self._instant.draw(pose, time=time, until=time, patch_pose=message.patch_pose)
        except (RenderError, DatasetError) as error:
            self.counts["refused"] += 1
            self.faults.append(str(error))
            return
        self.counts["drawn"] += 1
        self._begun = self._pose_number, message.stamp_ns
        self._pose_first = self._drawn
        self._last = LoggedPose(self._drawn, self._pose_number, message.stamp_ns, pose, message.patch_pose)
        if self._log is not None:
            self._log.add(self._last)
        self._pose_number += 1

    def show(self) -> None:
        """Let a viewer see what is drawn, once all that is due has been handed to the writer."""
        state, due_ns, last = RESTING, 0, self._last
        if self.base is None:
            state = WAITING if self._is_waiting else RESTING
        elif last is not None and self.stopped_at is None:
            state, due_ns = DRAWING, self._start_ns + last.first * self._period_ns
        now_ns = self._clock_ns()
        if not self._tap.is_due(state, is_lost=self.is_lost, pose_due_ns=due_ns, now_ns=now_ns):
            return
        contours = self._instant.contours
        if last is not None and contours is not None:
            time = ((self.base or 0) + self._drawn) / self._rate
            self._tap.copy(last, contours, index=self._index, time=time, now_ns=now_ns)

    def _draw_until(self, now_ns: int, until_ns: int) -> None:
        """Draw what is due before a time [ns], and hand it over.

        What is late already is drawn, so that what follows is what it would have been, but not packed.
        """
        until, late = self._due(until_ns), self._due(now_ns)
        while self._drawn < until:
            is_late = self._drawn < late
            most = round(self._rate) if is_late else self._settings.slice_frames
            stop = min(late if is_late else until, self._drawn + most)
            focus = self._instant.go_on(stop / self._rate)
            first, self._drawn = self._drawn, stop
            gain = self._gains(stop - first)
            if self._log is not None:
                self._log.add(LoggedPoints(first, *focus, gain))
            if not is_late:
                self._put(first, focus, gain)

    def _gains(self, count: int) -> np.ndarray | None:
        """The person's intensity for the next samples; None where it is 1."""
        if self._gain == self._wanted == 1.0:
            return None
        step = (1.0 if self._wanted > self._gain else -1.0) / (RAMP * self._rate)
        ramp = self._gain + step * np.arange(1, count + 1)
        low, high = sorted((self._gain, self._wanted))
        gains = np.clip(ramp, low, high)
        self._gain = float(gains[-1])
        return gains.astype(np.float32)

    def _put(self, first: int, focus: FocalPoints, gain: np.ndarray | None) -> None:
        """Hand samples to the writer, no more than fit a slice."""
        if gain is not None:
            shaped = gain.reshape(-1, *[1] * (focus.intensity.ndim - 1))
            focus = focus._replace(intensity=focus.intensity * shaped)
        self._tap.add_points(focus)
        blocks, doses = None, []
        if focus.intensity.any():
            if self._was_silent:
                self._driver.reset()  # no frame comes from what was before the silence
            blocks, doses = self._packed(focus)
        self._was_silent = blocks is None
        self.counts["frames_on"] += 0 if blocks is None else len(focus.intensity)
        number, stamp_ns = self._begun
        is_put = self._ring.put(
            first + (self.base or 0), len(focus.intensity), blocks, doses, pose_number=number, stamp_ns=stamp_ns
        )
        self.counts["slices_lost"] += not is_put
        if is_put:
            self._begun = None, 0
            os.eventfd_write(self._settings.wake_fd, 1)

    def _packed(self, focus: FocalPoints) -> tuple[list[Any], list[Dose]]:
        """Wire bytes for each array, shape [frame, frame_bytes], and what they do."""
        blocks = [frames.numpy() for frames in self._driver.pack(focus).frames]
        return blocks, [guard.measure(own, len(own))[0] for guard, own in zip(self._guards, blocks, strict=True)]


def settled_pose(pose: np.ndarray) -> np.ndarray:
    """A pose as `motion_of` leaves it however often it is applied: a file's pose is checked again where it is drawn."""
    row = checked_pose(pose)
    for _ in range(4):
        again = checked_pose(row)
        if np.array_equal(again, row):
            break
        row = again
    return row


class _RendererProcess:
    """The process's loop: what comes from the source and from the parent."""

    def __init__(self, settings: RendererSettings) -> None:
        self._settings = settings
        self._control = socket.socket(fileno=settings.control_fd)
        self._control.setblocking(False)
        os.set_blocking(settings.pose_fd, False)
        self._is_ending = False
        self._listens = self._is_asked = self._is_stopping = False
        self._state_at = 0.0

    def run(self) -> None:
        own = self._settings
        try:
            ring = FrameRing([model.frame_bytes for model in own.arrays], frame_count=own.slice_frames, fd=own.ring_fd)
            self._log = log = None if own.log_fd is None else DrawnLog(own.log_fd)
            (rate,) = {rendering.sampling.update_rate for rendering in own.renderings}
            tap = MomentTap(MomentSlot(fd=own.moment_fd), rate)
            self._renderer = renderer = LiveRenderer(own, ring, log, tap=tap)
            cost = renderer.try_poses()
            is_realtime = own.realtime and enter_realtime(RENDERER_PRIORITY)
            stop_collecting()
            tell(self._control, "ready", realtime=is_realtime, **cost)
            self._loop(renderer)
            if log is not None:
                log.drain(DRAIN_TIMEOUT)
            self._tell_state(time.monotonic())
        except Exception as error:  # whatever it is, the parent is told: the writer switches off by itself
            tell(self._control, "failed", kind=type(error).__name__, text=str(error) or type(error).__name__)

    def _loop(self, renderer: LiveRenderer) -> None:
        own = self._settings
        while not self._is_ending:
            next_ns = renderer.step()
            renderer.show()
            if renderer.base is not None and self._is_asked:
                self._is_asked = False
                tell(self._control, "began", base=renderer.base)
            if (at := renderer.stopped_at) is not None and self._is_stopping:
                self._is_stopping = False
                renderer.rest()
                renderer.show()  # before it is told: who hears of it finds no moment of what has ended
                tell(self._control, "stopped", at=at)
            if (now := time.monotonic()) >= self._state_at:
                self._tell_state(now)
            watched = [own.control_fd, own.pose_fd] if self._listens else [own.control_fd]
            wait = max(next_ns - time.monotonic_ns(), 0) * 1e-9
            ready, _, _ = select.select(watched, [], [], min(wait, STATE_PERIOD))
            if own.control_fd in ready:
                self._obey()
            if own.pose_fd in ready:
                try:
                    renderer.take(received_messages(own.pose_fd))
                except EOFError:
                    self._listens = False
                    renderer.is_lost = True
                    renderer.faults.append("the source of poses has ended")

    def _obey(self) -> None:
        while not self._is_ending:
            try:
                data = self._control.recv(65536)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._is_ending = True
                return
            message = json.loads(data)
            match message["do"]:
                case "go":
                    self._listens = self._is_asked = True
                    self._renderer.begin(message["base"], message.get("index", 0))
                    self._renderer.show()  # before anything plays: who hears of the onset finds a moment
                case "listen":
                    self._listens = True
                case "intensity":
                    self._renderer.set_intensity(message["value"])
                case "stop":
                    self._renderer.stop()
                    self._is_stopping = True
                    self._listens = not message.get("hands_over", False)
                case "end":
                    self._is_ending = True

    def _tell_state(self, now: float) -> None:
        self._state_at = now + STATE_PERIOD
        if self._log is not None:
            self._renderer.counts["records_lost"] = self._log.lost
        faults, self._renderer.faults = self._renderer.faults, []
        for fault in dict.fromkeys(faults[:20]):
            tell(self._control, "fault", text=fault[:1000])
        tell(self._control, "poses", **self._renderer.counts)


def tell(control: socket.socket, event: str, **values: Any) -> None:
    """Send a message to the parent; one that it has no room for, or that nobody hears any more, is lost."""
    try:
        control.send(json.dumps({"event": event, **values}).encode())
    except OSError:
        return


def main() -> int:
    """Read the settings from standard input, and run."""
    for signum in (signal.SIGINT, signal.SIGHUP):  # the terminal's signals are for the process that started this one
        signal.signal(signum, signal.SIG_IGN)
    start_warp()
    # a pipe of our own, from the process that started this one
    control_fd, content = pickle.load(sys.stdin.buffer)
    try:
        stages, settings = unship(content)
        for entry in stages:
            if entry.name not in known_stages(entry.role):  # importing its module may have registered it
                register_stage(entry)
        for kind in settings.kinds:
            if kind not in array_kinds():
                register_array(kind)
    except Exception as error:  # of a user's module, perhaps
        tell(socket.socket(fileno=control_fd), "failed", kind=type(error).__name__, text=str(error))
        return 1
    _RendererProcess(settings).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
