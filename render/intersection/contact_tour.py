"""Raw "contact": skin inside the object as points, and a short path through them.

After Maunsbach et al. 2024 (MAMMOTH): points of the hand's skin inside an object, thinned to 8 mm, a 2-opt path. Here
the path's true length counts, it closes, and a small contact is drawn as well as a large one.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import warp as wp

from ...kernels.contours import with_columns
from ...kernels.skin.sign import Posed
from ...kernels.tours.nodes import (
    Nodes,
    inside_nodes,
    inside_vertices,
    list_nodes,
    nodes_of_pose,
    outlined_nodes,
    thin_nodes,
)
from ...kernels.tours.tour import POINTS_MOST, TooManyPointsError, separation_that_fits, thin_points, tour_points
from ..errors import MeshError, StrategyError
from ..hands.hand import Hand, PatchHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..strategies.intersection_strategy import IntersectionStrategy
from ..user_warnings import warn_user
from ..validation import is_number, number_text
from .mesh_section import intersect

LARGEST = float(np.finfo(np.float64).max)
SEPARATION = 0.008  # [m]; MAMMOTH's
CLOSED = IntersectionStrategy(prune=("outside",), transform=("close",))
NODES_MOST = 1 << 22  # points of skin that are looked at in one go: up to 30 bytes each
GPU_FACTOR = 8  # so many times more on a GPU, where launches for few poses take longer than what they compute


def contact_contours(
    solid: Solid,
    hand: Hand,
    pose: np.ndarray,
    first: int = 0,
    *,
    device: str = "cpu",
    step: float,
    separation: float = SEPARATION,
    closes: bool = True,
) -> Any:
    """One polyline a pose, of kind MADE, through points of skin inside the object.

    pose: hand frame -> array frame, float32, shape [pose, 7], rows `first`.. of the motion.
    step: between the points that are looked at on a patch, or the longest edge of a hand mesh [m]; separation: least
    distance of those that stay [m]; closes: back to the first.
    Where only one point would stay, the one farthest from it stays, too. A pose with no more than one point inside
    stays empty; these are counted in a PalpateWarning.
    Raises StrategyError for a step or separation that is not positive or too small, and for a pose that keeps more than
    2,000 points; MeshError for an object without an inside.
    """
    require_length("contact: step", step)
    require_length("contact: separation", separation)
    try:
        solid.require_closed()
    except MeshError as error:
        raise MeshError(f'raw "contact" needs an object with an inside: {error}') from error
    pose = np.asarray(pose, np.float32).reshape(-1, 7)
    skin = _Skin(solid, hand, device, step)
    parts = []
    nodes_most = NODES_MOST * (GPU_FACTOR if wp.get_device(device).is_cuda else 1)
    size = max(1, nodes_most // max(skin.point_count, 1))
    try:
        for begin in range(0, len(pose), size):
            rows = slice(begin, min(begin + size, len(pose)))
            parts.append(skin.thinned_inside(pose[rows], first + begin, separation))
        point, start = joined_points(parts, device)
        return toured(point, start, closes=closes, patch_count=hand.patch_count)
    except (MeshError, StrategyError):
        raise
    except ValueError as error:
        raise StrategyError(f"contact: {error}") from error


def require_length(name: str, value: Any) -> None:
    """Raise StrategyError unless a value is a positive, finite length [m]."""
    if not is_number(value) or not 0.0 < value <= LARGEST:
        raise StrategyError(f"{name} must be a positive length in metres, not {number_text(value)}")


def is_outlined(solid: Solid) -> bool:
    """Whether the closed contours in which planes cut an object are simple, and all of it: they show what is inside."""
    return isinstance(solid, MeshObject) and solid.is_simple and not solid.report.sheet_faces


class _Skin:
    """A hand's skin as points, whichever kind of hand it is."""

    def __init__(self, solid: Solid, hand: Hand, device: str, step: float) -> None:
        self.solid, self.device, self.step = solid, device, step
        self.hand: Any = hand  # a PatchHand or a MeshHand
        self.patch: Any = hand.on(device) if isinstance(hand, PatchHand) else None
        if self.patch is not None:
            sides = 2.0 * self.patch.numpy()["half"].reshape(-1, 2)
            self.point_count = int(np.prod(sides / step + 2.0, axis=1).sum())
        else:
            self.skin = self.hand.skin_on(device, step)
            self.point_count = self.skin.vertex_count

    def inside(self, pose: np.ndarray, first: int) -> tuple[wp.array, wp.array]:
        """Points inside the object at poses first.., and where each pose's start."""
        if self.patch is not None:
            return list_nodes(self.nodes(pose, first))
        vertex = self.hand.vertices_on(self.device, first, first + len(pose))
        posed = Posed(self._sections(pose, first), self.skin, vertex)
        return inside_vertices(self.solid.field_on(self.device), posed, self.solid.bounds)

    def nodes(self, pose: np.ndarray, first: int) -> Nodes:
        """Nodes of patches inside the object at poses first..."""
        section = self._sections(pose, first)
        if not is_outlined(self.solid):
            field = self.solid.field_on(self.device)
            return inside_nodes(field, section, self.patch, step=self.step, bounds=self.solid.bounds)
        cut, _ = intersect(cast(MeshObject, self.solid), self.hand, section, CLOSED)
        return outlined_nodes(cut.struct, section, self.patch, step=self.step)

    def thinned_inside(self, pose: np.ndarray, first: int, separation: float) -> tuple[wp.array, wp.array]:
        """Thinned points inside the object, and where each pose's start; raises as `thinned`."""
        if self.patch is None or self.hand.patch_count > 1:
            return thinned(*self.inside(pose, first), separation=separation, first=first)
        nodes = self.nodes(pose, first)
        thin, count = thin_nodes(nodes, separation=separation)
        over = np.flatnonzero(count.numpy() > POINTS_MOST)
        if len(over):
            own = nodes_of_pose(nodes, row := int(over[0]))
            raise too_many(
                f"contact: pose {first + row}",
                list_nodes(own)[0].shape[0],
                separation,
                lambda wider: thin_nodes(own, separation=wider)[1].numpy()[0] <= POINTS_MOST,
            )
        return list_nodes(thin)

    def _sections(self, pose: np.ndarray, first: int) -> wp.array:
        poses = self.hand.section_poses(pose, first)
        return wp.array(poses, dtype=wp.transform, ndim=2, device=self.device)


def thinned(point: wp.array, start: wp.array, *, separation: float, first: int) -> tuple[wp.array, wp.array]:
    """Thin each pose's points, see `thin_points`; first: the first one's row of the motion.

    Raises StrategyError where too many points would be left.
    """
    try:
        return thin_points(point, start, separation=separation)
    except TooManyPointsError as error:
        begin, end = start.numpy()[error.pose : error.pose + 2].tolist()
        own, ends = point[begin:end], wp.array([0, end - begin], dtype=wp.int64, device=point.device)

        def fits(wider: float) -> bool:
            try:
                thin_points(own, ends, separation=wider)
            except TooManyPointsError:
                return False
            return True

        raise too_many(f"contact: pose {first + error.pose}", error.point_count, separation, fits) from error


def too_many(title: str, point_count: int, separation: float, fits: Callable[[float], bool]) -> StrategyError:
    """Error of a pose that keeps too many of its points; fits: whether it does not at another separation."""
    wider = separation_that_fits(fits, separation)
    return StrategyError(
        f"{title} keeps more than {POINTS_MOST} of its {point_count} points at a separation of {separation:g} m; "
        f"{wider:.3g} m fits"
    )


def joined_points(parts: list[tuple[wp.array, wp.array]], device: str) -> tuple[wp.array, wp.array]:
    """Points and offsets of consecutive poses as one."""
    if len(parts) == 1:
        return parts[0]
    point = wp.empty(sum(p.shape[0] for p, _ in parts), dtype=wp.vec3, device=device)
    counts, place = [np.zeros(1, np.int64)], 0
    for piece, start in parts:
        wp.copy(point, piece, dest_offset=place, count=piece.shape[0])
        place += piece.shape[0]
        counts.append(np.diff(start.numpy()))
    return point, wp.array(np.cumsum(np.concatenate(counts)), dtype=wp.int64, device=device)


def toured(point: wp.array, start: wp.array, *, closes: bool, patch_count: int) -> Any:
    """A path through each pose's points, see `tour_points`, as the contours of a hand of so many patches.

    Warns of poses with a single point, which have no path.
    """
    tours = tour_points(point, start, closes=closes)
    if tours.single_count:
        poses = start.shape[0] - 1
        warn_user(f"contact: at {tours.single_count} of {poses} poses a single point touches, which has no length")
    if patch_count == 1:
        return tours.contours
    pose_start = tours.contours.pose_start.numpy()
    section_start = np.repeat(pose_start[1:], patch_count)  # all of a pose's polylines are its first patch's
    section_start[::patch_count] = pose_start[:-1]
    both = np.concatenate([section_start, pose_start[-1:]])
    return with_columns(tours.contours, pose_start=wp.array(both, dtype=wp.int64, device=point.device))
