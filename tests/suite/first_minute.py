"""A run's first minute: kernels are compiled while workers collect, and workers collect from both ends.

To collect tests, pytest rewrites and compiles every file of them, and keeps the result on disk. Workers that go
through the files in the same order all do the same work at the same time. Therefore every second worker begins at the
end: where two workers meet, each finds on disk what the other one has made.
"""

import gc
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
import warp as wp

READY = "PALPATE_TEST_KERNELS"
"""Environment variable: the file that appears when kernels are compiled, or cannot be."""
COMPILE = """
import sys
import warp
warp.config.log_level = warp.LOG_WARNING
from palpate.kernels import compile_kernels
for device in sys.argv[1:]:
    compile_kernels(device)
"""
WITHOUT_KERNELS = ("datasets", "device", "faults")
"""Folders of tests that run while kernels are compiled: most of them need none."""


def keep_bytecode():
    """Keep bytecode for this run where Python is asked to write none: else each child process compiles every module."""
    if not sys.dont_write_bytecode:
        return None
    folder = tempfile.TemporaryDirectory(prefix="palpate-bytecode-")
    sys.dont_write_bytecode, sys.pycache_prefix = False, folder.name
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = folder.name
    return folder


class Controller:
    """Compiles kernels in a process beside the workers."""

    def __init__(self, devices):
        self.bytecode = keep_bytecode()
        self.folder = tempfile.TemporaryDirectory(prefix="palpate-kernels-")
        self.ready = Path(self.folder.name, "ready")
        self.failure = ""
        os.environ[READY] = str(self.ready)
        words = [sys.executable, "-c", COMPILE, *devices]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.thread = threading.Thread(target=self.wait, daemon=True)
        self.thread.start()

    def wait(self):
        printed, _ = self.process.communicate()
        self.failure = printed if self.process.returncode else ""
        self.ready.touch()

    def pytest_sessionfinish(self, session):
        """A run whose kernels do not compile fails, even if no test needs the one that is wrong."""
        if self.failure and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter):
        if self.failure:
            terminalreporter.section("kernels that were to be compiled before the tests")
            terminalreporter.line(self.failure)

    def pytest_unconfigure(self):
        if self.process.poll() is None:
            self.process.kill()
        self.thread.join()
        self.folder.cleanup()


class Worker:
    """Collects from its own end, and waits for the kernels before its first test that needs them."""

    def __init__(self, number, ready):
        self.is_reversed = number % 2 == 1
        self.ready = ready

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector):
        report = yield
        if self.is_reversed and isinstance(collector, pytest.Dir) and report.result:
            report.result.reverse()
        return report

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items):
        """All workers must have the same order; within a file it is the same already."""
        items.sort(key=lambda item: str(item.path))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        """If kernels could not be compiled, the tests that need them compile them, and show what is wrong."""
        if self.ready and not set(WITHOUT_KERNELS) & set(item.path.relative_to(item.config.rootpath).parts):
            while not self.ready.exists():
                time.sleep(0.02)
            self.ready = None
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """No garbage is collected meanwhile: syntax trees make millions of objects, and hardly any garbage."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_configure(config):
    if hasattr(config, "workerinput"):
        ready = os.environ.get(READY)
        number = int(config.workerinput["workerid"].removeprefix("gw"))
        config.pluginmanager.register(Worker(number, Path(ready) if ready else None))
    elif config.getoption("numprocesses", None):
        devices = config.getoption("--device") or [str(device) for device in wp.get_devices()]
        if config.getoption("--lanes"):  # its kernels are others, which each worker compiles
            config.bytecode = keep_bytecode()
        else:
            config.pluginmanager.register(Controller(devices))
