"""The pipeline: objects and hands in, contours, focal points and drives out."""

from .batch import render
from .contours import ContourBatch
from .drive import Driver, DriveStrategy, drive_focus
from .hands import Palm
from .instant import Instant
from .objects import MeshObject, Placement
from .playback import Connection, play_file
from .record import record
from .rig import PlacedArray, load_rig
from .sampling import FocalPoints, Sampler, SamplingStrategy, dwell_map, load_sampling, preset, sample_contours
from .strategy import IntersectionStrategy, closed_contour, open_contour
from .summary import summarise

__all__ = [
    "Connection",
    "ContourBatch",
    "DriveStrategy",
    "Driver",
    "FocalPoints",
    "Instant",
    "IntersectionStrategy",
    "MeshObject",
    "Palm",
    "PlacedArray",
    "Placement",
    "Sampler",
    "SamplingStrategy",
    "closed_contour",
    "drive_focus",
    "dwell_map",
    "load_rig",
    "load_sampling",
    "open_contour",
    "play_file",
    "preset",
    "record",
    "render",
    "sample_contours",
    "summarise",
]
