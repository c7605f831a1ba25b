"""CPU seconds of tests: the slowest are printed; with `--cpu-most` and `--cpu-sum` (in `.ci/run`), bounds.

They are CPU seconds of the test's process and of the child processes that it waits for. Wall time would depend on what
else the machine does. On a slower processor a calibration takes longer, and the bounds grow by the same factor. What
several tests share does not count: fixtures, and what only the first run of a test computes, as imports and caches are.

A test fails above `NOISE` times the bound; between the bound and that it is named, since two machines whose
calibrations are equal have used 0.29 and 0.34 s for one test.
"""

import resource
import time
from statistics import median

import numpy as np
import pytest
from _pytest.runner import runtestprotocol  # what pytest-rerunfailures uses, too: no public function runs a test again

CALIBRATION = 0.0147
"""CPU seconds of `calibrate` on the processor on which the bounds were set: an EPYC at 2.6 GHz (AMD, family 25)."""
SCALE_MOST = 3.0
NOISE = 1.5
"""How many times the bound a test may use: caches, clocks and neighbours of a machine add so much CPU time."""
SHOWN = 10
ROWS_MOST = 200


def cpu_seconds():
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in used)


def calibrate():
    """CPU seconds of a fixed piece of work, half in Python and half in NumPy: the least of five."""
    values = np.arange(200_000.0)

    def work():
        begin = time.process_time()
        sum(k * k for k in range(60_000))
        np.sort(np.sin(values))
        return time.process_time() - begin

    return min(work() for _ in range(5))


def measured_scale():
    """How many times longer than on the processor of the bounds the calibration takes, within 1 and `SCALE_MOST`."""
    return min(SCALE_MOST, max(1.0, calibrate() / CALIBRATION))


def pytest_addoption(parser):
    group = parser.getgroup("cpu", "CPU seconds of tests")
    group.addoption("--cpu-most", type=float, help="a test that uses more CPU seconds fails, unless it is exhaustive")
    group.addoption("--cpu-sum", type=float, help="the run fails if its tests use more CPU seconds together")


class CpuTime:
    """Measures each test in the process that runs it, and holds it to the bound."""

    def __init__(self, most):
        self.most = most
        self.scale = measured_scale() if most else 1.0
        self.rows = {}
        self.near = []
        self.wider = 0.0  # of fixtures that several tests share
        self.is_in_wider = False

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        if fixturedef.scope == "function" or self.is_in_wider:  # what a shared fixture asks for is counted with it
            return (yield)
        begin, self.is_in_wider = cpu_seconds(), True
        try:
            return (yield)
        finally:
            self.wider, self.is_in_wider = self.wider + cpu_seconds() - begin, False

    def run(self, item, nextitem):
        """Reports of a test, and CPU seconds: its own, and all."""
        begin, self.wider = cpu_seconds(), 0.0
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        used = cpu_seconds() - begin
        return reports, used - self.wider, used

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item, nextitem):
        """Run a test; if it is over the bound, once more: imports and what else is done once do not count."""
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports, own, used = self.run(item, nextitem)
        self.rows[item.nodeid] = used
        bounded = self.most and item.get_closest_marker("exhaustive") is None
        if bounded and own > self.most * self.scale and all(report.passed for report in reports):
            item._initrequest()
            reports, again, _ = self.run(item, nextitem)
            self.scale = max(self.scale, measured_scale())
            call = next((report for report in reports if report.when == "call"), None)
            bound = self.most * self.scale
            if call is not None and min(own, again) > bound:
                text = (
                    f"used {min(own, again):.2f} s of CPU, but a quick test may use {bound:.2f} s "
                    f"({self.most:g} s x {self.scale:.2f} for this machine): make it cheaper, or mark it exhaustive"
                )
                if min(own, again) > NOISE * bound:
                    call.outcome, call.longrepr = "failed", text
                else:
                    self.near.append(f"{item.nodeid}: {text}")
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def pytest_sessionfinish(self, session):
        rows = sorted(self.rows.items(), key=lambda row: -row[1])
        found = {"sum": sum(self.rows.values()), "count": len(rows), "scale": self.scale, "rows": rows[:ROWS_MOST]}
        found["near"] = self.near
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["cpu"] = found
        else:
            session.config.pluginmanager.get_plugin("cpu_summary").parts.append(found)


class CpuSummary:
    """Adds up what the processes measured, prints the slowest tests, and fails a run that is over its bound."""

    def __init__(self, most):
        self.most = most
        self.parts = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        self.parts += [own] if (own := getattr(node, "workeroutput", {}).get("cpu")) else []

    @property
    def scale(self):
        return median(part["scale"] for part in self.parts) if self.parts else 1.0

    @property
    def seconds(self):
        return sum(part["sum"] for part in self.parts)

    def is_over(self):
        return self.most is not None and self.seconds > self.most * self.scale

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session):
        if self.is_over() and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter):
        for text in (text for part in self.parts for text in part["near"]):
            terminalreporter.line(f"over the bound, within its noise of {NOISE:g}: {text}", yellow=True)
        rows = sorted((row for part in self.parts for row in part["rows"]), key=lambda row: -row[1])[:SHOWN]
        if len(rows) < SHOWN and self.most is None:
            return
        terminalreporter.section("CPU seconds of the slowest tests")
        for test, used in rows:
            terminalreporter.line(f"{used:6.2f} {test}")
        terminalreporter.line(f"{self.seconds:6.1f} s of CPU in {sum(part['count'] for part in self.parts)} tests")
        if self.is_over():
            bound = self.most * self.scale
            terminalreporter.line(
                f"over the bound of {bound:.0f} s: make tests cheaper, or mark some exhaustive", red=True
            )


def pytest_configure(config):
    most = config.getoption("--cpu-most")
    is_worker = hasattr(config, "workerinput")
    if not is_worker:
        config.pluginmanager.register(CpuSummary(config.getoption("--cpu-sum")), "cpu_summary")
    if is_worker or not config.getoption("numprocesses", None):
        config.pluginmanager.register(CpuTime(most), "cpu_of_tests")
