"""What a live run does, appended to files while it runs, so that a killed run keeps all that was drawn until then.

| file | holds |
|---|---|
| description.json | what is rendered and how; written first |
| hand.npz | arrays of the hand |
| poses · position · intensity · gain | a row for each pose, or for each sample |
| marks · emitted | a row for each span of samples not emitted as sampled · for each pose that was emitted |
| events | a line of JSON for each event |

Rows go to the system at once, so a killed process loses none. A thread of its own brings them to the disk, at most once
a second, so nobody waits for the disk. A row that is not whole is the last one of its file, and is left out.
"""

import contextlib
import json
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.errors import ContourFileError
from ...datasets.json_text import read_json
from ...datasets.storage.durable import FolderLock, discard_tree, write_file
from ..hands.hand import Hand
from ..hands.plane_hand import PlaneHand
from ..hands.stored_hand import hand_from
from ..objects.solid import Solid
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy
from ..trust.permission import AllowCode
from .recording import LiveSegment, event_lines, events_of, save_segment

SYNC_INTERVAL = 1.0  # [s]; a power cut loses what is younger
SAMPLE_FILES = ("position", "intensity", "gain")
FILES = ("poses", *SAMPLE_FILES, "marks", "emitted", "events")
FIELDS = ("hold", "source", "array", "lead", "realtime", "emission")
"""Of a LiveSegment, which the description has as they are."""
MARK = np.dtype([("first", "<i8"), ("count", "<i8"), ("mark", "<i8")])
EMITTED = np.dtype([("number", "<i8"), ("time", "<f8")])


def pose_row(patches: int) -> np.dtype:
    """A pose's row in its file, with the poses of so many patches."""
    own: list[Any] = [("first", "<i8"), ("number", "<i8"), ("stamp", "<f8"), ("pose", "<f4", 7)]
    return np.dtype([*own, ("patch_pose", "<f4", (patches, 7))] if patches else own)


@dataclass(frozen=True)
class SpoolDescription:
    """What is rendered and how: everything of a LiveSegment that is known before its first pose."""

    solid: Solid
    hand: Hand
    """An articulated hand of planes is kept as rigid, since its poses come with the run."""
    strategy: IntersectionStrategy
    sampling: SamplingStrategy
    fields: dict[str, Any]
    patches: int
    """Of an articulated hand of planes, otherwise 0."""

    def write(self, folder: Path) -> None:
        """Write the files of the description; its text last, as the others are of no use without it."""
        arrays = BytesIO()
        np.savez(arrays, **self.hand.arrays())
        write_file(folder / "hand.npz", arrays.getbuffer())
        text = {
            "object": self.solid.described(),
            "hand": self.hand.described(),
            "strategy": self.strategy.described(),
            "sampling": self.sampling.described(),
            "patches": self.patches,
            **self.fields,
        }
        write_file(folder / "description.json", json.dumps(text).encode())

    @classmethod
    def read(cls, folder: Path, solid: Solid, *, allow_code: AllowCode) -> "SpoolDescription":
        """Read the files back; raises ContourFileError where they cannot be, or `solid` is another object."""
        try:
            text = read_json(folder / "description.json", allow_nan=True)
            if json.loads(json.dumps(solid.described())) != text["object"]:
                raise ContourFileError(f"{folder}: the run was of another object, {text['object'].get('name')!r}")
            with np.load(folder / "hand.npz", allow_pickle=False) as arrays:
                hand = hand_from(text["hand"], dict(arrays))
            strategy = IntersectionStrategy.from_json(json.dumps(text["strategy"]), allow_code=allow_code)
            sampling = SamplingStrategy.from_json(json.dumps(text["sampling"]))
            return cls(solid, hand, strategy, sampling, {name: text[name] for name in FIELDS}, int(text["patches"]))
        except (OSError, ValueError, TypeError, AttributeError, LookupError) as error:
            raise ContourFileError(f"{folder} is no folder of a live run that can be read: {error}") from error


class LiveSpool:
    """Files of one live run of one object, hand, strategy and sampling, in a folder of their own.

    folder: made anew. fields: FIELDS of a LiveSegment. For one thread.
    Raises ContourFileError, also from every method, for a folder that is there or cannot be written.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        solid: Solid,
        hand: Hand,
        strategy: IntersectionStrategy,
        sampling: SamplingStrategy,
        **fields: Any,
    ) -> None:
        self.folder = Path(folder)
        patches = 0
        if isinstance(hand, PlaneHand) and hand.pose_count is not None:
            hand, patches = replace(hand, patch_pose=None), hand.patch_count
        self.description = SpoolDescription(solid, hand, strategy, sampling, fields, patches)
        self.samples = 0
        """Samples so far."""
        self._row = pose_row(self.description.patches)
        self._files: dict[str, FileIO] = {}
        with _failures(self.folder), contextlib.ExitStack() as opened:
            self.folder.mkdir(mode=0o700)
            self._lock = FolderLock(self.folder)
            opened.callback(self._lock.release)
            for name in FILES:
                self._files[name] = opened.enter_context(FileIO(str(self.folder / name), "ab"))
            self.description.write(self.folder)
            opened.pop_all()  # `close` closes them
        self._dirty, self._ended = threading.Event(), threading.Event()
        self._syncer = threading.Thread(target=self._sync_often, name="live spool", daemon=True)
        self._syncer.start()

    def add_pose(
        self, first: int, number: int, stamp: float, pose: np.ndarray, patch_pose: np.ndarray | None = None
    ) -> None:
        """A pose that was taken: its first sample, its number in `add_emitted`, when the hand was there [s]."""
        row = np.zeros(1, self._row)
        row["first"], row["number"], row["stamp"], row["pose"] = first, number, stamp, pose
        if self.description.patches:
            row["patch_pose"] = patch_pose
        self._append("poses", row.tobytes())

    def add_samples(
        self, first: int, position: np.ndarray, intensity: np.ndarray, gain: np.ndarray | None = None
    ) -> None:
        """Focal points from sample `first` on, which follows the samples before; arrays as in LiveSegment."""
        count, foci = len(intensity), self.description.sampling.foci
        if first != self.samples or np.size(intensity) != count * foci or np.size(position) != 3 * count * foci:
            raise ContourFileError(
                f"{self.folder}: {count} samples of {foci} foci from {self.samples} on are next, not arrays of "
                f"{np.size(position)} and {np.size(intensity)} values from {first} on"
            )
        gain = np.ones(count, np.float32) if gain is None else gain
        for name, rows in zip(SAMPLE_FILES, (position, intensity, gain), strict=True):
            self._append(name, np.ascontiguousarray(rows, "<f4").tobytes())
        self.samples += count

    def add_mark(self, first: int, count: int, mark: int) -> None:
        """Samples from `first` on that were not emitted as sampled: DROPPED, HELD or FADED."""
        self._append("marks", np.array([(first, count, mark)], MARK).tobytes())

    def add_emitted(self, number: int, time: float) -> None:
        """When the first focal point of the pose of a number was emitted [s]."""
        self._append("emitted", np.array([(number, time)], EMITTED).tobytes())

    def add_event(self, time: float, kind: str, text: str) -> None:
        """Something that happened; time [s]."""
        self._append("events", event_lines([(time, kind, text)]))

    def close(self) -> None:
        """End the thread and let others finish the folder; closing twice does nothing."""
        self._ended.set()
        self._dirty.set()
        self._syncer.join()
        for file in self._files.values():
            file.close()
        self._lock.release()

    def finish(self, path: str | Path, *, overwrite: bool = False) -> Path | None:
        """Make the file of the run and remove the folder; returns the path, or None where nothing was drawn."""
        self.close()
        return _finish(self.folder, self.description, Path(path), overwrite=overwrite)

    def _append(self, name: str, content: bytes) -> None:
        rest = memoryview(content)
        with _failures(self.folder):
            while rest:
                rest = rest[self._files[name].write(rest) or 0 :]
        self._dirty.set()

    def _sync_often(self) -> None:
        while not self._ended.is_set():
            self._dirty.wait()
            self._dirty.clear()
            for file in self._files.values():
                with contextlib.suppress(OSError, ValueError):  # what fails here fails in `finish`, which reports it
                    os.fsync(file.fileno())
            self._ended.wait(SYNC_INTERVAL)


def finish_spool(
    folder: str | Path, path: str | Path, solid: Solid, *, allow_code: AllowCode = False, overwrite: bool = False
) -> Path | None:
    """Make the file of a live run that was killed, of what it left in its folder, and remove the folder.

    solid: the object that was rendered. allow_code: as in `load_strategy`.
    Returns the path, or None where the run drew nothing. Raises ContourFileError for a folder of a run that goes on, or
    that cannot be read, for another object, and as `save_segment`.
    """
    description = SpoolDescription.read(Path(folder), solid, allow_code=allow_code)
    return _finish(Path(folder), description, Path(path), overwrite=overwrite)


def spooled_segment(folder: Path, description: SpoolDescription) -> LiveSegment | None:
    """The run that a folder's whole rows are of; None where nothing was drawn. Samples stay on the disk."""
    foci = description.sampling.foci
    shapes = {"position": (foci, 3) if foci > 1 else (3,), "intensity": (foci,) if foci > 1 else (), "gain": ()}
    rows = {name: _rows(folder / name, np.dtype(("<f4", shape))) for name, shape in shapes.items()}
    count = min(map(len, rows.values()))
    poses = _rows(folder / "poses", pose_row(description.patches))
    poses = poses[poses["first"] < count]
    if not len(poses):
        return None
    emitted = dict(_rows(folder / "emitted", EMITTED).tolist())
    mark = np.zeros(count, np.uint8)
    for first, length, value in _rows(folder / "marks", MARK).tolist():
        mark[max(first, 0) : max(first + length, 0)] = value
    lines = (folder / "events").read_bytes()
    return LiveSegment(
        solid=description.solid,
        hand=description.hand,
        strategy=description.strategy,
        sampling=description.sampling,
        time=poses["first"] / description.sampling.update_rate,
        pose=np.ascontiguousarray(poses["pose"]),
        patch_pose=np.ascontiguousarray(poses["patch_pose"]) if description.patches else None,
        stamp=np.ascontiguousarray(poses["stamp"]),
        emitted=np.array([emitted.get(number, np.nan) for number in poses["number"].tolist()]),
        position=rows["position"][:count],
        intensity=rows["intensity"][:count],
        gain=None if (rows["gain"][:count] == 1.0).all() else rows["gain"][:count],
        mark=mark,
        events=events_of(lines[: lines.rfind(b"\n") + 1]),
        **description.fields,
    )


def _finish(folder: Path, description: SpoolDescription, path: Path, *, overwrite: bool) -> Path | None:
    with _failures(folder):
        lock = FolderLock(folder)
    try:
        with _failures(folder):
            segment = spooled_segment(folder, description)
        made = None if segment is None else save_segment(path, segment, overwrite=overwrite)
        discard_tree(folder)
        return made
    finally:
        lock.release()


def _rows(path: Path, row: np.dtype) -> np.ndarray:
    """The whole rows of a file, which stay on the disk."""
    count = path.stat().st_size // row.itemsize
    if count == 0:
        return np.zeros(0, row)
    base, shape = row.subdtype or (row, ())
    return np.memmap(path, base, "r", shape=(count, *shape)).view(np.ndarray)


@contextlib.contextmanager
def _failures(folder: Path) -> Iterator[None]:
    """Errors of the system as a ContourFileError that names the folder."""
    try:
        yield
    except BlockingIOError:
        raise ContourFileError(f"{folder}: its live run goes on, or another process finishes it") from None
    except (OSError, ValueError) as error:
        raise ContourFileError(f"{folder}: cannot be used for a live run: {error}") from error
