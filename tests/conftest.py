"""Devices to test on, kernels compiled once, hypothesis without clocks; modules that need what is not here skipped."""

import gc
import os

if "PYTEST_XDIST_WORKER" in os.environ:  # before NumPy starts its threads: a worker has one core
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import signal
from collections import Counter
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
import warp as wp

try:
    import hypothesis
except ModuleNotFoundError:  # a machine with a GPU, Warp, NumPy and pytest only
    hypothesis = None

pytest_plugins = ["cpu_time", "first_minute", "reach"]  # tests/suite, by pyproject's pythonpath

wp.config.log_level = wp.LOG_WARNING
os.environ["PALPATE_CACHE"] = "off"  # no test reads or fills the user's cache; those of the cache name a folder

if hypothesis:
    hypothesis.settings.register_profile("default", deadline=None, max_examples=50)
    hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
    hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default")


def pytest_addoption(parser):
    parser.addoption(
        "--device", action="append", help="Warp device to test on (again for more); default: all there are"
    )
    parser.addoption(
        "--lanes",
        choices=("rising", "falling"),
        help="kernels/section runs on the CPU what it runs on GPUs; lanes in this order",
    )


def pytest_configure(config):
    """Usual signal handlers, the way to shared modules, markers, and lanes on a CPU if they are asked for."""
    # A shell's `&` ignores SIGINT and `nohup` SIGHUP; processes of tests would inherit that.
    for signum, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(signum) is signal.SIG_IGN:
            signal.signal(signum, usual)
    shared = [str(path) for path in config.getini("pythonpath")]  # child processes find what tests share, too
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [*shared, os.environ.get("PYTHONPATH")]))
    for line in (
        "stress: many poses on large meshes; seconds each",
        "exhaustive(after=0, but=''): runs only with -m '' or -m exhaustive; the first `after` examples "
        "of a test, and those whose id has `but`, run always",
    ):
        config.addinivalue_line("markers", line)
    if config.getoption("--lanes"):
        if config.getoption("--device") not in (None, ["cpu"]):
            raise pytest.UsageError(f"--lanes is for the CPU alone, not for --device {config.getoption('--device')}")
        config.option.device = ["cpu"]
        from lanes_on_cpu import emulate_lanes

        emulate_lanes(config.getoption("--lanes"))


@pytest.fixture(autouse=True)
def signal_handlers():
    """Those of before, after each test: a command that a signal ends leaves signals ignored, as its process ends."""
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(signum) for signum in signals]
    yield
    for signum, handler in zip(signals, before, strict=True):
        if signal.getsignal(signum) is not handler:
            signal.signal(signum, handler)


def is_absent(error):
    """Whether a package of others is not installed; where CI runs, that is an error like any."""
    while isinstance(error, Exception) and not isinstance(error, ModuleNotFoundError):
        error = error.__cause__
    if error is None or os.environ.get("CI"):
        return False
    if isinstance(error, PackageNotFoundError):
        return True
    own = {path.stem for path in Path(__file__).parent.rglob("*.py")} | {"palpate"}
    return (error.name or "").split(".")[0] not in own


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skip a module, with the reason, if it imports a package that is not installed."""
    report = yield
    error = report.call.excinfo.value if report.failed and report.call.excinfo else None
    if is_absent(error):
        while not isinstance(error, ModuleNotFoundError):
            error = error.__cause__
        report.outcome, report.longrepr = "skipped", (str(collector.path), 1, f"Skipped: {error}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    """Skip a test, with the reason, if it asks for a package that is not installed."""
    try:
        return (yield)
    except ModuleNotFoundError as error:
        if not is_absent(error):
            raise
        pytest.skip(str(error))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Take the mark `exhaustive` from the examples that run always; -m deselects the others."""
    count = Counter()
    for item in items:
        mark = item.get_closest_marker("exhaustive")
        if mark is None or not mark.kwargs:
            continue
        after, but = mark.kwargs.get("after", 0), mark.kwargs.get("but", "")
        test = (item.parent.nodeid, item.originalname, item.callspec.params.get("device"))
        count[test] += 1
        if count[test] <= after or (but and but in item.callspec.id):
            item.own_markers.remove(mark)


def start_hypothesis():
    """Run the shortest of its tests."""

    @hypothesis.settings(max_examples=1, database=None)
    @hypothesis.given(hypothesis.strategies.none())
    def run(value):
        assert value is None

    run()


def pytest_collection_finish():
    """Leave modules and tests out of garbage collection: going through them all was a sixth of the time."""
    if hypothesis:  # it looks for who refers to its generator when it is first used, and does not see what is frozen
        start_hypothesis()
    gc.collect()
    gc.freeze()


def pytest_generate_tests(metafunc):
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", metafunc.config.getoption("--device") or [str(d) for d in wp.get_devices()])


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


@pytest.fixture(scope="session")
def outside_data():
    """Folder of real recordings and meshes that are not part of the project."""
    folder = os.environ.get("PALPATE_TEST_DATA")
    if not folder:
        pytest.skip("PALPATE_TEST_DATA is not set: no real recordings and meshes to test with")
    if not Path(folder).is_dir():
        pytest.fail(f"PALPATE_TEST_DATA={folder} is not a folder")
    return Path(folder)
