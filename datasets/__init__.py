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
from .recordings.alignment import Y_UP
from .recordings.files import load_recording
from .recordings.recording import HandRecording
from .recordings.sample import write_sample
from .shapes.built_in import shape, shape_names

__all__ = [
    "Y_UP",
    "ContourFile",
    "ContourWriter",
    "HandMotion",
    "HandRecording",
    "HandShape",
    "ShardRow",
    "SweepStore",
    "check_file",
    "exploration",
    "hand_shape",
    "load_pose_table",
    "load_recording",
    "load_table",
    "posed_vertices",
    "read_ptlist",
    "shape",
    "shape_names",
    "static_pose",
    "table_attributes",
    "write_parquet",
    "write_ptlist",
    "write_sample",
    "write_shard",
    "write_table",
]

_LATER = {
    "ShardRow": "shard",
    "SweepStore": "store",
    "load_pose_table": "pose_files",
    "load_table": "table",
    "table_attributes": "table",
    "write_parquet": "table",
    "write_shard": "shard",
    "write_table": "table",
}
"""Names of sweeps, each with its module in `sweeps`: imported when asked for, as most programs need none."""

if TYPE_CHECKING:
    from .sweeps.pose_files import load_pose_table
    from .sweeps.shard import ShardRow, write_shard
    from .sweeps.store import SweepStore
    from .sweeps.table import load_table, table_attributes, write_parquet, write_table

    __version__: str
else:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> object:
        """Names of `_LATER`, and `__version__`, which takes longer to find than some imports do (PEP 562)."""
        if name == "__version__":
            return import_module("importlib.metadata").version("palpate")
        if name not in _LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = globals()[name] = getattr(import_module(f".sweeps.{_LATER[name]}", __name__), name)
        return found
