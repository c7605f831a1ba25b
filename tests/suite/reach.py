"""`--reach`: of the tests that were collected, those that a change reaches; `--budget`: as many as fit into a time.

`.ci/proved` holds a digest of each folder, of the state for which every test passed; folders with another content have
changed. A change reaches a test
- if it is in the test's folder, in the room that this folder mirrors, or in a room that this one imports;
- if the test imports or names the changed room, or imports shared modules of a changed folder of tests;
- if it is in a folder of documents, benchmarks or CI, or a file of the root, whose name stands in the test.
A change of `pyproject.toml`, `tests/conftest.py` or `tests/suite` reaches every test.
"""

import re
import time
from collections import Counter
from functools import cache

import pytest
from rooms import ROOT, ROOT_FILES, digests, folder_of, imported_rooms, importers

PROVED = ROOT / ".ci" / "proved"
READ = ("docs", "benchmarks", ".ci", *ROOT_FILES)
SHARED = ("tests/cases", "tests/oracles", "tests/faults", "tests/device/tiers", "tests/suite")


def pytest_addoption(parser):
    group = parser.getgroup("reach", "tests that a change reaches")
    group.addoption("--reach", action="store_true", help="only tests that a change since .ci/proved reaches")
    group.addoption("--budget", type=float, help="seconds after which no further test begins; prints what is left out")


def proved_digests(path=PROVED):
    """Digests of the folders for which every test passed; none if the file is missing or cannot be read."""
    try:
        rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
        return {room: digest for digest, room in rows}
    except (OSError, ValueError):
        return {}


def changed_rooms(proved, now):
    """Folders whose content is not the one that was proved, gone ones too."""
    return {room for room in proved.keys() | now.keys() if proved.get(room) != now.get(room)}


def reaches_all(changed):
    return bool(changed & {"pyproject.toml", "tests", "tests/suite"})


def mirrored(folder):
    """The room of the source that a folder of tests mirrors."""
    return folder.removeprefix("tests/")


@cache
def shared_files():
    return {path.stem: path for folder in SHARED for path in (ROOT / folder).rglob("*.py")}


@cache
def used_rooms(path):
    """Rooms that a file of the tests imports or names, by itself and by shared modules; and the folders of these."""
    found, waiting = set(), [path]
    while waiting:
        for name in re.findall(r"^\s*(?:from|import) (\w+)", waiting.pop().read_text(), re.MULTILINE):
            if (file := shared_files().get(name)) and file not in found:
                found.add(file)
                waiting.append(file)
    return frozenset().union(*map(imported_rooms, found | {path}), (folder_of(file) for file in found))


def rank_of(path, changed):
    """0: the test or its room changed; 1: the room imports one that did; 2: it uses one; None: not reached."""
    folder = folder_of(path)
    room = mirrored(folder)
    if {folder, room} & changed:
        return 0
    if any(room in importers()[other] for other in changed & importers().keys()):
        return 1
    if used_rooms(path) & changed:
        return 2
    text, tops = path.read_text(), {room.split("/")[0] for room in changed}
    return 2 if any(top in tops and re.search(rf"(?<!\w){re.escape(top)}(?!\w)", text) for top in READ) else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Deselect what is not reached; order what is: the nearest first, and of each test its first example first."""
    if not config.getoption("--reach"):
        return
    changed = changed_rooms(proved_digests(), digests())
    ranks = {path: rank_of(path, changed) for path in {item.path for item in items}}
    if reaches_all(changed):
        ranks = {path: 3 if rank is None else rank for path, rank in ranks.items()}
    reached = [item for item in items if ranks[item.path] is not None]
    config.hook.pytest_deselected(items=[item for item in items if ranks[item.path] is None])
    count = Counter()
    places = []
    for item in reached:
        test = item.nodeid.partition("[")[0]
        places.append((ranks[item.path], count[test]))
        count[test] += 1
    items[:] = [reached[k] for k in sorted(range(len(reached)), key=places.__getitem__)]


def pytest_terminal_summary(terminalreporter, config):
    if config.getoption("--reach"):
        changed = changed_rooms(proved_digests(), digests())
        shown = ", ".join(sorted(changed)) or "nothing"
        terminalreporter.line(f"changed since .ci/proved: {shown}{' (reaches all)' if reaches_all(changed) else ''}")


class Budget:
    """Skips tests that would begin after the time is up."""

    def __init__(self, seconds):
        self.seconds = seconds
        self.begin = None

    def pytest_runtest_setup(self, item):
        self.begin = self.begin or time.monotonic()
        if time.monotonic() - self.begin > self.seconds:
            pytest.skip(f"the budget of {self.seconds:g} s is used up")


class LeftOut:
    """Prints by name, once for all examples of a test, what the budget left out."""

    def __init__(self):
        self.tests = Counter()

    def pytest_runtest_logreport(self, report):
        if report.skipped and isinstance(report.longrepr, tuple) and "the budget of" in report.longrepr[2]:
            self.tests[report.nodeid.partition("[")[0]] += 1

    def pytest_terminal_summary(self, terminalreporter):
        if not self.tests:
            return
        terminalreporter.section("left out by the budget: .ci/release runs them")
        for test, count in sorted(self.tests.items()):
            terminalreporter.line(f"{test} ({count})" if count > 1 else test)
        terminalreporter.line(f"{self.tests.total()} tests left out")


def pytest_configure(config):
    seconds = config.getoption("--budget")
    if seconds is None:
        return
    if not seconds > 0:
        raise pytest.UsageError(f"--budget must be above 0 s, not {seconds:g}")
    config.pluginmanager.register(Budget(seconds))
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(LeftOut())


def proved_text():
    """What .ci/proved holds if every test passed for the tree as it is now."""
    lines = [
        "# Written by .ci/release: the content of each folder (SHA-256, 128 bits of it) for which every test passed."
    ]
    return "\n".join([*lines, *(f"{digest} {room}" for room, digest in sorted(digests().items())), ""])


if __name__ == "__main__":
    print(proved_text(), end="")
