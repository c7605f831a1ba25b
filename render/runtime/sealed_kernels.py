"""Compiled kernels are proven before they run: damaged ones, as a power cut leaves them, are compiled anew.

Warp loads whatever its cache holds. Of an object with 256 bytes replaced by zeros, 2 of 17 made the process crash and 5
raised an error that names no file. So the digests of a module's files are written beside them, as their seal, and are
compared before it is loaded. Several processes that lack the same module compile it once: the first one holds a lock,
and the others wait.
"""

import hashlib
import inspect
import os
import threading
import time
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any

from ...datasets.storage.durable import FolderLock, discard_tree, sync, write_file
from ..errors import KernelCacheError
from ..user_warnings import warn_user
from .interrupt import abandonable
from .kernel_cache import REMEDY, is_in_cache, lock_module, unlock_module

SEAL_SUFFIX = ".sha256"
"""Of the file beside an object that holds the digests of object and metadata as `sha256sum --check` reads them."""


class _Unproven(threading.local):
    """The module that this thread is loading although no seal proves it."""

    folder: Path | None = None
    output_name = ""
    is_new = False
    """Whether it was compiled just now."""
    lock: FolderLock | None = None
    """Held until it is loaded and sealed; None where the file system has no locks."""

    def end(self) -> None:
        """Let other processes load the module."""
        if self.lock is not None:
            unlock_module(self.lock)
        self.folder = self.lock = None


def guard_kernels() -> None:
    """Have Warp prove each module that it finds in its cache, and seal each one that it compiles, which happens once.

    A module that differs from its seal is removed with a warning and compiled anew. One without a seal, made by another
    program, is compiled anew if a power cut may have damaged it, and if it cannot be loaded. Threads and processes that
    need the same module wait for the one that compiles it. A second call does nothing.
    """
    import warp as wp

    compile_module, load = wp.Module._compile, wp.Module.load
    if hasattr(compile_module, "__wrapped__"):  # guarded already
        return
    if list(inspect.signature(compile_module).parameters)[1:4] != ["device", "output_dir", "output_name"]:
        return  # a Warp that compiles in another way
    unproven = _Unproven()

    @wraps(compile_module)
    def compile_guarded(
        self: Any, device: Any = None, output_dir: Any = None, output_name: Any = None, *rest: Any, **options: Any
    ) -> bool:
        with abandonable():
            # Only Warp's `load` names the output; what compiles ahead of time writes into a folder of its own.
            if output_name is not None and is_in_cache(output_dir) and not _is_sealed(Path(output_dir), output_name):
                unproven.lock = unproven.lock or lock_module(Path(output_dir))
                if not _is_sealed(Path(output_dir), output_name):  # by the process that held the lock before
                    unproven.folder, unproven.output_name = Path(output_dir), output_name
                    _remove_unproven(Path(output_dir), output_name)
            unproven.is_new = compile_module(self, device, output_dir, output_name, *rest, **options)
            return unproven.is_new

    @wraps(load)
    def load_guarded(self: Any, *rest: Any, **options: Any) -> Any:
        # Two threads that load one module at once get two of it, of which Warp unloads one, perhaps while it runs.
        with vars(self).setdefault("palpate_lock", threading.RLock()):
            try:
                return load_alone(self, *rest, **options)
            finally:
                unproven.end()

    def load_alone(self: Any, *rest: Any, **options: Any) -> Any:
        try:
            loaded = load(self, *rest, **options)
        except Exception:
            if unproven.folder is None:
                raise
            _remove(unproven.folder, is_damaged=True)
            loaded = load(self, *rest, **options)
        if unproven.folder is not None and unproven.is_new:  # only now: a full disk may have cut the object off
            _seal(unproven.folder, unproven.output_name)
        return loaded

    wp.Module._compile, wp.Module.load = compile_guarded, load_guarded


def _is_sealed(folder: Path, output_name: str) -> bool:
    """Whether a module's files fit its seal."""
    with suppress(OSError, UnicodeDecodeError):
        return (folder / f"{output_name}{SEAL_SUFFIX}").read_text("ascii") == _digests(folder, output_name)
    return False


def _remove_unproven(folder: Path, output_name: str) -> None:
    """Remove a module, so that Warp compiles it, if it differs from its seal, or has none and may be damaged."""
    if os.path.lexists(folder / f"{output_name}{SEAL_SUFFIX}"):
        _remove(folder, is_damaged=True)
    elif not folder.is_symlink():  # a link leads to a cache that is only read: its modules are taken as they are
        started = time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)  # of this machine: no power cut since
        with suppress(OSError):
            if (folder / output_name).stat().st_mtime < started:
                _remove(folder, is_damaged=False)


def _digests(folder: Path, output_name: str) -> str:
    """Lines of `sha256sum` of a module's object and metadata; raises OSError."""
    names = (output_name, f"{folder.name}.meta")
    return "".join(f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in names)


def _seal(folder: Path, output_name: str) -> None:
    """Write a module's seal once the module is on the disk; errors are ignored, as the next process judges it anew."""
    with suppress(OSError):
        text = _digests(folder, output_name)
        sync(folder / output_name)
        sync(folder / f"{folder.name}.meta")
        sync(folder.parent)
        write_file(folder / f"{output_name}{SEAL_SUFFIX}", text.encode())


def _remove(folder: Path, *, is_damaged: bool) -> None:
    """Remove a module from the cache, at once for all who look; raises KernelCacheError if that cannot be done.

    is_damaged: whether it is known to be; one that only may be stays if it cannot be removed, and is loaded as it is.
    """
    aside = folder.with_name(f"{folder.name}_damaged_p{os.getpid()}_t{threading.get_ident()}")
    try:
        os.rename(folder, aside)
    except FileNotFoundError:  # another process was faster
        return
    except OSError as error:
        if not is_damaged:
            return
        raise KernelCacheError(
            f"{folder}: compiled kernels are damaged and cannot be removed ({error.strerror}): "
            f"remove that folder, or {REMEDY}"
        ) from error
    discard_tree(aside)
    if is_damaged:
        warn_user(
            f"{folder.parent}: compiled kernels were damaged there, as a power cut leaves them; "
            "they were removed and are compiled anew"
        )
