"""Processes that palpate starts import nothing from the current folder, and run kernels that their user compiled."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp

from palpate.device import WatchdogError, array_model
from palpate.device.playing.watchdog import Watchdog
from palpate.render.errors import KernelCacheError
from palpate.render.runtime import kernel_cache, kernel_compiling
from palpate.render.runtime.kernel_cache import require_private_cache

PALPATE = [str(Path(sys.executable).with_name("palpate"))]  # not by -P, which children would inherit
PLANTED = """numpy pickle socket struct selectors subprocess tempfile threading distributed dask multiprocessing logging
    warp h5py usb typing dataclasses sitecustomize"""


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A current folder with modules by the names of those that every process of palpate imports."""
    folder = tmp_path / "hostile"
    folder.mkdir()
    for name in PLANTED.split():
        (folder / f"{name}.py").write_text(f"import os\nos.mkdir({str(tmp_path / 'planted')!r})\nos._exit(9)\n")
    (folder / "plan.toml").write_text('[object]\nsource = "cube"\n[motion]\nsource = "random"\ncount = 20\n')
    monkeypatch.chdir(folder)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.delenv("PYTHONPATH", raising=False)  # it may have an empty entry, which is the current folder
    yield folder
    assert not (tmp_path / "planted").exists()


def test_the_planted_modules_would_run(tmp_path, hostile):
    """What the other tests exclude: -c and -m put the current folder first."""
    done = subprocess.run([sys.executable, "-c", "import numpy"])
    assert done.returncode == 9
    (tmp_path / "planted").rmdir()


@pytest.mark.exhaustive
def test_the_watchdog_stands_in_a_folder_with_a_planted_numpy(hostile):
    """There is no such array here, which only a watchdog that has started can say."""
    for name in ("pat16", "sonicsurface"):
        dog = Watchdog(SimpleNamespace(array=array_model(name), serial="none like it"))  # type: ignore[arg-type]
        with pytest.raises(WatchdogError, match="cannot reach array") as refused, dog:
            pass
        assert "did not start" not in str(refused.value)


@pytest.mark.exhaustive
def test_workers_of_a_sweep_stand_there_too(hostile):
    """A metric of the user's runs in processes, which have planted modules beside it."""
    (hostile / "mine.py").write_text(
        "def count(contours):\n    return contours.pose_start[1:] - contours.pose_start[:-1]\n"
    )
    options = ["--set", 'metrics=["mine.py:count"]', "--allow-code", "--device", "cpu", "--no-figure", "--json"]
    done = subprocess.run([*PALPATE, "sweep", "plan.toml", *options], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(done.stdout)
    assert (report["poses_rendered"], report["executor"]) == (20, "2 processes, on cpu")


@pytest.mark.exhaustive
def test_what_compiles_beside_a_rendering_stands_there_too(hostile, monkeypatch):
    monkeypatch.setattr(kernel_compiling, "uncompiled", lambda stages: stages)
    with kernel_compiling.CompilingAhead(("sampling.contour_faults",)) as ahead:
        ahead.wait()
    assert ahead._process.returncode == 0


# The kernels' cache


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Warp's cache as it is said to be, not as it is; and a home folder elsewhere."""
    folder = tmp_path / "cache" / "1.0"
    folder.mkdir(parents=True)
    for path in (folder, folder.parent):
        path.chmod(0o700)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(folder))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return folder


def test_a_cache_of_ones_own_is_taken(cache):
    require_private_cache()
    cache.chmod(0o755)
    require_private_cache()


def test_a_cache_in_the_shared_temporary_folder_is_taken_only_if_nobody_can_replace_it(cache, tmp_path):
    cache.parent.chmod(0o1777)  # as /tmp is: others add names, and cannot replace ours
    require_private_cache()
    cache.parent.chmod(0o777)
    with pytest.raises(KernelCacheError, match=r"cache can be written by others.*WARP_CACHE_PATH"):
        require_private_cache()


@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o707])
def test_a_cache_that_others_can_write_is_refused(cache, mode):
    cache.chmod(mode)
    with pytest.raises(KernelCacheError, match=r"1\.0 can be written by others"):
        require_private_cache()


def test_a_cache_that_a_group_can_write_is_refused_unless_the_group_is_its_user(cache, monkeypatch):
    cache.chmod(0o770)
    monkeypatch.setattr(kernel_cache, "_is_own_group", lambda gid: True)
    require_private_cache()
    monkeypatch.setattr(kernel_cache, "_is_own_group", lambda gid: False)
    with pytest.raises(KernelCacheError, match="can be written by others"):
        require_private_cache()


def test_what_somebody_has_planted_is_refused(cache, monkeypatch):
    """As by whoever was first to make the folder of a documented name."""
    monkeypatch.setattr(os, "geteuid", lambda: 65_533)
    with pytest.raises(KernelCacheError, match="belongs to"):
        require_private_cache()


def test_links_to_a_folder_of_others_are_followed_before_it_is_judged(cache, tmp_path, monkeypatch):
    (tmp_path / "link").symlink_to(cache)
    cache.chmod(0o777)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "link"))
    with pytest.raises(KernelCacheError, match=r"cache/1\.0 can be written"):
        require_private_cache()


@pytest.mark.exhaustive
@pytest.mark.parametrize("place", ["/dev/null/x", "{}/file"])
def test_a_cache_that_cannot_be_made_is_named_with_the_remedy_and_another_serves(place, tmp_path):
    (tmp_path / "file").write_bytes(b"")
    words = [*PALPATE, "render", "cube", "exploration", "-o", str(tmp_path / "a.h5")]
    environment = os.environ | {"WARP_CACHE_PATH": place.format(tmp_path)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "cannot be written: set WARP_CACHE_PATH" in done.stderr
    assert (tmp_path / "a.h5").exists()
    assert "Traceback" not in done.stderr


@pytest.mark.exhaustive
def test_a_new_cache_is_its_users_alone_and_a_shared_one_ends_the_command(tmp_path):
    made, shared = tmp_path / "made", tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    start = "import os; os.umask(0); from palpate.render.runtime.warp_start import start_warp; start_warp()"
    subprocess.run([sys.executable, "-c", start], env=os.environ | {"WARP_CACHE_PATH": str(made)}, check=True)
    for folder in (made, made / wp.config.version):
        assert folder.stat().st_mode & 0o777 == 0o700
    words = [*PALPATE, "render", "cube", "exploration", "-o", str(tmp_path / "a.h5")]
    done = subprocess.run(words, env=os.environ | {"WARP_CACHE_PATH": str(shared)}, capture_output=True, text=True)
    assert done.returncode == 1
    assert "can be written by others" in done.stderr
    assert not (tmp_path / "a.h5").exists()
