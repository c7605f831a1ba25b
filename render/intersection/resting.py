"""Distance at which a vertex counts as on a patch's plane or side: `flush`, or float32 spacings at the pose."""

from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp

from ...kernels.flush import FLUSH_RATE, resolve_flush
from ..hands.hand import Palm, PatchHand
from ..objects.solid import Solid
from ..strategies.intersection_strategy import IntersectionStrategy

_REACH: WeakKeyDictionary[Solid, float] = WeakKeyDictionary()  # of objects that are in use


def farthest_of(object_pose: np.ndarray | None) -> float:
    """Largest coordinate of the poses of an object that moves [m], shape [pose, 7]; 0 for one that stands still."""
    return 0.0 if object_pose is None or not len(object_pose) else float(np.abs(object_pose[:, :3]).max())


def reach_of(solid: Solid) -> float:
    """Largest coordinate of an object [m], looked for once; 0 for one without bounds."""
    if solid not in _REACH:
        reach = float(np.abs(solid.bounds).max())
        _REACH[solid] = reach if np.isfinite(reach) else 0.0
    return _REACH[solid]


def patches_for(
    hand: PatchHand,
    solid: Solid,
    strategy: IntersectionStrategy,
    device: str,
    *,
    farthest: float = 0.0,
    relative: bool = False,
) -> wp.array:
    """A hand's patches on a device, with the distance that counts as on them; dtype Patch, shape [patch].

    A strategy without `flush` gets FLUSH_RATE times the largest coordinate of the object and the patch, and of the
    object's own poses on top where it moves: those are rounded, too. farthest: see `farthest_of`; relative: whether
    points are written relative to their patch.
    """
    least, rate = strategy.flush, 0.0
    if least is None:
        least, rate = FLUSH_RATE * (reach_of(solid) + farthest), FLUSH_RATE
    resolve = _palm_patches if type(hand) is Palm else _patches  # a subclass may have other patches
    return resolve(hand, device, least, rate, relative)


def _patches(hand: PatchHand, device: str, flush: float, flush_rate: float, relative: bool) -> wp.array:
    """A hand's patches on a device, resolved (`resolve_flush`)."""
    return resolve_flush(hand.on(device), flush=flush, flush_rate=flush_rate, relative=relative)


@lru_cache(maxsize=16)
def _palm_patches(palm: Palm, device: str, flush: float, flush_rate: float, relative: bool) -> wp.array:
    """`_patches` of a palm, which meets the same object in batch after batch; nobody writes to them."""
    resolved = _patches(palm, device, flush, flush_rate, relative)
    wp.synchronize_device(device)  # other streams read them, too
    return resolved
