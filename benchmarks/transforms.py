"""Time that transform stages take, as whole presets beside "cc", by turns; and that of explorations.

    python benchmarks/transforms.py --presets smooth hatch --poses 20000
    python benchmarks/transforms.py --device cuda:0 --poses 1000000 --compare numbers.npz   # made elsewhere by --save

One line of JSON a preset: microseconds a pose of the whole, and less those of "cc"; contours stay where they were made.
CPU time of one thread, or wall time of a GPU. --save keeps numbers of each 1,000 poses: polylines, points, length, and
a checksum of all bits of the points. The cases also run small as tests (tests/house/test_benchmarks.py).
"""

import argparse
import json
import zlib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import warp as wp
from turns import seconds_by_turns

from palpate.render import ContourBatch, MeshObject, Palm, Scene
from palpate.render.bench.cases import random_poses
from palpate.render.motions.explorations.explored import ExploredPoses, explored_rows

PRESETS = (
    "simplified", "smooth", "corners", "edges", "depth", "ellipse", "circle", "centroid", "hatch", "inset",
)  # fmt: skip
BLOCK = 1000  # poses whose numbers are kept together
EXPLORED = 2700  # poses of an exploration: 30 s at 90 Hz


def measure(
    presets: Sequence[str],
    device: str,
    poses: np.ndarray,
    *,
    thing: str = "tube",
    chunk: int = 250_000,
    rounds: int = 5,
) -> list[dict]:
    """Figures of presets."""
    mesh = MeshObject.load(thing)
    scenes = [Scene.of(mesh, Palm(), name) for name in ("cc", *presets)]
    parts = [wp.array(poses[k : k + chunk], dtype=wp.transform, device=device) for k in range(0, len(poses), chunk)]

    def run(scene: Scene) -> None:
        for part in parts:
            scene.contours(part, 0, device)
        wp.synchronize_device(device)

    least, *seconds = seconds_by_turns([partial(run, scene) for scene in scenes], device, rounds)
    scale = 1e6 / len(poses)
    return [
        {"preset": name, "device": device, "object": thing, "poses": len(poses), "us": scale * own,
         "us_of_stages": scale * (own - least)}
        for name, own in zip(presets, seconds, strict=True)
    ]  # fmt: skip


def measure_explorations(device: str, count: int, rounds: int = 5) -> dict:
    """Figures of explorations of 30 s, made together."""
    bounds = MeshObject.load("tube").bounds
    given = {"duration": 30.0, "rate": 90.0, "model": "over-array", "bounds": bounds}
    ranges = [(ExploredPoses.of(**given, seed=k, explorer=1 + k % 100), 0, EXPLORED) for k in range(count)]

    def run() -> None:
        explored_rows(ranges, device)
        wp.synchronize_device(device)

    (seconds,) = seconds_by_turns([run], device, rounds)
    return {"explorations": count, "device": device, "us": 1e6 * seconds / (count * EXPLORED)}


def numbers_of(preset: str, device: str, poses: np.ndarray, thing: str = "tube") -> np.ndarray:
    """Of each BLOCK of poses: polylines, points, length [m], checksum of the points; float64, shape [block, 4]."""
    scene = Scene.of(MeshObject.load(thing), Palm(), preset)
    rows = []
    for k in range(0, len(poses), 50 * BLOCK):
        part = wp.array(poses[k : k + 50 * BLOCK], dtype=wp.transform, device=device)
        batch, _ = scene.contours(part, 0, device)
        rows.append(block_numbers(batch.numpy()))
    return np.concatenate(rows)


def block_numbers(batch: ContourBatch) -> np.ndarray:
    """`numbers_of` a batch on the host."""
    out = []
    for k in range(0, len(batch), BLOCK):
        part = batch.select(k, min(k + BLOCK, len(batch)))
        length = float(part.lengths().sum(dtype=np.float64))
        out.append([part.polyline_count, part.point_count, length, zlib.crc32(np.ascontiguousarray(part.points))])
    return np.array(out, np.float64)


def compare(found: np.ndarray, known: np.ndarray) -> dict:
    """How far numbers of the same poses are apart."""
    known = known[: len(found)]
    return {
        "blocks": len(found),
        "blocks_of_equal_bits": int((found[:, 3] == known[:, 3]).sum()),
        "polylines_apart": int(np.abs(found[:, 0] - known[:, 0]).sum()),
        "points_apart": int(np.abs(found[:, 1] - known[:, 1]).sum()),
        "length_apart": float(np.abs(found[:, 2] - known[:, 2]).max()),  # [m] of BLOCK poses together
    }


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=20_000)
    parser.add_argument("--presets", nargs="*", default=list(PRESETS))
    parser.add_argument("--object", default="tube")
    parser.add_argument("--chunk", type=int, default=250_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--explorations", type=int, default=0, help="how many of 30 s to make, too")
    parser.add_argument("--save", type=Path, help="write numbers of the contours of all presets")
    parser.add_argument("--compare", type=Path, help="compare with numbers written by --save")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    poses = random_poses(given.poses)
    if given.save or given.compare:
        _check(given.presets, given.device, poses, given.object, given.save, given.compare)
    else:
        for row in measure(
            given.presets, given.device, poses, thing=given.object, chunk=given.chunk, rounds=given.rounds
        ):
            print(json.dumps(row), flush=True)
    if given.explorations:
        print(json.dumps(measure_explorations(given.device, given.explorations, given.rounds)), flush=True)


def _check(
    presets: Sequence[str], device: str, poses: np.ndarray, thing: str, save: Path | None, known_at: Path | None
) -> None:
    known: Mapping[str, np.ndarray] = np.load(known_at) if known_at else {}
    found = {}
    for name in presets:
        found[name] = numbers_of(name, device, poses, thing)
        if name in known:
            print(json.dumps({"preset": name, "device": device, **compare(found[name], known[name])}), flush=True)
    if save:
        np.savez_compressed(save, **found)


if __name__ == "__main__":
    main()
