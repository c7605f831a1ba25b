"""Writing a contour file while it is computed, such that poses that were committed are never lost.

Poses that are written are held in memory; every ten seconds, or 256 MB, they are committed as a block, a whole HDF5
file in the work folder OUT.h5.partial (blocks.py); before the first block, the header is committed. `seal` passes
blocks and held poses through h5py into one file.

| OUT.h5 | header | blocks | what `mode="resume"` does                                              |
|--------|--------|--------|------------------------------------------------------------------------|
| no     | no     | no     | begins, as "create"                                                    |
| yes    | no     | no     | compares with OUT.h5; nothing is missing                               |
| any    | no     | yes    | refuses: it is unknown what the blocks belong to                        |
| yes    | same   | any    | killed after sealing: compares, nothing is missing, removes the folder |
| yes    | other  | any    | as the next line if the run may overwrite, else refuses                |
| no     | other  | any    | compares with the header, goes on with the poses missing               |

header, blocks: in the work folder; "same": its header is of the run that made OUT.h5; a file `overwrite` beside them
says that the run may replace OUT.h5.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import time
from collections.abc import Generator, Iterator, Mapping
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError, name_nothing
from ..storage.durable import TEMPORARY_SUFFIX, FolderLock, NewFile, discard_left, sync, temporary_files, write_file
from ..storage.hdf5_output import Hdf5Output, hdf5_output
from ..storage.schema import CONTOURS, HEADER, METRICS, validate_fields
from .blocks import (
    HEADER_NAME,
    PoseRows,
    block_files,
    block_like_files,
    optional_fields,
    work_folder,
    write_block,
    write_rows,
)
from .header import FileHeader, header_attributes, recipe_differences, recipe_hash
from .reader import ContourFile
from .timing import Timing, get_timing, join_timing, timing_of, write_timing

COMMIT_SECONDS = 10.0
"""Poses of a rendering that lasts longer are committed once in this time [s]."""
COMMIT_BYTES = 1 << 28
"""Poses that take more memory are committed."""

_OVERWRITE_NAME = "overwrite"


class ContourWriter:
    """Writes one contour file; the only writer of its path as long as it lives. For one thread at a time.

    What is committed lies in the work folder `OUT.h5.partial` until `seal()` makes OUT.h5 of it. Leaving the `with`,
    also by an exception, commits what is held and lets the next writer in.

    path: the file to make, OUT.h5. header: motion, object, hand, strategy and who renders. mode: "create" refuses an
    existing OUT.h5 or work folder; "resume" goes on where a writer with the same recipe stopped, or begins; "overwrite"
    begins anew, keeping an old OUT.h5 until the new one is sealed.
    Raises ContourFileError where the header is not valid; the path exists ("create"); the recipe differs ("resume",
    each differing field is named); another writer is at work; the disk is full or fails.

    >>> from palpate.datasets import ContourWriter
    >>> from palpate.render import ContourFile, render, static_pose
    >>> cube = ContourFile(render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True))
    >>> with ContourWriter("copy.h5", cube.header(), mode="overwrite") as writer:
    ...     writer.write(0, 1, cube.contours(), cube.metrics())
    ...     writer
    ContourWriter('copy.h5', 1 of 1 poses done, not sealed)
    """

    def __init__(
        self,
        path: str | PathLike[str],
        header: FileHeader,
        *,
        mode: Literal["create", "resume", "overwrite"] = "create",
    ) -> None:
        self.path = Path(path)
        self.repairs: tuple[str, ...] = ()
        """What resuming found damaged and dropped, a sentence each; those poses are missing again."""
        self._folder = work_folder(self.path)
        self._held: list[tuple[PoseRows, Timing]] = []
        self._held_bytes = 0
        self._committed: list[tuple[int, int]] = []
        self._committed_at = time.monotonic()
        self._complete = False
        self._new: NewFile | None = None
        self._lock: FolderLock | None = None
        header.validate()
        self._header = header
        self._is_written = np.zeros(header.pose_count, np.bool_)
        self._recipe = header.recipe  # hashes motion and mesh anew each time it is asked for
        self._recipe_hash = recipe_hash(self._recipe)
        self._refuse_existing(mode)
        with self._machine_failures("prepare"):
            self._begin(mode)

    def __repr__(self) -> str:
        """One line."""
        done = self._header.pose_count - sum(stop - first for first, stop in self.missing())
        state = "sealed" if self._complete else "not sealed"
        return f"ContourWriter({str(self.path)!r}, {done} of {self._header.pose_count} poses done, {state})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except ContourFileError:
            if error is None:  # else what has ended the block is told
                raise

    def close(self) -> None:
        """Commit what is held, and let other writers in. Closing twice does nothing.

        Raises ContourFileError where the disk is full or fails: what is held is lost then, what was committed stays.
        """
        if self._lock is None:
            return
        try:
            if not self._complete:
                self.commit()
        finally:
            if self._complete or not self._has_rendering():
                self._remove_folder()
            self._lock.release()
            self._lock = None

    def _has_rendering(self) -> bool:
        """Whether the work folder holds more than what a writer leaves that is killed before its first commit."""
        if not self._folder.is_dir():
            return False
        return (self._folder / HEADER_NAME).exists() or bool(block_like_files(self._folder))

    @property
    def committed(self) -> int:
        """Number of poses that are on the disk, whatever happens to this process."""
        return self._header.pose_count if self._complete else sum(stop - first for first, stop in self._committed)

    def missing(self) -> list[tuple[int, int]]:
        """Pose ranges (first, stop) that were not written yet, in pose order."""
        ends = np.flatnonzero(np.diff(self._is_written, prepend=True, append=True))
        return [] if self._complete else [(int(first), int(stop)) for first, stop in ends.reshape(-1, 2)]

    def write(
        self,
        first: int,
        stop: int,
        contours: Mapping[str, NDArray[Any]],
        metrics: Mapping[str, NDArray[Any]],
        timing: Mapping[str, float] | None = None,
    ) -> None:
        """Take the contours of poses `first` to `stop`; they are copied, and committed by a write ten seconds later.

        A write commits all that is held where the last commit was ten seconds ago or more, or 256 MB are held.

        Ranges may come in any order and of any size. first, stop: first pose of the range, and the pose after the last.
        contours: arrays of /contours by name, offsets from 0, points [m]; what is optional may be left out. metrics:
        arrays of /metrics by name, shape [pose], lengths [m]. timing: time spent by stage [s].
        Raises ContourFileError where the range or an array is not valid, or overlaps what was written (nothing is
        taken); the disk is full or fails (all that is held stays held, this range too, and the next write tries again).
        """
        self._refuse_closed()
        self._validate(first, stop, contours, metrics)
        rows = PoseRows(first, stop, _copied(contours), _copied(metrics))
        self._held.append((rows, timing_of(first, stop, timing or {})))
        self._held_bytes += sum(array.nbytes for array in (*rows.contours.values(), *rows.metrics.values()))
        self._is_written[first:stop] = True
        if self._held_bytes > COMMIT_BYTES or time.monotonic() - self._committed_at > COMMIT_SECONDS:
            self.commit()

    def commit(self) -> None:
        """Write what is held as blocks, one of each run of consecutive poses; when this returns, they are on the disk.

        Raises ContourFileError where the disk is full or fails; what could not be written is still held.
        """
        self._held.sort(key=lambda own: own[0].first)
        if self._held:
            with self._machine_failures("prepare to write"):
                self._write_header()
                self._remove_uncommitted()
        while self._held:
            count = next(
                (k for k in range(1, len(self._held)) if self._held[k][0].first != self._held[k - 1][0].stop),
                len(self._held),
            )
            rows = [own for own, _ in self._held[:count]]
            with self._machine_failures(f"write poses {rows[0].first} to {rows[-1].stop}"):
                write_block(self._folder, rows, join_timing([own for _, own in self._held[:count]]), self._recipe_hash)
            self._committed.append((rows[0].first, rows[-1].stop))
            del self._held[:count]
        self._held_bytes, self._committed_at = 0, time.monotonic()

    def seal(self, *, gzip: int = 0) -> None:
        """Make OUT.h5 of what was written, replacing an old one, and remove the work folder.

        One pass through h5py, in blocks of about a million points; what was committed is proven by its digests.

        gzip: 0 stores points as they are; 1 to 9 compress (25 % smaller, some 50 times slower).
        Raises ContourFileError where poses are missing; the disk has no room, or fails; a block is not what was
        written. What was committed stays.
        """
        if self._complete:
            return
        self._refuse_closed()
        if gaps := self.missing():
            count = sum(stop - first for first, stop in gaps)
            raise ContourFileError(f"{self.path} cannot be sealed: {count} poses are missing, from {gaps[0][0]} on")
        if gzip not in range(10):
            raise ContourFileError(f"gzip must be 0 to 9, got {gzip!r}")
        with self._machine_failures("seal"):
            self._seal(gzip)
        self._complete = True
        self._held.clear()
        self.close()

    def _seal(self, gzip: int) -> None:
        if self._new is not None and self._new.is_named:  # and then the sync of the folder failed
            self._new.publish()
            return
        self._remove_uncommitted()
        with NewFile(self.path) as self._new:
            with contextlib.ExitStack() as stack:
                file = stack.enter_context(ContourFile(self._folder)) if self._committed else None
                output = stack.enter_context(hdf5_output(self._new.temporary, gzip=gzip))
                _write_header(output, self._header)
                held = [own for own, _ in self._held]
                counts = {dim: sum(own.counts[dim] for own in held) for dim in ("pose", "polyline", "point")}
                optional, timing = set(optional_fields(held)), [own for _, own in self._held]
                if file is not None:
                    self._require_committed(file)
                    file.require_whole()
                    counts["pose"] += self.committed
                    counts["polyline"] += file.polyline_count
                    counts["point"] += file.point_count
                    optional |= set(file.optional)
                    timing += [get_timing(rows) for rows, _ in file.parts()[1]]
                write_rows(output, self._rows_of(file), counts, optional)
                write_timing(output, join_timing(sorted(timing, key=lambda own: own.first[:1].tolist())))
            self._refuse_stranger()

    def _require_committed(self, file: ContourFile) -> None:
        if lost := self.committed - sum(stop - first for first, stop in file.done):
            told = "; ".join(file.problems) or "somebody has removed them"
            raise ContourFileError(
                f"{self.path} cannot be sealed: {lost} poses that were committed are not in {self._folder} ({told}); "
                'mode="resume" renders them again'
            )

    def _rows_of(self, file: ContourFile | None) -> Iterator[PoseRows]:
        """All poses in order, those that were committed in bounded memory."""
        committed = [] if file is None else [(first, stop, None) for first, stop in file.blocks()]
        held = [(own.first, own.stop, own) for own, _ in self._held]
        for first, stop, rows in sorted([*committed, *held], key=lambda part: part[0]):
            if rows is None and file is not None:
                rows = PoseRows(first, stop, file.contours(first, stop), file.metrics(first, stop))
            if rows is not None:
                yield rows

    def _refuse_existing(self, mode: str) -> None:
        if mode not in ("create", "resume", "overwrite"):
            raise ContourFileError(f"mode must be create, resume or overwrite, got {mode!r}")
        if self.path.is_dir():
            raise name_nothing(ContourFileError(f"{self.path} is a folder, not a file to write"))
        if not (folder := self.path.parent).is_dir():
            raise name_nothing(ContourFileError(f"{self.path} cannot be written: there is no folder {folder}"))
        if mode == "create":
            self._refuse_sealed()

    def _refuse_sealed(self) -> None:
        if self.path.exists():
            begun = f"; {self._folder} holds an unfinished one, which overwriting discards" * self._has_rendering()
            raise ContourFileError(
                f'{self.path} exists already: mode="overwrite" replaces it once the new one is whole, '
                f'mode="resume" keeps it if it is of the same rendering{begun}'
            )

    def _refuse_stranger(self) -> None:
        """Refuse to replace what is there without permission, which a run keeps beside its blocks."""
        if os.path.lexists(self.path) and not (self._folder / _OVERWRITE_NAME).exists():
            raise ContourFileError(
                f"{self.path} is not of the unfinished rendering in {self._folder}, which may not replace it: move it "
                'away and go on with mode="resume", or begin anew with mode="overwrite"'
            )

    def _begin(self, mode: str) -> None:
        try:
            self._folder.mkdir()
            left: list[Path] = []
        except FileExistsError:
            left = temporary_files(self.path)  # perhaps of a writer that was killed while it sealed
            if self._folder.is_symlink() or not self._folder.is_dir():
                raise ContourFileError(f"{self._folder} is no folder of its own, but a file or a link") from None
        try:
            self._lock = FolderLock(self._folder)
            for path in left:
                discard_left(path)
            if mode == "create":
                self._refuse_sealed()  # again: now no other process can seal
                if self._has_rendering():
                    raise ContourFileError(
                        f"{self._folder} holds an unfinished rendering of {self.path}: "
                        'mode="resume" goes on with it, mode="overwrite" begins anew'
                    )
                self._clear_folder()
            if mode == "overwrite":
                self._clear_folder()
                write_file(self._folder / _OVERWRITE_NAME)
            if mode == "resume":
                self._resume()
        except BlockingIOError:
            raise ContourFileError(f"{self.path} is being written by another process") from None
        except BaseException:
            if self._lock is None:
                with contextlib.suppress(OSError):  # it is not empty
                    self._folder.rmdir()
            self.close()
            raise

    def _write_header(self) -> None:
        if not (self._folder / HEADER_NAME).exists():
            sync(self._folder.parent)
            with NewFile(self._folder / HEADER_NAME) as new, hdf5_output(new.temporary) as output:
                _write_header(output, self._header)

    def _resume(self) -> None:
        """Take over what is there, by the table above."""
        if not (self._folder / HEADER_NAME).exists():
            if block_files(self._folder):
                raise ContourFileError(f'{self._folder} has no header, so it cannot be resumed: use mode="overwrite"')
            self._clear_folder()
            if self.path.exists():
                self._finish_with(self.path)
            return
        with ContourFile(self._folder) as old:
            self._refuse_differing(old)
            self._header = old.header()  # one run, one header: also its device and time of creation
            if self._is_sealed_as(self._header.created):
                self._finish_with(self.path)
                return
            self._refuse_stranger()
            self._clear_temporary()
            self._committed, damaged = old.intact_blocks()
            for first, stop in self._committed:
                self._is_written[first:stop] = True
        self.repairs = tuple(f"{text}: dropped, its poses are rendered again" for text in (*old.problems, *damaged))
        self._remove_uncommitted()

    def _remove_uncommitted(self) -> None:
        """Remove blocks that are none: damaged, foreign, or left by a commit that failed once they had their name."""
        kept = set(self._committed)
        for first, stop, path in block_files(self._folder):
            if (first, stop) not in kept:
                path.unlink()

    def _finish_with(self, path: Path) -> None:
        with ContourFile(path) as old:
            if not old.sealed:
                raise ContourFileError(f"{path} is not whole")
            self._refuse_differing(old)
        self._complete = True
        self.close()

    def _is_sealed_as(self, created: str) -> bool:
        """Whether OUT.h5 is of the run that began at `created`."""
        if not self.path.exists():
            return False
        try:
            with ContourFile(self.path) as file:
                return file.sealed and file.attributes["created"] == created and file.recipe == self._recipe
        except ContourFileError:  # an old file that will be replaced may be anything
            return False

    def _refuse_differing(self, old: ContourFile) -> None:
        if differences := recipe_differences(old.recipe, self._recipe):
            raise ContourFileError(
                f"{self.path} cannot be resumed, {old.path} is of another rendering: {'; '.join(differences)}; "
                'mode="overwrite" begins anew'
            )

    def _refuse_closed(self) -> None:
        if self._complete:
            raise ContourFileError(f"{self.path} is sealed already, nothing can be added")
        if self._lock is None:
            raise ContourFileError(f"{self.path}: this writer is closed")

    def _validate(
        self, first: int, stop: int, contours: Mapping[str, NDArray[Any]], metrics: Mapping[str, NDArray[Any]]
    ) -> None:
        where = f"{self.path}, poses {first} to {stop}"
        if not 0 <= first < stop <= self._header.pose_count:
            raise ContourFileError(f"{where}: out of range, there are {self._header.pose_count} poses")
        if self._is_written[first:stop].any():
            raise ContourFileError(f"{where}: overlap poses that were written already")
        try:
            rows, metric_rows = validate_fields(contours, CONTOURS), validate_fields(metrics, METRICS)
        except ContourFileError as error:
            raise ContourFileError(f"{where}: {error}") from None
        if rows["pose"] != stop - first or metric_rows["pose"] != stop - first:
            raise ContourFileError(f"{where}: arrays are of {rows['pose']} and {metric_rows['pose']} poses")
        for name, count in (("pose_start", rows["polyline"]), ("polyline_start", rows["point"])):
            steps = np.diff(contours[name])
            least = 0 if name == "pose_start" else 1  # a pose may be empty, a polyline may not
            if contours[name][0] != 0 or contours[name][-1] != count or (steps < least).any():
                raise ContourFileError(f"{where}: {name} must rise from 0 to {count} by at least {least}")

    @contextlib.contextmanager
    def _machine_failures(self, task: str) -> Generator[None, None, None]:
        try:
            yield
        except OSError as error:
            done = self.committed
            free = f", {self._free()}" if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
            kept = f'the {done} poses done are kept in {self._folder}: mend that and go on with mode="resume"'
            raise ContourFileError(
                f"{self.path}: cannot {task}: {error.strerror or error}{free}; {kept if done else 'no pose was saved'}"
            ) from error

    def _free(self) -> str:
        with contextlib.suppress(OSError):
            return f"{shutil.disk_usage(self.path.parent).free / 1e6:.1f} MB are free"
        return "free space unknown"

    def _clear_temporary(self) -> None:
        for path in self._folder.glob("*.h5.*" + TEMPORARY_SUFFIX):
            path.unlink()

    def _clear_folder(self) -> None:
        """Remove what writers left, older palpates' too, the header last: blocks without it would be of nothing."""
        self._clear_temporary()
        last = [self._folder / name for name in (_OVERWRITE_NAME, HEADER_NAME)]
        for path in (*block_like_files(self._folder), *(path for path in last if path.exists())):
            path.unlink()

    def _remove_folder(self) -> None:
        # Nothing in it is needed any more; one that cannot go, as another file is in it, does no harm.
        with contextlib.suppress(OSError):
            self._clear_folder()
            if self._lock is not None:
                self._lock.remove()
            self._folder.rmdir()


def _copied(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Of their own: the caller may use its memory again before they are committed."""
    return {name: np.array(array, order="C") for name, array in arrays.items()}


def _write_header(output: Hdf5Output, header: FileHeader) -> None:
    """Motion, object, hand and attributes."""
    for name, values in header_attributes(header).items():
        output.attributes(name, values)
    arrays = header.arrays()
    for spec in HEADER:
        if spec.name in arrays:
            output.add(spec, arrays[spec.name])
