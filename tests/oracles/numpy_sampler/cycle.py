"""One cycle of focal points over a path, laid out in time.

Whatever a strategy asks for comes down to nodes and when each is reached. Between two nodes the focal point runs
evenly: a segment of no duration is a jump, one of no length is a pause.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.render.sampling.strategy import SamplingStrategy

from .drawing_turns import by_turns
from .path import Path
from .route import PIECES_MOST, Route, RoutePiece, steady_route

NEAR_CUT = 0.1  # of a section's length
NEAR_STEPS = 3.0  # ordinary steps: by so much contours may move between inserted poses, see `pose_insertion`
NOISE_SHARE = 1e-3  # of a sample: segments that take less say nothing of the speed, for rounding is as large
PASSES_MOST = 199  # through a section; more only on contours far smaller than a focal point


@dataclass(frozen=True, eq=False, slots=True)
class Cycle:
    """Nodes of a cycle."""

    parameter: np.ndarray
    """When each node is reached, in any unit that the strategy's speed makes even, from 0, shape [node]."""
    points: np.ndarray
    """[m], shape [node, 3]."""
    step: np.ndarray
    """From each node to the next [m], shape [node - 1, 3]."""
    intensity: np.ndarray | None
    """Shape [node]; None means 1."""
    sample_count: int
    """Samples a cycle."""
    seconds: float
    """What a cycle takes at the nominal speeds [s]."""
    pause: np.ndarray | None = None
    """Whether the focal point rests from each node to the next, bool, shape [node - 1]; None: nowhere."""
    section: np.ndarray | None = None
    """Parameters at which sections start, and the period, shape [section + 1]; None: there are none."""
    route: Route | None = None
    """The polylines in the order in which they are drawn; None where a cycle is made by hand."""
    piece: np.ndarray | None = None
    """Number in the route of the polyline that each segment from node to node is on, -1 between two of them, shape
    [node - 1]; None: all are on polyline 0."""
    turns: int = 1
    """Cycles after which the samples lie where they lay before. More than one where a polyline is shorter than a step:
    the samples of each cycle then lie elsewhere, so that each polyline has one in one of these cycles."""
    turn_samples: int = 0
    """Samples of that many cycles; 0 for `sample_count` of one cycle."""

    @property
    def period(self) -> float:
        """Of a cycle, in the unit of the parameters."""
        return float(self.parameter[-1])

    @property
    def repeat_count(self) -> int:
        """Samples after which all samples lie where they lay before."""
        return self.turn_samples or self.sample_count

    @property
    def one_sample(self) -> float:
        """Curve parameter from a sample to the next."""
        return self.turns * self.period / self.repeat_count

    @property
    def step_ordinary(self) -> float:
        """Greatest distance between two samples on the same segment of the cycle, jumps left out [m]."""
        took = np.diff(self.parameter)
        moves = took > NOISE_SHARE * self.one_sample
        length = np.sqrt(np.einsum("ij,ij->i", self.step[moves], self.step[moves]))
        return float((length / took[moves]).max(initial=0.0)) * self.one_sample

    def pieces_at(self, parameter: np.ndarray) -> np.ndarray | None:
        """Number in the route of the polyline at parameters within 0..period, -1 between two; None: on the only one."""
        if self.piece is None:
            return None
        segment = np.searchsorted(self.parameter, parameter, side="right") - 1
        return self.piece[np.minimum(segment, len(self.piece) - 1)]

    def at(self, parameter: np.ndarray) -> np.ndarray:
        """Points [m] at parameters within 0..period, shape [..., 3]; at a jump the one behind it."""
        out = np.empty((*parameter.shape, 3))
        for axis in range(3):
            out[..., axis] = np.interp(parameter, self.parameter, self.points[:, axis])
        return out

    def along(self, i: int, part: float) -> float:
        """Parameter on the segment from a node to the next, part 0..1."""
        return float(self.parameter[i] + part * (self.parameter[i + 1] - self.parameter[i]))

    def approach(
        self, point: np.ndarray, direction: np.ndarray | None, slack: float, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance of each segment from a point, and the nearest place on it, 0..1; both of shape [node - 1].

        The distance [m] counts `slack` more for segments that run against the direction; jumps and pauses are at
        infinity. So do segments farther than NEAR_STEPS ordinary `step`s [m] where any segment is as near as that: the
        direction is no reason for a longer step. With pauses and sections it is, lest these be left out or made twice.
        """
        square = np.einsum("ij,ij->i", self.step, self.step)
        off = point - self.points[:-1]
        part = np.einsum("ij,ij->i", off, self.step) / np.maximum(square, 1e-30)
        part = np.minimum(np.maximum(part, 0.0), 1.0)
        off -= part[:, None] * self.step
        cost = np.sqrt(np.einsum("ij,ij->i", off, off))
        cost[(self.parameter[1:] <= self.parameter[:-1]) | (square == 0)] = np.inf
        if direction is not None:
            worse = (self.step * direction).sum(axis=1) < -1e-9 * np.sqrt(square)
            if self.pause is None and self.section is None and cost.min() <= NEAR_STEPS * step:
                worse |= cost > NEAR_STEPS * step
            cost += slack * worse
        return cost, part


def lay_cycle(path: Path, strategy: SamplingStrategy, before: Route | None = None) -> Cycle:
    """One cycle of a strategy over the polylines of a pose; before: route of the pose before, see `steady_route`."""
    single = len(path.first) == 1
    in_order = not 1 < len(path.first) <= PIECES_MOST or strategy.order.route == "given"
    pieces = pieces_of(path)
    if strategy.plain and in_order and path.dwell is None and (single or not _has_short(path, strategy)):
        seconds = path.length / strategy.speed
        count = strategy.samples_of(seconds)
        piece = None if single else _piece_of_segments(_numbers_of(path))
        route = Route(pieces, before)
        return Cycle(path.arc, path.points, path.step, path.intensity, count, seconds, route=route, piece=piece)
    if strategy.gap.kind == "close":
        pieces = [_closed(piece) for piece in pieces]
    back, cyclic = strategy.gap.kind == "pendulum", strategy.order.kind != "pendulum"
    if strategy.order.route == "shortest":
        route = steady_route(pieces, before, margin=strategy.order.margin, back=back, cyclic=cyclic)
    else:
        route = Route(pieces, before)
    nodes = _nodes_of(route.pieces, strategy)
    if strategy.sections is not None:
        nodes = _in_sections(nodes, strategy)
    elif strategy.dwell.time > 0 or strategy.dwell.share > 0 or nodes.dwell is not None:
        nodes = _with_pauses(nodes, strategy)
    return _timed(nodes, route, strategy)


def _has_short(path: Path, strategy: SamplingStrategy) -> bool:
    """Whether a polyline of a path is shorter than the step from sample to sample."""
    length = np.diff(np.append(path.arc[path.first], path.arc[-1]))
    step = path.length / strategy.samples_of(path.length / strategy.speed)
    return bool((length[length > 0] < step).any())


@dataclass(frozen=True, eq=False, slots=True)
class TimedNodes:
    """Nodes and how long each segment between two of them takes."""

    points: np.ndarray  # [m], shape [node, 3]
    duration: np.ndarray  # [s], shape [node - 1]
    corner: np.ndarray  # bool, shape [node]
    intensity: np.ndarray | None  # shape [node]
    piece: np.ndarray  # number of the polyline that it is on, -1 between two, shape [node]
    pause: np.ndarray | None = None  # bool, shape [node - 1]
    section: np.ndarray | None = None  # first node of each section, and the last of all
    dwell: np.ndarray | None = None  # pause that the contours have there [s], shape [node]

    def picked(self, index: np.ndarray, duration: np.ndarray) -> "TimedNodes":
        """Nodes by number, with other times between them."""
        intensity, dwell = (None if values is None else values[index] for values in (self.intensity, self.dwell))
        return TimedNodes(self.points[index], duration, self.corner[index], intensity, self.piece[index], dwell=dwell)


def _timed(nodes: TimedNodes, route: Route, strategy: SamplingStrategy) -> Cycle:
    """The cycle of nodes with durations: when each node is reached, and on how many samples the cycle is drawn."""
    parameter = _summed(nodes.duration)
    seconds = float(parameter[-1])
    count = strategy.samples_of(seconds)
    piece = _piece_of_segments(nodes.piece)
    turns, turn_samples = 1, 0
    if strategy.pace.points is None and strategy.pace.kind != "still" and len(route.pieces) > 1:
        duration, turns, turn_samples = by_turns(nodes.duration, piece, count, strategy)
        if duration is not nodes.duration:
            parameter = _summed(duration)
    section = None if nodes.section is None else parameter[nodes.section]
    step = np.diff(nodes.points, axis=0)
    return Cycle(
        parameter, nodes.points, step, nodes.intensity, count, seconds, nodes.pause, section,
        route, piece, turns, turn_samples,
    )  # fmt: skip


def _summed(duration: np.ndarray) -> np.ndarray:
    """When each node is reached, from 0."""
    parameter = np.zeros(len(duration) + 1)
    np.cumsum(duration, out=parameter[1:])
    return parameter


def _piece_of_segments(piece: np.ndarray) -> np.ndarray:
    """Number of the polyline that each segment from node to node is on, -1 between two; piece: of each node."""
    return np.where(piece[:-1] == piece[1:], piece[:-1], -1)


def pieces_of(path: Path) -> list[RoutePiece]:
    """The polylines of a path that have a length."""
    stops = [*path.first[1:].tolist(), len(path.points)]
    pieces = []
    for first, stop, closed in zip(path.first.tolist(), stops, path.closed.tolist(), strict=True):
        if path.arc[stop - 1] > path.arc[first]:
            intensity = None if path.intensity is None else path.intensity[first:stop]
            dwell = None if path.dwell is None else path.dwell[first:stop].copy()
            if dwell is not None and closed:
                dwell[0] = 0.0
            pieces.append(RoutePiece(path.points[first:stop], closed, intensity, dwell))
    return pieces


def _numbers_of(path: Path) -> np.ndarray:
    """Number among `pieces_of` of the polyline that each vertex is on, shape [point]."""
    length = np.diff(np.append(path.arc[path.first], path.arc[-1]))
    return np.repeat(np.cumsum(length > 0) - 1, np.diff(np.append(path.first, len(path.points))))


def _closed(piece: RoutePiece) -> RoutePiece:
    """An open piece with its chord."""
    if piece.closed:
        return piece
    intensity, dwell = (None if v is None else np.append(v, v[0]) for v in (piece.intensity, piece.dwell))
    if dwell is not None:
        dwell[0] = 0.0
    return RoutePiece(np.vstack([piece.points, piece.points[:1]]), True, intensity, dwell)


def _nodes_of(pieces: list[RoutePiece], strategy: SamplingStrategy) -> TimedNodes:
    """The pieces one after the other, with the segments between them, and back where the order asks for it."""
    corners = [_corners_of(piece, strategy) for piece in pieces]
    if strategy.gap.kind == "pendulum":
        corners = [c if p.closed else _there_and_back(c, strategy) for p, c in zip(pieces, corners, strict=True)]
        pieces = [p if p.closed else _returned(p) for p in pieces]
    points = np.concatenate([p.points for p in pieces])
    corner = np.concatenate(corners)
    strengths = [p.intensity for p in pieces if p.intensity is not None]
    intensity = np.concatenate(strengths) if strengths else None
    pauses = [p.dwell for p in pieces if p.dwell is not None]
    dwell = np.concatenate(pauses) if pauses else None
    returns, pendulum = strategy.gap.kind == "return", strategy.order.kind == "pendulum"
    number = np.repeat(np.arange(len(pieces)), [len(p.points) for p in pieces])
    gap = np.cumsum([len(p.points) for p in pieces])[:-1] - 1
    if returns and not pendulum:  # from the last to the first
        gap = np.append(gap, len(points) - 1)
        points = np.vstack([points, points[:1]])
        corner, number = np.append(corner, False), np.append(number, -1)
        intensity = None if intensity is None else np.append(intensity, intensity[0])
        dwell = None if dwell is None else np.append(dwell, 0.0)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    duration = length / strategy.speed
    duration[gap] = length[gap] / strategy.gap.speed if returns else 0.0
    nodes = TimedNodes(points, duration, corner, intensity, number, dwell=dwell)
    if pendulum:
        index = np.concatenate([np.arange(len(points)), np.arange(len(points) - 2, -1, -1)])
        back = nodes.picked(index, np.concatenate([duration, duration[::-1]]))
        nodes = replace(back, corner=_there_and_back(corner, strategy), dwell=_paused_once(back.dwell))
    return nodes


def _returned(piece: RoutePiece) -> RoutePiece:
    """A piece there and back."""
    points, intensity, dwell = (
        None if values is None else np.concatenate([values, values[-2::-1]])
        for values in (piece.points, piece.intensity, piece.dwell)
    )
    return RoutePiece(points, piece.closed, intensity, _paused_once(dwell))


def _paused_once(dwell: np.ndarray | None) -> np.ndarray | None:
    """Pauses of a piece that ends where it starts: there only at the end."""
    return None if dwell is None else np.concatenate([[0.0], dwell[1:]])


def _there_and_back(corner: np.ndarray, strategy: SamplingStrategy) -> np.ndarray:
    out = np.concatenate([corner, corner[-2::-1]])
    if strategy.sections is None:
        out[0] = False  # its pause comes when the piece ends there
    return out


def _corners_of(piece: RoutePiece, strategy: SamplingStrategy) -> np.ndarray:
    """Vertices where a piece turns by more than an angle, and the ends of an open one, bool, shape [point].

    The corner at which a closed piece starts is marked at its end, and, for sections, at its start too. None without
    pauses.
    """
    dwell = strategy.dwell
    if dwell.time == 0 and dwell.share == 0:
        return np.zeros(len(piece.points), bool)
    corner = np.zeros(len(piece.points), bool)
    step = np.diff(piece.points, axis=0)
    length = np.linalg.norm(step, axis=1)
    moving = np.flatnonzero(length > 0)
    unit = step[moving] / length[moving, None]
    cosine = np.einsum("ij,ij->i", unit, np.roll(unit, -1, axis=0))  # at the end of each step
    corner[moving + 1] = cosine < np.cos(dwell.angle)
    if not piece.closed:
        corner[[0, -1]] = True
    elif strategy.sections is not None:
        corner[0] = corner[-1]
    return corner


def _with_pauses(nodes: TimedNodes, strategy: SamplingStrategy) -> TimedNodes:
    """A pause at every corner, and where the contours have one of their own."""
    dwell, count = strategy.dwell, int(np.count_nonzero(nodes.corner))
    pause = np.zeros(len(nodes.points)) if nodes.dwell is None else nodes.dwell.copy()
    if count > 0:
        share = dwell.share / (1.0 - dwell.share) * float(nodes.duration.sum()) / count
        pause[nodes.corner] += dwell.time or share
    if not pause.any():
        return nodes
    index = np.repeat(np.arange(len(nodes.points)), 1 + (pause > 0))
    moving = nodes.duration[np.minimum(index[:-1], len(nodes.duration) - 1)]
    rests = np.diff(index) == 0
    return replace(nodes.picked(index, np.where(rests, pause[index[:-1]], moving)), pause=rests)


def _in_sections(nodes: TimedNodes, strategy: SamplingStrategy) -> TimedNodes:
    """Each section there and back an odd number of times; see `Sections`."""
    sections = strategy.sections
    if sections is None:
        return nodes
    corner = _sections_with_corner(nodes, sections.count)
    nodes, start, stop = _cut(nodes, sections.count)
    time = np.full(sections.count, 1.0 / sections.count)
    share, marked = strategy.dwell.share, int(np.count_nonzero(corner))
    if share > 0 and 0 < marked < sections.count:
        time = np.where(corner, share / marked, (1.0 - share) / (sections.count - marked))
    time /= strategy.pace.frequency
    once = np.add.reduceat(nodes.duration, start)  # segments from section to section take no time
    wanted = time * sections.speed / (np.maximum(once, 1e-12) * strategy.speed)
    passes = 1 + 2 * np.clip(np.rint((wanted - 1) / 2), 0, PASSES_MOST // 2).astype(np.int64)
    segments = stop - start
    node_count = segments * passes + 1
    section = np.repeat(np.arange(sections.count), node_count)
    first = np.cumsum(node_count) - node_count
    turn = (np.arange(len(section)) - first[section]) % (2 * segments[section])
    index = start[section] + np.minimum(turn, 2 * segments[section] - turn)
    scale = time / (np.maximum(once, 1e-12) * passes)
    duration = nodes.duration[np.minimum(index[:-1], index[1:])] * scale[section[:-1]]
    duration[first[1:] - 1] = 0.0
    return replace(nodes.picked(index, duration), section=np.append(first, len(index) - 1))


def _sections_with_corner(nodes: TimedNodes, count: int) -> np.ndarray:
    """Equal sections that hold a corner, bool, shape [section]; one near a cut is in both, lest noise decides."""
    parameter = np.concatenate([[0.0], np.cumsum(nodes.duration)])
    at = parameter[nodes.corner] / parameter[-1] * count
    out = np.zeros(count, bool)
    out[np.clip(np.floor(at - NEAR_CUT).astype(int), 0, count - 1)] = True
    out[np.clip(np.floor(at + NEAR_CUT).astype(int), 0, count - 1)] = True
    return out


def _cut(nodes: TimedNodes, count: int) -> tuple[TimedNodes, np.ndarray, np.ndarray]:
    """Nodes with more of them at cuts into equal parts, and the first and last node of each part."""
    parameter = np.concatenate([[0.0], np.cumsum(nodes.duration)])
    cut = parameter[-1] * np.arange(1, count) / count
    near = np.searchsorted(parameter, cut)
    below, above = np.abs(cut - parameter[near - 1]), np.abs(parameter[np.minimum(near, len(parameter) - 1)] - cut)
    cut = np.where(below < 1e-12, parameter[near - 1], np.where(above < 1e-12, parameter[near], cut))
    new = cut[~np.isin(cut, parameter)]
    place = np.searchsorted(parameter, new)
    points = np.stack([np.interp(new, parameter, nodes.points[:, axis]) for axis in range(3)], axis=1)
    intensity = nodes.intensity
    if intensity is not None:
        intensity = np.insert(intensity, place, np.interp(new, parameter, intensity))
    parameters = np.insert(parameter, place, new)
    corner = np.insert(nodes.corner, place, False)
    piece = np.insert(nodes.piece, place, _piece_of_segments(nodes.piece)[place - 1])
    out = TimedNodes(np.insert(nodes.points, place, points, axis=0), np.diff(parameters), corner, intensity, piece)
    start = np.concatenate([[0], np.searchsorted(parameters, cut, side="right") - 1])
    stop = np.concatenate([np.searchsorted(parameters, cut, side="left"), [len(parameters) - 1]])
    return out, start, stop
