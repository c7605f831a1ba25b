"""The folder of compiled kernels: it holds machine code that is run, so nobody else may write it."""

import atexit
import contextlib
import grp
import os
import pwd
import re
import shutil
import stat
import sys
import tempfile
import time
from pathlib import Path

from ...datasets.storage.durable import FolderLock, discard_tree
from ..errors import KernelCacheError

ROOM_LEAST = 64 * 2**20  # [byte] on the cache's disk: all of palpate's kernels take 40 MB
BUILD_SECONDS = 600.0  # longest time to compile one module: no process, of another machine either, uses an older folder
REMEDY = "set WARP_CACHE_PATH to a folder that only you can write, such as one in your home folder"
_POLL_SECONDS = 0.05  # between two looks at whether another process has compiled a module
_LOCKS: list[FolderLock] = []  # of modules that this process compiles
_TEMPORARY: list[Path] = []  # the temporary folder for kernels, if there is one


def require_private_cache() -> None:
    """Raise KernelCacheError if somebody else can put kernels into Warp's cache, which Warp must have set by now.

    The folder must be ours; no other user may write it or replace one of the folders that it is in. A cache in the home
    folder is judged up to there only.
    """
    import warp as wp  # a second, which commands that render nothing do without

    folder = Path(wp.config.kernel_cache_dir or "").resolve()
    home = Path(os.path.expanduser("~")).resolve()
    for path in (folder, *folder.parents):
        if path != folder and folder.is_relative_to(home) and home.is_relative_to(path):
            return
        if fault := _fault(path, is_cache=path == folder):
            raise KernelCacheError(f"{path} {fault}, so the compiled kernels in {folder} may be anybody's: {REMEDY}")


def is_writable() -> bool:
    """Whether kernels can be added to Warp's cache, which Warp must have set by now."""
    import warp as wp

    folder = Path(wp.config.kernel_cache_dir or "")
    return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free >= ROOM_LEAST


def use_temporary_cache(cause: KernelCacheError | None = None) -> None:
    """Have Warp keep kernels in a temporary folder until this process ends; those of its cache are linked there.

    Children get it, too. cause: why Warp could not start, raised if there is no room for a temporary folder either.
    """
    import warp as wp

    known = wp.config.kernel_cache_dir
    try:
        base = Path(tempfile.mkdtemp(prefix="palpate-kernels-"))
        folder = base / wp.config.version
        folder.mkdir()
        for module in Path(known).iterdir() if known and Path(known).is_dir() else ():
            (folder / module.name).symlink_to(module)
    except OSError as error:
        raise cause or unusable_cache(error) from error
    _TEMPORARY.append(folder)
    owner = os.getpid()
    atexit.register(lambda: os.getpid() == owner and discard_tree(base))  # a forked child ends, too
    os.environ["WARP_CACHE_PATH"] = str(base)
    wp.config.kernel_cache_dir = None if cause else str(folder)  # a Warp that is to start anew asks the environment


def is_temporary() -> bool:
    """Whether what this process compiles is removed when it ends."""
    return bool(_TEMPORARY)


def kernels_lost() -> str | None:
    """The sentence on kernels that were compiled into a temporary folder; None if there are none."""
    count = sum(not module.is_symlink() for folder in _TEMPORARY for module in folder.iterdir())
    if not count:
        return None
    return f"kernels were compiled for this run only ({count} files), since their cache cannot be written: {REMEDY}"


def lock_module(folder: Path) -> FolderLock | None:
    """Lock a module's folder once no other process has it, or BUILD_SECONDS later; None without a lock."""
    deadline = time.monotonic() + BUILD_SECONDS
    with contextlib.suppress(OSError):  # a cache that cannot be written, or a file system without locks
        while time.monotonic() < deadline:
            with contextlib.suppress(BlockingIOError):
                _LOCKS.append(lock := FolderLock(folder.parent, f"{folder.name}.lock"))
                return lock
            time.sleep(_POLL_SECONDS)
    return None


def unlock_module(lock: FolderLock) -> None:
    """Let other processes have a module, and remove the lock's file."""
    _LOCKS.remove(lock)
    lock.remove()
    lock.release()


def remove_abandoned_builds() -> None:
    """Remove the folders that killed processes compiled in, from Warp's cache."""
    for folder in _builds(r"\d+"):
        with contextlib.suppress(OSError):  # another process has removed it
            process = int(folder.name.rpartition("_p")[2].partition("_t")[0])
            age = time.time() - folder.stat().st_mtime
            if age >= BUILD_SECONDS and not Path("/proc", str(process)).exists():
                discard_tree(folder)


def remove_own_builds() -> None:
    """Remove what this process keeps for compiling, before it ends in the middle of that."""
    runtime = getattr(sys.modules.get("warp._src.context"), "runtime", None)
    headers = getattr(runtime, "_pch_dirs", {})  # Warp's own, precompiled
    folders = [Path(folder.name) for folder in headers.values()]
    headers.clear()  # a process that goes on, as one of tests does, makes new ones
    for folder in (*_builds(str(os.getpid())), *folders, *(folder.parent for folder in _TEMPORARY)):
        discard_tree(folder)
    for lock in _LOCKS:
        lock.remove()  # the lock itself ends with the process


def _builds(process: str) -> list[Path]:
    """Folders in Warp's cache that processes compile in; process: a regular expression of their numbers."""
    import warp as wp

    cache = Path(wp.config.kernel_cache_dir or "")
    named = re.compile(rf"wp_.*_p{process}_t\d+")
    with contextlib.suppress(OSError):
        return [cache / name for name in os.listdir(cache) if named.fullmatch(name)]
    return []


def is_in_cache(path: object) -> bool:
    """Whether a path lies in Warp's cache."""
    warp = sys.modules.get("warp")
    folder = warp.config.kernel_cache_dir if warp else None
    return bool(folder) and isinstance(path, str) and Path(path).is_relative_to(folder)


def unusable_cache(error: OSError) -> KernelCacheError:
    """The error to raise where compiled kernels cannot be written."""
    return KernelCacheError(f"{error.filename}: compiled kernels cannot be kept there ({error.strerror}): {REMEDY}")


def _fault(path: Path, *, is_cache: bool) -> str | None:
    """Why others can put files into a folder, or replace what is in it; None if they cannot."""
    found = path.stat()
    if found.st_uid != os.geteuid() and (is_cache or found.st_uid != 0):
        return f"belongs to another user ({found.st_uid})"
    shared = found.st_mode & (stat.S_IWOTH if _is_own_group(found.st_gid) else stat.S_IWOTH | stat.S_IWGRP)
    is_sticky = found.st_mode & stat.S_ISVTX  # others may add names, and not replace ours
    return "can be written by others" if shared and (is_cache or not is_sticky) else None


def _is_own_group(gid: int) -> bool:
    """Whether a group has its user alone, as where each user has a group of the same name."""
    try:
        user = pwd.getpwuid(os.geteuid())
        return user.pw_gid == gid and grp.getgrgid(gid).gr_name == user.pw_name
    except KeyError:  # a user without an entry, as in containers
        return False
