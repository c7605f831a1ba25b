"""Route: in which order, from where and which way round the polylines of a pose are drawn, so that jumps are short."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

# A pose lasts 11 ms, and laying its track must leave time to play it: none takes 5 ms of a core.
SEARCHED_MOST = 32  # pieces; the route through more is not searched for: that grows with their square and beyond
PIECES_MOST = 128  # more are drawn in the batch's order
DOORS = 64  # starts looked at, over all polylines: 32 on each of two loops, 2 on each of 32, else the given one

# All orders of a cycle of so many; the other way round, every piece turned, one is as long.
CYCLES = {2: [[0, 1]], 3: [[0, 1, 2]], 4: [[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 1, 3]]}


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """One polyline."""

    points: np.ndarray
    """[m], shape [point, 3]; a closed one repeats its first at its end."""
    closed: bool
    intensity: np.ndarray | None
    """Shape [point]; None means 1."""
    dwell: np.ndarray | None = None
    """Pause at each vertex [s], that at the start of a closed one only at its end, shape [point]; None means none."""


@dataclass(frozen=True, eq=False, slots=True)
class Doors:
    """Ways to draw each piece: where one comes in and goes out. All pieces' doors stand one after the other."""

    piece: np.ndarray
    """Whose it is, shape [door]."""
    flipped: np.ndarray
    """The door of the same piece drawn the other way round, shape [door]."""
    jump: np.ndarray
    """From the way out of one door to the way in of another [m], shape [door, door]."""
    of: list[np.ndarray]
    """Doors of each piece."""


def jump_total(pieces: list[Piece], *, back: bool = False, cyclic: bool = True) -> float:
    """Length of the jumps from each piece to the next, and from the last to the first [m].

    back: open pieces end where they start. cyclic: False leaves out the jump from the last piece to the first.
    """
    ends = [(p.points[0], p.points[0] if back or p.closed else p.points[-1]) for p in pieces]
    pairs = list(itertools.pairwise([*ends, ends[0]] if cyclic else ends))
    return float(sum(np.linalg.norm(b[0] - a[1]) for a, b in pairs))


def shortest_route(pieces: list[Piece], *, back: bool = False, cyclic: bool = True) -> list[Piece]:
    """The pieces in an order that makes `jump_total` small: loops start anywhere, open pieces run either way.

    Exact for up to four pieces, three where it is no cycle, but for the choice of starts on loops: 32 on each of two,
    16 on each of four. Up to SEARCHED_MOST: nearest neighbour and the given order, each mended by 2-opt, then the best
    doors for that order. Beyond: nearest neighbour, loops from where they are given. Never longer than the given route;
    more than PIECES_MOST pieces stay as they are.
    """
    if not 1 < len(pieces) <= PIECES_MOST:
        return pieces
    searched = len(pieces) <= SEARCHED_MOST
    share = max(1, DOORS // len(pieces))
    doors = _doors_of(pieces, share, back=back, outside=not cyclic)
    place_count = len(doors.of)
    if place_count <= 4:
        chosen = min((_best_doors(order, doors) for order in CYCLES[place_count]), key=lambda found: found[0])[1]
    else:
        given, nearest = np.array([of[0] for of in doors.of]), _nearest_first(doors)
        if searched:
            routes = [_improved(nearest, doors), _improved(given, doors)]
        else:
            routes = [_best_of_order(nearest, doors), (float(doors.jump[given, np.roll(given, -1)].sum()), given)]
        chosen = min(routes, key=lambda found: found[0])[1]
    if not cyclic:  # the outside comes last
        chosen = np.roll(chosen, -1 - int(np.argmax(doors.piece[chosen])))
    picked = [(int(doors.piece[door]), int(door)) for door in chosen]
    return [_entered(pieces[i], door - int(doors.of[i][0]), share) for i, door in picked if i < len(pieces)]


def _doors_of(pieces: list[Piece], share: int, *, back: bool, outside: bool) -> Doors:
    """All doors; `outside` adds a place at no distance from any, where a route that is no cycle begins and ends."""
    entries, exits, of, flipped = [], [], [], []
    count = 0
    for piece in pieces:
        if piece.closed:
            here = _starts_of(piece.points, share)
            there, other = here, np.arange(share)
        else:
            here = piece.points[[0, -1]]
            there, other = (here if back else here[::-1]), np.array([1, 0])
        entries.append(here)
        exits.append(there)
        of.append(count + np.arange(len(here)))
        flipped.append(count + other)
        count += len(here)
    out, into = np.concatenate(exits), np.concatenate(entries)
    jump = np.zeros((count, count))
    for axis in range(3):  # four times as fast as one array with an axis of three
        apart = out[:, axis, None] - into[None, :, axis]
        apart *= apart
        jump += apart
    np.sqrt(jump, out=jump)
    if outside:
        jump = np.pad(jump, (0, 1))
        of.append(np.array([count]))
        flipped.append(np.array([count]))
    piece_of = np.repeat(np.arange(len(of)), [len(doors) for doors in of])
    return Doors(piece_of, np.concatenate(flipped), jump, of)


def _improved(chosen: np.ndarray, doors: Doors) -> tuple[float, np.ndarray]:
    """A route after 2-opt and the best doors, twice, and its length [m]."""
    length = np.inf
    for _ in range(2):
        better = _uncrossed(chosen, doors)
        if better is chosen and length < np.inf:  # a second look at the same
            break
        length, chosen = _best_of_order(better, doors)
    return length, chosen


def _best_of_order(chosen: np.ndarray, doors: Doors) -> tuple[float, np.ndarray]:
    """A route through the best doors in its order, and its length [m]."""
    return _best_doors(doors.piece[chosen].tolist(), doors)


def _nearest_first(doors: Doors) -> np.ndarray:
    """One door of each piece: from the shortest jump on, always to the nearest piece that is left."""
    other = doors.piece[:, None] != doors.piece[None]
    start = int(np.argmin(np.where(other, doors.jump, np.inf))) // len(doors.piece)
    chosen, free = [start], doors.piece != doors.piece[start]
    while free.any():
        door = int(np.argmin(np.where(free, doors.jump[chosen[-1]], np.inf)))
        chosen.append(door)
        free &= doors.piece != doors.piece[door]
    return np.array(chosen)


def _uncrossed(chosen: np.ndarray, doors: Doors) -> np.ndarray:
    """2-opt: turn stretches of the route round, the pieces in them too, while that shortens it."""
    count = len(chosen)
    for _ in range(4 * count):
        after, turned = np.roll(chosen, -1), doors.flipped[chosen]
        now = doors.jump[chosen, after]
        # A stretch i..j, 1 <= i <= j: its way in comes from i - 1, its way out goes to j + 1.
        gain = now[:-1, None] + now[None, 1:]
        gain -= doors.jump[chosen[:-1, None], turned[None, 1:]] + doors.jump[turned[1:, None], after[None, 1:]]
        gain = np.triu(gain)
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[i, j] <= 1e-9:
            break
        chosen = np.concatenate([chosen[: i + 1], turned[i + 1 : j + 2][::-1], chosen[j + 2 :]])
    return chosen


def _best_doors(order: list[int], doors: Doors) -> tuple[float, np.ndarray]:
    """The doors that make a cycle of pieces in this order shortest, and its length [m]: dynamic programming."""
    of = [doors.of[piece] for piece in order]
    total = _jumps(doors, of[0], of[1])  # shortest from each first door to each door here
    back = []
    for a, b in itertools.pairwise(of[1:]):
        through = total[:, None, :] + _jumps(doors, a, b).T[None]
        back.append(through.argmin(axis=2))
        total = through.min(axis=2)
    total = total + _jumps(doors, of[-1], of[0]).T
    first, door = (int(i) for i in np.unravel_index(int(total.argmin()), total.shape))
    chosen = [int(of[-1][door])]
    for k in range(len(back) - 1, -1, -1):
        door = int(back[k][first, door])
        chosen.append(int(of[k + 1][door]))
    return float(total.min()), np.array([int(of[0][first]), *chosen[::-1]])


def _jumps(doors: Doors, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Jumps from doors of one piece to those of another, which stand side by side."""
    return doors.jump[a[0] : a[-1] + 1, b[0] : b[-1] + 1]


def _entered(piece: Piece, door: int, share: int) -> Piece:
    """The piece drawn from one of its doors on."""
    if door == 0:
        return piece
    if not piece.closed:
        back, rest = (None if values is None else values[::-1] for values in (piece.intensity, piece.dwell))
        return replace(piece, points=piece.points[::-1], intensity=back, dwell=rest)
    arc = _arc_of(piece.points)
    start = arc[-1] * door / share
    before = int(np.searchsorted(arc, start - 1e-9))  # vertices before the start; the first is also the last
    after = int(np.searchsorted(arc, start + 1e-9))

    def turned(values: np.ndarray, at: np.ndarray) -> np.ndarray:
        return np.concatenate([at, values[after:], values[1:before], at])

    intensity = piece.intensity
    if intensity is not None:
        intensity = turned(intensity, np.interp([start], arc, intensity))
    dwell = piece.dwell
    if dwell is not None:
        dwell = turned(dwell, np.zeros(1))
        dwell[-1] = piece.dwell[before:after].sum() if piece.dwell is not None else 0.0
    points = turned(piece.points, _between(piece.points, arc, np.array([start])))
    return replace(piece, points=points, intensity=intensity, dwell=dwell)


def _starts_of(points: np.ndarray, share: int) -> np.ndarray:
    """Points on a loop from its first on, equally far along it, shape [share, 3]."""
    if share == 1:
        return points[:1]
    arc = _arc_of(points)
    return _between(points, arc, arc[-1] * np.arange(share) / share)


def _arc_of(points: np.ndarray) -> np.ndarray:
    step = np.diff(points, axis=0)
    return np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("ij,ij->i", step, step)))])


def _between(points: np.ndarray, arc: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(at, arc, points[:, axis]) for axis in range(3)], axis=1)
