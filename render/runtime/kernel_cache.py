"""The folder of compiled kernels: it holds machine code that is run, so nobody else may write it."""

import grp
import os
import pwd
import stat
from pathlib import Path

from ..errors import KernelCacheError

_REMEDY = "set WARP_CACHE_PATH to a folder that only you can write, such as one in your home folder"


def require_private_cache() -> None:
    """Raise KernelCacheError if somebody else can put kernels into Warp's cache, which Warp must have set by now.

    The folder must be ours; no other user may write it or replace one of the folders that it is in. Of these, the home
    folder and what it lies in are not judged.
    """
    import warp as wp  # a second, which commands that render nothing do without

    folder = Path(wp.config.kernel_cache_dir or "").resolve()
    home = Path(os.path.expanduser("~")).resolve()
    inside = [path for path in folder.parents if not home.is_relative_to(path)]
    outside = [] if folder.is_relative_to(home) else [path for path in folder.parents if home.is_relative_to(path)]
    for path in (folder, *inside, *outside):
        if fault := _fault(path, is_cache=path == folder):
            raise KernelCacheError(f"{path} {fault}, so the compiled kernels in {folder} may be anybody's: {_REMEDY}")


def unusable_cache(error: OSError) -> KernelCacheError:
    """What to raise where Warp could not make the folder."""
    return KernelCacheError(f"{error.filename}: compiled kernels cannot be kept there ({error.strerror}): {_REMEDY}")


def _fault(path: Path, *, is_cache: bool) -> str | None:
    found = path.stat()
    if found.st_uid != os.geteuid() and (is_cache or found.st_uid != 0):
        return f"belongs to {_name(found.st_uid)}"
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


def _name(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"user {uid}"
