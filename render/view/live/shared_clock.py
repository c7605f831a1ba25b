"""The clock that all shown files share: which pose of each is shown, and how time goes on while it plays."""

from collections.abc import Sequence

from ..file_scene import FileScene
from ..focal_path import STILL

SPEEDS = {"1": 1.0, "1/3": 1 / 3, "1/10": 0.1, "1/100": 0.01, "1/1000": 1e-3, "1/10000": 1e-4}
"""Shown time over real time."""


class SharedClock:
    """Time of the first file [s], on whose poses the slider stands; the others show the pose of the same time.

    Files whose poses have no times show the pose of the same number, each for 0.05 s.
    """

    def __init__(self, scenes: Sequence[FileScene]) -> None:
        self._scenes = scenes
        self._are_timed = all(scene.has_time for scene in scenes)
        first = scenes[0]
        self.begin = self.time_of(0)
        """When the first pose begins [s]."""
        last = first.pose_count - 1
        pause = self.time_of(last) - self.time_of(last - 1) if last > 0 else STILL
        self.end = self.time_of(last) + pause
        """When the last pose ends [s], which lasts as long as the one before it."""
        self.now = self.begin
        self.is_playing = False
        self.speed = 1.0
        """Shown time over real time."""
        self._poses = [0] * len(scenes)
        self._pose_time: float | None = None
        self._sought, self._sought_time = 0, self.begin

    def time_of(self, pose: int) -> float:
        """When a pose of the first file begins [s]."""
        time = self._scenes[0].time_of(pose)
        return STILL * pose if time is None else time

    def poses(self) -> list[int]:
        """Number of the pose that each file shows now."""
        if self._pose_time != self.now:
            first = self._sought if self.now == self._sought_time else self._pose_in(self._scenes[0])
            self._poses = [first]
            for scene in self._scenes[1:]:
                self._poses.append(self._pose_in(scene) if self._are_timed else min(first, scene.pose_count - 1))
            self._pose_time = self.now
        return self._poses

    def _pose_in(self, scene: FileScene) -> int:
        if scene.has_time:
            return scene.pose_at(self.now)
        return min(max(int(self.now / STILL + 1e-9), 0), scene.pose_count - 1)

    def seek(self, pose: int) -> None:
        """Go to the beginning of a pose of the first file, the first or last one for a number beyond."""
        self._sought = min(max(pose, 0), self._scenes[0].pose_count - 1)
        self.now = self._sought_time = self.time_of(self._sought)

    def advance(self, seconds: float) -> None:
        """Let real time pass [s] while it plays; from the end it goes on at the beginning."""
        if self.is_playing:
            span = self.end - self.begin
            self.now = self.begin + (self.now - self.begin + self.speed * seconds) % span

    def share_of(self, file: int) -> float:
        """How far the shown pose of a file has gone, 0 to 1."""
        if file and not self._are_timed:
            return self.share_of(0)
        scene, pose = self._scenes[file], self.poses()[file]
        start = scene.time_of(pose)
        start = STILL * pose if start is None else start
        follows = scene.time_of(pose + 1) if pose + 1 < scene.pose_count else None
        stop = start + STILL if follows is None else follows
        return min(max((self.now - start) / (stop - start), 0.0), 1.0)
