"""Play a contour file: contours -> focal points -> drives -> frames -> the player."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..datasets.reader import ContourFile
from ..device.array import ArrayModel, array_model
from ..device.clock import Clock, MonotonicClock, VirtualClock
from ..device.codec import encode_frames
from ..device.emulator import EmulatorBackend
from ..device.player import Player
from ..device.pyusb import Backend
from ..device.report import PlayReport
from ..device.usb import UsbLink
from .contours import ContourBatch
from .drive import SOUND_SPEED, drive_focus
from .errors import PoseError, StrategyError
from .sampling import Sampler, SamplingStrategy, sample_bounds, sample_contours

CLOCKS: dict[str, Callable[[], Clock]] = {"monotonic": MonotonicClock, "virtual": VirtualClock}
FRAMES_MOST = 1e12  # a year at 40 kHz
BLOCK = 1024  # frames; 0.1 s at 10 kHz, 26 ms at 40 kHz: what Python needs a few milliseconds for


@dataclass(frozen=True)
class Playback:
    """What playing a file came to."""

    played: PlayReport
    sampler: Sampler
    refused: int
    """Focal points outside the array's focal zone: silenced."""

    def as_dict(self) -> dict:
        """Everything, for JSON: the player's report, and the sampler's counts."""
        count = self.sampler.count
        return {
            **self.played.as_dict(),
            "jumps": sum(count.jumps.values()),
            "jumps_by_cause": count.jumps,
            "jump_length": count.jump_length,
            "jump_threshold": self.sampler.strategy.jump_threshold,
            "step_longest": count.step_longest,
            "samples": count.samples,
            "silent": count.silent,
            "held": count.held,
            "refused": self.refused,
            "revisit_rate": count.revisit_rate,
            "sampling": asdict(self.sampler.strategy),
        }


class FrameSource:
    """Wire bytes of a contour file, block by block, made as they are taken."""

    def __init__(
        self, file: ContourFile, array: ArrayModel, sampler: Sampler, duration: float | None, sound_speed: float
    ) -> None:
        motion = file.motion()
        self._file, self._array, self._sampler, self._sound_speed = file, array, sampler, sound_speed
        self._pose = motion["pose"]
        self._time, self.duration = play_times(motion.get("time"), len(self._pose), duration, file.path)
        self.frame_count = frame_count(self._time, self.duration, sampler.strategy, file.path)
        """Frames that it will make."""
        self.refused = 0

    def _batches(self) -> Iterator[ContourBatch]:
        for first, stop in self._file.blocks():
            if first >= len(self._time):
                return
            batch = ContourBatch.from_arrays(self._file.contours(first, stop))
            yield batch.select(0, min(stop, len(self._time)) - first)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Blocks of frames, uint8, shape [frame, frame_bytes]."""
        pose = self._pose[: len(self._time)]
        for focus in sample_contours(self._batches(), pose, self._time, self.duration, self._sampler, block=BLOCK):
            drives = drive_focus(focus, self._array, sound_speed=self._sound_speed)
            self.refused += drives.refused
            yield encode_frames(drives.delay, drives.amplitude, array=self._array.name)


def play_times(
    time: np.ndarray | None, pose_count: int, duration: float | None, path: Path
) -> tuple[np.ndarray, float]:
    """Times of the poses that are played, and when the last of them ends [s].

    A motion of one pose, or without time, is one static pose only if it is one: more poses without time are refused.
    """
    if duration is not None and not (np.isfinite(duration) and duration > 0):
        raise StrategyError(f"duration must be positive, not {duration} s")
    if time is None or pose_count == 1:
        if pose_count > 1:
            raise PoseError(f"{path}: has {pose_count} poses without times, which cannot be played")
        if duration is None:
            raise StrategyError(f"{path}: holds one static pose: say how long to play it with --duration")
        return np.zeros(1), duration
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise PoseError(f"{path}: /motion/time does not increase all the way; palpate check tells where")
    end = float(time[-1] + np.median(np.diff(time)))
    end = end if duration is None else min(end, duration)
    return time[time < end], end


def frame_count(time: np.ndarray, duration: float, sampling: SamplingStrategy, path: Path) -> int:
    """Frames of a playback; refused where there is none, or more than a count can hold."""
    if duration * sampling.update_rate > FRAMES_MOST:
        raise StrategyError(f"{path}: {duration:g} s at {sampling.update_rate:g} Hz is over {FRAMES_MOST:g} frames")
    count = int(sample_bounds(time, duration, sampling.update_rate)[-1])
    if count == 0:
        raise StrategyError(f"{path}: {duration:g} s at {sampling.update_rate:g} Hz is not one frame")
    return count


def play_file(
    path: str | Path,
    *,
    array: str = "emulator",
    serial: str | None = None,
    sampling: SamplingStrategy | None = None,
    duration: float | None = None,
    sound_speed: float = SOUND_SPEED,
    clock: str = "monotonic",
    backend: Backend | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Playback:
    """Play a contour file to an array; the array is off when this returns or raises.

    duration: how long [s]; a motion ends by itself, a static pose does not. clock: of the emulated array, "monotonic"
    or "virtual" (as fast as it goes). backend: pyusb's, by default the embedded emulated bus for the emulator.
    progress: called with frames taken and frames in all.
    Raises ContourFileError, PoseError, StrategyError before anything is sent; DeviceError (with `report`) and
    PlayInterrupted while playing.
    """
    model = array_model(array)
    sampler = Sampler(sampling or SamplingStrategy())
    model.divider(sampler.strategy.update_rate)
    if clock not in CLOCKS:
        raise StrategyError(f"unknown clock {clock!r}; known: {', '.join(CLOCKS)}")
    if backend is None and model.embedded:
        backend = EmulatorBackend(clock=CLOCKS[clock]())
    with ContourFile(path) as file:
        if not file.sealed:
            raise StrategyError(f"{path}: is not finished and cannot be played; palpate render --resume finishes it")
        source = FrameSource(file, model, sampler, duration, sound_speed)
        total = source.frame_count
        with UsbLink.open(model, serial=serial, backend=backend) as link:
            player = Player(link)
            report = player.play(
                source,
                update_rate=sampler.strategy.update_rate,
                progress=None if progress is None else lambda frames: progress(frames, total),
            )
        return Playback(report, sampler, source.refused)
