"""Contours of random palms: palpate beside published libraries on the same poses, by turns, and beside a memory copy.

    python benchmarks/bench.py                                         # the table: about ten minutes
    python benchmarks/bench.py --objects cube tube --peers meshlib manifold3d
    python benchmarks/bench.py --device cuda:0 --peers none
    python benchmarks/bench.py --strategies cc --peers none --objects blob-80 blob-320 blob-1280   # against triangles
    python benchmarks/bench.py --peers none --save lengths.npz         # here
    python benchmarks/bench.py --peers none --device cuda:0 --compare lengths.npz    # on a machine with a GPU

One line of JSON for each object and strategy; docs/measured/bench.md explains the fields and the peers. The cases also
run small as tests (tests/house/test_bench_peers.py).
"""

import argparse
import gc
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp
from libraries import PEERS, find_peers
from peers import Absence, Agreement, Declined, Peer, check_peer, keep_to_one_core
from turns import copying

from palpate.render import IntersectionStrategy, MeshObject, Palm, exploration, load_strategy
from palpate.render.bench.cases import bench_object, random_poses
from palpate.render.bench.speed import OwnTurn, fitting_count, fitting_poses, machine_facts, timed
from palpate.render.contour_batch import ContourBatch

OBJECTS = ("cube", "tube", "dog", "sphere", "boulder", "dog-detailed", "blob-5000")
PEER_POSES = 10, 1_000  # fewest and most
PROBE_POSES = 20  # rendered to learn what a peer costs
CHECK_POSES = 500
ONCE_SECONDS = 3.0  # a peer whose shortest repetition takes longer is timed once
SECONDS = 1.0  # of one repetition of a peer
POSE_BYTES, VERTEX_BYTES, POLYLINE_BYTES = 28, 12, 8
"""What any layout must at least move: a pose in, a distinct vertex and an offset out."""
EXPLORATION_RATE = 90.0  # [Hz]
COPY_BYTES = {True: 2**31, False: 2**28}  # read and written, by whether it is on CUDA: far beyond any cache
COPIES = 20  # in a row: on a GPU one takes 0.5 ms, and waiting for it a good part of that

object_of = cache(bench_object)  # a blob of a million triangles takes seconds to make


@dataclass(frozen=True)
class Trial:
    """What everyone is given: an object, a strategy, poses."""

    object: str
    strategy: str
    pose: np.ndarray
    """float32, shape [pose, 7]."""
    device: str = "cpu"
    repeats: int = 7
    one_core: bool = True
    """Compare CPU time on one core instead of wall time on all."""
    seconds: float = SECONDS
    hand: Palm = field(default_factory=Palm)

    @property
    def mesh(self) -> MeshObject:
        """The object that the name stands for."""
        return object_of(self.object)

    @property
    def stages(self) -> IntersectionStrategy:
        """The strategy that the name stands for."""
        return load_strategy(self.strategy)

    def spread(self, count: int) -> np.ndarray:
        """So many poses, evenly from all: the first ones of an exploration would be one visit."""
        return self.pose[np.linspace(0, len(self.pose) - 1, min(count, len(self.pose))).astype(int)]


@dataclass(frozen=True)
class Clocks:
    """Medians over the repetitions [s]."""

    cpu: float
    """Of the whole process, all threads."""
    wall: float
    repeats: int


def interleaved(calls: Sequence[Callable[[], Any]], repeats: int) -> list[Clocks]:
    """Time calls in turns, each once a round and the first one later every round; nothing is run to warm up."""
    taken = np.zeros((repeats, len(calls), 2))
    gc.disable()
    try:
        for turn in range(repeats):
            for place in range(len(calls)):
                index = (turn + place) % len(calls)
                taken[turn, index] = timed(calls[index])
            gc.collect()
    finally:
        gc.enable()
    return [Clocks(float(cpu), float(wall), repeats) for cpu, wall in np.median(taken, axis=0)]


@dataclass(frozen=True)
class Yield:
    """Totals of a rendering."""

    poses: int
    hit: int
    """Poses with contours."""
    vertices: int
    """Distinct points of polylines: without the repeated first point of a closed one."""
    points: int
    polylines: int
    bytes: int
    """Of all arrays."""

    @classmethod
    def of(cls, batches: Sequence[ContourBatch]) -> "Yield":
        """Count batches on the host or a device."""
        hosts = [batch.numpy() for batch in batches]
        points = sum(batch.point_count for batch in hosts)
        return cls(
            poses=sum(batch.pose_count for batch in hosts),
            hit=sum(int(np.count_nonzero(np.diff(batch.pose_start))) for batch in hosts),
            vertices=points - sum(int(batch.polyline_closed.sum(dtype=np.int64)) for batch in hosts),
            points=points,
            polylines=sum(batch.polyline_count for batch in hosts),
            bytes=sum(array.nbytes for batch in hosts for array in batch.by_name().values()),
        )

    def floor(self, copy_rate: float) -> float:
        """Seconds that moving the least any layout must move takes: each byte once, at the rate of a copy."""
        moved = POSE_BYTES * self.poses + VERTEX_BYTES * self.vertices + POLYLINE_BYTES * self.polylines
        return moved / copy_rate


class CountingAllocator:
    """A device's own allocator that also counts the bytes of the arrays that live."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner
        self.deallocate_requires_context_guard = inner.deallocate_requires_context_guard
        self.memory_kind = inner.memory_kind
        self.live = self.most = 0

    def allocate(self, size_in_bytes: int) -> int:
        """Pass on and count."""
        pointer = self._inner.allocate(size_in_bytes)
        self.live += size_in_bytes
        self.most = max(self.most, self.live)
        return pointer

    def deallocate(self, ptr: int, size_in_bytes: int) -> None:
        """Pass on and count."""
        self.live -= size_in_bytes
        self._inner.deallocate(ptr, size_in_bytes)


def memory_peak(call: Callable[[], Any], device: str) -> tuple[Any, int | None, int | None]:
    """The result of one call, and its peak memory [byte] on a CUDA device: of Warp's arrays, and of the pool.

    The arrays are counted exactly. The pool's high-water mark includes temporaries of native code; it is None where an
    earlier rendering reached higher, since the mark cannot be put back.
    """
    target = wp.get_device(device)
    if not target.is_cuda or not wp.is_mempool_enabled(target):
        return call(), None, None
    counting = CountingAllocator(wp.get_device_allocator(target))
    wp.synchronize_device(target)
    used, high = wp.get_mempool_used_mem_current(target), wp.get_mempool_used_mem_high(target)
    with wp.ScopedAllocator(target, counting):
        kept = call()
        wp.synchronize_device(target)
    risen = wp.get_mempool_used_mem_high(target)
    return kept, counting.most, risen - used if risen > high else None


@dataclass(frozen=True)
class PeerRow:
    """Result of one peer."""

    name: str
    state: str
    """timed, once (too slow to be repeated), disagrees, declined (not made for the mesh), failed, absent."""
    note: str = ""
    version: str = ""
    licence: str = ""
    setup_seconds: float | None = None
    """Not part of what a pose costs."""
    call_seconds: float | None = None
    """What every call takes before its first pose, of a peer that prepares the mesh anew; not part of it either."""
    poses: int = 0
    us: float | None = None
    """A pose [us]: CPU time where one core is compared, else wall time."""
    us_wall: float | None = None
    ratio: float | None = None
    """Its time over ours."""
    agreement: Agreement | None = None


class PeerTurn:
    """One peer in one trial: set up, checked against ours, then timed with as many poses as a repetition allows."""

    def __init__(self, peer: Peer, trial: Trial) -> None:
        self.peer, self.trial = peer, trial
        self.agreement: Agreement | None = None
        self.fault: tuple[str, str] | None = None
        """State and note, if it cannot be timed."""
        self.setup_seconds = self._cost = 0.0
        self.poses = 0
        try:
            self._prepare()
        except Declined as error:
            self.fault = "declined", str(error)
        except Exception as error:  # a library's fault is that library's row, not the end of the table
            self.fault = "failed", f"{type(error).__name__}: {error}"

    def _prepare(self) -> None:
        peer, trial, probe = self.peer, self.trial, self.trial.spread(PROBE_POSES)
        started = perf_counter()
        peer.setup(trial.mesh, trial.hand)
        self.setup_seconds = perf_counter() - started
        peer.contours(probe[:1], trial.stages)  # whatever a first call loads
        first = timed(self._call(probe[:1]))[0]
        self._cost = timed(self._call(probe))[0] / len(probe)
        seconds = trial.seconds
        if peer.rebuilds and len(probe) > 1:
            self._cost = max(self._cost * len(probe) - first, 1e-7) / (len(probe) - 1)
            seconds = max(seconds, first)
        self.poses = min(len(trial.pose), fitting_count(self._cost, seconds, *PEER_POSES))
        sample = trial.spread(max(PROBE_POSES, min(self.poses, CHECK_POSES)))
        self.agreement = check_peer(peer, trial.mesh, trial.hand, sample, trial.stages)
        if not self.agreement.agrees:
            self.fault = "disagrees", f"not the same contours: {self.agreement.text()}"

    def _call(self, pose: np.ndarray) -> Callable[[], Any]:
        return partial(self.peer.contours, pose, self.trial.stages)

    @property
    def repeated(self) -> bool:
        """Whether it is quick enough to take turns."""
        return self.fault is None and (self.peer.rebuilds or self._cost * self.poses <= ONCE_SECONDS)

    @property
    def calls(self) -> list[Callable[[], Any]]:
        """What is timed: all its poses; where every call prepares the mesh anew, one pose too, to be subtracted."""
        part = self.trial.spread(self.poses)
        return [self._call(part)] + ([self._call(part[:1])] if self.peer.rebuilds and self.poses > 1 else [])

    def row(self, clocks: list[Clocks], ours: float) -> PeerRow:
        """The result, from the clocks of `calls` and our own time a pose [us]."""
        about = {"name": self.peer.name, "version": self.peer.version, "licence": self.peer.licence}
        if self.fault:
            state, note = self.fault
            return PeerRow(**about, state=state, note=note, agreement=self.agreement)
        cpu, wall, count = clocks[0].cpu, clocks[0].wall, self.poses
        if len(clocks) == 2:
            cpu, wall, count = max(cpu - clocks[1].cpu, 0.0), max(wall - clocks[1].wall, 0.0), count - 1
        us = 1e6 * (cpu if self.trial.one_core else wall) / count
        return PeerRow(
            **about,
            state="timed" if self.repeated else "once",
            note="cost of a further pose, since every call prepares the mesh anew" if len(clocks) == 2 else "",
            setup_seconds=self.setup_seconds,
            call_seconds=clocks[1].wall if len(clocks) == 2 else None,
            poses=self.poses,
            us=us,
            us_wall=1e6 * wall / count,
            ratio=us / ours,
            agreement=self.agreement,
        )


def measure_trial(trial: Trial, peers: Sequence[Peer] = (), absent: Sequence[Absence] = ()) -> dict:
    """Check the peers, then time palpate, a copy, and the peers in turns."""
    own = OwnTurn(trial.mesh, trial.hand, trial.pose, trial.stages, trial.device)
    kept, peak, pool = memory_peak(own, trial.device)  # first, while the pool's mark is low; and everything is warm
    found, count = Yield.of(kept), len(trial.pose)
    del kept
    turns = [PeerTurn(peer, trial) for peer in peers]
    size = COPY_BYTES[wp.get_device(trial.device).is_cuda]
    copy, over = copying(size, trial.device, COPIES)
    clocks = interleaved([own, copy, *(call for turn in turns if turn.repeated for call in turn.calls)], trial.repeats)
    ours, copy_rate, rest = clocks[0], over * size / clocks[1].wall, iter(clocks[2:])
    floor = found.floor(copy_rate)
    # A GPU's work takes no CPU time, so it is compared by wall time.
    us = 1e6 * (ours.cpu if trial.one_core and trial.device == "cpu" else ours.wall) / count
    rows = [PeerRow(absence.name, "absent", absence.reason) for absence in absent]
    for turn in turns:
        if turn.repeated:
            taken = [next(rest) for _ in turn.calls]
        else:
            taken = [] if turn.fault else [Clocks(*timed(call), repeats=1) for call in turn.calls]
        rows.append(turn.row(taken, us))
    fastest = min((row for row in rows if row.us is not None), key=lambda row: row.us or 0.0, default=None)
    return {
        "object": trial.object,
        "triangles": len(trial.mesh.faces),
        "strategy": trial.strategy,
        "device": trial.device,
        "poses": count,
        "hit": found.hit / count,
        "vertices_per_pose": found.vertices / count,
        "polylines_per_pose": found.polylines / count,
        "us": us,
        "us_cpu": 1e6 * ours.cpu / count,
        "us_wall": 1e6 * ours.wall / count,
        "poses_per_second": count / ours.wall,
        "copy_rate": copy_rate,
        "floor_us": 1e6 * floor / count,
        "floor_ratio": ours.wall / floor,
        "peer": fastest.name if fastest else None,
        "peer_ratio": fastest.ratio if fastest else None,
        "result_bytes": found.bytes,
        "peak_bytes": peak,
        "pool_bytes": pool,
        "stages": own.stages(),
        "peers": [asdict(row) for row in rows],
    }


def poses_of(motion: str, name: str, count: int) -> np.ndarray:
    """Random poses, or those of an exploration around the object at 90 Hz; float32, shape [pose, 7]."""
    if motion == "random":
        return random_poses(count)
    bounds = object_of(name).bounds
    return exploration(bounds, count / EXPLORATION_RATE, rate=EXPLORATION_RATE, seed=1, model="around").pose[:count]


def lengths_of(trial: Trial) -> np.ndarray:
    """Lengths of all poses by kind [m], shape [pose, 3]."""
    own = OwnTurn(trial.mesh, trial.hand, trial.pose, trial.stages, trial.device)
    return np.concatenate([batch.lengths() for batch in own()])


def compare(lengths: np.ndarray, known: np.ndarray) -> dict:
    """How far two sets of lengths are apart [m]."""
    apart = np.abs(lengths.sum(axis=1, dtype=np.float64) - known.sum(axis=1, dtype=np.float64))
    return {
        "compared": len(known),
        "apart_max": float(apart.max()),
        "apart_over_1e-5": int((apart > 1e-5).sum()),
        "equal_bits": int((lengths == known).all(axis=1).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=[*OBJECTS, "blob-100k", "blob-1m"], help="built in, or blob-N")
    parser.add_argument("--strategies", nargs="+", default=["oc", "cc"])
    parser.add_argument("--device", default="cpu", help="of palpate; peers run on the CPU")
    parser.add_argument("--poses", type=int, help="of palpate; by default half a second of them, on a GPU 4,000,000")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--peers", nargs="+", default=["all"], help=f"all, none, or of: {' '.join(PEERS)}")
    parser.add_argument("--motion", choices=["random", "exploration"], default="random")
    parser.add_argument("--all-cores", action="store_true", help="compare wall time on all cores")
    parser.add_argument("--save", type=Path, help="write the lengths of all poses")
    parser.add_argument("--compare", type=Path, help="compare with lengths written by --save")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    known, saved = np.load(options.compare) if options.compare else {}, {}
    print(json.dumps(machine_facts(options.device)))
    core = None if options.all_cores else keep_to_one_core()
    found, absent = find_peers(options.peers)
    for name in options.objects:
        for strategy in options.strategies:
            count = options.poses or fitting_poses(object_of(name), strategy, options.device)
            pose = poses_of(options.motion, name, count)
            trial = Trial(name, strategy, pose, options.device, options.repeats, not options.all_cores)
            row = {"core": core, **measure_trial(trial, found, absent)}
            key = f"{name}-{strategy}"
            if options.save:
                saved[key] = lengths_of(trial)
            if key in known:  # as many poses as there: another count draws other poses
                same = Trial(name, strategy, random_poses(len(known[key])), options.device)
                row["against_file"] = compare(lengths_of(same), known[key])
            print(json.dumps(row), flush=True)
    if options.save:
        np.savez_compressed(options.save, **saved)


if __name__ == "__main__":
    main()
