"""A triangle surface as half-edges: what a contour is walked along, and where a search for contours must look."""

from functools import cached_property, reduce

import numpy as np
import warp as wp

from .edge_pairing import OPEN, twins_of

ROUNDING = 2.0**-22  # of a surface's size: two steps of float32; triangles this near to each other lie in one place
FACES_MOST = 2**28  # numbers of half-edges and flags share 31 bits
LEAF = 4  # triangles of a leaf of the hierarchy
MASK_WORDS = 128  # of 32 bits: the scanned edges that a search along the trail can tell apart
TRAIL_LARGEST = 8000  # [triangle]; beyond, no trail is made


@wp.struct
class Surface:
    """Half-edges on a device. Half-edge h = 3 face + corner runs from that corner to the face's next."""

    corner: wp.array[wp.vec4]  # where a half-edge starts [m], and the bits of its link (`HalfEdges.link`), shape [half]
    rank: wp.array[wp.int32]  # place of a scanned edge among all of them, the same for both its sides, shape [half]
    is_open: wp.int32  # whether some edge has a triangle on one side only
    reach: wp.float32  # largest |x| + |y| + |z| of a vertex [m]; bounds the rounding of float32 heights
    trail: wp.array[wp.vec4]  # vertices [m] along the scanned edges, shape [step + 1]
    trail_half: wp.array[wp.vec2i]  # half-edge of the step that ends here: along it, and back; OPEN for none or a jump
    node_centre: wp.array[wp.vec4]  # of the boxes of the hierarchy, a heap whose root is 1 [m]
    node_half: wp.array[wp.vec4]  # half extents [m], -1 for an empty one
    leaf_first: wp.int32  # heap number of the first leaf


def spatial_order(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces along a Morton curve through their middles: neighbours in space become neighbours in memory."""
    x = vertices.astype(np.float64)
    middle = (x[faces[:, 0]] + x[faces[:, 1]] + x[faces[:, 2]]) / 3
    low, size = middle.min(axis=0), np.ptp(middle, axis=0).max()
    cell = np.minimum((middle - low) / (size or 1.0) * 2**20, 2**20 - 1).astype(np.uint64)
    code = np.zeros(len(faces), np.uint64)
    for axis in range(3):
        code |= spread_bits(cell[:, axis]) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def spread_bits(x: np.ndarray) -> np.ndarray:
    """The 21 low bits of each number, two zeros between one and the next."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


class HalfEdges:
    """Half-edges of a triangle mesh on the host, its faces in spatial order.

    vertices: [m], float32, shape [vertex, 3], array frame; faces: int, shape [face, 3], no corner twice.
    Raises ValueError beyond FACES_MOST triangles.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self.vertices = np.ascontiguousarray(vertices, np.float32).reshape(-1, 3)
        faces = np.asarray(faces, np.int64).reshape(-1, 3)
        if len(faces) > FACES_MOST:
            raise ValueError(f"a surface may have {FACES_MOST} triangles, not {len(faces)}")
        self.faces = faces[spatial_order(self.vertices, faces)]
        """int64, shape [face, 3]; half-edges are numbered along it."""
        self.twin = twins_of(self.faces, self.vertices, ROUNDING * np.ptp(self.vertices, axis=0).max(initial=0.0))
        """int32, shape [half]; OPEN where an edge has one side only."""

    @property
    def open_count(self) -> int:
        """Edges with a triangle on one side only."""
        return int(np.count_nonzero(self.twin == OPEN))

    @cached_property
    def ends(self) -> np.ndarray:
        """Start and end vertex of each half-edge, shape [half, 2]."""
        return np.stack([self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()], axis=1)

    @cached_property
    def scanned(self) -> np.ndarray:
        """Whether a search must look at a half-edge's edge, bool, shape [half].

        Every edge with one side only, and every edge that a forest over the faces (joined through edges) leaves out:
        a contour is a simple path from face to face, and one that closes cannot keep to a forest. A third of all edges
        are enough, of a closed surface V - 1 + 2 genus.
        """
        joined = forest_off_paths(self) if len(self.faces) <= TRAIL_LARGEST else forest_by_order(self.twin)
        scanned = np.ones(len(self.twin), bool)
        scanned[joined] = False
        scanned[self.twin[joined]] = False
        return scanned

    @cached_property
    def has_trail(self) -> bool:
        """Whether there are few enough scanned edges to search along them."""
        inner = np.count_nonzero(self.scanned & (self.twin != OPEN)) // 2
        return len(self.faces) <= TRAIL_LARGEST and inner + self.open_count <= 32 * MASK_WORDS

    @cached_property
    def link(self) -> np.ndarray:
        """Twice the twin, plus 1 if the edge is scanned; OPEN for no twin; int32, shape [half]."""
        return np.where(self.twin == OPEN, OPEN, 2 * self.twin + self.scanned).astype(np.int32)

    @cached_property
    def trail(self) -> tuple[np.ndarray, np.ndarray]:
        """The scanned edges as one trail: vertices, shape [step + 1], and each step's half-edge, OPEN for a jump."""
        return trail_through(self)

    @cached_property
    def rank(self) -> np.ndarray:
        """Order of the scanned edges, the same on both sides, int32, shape [half]: along the trail if there is one."""
        rank = np.arange(len(self.twin), dtype=np.int32)
        if not self.has_trail:
            return np.where(self.twin == OPEN, rank, np.minimum(self.twin, rank))
        half = self.trail[1]
        half = half[half != OPEN]
        rank[half] = np.arange(len(half))
        inner = half[self.twin[half] != OPEN]
        rank[self.twin[inner]] = rank[inner]
        return rank


def forest_by_order(twin: np.ndarray) -> np.ndarray:
    """Half-edges of a forest over the faces, one an edge: each face joined to its lowest neighbour if that is lower."""
    neighbour = np.where(twin == OPEN, np.iinfo(np.int32).max, twin // 3).reshape(-1, 3)
    lowest = neighbour.argmin(axis=1)
    face = np.arange(len(neighbour))
    lower = neighbour[face, lowest] < face
    return (3 * face + lowest)[lower]


def forest_off_paths(surface: HalfEdges) -> np.ndarray:
    """Half-edges of a spanning forest over the faces, one an edge, that leaves long paths of edges to be scanned."""
    twin = surface.twin
    edge = np.flatnonzero((twin != OPEN) & (np.arange(len(twin)) < twin))
    on_path = deep_tree(surface.ends[:, 0], surface.ends[:, 1])
    edge = edge[np.argsort(on_path[edge] | on_path[twin[edge]], kind="stable")]
    root = list(range(len(surface.faces)))

    def find(face: int) -> int:
        while root[face] != face:
            root[face] = root[root[face]]
            face = root[face]
        return face

    joined = []
    for half, one, two in zip(edge.tolist(), (edge // 3).tolist(), (twin[edge] // 3).tolist(), strict=True):
        a, b = find(one), find(two)
        if a != b:
            root[a] = b
            joined.append(half)
    return np.array(joined, np.int64)


def deep_tree(tail: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Half-edges along which a depth-first search reaches new vertices, bool, shape [half]."""
    leaving: dict[int, list[tuple[int, int]]] = {}
    for half, (a, b) in enumerate(zip(tail.tolist(), head.tolist(), strict=True)):
        leaving.setdefault(a, []).append((b, half))
    used = np.zeros(len(tail), bool)
    seen: set[int] = set()
    for start in leaving:
        stack = [(start, OPEN)]
        while stack:
            vertex, half = stack.pop()
            if vertex in seen:
                continue
            seen.add(vertex)
            if half != OPEN:
                used[half] = True
            stack += [step for step in leaving[vertex] if step[0] not in seen] if vertex in leaving else []
    return used


def trail_through(surface: HalfEdges) -> tuple[np.ndarray, np.ndarray]:
    """A trail over every scanned edge once, with jumps: vertices [step + 1], half-edges [step] (OPEN: jump)."""
    own = surface.scanned & ((surface.twin == OPEN) | (np.arange(len(surface.twin)) < surface.twin))
    at: dict[int, list[tuple[int, int]]] = {}
    for half in np.flatnonzero(own).tolist():
        a, b = surface.ends[half].tolist()
        at.setdefault(a, []).append((half, b))
        at.setdefault(b, []).append((half, a))
    vertices: list[int] = []
    halves: list[int] = []
    used: set[int] = set()
    for start in sorted(at, key=lambda vertex: (len(at[vertex]) % 2 == 0, vertex)):  # odd ends first: fewer jumps
        while at[start]:
            half, vertex = at[start].pop()
            if half in used:
                continue
            halves += ([OPEN] if vertices else []) + [half]
            vertices += [start, vertex]
            used.add(half)
            while at[vertex]:
                half, following = at[vertex].pop()
                if half not in used:
                    used.add(half)
                    halves.append(half)
                    vertices.append(following)
                    vertex = following
    return np.array(vertices, np.int64), np.array(halves, np.int64)


def row_groups(function: np.ufunc, rows: np.ndarray, size: int) -> np.ndarray:
    """A function of two over every `size` rows, which is ten times as fast as its reduction over a short axis."""
    return reduce(function, (rows[k::size] for k in range(size)))


def boxes_of(surface: HalfEdges) -> tuple[np.ndarray, np.ndarray, int]:
    """Centres and half extents [m] of a heap of boxes over the faces, float32, shape [node, 3], and its first leaf.

    Faces are in spatial order already, so a leaf is LEAF of them in a row and a node its two children.
    """
    face_count, corners = len(surface.faces), [surface.vertices[surface.faces[:, k]] for k in range(3)]
    leaf_count = 1 << max(0, (-(-face_count // LEAF) - 1)).bit_length()
    low = np.full((leaf_count * LEAF, 3), np.inf, np.float32)
    high = -low
    low[:face_count], high[:face_count] = reduce(np.minimum, corners), reduce(np.maximum, corners)
    lows, highs = np.full((2 * leaf_count, 3), np.inf, np.float32), np.full((2 * leaf_count, 3), -np.inf, np.float32)
    low, high = row_groups(np.minimum, low, LEAF), row_groups(np.maximum, high, LEAF)
    first = leaf_count
    while first:
        lows[first : 2 * first], highs[first : 2 * first] = low, high
        if first > 1:
            low, high = row_groups(np.minimum, low, 2), row_groups(np.maximum, high, 2)
        first //= 2
    empty = lows[:, 0] > highs[:, 0]
    lows[empty] = highs[empty] = 0.0
    centre = (0.5 * (lows.astype(np.float64) + highs)).astype(np.float32)
    half = np.maximum(highs - centre, centre - lows) * np.float32(1 + 1e-6)
    half[empty] = -1.0
    return centre, half, leaf_count


def upload_surface(surface: HalfEdges, device: str) -> Surface:
    """Put a surface on a device."""
    out = Surface()
    start = np.empty((len(surface.twin), 4), np.float32)
    start[:, :3] = surface.vertices[surface.faces.ravel()]
    start[:, 3] = surface.link.view(np.float32)
    out.corner = wp.array(start, dtype=wp.vec4, device=device)
    out.rank = wp.array(surface.rank, dtype=wp.int32, device=device)
    out.is_open = int(surface.open_count > 0)
    out.reach = float(np.abs(surface.vertices).sum(axis=1).max())
    vertices, halves = surface.trail if surface.has_trail else (np.zeros(0, int), np.zeros(0, int))
    out.trail = wp.array(padded(surface.vertices[vertices]), dtype=wp.vec4, device=device)
    out.trail_half = wp.array(sides_of(surface, vertices, halves), dtype=wp.vec2i, device=device)
    centre, half, leaf_first = boxes_of(surface)
    out.node_centre = wp.array(padded(centre), dtype=wp.vec4, device=device)
    out.node_half = wp.array(padded(half), dtype=wp.vec4, device=device)
    out.leaf_first = leaf_first
    return out


def padded(x: np.ndarray) -> np.ndarray:
    """Vectors with a fourth component of 0: 16 bytes, which a GPU loads at once."""
    return np.hstack([x, np.zeros((len(x), 1), np.float32)]).astype(np.float32)


def sides_of(surface: HalfEdges, vertices: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """Half-edge along each step of the trail and back, for the vertex where the step ends, shape [step + 1, 2]."""
    out = np.full((len(vertices), 2), OPEN, np.int32)
    step = np.flatnonzero(halves != OPEN)
    half = halves[step]
    along = surface.ends[half, 0] == vertices[step]
    out[step + 1, 0] = np.where(along, half, surface.twin[half])
    out[step + 1, 1] = np.where(along, surface.twin[half], half)
    return out
