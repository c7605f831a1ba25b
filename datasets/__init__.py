"""Files on disk and things to render: contour files, hand motions, built-in objects."""

from importlib import import_module
from typing import TYPE_CHECKING

from .contour_file.check import check_file
from .contour_file.reader import ContourFile
from .contour_file.writer import ContourWriter
from .focus_files.ptlist import read_ptlist, write_ptlist
from .hand_model.shape import HandShape, hand_shape
from .hand_model.skinning import posed_vertices
from .motions.hand_motion import HandMotion, exploration, static_pose
from .recordings.files import load_recording
from .recordings.recording import HandRecording
from .shapes.built_in import shape, shape_names

__all__ = [
    "ContourFile",
    "ContourWriter",
    "HandMotion",
    "HandRecording",
    "HandShape",
    "check_file",
    "exploration",
    "hand_shape",
    "load_recording",
    "posed_vertices",
    "read_ptlist",
    "shape",
    "shape_names",
    "static_pose",
    "write_ptlist",
]

if TYPE_CHECKING:
    __version__: str
else:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> str:
        """`__version__`, read when it is asked for: finding it takes longer than some imports do (PEP 562)."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module("importlib.metadata").version("palpate")
