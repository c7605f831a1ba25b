"""Scene: an object, a hand and a strategy, rendered in batches of poses; the raw intersection first, then stages.

| `method_of` | object | hand | raw intersection |
|---|---|---|---|
| cut | mesh | patches | `mesh_section`: exact, along triangles; by winding number if the mesh crosses itself |
| march | voxels, function | patches | `kernels.march`: marching squares on a grid over each patch |
| skin | any | skin | `kernels.skin`: marching triangles over the skin |
| path | any | any | raw "contact": `contact_tour`, a path through the points of the skin that are inside the object |
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import HandMotion
from ...kernels.march.contours import march_patches
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
from ..stages.registry import BY_RAW_KERNELS, find_stage
from ..stages.setting import Setting
from ..strategies.intersection_strategy import IntersectionStrategy, strategy_of
from ..strategies.stage_order import FILLS, SHAPES, TOURS
from ..strategies.stage_runner import run_stages
from ..validation import require_choice, value_text
from .contact_tour import contact_contours
from .mesh_section import intersect, needs_regularising, patches_for
from .named_inputs import motion_of

SECTION_BYTES = 1024  # for a pose and patch: slots of pieces (SLOTS x 72), listed steps (128), events (24 x 8), offsets

SKIN_BYTES = 40  # for a pose and vertex of a hand's skin: its position, sign, marks of its edges


def method_of(solid: Solid, hand: Hand, strategy: IntersectionStrategy) -> str:
    """Raw intersection by the table above; raises StrategyError for a hand that is neither of patches nor of skin."""
    if strategy.raw_stage.name in TOURS:
        return "path"
    if isinstance(hand, MeshHand):
        return "skin"
    if not isinstance(hand, PatchHand):
        raise StrategyError(f"a hand must be a Palm, a PlaneHand or a MeshHand, not {type(hand).__name__}")
    return "cut" if isinstance(solid, MeshObject) else "march"


def with_joined_sides(strategy: IntersectionStrategy, hand: Hand) -> IntersectionStrategy:
    """The strategy, with the stage "joined" added if contours follow the sides of patches that touch.

    A strategy that fills or replaces regions stays as it is, because it needs the whole region of each patch.
    """
    names = [stage.name for stage in strategy.prune_stages]
    whole = any(stage.name in SHAPES + FILLS for stage in strategy.transform_stages)
    if not (isinstance(hand, PlaneHand) and hand.joints and strategy.closes) or whole or "joined" in names:
        return strategy
    after = names.index("outside") + 1
    return replace(strategy, prune=(*strategy.prune[:after], "joined", *strategy.prune[after:]))


def needs_focal_width(strategy: IntersectionStrategy, *, marches: bool) -> bool:
    """Whether the focal width may be used: for a step or an option that is not given, or by a user-defined stage."""
    entries = [(find_stage(role, s.name), s) for role, stages in strategy.stages().items() for s in stages]
    unset = any(s.options.get(key, o.default) is None for entry, s in entries for key, o in entry.options.items())
    return unset or (marches and strategy.step is None) or not all(entry.own for entry, _ in entries)


def require_parts(solid: object, hand: object, strategy: object) -> None:
    """Raise MeshError or StrategyError, naming the constructors, for what is no object, hand or strategy."""
    if not isinstance(solid, Solid):
        kinds = "a MeshObject, a VoxelObject or an ImplicitObject"
        raise MeshError(f"the object must be {kinds}, not {solid!r:.60}; MeshObject.load takes names and files")
    if isinstance(hand, type) or not isinstance(hand, Hand):
        raise StrategyError(
            "the hand must be a Palm, a PlaneHand or a MeshHand, or palm, planes or skin (of a mesh: "
            f"MeshHand(mesh.vertices, mesh.faces)), not {value_text(hand)}"
        )
    if not isinstance(strategy, IntersectionStrategy):
        raise StrategyError(
            "the strategy must be an IntersectionStrategy (load_strategy gives one; of fields: "
            f"IntersectionStrategy(**fields); of several, render each), not {value_text(strategy)}"
        )


def require_points(points: object, *, exact: bool) -> None:
    """Raise StrategyError for an unknown frame of points, and for "patch" unless a mesh is cut and no stage follows."""
    require_choice("points", points, ("array", "patch"))
    if points == "patch" and not exact:
        raise StrategyError(
            'points="patch" is for a mesh on a Palm or PlaneHand without joined patches, raw "section", and no stages '
            'but "outside" and "close": other stages need points in the array\'s frame'
        )


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Consecutive poses of a motion, rendered together on one device."""

    pose: np.ndarray | wp.array
    """Hand frame -> array frame, float32, shape [pose, 7], or wp.transform [pose] on the device."""
    first: int
    """Row of the motion that `pose` begins at."""
    device: str
    """Warp device."""
    point_limit: int | None = None
    """Most points: PointLimitError is raised before memory is allocated for more."""
    timing: dict[str, float] | None = None
    """Takes the seconds of each stage."""

    @property
    def rows(self) -> slice:
        """Rows of the motion."""
        return slice(self.first, self.first + len(self.pose))


@dataclass(frozen=True, eq=False)
class Scene:
    """An object, a hand and a strategy in which every option has a value; it renders poses.

    Make it with `Scene.of`. Several threads may use it at once.

    >>> from palpate.render import ImplicitObject, Palm, Scene, sphere, static_pose
    >>> scene = Scene.of(ImplicitObject(sphere(0.03), at=(0, 0, 0.2)), Palm(), "cc")
    >>> round(1000 * scene.strategy.step, 1)  # [mm], a quarter of the focal width
    2.5
    >>> batch, removed = scene.contours(static_pose([0, 0, 0.2]).pose, first=0, device="cpu")
    >>> batch.length().round(2)  # [m], a circle of radius 0.03
    array([0.19], dtype=float32)
    """

    solid: Solid
    hand: Hand
    strategy: IntersectionStrategy
    """As stored with the result: every option that is scaled by the focal width is a number."""
    object_pose: np.ndarray | None = None
    """Position of the middle of the object's bounds, and its rotation, at each pose, float32, shape [pose, 7]."""
    focal_width: float = 0.0
    """FWHM of p^2 across the focus at the object's middle, or a moving one's median [m]; 0 if nothing uses it."""
    points: str = "array"
    """Frame of written points: "array", the array's, or "patch", relative to the middle of their patch."""

    def __repr__(self) -> str:
        """One line."""
        return f"Scene({self.solid!r}, {self.hand!r}, {self.strategy!r})"

    @classmethod
    def of(
        cls,
        solid: Solid,
        hand: Hand,
        strategy: IntersectionStrategy | str,
        *,
        object_pose: np.ndarray | None = None,
        points: str = "array",
    ) -> Self:
        """Give every option of a strategy a value for this object and hand; object_pose, points: see the fields.

        Raises MeshError where inside and outside of the object must be defined and are not; StrategyError for a
        strategy that this hand cannot have, and if the focal width is needed and no focus can be made at the object.
        """
        strategy = strategy_of(strategy)
        require_parts(solid, hand, strategy)
        strategy = with_joined_sides(strategy, hand)
        method = method_of(solid, hand, strategy)
        marches = method != "cut"
        if strategy.needs_closed or method == "skin":
            solid.require_closed()
            solid = solid.solid_part if isinstance(solid, MeshObject) else solid
        if method == "skin" and not strategy.bounded:
            raise StrategyError('prune: contours on a hand mesh end where the skin does: "outside" cannot be left out')
        scene = cls(solid, hand, strategy, object_pose, points=points)
        require_points(points, exact=scene.is_raw and not marches)
        if scene.is_raw and not marches:
            return scene
        width = 0.0
        if needs_focal_width(strategy, marches=marches):
            place = solid.bounds.mean(axis=0) if object_pose is None else np.median(object_pose[:, :3], axis=0)
            try:
                width = focal_width(place).width
            except StrategyError as error:
                advice = "give the strategy a step= and its stages their lengths, or move the object"
                raise StrategyError(f"{solid.name}: {error}; {advice}") from error
        strategy = strategy.resolved(width or 1.0, marches=marches)  # 1.0: no option is scaled by it
        return replace(scene, strategy=strategy, focal_width=width)

    @cached_property
    def object_centre(self) -> np.ndarray:
        """Point of the placed object whose position `object_pose` gives: the middle of its bounds [m], shape [3]."""
        return np.asarray(self.solid.bounds, np.float64).mean(axis=0)

    @cached_property
    def method(self) -> str:
        """Raw intersection, by the table above: "cut", "march", "skin" or "path"."""
        return method_of(self.solid, self.hand, self.strategy)

    @property
    def _mesh_and_patches(self) -> tuple[MeshObject, PatchHand]:
        """Object and hand of the method "cut"."""
        return cast(MeshObject, self.solid), cast(PatchHand, self.hand)

    @cached_property
    def _warned(self) -> dict[str, object]:
        """Warnings of stages that batches of this scene have given, see `Setting.warn_once`."""
        return {}

    @property
    def step(self) -> float:
        """Grid step of marching [m]."""
        return self.strategy.step or self.focal_width / 4

    @cached_property
    def farthest(self) -> float:
        """Largest coordinate of the poses of an object that moves [m]; 0 for one that stands still."""
        return 0.0 if self.object_pose is None else float(np.abs(self.object_pose[:, :3]).max(initial=0.0))

    @cached_property
    def raw_error(self) -> float | None:
        """Largest distance of the raw intersection from the exact one [m]; None for a path through points.

        For a mesh cut by planes, the spacing of float32 at the largest coordinate that the object has. For grids, one
        step, provided that the solid and the space around it are wider than a step and tips have 20 degrees or more.
        """
        if self.method != "cut":
            return None if self.method == "path" else self.step
        bounds = np.abs(np.asarray(self.solid.bounds, np.float64))
        reach = bounds.max()
        if self.object_pose is not None:
            diagonal = np.linalg.norm(np.ptp(self.solid.bounds, axis=0))
            reach = self.farthest + 0.5 * diagonal
        return float(np.spacing(np.float32(reach)))

    @property
    def pose_bytes(self) -> int:
        """Approximate working memory for a pose [byte]; marching over patches limits its own blocks."""
        if self.method == "skin":
            return SECTION_BYTES + SKIN_BYTES * cast(MeshHand, self.hand).edges_of(self.step).vertex_count
        return SECTION_BYTES * self.hand.patch_count

    @cached_property
    def is_raw(self) -> bool:
        """Whether no stage follows the raw intersection."""
        return all(s.name in BY_RAW_KERNELS for s in (*self.strategy.prune_stages, *self.strategy.transform_stages))

    @property
    def is_cut_plainly(self) -> bool:
        """Whether the raw contours are those in which planes cut a mesh, drawn by kernels alone."""
        return self.method == "cut" and not needs_regularising(self._mesh_and_patches[0])

    def require_poses(self, pose_count: int) -> None:
        """Raise PoseError unless the hand and the object have as many poses as the motion."""
        require_rows(self.hand, pose_count)
        if self.object_pose is not None and len(self.object_pose) != pose_count:
            raise PoseError(f"the object has {len(self.object_pose)} poses, the motion {pose_count}")

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

        Arguments as the fields of `PoseBlock`. The batch is on the device, or on the host if the last stage works
        there. Raises PointLimitError.
        """
        block = PoseBlock(pose, first, device, point_limit, timing)
        batch, removed = self.staged(self.raw_contours(block), block)
        return replace(batch, raw_error=self.raw_error), removed

    def raw_contours(self, block: PoseBlock) -> ContourBatch:
        """Contours of the raw intersection, with the stages that it does itself ("outside", "close") and no other.

        Poses on the device stay there if the hand is rigid and the object does not move. Raises PointLimitError.
        """
        seen = block
        if self.object_pose is not None:
            hand_pose = poses_on_host(block.pose)
            seen = replace(block, pose=seen_from(self.object_pose[block.rows], self.object_centre, hand_pose))
        if self.method == "cut":
            section = sections_on(self.hand, seen.pose, seen.first, seen.device)
            options = {"farthest": self.farthest, "relative": self.points == "patch"}
            limits = {"point_limit": seen.point_limit, "timing": seen.timing}
            batch, _ = intersect(*self._mesh_and_patches, section, self.strategy, **limits, **options)
        else:
            with StageClock(seen.timing, "raw", seen.device):
                batch = ContourBatch.of_sections(ON_GRIDS[self.method](self, seen), self.hand.patch_count)
        if self.object_pose is not None and self.points == "array":  # others are relative to the hand: they stay
            place = wp.array(self.object_pose[block.rows], dtype=wp.transform, device=block.device)
            move_contours(batch.struct, place, self.object_centre)
        return batch

    def staged(self, batch: ContourBatch, block: PoseBlock) -> tuple[ContourBatch, dict[str, np.ndarray]]:
        """Raw contours after the strategy's other stages; returns as `contours`."""
        if self.is_raw:
            return batch, {}
        at = {}
        if self.object_pose is not None:
            at = {"object_pose": self.object_pose[block.rows], "object_centre": self.object_centre}
        where = (poses_on_host(block.pose), block.first, block.device)
        limits = {"point_limit": block.point_limit, "warned": self._warned}
        setting = Setting(self.solid, self.hand, *where, self.focal_width, self.step, **limits, **at)
        with StageClock(block.timing, "stages", block.device):
            return run_stages(batch, self.strategy, setting)

    def _path(self, block: PoseBlock) -> Any:
        """Path through points of the skin that are inside the object."""
        where, options = (poses_on_host(block.pose), block.first), self.strategy.raw_stage.options
        return contact_contours(self.solid, self.hand, *where, device=block.device, step=self.step, **options)

    def _skin(self, block: PoseBlock) -> Any:
        """Section of an object's surface by a hand mesh."""
        hand, first, device = cast(MeshHand, self.hand), block.first, block.device
        return skin_contours(
            self.solid.field_on(device),
            sections_on(hand, block.pose, first, device),
            hand.skin_on(device, self.step),
            hand.vertices_on(device, first, first + len(block.pose)),
            closes=self.strategy.closes,
            bounds=self.solid.bounds,
            limit=block.point_limit,
        )

    def _march(self, block: PoseBlock) -> Any:
        """Section of a field's surface by patches."""
        hand, device = cast(PatchHand, self.hand), block.device
        return march_patches(
            self.solid.field_on(device),
            sections_on(hand, block.pose, block.first, device),
            patches_for(hand, self.solid, self.strategy, device, farthest=self.farthest),
            step=self.step,
            bounds=self.solid.bounds,
            bounded=self.strategy.bounded,
            closes=self.strategy.closes,
            limit=block.point_limit,
        )


ON_GRIDS: dict[str, Callable[[Scene, PoseBlock], Any]] = {
    "path": Scene._path,
    "skin": Scene._skin,
    "march": Scene._march,
}
"""Raw intersections other than "cut", by `Scene.method`."""


def array_points(batch: ContourBatch, hand: Hand, motion: HandMotion | np.ndarray) -> np.ndarray:
    """Points of contours that were rendered with `points="patch"` in the array's frame [m], float64, shape [point, 3].

    batch: on the host, of all poses of the motion; hand, motion: those it was rendered with. float32 holds a point of a
    patch to 4e-9 m, so the result is as exact as the poses are, however far from the array.
    Raises StrategyError for contours that are not in their patches' planes, PoseError for another number of poses.

    >>> from palpate.render import Palm, array_points, render, static_pose
    >>> palm, motion = Palm(), static_pose([0, 0, 0.2])
    >>> batch = render("cube", palm, motion, points="patch")
    >>> batch.points[0], array_points(batch, palm, motion)[0].round(4)
    (array([-0.0425, -0.0425,  0.    ], dtype=float32), array([-0.0425, -0.0425,  0.2   ]))
    """
    pose = motion_of(motion).pose
    if batch.pose_count != len(pose):
        raise PoseError(f"the contours are of {batch.pose_count} poses, the motion has {len(pose)}")
    if batch.points[:, 2].any():
        raise StrategyError('these contours are in the array\'s frame: render them with points="patch"')
    frames = hand.frames(pose)
    row = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    line = np.repeat(np.arange(batch.polyline_count), np.diff(batch.polyline_start))
    own = row[line], batch.polyline_patch[line]
    x = batch.points.astype(np.float64)
    return frames.origin[own] + x[:, :1] * frames.u[own] + x[:, 1:2] * frames.v[own]
