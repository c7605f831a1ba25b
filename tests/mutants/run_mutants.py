"""Mutants: one fault a patch. Each is put into a copy of the source, where the tests that it names must fail.

    .venv/bin/python tests/mutants/run_mutants.py                # all
    .venv/bin/python tests/mutants/run_mutants.py objects playback     # of some rooms, or single patches by path
    .venv/bin/python tests/mutants/run_mutants.py --reach        # of source or tests that changed since .ci/proved

A patch `tests/mutants/ROOM/NAME.patch` begins with these lines, then a diff as `git diff` writes it:

    Fault: the player reports off although it sent no off frame.
    Tests: tests/device/playing/test_player.py tests/device/playing/test_signals.py
    Marks: exhaustive                                            # only if quick tests alone do not find it

A mutant dies if at least one of these tests fails; without the patch they pass, as the suite shows. Exit code 1: one
lives, no longer applies (rewrite it, for the code that does its work now), or breaks import or collection, which proves
nothing about tests.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).parent
sys.path.insert(0, str(ROOT / "tests" / "suite"))

from reach import changed_rooms, proved_digests, reaches_all, used_rooms  # noqa: E402 - the path to it stands above
from rooms import digests, folder_of  # noqa: E402

PACKAGES = ("kernels", "render", "device", "datasets")
TIMEOUT = 120.0
"""Seconds that the tests of one mutant may take: a fault that makes them hang is found, too."""


@dataclass(frozen=True)
class Mutant:
    """A patch with the fault that it makes and the tests that must fail."""

    path: Path
    fault: str
    tests: tuple[str, ...]
    marks: str

    @property
    def name(self) -> str:
        return self.path.relative_to(FOLDER).with_suffix("").as_posix()

    @property
    def rooms(self) -> set[str]:
        """Its own folder, those of the source that it changes and of its tests, and those of what its tests share."""
        tests = [ROOT / test.partition("::")[0] for test in self.tests]
        files = [ROOT / name for name in re.findall(r"^\+\+\+ b/(.+)$", self.path.read_text(), re.MULTILINE)]
        shared = {room for test in tests if test.is_file() for room in used_rooms(test) if room.startswith("tests/")}
        return {folder_of(file) for file in (self.path, *files, *tests)} | shared


def read_mutant(path: Path) -> Mutant:
    head = path.read_text().partition("\ndiff --git ")[0]
    fields = dict(re.findall(r"^(Fault|Tests|Marks): (.+)$", head, re.MULTILINE))
    if not {"Fault", "Tests"} <= fields.keys():
        sys.exit(f"{path}: its first lines must be 'Fault: ...' and 'Tests: ...'")
    tests = tuple(fields["Tests"].split())
    if missing := [test for test in tests if not (ROOT / test.partition("::")[0]).exists()]:
        sys.exit(f"{path}: there is no {', '.join(missing)}")
    return Mutant(path, fields["Fault"], tests, fields.get("Marks", "not exhaustive"))


def copy_tree(folder: Path) -> None:
    """What git tracks or would track, as it is now, and the namespace of the four packages beside it."""
    words = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in filter(None, subprocess.check_output(words, cwd=ROOT, text=True).split("\0")):
        if (ROOT / name).is_file():
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / "source" / name)
    (folder / "names" / "palpate").mkdir(parents=True)
    for package in PACKAGES:
        (folder / "names" / "palpate" / package).symlink_to(folder / "source" / package)


def apply(mutant: Mutant, source: Path, *options: str) -> str:
    """What git says if the patch does not apply; nothing if it does."""
    environment = os.environ | {"GIT_CEILING_DIRECTORIES": str(source.parent)}
    words = ["git", "apply", *options, str(mutant.path)]
    return subprocess.run(words, cwd=source, env=environment, capture_output=True, text=True, check=False).stderr


def judge(mutant: Mutant, folder: Path) -> tuple[str, str]:
    """'dies', 'lives' or what is wrong with the mutant; and the last lines of its tests."""
    source = folder / "source"
    if refusal := apply(mutant, source):
        return "does not apply", refusal
    own = [str(folder / "names"), os.environ.get("PYTHONPATH")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, own))}
    words = [
        sys.executable,
        "-P",
        "-m",
        "pytest",
        "-q",
        "-x",
        "--no-header",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
    ]
    words += ["-m", mutant.marks, "--device", "cpu", *mutant.tests]
    try:
        done = subprocess.run(
            words, cwd=source, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return "dies", f"no end after {TIMEOUT:g} s"
    finally:
        apply(mutant, source, "-R")
    outcome = {0: "lives", 1: "dies"}.get(done.returncode, f"breaks the tests themselves (exit code {done.returncode})")
    if outcome == "dies" and not re.search(r"\d+ (failed|error)", done.stdout):
        outcome = "breaks the tests themselves"
    return outcome, done.stdout[-1500:] + done.stderr[-500:]


def selected(words: list[str]) -> list[Path]:
    found = []
    for word in words or ["."]:
        place = Path(word) if word.endswith(".patch") else FOLDER / word
        found += [place.resolve()] if place.is_file() else sorted(place.rglob("*.patch"))
        if not found:
            sys.exit(f"no patch in {place}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rooms", nargs="*", help="folders of tests/mutants, or patches; default: all")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="mutants at a time")
    parser.add_argument("--reach", action="store_true", help="only those whose source or tests changed")
    options = parser.parse_args()
    mutants = [read_mutant(path) for path in selected(options.rooms)]
    changed = changed_rooms(proved_digests(), digests()) if options.reach else set()
    if options.reach and not reaches_all(changed):
        mutants = [mutant for mutant in mutants if mutant.rooms & changed]
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        free: Queue[Path] = Queue()
        for job in range(options.jobs):
            copy_tree(Path(scratch, str(job)))
            free.put(Path(scratch, str(job)))

        def run(mutant: Mutant) -> tuple[Mutant, str, str, float]:
            folder, begin = free.get(), time.monotonic()
            try:
                return mutant, *judge(mutant, folder), time.monotonic() - begin
            finally:
                free.put(folder)

        with ThreadPoolExecutor(options.jobs) as pool:
            for mutant, outcome, text, seconds in pool.map(run, mutants):
                print(f"{outcome:6} {mutant.name} ({seconds:.0f} s): {mutant.fault}", flush=True)
                if outcome != "dies":
                    wrong += 1
                    print(text, flush=True)
    print(f"{len(mutants) - wrong} of {len(mutants)} mutants die")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
