"""First use: what `palpate render` takes in a process of its own, with kernels to compile and without."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..errors import RenderError
from .cases import random_poses

OBJECT, POSES = "cube", 1_000
WARM_RUNS = 3
PALPATE = (sys.executable, "-P", "-c", "from palpate.render.cli.app import main; main()")


@dataclass(frozen=True)
class FirstUse:
    """Wall time of `palpate render cube` with 1,000 poses, start of Python included [s]."""

    cold: float
    """With an empty kernel cache: every kernel it needs is compiled."""
    warm: float
    """Median, kernels compiled before."""
    help: float
    """Median of `palpate --help`: what starting alone takes."""
    runs: int
    """Of `warm` and `help`."""


def measure_first_use(device: str) -> FirstUse:
    """Run the command in subprocesses with a kernel cache of their own.

    Raises RenderError with the last line that a failing one printed.
    """
    with TemporaryDirectory(prefix="palpate-bench-") as folder:
        motion, out = Path(folder, "poses.csv"), Path(folder, "out.h5")
        HandMotion(None, random_poses(POSES)).save(motion)
        environment = {**os.environ, "WARP_CACHE_PATH": str(Path(folder, "cache"))}
        render = ("render", OBJECT, str(motion), "-o", str(out), "--overwrite", "--device", device, "--json")
        cold = _seconds(render, environment)
        warm = [_seconds(render, environment) for _ in range(WARM_RUNS)]
        start = [_seconds(("--help",), environment) for _ in range(WARM_RUNS)]
    return FirstUse(cold, float(np.median(warm)), float(np.median(start)), WARM_RUNS)


def _seconds(arguments: tuple[str, ...], environment: dict[str, str]) -> float:
    started = perf_counter()
    done = subprocess.run([*PALPATE, *arguments], env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip() or "nothing").splitlines()[-1]
        raise RenderError(f"palpate {arguments[0]} failed in a process of its own (exit {done.returncode}): {last}")
    return perf_counter() - started
