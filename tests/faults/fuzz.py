"""Damages inputs of every loader and command, and counts what comes of it.

    python tests/faults/fuzz.py --seconds 600 [--loader NAME] [--seed N]       # in turns, until the time is over
    python tests/faults/fuzz.py --cases 50                                     # so many of each loader
    python tests/faults/fuzz.py --loader NAME --seed N --case K                # one again, with its traceback

The same seed makes the same cases. What fails is kept in `--out`, with how to repeat it; the exit code is then 1.
"""

import argparse
import contextlib
import faulthandler
import itertools
import json
import multiprocessing
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing import connection
from pathlib import Path
from typing import Any

SHARED = [str(Path(__file__).parents[1] / name) for name in ("cases", "cases/sweeps", "cases/arrays", "oracles")]
sys.path += SHARED  # as pytest does; child processes read PYTHONPATH
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [*SHARED, os.environ.get("PYTHONPATH")]))

PRELOADED = [
    "fuzz_child",
    "palpate.render.cli.file_commands",
    "palpate.render.cli.play_commands",
    "palpate.render.sweeps.plan.loading",
    "trimesh",
]
CASE_SECONDS, AGAIN_SECONDS = 5.0, 25.0
"""How long a case may take; one that took longer is tried again, alone, before it is called a hang."""
PREPARE_SECONDS = 600.0
"""How long undamaged seeds may take, with kernels to compile."""


class Child:
    """A process that runs one case at a time; another takes its place where it ended or was killed."""

    def __init__(self, context: Any, seeds: Path, folder: Path) -> None:
        self._context, self._seeds, self._folder = context, seeds, folder
        self._started = 0
        self.case: Any = None
        self.limit = CASE_SECONDS
        self.start()

    def start(self) -> None:
        from fuzz_child import serve

        self._started += 1
        self.pipe, other = self._context.Pipe()
        folder = self._folder / str(self._started)
        self.process = self._context.Process(target=serve, args=(other, self._seeds, folder), daemon=True)
        self.process.start()
        other.close()

    def give(self, case: Any, limit: float) -> None:
        self.case, self.limit = case, limit
        self.deadline = time.monotonic() + PREPARE_SECONDS
        self.begun = False
        self.pipe.send(case)

    def taken(self) -> Any:
        """The outcome of its case, if there is one by now."""
        from fuzz_child import HANG, RAW, SIGNAL, Outcome

        try:
            while self.pipe.poll():
                answer = self.pipe.recv()
                if isinstance(answer, Exception):
                    raise answer
                if answer != "begun":
                    return answer
                self.begun = True
                self.deadline = time.monotonic() + self.limit
        except (EOFError, OSError):
            self.process.join()
            code = self.process.exitcode
            self.start()
            where = "" if self.begun else " before its case began"
            return (
                Outcome(SIGNAL, f"signal {-code}{where}") if code and code < 0 else Outcome(RAW, f"exit {code}{where}")
            )
        if time.monotonic() > self.deadline:
            self.process.kill()
            self.process.join()
            self.start()
            return Outcome(HANG, f"over {self.limit:g} s")
        return None

    def end(self) -> None:
        self.process.kill()
        self.process.join()


def run_cases(cases: Iterator[Any], children: list[Child], ends: float) -> Iterator[tuple[Any, Any]]:
    """Cases and what came of them, until there are no more, or the time is over."""
    from fuzz_child import HANG

    again: list[Any] = []
    while True:
        for child in children:
            if child.case is None:
                if again:
                    child.give(again.pop(), AGAIN_SECONDS)
                elif time.monotonic() < ends and (case := next(cases, None)) is not None:
                    child.give(case, CASE_SECONDS)
        busy = [child for child in children if child.case is not None]
        if not busy:
            return
        connection.wait([child.pipe for child in busy], timeout=0.5)
        for child in busy:
            outcome = child.taken()
            if outcome is None:
                continue
            case, child.case = child.case, None
            if outcome.kind == HANG and child.limit == CASE_SECONDS:
                again.append(case)
            else:
                yield case, outcome


def keep(case: Any, outcome: Any, seeds: Path, out: Path) -> None:
    """Keep a failing input, with how to repeat it."""
    folder = out / f"{case.form.replace(' ', '-')}-{case.seed}-{case.number}"
    _, how = case.make(seeds, folder)
    for pipe in folder.rglob("pipe"):
        pipe.unlink()
    command = f"python tests/faults/fuzz.py --loader '{case.form}' --seed {case.seed} --case {case.number}"
    (folder / "outcome.txt").write_text(f"{command}\n{outcome.kind}: {outcome.place}\n{how}\n\n{outcome.text}\n")


def repeat(case: Any, seeds: Path, folder: Path) -> int:
    """Run one case in this process: a traceback says where it fails."""
    from fuzz_child import BY_NAME

    faulthandler.enable()
    path, how = case.make(seeds, folder)
    sys.stdout.write(f"{path}\n{how}\n")
    sys.stdout.write(f"{BY_NAME[case.form].read(path)!r:.2000}\n")
    return 0


class Tally:
    """Outcomes by loader; failing inputs are kept, three of each fault."""

    def __init__(self, names: list[str], seeds: Path, out: Path) -> None:
        self._seeds, self._out = seeds, out
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in names}
        self.faults: dict[tuple[str, str, str], list[tuple[Any, Any]]] = {}

    def add(self, case: Any, outcome: Any) -> None:
        from fuzz_child import BAD

        self.counts[case.form][outcome.kind] += 1
        if outcome.kind in BAD:
            alike = self.faults.setdefault((case.form, outcome.kind, outcome.place), [])
            alike.append((case, outcome))
            if len(alike) <= 3:
                keep(case, outcome, self._seeds, self._out)

    def __str__(self) -> str:
        from fuzz_child import OUTCOMES

        lines = [["loader", "cases", *OUTCOMES]]
        for name, own in [*self.counts.items(), ("all", sum(self.counts.values(), Counter()))]:
            lines.append([name, str(own.total()), *(str(own[kind]) for kind in OUTCOMES)])
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        rows = ["  ".join(cell.rjust(size) for cell, size in zip(line, widths, strict=True)) for line in lines]
        for (form, kind, place), alike in sorted(self.faults.items()):
            case, outcome = alike[0]
            rows.append(
                f"{form}: {kind}, {place}: {len(alike)} (case {case.number}: {outcome.how or 'see its folder'})"
            )
        return "\n".join([*rows, *([f"failing inputs are in {self._out}"] if self.faults else [])]) + "\n"

    def as_dict(self) -> dict[str, Any]:
        faults = [
            {"loader": form, "outcome": kind, "place": place, "cases": [case.number for case, _ in alike]}
            for (form, kind, place), alike in sorted(self.faults.items())
        ]
        return {"counts": self.counts, "faults": faults}


def options_of(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, help="for how long; by default 60, or as --cases says")
    parser.add_argument("--cases", type=int, help="cases of each loader")
    parser.add_argument("--loader", action="append", help="only this one; may be repeated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="repeat this one case, in this process")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--out", type=Path, default=Path("fuzz-failures"), help="folder of failing inputs")
    parser.add_argument("--json", type=Path, help="write counts and failures there, too")
    return parser.parse_args(arguments)


def fuzz(options: argparse.Namespace, names: list[str], scratch: Path) -> Tally:
    """Run cases of these loaders in turns; Ctrl-C ends it as the time does."""
    from fuzz_child import Case

    numbers = itertools.count() if options.cases is None else range(options.cases)
    cases = (Case(name, options.seed, number) for number in numbers for name in names)
    seconds = options.seconds or (60.0 if options.cases is None else float("inf"))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    tally = Tally(names, scratch / "seeds", options.out)
    children = [Child(context, scratch / "seeds", scratch / f"child{k}") for k in range(options.workers)]
    with contextlib.suppress(KeyboardInterrupt):
        for case, outcome in run_cases(cases, children, time.monotonic() + seconds):
            tally.add(case, outcome)
    for child in children:
        child.end()
    return tally


def main(arguments: list[str] | None = None) -> int:
    options = options_of(arguments)
    os.environ |= {"CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "1", "PALPATE_CACHE": "off", "PALPATE_READ_MB": "256"}
    from fuzz_child import BY_NAME, Case, quieten, temporary_folder
    from fuzz_formats import make_seeds

    quieten()
    names = options.loader or list(BY_NAME)
    if unknown := set(names) - set(BY_NAME):
        sys.exit(f"unknown loader {sorted(unknown)[0]!r}; known: {', '.join(BY_NAME)}")
    scratch = Path(temporary_folder())
    try:
        for name in names:
            make_seeds(BY_NAME[name], scratch / "seeds" / name)
        if options.case is not None:
            return repeat(Case(names[0], options.seed, options.case), scratch / "seeds", scratch / "case")
        tally = fuzz(options, names, scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    sys.stdout.write(str(tally))
    if options.json:
        options.json.write_text(json.dumps(tally.as_dict(), indent=1))
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
