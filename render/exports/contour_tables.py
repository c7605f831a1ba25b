"""Contours as CSV, a row for each point, and as NPZ, the arrays of a contour file; both in bounded memory."""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.storage.schema import CONTOURS, KIND_NAMES
from .pose_choice import ExportBlock, Progress, chosen_blocks

HEADER = "pose,time [s],polyline,x [m],y [m],z [m],kind,intensity"


def write_csv(file: ContourFile, chosen: range, temporary: Path, *, watch: Progress) -> dict[str, Any]:
    """Write a row for each point of the chosen poses; returns counts. Raises OSError.

    Numbers are the shortest that read back to the same bits. A pose without contours has no row; time is empty where
    poses have none.
    """
    time = file.motion(chosen.start, chosen.stop).get("time")
    polylines = points = done = 0
    with temporary.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(HEADER + "\n")
        for block in chosen_blocks(file, chosen):
            moments = None if time is None else time[block.number - chosen.start]
            stream.writelines(_rows(block, moments))
            polylines += len(block.contours["polyline_closed"])
            points += len(block.contours["points"])
            done += len(block.number)
            watch(done, len(chosen))
    return {"polylines": polylines, "points": points}


def _rows(block: ExportBlock, time: np.ndarray | None) -> list[str]:
    """Lines of a block."""
    contours = block.contours
    polylines, points = np.diff(contours["pose_start"]), np.diff(contours["polyline_start"])
    pose = np.repeat(np.arange(len(polylines)), polylines)  # of each polyline
    place = np.arange(len(pose)) - contours["pose_start"][pose]
    moments = [""] * len(polylines) if time is None else [repr(t) for t in time.tolist()]
    heads = [
        f"{number},{moments[k]},{line},"
        for number, k, line in zip(block.number[pose].tolist(), pose.tolist(), place.tolist(), strict=True)
    ]
    where = contours["points"].astype(str)  # of float32: the shortest text of each number
    level = contours["intensity"].astype(str) if "intensity" in contours else ["1.0"] * len(where)
    kinds = np.array(KIND_NAMES)[contours["kind"]]
    return [
        f"{heads[line]}{x},{y},{z},{kind},{intensity}\n"
        for line, (x, y, z), kind, intensity in zip(
            np.repeat(np.arange(len(pose)), points).tolist(), where.tolist(), kinds.tolist(), list(level), strict=True
        )
    ]


def write_npz(file: ContourFile, chosen: range, temporary: Path, *, gzip: int = 0, watch: Progress) -> dict[str, Any]:
    """Write the contours of the chosen poses, their motion and the object; returns counts. Raises OSError.

    Arrays have the names of docs/formats/file-format.md; `pose_number` is the number of each pose in the file.
    """
    polyline_count = int(file.metrics(chosen.start, chosen.stop)["polylines"][:: chosen.step].sum(dtype=np.int64))
    counts = {"pose": len(chosen), "polyline": polyline_count}
    method = zipfile.ZIP_DEFLATED if gzip else zipfile.ZIP_STORED
    fields = [spec for spec in CONTOURS if spec.name != "dwell" or "dwell" in file.optional]
    fields.sort(key=lambda spec: not spec.is_offset)  # the offsets of polylines count the points
    done, total = 0, len(fields) * len(chosen)
    with zipfile.ZipFile(temporary, "w", method, compresslevel=gzip or None) as archive:
        for spec in fields:
            rows = str(spec.dims[0]).removesuffix(" + 1")
            shape = (counts[rows] + spec.is_offset, *spec.dims[1:])
            with open_member(archive, spec.name, shape, spec.dtype) as member:
                base = np.zeros(1, np.int64)
                if spec.is_offset:
                    member.write(base.tobytes())
                for number, contours in chosen_blocks(file, chosen):
                    values = contours.get(spec.name)
                    if values is None:
                        values = np.full(len(contours["points"]), spec.absent, spec.dtype)
                    if spec.is_offset:
                        values = values[1:] + base
                        base = np.append(base, values)[-1:]
                    member.write(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
                    done += len(number)
                    watch(done, total)
            if spec.name == "polyline_start":
                counts["point"] = int(base[0])
            elif spec.name == "pose_start" and base[0] != polyline_count:
                raise ContourFileError(f"{file.path} is damaged: /metrics/polylines and /contours do not fit")
        for name, values in _others(file, chosen):
            with open_member(archive, name, values.shape, values.dtype) as member:
                member.write(values.tobytes())
    return {"polylines": counts["polyline"], "points": counts["point"]}


def _others(file: ContourFile, chosen: range) -> Iterator[tuple[str, np.ndarray]]:
    """The arrays of the chosen poses that are not contours, and the object's."""
    yield "pose_number", np.array(chosen, np.int64)
    for name, values in file.motion(chosen.start, chosen.stop).items():
        yield name, values[:: chosen.step]
    yield "length", file.metrics(chosen.start, chosen.stop)["length"][:: chosen.step]
    solid = file.object()
    yield "vertices", solid["vertices"]
    yield "faces", solid["faces"]
    if "moved" in solid:
        yield "moved", solid["moved"][chosen.start : chosen.stop : chosen.step]


def open_member(archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> IO[bytes]:
    """An opened member with the header of an array; its rows are to follow."""
    entry = zipfile.ZipInfo(f"{name}.npy")  # of 1980: equal contents make equal files
    entry.compress_type = archive.compression
    member = archive.open(entry, "w", force_zip64=True)
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(member, header)
    return member
