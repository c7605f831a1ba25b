"""Starting Warp: without its chatter, and with a folder of compiled kernels that can be written."""

import os
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager

from .kernel_cache import (
    is_writable,
    remove_abandoned_builds,
    require_private_cache,
    unusable_cache,
    use_temporary_cache,
)
from .sealed_kernels import guard_kernels

_NO_DRIVER = "find or load the NVIDIA CUDA driver"


def start_warp() -> None:
    """Start Warp for a command, whose kernel cache must be private.

    The cache is created for this user alone; where it cannot be written, a temporary one serves this process and its
    children. What killed processes left in it is removed, and what is loaded from it is proven. Raises KernelCacheError
    for one that other users can write.
    """
    _start()
    require_private_cache()
    if is_writable():
        remove_abandoned_builds()
    else:
        use_temporary_cache()
    guard_kernels()


def start_quietly() -> None:
    """Start Warp for a script that has not done so: what it prints is of no use to those who do not know Warp."""
    import warp as wp

    if wp.config.log_level == wp.LOG_INFO:  # else the script has chosen
        _start()
        if not is_writable():
            use_temporary_cache()
    guard_kernels()


def _start() -> None:
    import warp as wp  # a second, which commands that render nothing do without

    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    before = os.umask(0o077)
    try:
        with _without_driver_line():
            try:
                wp.init()
            except OSError as error:
                if error.filename is None:  # an error of Warp's own libraries, not of the cache
                    raise
                use_temporary_cache(unusable_cache(error))
                wp.init()
    finally:
        os.umask(before)


@contextmanager
def _without_driver_line() -> Generator[None]:
    """Leave out the line that Warp writes where there is no CUDA driver.

    Native code writes that line and no setting prevents it, so standard error is caught meanwhile and the rest is
    written again.
    """
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # closed
        yield
        return
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        caught.seek(0)
        for line in caught.read().decode(errors="replace").splitlines(keepends=True):
            if _NO_DRIVER not in line and sys.stderr is not None:
                sys.stderr.write(line)
