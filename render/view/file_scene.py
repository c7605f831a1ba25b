"""A contour file as a viewer shows it: one pose at a time, read when it is asked for, whatever the file's size."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ...datasets.contour_file.pose_rows import object_pose_at
from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.rigid import rotate, unit
from ..contour_batch import ContourBatch
from ..hands.stored_hand import HandLook, HandLooks
from ..sampling.strategy import SamplingStrategy


def tilts_of(pose: np.ndarray) -> np.ndarray:
    """Angle between the palm's skin and the array's face [rad], 0 where the palm faces the array; pose: [..., 7]."""
    up = rotate(unit(np.asarray(pose[..., 3:], np.float64)), np.array([0.0, 1.0, 0.0]))
    return np.arccos(np.clip(up[..., 2], -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Moment:
    """One pose of a file, as it is shown."""

    index: int
    time: float | None
    """When the pose begins [s]; None: the poses have no times."""
    hand_pose: np.ndarray
    """Hand frame -> array frame: position [m], quaternion xyzw; float32, shape [7]."""
    object_pose: np.ndarray | None
    """Where the object's middle is and how it is turned, float32, shape [7]; None: it is at rest."""
    hand: HandLook
    contours: ContourBatch
    """Of this pose only, on the host; empty where the pose is not rendered yet."""
    is_done: bool
    """The pose is rendered."""

    @property
    def length(self) -> float:
        """Of the contours [m]."""
        return float(self.contours.length()[0])

    @property
    def tilt(self) -> float:
        """Angle between the palm's skin and the array's face [rad], 0 where the palm faces the array."""
        return float(tilts_of(self.hand_pose))


class FileScene:
    """A contour file opened for a viewer; use it in a `with`, or `close()` it.

    Files that are still being written open, too: the poses that were done when the file was opened, or `refresh`ed,
    have contours. Raises ContourFileError for files that cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.file = file = ContourFile(self.path)
        self._inode = self._inode_now()
        try:
            self._read_constants(file)
        except BaseException:
            file.close()
            raise

    def _read_constants(self, file: ContourFile) -> None:
        self.pose_count = file.pose_count
        header = file.parts()[0]  # without the poses of an object that moves, which may be millions
        self.object_name: str = header.text("/object", "name")
        self.vertices: np.ndarray = header.read("/object/vertices")
        """Of the object where it was placed [m], float32, shape [vertex, 3]."""
        self.faces: np.ndarray = header.read("/object/faces")
        self.middle = (self.vertices.min(axis=0).astype(np.float64) + self.vertices.max(axis=0)) / 2
        """Of the object's box [m], which `Moment.object_pose` moves."""
        self.strategy = file.strategy
        self.has_time = "time" in file.motion(0, 1)
        self.looks = HandLooks(file)
        self.sampling = SamplingStrategy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    @property
    def is_sealed(self) -> bool:
        """The file is whole; False: it is still being written, or was interrupted."""
        return self.file.sealed

    @property
    def done_count(self) -> int:
        """Number of poses that are rendered."""
        return sum(stop - first for first, stop in self.file.done)

    def refresh(self) -> None:
        """Open an unfinished file again, so that poses done meanwhile have contours.

        Raises ContourFileError if another rendering is there by now.
        """
        if not self.file.sealed:
            before, file = self.file, ContourFile(self.path)
            if file.recipe != before.recipe:
                file.close()
                raise ContourFileError(f"{self.path}: is another rendering now; open it again")
            self.file, self._inode = file, self._inode_now()
            before.close()
            self.looks = HandLooks(self.file)

    def _inode_now(self) -> tuple[int, int] | None:
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    @property
    def is_replaced(self) -> bool:
        """Another file, or none, is at the path by now: what is shown is the old one."""
        return self._inode_now() != self._inode

    def is_done(self, index: int) -> bool:
        """Whether a pose is rendered."""
        return any(first <= index < stop for first, stop in self.file.done)

    def time_of(self, index: int) -> float | None:
        """When a pose begins [s]; None: the poses have no times."""
        return float(self.file.motion(index, index + 1)["time"][0]) if self.has_time else None

    def times(self, first: int, stop: int) -> np.ndarray:
        """When poses begin [s], float64; their numbers where they have no times."""
        motion = self.file.motion(first, stop)
        return motion["time"] if self.has_time else np.arange(first, stop, dtype=np.float64)

    def pose_at(self, time: float) -> int:
        """Number of the pose that is shown at a time [s], the first or last one outside the motion.

        Only as many times are read as a search by halves needs, and a block around the result.
        """
        low, high = 0, self.pose_count
        while high - low > 1:  # times increase: the pose is in low..high - 1
            middle = (low + high) // 2
            if self.times(middle, middle + 1)[0] <= time:
                low = middle
            else:
                high = middle
        return low

    def moment(self, index: int) -> Moment:
        """What is shown of a pose; raises ContourFileError for one that the file does not have."""
        motion = self.file.motion(index, index + 1)
        pose = motion["pose"][0]
        is_done = self.is_done(index)
        arrays = self.file.contours(index, index + 1) if is_done else _NOTHING
        return Moment(
            index=index,
            time=float(motion["time"][0]) if "time" in motion else None,
            hand_pose=pose,
            object_pose=object_pose_at(self.file, index),
            hand=self.looks.at(index, pose),
            contours=ContourBatch.from_arrays(arrays),
            is_done=is_done,
        )

    def bounds(self) -> np.ndarray:
        """Box of the object and of the palm's places in some poses [m], shape [2, 3]."""
        poses = np.unique(np.linspace(0, self.pose_count - 1, 200).astype(np.int64))
        places = np.concatenate([self.file.motion(int(i), int(i) + 1)["pose"][:, :3] for i in poses])
        if object_pose_at(self.file, 0) is not None:
            moved = [object_pose_at(self.file, int(i)) for i in poses]
            reach = np.linalg.norm(self.vertices - self.middle, axis=1).max(initial=0.0)
            middles = np.array([pose[:3] for pose in moved if pose is not None])
            places = np.concatenate([places, middles - reach, middles + reach])
        points = np.concatenate([places, self.vertices])
        return np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)


_NOTHING: dict[str, np.ndarray] = {
    "points": np.zeros((0, 3), np.float32),
    "kind": np.zeros(0, np.uint8),
    "polyline_start": np.zeros(1, np.int64),
    "polyline_patch": np.zeros(0, np.int32),
    "polyline_closed": np.zeros(0, np.uint8),
    "pose_start": np.zeros(2, np.int64),
}
