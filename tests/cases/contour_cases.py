"""Headers, ragged batches and crashes for the tests of the contour file; batches are plain NumPy."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xxhash

from palpate.datasets.contour_file.blocks import work_folder
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.header import FileHeader
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.storage import hdf5_output
from palpate.datasets.storage.schema import PRUNED_NAMES

Batch = dict[str, np.ndarray]


def make_header(pose_count: int, **changes: Any) -> FileHeader:
    rng = np.random.default_rng(pose_count)
    pose = rng.normal(size=(pose_count, 7)).astype(np.float32)
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    fields: dict[str, Any] = {
        "pose": pose,
        "time": np.arange(pose_count) / 90.0,
        "object_name": "tetrahedron",
        "vertices": np.vstack([np.zeros((1, 3)), np.eye(3)]).astype(np.float32),
        "faces": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32),
        "hand": {"kind": "palm", "width": 0.085, "length": 0.085},
        "strategy": {"raw": "mesh", "transform": ["close"]},
        "versions": {"palpate": "0.1.0", "numpy": "2"},
        "device": "cpu",
        "placement": {"scale": 1.0},
        "seed": 7,
        "created": "2026-01-01T00:00:00.000000+00:00",
    }
    return FileHeader(**(fields | changes))


def everything(pose_count: int) -> dict[str, Any]:
    """What a header may have besides: a moving object, a hand with poses of patches, a skin, a live run."""
    rng = np.random.default_rng(1)
    pose = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (pose_count, 1))
    hand_arrays = {
        "patch_pose": np.concatenate([np.tile(pose, (3, 1)), np.full((1, 7), np.nan, np.float32)]),
        "skin_vertices": rng.normal(size=(5, 3)).astype(np.float32),
        "skin_faces": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        "skin_glabrous": np.array([1, 0], np.uint8),
    }
    return {
        "moved": pose,
        "hand": {"kind": "of a later version"},  # no known one has poses of patches and a skin
        "hand_arrays": hand_arrays,
        "representation": {"representation": "voxels", "hash": "0"},
        **live_run(pose_count),
    }


def live_run(pose_count: int, *, samples: int = 9, foci: int = 2) -> dict[str, Any]:
    """A header's part of a live run: no pose but the last was emitted, and samples have every mark in turn."""
    rng = np.random.default_rng(2)
    run = {
        "sampling": {"speed": 7.0, "foci": foci}, "update_rate": 100.0, "hold": 0.1, "samples": samples, "foci": foci,
        "source": "udp", "array": "emulator", "lead": 0.008, "realtime": True, "emission": "estimate",
    }  # fmt: skip
    arrays = {
        "stamp": np.arange(pose_count) / 90 - 0.006,
        "emitted": np.where(np.arange(pose_count) == pose_count - 1, 1.0, np.nan),
        "position": rng.normal(size=(samples * foci, 3)).astype(np.float32),
        "intensity": rng.random(samples * foci, np.float32),
        "gain": np.full(samples, 0.5, np.float32),
        "mark": (np.arange(samples) % 4).astype(np.uint8),
        "events": np.frombuffer(b'[0.5, "lost", "no hand"]\n', np.uint8),
    }
    return {"live": run, "live_arrays": arrays}


def make_contours(
    pose_count: int, *, seed: int = 0, intensity: bool = False, dwell: bool = False, point_count_max: int = 12
) -> Batch:
    """Poses of 0 to 2 polylines of 1 to `point_count_max` points, about half of them closed."""
    rng = np.random.default_rng(seed)
    pose_start = _offsets(rng.integers(0, 3, pose_count))
    counts = rng.integers(1, point_count_max + 1, pose_start[-1])
    polyline_start = _offsets(counts)
    points = rng.normal(size=(polyline_start[-1], 3)).astype(np.float32)
    kind = rng.integers(0, 3, len(points)).astype(np.uint8)
    closed = rng.integers(0, 2, len(counts)).astype(np.uint8)
    for first, stop, is_closed in zip(polyline_start[:-1], polyline_start[1:], closed, strict=True):
        if is_closed:
            points[stop - 1] = points[first]
        kind[stop - 1] = kind[max(stop - 2, first)]
    contours = {
        "points": points,
        "kind": kind,
        "polyline_start": polyline_start,
        "polyline_patch": rng.integers(0, 5, len(counts)).astype(np.int32),
        "polyline_closed": closed,
        "pose_start": pose_start,
    }
    for name, wanted in (("intensity", intensity), ("dwell", dwell)):
        if wanted:
            value = rng.random(len(points), dtype=np.float32)
            loop = np.flatnonzero(closed)
            value[polyline_start[loop + 1] - 1] = value[polyline_start[loop]]  # one point, one value
            contours[name] = value
    return contours


def make_metrics(contours: Batch) -> Batch:
    """Metrics by a plain loop over polylines and segments; what stages removed where points have a dwell."""
    pose_count = len(contours["pose_start"]) - 1
    length = np.zeros((pose_count, 3))
    for pose in range(pose_count):
        for polyline in range(contours["pose_start"][pose], contours["pose_start"][pose + 1]):
            first, stop = contours["polyline_start"][polyline : polyline + 2]
            for point in range(first, stop - 1):
                a, b = contours["points"][point : point + 2].astype(np.float64)
                length[pose, contours["kind"][point]] += np.linalg.norm(b - a)
    names = ("length_object", "length_hand", "length_made")
    metrics = {name: length[:, column].astype(np.float32) for column, name in enumerate(names)}
    metrics["length"] = length.sum(axis=1).astype(np.float32)
    metrics["polylines"] = np.diff(contours["pose_start"]).astype(np.int32)
    removed = PRUNED_NAMES if "dwell" in contours else ()
    return metrics | {f"removed_{stage}": metrics["polylines"].astype(np.float32) for stage in removed}


def cut_contours(contours: Batch, first: int, stop: int) -> Batch:
    """Poses `first` to `stop` of a batch as a batch."""
    low, high = contours["pose_start"][[first, stop]]
    begin, end = contours["polyline_start"][[low, high]]
    cut = {name: contours[name][begin:end] for name in ("points", "kind", "intensity", "dwell") if name in contours}
    cut |= {name: contours[name][low:high] for name in ("polyline_patch", "polyline_closed")}
    cut["polyline_start"] = contours["polyline_start"][low : high + 1] - begin
    cut["pose_start"] = contours["pose_start"][first : stop + 1] - low
    return cut


def write_ranges(
    writer: ContourWriter, contours: Batch, ranges: Iterable[tuple[int, int]], *, held: bool = False
) -> None:
    """Write ranges of poses, each of them committed when this returns unless they are to be held."""
    for first, stop in ranges:
        part = cut_contours(contours, first, stop)
        writer.write(first, stop, part, make_metrics(part), {"raw": 0.25})
        if not held:
            writer.commit()


def write_file(path: Path, contours: Batch, *, chunk: int = 4, mode: Any = "create", **changes: Any) -> FileHeader:
    """A sealed file, written in chunks of `chunk` poses."""
    count = len(contours["pose_start"]) - 1
    header = make_header(count, **changes)
    ranges = [(first, min(first + chunk, count)) for first in range(0, count, chunk)]
    with ContourWriter(path, header, mode=mode) as writer:
        write_ranges(writer, contours, ranges, held=True)
        writer.seal()
    return header


def assert_same(got: Batch, want: Batch) -> None:
    """The same names, dtypes, shapes and bits."""
    assert sorted(got) == sorted(want)
    for name, array in want.items():
        assert got[name].dtype == array.dtype, name
        np.testing.assert_array_equal(got[name], array, err_msg=name)


@contextmanager
def small_chunks(rows: int = 7) -> Iterator[None]:
    """Many HDF5 chunks in a few rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5_output, "CHUNK_ROWS", rows)
        yield


def _offsets(counts: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def content_digests(path: Path) -> dict[str, str]:
    """Digests of a file's datasets but those of /timing, which differ from run to run."""
    with h5py.File(path) as file:
        digests = json.loads(file.attrs["digests"])["datasets"]
    return {name: digest for name, digest in digests.items() if not name.startswith("/timing/")}


def redigest(path: Path) -> None:
    """Give a file that was changed the digests of what it holds now: XXH3-64, by xxhash, of what h5py reads."""
    with h5py.File(path, "r+") as file:
        table = json.loads(file.attrs["digests"])
        for name in table["datasets"]:
            rows = file[name][...] if name in file else np.zeros(0)
            little = rows.astype(rows.dtype.newbyteorder("<"))
            table["datasets"][name] = xxhash.xxh3_64_hexdigest(little.tobytes())
        for group, names in table["attributes"].items():
            for key in names:
                value = file[group].attrs.get(key)
                value = value.encode() if isinstance(value, str) else value
                content = value if isinstance(value, bytes) else np.asarray(value).tobytes()
                names[key] = xxhash.xxh3_64_hexdigest(content)
        put_text(file, "digests", json.dumps(table))


def put_text(owner: Any, key: str, text: str) -> None:
    """An attribute as palpate writes it: text of fixed length."""
    raw = text.encode()
    owner.attrs[key] = np.array(raw, h5py.string_dtype("utf-8", len(raw)))


def flip_bit(path: Path, at: int) -> None:
    """Damage one byte of a file."""
    content = bytearray(path.read_bytes())
    content[at] ^= 0x10
    path.write_bytes(content)


def first_chunk(path: Path, name: str) -> tuple[int, int]:
    """Where a dataset's first chunk begins and ends in the file."""
    with h5py.File(path) as file:
        chunk: Any = file[name].id.get_chunk_info(0)
    return chunk.byte_offset, chunk.byte_offset + chunk.size


def zero_chunk(path: Path, name: str) -> None:
    """Put zeros for a dataset's first chunk: Fletcher-32 finds nothing, as that of zeros is 0."""
    begin, end = first_chunk(path, name)
    content = bytearray(path.read_bytes())
    content[begin:end] = bytes(end - begin)
    path.write_bytes(content)


def assert_whole(path: Path, contours: Batch) -> None:
    """Sealed, nothing wrong, no work folder beside it, and these contours in it."""
    assert check_file(path) == []
    assert not work_folder(path).exists()
    with ContourFile(path, verify=True) as file:
        assert file.sealed
        assert_same(file.contours(), contours)


def finish(path: Path, contours: Batch, **changes: Any) -> tuple[list[tuple[int, int]], tuple[str, ...]]:
    """Resume a rendering to its end; the poses that were missing, and what was told of repairs."""
    header = make_header(len(contours["pose_start"]) - 1, **changes)
    with ContourWriter(path, header, mode="resume") as writer:
        missing, repairs = writer.missing(), writer.repairs
        write_ranges(writer, contours, missing, held=True)
        writer.seal()
    assert_whole(path, contours)
    return missing, repairs
