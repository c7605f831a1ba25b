"""Files on disk and things to render: contour files, hand motions, built-in objects."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from .contour_file.check import check_file
    from .contour_file.reader import ContourFile
    from .contour_file.writer import ContourWriter
    from .focus_files.ptlist import read_ptlist, write_ptlist
    from .hand_model.shape import HandShape, hand_shape
    from .hand_model.skinning import posed_vertices
    from .motions.hand_motion import HandMotion, static_pose
    from .recordings.alignment import Y_UP
    from .recordings.files import load_recording
    from .recordings.recording import HandRecording
    from .recordings.sample import write_sample
    from .shapes.built_in import shape, shape_names
    from .sweeps.result_row import ResultRow
    from .sweeps.store import SweepStore
    from .sweeps.table import load_table, write_table


_ROOMS = {
    "contour_file.check": "check_file",
    "contour_file.reader": "ContourFile",
    "contour_file.writer": "ContourWriter",
    "focus_files.ptlist": "read_ptlist write_ptlist",
    "hand_model.shape": "HandShape hand_shape",
    "hand_model.skinning": "posed_vertices",
    "motions.hand_motion": "HandMotion static_pose",
    "recordings.alignment": "Y_UP",
    "recordings.files": "load_recording",
    "recordings.recording": "HandRecording",
    "recordings.sample": "write_sample",
    "shapes.built_in": "shape shape_names",
    "sweeps.result_row": "ResultRow",
    "sweeps.store": "SweepStore",
    "sweeps.table": "load_table write_table",
}
"""What each module has that scripts use: it is imported when that is asked for, as most programs need few of them."""

_HOMES = {name: room for room, names in _ROOMS.items() for name in names.split()}

__all__ = [
    "Y_UP",
    "ContourFile",
    "ContourWriter",
    "HandMotion",
    "HandRecording",
    "HandShape",
    "ResultRow",
    "SweepStore",
    "check_file",
    "hand_shape",
    "load_recording",
    "load_table",
    "posed_vertices",
    "read_ptlist",
    "shape",
    "shape_names",
    "static_pose",
    "write_ptlist",
    "write_sample",
    "write_table",
]


if not TYPE_CHECKING:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> object:
        """What `__all__` names, and `__version__` (PEP 562)."""
        if name == "__version__":
            return import_module("importlib.metadata").version("palpate")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
        found = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        return found


def __dir__() -> list[str]:
    """The public names, as `dir` and completion show them."""
    return [*__all__, "__version__"]
