"""System calls that fail, and what a file system may keep of them after a power cut: both by standing in for `os`.

The model of a power cut is pessimistic, as POSIX allows: of a file, what was written since its last `fsync` is kept
page by page or not at all, and its size is any that it had since; of a folder, names that were made, moved or removed
since its last `fsync` are kept up to any point, each folder by itself, a move between two folders as a whole.
"""

import errno
import os
import random
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CHANGING = (
    "open", "write", "pwrite", "ftruncate", "truncate", "posix_fallocate", "fsync", "fdatasync", "replace",
    "rename", "link", "unlink", "mkdir", "rmdir", "close", "fstat",
)  # fmt: skip
"""Calls that make, change, sync or remove files, and those that they need."""


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size [byte], as on a disk that is full."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


SYNCS = ("fsync", "fdatasync")

PAGE = 4096


@contextmanager
def stood_in_for(stand_in: Callable[[str, Callable[..., Any]], Callable[..., Any]]) -> Iterator[None]:
    """Have `stand_in(name, real)` called in place of each of `CHANGING`."""
    real = {name: getattr(os, name) for name in CHANGING}
    try:
        for name, call in real.items():
            setattr(os, name, stand_in(name, call))
        yield
    finally:
        for name, call in real.items():
            setattr(os, name, call)


@dataclass
class Faults:
    """Which calls fail: those whose numbers are given, counted from 0 over all of `CHANGING`."""

    numbers: frozenset[int]
    error: int = errno.EIO
    is_torn: bool = False
    """Whether a write that fails leaves its first half."""
    names: list[str] = field(default_factory=list)
    """All calls that were made."""
    failed: list[str] = field(default_factory=list)

    def __call__(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            if name == "close":  # what a sync has on the disk, no close takes back
                return real(*args, **options)
            number = len(self.names)
            self.names.append(name)
            if number not in self.numbers:
                return None if name in SYNCS else real(*args, **options)  # no power is cut here
            self.failed.append(name)
            if self.is_torn and name in ("write", "pwrite"):
                content = bytes(args[1])
                real(args[0], content[: len(content) // 2], *args[2:])
            raise OSError(self.error, os.strerror(self.error))

        return call


@dataclass
class _File:
    """An inode: what is on the disk for sure, and what was done to it since."""

    kept: bytes = b""
    pending: list[tuple[int, bytes | None]] = field(default_factory=list)
    """Offset and content of each write; None as content: cut or grown to the offset."""

    def after_a_cut(self, rng: random.Random, share: float) -> bytes:
        """What is there after a power cut; share: of the pages written since that are kept, 0..1."""
        steps = rng.randint(0, len(self.pending)) if 0 < share < 1 else round(share) * len(self.pending)
        size, out = len(self.kept), bytearray(self.kept)
        for step, (offset, content) in enumerate(self.pending):
            if content is not None:
                out.extend(bytes(max(0, offset + len(content) - len(out))))
                for first, stop in _pages(offset, offset + len(content)):
                    if rng.random() < share:
                        out[first:stop] = content[first - offset : stop - offset]
                size = max(size, offset + len(content)) if step < steps else size
            elif step < steps:
                size = offset
                out[offset:] = bytes(max(0, len(out) - offset))  # what was cut off comes back as zeros
        return bytes(out[:size].ljust(size, b"\0"))


def _pages(first: int, stop: int) -> Iterator[tuple[int, int]]:
    while first < stop:
        end = min(stop, first // PAGE * PAGE + PAGE)
        yield first, end
        first = end


class _Folder:
    """Stands for a folder among the names."""


_FOLDER = _Folder()
_Found = _File | _Folder | None


@dataclass(frozen=True)
class _Naming:
    """Names that are given or, where nothing is found under them any more, taken, all at once."""

    changes: tuple[tuple[Path, _Found], ...]

    @property
    def folders(self) -> set[Path]:
        return {path.parent for path, _ in self.changes}


class Disk:
    """Records what is done below a folder, and lays out what a power cut would leave of it."""

    def __init__(self, root: Path, at_event: Callable[[], None]) -> None:
        self._root = root
        self._at_event = at_event
        """Called after each call that changed anything, or had it on the disk."""
        self._names: dict[Path, _Found] = {}
        self._pending: list[_Naming] = []
        self._opened: dict[int, _File | Path] = {}
        self._is_recording = False
        for path in sorted(root.rglob("*")):  # what is there to begin with, is there for sure
            self._names[path] = _FOLDER if path.is_dir() else _File(path.read_bytes())
        self._kept_names = dict(self._names)

    @contextmanager
    def recording(self) -> Iterator[None]:
        with stood_in_for(self._stand_in):
            self._is_recording = True
            yield
            self._is_recording = False

    def lay_out(self, folder: Path, rng: random.Random, share: float) -> None:
        """Make in an empty folder what a power cut now would leave."""
        names = dict(self._kept_names)
        for naming in self._surviving(rng, share):
            names.update(naming.changes)
        for path, found in sorted(names.items(), key=lambda item: len(item[0].parts)):
            place = folder / path.relative_to(self._root)
            if found is None or not place.parent.is_dir():  # the name of its folder was lost
                continue
            if isinstance(found, _File):
                place.write_bytes(found.after_a_cut(rng, share))
            else:
                place.mkdir()

    def opened_name(self, handle: int) -> Path | None:
        """The name that an open file has now."""
        return next((path for path, found in self._names.items() if found is self._opened.get(handle)), None)

    def _surviving(self, rng: random.Random, share: float) -> list[_Naming]:
        """Of each folder, namings up to some point; one of two folders if both have come that far."""
        if share in (0, 1):
            return self._pending * round(share)
        left = {folder: rng.randint(0, len(self._pending)) for naming in self._pending for folder in naming.folders}
        out: list[_Naming] = []
        for naming in self._pending:
            if all(left[folder] > 0 for folder in naming.folders):
                out.append(naming)
            else:
                left |= dict.fromkeys(naming.folders, 0)
            for folder in naming.folders:
                left[folder] -= 1
        return out

    def _stand_in(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        note = getattr(self, f"_note_{name}", None)

        def call(*args: Any, **options: Any) -> Any:
            if not self._is_recording or note is None:
                return real(*args, **options)
            before = os.lseek(args[0], 0, os.SEEK_CUR) if name == "write" else 0
            result = None if name in SYNCS else real(*args, **options)
            if note(result, before, *args) is not None:
                self._is_recording = False
                try:
                    self._at_event()
                finally:
                    self._is_recording = True
            return result

        return call

    def _path(self, path: Any) -> Path | None:
        """An absolute path if it is below the root."""
        own = Path(os.path.abspath(os.fspath(path)))
        return own if own.is_relative_to(self._root) else None

    def _name(self, *changes: tuple[Path, _Found]) -> bool:
        for path, found in changes:
            self._names[path] = found
        self._pending.append(_Naming(changes))
        return True

    # What each call does: None if it concerns no file below the root, or changes nothing.

    def _note_open(self, handle: int, before: int, path: Any, flags: int, *rest: Any) -> bool | None:
        del before, rest
        own = self._path(path)
        if own is None:
            return None
        if own.is_dir():
            self._opened[handle] = own
            return None
        changed = None
        if self._names.get(own) is None:
            changed = self._name((own, _File()))
        file = self._names[own]
        assert isinstance(file, _File)
        self._opened[handle] = file
        if flags & os.O_TRUNC and not changed:
            file.pending.append((0, None))
            changed = True
        return changed

    def _note_close(self, result: None, before: int, handle: int) -> None:
        del result, before
        self._opened.pop(handle, None)

    def _note_write(self, count: int, before: int, handle: int, content: Any) -> bool | None:
        return self._note_pwrite(count, 0, handle, content, before)

    def _note_pwrite(self, count: int, before: int, handle: int, content: Any, offset: int) -> bool | None:
        del before
        file = self._opened.get(handle)
        if not isinstance(file, _File) or not count:
            return None
        file.pending.append((offset, bytes(content[:count])))
        return True

    def _note_ftruncate(self, result: None, before: int, handle: int, size: int) -> bool | None:
        del result, before
        file = self._opened.get(handle)
        if not isinstance(file, _File):
            return None
        file.pending.append((size, None))
        return True

    def _note_posix_fallocate(self, result: None, before: int, handle: int, offset: int, count: int) -> bool | None:
        del offset, count
        return self._note_ftruncate(result, before, handle, os.fstat(handle).st_size)

    def _note_fsync(self, result: None, before: int, handle: int) -> bool | None:
        del result, before
        found = self._opened.get(handle)
        if isinstance(found, _File):
            with open(f"/proc/self/fd/{handle}", "rb") as stream:  # all of it, whoever has written it
                found.kept, found.pending = stream.read(), []
        elif found is not None:
            self._sync_names({found})
        return None if found is None else True

    _note_fdatasync = _note_fsync

    def _sync_names(self, folders: set[Path]) -> None:
        """Keep for sure the namings of a folder, and those of other folders that came before a move from there."""
        kept: list[_Naming] = []
        for naming in reversed(self._pending):
            if naming.folders & folders:
                folders = folders | naming.folders
                kept.insert(0, naming)
        for naming in kept:
            self._kept_names.update(naming.changes)
        self._pending = [naming for naming in self._pending if not any(naming is own for own in kept)]

    def _note_replace(self, result: None, before: int, source: Any, target: Any) -> bool | None:
        del result, before
        old, new = self._path(source), self._path(target)
        if old is None or new is None:
            return None
        found = self._names.get(old) or _File(pending=[(0, new.read_bytes())])  # one that others than `os` have made
        return self._name((old, None), (new, found))

    _note_rename = _note_replace

    def _note_link(self, result: None, before: int, source: Any, target: Any) -> bool | None:
        del result, before
        old, new = self._path(source), self._path(target)
        return None if old is None or new is None else self._name((new, self._names.get(old)))

    def _note_unlink(self, result: None, before: int, path: Any) -> bool | None:
        del result, before
        own = self._path(path)
        return None if own is None else self._name((own, None))

    _note_rmdir = _note_unlink

    def _note_mkdir(self, result: None, before: int, path: Any, *rest: Any) -> bool | None:
        del result, before, rest
        own = self._path(path)
        return None if own is None else self._name((own, _FOLDER))
