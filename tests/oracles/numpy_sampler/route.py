"""Route: in which order, from where and which way round the polylines of a pose are drawn, so that jumps are short."""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .contour_matching import marks_of, matches_of

# A pose lasts 11 ms, and laying its cycle must leave time to play it: none takes 5 ms of a core.
SEARCHED_MOST = 32  # pieces; the route through more is not searched for: that grows with their square and beyond
PIECES_MOST = 128  # more are drawn in the batch's order
STARTS = 64  # starts looked at, over all polylines: 32 on each of two loops, 2 on each of 32, else the given one

INSERTED_MOST = 16  # new pieces in the order of the pose before; an insertion among 128 takes 0.15 ms
STARTS_TRIED = 16  # on a loop that is new in the order of the pose before
JUMP_SLACK = 5e-3  # [m] by which jumps may be longer in the order of the pose before: what is no longer is no jump

# All orders of a cycle of so many; the other way round, every piece turned, one is as long.
CYCLES = {2: [[0, 1]], 3: [[0, 1, 2]], 4: [[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 1, 3]]}


@dataclass(frozen=True, eq=False, slots=True)
class RoutePiece:
    """One polyline."""

    points: np.ndarray
    """[m], shape [point, 3]; a closed one repeats its first at its end."""
    closed: bool
    intensity: np.ndarray | None
    """Shape [point]; None means 1."""
    dwell: np.ndarray | None = None
    """Pause at each vertex [s], that at the start of a closed one only at its end, shape [point]; None means none."""


class Route:
    """The polylines of a pose as they are drawn, and which of them the pose before had too.

    pieces: in the order in which they are drawn, turned and started as they are drawn. before: the route of the pose
    before, None for the first pose.
    """

    def __init__(self, pieces: list[RoutePiece], before: "Route | None") -> None:
        self.pieces = pieces
        self.least = np.inf
        """Jumps of the shortest route when it was looked for last, or of this one if they were shorter since [m]."""
        if before is None or len(before.pieces) == 1:  # that one was drawn until now: no order to keep, and no absence
            self.earlier = np.full(len(pieces), -1)
        else:
            self.earlier = matches_of(self.mark, before.mark)
        """Number of the same polyline in the route of the pose before, -1 where it had none or just one; [piece]."""

    @cached_property
    def mark(self) -> np.ndarray:
        """Mark by which each polyline is recognised at the next pose, shape [piece, 4]; see `marks_of`."""
        return marks_of([piece.points for piece in self.pieces])

    def redrawn(self, order: np.ndarray, pieces: list[RoutePiece], least: float) -> "Route":
        """The same polylines in another order, turned and started as these pieces are."""
        other = Route(pieces, None)
        other.earlier, other.least = self.earlier[order], least
        if "mark" in vars(self):  # known already, and the same from wherever a loop starts
            other.mark = self.mark[order]
        return other


@dataclass(frozen=True, eq=False, slots=True)
class Starts:
    """Candidate starts of each piece. All pieces' starts stand one after the other."""

    piece: np.ndarray
    """Whose it is, shape [start]."""
    flipped: np.ndarray
    """The start of the same piece drawn the other way round, shape [start]."""
    jump: np.ndarray
    """Jump from the end of a piece drawn from one start to another start [m], shape [start, start]."""
    of: list[np.ndarray]
    """Starts of each piece."""


def jump_total(pieces: list[RoutePiece], *, back: bool = False, cyclic: bool = True) -> float:
    """Length of the jumps from each piece to the next, and from the last to the first [m].

    back: open pieces end where they start. cyclic: False leaves out the jump from the last piece to the first.
    """
    start = np.array([p.points[0] for p in pieces])
    end = start if back else np.array([p.points[0] if p.closed else p.points[-1] for p in pieces])
    jump = np.roll(start, -1, axis=0) - end
    return float(np.linalg.norm(jump if cyclic else jump[:-1], axis=1).sum())


def steady_route(
    pieces: list[RoutePiece], before: Route | None, *, margin: float, back: bool = False, cyclic: bool = True
) -> Route:
    """The route of the pose before, for these pieces, unless another is shorter by a margin; first, the shortest.

    Noise of a micrometre decides between routes that are about as long. If it did so at every pose, a polyline that is
    due next would become the last one, again and again. margin: by which share of its length, beyond JUMP_SLACK, the
    route may be longer than the shortest one. Looking for that takes most of the time, so it is done only where the
    jumps have become longer, by the margin, than the shortest since it was done last. A polyline that is new takes no
    part in that until the next pose: else those that come and go would change the order of those that stay.
    """
    given = Route(pieces, before)
    if not 1 < len(pieces) <= PIECES_MOST:
        return given
    if before is None or np.count_nonzero(given.earlier >= 0) < 2:  # there is no order to keep
        return given.redrawn(*_found(pieces, back=back, cyclic=cyclic))
    order, drawn = _known_pieces(given, before)
    length = jump_total(drawn, back=back, cyclic=cyclic)
    least = min(before.least, length)
    if length > (1.0 + margin) * least + JUMP_SLACK:
        known = [pieces[k] for k in order]
        other, shortest, least = _found(known, back=back, cyclic=cyclic)
        if length > (1.0 + margin) * least + JUMP_SLACK:
            order, drawn = order[other], shortest
    return given.redrawn(*_with_new(order, drawn, given, back=back, cyclic=cyclic), least)


def _known_pieces(given: Route, before: Route) -> tuple[np.ndarray, list[RoutePiece]]:
    """Order at the pose before of the pieces that it had, and these as they were drawn then."""
    order = np.argsort(given.earlier, kind="stable")
    known = order[given.earlier[order] >= 0]
    return known, _drawn_like([given.pieces[k] for k in known], [before.pieces[k] for k in given.earlier[known]])


def _with_new(
    known: np.ndarray, drawn: list[RoutePiece], given: Route, *, back: bool, cyclic: bool
) -> tuple[np.ndarray, list[RoutePiece]]:
    """A route of the pieces that are known, with the new ones where they cost least: all in order, and as drawn.

    More than INSERTED_MOST new ones come last, by a route of their own: to insert them one by one takes too long.
    """
    order, pieces = known.tolist(), list(drawn)
    new = np.flatnonzero(given.earlier < 0)
    if len(new) > INSERTED_MOST:
        other, added, _ = _found([given.pieces[k] for k in new], back=back, cyclic=False)
        return np.append(known, new[other]), pieces + added
    for k in new.tolist():
        place, piece = _insertion(pieces, given.pieces[k], back=back, cyclic=cyclic)
        pieces.insert(place, piece)
        order.insert(place, k)
    return np.array(order), pieces


def _drawn_like(pieces: list[RoutePiece], before: list[RoutePiece]) -> list[RoutePiece]:
    """Pieces the same way round as at the pose before; loops from the point nearest to where they started then."""
    points = np.concatenate([piece.points for piece in pieces])
    count = np.array([len(piece.points) for piece in pieces])
    first = np.cumsum(count) - count
    start = np.repeat(np.array([piece.points[0] for piece in before]), count, axis=0)[:-1]
    step = np.diff(points, axis=0)
    square = np.einsum("ij,ij->i", step, step)
    part = np.einsum("ij,ij->i", start - points[:-1], step) / np.maximum(square, 1e-30)
    part = np.minimum(np.maximum(part, 0.0), 1.0)
    off = points[:-1] + part[:, None] * step - start
    apart = np.einsum("ij,ij->i", off, off)
    out = []
    for piece, then, a, n in zip(pieces, before, first.tolist(), count.tolist(), strict=True):
        if piece.closed:
            segment = int(apart[a : a + n - 1].argmin())
            out.append(_begun(piece, segment, float(part[a + segment])))
        else:
            ends, ends_then = piece.points[[0, -1]], then.points[[0, -1]]
            same, turned = (np.linalg.norm(e - ends_then, axis=1).sum() for e in (ends, ends[::-1]))
            out.append(_reversed(piece) if turned < same else piece)
    return out


def _begun(piece: RoutePiece, segment: int, part: float) -> RoutePiece:
    """A loop drawn from a point on: on the segment from a vertex to the next, part 0..1."""
    segment, part = (segment + 1, 0.0) if part >= 1.0 else (segment, part)
    if part == 0.0 and segment in (0, len(piece.points) - 1):
        return piece
    ahead = segment + 1 if part > 0 else segment  # the next vertex, or the one that it starts at

    def begun(values: np.ndarray) -> np.ndarray:
        if part == 0.0:
            return np.concatenate([values[segment:], values[1 : segment + 1]])
        start = values[segment : segment + 1] + part * (values[ahead : ahead + 1] - values[segment : segment + 1])
        return np.concatenate([start, values[ahead:], values[1:ahead], start])

    dwell = None if piece.dwell is None else begun(piece.dwell)
    if dwell is not None:  # a pause at the start is made at the end, and between two vertices there is none
        dwell[0] = 0.0
        dwell[-1] = dwell[-1] if part == 0.0 else 0.0
    return RoutePiece(begun(piece.points), True, None if piece.intensity is None else begun(piece.intensity), dwell)


def _insertion(drawn: list[RoutePiece], piece: RoutePiece, *, back: bool, cyclic: bool) -> tuple[int, RoutePiece]:
    """The place at which a piece adds least to a route, and the piece as it is drawn there."""
    begin = np.array([p.points[0] for p in drawn])
    end = begin if back else np.array([p.points[0] if p.closed else p.points[-1] for p in drawn])
    following = np.roll(begin, -1, axis=0)
    into = _starts_of(piece.points, STARTS_TRIED) if piece.closed else piece.points[[0, -1]]
    out = into if piece.closed or back else into[::-1]
    to, on = (np.linalg.norm(a[:, None] - b[None], axis=2) for a, b in ((end, into), (following, out)))
    cost = to + on - np.linalg.norm(following - end, axis=1)[:, None]
    if not cyclic:  # behind the last one nothing follows
        cost[-1] = to[-1]
    place, start = np.unravel_index(int(cost.argmin()), cost.shape)
    return int(place) + 1, _entered(piece, int(start), STARTS_TRIED)


def _found(pieces: list[RoutePiece], *, back: bool, cyclic: bool) -> tuple[np.ndarray, list[RoutePiece], float]:
    """The shortest route: numbers of its pieces, the pieces as it draws them, and the length of its jumps [m]."""
    order, route = _shortest(pieces, back=back, cyclic=cyclic)
    return order, route, jump_total(route, back=back, cyclic=cyclic)


def shortest_route(pieces: list[RoutePiece], *, back: bool = False, cyclic: bool = True) -> list[RoutePiece]:
    """The pieces in an order that makes `jump_total` small: loops start anywhere, open pieces run either way.

    Exact for up to four pieces, three where it is no cycle, but for the choice of starts on loops: 32 on each of two,
    16 on each of four. Up to SEARCHED_MOST: nearest neighbour and the given order, each improved by 2-opt, then the
    best starts for that order. Beyond: nearest neighbour, loops from where they are given. Never longer than the given
    route; more than PIECES_MOST pieces stay as they are.
    """
    return pieces if not 1 < len(pieces) <= PIECES_MOST else _shortest(pieces, back=back, cyclic=cyclic)[1]


def _shortest(pieces: list[RoutePiece], *, back: bool, cyclic: bool) -> tuple[np.ndarray, list[RoutePiece]]:
    """Numbers of the pieces in the order of the shortest route, and the pieces as it draws them."""
    searched = len(pieces) <= SEARCHED_MOST
    share = max(1, STARTS // len(pieces))
    starts = _list_starts(pieces, share, back=back, outside=not cyclic)
    place_count = len(starts.of)
    if place_count <= 4:
        chosen = min((_best_starts(order, starts) for order in CYCLES[place_count]), key=lambda found: found[0])[1]
    else:
        given, nearest = np.array([of[0] for of in starts.of]), _nearest_first(starts)
        if searched:
            routes = [_improved(nearest, starts), _improved(given, starts)]
        else:
            routes = [_best_of_order(nearest, starts), (float(starts.jump[given, np.roll(given, -1)].sum()), given)]
        chosen = min(routes, key=lambda found: found[0])[1]
    if not cyclic:  # the outside comes last
        chosen = np.roll(chosen, -1 - int(np.argmax(starts.piece[chosen])))
    picked = [(int(starts.piece[start]), int(start)) for start in chosen if starts.piece[start] < len(pieces)]
    route = [_entered(pieces[i], start - int(starts.of[i][0]), share) for i, start in picked]
    return np.array([i for i, _ in picked]), route


def _list_starts(pieces: list[RoutePiece], share: int, *, back: bool, outside: bool) -> Starts:
    """All starts; `outside` adds a place at no distance from any, where a route that is no cycle begins and ends."""
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
    piece_of = np.repeat(np.arange(len(of)), [len(starts) for starts in of])
    return Starts(piece_of, np.concatenate(flipped), jump, of)


def _improved(chosen: np.ndarray, starts: Starts) -> tuple[float, np.ndarray]:
    """A route after 2-opt and the best starts, twice, and its length [m]."""
    length = np.inf
    for _ in range(2):
        better = _uncrossed(chosen, starts)
        if better is chosen and length < np.inf:  # a second look at the same
            break
        length, chosen = _best_of_order(better, starts)
    return length, chosen


def _best_of_order(chosen: np.ndarray, starts: Starts) -> tuple[float, np.ndarray]:
    """A route through the best starts in its order, and its length [m]."""
    return _best_starts(starts.piece[chosen].tolist(), starts)


def _nearest_first(starts: Starts) -> np.ndarray:
    """One start of each piece: from the shortest jump on, always to the nearest piece that is left."""
    other = starts.piece[:, None] != starts.piece[None]
    first = int(np.argmin(np.where(other, starts.jump, np.inf))) // len(starts.piece)
    chosen, free = [first], starts.piece != starts.piece[first]
    while free.any():
        start = int(np.argmin(np.where(free, starts.jump[chosen[-1]], np.inf)))
        chosen.append(start)
        free &= starts.piece != starts.piece[start]
    return np.array(chosen)


def _uncrossed(chosen: np.ndarray, starts: Starts) -> np.ndarray:
    """2-opt: reverse ranges of the route, and the pieces in them, while that shortens it."""
    count = len(chosen)
    for _ in range(4 * count):
        after, turned = np.roll(chosen, -1), starts.flipped[chosen]
        now = starts.jump[chosen, after]
        # Of a range i..j, 1 <= i <= j, the jumps from i - 1 and to j + 1 change.
        gain = now[:-1, None] + now[None, 1:]
        gain -= starts.jump[chosen[:-1, None], turned[None, 1:]] + starts.jump[turned[1:, None], after[None, 1:]]
        gain = np.triu(gain)
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[i, j] <= 1e-9:
            break
        chosen = np.concatenate([chosen[: i + 1], turned[i + 1 : j + 2][::-1], chosen[j + 2 :]])
    return chosen


def _best_starts(order: list[int], starts: Starts) -> tuple[float, np.ndarray]:
    """The starts that make a cycle of pieces in this order shortest, and its length [m]: dynamic programming."""
    of = [starts.of[piece] for piece in order]
    total = _jumps(starts, of[0], of[1])  # shortest from each first start to each start here
    back = []
    for a, b in itertools.pairwise(of[1:]):
        through = total[:, None, :] + _jumps(starts, a, b).T[None]
        back.append(through.argmin(axis=2))
        total = through.min(axis=2)
    total = total + _jumps(starts, of[-1], of[0]).T
    first, start = (int(i) for i in np.unravel_index(int(total.argmin()), total.shape))
    chosen = [int(of[-1][start])]
    for k in range(len(back) - 1, -1, -1):
        start = int(back[k][first, start])
        chosen.append(int(of[k + 1][start]))
    return float(total.min()), np.array([int(of[0][first]), *chosen[::-1]])


def _jumps(starts: Starts, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Jumps from starts of one piece to those of another, which stand side by side."""
    return starts.jump[a[0] : a[-1] + 1, b[0] : b[-1] + 1]


def _entered(piece: RoutePiece, start: int, share: int) -> RoutePiece:
    """The piece drawn from one of its starts on."""
    if start == 0:
        return piece
    if not piece.closed:
        return _reversed(piece)
    arc = _arc_of(piece.points)
    begin = arc[-1] * start / share
    before = int(np.searchsorted(arc, begin - 1e-9))  # vertices before the start; the first is also the last
    after = int(np.searchsorted(arc, begin + 1e-9))

    def turned(values: np.ndarray, at: np.ndarray) -> np.ndarray:
        return np.concatenate([at, values[after:], values[1:before], at])

    intensity = piece.intensity
    if intensity is not None:
        intensity = turned(intensity, np.interp([begin], arc, intensity))
    dwell = piece.dwell
    if dwell is not None:
        dwell = turned(dwell, np.zeros(1))
        dwell[-1] = piece.dwell[before:after].sum() if piece.dwell is not None else 0.0
    points = turned(piece.points, _between(piece.points, arc, np.array([begin])))
    return replace(piece, points=points, intensity=intensity, dwell=dwell)


def _reversed(piece: RoutePiece) -> RoutePiece:
    """An open piece the other way round."""
    back, rest = (None if values is None else values[::-1] for values in (piece.intensity, piece.dwell))
    return replace(piece, points=piece.points[::-1], intensity=back, dwell=rest)


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
