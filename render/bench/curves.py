"""Curves of `palpate bench`: cost a pose against the triangles of one surface, cost against the number of poses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..hands.hand import Palm
from ..objects.mesh.solid_mesh import MeshObject
from ..strategies.intersection_strategy import load_strategy
from .cases import bench_poses, blob_object
from .clocks import OwnTurn, Yield, interleaved, timed
from .rows import row_poses
from .turns import BenchOptions

FREQUENCIES = (2, 4, 7, 12, 22, 39, 71, 122, 224)  # of the blob: 80 to 1,003,520 triangles, three a decade
POSE_COUNTS = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
OBJECT = "tube"  # of the curve against poses
STRATEGY = "cc"
SECONDS_MOST = 120.0  # of one point's repetitions; fewer are made, or none


@dataclass(frozen=True)
class CurvePoint:
    """One measured point."""

    triangles: int
    poses: int
    repeats: int
    segments_per_pose: float
    us: float
    """A pose [us]."""
    seconds: float
    """All poses."""
    ns_per_segment: float
    theory: float
    """Segments a pose x log2 of triangles: what the cost a pose should grow like."""


@dataclass(frozen=True)
class Curve:
    """Cost against size, and the exponents of power laws fitted to it."""

    name: str
    against: str
    """triangles: us a pose; poses: seconds in all."""
    points: tuple[CurvePoint, ...]
    left_out: tuple[str, ...]
    """Points that would have taken too long."""
    slope: float | None
    """Of log cost over log size, all points."""
    slope_theory: float | None
    """The same of what theory says: not more than this is asked for."""
    slope_large: float | None
    """Over the upper half of the points, where fixed costs matter less."""
    slope_large_theory: float | None


def triangle_curve(
    options: BenchOptions, frequencies: Sequence[int] = FREQUENCIES, done: Callable[[], None] = lambda: None
) -> Curve:
    """Cost a pose of the blob at every frequency."""
    points, left_out = [], []
    for frequency in frequencies:
        mesh = blob_object(frequency)
        found = _point(mesh, row_poses(mesh, STRATEGY, options), options)
        if isinstance(found, str):
            left_out.append(found)
        else:
            points.append(found)
        done()
    return _curve("blob", "triangles", points, left_out)


def pose_curve(
    options: BenchOptions, counts: Sequence[int] = POSE_COUNTS, done: Callable[[], None] = lambda: None
) -> Curve:
    """Seconds of the tube's poses at every count."""
    mesh = MeshObject.load(OBJECT)
    points, left_out = [], []
    for count in counts:
        too_long = points and points[-1].us * 1e-6 * count > SECONDS_MOST
        found = f"{count} poses" if too_long else _point(mesh, bench_poses(options.motion, mesh, count), options)
        if isinstance(found, str):
            left_out.append(found)
        else:
            points.append(found)
        done()
    return _curve(OBJECT, "poses", points, left_out)


def _point(mesh: MeshObject, pose: np.ndarray, options: BenchOptions) -> CurvePoint | str:
    own = OwnTurn(mesh, Palm(), pose, load_strategy(STRATEGY), options.device)
    found = Yield.of(own())
    once = timed(own)[1]
    if once > SECONDS_MOST:
        return f"{len(mesh.faces)} triangles, {len(pose)} poses"
    clocks = interleaved([own], max(1, min(options.repeats, int(SECONDS_MOST / once))))[0]
    seconds = getattr(clocks, options.clock)
    segments = found.segments / len(pose)
    return CurvePoint(
        triangles=len(mesh.faces),
        poses=len(pose),
        repeats=clocks.repeats,
        segments_per_pose=segments,
        us=1e6 * seconds / len(pose),
        seconds=seconds,
        ns_per_segment=1e9 * seconds / max(found.segments, 1),
        theory=segments * float(np.log2(len(mesh.faces))),
    )


def _curve(name: str, against: str, points: list[CurvePoint], left_out: list[str]) -> Curve:
    size = [getattr(point, against) for point in points]
    cost = [point.us if against == "triangles" else point.seconds for point in points]
    theory = [point.theory if against == "triangles" else float(point.poses) for point in points]
    upper = len(points) // 2
    return Curve(
        name=name,
        against=against,
        points=tuple(points),
        left_out=tuple(left_out),
        slope=power(size, cost),
        slope_theory=power(size, theory),
        slope_large=power(size[upper:], cost[upper:]),
        slope_large_theory=power(size[upper:], theory[upper:]),
    )


def power(size: Sequence[float], cost: Sequence[float]) -> float | None:
    """Exponent of the power law that fits best, by least squares of logarithms; None of fewer than two points."""
    if len(size) < 2:
        return None
    return float(np.polyfit(np.log(size), np.log(cost), 1)[0])
