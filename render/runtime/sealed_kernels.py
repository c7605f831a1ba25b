"""Compiled kernels are proven before they run: damaged ones, as a power cut leaves them, are compiled anew.

Warp loads whatever its cache holds. Of an object with 256 bytes replaced by zeros, 2 of 17 made the process crash and 5
raised an error that names no file; so objects must be proven before they are loaded.
"""

import hashlib
import inspect
import os
import struct
import threading
import time
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

from ...datasets.json_text import read_json
from ...datasets.storage.durable import discard_tree, sync, write_file
from ..errors import KernelCacheError
from ..user_warnings import warn_user
from .interrupt import abandonable
from .kernel_cache import REMEDY, is_in_cache

SEAL_SUFFIX = ".sha256"
"""Of a file beside an object, with the digests of object and metadata as `sha256sum --check` reads them."""

_BLOCK_BYTES = 512  # the smallest block of a file system, which it may not have written yet

_END_BYTES = 32  # an object ends with its table of sections, which holds no more zeros than these

_ELF_HEAD_BYTES = 64

_loading = threading.local()


def guard_kernels() -> None:
    """Have Warp seal each module that it compiles into its cache, and prove each one that it finds there.

    Threads that need the same module wait for the one that loads it. A module that differs from its seal is removed
    with a warning and compiled again. One without a seal, made by another program, is compiled again if a power cut may
    have damaged it, and if it cannot be loaded. A second call does nothing.
    """
    import warp as wp

    compile_module, load = wp.Module._compile, wp.Module.load
    if hasattr(compile_module, "__wrapped__"):  # guarded already
        return
    if list(inspect.signature(compile_module).parameters)[1:4] != ["device", "output_dir", "output_name"]:
        return  # a Warp that compiles in another way

    @wraps(compile_module)
    def compile_guarded(
        self: Any, device: Any = None, output_dir: Any = None, output_name: Any = None, *rest: Any, **options: Any
    ) -> bool:
        _loading.unproven = None
        if output_name is None or not is_in_cache(output_dir):  # ahead of time, for a folder of the caller's
            return compile_module(self, device, output_dir, output_name, *rest, **options)
        is_proven = _prove(Path(output_dir), output_name)
        with abandonable():
            compiled = compile_module(self, device, output_dir, output_name, *rest, **options)
        if not is_proven:
            _loading.unproven = _Unproven(self, Path(output_dir), output_name, compiled)
        return compiled

    @wraps(load)
    def load_guarded(self: Any, *rest: Any, **options: Any) -> Any:
        # Two threads that load one module at once get two of it, of which Warp unloads one, perhaps while it runs.
        with vars(self).setdefault("palpate_lock", threading.RLock()):
            return load_alone(self, *rest, **options)

    def load_alone(self: Any, *rest: Any, **options: Any) -> Any:
        try:
            loaded = load(self, *rest, **options)
        except Exception:
            if (unproven := _take_unproven(self)) is None:
                raise
            _remove(unproven.folder)
            loaded = load(self, *rest, **options)
        if (unproven := _take_unproven(self)) is not None and unproven.is_new:
            _seal(unproven.folder, unproven.output_name)
        return loaded

    wp.Module._compile, wp.Module.load = compile_guarded, load_guarded


class _Unproven(NamedTuple):
    """A module that this thread is loading."""

    module: Any
    folder: Path
    output_name: str
    is_new: bool
    """Whether it was compiled just now: it is sealed once it could be loaded, as a full disk may have cut it off."""


def _take_unproven(module: Any) -> _Unproven | None:
    found: _Unproven | None = getattr(_loading, "unproven", None)
    if found is None:
        return None
    _loading.unproven = None
    return found if found.module is module else None


def _prove(folder: Path, output_name: str) -> bool:
    """Whether a module's folder has a seal that its files fit; a module that may be damaged is removed."""
    seal = folder / f"{output_name}{SEAL_SUFFIX}"
    if not os.path.lexists(seal):
        if not _is_usable(folder, output_name):
            _remove(folder)
        elif not folder.is_symlink() and _is_doubtful(folder / output_name):
            _remove(folder, is_damaged=False)
        return False
    with suppress(OSError, UnicodeDecodeError):
        if seal.read_text("ascii") == _digests(folder, output_name):
            return True
    _remove(folder)
    return False


def _is_usable(folder: Path, output_name: str) -> bool:
    """Whether Warp can load from a folder without a seal, or compile into it, where it keeps the metadata it finds."""
    if (folder / output_name).exists():
        return not _is_cut_off(folder / output_name)
    if not os.path.lexists(folder):
        return True
    try:
        read_json(folder / f"{folder.name}.meta")
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False
    return True


def _is_cut_off(path: Path) -> bool:
    """Whether an object cannot be read, or ends before its table of sections: the loader prints a line about that."""
    try:
        content = path.read_bytes()
    except OSError:
        return True
    if not content.startswith(b"\x7fELF"):
        return path.suffix == ".o"
    head = content[:_ELF_HEAD_BYTES].ljust(_ELF_HEAD_BYTES, b"\0")
    (table,), (row_bytes, row_count) = struct.unpack_from("<Q", head, 0x28), struct.unpack_from("<HH", head, 0x3A)
    return table + row_bytes * row_count > len(content)


def _digests(folder: Path, output_name: str) -> str:
    """Lines of `sha256sum` of a module's object and metadata; raises OSError."""
    names = (output_name, f"{folder.name}.meta")
    return "".join(f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in names)


def _seal(folder: Path, output_name: str) -> None:
    """Have a module on the disk and then say so; one that cannot be sealed is proven by loading it."""
    with suppress(OSError):
        text = _digests(folder, output_name)
        sync(folder / output_name)
        sync(folder / f"{folder.name}.meta")
        sync(folder.parent)
        write_file(folder / f"{output_name}{SEAL_SUFFIX}", text.encode())


def _is_doubtful(path: Path) -> bool:
    """Whether a power cut may have damaged a file: written before this machine started, or with a block of zeros."""
    with suppress(OSError):
        started = time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)
        content = path.read_bytes()
        return path.stat().st_mtime < started or bytes(_BLOCK_BYTES) in content or content.endswith(bytes(_END_BYTES))
    return False


def _remove(folder: Path, *, is_damaged: bool = True) -> None:
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
