"""Pairing of half-edges: find the triangle that continues the surface across an edge, even if many share the edge."""

import numpy as np

OPEN = -1


def order_of(*columns: np.ndarray) -> np.ndarray:
    """`np.lexsort(columns)` for columns of integers >= 0, in a tenth of the time: the last column is the primary key.

    Each number is packed with its row's place into one 64-bit word and sorted. A column's largest number and the row
    count must fit in 64 bits together, which numbers of vertices and faces do.
    """
    count = len(columns[0])
    bits = np.uint64(max(count - 1, 1).bit_length())
    place = np.arange(count, dtype=np.uint64)
    order = np.arange(count)
    for column in columns:
        packed = column[order].astype(np.uint64) << bits
        packed |= place
        packed.sort()
        packed &= (np.uint64(1) << bits) - np.uint64(1)
        order = order[packed.astype(np.int64)]
    return order


def group_starts(*columns: np.ndarray) -> np.ndarray:
    """Indices of rows that differ from the row before, and of the first row."""
    differs = np.ones(len(columns[0]), bool)
    if len(differs):
        differs[1:] = np.logical_or.reduce([column[1:] != column[:-1] for column in columns])
    return np.flatnonzero(differs)


def twins_of(faces: np.ndarray, vertices: np.ndarray | None = None, tolerance: float = 0.0) -> np.ndarray:
    """The opposite half-edge of each half-edge, int32, shape [3 face]; OPEN if there is none.

    Half-edge h = 3 face + corner runs from that corner to the face's next; it is paired with one in the opposite
    direction. If more than two triangles share an edge, two neighbours by angle around the edge are paired if the solid
    lies between them. So bodies that touch along an edge are separated, and two coincident walls pair with each other.
    Triangles of one patch (connected through edges of two triangles) are paired with each other first, if the patch is
    balanced at the edge. So bodies that cross at a common edge stay separate.

    faces: int, shape [face, 3], each with three different vertices.
    vertices: [m], shape [vertex, 3]; None: the k-th half-edge in one direction is paired with the k-th in the other.
    tolerance: triangles whose farthest corners differ by at most this count as coincident [m].
    """
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = order_of(high, low)
    start = group_starts(low[order], high[order])
    size = np.diff(start, append=len(order))
    twin = np.full(len(tail), OPEN, np.int32)
    two = start[size == 2]
    _pair(twin, order[two], order[two + 1], tail)
    many = np.repeat(size > 2, size)
    if many.any():
        half = order[many]
        group = np.repeat(np.arange(len(size)), size)[many]
        downward = tail[half] > head[half]
        turn = np.zeros(len(half))
        if vertices is not None:
            from scipy.sparse import coo_matrix  # takes 0.1 s to import and is needed only for edges of many triangles
            from scipy.sparse.csgraph import connected_components

            turn = _turns(faces, vertices, half, group, downward, tolerance)
            # A patch is a set of faces connected through edges of exactly two triangles. One that is balanced at an
            # edge (equally many half-edges each way) becomes a group of its own there.
            graph = coo_matrix(
                (np.ones(len(two), bool), (order[two] // 3, order[two + 1] // 3)), shape=(len(faces),) * 2
            )
            patch = connected_components(graph, directed=False)[1]
            numbers = int(patch.max()) + 2
            key = group * numbers + patch[half // 3] + 1
            _, own = np.unique(key, return_inverse=True)
            balanced = np.bincount(own, np.where(downward, 1, -1))[own] == 0
            group = np.where(balanced, key, group * numbers)
            by_patch = np.lexsort((half, patch[half // 3]))
            half, group, turn, downward = half[by_patch], group[by_patch], turn[by_patch], downward[by_patch]
        _pair(twin, *_match_brackets(half, group, turn, downward, by_rank=vertices is None), tail)
    return twin


def faces_around_edges(
    faces: np.ndarray, vertices: np.ndarray, tolerance: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half-edges sorted by edge, and around each edge by the angle of their triangles.

    Arguments as for `twins_of`. Returns the half-edges (int64), the number of each one's edge (ascending), and whether
    it runs to the higher vertex: then the front of its triangle faces the next triangle in the order.
    """
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.minimum(tail, head) * (int(faces.max(initial=0)) + 1) + np.maximum(tail, head)
    half = np.argsort(edge, kind="stable")
    group = edge[half]
    downward = tail[half] > head[half]
    turn = _turns(faces, vertices, half, group, downward, tolerance)
    order = np.lexsort((~downward, turn, group))
    return half[order], group[order], ~downward[order]


def _pair(twin: np.ndarray, one: np.ndarray, two: np.ndarray, tail: np.ndarray) -> None:
    """Store each pair (one, two) in `twin` if the two half-edges run in opposite directions."""
    opposite = tail[one] != tail[two]
    one, two = one[opposite], two[opposite]
    twin[one] = two
    twin[two] = one


def _turns(
    faces: np.ndarray, vertices: np.ndarray, half: np.ndarray, group: np.ndarray, downward: np.ndarray, tolerance: float
) -> np.ndarray:
    """Rank of each half-edge's triangle by angle around its edge, from one of its triangles; equal if coincident.

    group: ascending number of the edge of each half-edge; downward: whether it runs to the lower vertex.
    """
    x = np.asarray(vertices, np.float64)
    face, corner = half // 3, half % 3
    a, b = faces[face, corner], faces[face, (corner + 1) % 3]
    low = x[np.where(downward, b, a)]
    axis = x[np.where(downward, a, b)] - low
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), np.finfo(float).tiny)
    out = x[faces[face, (corner + 2) % 3]] - low
    out -= np.einsum("ij,ij->i", out, axis)[:, None] * axis
    first = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    zero = out[np.repeat(first, np.diff(first, append=len(group)))]
    angle = np.arctan2(np.einsum("ij,ij->i", axis, np.cross(zero, out)), np.einsum("ij,ij->i", zero, out))
    reach = np.linalg.norm(out, axis=1)
    angle[(angle < 0) & (-angle * reach <= tolerance)] = 0.0  # coincides with the first triangle
    angle = np.where(angle < 0, angle + 2 * np.pi, angle)
    order = np.lexsort((angle, group))
    gap = np.diff(angle[order]) * np.maximum(reach[order[1:]], reach[order[:-1]])
    apart = np.concatenate([[True], (gap > tolerance) | (group[order[1:]] != group[order[:-1]])])
    turn = np.empty(len(half))
    turn[order] = np.cumsum(apart)
    return turn


def _match_brackets(
    half: np.ndarray, group: np.ndarray, turn: np.ndarray, downward: np.ndarray, *, by_rank: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of half-edges of edges with more than two triangles, matched like brackets within each group, an edge's.

    Seen from the edge's lower vertex, by growing angle, the solid begins at the triangle of a downward half-edge (it
    opens) and ends at that of an upward one (it closes). Of coincident triangles the opening ones come first, in the
    given order, then the closing ones in reverse order, so that two coincident walls belong to the same bodies at all
    their edges. If there are more of one kind, the surplus stays unpaired.
    """
    if by_rank:
        order = np.lexsort((half, ~downward, group))
        place = np.arange(len(order))
        opens = downward[order]
        key = group[order] * 2 + ~opens
        run = place - np.maximum.accumulate(np.where(np.concatenate([[True], key[1:] != key[:-1]]), place, 0))
        return _neighbours(half[order], group[order], run, place, opens)
    place = np.arange(len(half))
    order = np.lexsort((np.where(downward, place, -place), ~downward, turn, group))
    half, group, opens = half[order], group[order], downward[order]
    start = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    size = np.diff(start, append=len(group))
    step = np.where(opens, 1, -1)
    excess = np.repeat(np.add.reduceat(step, start), size)
    first, count = np.repeat(start, size), np.repeat(size, size)
    place = np.arange(len(group)) - first
    flipped = excess < 0  # reverse the order so that opening half-edges are never fewer than closing ones
    place = np.where(flipped, count - 1 - place, place)
    order = np.lexsort((place, group))
    half, group, opens = half[order], group[order], (opens ^ flipped)[order]
    step = np.where(opens, 1, -1)
    depth = np.cumsum(step) - step  # before each bracket
    depth -= np.repeat(depth[start], size)
    lowest = np.repeat(np.minimum.reduceat(depth, start), size)
    at = np.arange(len(group)) - first
    begin = np.repeat(np.minimum.reduceat(np.where(depth == lowest, at, len(group)), start), size)
    wrapped = at < begin
    depth = depth - lowest + np.where(wrapped, np.abs(excess), 0)
    level = np.where(opens, depth, depth - 1)
    return _neighbours(half, group, level, np.where(wrapped, at + count, at), opens)


def _neighbours(
    half: np.ndarray, group: np.ndarray, level: np.ndarray, place: np.ndarray, opens: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of consecutive half-edges of the same group and level: an opening one and the closing one after it."""
    order = np.lexsort((place, level, group))
    one, two = order[:-1], order[1:]
    good = (group[one] == group[two]) & (level[one] == level[two]) & opens[one] & ~opens[two]
    return half[one[good]], half[two[good]]
