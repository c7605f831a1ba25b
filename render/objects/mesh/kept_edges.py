"""Half-edges and box hierarchies of large meshes kept on disk, by the identity of the placed mesh (kept_arrays.py)."""

import hashlib
from functools import partial
from time import perf_counter

import numpy as np

from ....kernels.section.half_edges import LEAF, OPEN, Boxes, HalfEdges
from .kept_arrays import kept_folder, maker_digest, read_entry, write_entry

SECONDS_LEAST = 0.2  # of making them, below which they are not kept: some 200,000 triangles
SOURCES = ("kernels/section/half_edges.py",)  # of palpate, that decide what they are
LIBRARIES = ("numpy", "scipy")


def edges_of_mesh(vertices: np.ndarray, faces: np.ndarray, identity: str) -> HalfEdges:
    """Half-edges of a mesh, from disk if those of the same mesh were made before; identity: of the mesh."""
    folder, path = kept_folder(), None
    if folder is not None:
        digest = hashlib.sha256(maker_digest(SOURCES, LIBRARIES) + identity.encode())
        path = folder / f"{digest.hexdigest()}.npz"
        if (kept := read_entry(path, partial(_edges_of, vertices, faces))) is not None:
            return kept
    started = perf_counter()
    edges = HalfEdges(vertices, faces)
    if path is not None and perf_counter() - started >= SECONDS_LEAST:
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
