"""The pipeline: objects and hands in, contours, focal points and drives out."""

from .batch import render
from .contours import ContourBatch
from .hands import Palm
from .objects import MeshObject, Placement
from .playback import play_file
from .record import record
from .sampling import SamplingStrategy
from .strategy import IntersectionStrategy, closed_contour, open_contour
from .summary import summarise

__all__ = [
    "ContourBatch",
    "IntersectionStrategy",
    "MeshObject",
    "Palm",
    "Placement",
    "SamplingStrategy",
    "closed_contour",
    "open_contour",
    "play_file",
    "record",
    "render",
    "summarise",
]
