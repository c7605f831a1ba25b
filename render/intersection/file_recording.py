"""Render into a contour file, writing each chunk while workers compute the next ones."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from ...datasets.contour_file.blocks import work_folder
from ...datasets.contour_file.header import FileHeader
from ...datasets.contour_file.reader import ContourFile
from ...datasets.contour_file.writer import ContourWriter
from ...datasets.errors import ContourFileError, DatasetError
from ...datasets.motions.hand_motion import HandMotion
from ...datasets.storage.durable import discard_tree
from ...datasets.storage.schema import removed_name
from ..contour_batch import KINDS, ContourBatch
from ..coordinate_spacing import apart_text, warn_of_spacing
from ..hands.hand import Hand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.moving_object import about_outline
from ..objects.solid import Solid
from ..runtime.interrupt import interrupt_between
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.user_stage_sources import stage_sources
from .batch_rendering import Chunk, removes_any, rendered_chunks
from .job import MEMORY_SMALLEST, job_of
from .scene import Scene

POSES_AT_ONCE = 1 << 16  # of a batch in memory, written together
PACKAGES = ("palpate", "warp-lang", "numpy", "trimesh", "h5py")


@dataclass(frozen=True)
class Recording:
    """Result of recording a motion's contours."""

    path: Path
    pose_count: int
    rendered: int
    """Poses rendered by this call; the others were there already."""
    repairs: tuple[str, ...]
    """Descriptions of damage that resuming found and rendered again."""


def file_header(scene: Scene, motion: HandMotion, device: str) -> FileHeader:
    """Everything of a contour file that is known before the first pose is rendered."""
    solid, hand = scene.solid, scene.hand
    described = solid.described()
    vertices, faces = solid.outline_mesh()
    meshed, sources = isinstance(solid, MeshObject), stage_sources(scene.strategy)
    outline_pose = scene.object_pose
    if outline_pose is not None:
        outline_pose = about_outline(outline_pose, scene.object_centre, vertices)
    return FileHeader(
        pose=motion.pose,
        time=motion.time,
        time_offset=motion.offset,
        seed=motion.seed,
        inserted=motion.inserted,
        provenance=motion.provenance,
        object_name=solid.name.encode(errors="backslashreplace").decode(),  # of a file whose name is no text
        vertices=vertices,
        faces=faces,
        placement=described["placement"],
        representation={} if meshed else {k: v for k, v in described.items() if k not in ("name", "placement")},
        moved=outline_pose,
        object_attributes={k: described[k] for k in ("triangles", "repair", "report", "detail") if k in described},
        hand=hand.described(),
        hand_arrays=hand.arrays(),
        strategy=scene.strategy.described() | ({"sources": sources} if sources else {}),
        versions={package: version(package) for package in PACKAGES},
        device=device,
        raw_error=scene.raw_error,
    )


def metrics_of(chunk: Chunk) -> dict[str, np.ndarray]:
    """Per-pose metrics of a chunk, as the file names them."""
    metrics = {
        "length": chunk.lengths.sum(axis=1, dtype=np.float64).astype(np.float32),
        **{f"length_{kind}": np.ascontiguousarray(chunk.lengths[:, k]) for kind, k in KINDS.items()},
        "polylines": np.diff(chunk.contours.pose_start).astype(np.int32),
    }
    for stage, length in chunk.removed.items():
        name = removed_name(stage)
        metrics[name] = metrics.get(name, np.float32(0)) + length.astype(np.float32)
    return metrics


def record(
    path: str | Path,
    solid: Solid | str | Path,
    hand: Hand | str,
    motion: HandMotion | str | Path,
    strategy: IntersectionStrategy | str = "cc",
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    mode: Literal["create", "resume", "overwrite"] = "create",
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    gzip: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Recording:
    """Render a motion into a contour file; but for the last ten seconds, what was rendered survives a kill.

    A full disk costs nothing that was rendered before, and leaving by an exception or Ctrl-C keeps all.

    solid, hand, motion, strategy: objects, or names and files, as for `render`.
    mode: "create" refuses an existing file, unless it holds no contour; "resume" goes on with an unfinished one of the
    same object, hand, motion, strategy and version; "overwrite" replaces it when the new one is complete, but for a
    file with contours by a rendering without any. object_pose: motion or poses of an
    object that moves, see `object_poses`. devices: one worker on each of these Warp devices, by default one on
    `device`; the file is the same. memory: budget of all chunks, computed or written [byte], by default 512 MB or
    more; the motion itself (36 bytes a pose), the object, and up to 256 MB that wait to be saved come on
    top.
    progress: called with the poses that are rendered, and with all.
    Raises MeshError, StrategyError, MotionError and warns as `render` does; ContourFileError for what the file refuses.

    >>> from palpate.render import ContourFile, Palm, record, static_pose
    >>> record("cube.h5", "cube", Palm(), static_pose([0, 0, 0.2]), "cc", mode="overwrite").rendered
    1
    >>> with ContourFile("cube.h5") as file:
    ...     file.metrics()["length"]  # [m]
    array([0.34], dtype=float32)
    """
    means = {"device": device, "devices": devices, "memory": memory, "memory_least": 4 * MEMORY_SMALLEST}
    job = job_of(solid, hand, motion, strategy, object_pose=object_pose, progress=progress, **means)
    scene, motion = job.scene, job.motion
    warn_of_spacing(scene.solid.name, scene.solid.bounds, motion.pose, scene.object_pose)
    header = file_header(scene, motion, ",".join(dict.fromkeys(job.devices)))
    if mode == "create" and polylines_in(path) == 0:
        mode = "overwrite"
    with ContourWriter(path, header, mode=mode) as writer:
        missing = writer.missing()
        rendered = sum(stop - first for first, stop in missing)
        done = len(motion) - rendered
        folder = work_folder(Path(path))  # none where the file is complete
        drawn = polylines_before(folder) if done and folder.is_dir() else 0
        removed_any = False
        job.report(done)
        chunks = rendered_chunks(job, missing)
        # what ends this loop also ends the workers, before the file is let go
        with interrupt_between() as raise_if_interrupted, closing(chunks):
            for chunk in chunks:
                writer.write(chunk.first, chunk.stop, chunk.contours.arrays(), metrics_of(chunk), chunk.timing)
                done += chunk.stop - chunk.first
                drawn += chunk.contours.polyline_count
                removed_any |= removes_any(chunk.removed)
                job.report(done)
                raise_if_interrupted()
        if folder.is_dir() and not drawn and (old_count := polylines_in(path)):
            writer.close()
            discard_tree(folder)
            raise ContourFileError(unchanged_text(path, old_count, scene, motion, removed_any=removed_any))
        writer.seal(gzip=gzip)
        return Recording(Path(path), len(motion), rendered, writer.repairs)


def polylines_before(folder: Path) -> int:
    """Number of polylines of what an unfinished rendering has committed."""
    with ContourFile(folder) as file:
        return file.polyline_count


def polylines_in(path: str | Path) -> int | None:
    """Number of polylines of a finished contour file; None where there is none, or another file."""
    try:
        with ContourFile(path) as file:
            return file.polyline_count if file.sealed else None
    except DatasetError:
        return None


def unchanged_text(path: str | Path, old_count: int, scene: Scene, motion: HandMotion, *, removed_any: bool) -> str:
    """The sentence on a file with contours that an empty rendering does not replace, with the likely cause.

    old_count: polylines of the file; removed_any: whether prune stages removed contours.
    """
    cause = (
        "the prune stages removed every contour"
        if removed_any
        else "no pose has a contour of the object, which moves"
        if scene.object_pose is not None
        else apart_text(scene.solid.bounds, motion.pose)
    )
    return f"{path}: stays as it is, with its {old_count:,} polylines, as the new rendering has none: {cause}"


def save_contours(
    path: str | Path,
    batch: ContourBatch,
    removed: dict[str, np.ndarray],
    scene: Scene,
    motion: HandMotion,
    *,
    overwrite: bool = False,
) -> None:
    """Write contours that are in memory into a contour file, whole or not at all; removed: as `collect` gives it.

    Raises ContourFileError for a file that is there, unless `overwrite` or without a contour, for one with contours
    where there are none to write, one that cannot be written, another suffix.
    """
    path = Path(path)
    if path.suffix.lower() not in (".h5", ".hdf5"):
        raise ContourFileError(f"{path}: a contour file must end in .h5 or .hdf5")
    old_count = polylines_in(path)
    overwrite = overwrite or old_count == 0
    if (path.exists() or path.is_symlink()) and not overwrite:
        raise ContourFileError(f"{path} exists already: overwrite=True replaces it once the new one is whole")
    batch = batch.numpy()
    if old_count and not batch.polyline_count:
        raise ContourFileError(unchanged_text(path, old_count, scene, motion, removed_any=removes_any(removed)))
    header = file_header(scene, motion, "cpu")
    with ContourWriter(path, header, mode="overwrite" if overwrite else "create") as writer:
        for first in range(0, len(batch), POSES_AT_ONCE):
            stop = min(first + POSES_AT_ONCE, len(batch))
            part = batch.select(first, stop)
            own = {name: length[first:stop] for name, length in removed.items()}
            chunk = Chunk(first, stop, part, part.lengths(), own)
            writer.write(first, stop, part.arrays(), metrics_of(chunk), {"total": 0.0})
        writer.seal()
