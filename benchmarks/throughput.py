"""Poses a second from poses to contours, results left on the device: `palpate bench` without peers, and with lengths.

    python benchmarks/throughput.py --device cuda:0 --poses 4000000
    python benchmarks/throughput.py --save lengths.npz            # here
    python benchmarks/throughput.py --device cuda:0 --compare lengths.npz     # on a machine with a GPU

Needs Warp, NumPy and what palpate.render imports; one line of JSON a case. The cases also run small as tests
(tests/house/test_benchmarks.py). Medians of `--repeats` runs; first runs are not counted.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import warp as wp

from palpate.render.bench.cases import bench_object, random_poses
from palpate.render.bench.clocks import OwnTurn
from palpate.render.bench.rows import measure_trial
from palpate.render.bench.turns import BenchOptions, Trial


@dataclass(frozen=True)
class Case:
    """One object, built in or a blob, and strategy."""

    thing: str
    label: str
    """OC or CC."""

    def trial(self, device: str, poses: np.ndarray, repeats: int) -> Trial:
        """The case on a device with these poses."""
        options = BenchOptions(device=device, repeats=repeats)
        return Trial(self.thing, bench_object(self.thing), self.label.lower(), poses, options)


OBJECTS = ("cube", "tube", "dog", "sphere", "boulder", "dog-detailed", "blob-5000")


def cases(objects: Sequence[str]) -> list[Case]:
    """Every object with OC and with CC."""
    return [Case(thing, label) for thing in objects for label in ("OC", "CC")]


CASES = cases(OBJECTS)


def measure(case: Case, device: str, poses: np.ndarray, repeats: int) -> tuple[dict, np.ndarray]:
    """Figures of one case, and the lengths of all poses [m], shape [pose, kind]."""
    trial = case.trial(device, poses, repeats)
    return asdict(measure_trial(trial)), lengths_of(trial)


def lengths_of(trial: Trial) -> np.ndarray:
    """Lengths of all poses by kind [m], shape [pose, 3]."""
    own = OwnTurn(trial.mesh, trial.hand, trial.pose, trial.stages, trial.options.device)
    return np.concatenate([batch.lengths() for batch in own()])


def compare(lengths: np.ndarray, known: np.ndarray) -> dict:
    """How far two sets of lengths are apart [m]."""
    apart = np.abs(lengths.sum(axis=1, dtype=np.float64) - known.sum(axis=1, dtype=np.float64))
    return {
        "compared": len(known),
        "apart_max": float(apart.max()),
        "apart_over_1e-5": int((apart > 1e-5).sum()),
        "equal_bits": int((lengths == known).all(axis=1).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--objects", nargs="+", default=["cube", "tube"])
    parser.add_argument("--save", type=Path, help="write the lengths of all cases")
    parser.add_argument("--compare", type=Path, help="compare with lengths written by --save")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    poses = random_poses(options.poses)
    known = np.load(options.compare) if options.compare else {}
    saved = {}
    for case in cases(options.objects):
        figures, lengths = measure(case, options.device, poses, options.repeats)
        name = f"{case.thing}-{case.label}"
        saved[name] = lengths
        if name in known:  # as many poses as there: another count draws other poses
            same = case.trial(options.device, random_poses(len(known[name])), 1)
            figures["against_file"] = compare(lengths_of(same), known[name])
        print(json.dumps(figures), flush=True)
    if options.save:
        np.savez_compressed(options.save, **saved)


if __name__ == "__main__":
    main()
