"""One batch of poses in one go: the raw intersection of an object with a hand, then a strategy's stages.

| object | hand | raw intersection |
|---|---|---|
| mesh | patches | kernels.find, close, draw: exact, from triangle to triangle |
| mesh that crosses itself | patches | kernels.plane_loops, render.section_regularisation: by its winding number |
| voxels, function | patches | kernels.march: marching squares on a grid over each patch |
| any | skin | kernels.skin: marching triangles over the skin |
| any, raw "contact" | any | render.contact: points of skin inside the object, and a path through them |
| any, raw "overlap" | given as a solid | render.overlap: the surface of what both share, and a path over it |
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import warp as wp

from ...kernels.march.contours import march_patches
from ...kernels.section.contour_writing import Contours
from ...kernels.skin.curves import skin_contours
from ...kernels.stages.move import move_contours
from ..contour_batch import ContourBatch
from ..errors import MeshError, PoseError, StrategyError
from ..focal_spot import focal_width
from ..hands.hand import Hand, PatchHand, poses_on_host, require_rows, sections_on
from ..hands.mesh_hand import MeshHand
from ..hands.plane_hand import PlaneHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.moving_object import seen_from
from ..objects.solid import Solid
from ..runtime.stage_timing import StageClock
from ..stages.registry import BY_RAW_KERNELS, Setting, Stage, find_stage
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.stage_order import FILLS, SHAPES, TOURS
from ..strategies.stage_runner import run_stages
from ..validation import require_choice
from .contact_tour import contact_contours
from .mesh_section import intersect, needs_regularising, tally_intersection
from .overlap_tour import overlap_contours
from .resting import farthest_of, patches_for

SECTION_BYTES = 1024  # of a pose and patch: slots of pieces (SLOTS x 88), events (24 x 8), counts and offsets

SKIN_BYTES = 40  # of a pose and vertex of a hand's skin: its place, sign, marks of its edges


def is_exact(thing: Solid, hand: Hand, strategy: IntersectionStrategy) -> bool:
    """Whether the raw intersection needs no grid: a mesh, planes, and their section."""
    return isinstance(thing, MeshObject) and isinstance(hand, PatchHand) and strategy.raw_stage.name == "section"


def with_joined_sides(strategy: IntersectionStrategy, hand: Hand) -> IntersectionStrategy:
    """The strategy with the stage "joined" for a hand whose patches touch, where contours follow their sides.

    Not where regions are filled or replaced afterwards: those of each patch are needed whole.
    """
    names = [stage.name for stage in strategy.prune_stages]
    whole = any(stage.name in SHAPES + FILLS for stage in strategy.transform_stages)
    if not (isinstance(hand, PlaneHand) and hand.joints and strategy.closes) or whole or "joined" in names:
        return strategy
    after = names.index("outside") + 1
    return replace(strategy, prune=(*strategy.prune[:after], "joined", *strategy.prune[after:]))


def needs_focal_width(strategy: IntersectionStrategy, *, marches: bool) -> bool:
    """Whether something may be scaled by the focal width: a step or an option not given, or a user's own stage."""
    entries = [(find_stage(role, s.name), s) for role, stages in strategy.stages().items() for s in stages]
    unset = any(s.options.get(key, o.default) is None for entry, s in entries for key, o in entry.options.items())
    return unset or (marches and strategy.step is None) or not all(entry.own for entry, _ in entries)


def require_parts(thing: object, hand: object, strategy: object) -> None:
    """Refuse what is no object, hand or strategy, with what makes one."""
    if not isinstance(thing, Solid):
        kinds = "a MeshObject, a VoxelObject or an ImplicitObject"
        raise MeshError(f"the object must be {kinds}, not {thing!r:.60}; MeshObject.load takes names and files")
    if not isinstance(hand, Hand):
        raise StrategyError(f"the hand must be a Palm, a PlaneHand or a MeshHand, not {hand!r:.60}")
    if not isinstance(strategy, IntersectionStrategy):
        raise StrategyError(
            f"the strategy must be an IntersectionStrategy (load_strategy gives one), not {strategy!r:.60}"
        )


def require_points(points: object, *, exact: bool) -> None:
    """Refuse a frame of points that is unknown, and "patch" where points are not the raw intersection's of a mesh."""
    require_choice("points", points, ("array", "patch"))
    if points == "patch" and not exact:
        raise StrategyError(
            'points="patch" is for a mesh on a Palm or PlaneHand without joined patches, raw "section", and no stages '
            'but "outside" and "close": other stages need points in the array\'s frame'
        )


@dataclass(frozen=True, eq=False)
class Scene:
    """An object, a hand and a strategy whose every number is settled: what renders poses.

    Make it with `Scene.of`. It may be used by several threads at once.
    """

    thing: Solid
    hand: Hand
    strategy: IntersectionStrategy
    """As stored with the result: no option is left to be scaled by the focal width."""
    moved: np.ndarray | None = None
    """Where the middle of the object's bounds is at each pose, and how it is turned, float32, shape [pose, 7]."""
    focal_width: float = 0.0
    """FWHM of p^2 across the focus at the object's middle, or a moving one's median [m]; 0 if nothing asks for it."""
    points: str = "array"
    """Where points are written: "array", in the array's frame, or "patch", relative to the middle of their patch."""

    @classmethod
    def of(
        cls,
        thing: Solid,
        hand: Hand,
        strategy: IntersectionStrategy,
        *,
        moved: np.ndarray | None = None,
        points: str = "array",
    ) -> Self:
        """Settle a strategy for an object and a hand; points: see the field.

        Raises MeshError where inside and outside of the object must be defined and are not; StrategyError for a
        strategy that this hand cannot have, and where the focal width is needed at a place where there is no focus.
        """
        require_parts(thing, hand, strategy)
        strategy = with_joined_sides(strategy, hand)
        marches = not is_exact(thing, hand, strategy)
        if strategy.needs_closed or isinstance(hand, MeshHand):
            thing.require_closed()
            thing = thing.solid_part if isinstance(thing, MeshObject) else thing
        if isinstance(hand, MeshHand) and not strategy.bounded and strategy.raw_stage.name == "section":
            raise StrategyError('prune: contours on a hand mesh end where the skin does: "outside" cannot be left out')
        stages = (*strategy.prune_stages, *strategy.transform_stages)
        raw_only = all(stage.name in BY_RAW_KERNELS for stage in stages)
        require_points(points, exact=not marches and raw_only)
        if not marches and raw_only:
            return cls(thing, hand, strategy, moved, points=points)
        width = 0.0
        if needs_focal_width(strategy, marches=marches):
            place = thing.bounds.mean(axis=0) if moved is None else np.median(moved[:, :3], axis=0)
            try:
                width = focal_width(place).width
            except StrategyError as error:
                way = "give the strategy a step= and its stages their lengths, or move the object"
                raise StrategyError(f"{thing.name}: {error}; {way}") from error
        return cls(thing, hand, strategy.resolved(width or 1.0, marches=marches), moved, width)  # 1.0: scales nothing

    @cached_property
    def pivot(self) -> np.ndarray:
        """What of the object `moved` tells the place of: the middle of its bounds [m]."""
        return np.asarray(self.thing.bounds, np.float64).mean(axis=0)

    @cached_property
    def exact(self) -> bool:
        """Whether a mesh is cut by planes, from triangle to triangle."""
        return is_exact(self.thing, self.hand, self.strategy)

    @property
    def step(self) -> float:
        """Grid step of marching [m]."""
        return self.strategy.step or self.focal_width / 4

    @cached_property
    def raw_error(self) -> float | None:
        """How far the raw intersection can be from the exact one [m]; None for a path through points.

        A mesh cut by planes: the spacing of float32 at the largest coordinate that the object has. Grids: a step,
        where the solid, and what is around it, is wider than a step, and at tips of 20 degrees or more.
        """
        if self.strategy.raw_stage.name in TOURS:
            return None
        if not self.exact:
            return self.step
        bounds = np.abs(np.asarray(self.thing.bounds, np.float64))
        reach = bounds.max()
        if self.moved is not None:
            reach = np.abs(self.moved[:, :3]).max(initial=0.0) + 0.5 * np.linalg.norm(np.ptp(self.thing.bounds, axis=0))
        return float(np.spacing(np.float32(reach)))

    @property
    def pose_bytes(self) -> int:
        """Working memory that a pose takes, roughly [byte]; marching over patches keeps to blocks of its own."""
        if isinstance(self.hand, MeshHand) and self.strategy.raw_stage.name == "section":
            return SECTION_BYTES + SKIN_BYTES * self.hand.edges_of(self.step).vertex_count
        return SECTION_BYTES * self.hand.patch_count

    def require_poses(self, pose_count: int) -> None:
        """Raise PoseError unless the hand and the object have as many poses as the motion."""
        require_rows(self.hand, pose_count)
        if self.moved is not None and len(self.moved) != pose_count:
            raise PoseError(f"the object has {len(self.moved)} poses, the motion {pose_count}")

    def contours(
        self,
        pose: np.ndarray | wp.array,
        first: int,
        device: str,
        *,
        point_limit: int | None = None,
        timing: dict[str, float] | None = None,
    ) -> tuple[ContourBatch, dict[str, np.ndarray]]:
        """Contours of one batch of poses, and the length that each prune stage removed [m], float32 [pose], by name.

        pose: float32, shape [pose, 7], or wp.transform [pose] on the device: rows `first`.. of the motion. The batch is
        on the device, or on the host if the last stage left it there. Raises PointLimitError before memory is taken for
        more points than `point_limit`.
        """
        batch = self.raw_contours(pose, first, device, point_limit=point_limit, timing=timing)
        staged, removed = self.staged(batch, pose, first, device, timing=timing)
        return replace(staged, raw_error=self.raw_error), removed

    def raw_contours(
        self,
        pose: np.ndarray | wp.array,
        first: int,
        device: str,
        *,
        point_limit: int | None = None,
        timing: dict[str, float] | None = None,
    ) -> ContourBatch:
        """What the raw intersection gives, ended at patches' sides and closed if the strategy says so: no other stage.

        Arguments as for `contours`. Poses on the device stay there for a rigid hand and an object that does.
        """
        if self.moved is None:
            return self._raw(pose, first, device, point_limit, timing)
        moved = self._moved_at(first, len(pose))
        batch = self._raw(seen_from(moved, self.pivot, poses_on_host(pose)), first, device, point_limit, timing)
        if self.points == "patch":
            return batch  # relative to what moves along
        place = wp.array(moved, dtype=wp.transform, device=device)
        move_contours(batch.points, batch.polyline_start, batch.pose_start, place, self.pivot)
        return batch

    @property
    def is_drawn_to_measure(self) -> bool:
        """Whether lengths are known of points only; else `tally` tells them."""
        crosses = isinstance(self.thing, MeshObject) and needs_regularising(self.thing)
        return crosses or not (self.exact and self.is_raw and self.moved is None)

    def tally(
        self,
        pose: np.ndarray | wp.array,
        first: int,
        device: str,
        value: wp.array,
        length: wp.array,
        *,
        timing: dict[str, float] | None = None,
    ) -> None:
        """Measure a batch of poses and draw nothing, see `tally_intersection`; not where points are needed."""
        if not (isinstance(self.thing, MeshObject) and isinstance(self.hand, PatchHand)) or self.is_drawn_to_measure:
            raise StrategyError(
                "only raw contours of a simple mesh that stands still, on patches, are measured undrawn"
            )
        section = sections_on(self.hand, pose, first, device)
        tally_intersection(self.thing, self.hand, section, self.strategy, value, length, timing=timing)

    def staged(
        self,
        batch: ContourBatch,
        pose: np.ndarray | wp.array,
        first: int,
        device: str,
        *,
        timing: dict[str, float] | None = None,
    ) -> tuple[ContourBatch, dict[str, np.ndarray]]:
        """What the stages behind the raw intersection make of what that gave; see `contours`."""
        if self.is_raw:
            return batch, {}
        at = {} if self.moved is None else {"moved": self._moved_at(first, len(pose)), "pivot": self.pivot}
        setting = Setting(self.thing, self.hand, poses_on_host(pose), first, device, self.focal_width, self.step, **at)
        with StageClock(timing, "stages", device):
            return run_stages(batch, self.strategy, setting)

    def _moved_at(self, first: int, count: int) -> np.ndarray:
        """Where the object is at some of the poses."""
        return np.zeros((0, 7), np.float32) if self.moved is None else self.moved[first : first + count]

    @cached_property
    def is_raw(self) -> bool:
        """Whether nothing follows the raw intersection."""
        return all(s.name in BY_RAW_KERNELS for s in (*self.strategy.prune_stages, *self.strategy.transform_stages))

    def _raw(
        self, pose: np.ndarray | wp.array, first: int, device: str, limit: int | None, timing: dict[str, float] | None
    ) -> ContourBatch:
        raw, hand = self.strategy.raw_stage, self.hand
        if isinstance(self.thing, MeshObject) and isinstance(hand, PatchHand) and self.exact:
            section = sections_on(hand, pose, first, device)
            at = {"farthest": farthest_of(self.moved), "relative": self.points == "patch"}
            return intersect(self.thing, hand, section, self.strategy, point_limit=limit, timing=timing, **at)[0]
        with StageClock(timing, "raw", device):
            return ContourBatch.from_device(self._marched(raw, pose, first, device, limit), hand.patch_count)

    def _marched(self, raw: Stage, pose: np.ndarray | wp.array, first: int, device: str, limit: int | None) -> Contours:
        thing, hand, strategy = self.thing, self.hand, self.strategy
        if raw.name in TOURS:
            contours = contact_contours if raw.name == "contact" else overlap_contours
            return contours(thing, hand, poses_on_host(pose), first, device=device, step=self.step, **raw.options)
        section = sections_on(hand, pose, first, device)
        solid, bounds = thing.field_on(device), thing.bounds
        if isinstance(hand, MeshHand):
            vertex, skin = hand.vertices_on(device, first, first + len(pose)), hand.skin_on(device, self.step)
            return skin_contours(solid, section, skin, vertex, closes=strategy.closes, bounds=bounds, limit=limit)
        if not isinstance(hand, PatchHand):
            raise StrategyError(f"a hand must be a Palm, a PlaneHand or a MeshHand, not {type(hand).__name__}")
        return march_patches(
            solid,
            section,
            patches_for(hand, thing, strategy, device, farthest=farthest_of(self.moved)),
            step=self.step,
            bounds=bounds,
            bounded=strategy.bounded,
            closes=strategy.closes,
            limit=limit,
        )
