"""Kernels compiled before they are needed: which are missing, and that Ctrl-C and errors reach the caller."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest
import warp as wp

from palpate.kernels import compile_kernels, uncompiled
from palpate.render.runtime import kernel_cache, kernel_compiling
from palpate.render.runtime.kernel_compiling import compile_now

SMALL, OTHER = "sampling.contour_faults", "sampling.sums"
FOLDER = "wp_palpate.kernels."


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty cache, for this process and its children."""
    tmp_path.chmod(0o700)
    folder = tmp_path / wp.config.version
    folder.mkdir()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(folder))
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    return folder


def test_what_the_cache_lacks_is_told_by_the_folders_that_warp_made(empty, monkeypatch):
    assert uncompiled((SMALL, OTHER)) == (SMALL, OTHER)
    monkeypatch.undo()
    compile_kernels("cpu", (SMALL, OTHER))
    real = Path(wp.config.kernel_cache_dir or "")
    assert uncompiled((SMALL, OTHER)) == ()
    for folder in real.glob(f"{FOLDER}{SMALL}_???????"):
        (empty / folder.name).symlink_to(folder)
    for folder in real.glob(f"{FOLDER}{OTHER}_???????"):  # as a broken-off compilation leaves it
        (empty / folder.name).mkdir()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(empty))
    assert uncompiled((SMALL, OTHER)) == (OTHER,)


def test_an_error_of_the_compiler_is_raised_where_kernels_are_needed(monkeypatch):
    def fail(device, stages):
        raise OSError(28, "No space left on device", "kernels")

    monkeypatch.setattr(kernel_compiling, "compile_kernels", fail)
    with pytest.raises(OSError, match="No space left"):
        compile_now((SMALL,))


def test_all_stages_are_compiled_in_one_thread_in_their_order(monkeypatch):
    seen = []
    monkeypatch.setattr(
        kernel_compiling, "compile_kernels", lambda *given: seen.append((*given, threading.current_thread().name))
    )
    compile_now((OTHER, SMALL), "cuda:0")
    assert seen == [("cuda:0", (stage,), "palpate compiling") for stage in (OTHER, SMALL)]


def test_ctrl_c_does_not_wait_for_the_compiler_whose_folder_goes_with_the_process(monkeypatch):
    done, at_exit = threading.Event(), []
    monkeypatch.setattr(kernel_compiling.atexit, "register", at_exit.append)
    monkeypatch.setattr(kernel_compiling, "compile_kernels", lambda *given: done.wait(20))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.monotonic()
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            compile_now((SMALL,))
    finally:
        signal.signal(signal.SIGINT, before)
        done.set()
    assert time.monotonic() - begun < 5
    assert at_exit == [kernel_cache.remove_own_builds]
