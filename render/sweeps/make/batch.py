"""Which poses a worker renders together: portions of recipes, cut to batches that fit the memory.

How they are cut changes no bit of a result: batches hold whole spans, and a part that is cut goes on in the next batch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from ....kernels.offsets import PointLimitError
from ...intersection.batch_rendering import CPU_SPAN_BYTES, POINT_BYTES
from ...sampling.contour_sampling import SamplingStrategy
from ..plan.recipe import WHOLE_GROUPS, Recipe
from .metrics import Measured
from .rendering import Rendering, sampling_of
from .task import PART, SPAN, Piece

GPU_POSES = 128 * PART  # of a batch: 16 M, if the memory has room; launches and waits cost less than 2 % then
GPU_SHARE = 8  # of a GPU's memory, a batch's working arrays take one part in so many
POINTS_A_POSE = 32  # supposed, until a batch tells otherwise by not fitting

Samplings = dict[str, tuple[SamplingStrategy, ...]]
"""By rendering."""


@dataclass(eq=False)
class Want:
    """A group of a part that is asked for."""

    sampling: SamplingStrategy | None
    """None where contours are all that it needs."""
    pieces: set[int] = field(default_factory=set)
    """Who asks."""


@dataclass(eq=False)
class Portion:
    """A part of a rendering that is to be made."""

    rendering: Rendering
    part: int
    wanted: dict[tuple[str, str], Want] = field(default_factory=dict)
    """By group and key."""
    measured: Measured | None = None
    """Of the poses rendered so far."""
    columns: list[tuple[dict[str, np.ndarray], ...]] = field(default_factory=list)

    @property
    def stop(self) -> int:
        """The pose after its last."""
        return min((self.part + 1) * PART, self.rendering.poses.count)

    @property
    def pieces(self) -> set[int]:
        """Who asks for any of it."""
        return set().union(*(want.pieces for want in self.wanted.values()))

    @property
    def per_pose(self) -> bool:
        """Whether a row a pose is asked for."""
        return any(group == "poses" for group, _ in self.wanted)


@dataclass(frozen=True)
class Stretch:
    """Poses of a portion that are rendered in one batch."""

    portion: Portion
    first: int
    stop: int

    @property
    def count(self) -> int:
        """Number of poses."""
        return self.stop - self.first


def plan_portions(
    portions: dict[tuple[str, int], Portion], number: int, piece: Piece, recipe: Recipe, rendering: Rendering
) -> None:
    """Add what a piece asks for of the groups that are made part by part."""
    groups = [group for group in piece.groups if group not in WHOLE_GROUPS]
    if not groups:
        return
    sampled = any(group != "contours" for group in groups)
    sampling = sampling_of(recipe.sampling) if sampled else None
    for part in range(piece.first, min(piece.stop, -(-rendering.poses.count // PART))):
        portion = portions.setdefault((rendering.key, part), Portion(rendering, part))
        for group in groups:
            want = Want(None if group == "contours" else sampling)
            portion.wanted.setdefault((group, recipe.key(group)), want).pieces.add(number)


def samplings_of(portions: Sequence[Portion]) -> Samplings:
    """How each rendering is sampled, for all of its portions alike: they go on from batch to batch."""
    out: Samplings = {}
    for portion in portions:
        key = portion.rendering.key
        own = [want.sampling for want in portion.wanted.values() if want.sampling is not None]
        out[key] = tuple(dict.fromkeys((*out.get(key, ()), *own)))
    return out


def joined_stretches(stretches: Sequence[Stretch], by: Callable[[Portion], object]) -> list[Stretch]:
    """Stretches, those that follow each other in what `by` tells of their portions as one, of the first's portion."""
    out: list[Stretch] = []
    for stretch in stretches:
        last = out[-1] if out else None
        if last and last.stop == stretch.first and by(last.portion) is by(stretch.portion):
            out[-1] = Stretch(last.portion, last.first, stretch.stop)
        else:
            out.append(stretch)
    return out


def mended(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Stretches with those of one portion as one: a batch has one of a portion at most."""
    return joined_stretches(stretches, lambda portion: portion)


def take_batch(left: Sequence[Stretch], capacity: int) -> tuple[list[Stretch], list[Stretch]]:
    """Stretches of up to `capacity` poses, the last one cut between spans, and what is left."""
    batch: list[Stretch] = []
    room = capacity
    for k, stretch in enumerate(left):
        if stretch.count > room:
            cut = stretch.first + spans_below(room)
            if cut > stretch.first:
                batch.append(Stretch(stretch.portion, stretch.first, cut))
                stretch = Stretch(stretch.portion, cut, stretch.stop)  # the rest of the same one
            return batch, [stretch, *left[k + 1 :]]
        batch.append(stretch)
        room -= stretch.count
    return batch, []


def poses_of(batch: Sequence[Stretch], device: str) -> np.ndarray | wp.array:
    """Poses of all stretches, one after the other: on the host if all are there, else on the device."""
    rows = [
        s.portion.rendering.poses.rows(s.first, s.stop, device) for s in joined_stretches(batch, lambda p: p.rendering)
    ]
    if len(rows) == 1:
        return rows[0]
    if all(isinstance(part, np.ndarray) for part in rows):
        return np.concatenate(rows)
    out = wp.empty(sum(len(part) for part in rows), dtype=wp.transform, device=device)
    at = 0
    for part in rows:
        source = wp.array(part, dtype=wp.transform, device=device) if isinstance(part, np.ndarray) else part
        wp.copy(out, source, dest_offset=at, count=len(part))
        at += len(part)
    return out


def spans_below(count: int) -> int:
    """Poses of as many whole spans as `count` has."""
    return count // SPAN * SPAN


def batch_bytes(device: str) -> int:
    """Working memory of a batch [byte]."""
    place = wp.get_device(device)
    return CPU_SPAN_BYTES if place.is_cpu else place.total_memory // GPU_SHARE


def batch_capacity(pose_bytes: int, device: str) -> int:
    """Poses of a batch, one span at least: what the memory has room for, of contours of POINTS_A_POSE points."""
    fitting = batch_bytes(device) // (pose_bytes + POINT_BYTES * POINTS_A_POSE)
    return max(SPAN, spans_below(fitting if wp.get_device(device).is_cpu else min(fitting, GPU_POSES)))


def point_limit(device: str) -> int:
    """Points of a batch of more than one span."""
    return batch_bytes(device) // POINT_BYTES


def is_too_large(error: Exception) -> bool:
    """Whether a smaller batch may do: too many points, or no memory for them."""
    is_allocation = isinstance(error, RuntimeError) and "allocate" in str(error)
    return isinstance(error, PointLimitError | MemoryError) or is_allocation
