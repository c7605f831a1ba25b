"""VTKHDF: contours as lines over time, which ParaView and PyVista open, with object and hand if asked for.

VTK's reader (9.7.2) finds a part's offsets by counting the cells of the parts before it, and takes a wrong place after
parts without cells. So steps without cells share one part without cells, which is the last one of the file.
"""

from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ...datasets.storage.hdf5_output import new_hdf5
from ..hands.hand import Hand
from ..hands.mesh_hand import MeshHand
from ..hands.stored_hand import hand_from
from .pose_choice import Progress, chosen_blocks, offsets, ragged

CELLS = ("Vertices", "Lines", "Polygons", "Strips")
"""Kinds of cells of PolyData, in the format's order."""
ROWS_OF_PARTS = ("NumberOfCells", "NumberOfConnectivityIds", "Offsets")
"""Of each kind of cells: a row for each part; of offsets one more than cells."""
CHUNK_ROWS = 4096  # larger ones slow down reading a step, as VTK opens the file anew for each


class StepCells(NamedTuple):
    """Cells of consecutive steps."""

    points: np.ndarray
    """[m], float32, shape [point, 3]."""
    cell_start: np.ndarray
    """Offsets into points: cell c connects points cell_start[c] to cell_start[c + 1] in order."""
    step_start: np.ndarray
    """Offsets into cells, one more than steps."""


class PolyDataSteps:
    """Writes one block; call `append` with consecutive steps, then `finish`.

    group: the block's `h5py.Group`. kind: of all its cells, "Lines" or "Polygons". version: of the format. gzip: 0..9.
    Takes 48 bytes of memory a step besides what is being written.
    """

    def __init__(self, group: Any, kind: str, *, version: tuple[int, int], gzip: int) -> None:
        self._group, self._kind, self._version = group, kind, version
        self._filters: dict[str, Any] = {"compression": "gzip", "compression_opts": gzip, "shuffle": True}
        if not gzip:
            self._filters = {}
        self._parts = self._cells = self._points = self._widest = 0
        self._steps: list[np.ndarray] = []  # part, first point and first cell of each step; -1 for one without cells
        self._attributes: list[str] = []
        self._rows("Points", np.float32, (3,))
        for name in ("NumberOfPoints", *(f"{kind}/{name}" for name in ROWS_OF_PARTS)):
            self._rows(name, np.int64)

    def append(self, cells: StepCells, point_data: dict[str, np.ndarray], cell_data: dict[str, np.ndarray]) -> None:
        """Write the next steps; point_data, cell_data: values by the same names each time, a row a point or cell."""
        count = np.diff(cells.step_start)
        filled = np.flatnonzero(count)
        first = cells.cell_start[cells.step_start]  # point of each step
        place = np.full((len(count), 3), -1, np.int64)
        place[filled, 0] = self._parts + np.arange(len(filled))
        place[filled, 1] = self._points + first[filled]
        place[filled, 2] = self._cells + cells.step_start[filled]
        self._steps.append(place)
        points = np.diff(first)[filled]
        entries = count[filled] + 1
        local = cells.cell_start[ragged(cells.step_start[filled], entries)] - np.repeat(first[filled], entries)
        self._write("Points", cells.points)
        self._write("NumberOfPoints", points)
        self._write(f"{self._kind}/NumberOfCells", count[filled])
        self._write(f"{self._kind}/NumberOfConnectivityIds", points)
        self._write(f"{self._kind}/Offsets", local)
        for folder, data in (("PointData", point_data), ("CellData", cell_data)):
            for name, values in data.items():
                self._add_attribute(f"{folder}/{name}", values)
        self._parts += len(filled)
        self._points += len(cells.points)
        self._cells += len(cells.cell_start) - 1
        self._widest = max(self._widest, int(points.max(initial=0)))

    def repeat(self, step_count: int) -> None:
        """Have all of `step_count` steps show what was appended as the first one."""
        self._steps = [np.zeros((step_count, 3), np.int64)]

    def finish(self, value: np.ndarray, fields: dict[str, np.ndarray]) -> None:
        """Write the part without cells, and the steps.

        value: of the time axis at each step; fields: of a value for each step, by name.
        """
        place = np.concatenate([np.zeros((0, 3), np.int64), *self._steps])
        is_empty = place[:, 0] < 0
        if is_empty.any():  # not else: of a single step, VTK shows all parts
            for name in ("NumberOfPoints", *(f"{self._kind}/{name}" for name in ROWS_OF_PARTS)):
                self._write(name, np.zeros(1, np.int64))
        place[is_empty] = self._parts, self._points, self._cells
        # points are connected in their order, so that all parts can share one list of connected points
        self._rows(f"{self._kind}/Connectivity", np.int64)
        self._write(f"{self._kind}/Connectivity", np.arange(self._widest))
        self._write_other_cells(self._parts + bool(is_empty.any()))
        self._group.attrs["Version"] = np.array(self._version, np.int32)
        self._group.attrs["Type"] = np.bytes_(b"PolyData")
        self._write_steps(value, place.T, fields)

    def _write_other_cells(self, part_count: int) -> None:
        """Cells of other kinds, of which there are none: zeros, which take no space."""
        none = [kind for kind in CELLS if kind != self._kind]
        for name in ROWS_OF_PARTS:
            self._constant(f"{none[0]}/{name}", (part_count,), 0)
        self._rows(f"{none[0]}/Connectivity", np.int64)
        for kind in none[1:]:
            self._group[kind] = self._group[none[0]]

    def _write_steps(self, value: np.ndarray, place: np.ndarray, fields: dict[str, np.ndarray]) -> None:
        steps = self._group.create_group("Steps")
        count = len(value)
        steps.attrs["NSteps"] = count
        part, point, cell = place
        self._put("Steps/Values", np.asarray(value, np.float64))
        self._constant("Steps/NumberOfParts", (count,), 1)
        self._put("Steps/PartOffsets", part)
        self._put("Steps/PointOffsets", point)
        self._constant("Steps/ConnectivityIdOffsets", (count, len(CELLS)), 0)
        self._constant("Steps/CellOffsets", (count, len(CELLS)), 0)
        self._group["Steps/CellOffsets"][:, CELLS.index(self._kind)] = cell
        self._put("Steps/CellsBefore", cell)
        for name in self._attributes:
            folder, _, own = name.partition("/")
            same = {"PointData": "PointOffsets", "CellData": "CellsBefore"}[folder]
            steps.require_group(f"{folder}Offsets")[own] = steps[same]  # a hard link
        del steps["CellsBefore"]
        for name, values in fields.items():
            self._put(f"FieldData/{name}", values)
            self._put(f"Steps/FieldDataOffsets/{name}", np.arange(count))
            self._constant(f"Steps/FieldDataSizes/{name}", (count, 2), 1)

    def _add_attribute(self, name: str, values: np.ndarray) -> None:
        if name not in self._attributes:
            self._attributes.append(name)
            self._rows(name, values.dtype)
        self._write(name, values)

    def _rows(self, name: str, dtype: Any, shape: tuple[int, ...] = ()) -> None:
        """A dataset that grows, of rows of a shape."""
        self._group.create_dataset(
            name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(CHUNK_ROWS, *shape), **self._filters
        )

    def _write(self, name: str, values: np.ndarray) -> None:
        if len(values):
            dataset: Any = self._group[name]
            before = len(dataset)
            dataset.resize(before + len(values), axis=0)
            dataset[before:] = values

    def _put(self, name: str, values: np.ndarray) -> None:
        """A whole dataset."""
        chunks = (min(CHUNK_ROWS, len(values)),)
        self._group.create_dataset(name, data=values, chunks=chunks, **self._filters)

    def _constant(self, name: str, shape: tuple[int, ...], value: int) -> None:
        """A dataset of one value: its chunks are not in the file until something else is written."""
        chunks = (min(CHUNK_ROWS, shape[0]), *shape[1:])
        self._group.create_dataset(name, shape, np.int64, chunks=chunks, fillvalue=value, **self._filters)


def same_cells(vertices: np.ndarray, corner_count: int, step_count: int) -> StepCells:
    """Polygons of `corner_count` corners each, as many at each of `step_count` steps.

    vertices: [m], shape [step, polygon, corner, 3].
    """
    polygons = int(np.prod(vertices.shape[:-2], dtype=np.int64))
    each = polygons // max(step_count, 1)
    return StepCells(
        np.ascontiguousarray(vertices.reshape(-1, 3), np.float32),
        offsets(np.full(polygons, corner_count)),
        offsets(np.full(step_count, each)),
    )


POLYDATA_VERSION, COLLECTION_VERSION = (2, 0), (2, 1)
"""Versions of the format that brought what is used: a reader warns of greater ones than it knows."""
POLYGONS_A_BLOCK = 1 << 16


def write_vtkhdf(
    file: ContourFile, chosen: range, temporary: Path, *, gzip: int = 0, scene: bool = False, watch: Progress
) -> dict[str, Any]:
    """Write the contours of the chosen poses, a step each; returns counts.

    scene: object and hand, too, as further blocks. Raises OSError.
    """
    time = file.motion(chosen.start, chosen.stop).get("time")
    value = np.array(chosen, np.float64) if time is None else time[:: chosen.step]
    with new_hdf5(temporary) as hdf5:
        root = hdf5.create_group("VTKHDF", track_order=True)
        version = COLLECTION_VERSION if scene else POLYDATA_VERSION
        names = ("contours", "object", "hand") if scene else ()
        groups = [root.create_group(name, track_order=True) for name in names] or [root]
        blocks = [
            PolyDataSteps(group, kind, version=version, gzip=gzip)
            for group, kind in zip(groups, ("Lines", "Polygons", "Polygons"), strict=False)
        ]
        counts = _write_contours(blocks[0], file, chosen, watch)
        if scene:
            _write_object(blocks[1], file, chosen)
            _write_hand(blocks[2], file, chosen)
            _assemble(root, names, value)
        for block in blocks:  # VTK reads fields of a single block only
            block.finish(value, {} if scene else {"pose": np.array(chosen, np.int64)})
    return counts


def _write_contours(block: PolyDataSteps, file: ContourFile, chosen: range, watch: Progress) -> dict[str, Any]:
    polylines = points = done = 0
    pauses = "dwell" in file.optional
    for number, contours in chosen_blocks(file, chosen):
        cells = StepCells(contours["points"], contours["polyline_start"], contours["pose_start"])
        ones = np.ones(len(contours["points"]), np.float32)
        data = {"kind": contours["kind"], "intensity": contours.get("intensity", ones)}
        if pauses:
            data["dwell"] = contours.get("dwell", 0 * ones)
        block.append(cells, data, {"closed": contours["polyline_closed"], "patch": contours["polyline_patch"]})
        polylines += len(contours["polyline_closed"])
        points += len(contours["points"])
        done += len(number)
        watch(done, len(chosen))
    return {"polylines": polylines, "points": points}


def _write_object(block: PolyDataSteps, file: ContourFile, chosen: range) -> None:
    """The object's mesh: once if it rests, or at each pose."""
    solid = file.object()
    triangles = solid["vertices"][solid["faces"]]
    if "moved" not in solid:
        block.append(same_cells(triangles[None], 3, 1), {}, {})
        block.repeat(len(chosen))
        return
    vertices = solid["vertices"].astype(np.float64)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = max(1, POLYGONS_A_BLOCK // len(triangles))
    for k in range(0, len(chosen), size):
        place = solid["moved"][list(chosen[k : k + size])].astype(np.float64)
        moved = place[:, None, None, :3] + rotate(place[:, None, None, 3:], triangles - middle)
        block.append(same_cells(moved, 3, len(place)), {}, {})


def _write_hand(block: PolyDataSteps, file: ContourFile, chosen: range) -> None:
    """The hand's skin at each pose: patches, or the triangles that contours are drawn on."""
    hand, pose = hand_from(file.hand, file.hand_arrays()), file.motion()["pose"]
    corners = 3 if isinstance(hand, MeshHand) else 4
    size = max(1, POLYGONS_A_BLOCK // _polygons(hand, pose, chosen[0], chosen[0] + 1).shape[1])
    for k in range(0, len(chosen), size):
        part = chosen[k : k + size]
        if part.step == 1:
            polygons = _polygons(hand, pose, part.start, part.stop)
        else:
            polygons = np.concatenate([_polygons(hand, pose, row, row + 1) for row in part])
        block.append(same_cells(polygons, corners, len(part)), {}, {})


def _polygons(hand: Hand, pose: np.ndarray, first: int, stop: int) -> np.ndarray:
    """Polygons of the skin at poses [m], shape [pose, polygon, corner, 3]; a patch that is absent is a point."""
    if isinstance(hand, MeshHand):
        return hand.triangles(pose[first:stop], first)
    corners = hand.corners(pose[first:stop], first)
    absent = ~np.isfinite(corners).all(axis=(2, 3), keepdims=True)
    return np.where(absent, pose[first:stop, None, None, :3], corners)


def _assemble(root: h5py.Group, names: tuple[str, ...], value: np.ndarray) -> None:
    """Make a collection of blocks, of a kind that PyVista takes, too; value: of the time axis at each step.

    Without steps of its own, VTK's reader (9.7.2) shows the first part that is in the file at the first step.
    """
    root.attrs["Version"] = np.array(COLLECTION_VERSION, np.int32)
    root.attrs["Type"] = np.bytes_(b"MultiBlockDataSet")
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(value)
    steps["Values"] = np.asarray(value, np.float64)
    assembly = root.create_group("Assembly", track_order=True)
    for index, name in enumerate(names):
        root[name].attrs["Index"] = np.int32(index)
        assembly[name] = h5py.SoftLink(f"/VTKHDF/{name}")
