"""What a page shows of one contour file: its arrays, packed, and their descriptions."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from ....datasets.rigid import rotate, unit
from ....device.array import ArrayModel
from ...contour_batch import ContourBatch
from ...coordinate_spacing import apart_text
from ...errors import StrategyError
from ...hands.stored_hand import HandLook
from ...reports.rendering_labels import hand_text, labels_of, strategy_name_of
from ...sampling.draw_frequency import pose_frequencies
from ...sampling.presets import PRESETS
from ...sampling.strategy import SamplingStrategy
from ...terminal.foreign_text import visible
from ..file_scene import FileScene, Moment
from ..focal_path import FocalPath, focal_path
from ..packing import Packer

FOCUS_MOST = 512  # samples of the focal point a pose: every 2nd, every 3rd, ... of a pose that has more
JUMP, HOP = 1, 2
WIDE = 2.0  # [m]: an object that no hand reaches around
POSES_LOOKED_AT = 200  # for where the hand is
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
    constant = pack_constants(scene, packer, name=name, sampling=sampling)
    block, refused = pack_poses(scene, rows, packer, sampling)
    if refused is not None:
        raise refused
    return merged(constant, block)


def merged(constant: dict[str, Any], block: dict[str, Any]) -> dict[str, Any]:
    """One description of what is constant in a file and of some of its poses."""
    parts = {name: constant[name] | block[name] for name in ("solid", "skin")}
    return constant | block | parts


def pack_constants(
    scene: FileScene, packer: Packer, *, name: str, sampling: SamplingStrategy | None = None
) -> dict[str, Any]:
    """Pack what all poses of a file share: names, the object's mesh, and the hand's topology."""
    strategy, first = sampling or scene.sampling, scene.moment(0)
    return {
        "name": visible(name),
        "hand": visible(hand_text(scene.file.hand)),
        "pose_count": scene.pose_count,
        "has_time": scene.has_time,
        **pack_looks(
            first.hand, first.hand_pose, scene.vertices, scene.faces, scene.looks.faces, packer,
            is_rigid=scene.looks.is_rigid,
        ),
        **names_of(scene.object_name, strategy_name_of(scene.strategy), strategy),
    }  # fmt: skip


def names_of(solid: str, strategy: str, sampling: SamplingStrategy) -> dict[str, str]:
    """Names of an object and of both strategies, as the page shows them."""
    preset = next((name for name, make in PRESETS.items() if make() == sampling), "options of its own")
    return {
        "object": visible(solid),
        "strategy": visible(strategy),
        "sampling": visible(f"{preset}: {sampling.speed:g} m/s at {sampling.update_rate / 1e3:g} kHz"),
    }


def pack_looks(
    hand: HandLook,
    hand_pose: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    hand_faces: np.ndarray,
    packer: Packer,
    *,
    is_rigid: bool,
) -> dict[str, Any]:
    """Pack the object's mesh [m], and the hand's: its vertices in the hand's frame if its shape never changes."""
    skin: dict[str, Any] = {
        "vertex_count": len(hand.vertices),
        "is_rigid": is_rigid,
        "is_rendered": hand.is_rendered,
        "faces": packer.indices(hand_faces, len(hand.vertices)),
    }
    if is_rigid:
        skin["vertices"] = packer.positions(_in_hand(hand.vertices, hand_pose))
    return {"solid": _pack_solid(vertices, faces, packer), "skin": skin}


def pack_poses(
    scene: FileScene, rows: list[int], packer: Packer, sampling: SamplingStrategy | None = None
) -> tuple[dict[str, Any], StrategyError | None]:
    """Pack some poses of a file, and say why the focal point cannot draw them where it can draw none of them."""
    strategy = sampling or scene.sampling
    moments = [scene.moment(row) for row in rows]
    paths, refused = _paths(scene, moments, strategy)
    lengths = np.array([_length(scene, moment) for moment in moments])
    return pack_moments(moments, lengths, paths, strategy, packer, is_rigid=scene.looks.is_rigid), refused


def pack_moments(
    moments: list[Moment],
    lengths: np.ndarray,
    paths: Sequence[FocalPath | None],
    sampling: SamplingStrategy,
    packer: Packer,
    *,
    is_rigid: bool,
) -> dict[str, Any]:
    """Pack poses, their contours and their focal points. lengths: of their contours [m], NaN where not rendered."""
    frequency = np.concatenate([pose_frequencies(moment.contours, sampling) for moment in moments])
    time = [moment.index if moment.time is None else moment.time for moment in moments]
    moved = [moment.object_pose for moment in moments]
    solid = None
    if any(pose is not None for pose in moved):
        solid = packer.numbers(np.stack([pose for pose in moved if pose is not None]), "f4")
    return {
        "poses": {
            "index": packer.numbers(np.array([moment.index for moment in moments]), "u4"),
            "time": packer.numbers(np.array(time, np.float64), "f8"),
            "hand_pose": packer.numbers(np.stack([moment.hand_pose for moment in moments]), "f4"),
            "length": packer.numbers(lengths, "f4"),
            "draw_frequency": packer.numbers(frequency, "f4"),
            "tilt": packer.numbers(np.degrees([moment.tilt for moment in moments]), "f4"),
        },
        "solid": {"pose": solid},
        "skin": _pack_skin(moments, packer, is_rigid=is_rigid),
        "contours": _pack_contours([moment.contours for moment in moments], packer),
        "focus": _pack_focus(paths, packer),
    }


def file_names(scenes: Sequence[FileScene]) -> list[str]:
    """Names of files as the page shows them: with their folders where they are alike, and whether one is unfinished."""
    names = [scene.path.name for scene in scenes]
    if len(set(names)) < len(names):
        names = [str(scene.path) for scene in scenes]
    return [
        name if scene.is_sealed else f"{name} (unfinished: {scene.done_count} of {scene.pose_count} poses are rendered)"
        for name, scene in zip(names, scenes, strict=True)
    ]


def describe_page(
    files: list[dict[str, Any]],
    scenes: Sequence[FileScene],
    arrays: Sequence[ArrayModel],
    packer: Packer,
    title: str | None = None,
) -> dict[str, Any]:
    """What a page shows: packed files, their labels, the arrays under them, and the box around all of it."""
    for file, label in zip(files, labels_of([scene.file for scene in scenes]), strict=True):
        file["label"] = visible(label)
    boxes = np.stack([scene.bounds() for scene in scenes])
    objects, labels = (" and ".join(dict.fromkeys(file[name] for file in files)) for name in ("object", "label"))
    return {
        "title": visible(title or f"{objects}, {labels}"),
        "notes": list(dict.fromkeys(visible(note) for scene in scenes for note in notes_of(scene))),
        "version": version("palpate"),
        "files": files,
        "arrays": [pack_array(model, packer) for model in arrays],
        "bounds": [boxes[:, 0].min(axis=0).round(5).tolist(), boxes[:, 1].max(axis=0).round(5).tolist()],
    }


def notes_of(scene: FileScene) -> list[str]:
    """Why there may be nothing to see: a hand that never meets the object, lengths that look like millimetres."""
    notes = []
    if scene.is_replaced:
        notes.append(
            f"{scene.path.name} was replaced or removed since palpate view began, which still shows the old one."
        )
    box = np.stack([scene.vertices.min(axis=0), scene.vertices.max(axis=0)]).astype(np.float64)
    if np.ptp(box, axis=0).max() > WIDE:
        width = f"{np.ptp(box, axis=0).max():.3g} m"
        notes.append(f"The object is {width} wide: a mesh in millimetres needs --scale 0.001 of palpate render.")
    if not scene.file.polyline_count and scene.is_sealed:
        rows = np.unique(np.linspace(0, scene.pose_count - 1, POSES_LOOKED_AT).astype(np.int64))
        pose = np.concatenate([scene.file.motion(int(row), int(row) + 1)["pose"] for row in rows])
        text = apart_text(box, pose)
        notes.append(f"{text[:1].upper()}{text[1:]}.")
    return notes


def pack_array(model: ArrayModel, packer: Packer) -> dict[str, Any]:
    """Transducers as discs that nearly touch, the plate under them, and the focal zone's corners, low ones first."""
    own = model.unplaced or model
    zone, place = own.focal_zone, own.position.astype(np.float64)
    apart = np.linalg.norm(place[1:] - place[0], axis=1).min() if len(place) > 1 else 0.01
    low, high = place.min(axis=0) - apart / 2, place.max(axis=0) + apart / 2
    plate = [[x, y, 0.0] for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))]
    square = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    box = [[zone.lateral * x, zone.lateral * y, z] for z in (zone.z_min, zone.z_max) for x, y in square]
    plate, box = (rotate(model.pose[3:], np.array(corners)) + model.pose[:3] for corners in (plate, box))
    return {
        "name": visible(model.name),
        "transducers": packer.positions(model.position),
        "normals": packer.numbers(model.normal, "f4"),
        "radius": round(0.46 * float(apart), 6),
        "plate": plate.round(6).tolist(),
        "zone": box.round(6).tolist(),
        "zone_text": f"focal zone of {visible(model.name)}: {1e3 * zone.z_min:g} to {1e3 * zone.z_max:g} mm high",
    }


def _length(scene: FileScene, moment: Moment) -> float:
    """Of a pose's contours, as the file has it [m]; NaN: not rendered yet."""
    if not moment.is_done:
        return np.nan
    return float(scene.file.metrics(moment.index, moment.index + 1)["length"][0])


def _pack_solid(vertices: np.ndarray, faces: np.ndarray, packer: Packer) -> dict[str, Any]:
    middle = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
    shown, shown_faces, tolerance = simplified_for_display(vertices, faces)
    described = packer.positions(shown - middle)
    return {
        "vertices": described,
        "step": described.get("step", 0.0),
        "faces": packer.indices(shown_faces, len(shown)),
        "face_count": len(faces),
        "tolerance": tolerance,
        "middle": middle.tolist(),
    }


def _pack_skin(moments: list[Moment], packer: Packer, *, is_rigid: bool) -> dict[str, Any]:
    """Planes of skin in the array's frame; vertices of a mesh that changes its shape in the hand's."""
    patches = [moment.hand.patches for moment in moments]
    packed: dict[str, Any] = {
        "patch_count": packer.numbers(np.array([len(each) for each in patches]), "u2"),
        "corners": packer.positions(np.concatenate(patches).reshape(-1, 3)),
    }
    if not is_rigid:
        vertices = np.stack([_in_hand(moment.hand.vertices, moment.hand_pose) for moment in moments])
        packed["vertices"] = packer.positions(vertices.reshape(len(vertices), -1))
    return packed


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
        "step": described.get("step", 0.0),
        "kind": packer.numbers(np.concatenate([batch.kind for batch in batches]), "u1"),
        "intensity": None,
    }
    if any(batch.intensity is not None for batch in batches):
        levels = [np.ones(b.point_count) if b.intensity is None else b.intensity for b in batches]
        packed["intensity"] = packer.numbers(np.round(255 * np.concatenate(levels)), "u1")
    return packed


def _paths(
    scene: FileScene, moments: list[Moment], strategy: SamplingStrategy
) -> tuple[list[FocalPath | None], StrategyError | None]:
    """Focal points of each pose; None where there are none, or where a pose lasts less than a sample."""
    paths: list[FocalPath | None] = []
    refused: StrategyError | None = None
    for moment in moments:
        try:
            paths.append(focal_path(scene, moment.index, strategy) if moment.contours.point_count else None)
        except StrategyError as error:
            refused = error
            paths.append(None)
    return paths, refused if all(path is None for path in paths) else None


def _pack_focus(paths: Sequence[FocalPath | None], packer: Packer) -> dict[str, Any]:
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
