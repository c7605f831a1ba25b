"""Damages inputs of every loader and command, reads them within bounds of time and memory, and counts the outcomes.

    python tests/faults/fuzz.py --seconds 600 [--loader NAME] [--seed N]       # until the time is over
    python tests/faults/fuzz.py --cases 50                                     # so many of each loader
    python tests/faults/fuzz.py --loader NAME --seed N --case K                # one again, with its traceback

The same seed makes the same cases; without `--seed` it is a new one, which is printed. Failing inputs are kept in
`--out`, with the command that repeats each; the exit code is then 1.
"""

# ruff: noqa: E402  # what tests share must be found first

import argparse
import itertools
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

SHARED = [
    str(Path(__file__).parents[1] / name)
    for name in ("cases", "cases/solids", "cases/sweeps", "cases/arrays", "oracles")
]
sys.path += SHARED  # as pytest does; child processes read PYTHONPATH
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [*SHARED, os.environ.get("PYTHONPATH")]))
os.environ |= {"CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "1", "PALPATE_CACHE": "off"}

import numpy as np
import warp as wp
from bounded import BAD, KINDS, Outcome, Wrong, outcome_in_child
from fuzz_damage import PIPE, damage
from fuzz_readers import READERS, Reader

READ_MB = "256"
"""Budget of one file in cases [MB]: as `PALPATE_READ_MB`."""
BY_NAME = {reader.name: reader for reader in READERS}


class Case(NamedTuple):
    """One damaged input: the same for the same loader, seed and number."""

    loader: str
    seed: int
    number: int

    def make(self, seeds: Path, folder: Path) -> tuple[Path, str]:
        """Put it into a folder; the path to read and how it was damaged."""
        rng = random.Random(f"{self.seed} {self.loader} {self.number}")
        whole = rng.choice(sorted((seeds / self.loader).iterdir()))
        path = copied(whole, folder)
        for place in {folder, path if path.is_dir() else folder}:
            os.mkfifo(place / PIPE)
        file = path
        if path.is_dir():
            patterns = BY_NAME[self.loader].damaged
            found = {own for pattern in patterns for own in path.rglob(pattern.format(path.name)) if own.is_file()}
            file = rng.choice(sorted(found))
        return path, f"{whole.name}: {file.name} {damage(file, rng)}"

    @property
    def command(self) -> str:
        return f"python tests/faults/fuzz.py --loader '{self.loader}' --seed {self.seed} --case {self.number}"


def copied(whole: Path, folder: Path) -> Path:
    """A seed copied into an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / whole.name
    shutil.copytree(whole, path) if whole.is_dir() else shutil.copyfile(whole, path)
    return path


def compare(reader: Reader, path: Path, how: str, whole: Any) -> None:
    """Read a damaged input; raises Wrong for values that a checked format must not give back."""
    found = reader.read(path)
    if reader.is_checked and "structure" not in how and (where := difference(found, whole)):
        raise Wrong(f"read without an error, but {where} differs")


def difference(a: Any, b: Any) -> str:
    """The place where two values differ; empty if they do not."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        if (a.dtype, a.shape) != (b.dtype, b.shape):
            return "an array's type or shape"
        same = a.tolist() == b.tolist() if a.dtype.kind == "O" else a.tobytes() == b.tobytes()
        return "" if same else "an array"
    if isinstance(a, dict) and isinstance(b, dict):
        names = "names" if sorted(map(str, a)) != sorted(map(str, b)) else ""
        return names or next((f"{key}: {found}" for key in a if (found := difference(a[key], b[key]))), "")
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        length = "a length" if len(a) != len(b) else ""
        return length or next((found for pair in zip(a, b, strict=True) if (found := difference(*pair))), "")
    return "" if repr(a) == repr(b) else "a value"


class Fuzzer:
    """Seeds of some loaders, and what each holds undamaged."""

    def __init__(self, names: list[str], scratch: Path) -> None:
        self.seeds, self.scratch = scratch / "seeds", scratch
        warnings.simplefilter("ignore")
        np.seterr(all="ignore")
        wp.config.log_level = wp.LOG_ERROR
        self.wholes: dict[tuple[str, str], Any] = {}
        for name in names:
            (self.seeds / name).mkdir(parents=True)
            BY_NAME[name].seeds(self.seeds / name)
            for seed in sorted((self.seeds / name).iterdir()):  # a format that cannot read its seeds is a fault, too
                self.wholes[name, seed.name] = BY_NAME[name].read(copied(seed, scratch / "whole"))
        os.environ["PALPATE_READ_MB"] = READ_MB

    def run(self, case: Case) -> tuple[Case, str, Outcome]:
        """Make a case and read it in a child process."""
        path, how = case.make(self.seeds, self.scratch / f"case-{os.getpid()}")
        whole = self.wholes[case.loader, path.name]
        return case, how, outcome_in_child(lambda: compare(BY_NAME[case.loader], path, how, whole))

    def keep(self, case: Case, how: str, outcome: Outcome, out: Path) -> None:
        """Keep a failing input, with the command that repeats it."""
        folder = out / f"{case.loader.replace(' ', '-')}-{case.seed}-{case.number}"
        case.make(self.seeds, folder)
        for pipe in folder.rglob(PIPE):
            pipe.unlink()
        (folder / "outcome.txt").write_text(f"{case.command}\n{how}\n" + "\n".join(outcome) + "\n")


FUZZER: Fuzzer
"""Of the worker processes, which are forked from the one that made it."""


def run_case(case: Case) -> tuple[Case, str, Outcome]:
    """`Fuzzer.run` in a worker process."""
    return FUZZER.run(case)


def options_of(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, help="for how long; by default 60, or as --cases says")
    parser.add_argument("--cases", type=int, help="cases of each loader")
    parser.add_argument("--loader", action="append", choices=BY_NAME, help="only this one; may be repeated")
    parser.add_argument("--seed", type=int, default=random.randrange(10**6), help="by default a new one")
    parser.add_argument("--case", type=int, help="repeat this one case, in this process")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--out", type=Path, default=Path("fuzz-failures"), help="folder of failing inputs")
    parser.add_argument("--json", type=Path, help="write counts and failures there, too")
    return parser.parse_args(arguments)


def fuzz(options: argparse.Namespace, names: list[str]) -> list[tuple[Case, str, Outcome]]:
    """Cases of these loaders in turns, with their outcomes."""
    ends = time.monotonic() + (options.seconds or (60.0 if options.cases is None else float("inf")))
    done: list[tuple[Case, str, Outcome]] = []
    with ProcessPoolExecutor(options.workers, multiprocessing.get_context("fork")) as pool:
        for number in itertools.count() if options.cases is None else range(options.cases):
            if time.monotonic() > ends:
                break
            done += pool.map(run_case, [Case(name, options.seed, number) for name in names])
    return done


def main(arguments: list[str] | None = None) -> int:
    global FUZZER
    options = options_of(arguments)
    names = options.loader or list(BY_NAME)
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # in memory, if there is such a place
    with tempfile.TemporaryDirectory(prefix="palpate-fuzz-", dir=shared) as scratch:
        FUZZER = Fuzzer(names, Path(scratch))
        if options.case is not None:
            path, how = Case(names[0], options.seed, options.case).make(FUZZER.seeds, Path(scratch, "case"))
            sys.stdout.write(f"{path}\n{how}\n")
            compare(BY_NAME[names[0]], path, how, FUZZER.wholes[names[0], path.name])
            return 0
        done = fuzz(options, names)
        bad = [own for own in done if own[2].kind in BAD]
        for case, how, outcome in bad[:100]:
            FUZZER.keep(case, how, outcome, options.out)
    counts = {name: Counter(outcome.kind for case, _, outcome in done if case.loader == name) for name in names}
    faults = [f"{outcome.kind}: {outcome.text}\n  {how}\n  {case.command}" for case, how, outcome in bad]
    for name, own in counts.items():
        sys.stdout.write(f"{name:20} " + ", ".join(f"{own[kind]} {kind}" for kind in KINDS if own[kind]) + "\n")
    sys.stdout.write("\n".join([*faults, f"seed {options.seed}: {len(done)} cases, {len(bad)} faults"]) + "\n")
    if bad:
        sys.stdout.write(f"failing inputs are in {options.out}\n")
    if options.json:
        options.json.write_text(json.dumps({"counts": counts, "faults": faults}))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
