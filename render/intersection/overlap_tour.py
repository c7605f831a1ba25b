"""Raw "overlap": what a hand and an object share, both of them solids; points on its surface and a short path."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from ...datasets.rigid import rotate
from ...kernels.tours.overlap import find_shared_surface
from ..errors import MeshError, StrategyError
from ..hands.hand import Hand
from ..hands.hand_solid import hand_solids
from ..objects.solid import Solid
from ..objects.voxels.grid import corners_of
from .contact_tour import SEPARATION, joined_points, require_inside, require_length, thinned, toured

NODES_MOST = 2**23  # of one launch: 9 bytes each
STEP_LEAST = 1e-5  # [m]


def overlap_contours(
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
    """One polyline a pose, of kind MADE, over the surface of what object and hand share.

    hand: a MeshHand whose mesh is closed, see `hand_solids`; pose: hand frame -> array frame, float32, shape [pose, 7],
    rows `first`.. of the motion. step: of the lattice that is searched [m], see `overlap_points`; separation: least
    distance of the points that stay [m]; closes: back to the first.
    Poses where a single point is shared are counted in a PalpateWarning.
    Raises StrategyError for a hand without an inside, a step or a separation that cannot be used, and for a pose that
    keeps more than 2,000 points; MeshError for a hand mesh that is not closed and an object without an inside.
    """
    require_length("overlap: separation", separation)
    pose = np.asarray(pose, np.float32).reshape(-1, 7)
    parts, own = [], first
    try:
        for hand_part, rows in hand_solids(hand, first, len(pose)):
            for found in shared_surfaces(solid, hand_part, pose[rows], step=step, device=device, limit=NODES_MOST):
                parts.append(thinned(*found, separation=separation, first=own, name="overlap"))
                own += found[1].shape[0] - 1
        point, start = joined_points(parts, device)
        return toured(point, start, closes=closes, patch_count=hand.patch_count, name="overlap")
    except (MeshError, StrategyError):
        raise
    except ValueError as error:
        raise StrategyError(f"overlap: {error}") from error


def overlap_points(
    solid: Solid, hand: Solid, pose: np.ndarray, *, step: float, device: str = "cpu", limit: int = NODES_MOST
) -> tuple[np.ndarray, np.ndarray]:
    """Points on the surface of the Boolean intersection of an object and a hand, at each pose.

    hand: a solid in the hand frame; pose: hand frame -> array frame, shape [pose, 7].
    step: of the lattice that is searched [m]; each of its cells that the surface cuts gives one point, on the surface
    to within 1 nm and float32. What is thinner than a step may be missing.
    limit: most nodes of the lattice at a time, so memory does not depend on the number of poses.

    Returns points [m], array frame, float32, shape [point, 3], and where each pose's start, int64, shape [pose + 1].
    Raises StrategyError for a step that is none, or so small that one pose has more nodes than the limit, and MeshError
    for an object or a hand without an inside.

    >>> import numpy as np
    >>> from palpate.render import ImplicitObject, MeshObject, overlap_points, sphere, static_pose
    >>> ball = ImplicitObject(sphere(0.05), hand=True)  # in place of a hand
    >>> points, start = overlap_points(MeshObject.load("cube"), ball, static_pose([0, 0, 0.2]).pose, step=0.01)
    >>> np.unique(np.linalg.norm(points - [0, 0, 0.2], axis=1).round(4))  # the ball is wholly in the cube: its surface
    array([0.05])
    """
    hand.require_closed()
    points, start = [np.zeros((0, 3), np.float32)], [np.zeros(1, np.int64)]
    for found, ends in shared_surfaces(solid, hand, pose, step=step, device=device, limit=limit):
        points.append(found.numpy())
        start.append(start[-1][-1] + ends.numpy()[1:])
    return np.concatenate(points), np.concatenate(start)


def shared_surfaces(
    solid: Solid, hand: Any, pose: np.ndarray, *, step: float, device: str, limit: int
) -> Iterator[tuple[wp.array, wp.array]]:
    """Points of consecutive poses and where each pose's start, on the device: see `overlap_points`."""
    require_length("overlap: step", step, STEP_LEAST)
    require_inside(solid, "overlap")
    pose = np.asarray(pose, np.float32).reshape(-1, 7)
    first, count = node_blocks(solid.bounds, hand.bounds, pose, step)
    nodes = count.prod(axis=1, dtype=np.int64)
    if len(nodes) and nodes.max() > limit:
        raise StrategyError(
            f"overlap: a step of {step:.3g} m takes {nodes.max()} nodes at pose {nodes.argmax()}, of which {limit} are "
            f"allowed; {step * (nodes.max() / limit) ** (1 / 3):.2g} m fits"
        )
    one, other = solid.field_on(device), hand.field_on(device)
    for rows in launches(nodes, limit):
        yield find_shared_surface(one, other, pose[rows], first[rows], count[rows], step=step, device=device)


def node_blocks(solid: np.ndarray, hand: np.ndarray, pose: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest node [step] and number of nodes along each axis of the box that both are in, int32, shape [pose, 3].

    solid, hand: bounds in their own frames [m], shape [2, 3].
    """
    corners = corners_of(hand)
    wide = pose.astype(np.float64)
    turn = wide[:, None, 3:] / np.linalg.norm(wide[:, None, 3:], axis=2, keepdims=True)
    corner = wide[:, None, :3] + rotate(turn, corners[None])
    low, high = np.maximum(solid[0], corner.min(axis=1)), np.minimum(solid[1], corner.max(axis=1))
    first, last = np.floor(low / step), np.ceil(high / step)
    count = np.where((low <= high).all(axis=1, keepdims=True), last - first + 1, 0)
    return first.astype(np.int32), count.astype(np.int32)


def launches(nodes: np.ndarray, limit: int) -> list[slice]:
    """Rows of poses that are looked at together: as many as have no more nodes than the limit."""
    total = np.concatenate([[0], np.cumsum(nodes)])
    out, first = [], 0
    while first < len(nodes):
        stop = max(first + 1, int(np.searchsorted(total, total[first] + limit, side="right")) - 1)
        out.append(slice(first, stop))
        first = stop
    return out
