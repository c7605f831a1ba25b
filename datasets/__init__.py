"""Files on disk and things to render: contour files, hand motions, built-in objects."""

from .check import check_file
from .motion import HandMotion, exploration, static_pose
from .ptlist import read_ptlist, write_ptlist
from .reader import ContourFile
from .shapes import shape, shape_names
from .writer import ContourWriter

__all__ = [
    "ContourFile",
    "ContourWriter",
    "HandMotion",
    "check_file",
    "exploration",
    "read_ptlist",
    "shape",
    "shape_names",
    "static_pose",
    "write_ptlist",
]
