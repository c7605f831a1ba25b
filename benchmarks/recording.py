"""Recording against rendering alone, and writing against as many random bytes written with h5py alone.

    python benchmarks/recording.py --device cpu --workers 2 --poses 400000

Write: of contours that are there already. Raw: the same datasets, chunks, Fletcher-32 checksums, and an fsync for each
range of poses that recording reports done.
Sides take turns; medians. The cases also run small as tests (tests/house/test_benchmarks.py).
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import h5py
import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parent))
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.storage.schema import CHUNK_ROWS, CONTOURS, METRICS
from palpate.render.bench.cases import random_poses
from palpate.render.hands.hand import Palm
from palpate.render.intersection.batch_rendering import Chunk, rendered_chunks
from palpate.render.intersection.file_recording import file_header, metrics_of, record
from palpate.render.intersection.job import ContourJob
from palpate.render.intersection.scene import Scene
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.runtime.worker_devices import worker_devices
from palpate.render.strategies.intersection_strategy import closed_contour

THINGS = ("cube", "tube")


def render_alone(thing: MeshObject, motion: HandMotion, devices: list[str]) -> float:
    """Seconds until the last chunk is on the host."""
    started = perf_counter()
    for _ in rendered_chunks(ContourJob.of(Scene.of(thing, Palm(), closed_contour()), motion, devices=devices)):
        pass
    return perf_counter() - started


def record_all(path: Path, thing: MeshObject, motion: HandMotion, devices: list[str]) -> float:
    """Seconds from poses to a sealed file."""
    started = perf_counter()
    record(path, thing, Palm(), motion, closed_contour(), devices=devices)
    return perf_counter() - started


def write_alone(path: Path, thing: MeshObject, motion: HandMotion, chunks: list[Chunk]) -> float:
    """Seconds that a file takes whose contours are there already: what a fast device would have to wait for."""
    started = perf_counter()
    with ContourWriter(path, file_header(Scene.of(thing, Palm(), closed_contour()), motion, "cpu")) as writer:
        for chunk in chunks:
            writer.write(chunk.first, chunk.stop, chunk.contours.arrays(), metrics_of(chunk), chunk.timing)
        writer.seal()
    return perf_counter() - started


def random_rows(recorded: Path) -> tuple[dict[str, np.ndarray], int]:
    """Random rows for each dataset that grows, as many as a file has; and how many ranges it was written in."""
    rng = np.random.default_rng(0)
    rows = {}
    with h5py.File(recorded) as file:
        for spec in (*CONTOURS, *METRICS):
            if spec.path in file:
                shape = file[spec.path].shape
                rows[spec.path] = rng.integers(0, 256, (*shape, spec.dtype.itemsize), np.uint8).view(spec.dtype)[..., 0]
    with ContourFile(recorded) as file:
        return rows, len(file.timing().first)


def write_raw(path: Path, rows: dict[str, np.ndarray], commit_count: int, motion: HandMotion) -> float:
    """Seconds that h5py alone takes to write rows, safe on the disk after each of the ranges."""
    started = perf_counter()
    with h5py.File(path, "w", libver=("v108", "v108")) as file:
        file.create_dataset("/motion/pose", data=motion.pose, chunks=_chunk(motion.pose), fletcher32=True)
        for name, content in rows.items():
            file.create_dataset(name, content.shape, content.dtype, chunks=_chunk(content), fletcher32=True)
        for k in range(commit_count):
            for name, content in rows.items():
                first, stop = k * len(content) // commit_count, (k + 1) * len(content) // commit_count
                file[name][first:stop] = content[first:stop]
            file.flush()
            _sync(path)
    _sync(path)
    return perf_counter() - started


def _chunk(rows: np.ndarray) -> tuple[int, ...]:
    return (min(CHUNK_ROWS, max(1, len(rows))), *rows.shape[1:])


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    os.fsync(handle)
    os.close(handle)


def measure(name: str, devices: list[str], pose_count: int, repeats: int, folder: Path) -> dict:
    """Medians of the three, and what a file takes."""
    thing, motion = MeshObject.load(name), HandMotion(None, random_poses(pose_count))
    recorded, written, raw = (folder / f"{side}.h5" for side in ("recorded", "written", "raw"))
    chunks = list(rendered_chunks(ContourJob.of(Scene.of(thing, Palm(), closed_contour()), motion, devices=devices)))
    record_all(recorded, thing, motion, devices)
    rows, commit_count = random_rows(recorded)
    size = recorded.stat().st_size
    seconds: dict[str, list[float]] = {"render": [], "record": [], "write": [], "raw": []}
    for _ in range(repeats):
        for path in (recorded, written, raw):
            path.unlink(missing_ok=True)
        seconds["render"].append(render_alone(thing, motion, devices))
        seconds["record"].append(record_all(recorded, thing, motion, devices))
        seconds["write"].append(write_alone(written, thing, motion, chunks))
        seconds["raw"].append(write_raw(raw, rows, commit_count, motion))
    median = {side: float(np.median(values)) for side, values in seconds.items()}
    return {
        "object": name,
        "devices": ",".join(devices),
        "poses": pose_count,
        "bytes_per_pose": size / pose_count,
        "commits": commit_count,
        **{f"{side}_seconds": value for side, value in median.items()},
        "record_over_render": median["record"] / median["render"],
        "record_MB_per_second": size / median["record"] / 1e6,
        "write_MB_per_second": size / median["write"] / 1e6,
        "raw_over_write": median["raw"] / median["write"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--poses", type=int, default=400_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--objects", nargs="+", default=list(THINGS))
    parser.add_argument("--folder", type=Path, help="on the disk to measure; by default the one for temporary files")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    devices = worker_devices(options.device, options.workers)
    for name in options.objects:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            print(json.dumps(measure(name, devices, options.poses, options.repeats, Path(folder))), flush=True)


if __name__ == "__main__":
    main()
