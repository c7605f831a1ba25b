"""What was computed of large meshes, kept on disk, so that it is computed once and not at every start.

An entry is an .npz file under `$XDG_CACHE_HOME/palpate/meshes` (`~/.cache/palpate/meshes`), named by a SHA-256 over
what it was made of and over the sources and libraries that decide about it: another version never reads it. Nothing
depends on entries: one that cannot be read is removed, one that cannot be written is left out. Kept are repaired
meshes, by the mesh as given and what was asked for, and half-edges with their box hierarchies, by the placed mesh.
"""

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple
from functools import cache, partial
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import TypeVar

import numpy as np

from ....datasets.array_file import read_arrays
from ....datasets.json_text import parse_json
from ....datasets.storage.durable import discard, write_file
from ....kernels.section.half_edges import LEAF, OPEN, Boxes, HalfEdges
from ...runtime.loading_progress import Watch, unwatched
from .repair import Mended, Repair, repair_mesh
from .report import MeshReport

SWITCH = "PALPATE_CACHE"  # environment variable: "off", or a folder to use instead
BYTES_MOST = 2_000_000_000  # of all entries; beyond, those that were used least lately are deleted
ENTRY = re.compile(r"[0-9a-f]{64}\.npz(\.[0-9a-f]+\.tmp)?")  # and what a killed process left of one

Kept = TypeVar("Kept")


def kept_folder() -> Path | None:
    """Where entries are; None if keeping is switched off or there is no place for it."""
    given = os.environ.get(SWITCH, "")
    if given.lower() == "off":
        return None
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):  # a relative one is to be ignored, says its specification
        return Path(base) / "palpate" / "meshes"
    try:
        return Path.home() / ".cache" / "palpate" / "meshes"
    except RuntimeError:
        return None


@cache
def maker_digest(sources: Sequence[str], libraries: Sequence[str]) -> bytes:
    """SHA-256 over palpate's sources, as paths from its root, and the versions of libraries."""
    digest = hashlib.sha256()
    for name in sources:
        digest.update((Path(__file__).parents[3] / name).read_bytes())
    digest.update(json.dumps([(name, version(name)) for name in libraries]).encode())
    return digest.digest()


def read_entry(path: Path, made_of: Callable[[dict[str, np.ndarray]], Kept]) -> Kept | None:
    """What `made_of` makes of an entry's arrays; None if there is no entry or it is damaged, which is then removed.

    made_of: raises any error for arrays that cannot be right.
    """
    try:
        kept = made_of(read_arrays(path))
    except FileNotFoundError:
        return None
    except Exception:  # of a damaged zip file, or a damaged array in it: readers with many errors of their own
        discard(path)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # it was used
    return kept


def write_entry(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Keep arrays if that can be done: not on a full disk, nor in a folder that may not be written."""
    if sum(array.nbytes for array in arrays.values()) > BYTES_MOST:
        return
    content = BytesIO()  # first in memory: zipfile reports a full disk again when it is deleted
    np.savez(content, **arrays)  # pyright: ignore[reportArgumentType]  # takes arrays by any name
    with contextlib.suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_file(path, content.getbuffer())
        drop_oldest(path.parent)


def drop_oldest(folder: Path) -> None:
    """Delete the entries that were used least lately, until BYTES_MOST hold the others; files of others are left."""
    found = []
    for path in folder.iterdir():
        if not ENTRY.fullmatch(path.name):
            continue
        with contextlib.suppress(OSError):  # another process may have deleted it
            status = path.stat()
            found.append((status.st_mtime, status.st_size, path))
    total = 0
    for _, size, path in sorted(found, reverse=True):
        total += size
        if total > BYTES_MOST:
            discard(path)


EDGES_SECONDS = 0.2  # of making them, below which they are not kept: some 200,000 triangles
EDGES_SOURCES = ("kernels/section/half_edges.py",)  # decide what edges are
EDGES_LIBRARIES = ("numpy", "scipy")


def edges_of_mesh(vertices: np.ndarray, faces: np.ndarray, identity: str) -> HalfEdges:
    """Half-edges of a mesh, from disk if those of the same mesh were made before; identity: of the mesh."""
    folder, path = kept_folder(), None
    if folder is not None:
        digest = hashlib.sha256(maker_digest(EDGES_SOURCES, EDGES_LIBRARIES) + identity.encode())
        path = folder / f"{digest.hexdigest()}.npz"
        if (kept := read_entry(path, partial(_edges_of, vertices, faces))) is not None:
            return kept
    started = perf_counter()
    edges = HalfEdges(vertices, faces)
    if path is not None and perf_counter() - started >= EDGES_SECONDS:
        parts = {"order": edges.order.astype(np.int32), "twin": edges.twin, **edges.boxes._asdict()}
        write_entry(path, parts)
    return edges


def _edges_of(vertices: np.ndarray, faces: np.ndarray, entry: dict[str, np.ndarray]) -> HalfEdges:
    """Half-edges from the arrays of an entry; raises ValueError for arrays that are not of this mesh."""
    order, twin, boxes = entry["order"], entry["twin"], Boxes(entry["centre"], entry["half"])
    paired = np.flatnonzero(twin != OPEN)
    sound = (
        (order.dtype, twin.dtype, boxes.centre.dtype, boxes.half.dtype) == (np.int32, np.int32, np.float32, np.float32)
        and np.array_equal(np.bincount(order), np.ones(len(faces)))
        and twin.shape == (faces.size,)
        and np.array_equal(twin[twin[paired]], paired)
        and boxes.centre.shape == boxes.half.shape == (2 * boxes.leaf_first, 3)
        and LEAF * boxes.leaf_first >= len(faces)
    )
    if not sound:
        raise ValueError("the entry holds no half-edges of this mesh")
    return HalfEdges.of_parts(vertices, faces, order, twin, boxes)


REPAIR_SECONDS = 0.5  # of repairing, below which a mesh is not kept
REPAIR_SOURCES = (  # decide how a mesh is repaired
    "kernels/offsets.py",
    "kernels/one_device.py",
    "kernels/patch.py",
    "kernels/section/half_edges.py",
    "kernels/solids/crossing.py",
    "kernels/solids/nesting.py",
    "kernels/solids/orientation.py",
    "render/errors.py",
    "render/objects/mesh/bodies.py",
    "render/objects/mesh/repair.py",
    "render/objects/mesh/report.py",
    "render/objects/mesh/sheets.py",
    "render/objects/mesh/union.py",
    "render/objects/mesh/welding.py",
    "render/runtime/loading_progress.py",
)
REPAIR_LIBRARIES = ("manifold3d", "numpy", "scipy", "warp-lang")


def repaired_mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    repair: Repair,
    watch: Watch = unwatched,
) -> Mended:
    """Repaired mesh of `repair_mesh`, from disk if the same mesh was repaired before."""
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    folder = kept_folder()
    path = None if folder is None else folder / f"{entry_key(vertices, faces, repair)}.npz"
    if path is not None:
        watch("looking for it as repaired before", 0, 1)
        kept = read_entry(path, mended_of)
        if kept is not None:
            return kept
    started = perf_counter()
    repaired = repair_mesh(vertices, faces, repair, watch)
    if path is not None and perf_counter() - started >= REPAIR_SECONDS:
        write_entry(path, arrays_of(repaired))
    return repaired


def entry_key(vertices: np.ndarray, faces: np.ndarray, repair: Repair) -> str:
    """Name of the entry of a mesh, float64 and int64, and of how it is repaired."""
    digest = hashlib.sha256(maker_digest(REPAIR_SOURCES, REPAIR_LIBRARIES))
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
