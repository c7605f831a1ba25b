"""VTKHDF: contours as lines over time, which ParaView and PyVista open, with object and hand if asked for."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ...datasets.storage.hdf5_output import new_hdf5
from ..hands.hand import Hand
from ..hands.mesh_hand import MeshHand
from ..hands.stored_hand import hand_from
from .pose_choice import Progress, chosen_blocks
from .vtkhdf_steps import PolyDataSteps, StepCells, same_cells

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
