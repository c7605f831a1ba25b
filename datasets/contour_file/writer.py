"""Writing a contour file while it is computed, such that a pose range reported done is never lost.

| OUT.h5 | header | parts | what `mode="resume"` does                                              |
|--------|--------|-------|------------------------------------------------------------------------|
| no     | no     | no    | begins, as "create"                                                    |
| yes    | no     | no    | compares with OUT.h5; nothing is missing                               |
| any    | no     | yes   | refuses: it is unknown what the parts belong to                         |
| yes    | same   | any   | killed after sealing: compares, nothing is missing, removes the folder |
| yes    | other  | any   | as the next line if the run may overwrite, else refuses                |
| no     | other  | any   | compares with the header, goes on with the poses missing               |

header, parts: in the work folder OUT.h5.partial; "same": its header is of the run that made OUT.h5; a file `overwrite`
beside them says that the run may replace OUT.h5.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Generator, Mapping
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError, name_nothing
from ..storage.durable import TEMPORARY_SUFFIX, FolderLock, append_at, copy_range, discard, publish, sync
from ..storage.hdf5 import Hdf5Reader
from ..storage.schema import CONTOURS, METRICS, validate_fields
from .header import FileHeader, recipe_differences, recipe_hash
from .parts import HEADER_NAME, FilePart, begin_part, part_logs, work_folder
from .reader import ContourFile
from .recovery import part_files, take_over_parts
from .rows import optional_fields
from .seal import FileFrame, copy_sealed, read_frame, seal_in_place, write_header

_SEALING_NAME = "sealed.h5" + TEMPORARY_SUFFIX
_OVERWRITE_NAME = "overwrite"


class ContourWriter:
    """Writes one contour file; the only writer of its path as long as it lives. For one thread at a time.

    What is done lies in the work folder `OUT.h5.partial` until `seal()` makes OUT.h5 of it. Leaving the `with`, also
    by an exception, only lets the next writer in: nothing done is removed.

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
        self._parts: list[FilePart] = []
        self._complete = False
        self._published = False
        self._lock: FolderLock | None = None
        header.validate()
        self._header = header
        self._recipe = header.recipe  # hashes motion and mesh anew each time it is asked for
        self._recipe_hash = recipe_hash(self._recipe)
        self._frame = FileFrame(0, 0)
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
        self.close()

    def close(self) -> None:
        """Let other writers in; what is done stays. Closing twice does nothing."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def missing(self) -> list[tuple[int, int]]:
        """Pose ranges (first, stop) not done yet, in pose order."""
        gaps: list[tuple[int, int]] = []
        reached = self._header.pose_count if self._complete else 0
        for part in self._parts:
            if reached < part.first:
                gaps.append((reached, part.first))
            reached = part.stop
        if reached < self._header.pose_count:
            gaps.append((reached, self._header.pose_count))
        return gaps

    def write(
        self,
        first: int,
        stop: int,
        contours: Mapping[str, NDArray[Any]],
        metrics: Mapping[str, NDArray[Any]],
        timing: Mapping[str, float] | None = None,
    ) -> None:
        """Write the contours of poses `first` to `stop`; when this returns, they are done: on the disk, whole.

        Ranges may come in any order and of any size; in pose order nothing is copied. Takes a few MB beside the arrays.
        first, stop: first pose of the range, and the pose after the last. contours: arrays of /contours by name,
        offsets from 0, points [m]; what is optional may be left out. metrics: arrays of /metrics by name, shape [pose],
        lengths [m]. timing: time spent by stage [s].
        Raises ContourFileError where the range or an array is not valid, or overlaps what is done (nothing is written);
        the disk is full or fails (what was done before stays done).
        """
        self._refuse_closed()
        self._validate(first, stop, contours, metrics)
        with self._machine_failures(f"write poses {first} to {stop}"):
            part = self._part_for(first, optional_fields((*contours, *metrics)))
            part.append(stop, contours, metrics, timing or {})
        if part not in self._parts:
            self._parts = sorted([*self._parts, part], key=lambda done: done.first)

    def _part_for(self, first: int, optional: tuple[str, ...]) -> FilePart:
        """The part that ends where poses begin, or a new one."""
        for part in self._parts:
            if part.stop == first and part.optional == optional:
                return part
        part = begin_part(self._folder, first, self._recipe_hash, self._frame.begin, optional=optional)
        self._give_arrays(part)
        return part

    def _give_arrays(self, part: FilePart) -> None:
        """Put motion and mesh into the part that will be sealed; again after a kill, which may have come before."""
        if part.first == 0:
            copy_range(self._folder / HEADER_NAME, part.path, self._frame.room, self._frame.begin)

    def seal(self, *, gzip: int = 0) -> None:
        """Make OUT.h5 of what is done, replacing an old one, and remove the work folder.

        Poses written in order lie in their final place: metadata are added. Otherwise, and with gzip, libhdf5 copies
        them, in blocks. Either way all is read once more and compared with what was written. Takes a few megabytes.

        gzip: 0 stores points as they are; 1 to 9 compress (25 % smaller, some 50 times slower).
        Raises ContourFileError where poses are missing; the disk has no room, or fails; what lies there is not what was
        written. What is done stays done.
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
        self._remove_folder()

    def _seal(self, gzip: int) -> None:
        if self._published:  # and then the sync of its name failed: the parts are gone into it
            sync(self.path.parent)
            return
        with ContourFile(self._folder) as file:
            timing = file.timing()
        part = self._parts[0]
        if len(self._parts) == 1 and not gzip and seal_in_place(part, self._header, timing, self._frame):
            self._refuse_unlike(part.path)
            self._publish(part.path)
            return
        copy = self._folder / _SEALING_NAME
        try:
            with ContourFile(self._folder) as file:
                copy_sealed(copy, file, self._header, gzip=gzip)
            self._refuse_unlike(copy)
            self._publish(copy)
        except (OSError, ContourFileError):
            discard(copy)
            raise

    def _publish(self, made: Path) -> None:
        self._refuse_stranger()
        os.replace(made, self.path)
        self._published = True
        sync(self.path.parent)

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
            raise ContourFileError(
                f'{self.path} exists already: mode="overwrite" replaces it once the new one is whole, '
                'mode="resume" keeps it if it is of the same rendering'
            )

    def _refuse_stranger(self) -> None:
        """Refuse to replace what is there without permission, which a run keeps beside its parts."""
        if os.path.lexists(self.path) and not (self._folder / _OVERWRITE_NAME).exists():
            raise ContourFileError(
                f"{self.path} is not of the unfinished rendering in {self._folder}, which may not replace it: move it "
                'away and go on with mode="resume", or begin anew with mode="overwrite"'
            )

    def _begin(self, mode: str) -> None:
        fresh = self._make_folder()
        try:
            self._lock = FolderLock(self._folder)
            if mode == "create":
                self._refuse_sealed()  # again: now no other process can seal
                self._refuse_unfinished(fresh)
            if mode == "overwrite":
                self._clear_folder()
                append_at(self._folder / _OVERWRITE_NAME, 0, [], fresh=True)
            if mode != "resume" or not self._resume():
                self._write_header()
        except BlockingIOError:
            raise ContourFileError(f"{self.path} is being written by another process") from None
        except BaseException as error:
            if fresh and isinstance(error, (OSError, ContourFileError)):
                self._remove_folder()
            self.close()
            raise

    def _refuse_unfinished(self, fresh: bool) -> None:
        if not fresh:
            raise ContourFileError(
                f"{self._folder} holds an unfinished rendering of {self.path}: "
                'mode="resume" goes on with it, mode="overwrite" begins anew'
            )

    def _make_folder(self) -> bool:
        try:
            self._folder.mkdir()
        except FileExistsError:
            if self._folder.is_symlink() or not self._folder.is_dir():
                raise ContourFileError(f"{self._folder} is no folder of its own, but a file or a link") from None
            return False
        sync(self._folder.parent)
        return True

    def _write_header(self) -> None:
        temporary = self._folder / (HEADER_NAME + TEMPORARY_SUFFIX)
        try:
            self._frame = write_header(temporary, self._header)
            publish(temporary, self._folder / HEADER_NAME)
        except OSError:
            discard(temporary)
            raise

    def _resume(self) -> bool:
        """Take over what is there, by the table above; False if there is nothing."""
        if not (self._folder / HEADER_NAME).exists():
            if part_logs(self._folder):
                raise ContourFileError(f'{self._folder} has no header, so it cannot be resumed: use mode="overwrite"')
            if not self.path.exists():
                self._clear_temporary()
                return False
            self._finish_with(self.path)
            return True
        with ContourFile(self._folder) as old:
            self._refuse_differing(old)
            self._header = old.header()  # one run, one header: also its device and time of creation
        with Hdf5Reader(self._folder / HEADER_NAME) as file:
            self._frame = read_frame(file, self._header)
        if self._is_sealed_as(self._header.created):
            self._finish_with(self.path)
        else:
            self._refuse_stranger()
            self._clear_temporary()
            self._parts, self.repairs = take_over_parts(self._folder, self._recipe_hash)
            for part in self._parts:
                self._give_arrays(part)
        return True

    def _finish_with(self, path: Path) -> None:
        with ContourFile(path) as old:
            if not old.sealed:
                raise ContourFileError(f"{path} is not whole")
            self._refuse_differing(old)
        self._complete = True
        self._remove_folder()

    def _is_sealed_as(self, created: str) -> bool:
        """Whether OUT.h5 is of the run that began at `created`."""
        try:
            with ContourFile(self.path) as file:
                return file.sealed and file.attributes["created"] == created and file.recipe == self._recipe
        except ContourFileError:  # an old file that will be replaced may be anything
            return False

    def _refuse_differing(self, old: ContourFile) -> None:
        if differences := recipe_differences(old.recipe, self._recipe):
            raise ContourFileError(
                f"{self.path} cannot be resumed, it is of another rendering: {'; '.join(differences)}; "
                'mode="overwrite" begins anew'
            )

    def _refuse_unlike(self, temporary: Path) -> None:
        """Look once more before the parts go."""
        wanted = tuple(sum(part.rows.count(dim) for part in self._parts) for dim in ("point", "polyline"))
        with ContourFile(temporary) as file:
            made = (file.point_count, file.polyline_count)
            if made != wanted or file.recipe != self._recipe:
                raise ContourFileError(f"{temporary} has {made} points and polylines, its parts have {wanted}")

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
        if any(part.first < stop and first < part.stop for part in self._parts):
            raise ContourFileError(f"{where}: overlap poses that are done already")
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
            done = sum(part.stop - part.first for part in self._parts)
            free = "" if isinstance(error, PermissionError) else f", {self._free()}"
            kept = f'; the {done} poses done are kept in {self._folder}, make room and go on with mode="resume"'
            raise ContourFileError(
                f"{self.path}: cannot {task}: {error.strerror or error}{free}{kept if done else ''}"
            ) from error

    def _free(self) -> str:
        with contextlib.suppress(OSError):
            return f"{shutil.disk_usage(self.path.parent).free / 1e6:.1f} MB are free"
        return "free space unknown"

    def _clear_temporary(self) -> None:
        for path in self._folder.glob("*" + TEMPORARY_SUFFIX):
            path.unlink()

    def _clear_folder(self) -> None:
        """Remove what writers left, the header last: parts without it would be of nothing."""
        self._clear_temporary()
        for path in part_files(self._folder):
            path.unlink()
        for name in (_OVERWRITE_NAME, HEADER_NAME):
            (self._folder / name).unlink(missing_ok=True)

    def _remove_folder(self) -> None:
        # The file is whole by now; a folder that cannot go (another file is in it) does no harm.
        with contextlib.suppress(OSError):
            self._clear_folder()
            if self._lock is not None:
                self._lock.remove()
            self._folder.rmdir()
        self.close()
