"""The folder of compiled kernels: what killed processes left there is removed, and nothing else.

The truth is the kernel's list of processes, and the names that Warp gives to the folders that it compiles in.
"""

import os
import subprocess
import sys
import time

import pytest
import warp as wp

from palpate.render.runtime.kernel_cache import lock_module, remove_abandoned_builds, remove_own_builds, unlock_module

HOUR_AGO = time.time() - 3600


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


def build(cache, process, when, *, module="wp_palpate.kernels.patch_0ac5d3f"):
    """A folder as Warp compiles in, written at a time."""
    folder = cache / f"{module}_p{process}_t139625649879936"
    folder.mkdir()
    (folder / "patch.cpp").write_text("half")
    os.utime(folder, (when, when))
    return folder


def ended_process():
    """The number of a process that has ended."""
    with subprocess.Popen(["true"]) as process:
        pass
    return process.pid


def test_what_a_killed_process_left_is_removed_and_what_may_be_in_use_is_not(cache):
    ended = ended_process()
    left = build(cache, ended, HOUR_AGO)
    recent = build(cache, ended, time.time(), module="wp_recent_0ac5d3f")  # perhaps of a process on another machine
    alive = build(cache, os.getpid(), HOUR_AGO)
    module = build(cache, "", HOUR_AGO, module="wp_user_0ac5d3f")
    stranger = build(cache, ended, HOUR_AGO, module="results")
    remove_abandoned_builds()
    assert not left.exists()
    assert all(folder.exists() for folder in (recent, alive, module, stranger))


def test_a_process_that_ends_in_the_middle_removes_its_own(cache):
    own, other = build(cache, os.getpid(), time.time()), build(cache, ended_process(), time.time())
    lock = lock_module(cache / "wp_user_0ac5d3f")
    assert len(list(cache.iterdir())) == 3
    remove_own_builds()
    assert (own.exists(), list(cache.iterdir())) == (False, [other])
    unlock_module(lock)


@pytest.mark.exhaustive
def test_every_command_removes_what_killed_ones_left(tmp_path):
    start = "from palpate.render.runtime.warp_start import start_warp; start_warp()"
    (tmp_path / wp.config.version).mkdir(mode=0o700)
    tmp_path.chmod(0o700)
    left = build(tmp_path / wp.config.version, ended_process(), HOUR_AGO)
    subprocess.run([sys.executable, "-c", start], env=os.environ | {"WARP_CACHE_PATH": str(tmp_path)}, check=True)
    assert not left.exists()
