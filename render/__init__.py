"""The pipeline: objects and hands in, contours, focal points and drives out."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from .batch import render
    from .contours import ContourBatch
    from .detail import simplify
    from .drive import Driver, DriveStrategy, drive_focus
    from .flat_planes import flat_hand
    from .focal_spot import focal_width
    from .hands import Palm
    from .implicit import ImplicitObject
    from .instant import Instant
    from .mesh_hand import MeshHand
    from .objects import MeshObject, Placement
    from .patch_points import array_points
    from .plane_hand import HandPatch, PatchJoint, PlaneHand
    from .playback import Connection, play_file
    from .recorder import record
    from .rig import PlacedArray, load_rig
    from .sampling import FocalPoints, Sampler, SamplingStrategy, dwell_map, load_sampling, preset, sample_contours
    from .scene import Scene
    from .several_hands import together
    from .stages import Stage, register_point_function, register_prune, register_transform
    from .strategy import IntersectionStrategy, closed_contour, load_strategy, open_contour
    from .summary import summarise
    from .voxeliser import voxelise
    from .voxels import VoxelObject

_ROOMS = {
    "batch": "render",
    "contours": "ContourBatch",
    "detail": "simplify",
    "drive": "Driver DriveStrategy drive_focus",
    "flat_planes": "flat_hand",
    "focal_spot": "focal_width",
    "hands": "Palm",
    "implicit": "ImplicitObject",
    "instant": "Instant",
    "mesh_hand": "MeshHand",
    "objects": "MeshObject Placement",
    "patch_points": "array_points",
    "plane_hand": "HandPatch PatchJoint PlaneHand",
    "playback": "Connection play_file",
    "recorder": "record",
    "rig": "PlacedArray load_rig",
    "sampling": "FocalPoints Sampler SamplingStrategy dwell_map load_sampling preset sample_contours",
    "scene": "Scene",
    "several_hands": "together",
    "stages": "Stage register_point_function register_prune register_transform",
    "strategy": "IntersectionStrategy closed_contour load_strategy open_contour",
    "summary": "summarise",
    "voxeliser": "voxelise",
    "voxels": "VoxelObject",
}
"""What each module has that scripts use: it is imported when that is asked for, as a command needs few of them."""

_HOMES = {name: room for room, names in _ROOMS.items() for name in names.split()}

__all__ = [
    "Connection",
    "ContourBatch",
    "DriveStrategy",
    "Driver",
    "FocalPoints",
    "HandPatch",
    "ImplicitObject",
    "Instant",
    "IntersectionStrategy",
    "MeshHand",
    "MeshObject",
    "Palm",
    "PatchJoint",
    "PlacedArray",
    "Placement",
    "PlaneHand",
    "Sampler",
    "SamplingStrategy",
    "Scene",
    "Stage",
    "VoxelObject",
    "array_points",
    "closed_contour",
    "drive_focus",
    "dwell_map",
    "flat_hand",
    "focal_width",
    "load_rig",
    "load_sampling",
    "load_strategy",
    "open_contour",
    "play_file",
    "preset",
    "record",
    "register_point_function",
    "register_prune",
    "register_transform",
    "render",
    "sample_contours",
    "simplify",
    "summarise",
    "together",
    "voxelise",
]


def __getattr__(name: str) -> object:
    """What `__all__` names, and `__version__` (PEP 562)."""
    if name == "__version__":
        return import_module("importlib.metadata").version("palpate")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    return found


def __dir__() -> list[str]:
    """What can be asked for."""
    return sorted({*globals(), *__all__})
