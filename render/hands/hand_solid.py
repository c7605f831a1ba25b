"""A hand's inside as a solid, in the hand frame.

| hand | its solid |
|---|---|
| MeshHand, rigid or with vertices for each pose | the inside of its mesh, which must be closed |
| patches | none: they have no inside |

A hand made from voxels or a function is the mesh that was made of it, so that a file's hand is the same hand.
"""

from collections.abc import Iterator
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np

from ...kernels.fields.field import Field
from ...kernels.fields.mesh_inside import mesh_field
from ...kernels.section.half_edges import OPEN, HalfEdges, twins_of, upload_surface
from ..errors import MeshError, StrategyError
from .hand import Hand
from .mesh_hand import MeshHand


class HandSolid:
    """The inside of a closed hand mesh.

    vertices: [m], float32, shape [vertex, 3]; faces: int32, shape [face, 3]. Raises MeshError for a mesh that is open.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, name: str) -> None:
        open_edges = int((twins_of(faces) == OPEN).sum())
        if open_edges:
            raise MeshError(
                f'{name}: raw "overlap" needs a closed hand mesh, but it has {open_edges} open edges; '
                'raw "contact" takes any'
            )
        self.bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)
        """Lowest and highest coordinates [m], shape [2, 3]."""
        self._edges = HalfEdges(vertices, faces)
        self._fields: dict[str, Field] = {}
        self._lock = Lock()

    def field_on(self, device: str) -> Field:
        """The solid as a field on a Warp device, made once."""
        with self._lock:
            if device not in self._fields:
                self._fields[device] = mesh_field(upload_surface(self._edges, device), self.bounds)
            return self._fields[device]


_SOLIDS: WeakKeyDictionary[MeshHand, HandSolid] = WeakKeyDictionary()  # of rigid hands
_LOCK = Lock()


def hand_solids(hand: Hand, first: int, count: int) -> Iterator[tuple[HandSolid, slice]]:
    """A hand's solid, and the poses that it is for, counted from `first`: once for a rigid hand, else for each pose."""
    if not isinstance(hand, MeshHand):
        raise StrategyError('raw "overlap" needs a hand with an inside, a MeshHand; patches have none')
    if hand.pose_count is not None:
        for row in range(count):
            yield HandSolid(hand.vertices[first + row], hand.faces, hand.name), slice(row, row + 1)
        return
    with _LOCK:
        if hand not in _SOLIDS:
            _SOLIDS[hand] = HandSolid(hand.vertices[0], hand.faces, hand.name)
        solid = _SOLIDS[hand]
    yield solid, slice(0, count)
