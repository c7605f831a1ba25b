"""Damaged files in the cache of compiled kernels: found before they are loaded, removed, and compiled anew.

The truths are Warp's own compiler and loader, which kernels go through here, and `sha256sum`, which reads the seals.
"""

import errno
import os
import shutil
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from palpate.datasets.storage.durable import FolderLock
from palpate.render.errors import KernelCacheError, PalpateWarning
from palpate.render.runtime import kernel_cache
from palpate.render.runtime.sealed_kernels import guard_kernels

real_sleep = time.sleep


@wp.kernel(module="palpate_test_sealed_kernels", enable_backward=False)
def double(values: wp.array(dtype=float)):
    place = wp.tid()
    values[place] = 2.0 * values[place]


UNLOADABLE = {  # object and metadata are written anew, as a power cut may leave them
    "an object cut off": lambda o, m: o.write_bytes(o.read_bytes()[:700]),
    "no object and empty metadata": lambda o, m: (o.unlink(), m.write_bytes(b"")),
    "metadata that are no text": lambda o, m: m.write_bytes(b"\xff\xfe\x80"),
    "a file for the module's folder": lambda o, m: (shutil.rmtree(o.parent), o.parent.write_bytes(b"")),
}
LOADABLE = {  # these Warp loads without a word, and may crash in
    "an object of zeros": lambda o, m: o.write_bytes(bytes(o.stat().st_size)),
    "zeros within an object": lambda o, m: o.write_bytes(o.read_bytes()[:512] + bytes(256) + o.read_bytes()[768:]),
    "metadata of another kernel": lambda o, m: m.write_bytes(b"{}"),
    "no object": lambda o, m: o.unlink(),
    "no metadata": lambda o, m: m.unlink(),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A cache with one module, compiled and sealed."""
    wp.init()
    folder, before = tmp_path_factory.mktemp("whole"), wp.config.kernel_cache_dir
    guard_kernels()
    wp.config.kernel_cache_dir = str(folder)
    try:
        run()
    finally:
        wp.config.kernel_cache_dir = before
    return folder


@pytest.fixture
def cache(whole, tmp_path, monkeypatch):
    """A copy of that cache, which Warp has now."""
    shutil.copytree(whole, tmp_path / "cache")
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "cache"))
    return tmp_path / "cache"


def run():
    """Load the kernel from the cache, and launch it."""
    double.module.unload()
    values = wp.array([1.0, -3.0], dtype=float, device="cpu")
    wp.launch(double, 2, inputs=[values], device="cpu")
    assert np.array_equal(values.numpy(), [2.0, -6.0])


def files(cache):
    """The object, the metadata and the seal of the one module in a cache."""
    return next(cache.rglob("*.o")), next(cache.rglob("*.meta")), next(cache.rglob("*.o.sha256"))


def test_a_seal_is_what_sha256sum_reads(cache):
    seal = files(cache)[2]
    check = ["sha256sum", "--check", "--strict", seal.name]
    assert subprocess.run(check, cwd=seal.parent, capture_output=True).returncode == 0
    assert len(seal.read_text().splitlines()) == 2


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("damage", [*UNLOADABLE.values(), *LOADABLE.values()], ids=[*UNLOADABLE, *LOADABLE])
def test_a_damaged_module_is_removed_with_one_warning_and_compiled_anew(cache, whole, damage):
    damage(*files(cache)[:2])
    with pytest.warns(PalpateWarning, match=rf"^{cache}: compiled kernels were damaged .* compiled anew$") as told:
        run()
    assert len(told) == 1
    assert {path.name for path in cache.rglob("*")} == {path.name for path in whole.rglob("*")}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run()


@pytest.mark.exhaustive
@pytest.mark.parametrize("damage", UNLOADABLE.values(), ids=UNLOADABLE)
def test_modules_of_other_programs_have_no_seal_and_are_compiled_anew_if_damaged(cache, damage):
    found, meta, seal = files(cache)
    seal.unlink()
    damage(found, meta)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)
        run()
    assert files(cache)[2].is_file()


def test_a_module_without_a_seal_is_used_unless_the_power_may_have_failed_since(cache):
    found, _, seal = files(cache)
    seal.unlink()
    before = found.stat().st_mtime_ns
    run()
    assert found.stat().st_mtime_ns == before
    assert not seal.exists()
    then = time.time() - time.clock_gettime(time.CLOCK_BOOTTIME) - 10
    os.utime(found, (then, then))
    run()
    assert files(cache)[0].stat().st_mtime > then + 10
    assert seal.exists()


def test_a_damaged_module_of_a_cache_for_reading_is_replaced_where_it_is_linked(cache, tmp_path, monkeypatch):
    module, links = files(cache)[0].parent, tmp_path / "links"
    links.mkdir()
    (links / module.name).symlink_to(module)
    files(cache)[0].write_bytes(b"")
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(links))
    with pytest.warns(PalpateWarning, match="compiled anew"):
        run()
    assert files(cache)[0].stat().st_size == 0
    assert not (links / module.name).is_symlink()


def test_a_damaged_module_that_cannot_be_removed_is_named_with_the_way_out(cache, monkeypatch):
    def refuse(*paths):
        raise PermissionError(13, "Permission denied", *paths)

    files(cache)[0].write_bytes(b"")
    monkeypatch.setattr(os, "rename", refuse)
    with pytest.raises(KernelCacheError, match=r"wp_palpate_test\S+: .*damaged.*Permission denied.*WARP_CACHE_PATH"):
        run()


def test_an_old_module_that_cannot_be_removed_is_loaded_as_it_is(cache, monkeypatch):
    """Of a script, whose cache may be another user's; overlayfs renames no folder of an image's layer, either."""

    def refuse(*paths):
        raise OSError(errno.EXDEV, "Invalid cross-device link", *paths)

    found, _, seal = files(cache)
    seal.unlink()
    os.utime(found, (1e9, 1e9))  # in 2001, before this machine started
    monkeypatch.setattr(os, "rename", refuse)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run()
    assert found.stat().st_mtime == 1e9


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_an_object_that_a_full_disk_cuts_off_is_never_sealed(cache, monkeypatch):
    build = wp._src.build.build_cpu

    def build_on_a_full_disk(path, *rest, **options):
        build(path, *rest, **options)
        os.truncate(path, 700)

    shutil.rmtree(files(cache)[0].parent)
    with monkeypatch.context() as patch:
        patch.setattr(wp._src.build, "build_cpu", build_on_a_full_disk)
        with pytest.raises(Exception, match="Failed to load CPU module"):
            run()
    assert not list(cache.rglob("*.sha256"))
    run()
    assert files(cache)[2].is_file()


def test_threads_that_need_a_module_at_once_share_one(cache):
    run()  # compiled, so that both threads only load it
    module, both = wp.get_module("palpate_test_sealed_kernels"), threading.Barrier(2)
    for _ in range(20):
        module.unload()

        def load():
            both.wait()
            return module.load("cpu", 1)

        with ThreadPoolExecutor(2) as pool:
            first, second = (own.result() for own in [pool.submit(load), pool.submit(load)])
        assert first is second


def test_a_module_that_another_process_compiles_is_waited_for_and_not_compiled_again(cache, tmp_path, monkeypatch):
    """The other process is this test: it holds the lock, and gives the module its name while the thread waits."""
    module, waits = files(cache)[0].parent, threading.Event()
    module.rename(tmp_path / "compiled by another")
    lock = FolderLock(cache, f"{module.name}.lock")
    monkeypatch.setattr(kernel_cache.time, "sleep", lambda seconds: waits.set() or real_sleep(seconds))
    monkeypatch.setattr(wp._src.build, "build_cpu", lambda *words, **options: pytest.fail("is compiled again"))
    with ThreadPoolExecutor(1) as pool:
        loaded = pool.submit(run)
        assert waits.wait(20)
        (tmp_path / "compiled by another").rename(module)
        lock.release()
        loaded.result()
    assert [path.name for path in cache.iterdir()] == [module.name]  # the lock's file is gone


COMPILING = """
import sys
import warp as wp
from palpate.kernels import compile_kernels
from palpate.render.runtime.warp_start import start_warp

start_warp()
build, built = wp._src.build.build_cpu, []
wp._src.build.build_cpu = lambda *words, **options: (built.append(1), build(*words, **options))[1]
print("ready", flush=True)
sys.stdin.readline()
compile_kernels("cpu", ("sampling.contour_faults",))
print(len(built))
"""


@pytest.mark.exhaustive
def test_processes_that_lack_a_module_at_once_compile_it_once(tmp_path):
    tmp_path.chmod(0o700)
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([sys.executable, "-c", COMPILING], env=environment, **pipes) for _ in range(3)]
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("go\n")
        process.stdin.flush()
    counts = [int(process.communicate()[0]) for process in processes]
    assert (sorted(counts), [process.returncode for process in processes]) == ([0, 0, 1], [0, 0, 0])


def test_warp_has_what_is_guarded():
    guard_kernels()
    assert [wp.Module._compile.__name__, wp.Module.load.__name__] == ["_compile", "load"]
    assert hasattr(wp.Module._compile, "__wrapped__")
    assert not hasattr(wp.Module._compile.__wrapped__, "__wrapped__")
    assert Path(wp.Module._compile.__code__.co_filename).name == "sealed_kernels.py"
