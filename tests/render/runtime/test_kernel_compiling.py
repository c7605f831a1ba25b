"""Kernels compiled beside a rendering: what is started, when it ends, and that it never harms the command."""

import os
import re
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest
import warp as wp

from palpate.kernels import compile_kernels, uncompiled
from palpate.render.runtime import kernel_cache, kernel_compiling
from palpate.render.runtime.kernel_compiling import CompilingAhead, compile_now

SMALL, OTHER = "sampling.contour_faults", "sampling.sums"
FOLDER = "wp_palpate.kernels."
BUILD = re.compile(r"_p\d+_t\d+$")  # of a folder that a process and thread compile in


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty cache, for this process and its children."""
    tmp_path.chmod(0o700)
    folder = tmp_path / wp.config.version
    folder.mkdir()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(folder))
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    return folder


def compiled(folder):
    """Stages in a cache, by the names of the folders that Warp makes; those that are being compiled are left out."""
    names = [path.name for path in folder.iterdir() if path.is_dir() and not BUILD.search(path.name)]
    return sorted(name.removeprefix(FOLDER).rpartition("_")[0] for name in names)


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


def test_nothing_is_started_where_the_cache_has_all_or_ends_with_this_process(monkeypatch):
    started, missing = [], ()
    monkeypatch.setattr(kernel_compiling, "uncompiled", lambda stages: missing)
    monkeypatch.setattr(subprocess, "Popen", lambda words, **options: started.append(words))
    with CompilingAhead((SMALL,)) as ahead:
        ahead.wait()
    missing = (SMALL,)
    monkeypatch.setattr(kernel_cache, "_TEMPORARY", [Path("temporary")])
    with CompilingAhead((SMALL,)) as ahead:
        ahead.wait()
    assert started == []


def test_a_system_that_allows_no_process_is_no_error(monkeypatch):
    def refuse(*words, **options):
        raise BlockingIOError("too many processes")

    monkeypatch.setattr(kernel_compiling, "uncompiled", lambda stages: stages)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    reported = []
    with CompilingAhead((SMALL,)) as ahead:
        ahead.wait(reported.append)
    assert reported == []


def test_a_short_rendering_compiles_nothing_and_waits_for_nothing(empty):
    begun = time.monotonic()
    with CompilingAhead((SMALL,)) as ahead:
        process = ahead._process
        assert os.getsid(process.pid) == process.pid  # Ctrl-C in a terminal does not reach it
    ahead.wait()
    assert (process.returncode, time.monotonic() - begun < kernel_compiling.DELAY) == (0, True)
    assert compiled(empty) == []


def test_an_error_while_rendering_is_raised_at_once_and_ends_the_process(empty):
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), CompilingAhead((SMALL,)) as ahead:
        raise KeyboardInterrupt
    assert time.monotonic() - begun < 1.0
    assert ahead._process.wait(timeout=10) == 0


@pytest.mark.exhaustive
def test_while_active_all_is_compiled_and_then_nothing_is_missing(empty):
    reported = []
    with CompilingAhead((SMALL, OTHER)) as ahead:
        ahead.wait(reported.append)
    assert (reported, compiled(empty)) == ([2], sorted([SMALL, OTHER]))
    assert uncompiled((SMALL, OTHER)) == ()


@pytest.mark.exhaustive
def test_the_module_under_way_is_finished_and_no_other_is_begun(empty):
    with CompilingAhead(("sampling.visits", SMALL)) as ahead:
        while not any(BUILD.search(path.name) for path in empty.iterdir()):
            time.sleep(0.01)
        assert compiled(empty) == []
    ahead.wait()
    assert compiled(empty) == ["sampling.visits"]


@pytest.mark.exhaustive
def test_a_stage_that_cannot_be_compiled_is_no_error_of_the_rendering(empty, monkeypatch, capfd):
    monkeypatch.setattr(kernel_compiling, "uncompiled", lambda stages: stages)
    with CompilingAhead(("sampling.of_nothing", SMALL)) as ahead:
        ahead.wait()
    assert ahead._process.returncode == 1
    assert compiled(empty) == []
    assert tuple(capfd.readouterr()) == ("", "")


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
