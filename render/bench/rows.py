"""One row of `palpate bench`: an object and a strategy, rendered by palpate and its peers in turns."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..hands.hand import Palm
from ..objects.mesh.solid_mesh import MeshObject
from ..strategies.intersection_strategy import load_strategy
from .cases import bench_poses
from .clocks import Clocks, CopyTurn, OwnTurn, Yield, fitting_count, interleaved, memory_peak, timed
from .peers import Absence, Peer
from .turns import BenchOptions, PeerRow, PeerTurn, Trial, timed_once

POSES_LEAST, POSES_MOST = 1_000, 200_000  # of ours, on the CPU
POSES_CUDA, POSES_CUDA_LARGE = 4_000_000, 200_000  # on a GPU, and there of a mesh of at least ...
TRIANGLES_LARGE = 50_000

FROZEN = {"cube": 23.0, "tube": 68.0, "sphere": 83.0, "blob-100k": 853.0, "blob-1m": 6700.0}
"""CC of the fastest library as measured once, on another machine, for poses in +-90 mm, and, the last two, for another
mesh of that many triangles [us a pose]: a second bar, which does not move with the machine."""


@dataclass(frozen=True)
class Row:
    """An object and a strategy."""

    object: str
    triangles: int
    strategy: str
    device: str
    motion: str
    poses: int
    repeats: int
    hit: float
    """Share of poses with contours."""
    vertices_per_pose: float
    """Distinct ones: without the repeated first point of a closed polyline."""
    segments_per_pose: float
    polylines_per_pose: float
    us: float
    """A pose [us]: CPU time where one core is compared on the CPU, else wall time."""
    us_cpu: float
    us_wall: float
    poses_per_second: float
    """By wall time."""
    copy_rate: float
    """Bytes read and written a second by a large copy on the device, in turns with the rest."""
    floor_us: float
    """28 bytes a pose, 12 a vertex and 8 a polyline at that rate [us a pose]."""
    floor_ratio: float
    """Wall time over the floor."""
    peer: str | None
    """The fastest peer whose contours are ours."""
    peer_ratio: float | None
    """Its time over ours."""
    frozen_us: float | None
    frozen_ratio: float | None
    result_bytes: int
    peak_bytes: int | None
    """Most device memory of Warp's arrays at once, results included; CUDA only."""
    pool_bytes: int | None
    """The same by the pool's high-water mark, native temporaries included; where it rose."""
    stages: dict[str, float] = field(default_factory=dict)
    """Shares of the time."""
    peers: tuple[PeerRow, ...] = ()


def measure_row(
    name: str,
    mesh: MeshObject,
    strategy: str,
    peers: Sequence[Peer],
    absent: Sequence[Absence],
    options: BenchOptions,
) -> Row:
    """Choose the poses, then measure.

    Raises MeshError where the strategy needs a closed object, StrategyError for an unknown strategy or motion, and
    fewer than one pose.
    """
    trial = Trial(name, mesh, strategy, row_poses(mesh, strategy, options), options)
    return measure_trial(trial, peers, absent)


def measure_trial(trial: Trial, peers: Sequence[Peer] = (), absent: Sequence[Absence] = ()) -> Row:
    """Check the peers, then time palpate, a copy, and the peers in turns."""
    options = trial.options
    own = OwnTurn(trial.mesh, trial.hand, trial.pose, trial.stages, options.device)
    kept, peak = memory_peak(own, options.device)  # first, while the pool's mark is low; and everything is warm
    found = Yield.of(kept)
    del kept
    turns = [PeerTurn(peer, trial) for peer in peers]
    copy = CopyTurn(options.device)
    calls = [own, copy, *(call for turn in turns if turn.repeated for call in turn.calls)]
    clocks = interleaved(calls, options.repeats)
    ours, copied, rest = clocks[0], copy.rate(clocks[1]), iter(clocks[2:])
    del calls, copy  # its memory is not ours
    us = 1e6 * getattr(ours, options.clock) / len(trial.pose)
    rows = []
    for turn in turns:
        taken = [next(rest) for _ in turn.calls] if turn.repeated else [] if turn.fault else timed_once(turn)
        rows.append(turn.row(taken, us))
    rows += [PeerRow.absent(absence) for absence in absent]
    return Row(
        **_named(trial, ours),
        **_yielded(found, ours, copied),
        **_compared(trial, us, rows),
        result_bytes=found.bytes,
        peak_bytes=peak.arrays if peak else None,
        pool_bytes=peak.pool if peak else None,
        stages=own.stages(),
        peers=tuple(rows),
    )


def row_poses(mesh: MeshObject, strategy: str, options: BenchOptions) -> np.ndarray:
    """As many poses as asked for, or as a repetition on the CPU has time for, or as fill a GPU."""
    if options.poses is not None:
        return bench_poses(options.motion, mesh, options.poses)
    if options.device != "cpu":
        large = len(mesh.faces) >= TRIANGLES_LARGE
        return bench_poses(options.motion, mesh, POSES_CUDA_LARGE if large else POSES_CUDA)
    probe = bench_poses(options.motion, mesh, POSES_LEAST)
    own = OwnTurn(mesh, Palm(), probe, load_strategy(strategy), options.device)
    timed(own)
    count = fitting_count(timed(own)[1] / len(probe), options.seconds, POSES_LEAST, POSES_MOST)
    return bench_poses(options.motion, mesh, count)


def _named(trial: Trial, ours: Clocks) -> dict:
    return {
        "object": trial.object,
        "triangles": len(trial.mesh.faces),
        "strategy": trial.strategy,
        "device": trial.options.device,
        "motion": trial.options.motion,
        "poses": len(trial.pose),
        "repeats": ours.repeats,
    }


def _yielded(found: Yield, ours: Clocks, copy_rate: float) -> dict:
    count, floor = found.poses, found.floor(copy_rate)
    return {
        "hit": found.hit / count,
        "vertices_per_pose": found.vertices / count,
        "segments_per_pose": found.segments / count,
        "polylines_per_pose": found.polylines / count,
        "us_cpu": 1e6 * ours.cpu / count,
        "us_wall": 1e6 * ours.wall / count,
        "poses_per_second": count / ours.wall,
        "copy_rate": copy_rate,
        "floor_us": 1e6 * floor / count,
        "floor_ratio": ours.wall / floor,
    }


def _compared(trial: Trial, us: float, peers: Sequence[PeerRow]) -> dict:
    fastest = min((row for row in peers if row.us is not None), key=lambda row: row.us or 0.0, default=None)
    known = trial.strategy == "cc" and trial.options.motion == "random"
    frozen = FROZEN.get(trial.object) if known else None
    return {
        "us": us,
        "peer": fastest.name if fastest else None,
        "peer_ratio": fastest.ratio if fastest else None,
        "frozen_us": frozen,
        "frozen_ratio": frozen / us if frozen else None,
    }
