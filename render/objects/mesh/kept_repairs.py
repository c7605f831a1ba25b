"""Repaired meshes kept on disk, by the mesh as given and what was asked for (kept_arrays.py)."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, astuple
from time import perf_counter

import numpy as np

from ....datasets.json_text import parse_json
from ...runtime.loading_progress import Watch, unwatched
from .kept_arrays import kept_folder, maker_digest, read_entry, write_entry
from .repair import Mended, Repair, repair_mesh
from .report import MeshReport

SECONDS_LEAST = 0.5  # of repairing, below which a mesh is not kept
SOURCES = (  # of palpate, that decide how a mesh is repaired
    "kernels/solids/crossing.py",
    "kernels/section/half_edges.py",
    "kernels/solids/nesting.py",
    "kernels/solids/orientation.py",
    "kernels/offsets.py",
    "kernels/one_device.py",
    "kernels/patch.py",
    "render/errors.py",
    "render/runtime/loading_progress.py",
    "render/objects/mesh/repair.py",
    "render/objects/mesh/bodies.py",
    "render/objects/mesh/contacts.py",
    "render/objects/mesh/holes.py",
    "render/objects/mesh/coincident_triangles.py",
    "render/objects/mesh/report.py",
    "render/objects/mesh/sheets.py",
    "render/objects/mesh/slivers.py",
    "render/objects/mesh/union.py",
    "render/objects/mesh/welding.py",
)
LIBRARIES = ("manifold3d", "numpy", "scipy", "warp-lang")


def repaired_mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    repair: Repair,
    watch: Watch = unwatched,
    *,
    announce: Callable[[int], None] | None = None,
) -> Mended:
    """Repaired mesh of `repair_mesh`, from disk if the same mesh was repaired before.

    announce: called with the number of triangles before a mesh is repaired, not where that was done before.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    folder = kept_folder()
    path = None if folder is None else folder / f"{entry_key(vertices, faces, repair)}.npz"
    if path is not None:
        watch("looking for it as repaired before", 0, 1)
        kept = read_entry(path, mended_of)
        if kept is not None:
            return kept
    if announce is not None:
        announce(len(faces))
    started = perf_counter()
    repaired = repair_mesh(vertices, faces, repair, watch)
    if path is not None and perf_counter() - started >= SECONDS_LEAST:
        write_entry(path, arrays_of(repaired))
    return repaired


def entry_key(vertices: np.ndarray, faces: np.ndarray, repair: Repair) -> str:
    """Name of the entry of a mesh, float64 and int64, and of how it is repaired."""
    digest = hashlib.sha256(maker_digest(SOURCES, LIBRARIES))
    digest.update(json.dumps([vertices.shape, faces.shape, astuple(repair)]).encode())
    digest.update(np.ascontiguousarray(vertices))
    digest.update(np.ascontiguousarray(faces))
    return digest.hexdigest()


def mended_of(entry: dict[str, np.ndarray]) -> Mended:
    """A repaired mesh from the arrays of an entry; raises ValueError for arrays that are none."""
    vertices, faces = entry["vertices"], entry["faces"]
    solid_count, report = int(entry["solid_count"]), MeshReport(**parse_json(str(entry["report"]), allow_nan=True))
    sound = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
    if not (sound and 0 <= solid_count <= len(faces) and faces.min() >= 0 and faces.max() < len(vertices)):
        raise ValueError("the entry holds no mesh")
    return Mended(vertices, faces.astype(np.int64), solid_count, report)


def arrays_of(repaired: Mended) -> dict[str, np.ndarray]:
    """The arrays of an entry from which `mended_of` makes a repaired mesh."""
    return {
        "vertices": repaired.vertices,
        "faces": repaired.faces.astype(np.int32),
        "solid_count": np.array(repaired.solid_count),
        "report": np.array(json.dumps(asdict(repaired.report), default=np.generic.item)),
    }
