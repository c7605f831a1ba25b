"""Peers: published libraries that cut a mesh by a plane, brought to palpate's output and compared with it.

docs/measured/bench.md has the details.
"""

import os
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import warp as wp
from section_completion import PalmFrames, Polylines, clipped

from palpate.render.hands.hand import Palm
from palpate.render.intersection.mesh_section import intersect
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.strategies.intersection_strategy import IntersectionStrategy

APART = 1e-4  # of a pose's length; what single precision costs in general position
SHIFT = 1e-7  # [m]; single precision puts a plane anywhere in this: what that changes is nobody's mistake
APART_SHARE = 1e-3  # of the poses may differ by more: corners that single precision puts on the other side
LINES_SHARE = 1e-2  # of the poses may have another number of polylines
COUNTED = 4e-6  # [m]; shorter polylines are rounding's
COMPLETION = ("shapely",)  # what completes sections
ONE_THREAD = ("OMP", "OPENBLAS", "MKL", "TBB", "IGL", "NUMEXPR")


class Declined(Exception):
    """A mesh that a peer's interface is not made for."""


class Peer:
    """One library in its best setting: `setup` once a mesh and palm, then `contours` of many poses in one call."""

    name = ""
    packages: tuple[str, ...] = ()
    """Distributions that it needs, the library first."""
    modules: tuple[str, ...] = ()
    """What is imported to see whether it is there."""
    licence = ""
    turn = 0
    """How shells run: 1 counter-clockwise seen from +n, -1 clockwise, 0 either way."""
    rebuilds = False
    """Whether every call prepares the mesh anew, so that only what a further pose costs can be compared."""

    def setup(self, mesh: MeshObject, hand: Palm) -> None:
        """Convert the mesh and build what the library searches in; not part of what a pose costs.

        Raises Declined for a mesh that it is not made for.
        """
        self.hand = hand
        self.vertices, self.faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
        self.prepare()

    def prepare(self) -> None:
        """Make the library's own mesh of `vertices` and `faces`."""
        raise NotImplementedError

    def rings(self, frames: PalmFrames) -> Polylines:
        """Whole sections, closed, in the palms' frames."""
        raise NotImplementedError

    def contours(self, pose: np.ndarray, strategy: IntersectionStrategy) -> Polylines:
        """Contours of poses [pose, 7] as `intersect` gives them, but in the palms' frames."""
        rings = self.rings(PalmFrames.of(pose))
        return clipped(rings, self.hand, closed=strategy.needs_closed, turn=self.turn)

    @property
    def version(self) -> str:
        """Versions of the library and of what completes it."""
        versions = [f"{package} {version(package)}" for package in (*self.packages, *COMPLETION)]
        return ", ".join(versions)


@dataclass(frozen=True)
class Absence:
    """A peer that cannot run here."""

    name: str
    reason: str


def keep_to_one_core() -> int | None:
    """Keep this process to one core, and libraries that are imported later to one thread.

    Gives the core's number, or None where the system cannot.
    """
    os.environ.update({f"{library}_NUM_THREADS": "1" for library in ONE_THREAD} | {"VTK_SMP_MAX_THREADS": "1"})
    if not hasattr(os, "sched_setaffinity"):
        return None
    core = max(os.sched_getaffinity(0))  # interrupts are mostly served by the first
    os.sched_setaffinity(0, {core})
    return core


@dataclass(frozen=True)
class Agreement:
    """How a peer's contours compare with ours, pose by pose."""

    poses: int
    apart: int
    """Poses whose length differs by more than 1e-4 of it and more than what 1e-7 m of the plane's place changes."""
    apart_most: float
    """Largest difference of lengths, relative to ours (of poses longer than 1 mm)."""
    lines_apart: int
    """Poses with another number of polylines longer than 4 um."""

    @property
    def agrees(self) -> bool:
        """Whether it is the same output: at most 0.1 % of the poses apart, 1 % in their number of polylines."""
        return self.apart <= APART_SHARE * self.poses and self.lines_apart <= LINES_SHARE * self.poses

    def text(self) -> str:
        """One sentence."""
        return (
            f"{self.apart} of {self.poses} poses differ in length (most: {self.apart_most:.2g} of it), "
            f"{self.lines_apart} in their number of polylines"
        )


def compare_contours(
    found: Polylines, mesh: MeshObject, hand: Palm, pose: np.ndarray, strategy: IntersectionStrategy
) -> Agreement:
    """Compare a peer's contours of poses [pose, 7] with ours on the CPU."""
    ours, counts = _own_contours(mesh, hand, pose, strategy)
    spread = np.zeros(len(pose))
    normal = PalmFrames.of(pose).axes[:, 2]
    for step in (-SHIFT, SHIFT):
        moved = pose.copy()
        moved[:, :3] += (step * normal).astype(np.float32)
        spread = np.maximum(spread, np.abs(_own_contours(mesh, hand, moved, strategy)[0] - ours))
    difference = np.abs(found.lengths(len(pose)) - ours)
    long = ours > 1e-3
    return Agreement(
        poses=len(pose),
        apart=int((difference > APART * ours + spread).sum()),
        apart_most=float((difference[long] / ours[long]).max(initial=0.0)),
        lines_apart=int((found.counts(len(pose), longer_than=COUNTED) != counts).sum()),
    )


def _own_contours(
    mesh: MeshObject, hand: Palm, pose: np.ndarray, strategy: IntersectionStrategy
) -> tuple[np.ndarray, np.ndarray]:
    """Length [m] and number of polylines longer than 4 um, both of shape [pose]."""
    batch = intersect(mesh, hand, wp.array(pose, dtype=wp.transform, device="cpu"), strategy)[0].numpy()
    owner = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    flat = Polylines(batch.points.astype(np.float64), batch.polyline_start, owner)
    return flat.lengths(len(pose)), flat.counts(len(pose), longer_than=COUNTED)


def check_peer(peer: Peer, mesh: MeshObject, hand: Palm, pose: np.ndarray, strategy: IntersectionStrategy) -> Agreement:
    """Compare the contours of a peer that is set up with ours."""
    return compare_contours(peer.contours(pose, strategy), mesh, hand, pose, strategy)
