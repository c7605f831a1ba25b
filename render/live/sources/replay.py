"""A motion, an exploration or a recording, played again in real time: a source of poses that needs no tracker."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from ....datasets.motions.hand_motion import HandMotion
from ....datasets.motions.last_pose import end_of_motion
from ....datasets.recordings.recording import HandRecording
from ....datasets.rigid import Numbers
from ...errors import PoseError
from .hand_frame import MONOTONIC, SeenHand

START_DELAY = 0.05  # [s] from the first request to the first pose: whatever the process still imports is done then

LATE_MOST = 0.1  # [s]


@dataclass(frozen=True, eq=False)
class ReplaySource:
    """Poses in the array's frame, each shown at its time; where a row is NaN, no hand is seen.

    >>> from palpate.render import exploration
    >>> from palpate.render.live.sources.replay import ReplaySource
    >>> ReplaySource.of_motion(exploration("cube", duration=2.0))
    ReplaySource(180 poses, 2 s)
    """

    time: Numbers
    """[s], shape [frame], strictly increasing."""
    pose: Numbers
    """Hand frame -> array frame, shape [frame, 7]."""
    joints: Numbers | None = None
    """OpenXR's joints in the array's frame, shape [frame, 26, 7]."""
    radius: Numbers | None = None
    """Of the joints [m], shape [frame, 26]."""
    side: str | None = None
    duration: float = 0.0
    """After this time it begins again, if it does [s]."""
    loops: bool = False
    """Whether it begins again after its end."""
    clock: str = MONOTONIC

    def __repr__(self) -> str:
        return f"ReplaySource({len(self.time)} poses, {self.duration:.6g} s{', again and again' * self.loops})"

    @classmethod
    def of_motion(cls, motion: HandMotion, *, loops: bool = False) -> Self:
        """The poses of a motion; raises PoseError for one without times."""
        if motion.time is None:
            raise PoseError(
                f"a motion without times cannot be played in real time, and {motion!r} has none: give a column time [s]"
            )
        pose = motion.pose.astype(np.float64)
        return cls(motion.time, pose, duration=end_of_motion(motion.time), loops=loops)

    @classmethod
    def of_recording(cls, recording: HandRecording, *, loops: bool = False) -> Self:
        """The palm and the joints of a recording in the array's frame, joints held over short gaps.

        Raises PoseError for static poses, which have no times.
        """
        if recording.time is None:
            raise PoseError(f"poses without times cannot be played in real time, and {recording!r} has none")
        held = recording.held()
        pose = np.full((len(held), 7), np.nan)
        pose[held.present] = held.skin_pose()
        radius = np.broadcast_to(held.joint_radius, held.joint_pose.shape[:2])
        side = "left" if held.is_left else "right"
        end = end_of_motion(recording.time)
        return cls(recording.time, pose, held.joint_pose, radius, side, end, loops)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is open."""

    def __iter__(self) -> Iterator[SeenHand]:
        """Frames at their times from now on."""
        start = time.monotonic() + START_DELAY - float(self.time[0])
        while True:
            for frame, at in enumerate(self.time.tolist()):
                wait = start + at - time.monotonic()
                if wait < -LATE_MOST:
                    continue  # this process was stopped: what is over is not played
                time.sleep(max(wait, 0.0))
                yield self.frame_at(frame, start + at)
            if not self.loops:
                time.sleep(max(start + self.duration - time.monotonic(), 0.0))
                return
            start += max(self.duration - float(self.time[0]), 1e-3)

    def frame_at(self, frame: int, at: float) -> SeenHand:
        """A frame by number, said to be seen at a time [s]."""
        pose = self.pose[frame]
        if np.isnan(pose).any():
            return SeenHand(at, self.side)
        if self.joints is None or self.radius is None:
            return SeenHand(at, self.side, "1", pose)
        return SeenHand(at, self.side, "1", pose, self.joints[frame], self.radius[frame])
