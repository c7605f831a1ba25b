"""What a page shows of one contour file: its arrays, packed, and their descriptions."""

from typing import Any

import numpy as np

from ....datasets.rigid import rotate, unit
from ...contour_batch import ContourBatch
from ...errors import StrategyError
from ...reports.rendering_labels import hand_text, strategy_name_of
from ...sampling.draw_frequency import pose_frequencies
from ...sampling.presets import PRESETS
from ...sampling.strategy import SamplingStrategy
from ...terminal.foreign_text import visible
from ..file_scene import FileScene, Moment
from ..focal_path import FocalPath, focal_path
from .packing import Packer

FOCUS_MOST = 512  # samples of the focal point a pose: every 2nd, every 3rd, ... of a pose that has more
JUMP, HOP = 1, 2
FACES_MOST = 20_000
"""Triangles of an object on a page; of those that have more, manifold3d moves corners together."""
_SHARES = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)  # of the object's size: tolerances, until few triangles are left


def pack_file(
    scene: FileScene, rows: list[int], packer: Packer, *, name: str, sampling: SamplingStrategy | None = None
) -> dict[str, Any]:
    """Pack some poses of a file, and what is the same at all of them; the description is what JSON takes.

    rows: numbers of the poses, increasing. name: the file's, as the page shows it. Raises ContourFileError where the
    file cannot be read, StrategyError where the sampling strategy can draw none of the poses.
    """
    moments = [scene.moment(row) for row in rows]
    pose = np.stack([moment.hand_pose for moment in moments])
    strategy = sampling or scene.sampling
    preset = next((name for name, make in PRESETS.items() if make() == strategy), "options of its own")
    return {
        "name": visible(name),
        "object": visible(scene.object_name),
        "hand": visible(hand_text(scene.file.hand)),
        "strategy": visible(strategy_name_of(scene.strategy)),
        "sampling": visible(f"{preset}: {strategy.speed:g} m/s at {strategy.update_rate / 1e3:g} kHz"),
        "pose_count": scene.pose_count,
        "has_time": scene.has_time,
        "solid": _pack_solid(scene, moments, packer),
        "skin": _pack_hand(scene, moments, pose, packer),
        "poses": _pack_poses(scene, moments, pose, strategy, packer),
        "contours": _pack_contours([moment.contours for moment in moments], packer),
        "focus": _pack_focus(_paths(scene, moments, strategy), packer),
    }


def _pack_poses(
    scene: FileScene, moments: list[Moment], pose: np.ndarray, strategy: SamplingStrategy, packer: Packer
) -> dict[str, Any]:
    length = np.array([_length(scene, moment) for moment in moments])
    frequency = np.concatenate([pose_frequencies(moment.contours, strategy) for moment in moments])
    time = [moment.index if moment.time is None else moment.time for moment in moments]
    return {
        "index": packer.numbers(np.array([moment.index for moment in moments]), "u4"),
        "time": packer.numbers(np.array(time, np.float64), "f8"),
        "hand_pose": packer.numbers(pose, "f4"),
        "length": packer.numbers(length, "f4"),
        "draw_frequency": packer.numbers(frequency, "f4"),
        "tilt": packer.numbers(np.degrees([moment.tilt for moment in moments]), "f4"),
    }


def _length(scene: FileScene, moment: Moment) -> float:
    """Of a pose's contours, as the file has it [m]; NaN: not rendered yet."""
    if not moment.is_done:
        return np.nan
    return float(scene.file.metrics(moment.index, moment.index + 1)["length"][0])


def _pack_solid(scene: FileScene, moments: list[Moment], packer: Packer) -> dict[str, Any]:
    vertices, faces, tolerance = simplified_for_display(scene.vertices, scene.faces)
    described = packer.positions(vertices - scene.middle)
    packed = {
        "vertices": described,
        "step": described["step"],
        "faces": packer.indices(faces, len(vertices)),
        "face_count": len(scene.faces),
        "tolerance": tolerance,
        "middle": scene.middle.tolist(),
        "pose": None,
    }
    poses = [moment.object_pose for moment in moments]
    if any(pose is not None for pose in poses):
        packed["pose"] = packer.numbers(np.stack([pose for pose in poses if pose is not None]), "f4")
    return packed


def _pack_hand(scene: FileScene, moments: list[Moment], pose: np.ndarray, packer: Packer) -> dict[str, Any]:
    """Planes of skin in the array's frame; the mesh in the hand's, once if its shape stays the same."""
    looks = scene.looks
    shown = moments[:1] if looks.is_rigid else moments
    vertices = np.stack([_in_hand(moment.hand.vertices, moment.hand_pose) for moment in shown])
    patches = [moment.hand.patches for moment in moments]
    return {
        "vertices": packer.positions(vertices[0] if looks.is_rigid else vertices.reshape(len(vertices), -1)),
        "vertex_count": vertices.shape[1],
        "is_rigid": looks.is_rigid,
        "is_rendered": moments[0].hand.is_rendered,
        "faces": packer.indices(looks.faces, vertices.shape[1]),
        "glabrous": packer.numbers(looks.glabrous, "u1"),
        "patch_count": packer.numbers(np.array([len(each) for each in patches]), "u2"),
        "corners": packer.positions(np.concatenate(patches).reshape(-1, 3)),
    }


def _in_hand(vertices: np.ndarray, pose: np.ndarray) -> np.ndarray:
    turn = unit(np.asarray(pose[3:], np.float64)) * [-1.0, -1.0, -1.0, 1.0]
    return rotate(turn, vertices.astype(np.float64) - pose[:3])


def _pack_contours(batches: list[ContourBatch], packer: Packer) -> dict[str, Any]:
    points = np.concatenate([batch.points for batch in batches])
    counts = np.concatenate([np.diff(batch.polyline_start) for batch in batches])
    packed = {
        "polyline_count": packer.numbers(np.array([batch.polyline_count for batch in batches]), "u4"),
        "point_count": packer.numbers(counts, "u4"),
        "points": (described := packer.positions(points)),
        "step": described["step"],
        "kind": packer.numbers(np.concatenate([batch.kind for batch in batches]), "u1"),
        "intensity": None,
    }
    if any(batch.intensity is not None for batch in batches):
        levels = [np.ones(b.point_count) if b.intensity is None else b.intensity for b in batches]
        packed["intensity"] = packer.numbers(np.round(255 * np.concatenate(levels)), "u1")
    return packed


def _paths(scene: FileScene, moments: list[Moment], strategy: SamplingStrategy) -> list[FocalPath | None]:
    """Focal points of each pose; None where there are none, or where a pose lasts less than a sample."""
    paths: list[FocalPath | None] = []
    refused: StrategyError | None = None
    for moment in moments:
        try:
            paths.append(focal_path(scene, moment.index, strategy) if moment.contours.point_count else None)
        except StrategyError as error:
            refused = error
            paths.append(None)
    if refused is not None and all(path is None for path in paths):
        raise refused
    return paths


def _pack_focus(paths: list[FocalPath | None], packer: Packer) -> dict[str, Any]:
    """Samples of all poses in one, at most FOCUS_MOST a pose: of more, every second, every third, ..."""
    strides = [0 if path is None else -(-len(path.position) // FOCUS_MOST) for path in paths]
    found = [(path, stride) for path, stride in zip(paths, strides, strict=True) if path is not None and stride]
    places = [path.position.reshape(len(path.position), -1)[::stride] for path, stride in found]
    levels = [path.intensity.reshape(len(path.intensity), -1)[::stride] for path, stride in found]
    foci = levels[0].shape[1] if levels else 1
    counts = np.zeros(len(paths), np.int64)
    counts[np.array(strides, np.int64) > 0] = [len(place) for place in places]
    rate = [
        0.0 if path is None or not stride else path.rate / stride for path, stride in zip(paths, strides, strict=True)
    ]
    steps = [_steps(path, stride) for path, stride in found]
    return {
        "focus_count": foci,
        "sample_count": packer.numbers(counts, "u4"),
        "stride": max(strides, default=0),
        "rate": packer.numbers(np.array(rate), "f4"),
        "position": packer.positions(np.concatenate([np.zeros((0, 3 * foci)), *places])),
        "intensity": packer.numbers(np.round(255 * np.concatenate([np.zeros((0, foci)), *levels])), "u1"),
        "step": packer.numbers(np.concatenate([np.zeros(0), *steps]), "u1"),
    }


def _steps(path: FocalPath, stride: int) -> np.ndarray:
    """JUMP or HOP for each sample that is kept where one lies between it and the one kept before, else 0."""
    kinds = np.where(path.jump, JUMP, np.where(path.hop, HOP, 0))
    kept = -(-len(kinds) // stride)
    rank = np.array([0, 2, 1])[kinds]  # a jump outranks a hop
    padded = np.concatenate([np.zeros(stride - 1, np.int64), rank, np.zeros(kept * stride, np.int64)])
    return np.array([0, HOP, JUMP])[padded[: kept * stride].reshape(kept, stride).max(axis=1)]


def simplified_for_display(
    vertices: np.ndarray, faces: np.ndarray, faces_most: int = FACES_MOST
) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices [m] and faces of a mesh with few triangles, and the tolerance [m] that it took; 0: the mesh itself.

    A surface that is not closed stays as it is, whatever its size: manifold3d does not take it.
    """
    if len(faces) <= faces_most:
        return vertices, faces, 0.0
    import manifold3d  # 50 ms that only simplifying costs

    middle = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
    near = (vertices - middle).astype(np.float32)
    mesh = manifold3d.Mesh(near, np.ascontiguousarray(faces, np.uint32))
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError or solid.num_tri() == 0:
        return vertices, faces, 0.0
    tolerance = 0.0
    for share in _SHARES:
        tolerance = share * float(np.ptp(near, axis=0).max())
        solid = solid.simplify(tolerance)
        if solid.num_tri() <= faces_most:
            break
    out = solid.to_mesh()
    found = np.asarray(out.vert_properties)[:, :3].astype(np.float64) + middle
    return found.astype(np.float32), np.asarray(out.tri_verts, np.int32), tolerance
