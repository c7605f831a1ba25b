"""Peers take their turns: set up, checked against ours, then timed with as many poses as a repetition allows."""

from dataclasses import dataclass, field
from functools import partial
from time import perf_counter

import numpy as np

from ..hands.hand import Palm
from ..objects.mesh.solid_mesh import MeshObject
from ..strategies.intersection_strategy import IntersectionStrategy, load_strategy
from .clocks import Call, Clocks, fitting_count, timed
from .peers import Absence, Agreement, Declined, Peer, check_peer

POSES_LEAST, POSES_MOST = 10, 1_000
PROBE_POSES = 20  # that tell what a peer costs
CHECK_POSES = 500
ONCE_SECONDS = 3.0  # a peer whose shortest repetition takes longer is timed once


@dataclass(frozen=True)
class BenchOptions:
    """How rows are measured."""

    device: str = "cpu"
    poses: int | None = None
    """Of ours; None: as many as take `seconds`."""
    motion: str = "random"
    repeats: int = 7
    seconds: float = 0.5
    """Of one repetition of ours, and twice that of a peer's."""
    one_core: bool = True
    """Compare CPU time on one core instead of wall time on all."""

    @property
    def clock(self) -> str:
        """Which clock ours is compared by: a GPU's work takes no CPU time."""
        return "cpu" if self.one_core and self.device == "cpu" else "wall"


@dataclass(frozen=True)
class Trial:
    """What everyone is given: an object, a strategy, poses."""

    object: str
    mesh: MeshObject
    strategy: str
    pose: np.ndarray
    """float32, shape [pose, 7]."""
    options: BenchOptions
    hand: Palm = field(default_factory=Palm)

    @property
    def stages(self) -> IntersectionStrategy:
        """The strategy that the name stands for."""
        return load_strategy(self.strategy)

    def spread(self, count: int) -> np.ndarray:
        """So many poses, evenly from all: the first ones of an exploration would be one visit."""
        return self.pose[np.linspace(0, len(self.pose) - 1, min(count, len(self.pose))).astype(int)]


@dataclass(frozen=True)
class PeerRow:
    """What one peer took."""

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
    repeats: int = 0
    us: float | None = None
    """A pose [us]: CPU time where one core is compared, else wall time."""
    us_cpu: float | None = None
    us_wall: float | None = None
    ratio: float | None = None
    """Its time over ours."""
    agreement: Agreement | None = None

    @classmethod
    def absent(cls, absence: Absence) -> "PeerRow":
        """A peer that is not here."""
        return cls(absence.name, "absent", absence.reason)


class PeerTurn:
    """One peer in one trial."""

    def __init__(self, peer: Peer, trial: Trial) -> None:
        self.peer, self.trial = peer, trial
        self.agreement: Agreement | None = None
        self.fault: tuple[str, str] | None = None
        """State and note, if it cannot be timed."""
        self.setup_seconds = 0.0
        self.poses = 0
        self._cost = 0.0
        try:
            self._prepare()
        except Declined as error:
            self.fault = "declined", str(error)
        except Exception as error:  # a fault of a library's is that library's row, not the end of the table
            self.fault = "failed", f"{type(error).__name__}: {error}"

    def _prepare(self) -> None:
        peer, trial, probe = self.peer, self.trial, self.trial.spread(PROBE_POSES)
        started = perf_counter()
        peer.setup(trial.mesh, trial.hand)
        self.setup_seconds = perf_counter() - started
        peer.contours(probe[:1], trial.stages)  # whatever a first call loads
        first = timed(self._call(probe[:1]))[0]
        self._cost = timed(self._call(probe))[0] / len(probe)
        seconds = 2 * trial.options.seconds
        if peer.rebuilds and len(probe) > 1:
            self._cost = max(self._cost * len(probe) - first, 1e-7) / (len(probe) - 1)
            seconds = max(seconds, first)
        self.poses = min(len(trial.pose), fitting_count(self._cost, seconds, POSES_LEAST, POSES_MOST))
        sample = trial.spread(max(PROBE_POSES, min(self.poses, CHECK_POSES)))
        self.agreement = check_peer(peer, trial.mesh, trial.hand, sample, trial.stages)
        if not self.agreement.agrees:
            self.fault = "disagrees", f"not the same contours: {self.agreement.text()}"

    def _call(self, pose: np.ndarray) -> Call:
        return partial(self.peer.contours, pose, self.trial.stages)

    @property
    def repeated(self) -> bool:
        """Whether it is quick enough to take turns."""
        return self.fault is None and (self.peer.rebuilds or self._cost * self.poses <= ONCE_SECONDS)

    @property
    def calls(self) -> list[Call]:
        """What is timed: all its poses; where every call prepares the mesh anew, one pose too, to be subtracted."""
        part = self.trial.spread(self.poses)
        return [self._call(part)] + ([self._call(part[:1])] if self.peer.rebuilds and self.poses > 1 else [])

    def row(self, clocks: list[Clocks], ours: float) -> PeerRow:
        """The result, from the clocks of `calls` and our own time a pose [us]."""
        if self.fault:
            state, note = self.fault
            return PeerRow(agreement=self.agreement, **self._cells(state, note))
        state, note = ("timed", "") if self.repeated else ("once", f"timed once, {clocks[0].wall:.3g} s")
        cpu, wall, count = clocks[0].cpu, clocks[0].wall, self.poses
        if len(clocks) == 2:
            cpu, wall, count = max(cpu - clocks[1].cpu, 0.0), max(wall - clocks[1].wall, 0.0), count - 1
            note = "cost of a further pose, since every call prepares the mesh anew"
        us = 1e6 * (cpu if self.trial.options.one_core else wall) / count
        return PeerRow(
            **self._cells(state, note),
            setup_seconds=self.setup_seconds,
            call_seconds=clocks[1].wall if len(clocks) == 2 else None,
            poses=self.poses,
            repeats=clocks[0].repeats,
            us=us,
            us_cpu=1e6 * cpu / count,
            us_wall=1e6 * wall / count,
            ratio=us / ours,
            agreement=self.agreement,
        )

    def _cells(self, state: str, note: str) -> dict[str, str]:
        peer = self.peer
        return {"name": peer.name, "state": state, "note": note, "version": peer.version, "licence": peer.licence}


def timed_once(turn: PeerTurn) -> list[Clocks]:
    """Clocks of a turn that is not repeated."""
    return [Clocks(*timed(call), repeats=1) for call in turn.calls]
