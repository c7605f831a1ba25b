"""The pipeline: objects and hands in, contours, focal points and drives out."""

from .batch import render
from .contours import ContourBatch
from .detail import simplify
from .drive import Driver, DriveStrategy, drive_focus
from .flat_planes import flat_hand
from .focal_width import focal_width
from .hands import Palm
from .implicit import ImplicitObject
from .instant import Instant
from .mesh_hand import MeshHand
from .objects import MeshObject, Placement
from .plane_hand import HandPatch, PatchJoint, PlaneHand
from .playback import Connection, play_file
from .record import record
from .rig import PlacedArray, load_rig
from .sampling import FocalPoints, Sampler, SamplingStrategy, dwell_map, load_sampling, preset, sample_contours
from .scene import Scene
from .several_hands import together
from .stages import Stage, register_point_function, register_prune, register_transform
from .strategy import IntersectionStrategy, closed_contour, load_strategy, open_contour
from .summary import summarise
from .voxelise import voxelise
from .voxels import VoxelObject

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
