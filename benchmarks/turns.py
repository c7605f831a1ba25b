"""What benchmarks share: cases that take turns, what they need, and what contours they gave."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from time import perf_counter, thread_time
from typing import Any

import numpy as np
import warp as wp

COPIED = {"cuda": 2**28, "cpu": 2**24}  # [byte] that a rate of copying is measured with, at least
COPIED_MOST = 2**31  # [byte]; an array has no more, and the rate is the same


@dataclass(frozen=True)
class Case:
    """One way to a result."""

    name: str
    prepare: Callable[..., Any]
    """Makes what is timed, which has a method `run`, from inputs that a benchmark's cases share."""
    needs: tuple[str, ...] = ()
    """Packages."""

    @property
    def missing(self) -> list[str]:
        """Packages that are not installed."""
        return [name for name in self.needs if find_spec(name) is None]


@dataclass(frozen=True)
class Curves:
    """A case with its input that makes contours."""

    run: Callable[[], object]
    lengths: Callable[[], np.ndarray] | None
    """Length of each pose's contours of the last run [m]; None: it makes none."""
    pose_count: float
    """Poses of a run; of a floor, how many poses' bytes are copied."""


@dataclass(frozen=True)
class Figure:
    """What a case of contours came to."""

    case: str
    poses: float
    microseconds: float
    """A pose, median."""
    length: float | None
    apart: float | None
    rounds: int


def installed(cases: Iterable[Case]) -> list[Case]:
    """Cases whose packages are there; the others are told, as JSON."""
    cases = list(cases)
    for case in cases:
        if case.missing:
            print(json.dumps({"case": case.name, "skipped": f"not installed: {', '.join(case.missing)}"}))
    return [case for case in cases if not case.missing]


def seconds_by_turns(runs: Sequence[Callable[[], object]], device: str, rounds: int) -> list[float]:
    """Median seconds of each: every round runs each once, after one that is not counted, since it compiles.

    On the CPU the time of this thread counts, else wall time.
    """
    times: list[list[float]] = [[] for _ in runs]
    clock = thread_time if device == "cpu" else perf_counter
    for run in runs:
        run()
    for _ in range(rounds):
        for run, taken in zip(runs, times, strict=True):
            started = clock()
            run()
            taken.append(clock() - started)
    return [float(np.median(taken)) for taken in times]


def measure_curves(cases: Sequence[Case], device: str, rounds: int, *inputs: Any) -> list[Figure]:
    """Figures of cases that make contours; the first one's are what others are compared with, pose by pose."""
    ready = [case.prepare(*inputs) for case in cases]
    seconds = seconds_by_turns([one.run for one in ready], device, rounds)
    if ready[0].lengths is None:
        raise ValueError(f"{cases[0].name} makes no contours that others can be compared with")
    wanted = ready[0].lengths()
    figures = []
    for case, one, taken in zip(cases, ready, seconds, strict=True):
        length = apart = None
        if one.lengths is not None:
            got = one.lengths()
            length, apart = float(got.mean()), float(np.abs(got - wanted[: len(got)]).mean())
        figures.append(Figure(case.name, one.pose_count, taken / one.pose_count * 1e6, length, apart, rounds))
    return figures


def copying(byte_count: float, device: str, times: int = 1) -> tuple[Callable[[], None], float]:
    """A function that copies one large array, and its bytes, read and written both counted, over `byte_count`.

    The array has at least as many bytes as the rate of this device's memory is measured with. times: copies in a row,
    where waiting for one would take a good part of its time.
    """
    least = COPIED["cuda" if wp.get_device(device).is_cuda else "cpu"]
    source = wp.zeros(min(max(least, int(byte_count)), COPIED_MOST) // 2, dtype=wp.uint8, device=device)
    target = wp.empty_like(source)

    def run() -> None:
        for _ in range(times):
            wp.copy(target, source)
        wp.synchronize_device(device)

    return run, 2 * source.size * times / byte_count
