"""The pipeline: objects and hands in, contours, focal points and drives out."""

from .batch import render
from .contours import ContourBatch
from .hands import Palm
from .objects import MeshObject, Placement
from .strategy import IntersectionStrategy, closed_contour, open_contour

__all__ = [
    "ContourBatch",
    "IntersectionStrategy",
    "MeshObject",
    "Palm",
    "Placement",
    "closed_contour",
    "open_contour",
    "render",
]
