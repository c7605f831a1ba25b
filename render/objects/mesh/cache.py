"""Repaired meshes kept on disk, so that a large mesh is repaired once and not at every start.

An entry is an .npz file under `$XDG_CACHE_HOME/palpate/meshes` (`~/.cache/palpate/meshes`), named by a SHA-256 over the
mesh as given, what was asked for, and the sources and libraries that decide about the result: another version never
reads it. Nothing depends on the cache: an entry that cannot be read is removed, one that cannot be written is left out.
"""

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable
from dataclasses import asdict, astuple
from functools import cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from time import perf_counter

import numpy as np

from ....datasets.array_file import read_arrays
from ....datasets.storage.durable import discard, temporary_name, write_temporary
from ...runtime.loading_progress import Watch, unwatched
from .repair import Mended, Repair, repair_mesh
from .report import MeshReport

SWITCH = "PALPATE_CACHE"  # environment variable: "off", or a folder to use instead
SECONDS_LEAST = 0.5  # of repairing, below which a mesh is not kept
BYTES_MOST = 2_000_000_000  # of all entries; beyond, those that were used least lately are deleted
SOURCES = (  # of palpate, that decide how a mesh is repaired
    "kernels/solids/crossing.py",
    "kernels/section/edge_pairing.py",
    "kernels/solids/nesting.py",
    "kernels/solids/orientation.py",
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
ENTRY = re.compile(r"[0-9a-f]{64}\.npz|\.[0-9a-f]{64}\.[0-9a-f]+\.tmp")  # and what a killed process left of one
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
    folder = cache_folder()
    path = None if folder is None else folder / f"{entry_key(vertices, faces, repair)}.npz"
    if path is not None:
        watch("looking for it as repaired before", 0, 1)
        kept = read_entry(path)
        if kept is not None:
            return kept
    if announce is not None:
        announce(len(faces))
    started = perf_counter()
    repaired = repair_mesh(vertices, faces, repair, watch)
    if path is not None and perf_counter() - started >= SECONDS_LEAST:
        write_entry(path, repaired)
    return repaired


def cache_folder() -> Path | None:
    """Where entries are; None if the cache is switched off or there is no place for it."""
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
def maker_digest() -> bytes:
    """SHA-256 over what decides about the result besides the mesh: palpate's sources, the versions of libraries."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((Path(__file__).parents[3] / name).read_bytes())
    digest.update(json.dumps([(name, version(name)) for name in LIBRARIES]).encode())
    return digest.digest()


def entry_key(vertices: np.ndarray, faces: np.ndarray, repair: Repair) -> str:
    """Name of the entry of a mesh, float64 and int64, and of how it is repaired."""
    digest = hashlib.sha256(maker_digest())
    digest.update(json.dumps([vertices.shape, faces.shape, astuple(repair)]).encode())
    digest.update(np.ascontiguousarray(vertices))
    digest.update(np.ascontiguousarray(faces))
    return digest.hexdigest()


def read_entry(path: Path) -> Mended | None:
    """A repaired mesh; None if there is none or it is damaged, which is then removed."""
    try:
        entry = read_arrays(path)
        vertices, faces = entry["vertices"], entry["faces"]
        solid_count, report = int(entry["solid_count"]), MeshReport(**json.loads(str(entry["report"])))
        sound = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
        if not (sound and 0 <= solid_count <= len(faces) and faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"{path} holds no mesh")
    except FileNotFoundError:
        return None
    except Exception:  # of a damaged zip file, or a damaged array in it: readers with many errors of their own
        discard(path)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # it was used
    return Mended(vertices, faces.astype(np.int64), solid_count, report)


def write_entry(path: Path, repaired: Mended) -> None:
    """Keep a repaired mesh if that can be done: not on a full disk, nor in a folder that may not be written."""
    if repaired.vertices.nbytes + repaired.faces.nbytes // 2 > BYTES_MOST:
        return
    content = BytesIO()  # first in memory: zipfile reports a full disk again when it is deleted
    np.savez(
        content,
        vertices=repaired.vertices,
        faces=repaired.faces.astype(np.int32),
        solid_count=np.array(repaired.solid_count),
        report=np.array(json.dumps(asdict(repaired.report), default=np.generic.item)),
    )
    temporary = temporary_name(path.with_name(f".{path.stem}"))
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_temporary(temporary, content.getbuffer())
        os.replace(temporary, path)
        drop_oldest(path.parent)
    except OSError:
        return
    finally:
        discard(temporary)


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
