"""The pipeline: objects and hands in, contours, focal points and drives out."""

import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from ..datasets.contour_file.check import check_file
    from ..datasets.contour_file.reader import ContourFile
    from ..datasets.errors import (
        ContourFileError,
        DatasetError,
        Hdf5Error,
        MotionError,
        NotStoreError,
        RecordingError,
        RecordingWarning,
        ShapeError,
        SweepStoreError,
    )
    from ..datasets.motions.hand_motion import HandMotion, static_pose
    from ..datasets.recordings.files import load_recording
    from ..datasets.shapes.built_in import shape_names
    from .acoustics.emission import PlayedFrames
    from .acoustics.field_metrics import PressureMetrics, pressure_metrics
    from .acoustics.noise import NoiseListener, NoiseModel
    from .acoustics.prediction import predict_noise
    from .acoustics.pressure import pressure_at
    from .acoustics.radiation import radiation_pressure
    from .acoustics.spectrum import NoiseSignal, NoiseSpectrum, level_differences
    from .acoustics.transducers import Resonance
    from .acoustics.wave_files import write_wave_files
    from .contour_batch import ContourBatch
    from .errors import (
        ImplicitError,
        KernelCacheError,
        MeshError,
        PalpateWarning,
        PlacementError,
        PlanError,
        PoseError,
        RenderError,
        RepairError,
        StrategyError,
        SweepError,
        TrustStoreError,
        UntrustedCodeError,
        ViewError,
        VoxelError,
    )
    from .exports.file_export import export_file
    from .focal_spot import focal_width
    from .hands.combined_hands import together
    from .hands.hand import Hand, Palm
    from .hands.mesh_hand import MeshHand
    from .hands.plane_hand import HandPatch, PatchJoint, PlaneHand, flat_hand
    from .intersection.file_recording import record
    from .intersection.prepared_contours import PreparedContours
    from .intersection.scene import Scene, array_points
    from .live.counts import RunStatistics
    from .live.handle import Live
    from .live.instant import Instant
    from .live.moment import LiveMoment, LiveScene
    from .live.recording import LiveRecording
    from .live.session import LiveStimulus, Onset, Session, Stimulus
    from .live.sources.hand_frame import PoseSource, SeenHand, SourceFault
    from .live.sources.shaping import PoseShaping, Prediction, Smoothing
    from .motions.explorations.explored import ExploredPoses, exploration
    from .motions.explorations.habits import ExplorerHabits, explorer_habits
    from .motions.groups import MotionGroup, render_motions
    from .objects.functions.expression import (
        box,
        capsule,
        cylinder,
        expression_from_json,
        expression_to_json,
        half_space,
        load_expression,
        sphere,
        torus,
    )
    from .objects.functions.implicit_object import ImplicitObject
    from .objects.isosurface import isosurface
    from .objects.level_of_detail import simplify
    from .objects.mesh.placement import Placement
    from .objects.mesh.solid_mesh import MeshObject
    from .objects.voxels.voxel_object import VoxelObject, save_voxels
    from .objects.voxels.voxeliser import voxelise
    from .playback.drive import Driver, DriveStrategy, drive_focus
    from .playback.file_playback import Connection, play_file
    from .playback.placed_arrays import PlacedArray, load_rig
    from .playback.prepared_frames import prepare_frames
    from .reports.contour_figure import draw_figure
    from .reports.file_summary import summarise
    from .runtime.worker_devices import worker_devices
    from .sampling.metrics import FocalPoints, MotionSamples, dwell_map
    from .sampling.presets import load_sampling, preset
    from .sampling.revisits import revisit_rate
    from .sampling.sampler import Sampler, sample_bounds, sample_contours, sample_motions
    from .sampling.strategy import Dwell, Gap, SamplingStrategy
    from .scripting.rendered_batch import RenderedBatch, load_contours, render
    from .scripting.sampled_contours import SampledContours
    from .stages.point_function import register_point_function
    from .stages.prune import cut_batch
    from .stages.registry import Stage, register_prune, register_transform
    from .strategies.intersection_strategy import IntersectionStrategy, closed_contour, load_strategy, open_contour
    from .sweeps.plan.loading import load_plans
    from .sweeps.report.table import tidy_columns
    from .sweeps.run.sweep_run import run_sweep
    from .sweeps.study import SweepResult, sweep
    from .view.page.export import export_page
    from .view.served.viewing import view_files


# The imports above are the one list of public names: each module is imported when a name of it is asked for, as a
# command needs few of them, so the list is read from this file's own text, which takes less than a millisecond.
_IMPORTS = re.findall(r"^    from \.(\S+) import (?:\(([^)]*)\)|(.*))$", Path(__file__).read_text(), re.MULTILINE)
_HOMES = {name: module for module, *names in _IMPORTS for name in re.findall(r"\w+", "".join(names))}

__all__ = [
    "Connection",
    "ContourBatch",
    "ContourFile",
    "ContourFileError",
    "DatasetError",
    "DriveStrategy",
    "Driver",
    "Dwell",
    "ExploredPoses",
    "ExplorerHabits",
    "FocalPoints",
    "Gap",
    "Hand",
    "HandMotion",
    "HandPatch",
    "Hdf5Error",
    "ImplicitError",
    "ImplicitObject",
    "Instant",
    "IntersectionStrategy",
    "KernelCacheError",
    "Live",
    "LiveMoment",
    "LiveRecording",
    "LiveScene",
    "LiveStimulus",
    "MeshError",
    "MeshHand",
    "MeshObject",
    "MotionError",
    "MotionGroup",
    "MotionSamples",
    "NoiseListener",
    "NoiseModel",
    "NoiseSignal",
    "NoiseSpectrum",
    "NotStoreError",
    "Onset",
    "Palm",
    "PalpateWarning",
    "PatchJoint",
    "PlacedArray",
    "Placement",
    "PlacementError",
    "PlanError",
    "PlaneHand",
    "PlayedFrames",
    "PoseError",
    "PoseShaping",
    "PoseSource",
    "Prediction",
    "PreparedContours",
    "PressureMetrics",
    "RecordingError",
    "RecordingWarning",
    "RenderError",
    "RenderedBatch",
    "RepairError",
    "Resonance",
    "RunStatistics",
    "SampledContours",
    "Sampler",
    "SamplingStrategy",
    "Scene",
    "SeenHand",
    "Session",
    "ShapeError",
    "Smoothing",
    "SourceFault",
    "Stage",
    "Stimulus",
    "StrategyError",
    "SweepError",
    "SweepResult",
    "SweepStoreError",
    "TrustStoreError",
    "UntrustedCodeError",
    "ViewError",
    "VoxelError",
    "VoxelObject",
    "array_points",
    "box",
    "capsule",
    "check_file",
    "closed_contour",
    "cut_batch",
    "cylinder",
    "draw_figure",
    "drive_focus",
    "dwell_map",
    "exploration",
    "explorer_habits",
    "export_file",
    "export_page",
    "expression_from_json",
    "expression_to_json",
    "flat_hand",
    "focal_width",
    "half_space",
    "isosurface",
    "level_differences",
    "load_contours",
    "load_expression",
    "load_plans",
    "load_recording",
    "load_rig",
    "load_sampling",
    "load_strategy",
    "open_contour",
    "play_file",
    "predict_noise",
    "prepare_frames",
    "preset",
    "pressure_at",
    "pressure_metrics",
    "radiation_pressure",
    "record",
    "register_point_function",
    "register_prune",
    "register_transform",
    "render",
    "render_motions",
    "revisit_rate",
    "run_sweep",
    "sample_bounds",
    "sample_contours",
    "sample_motions",
    "save_voxels",
    "shape_names",
    "simplify",
    "sphere",
    "static_pose",
    "summarise",
    "sweep",
    "tidy_columns",
    "together",
    "torus",
    "view_files",
    "voxelise",
    "worker_devices",
    "write_wave_files",
]


if not TYPE_CHECKING:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> object:
        """What `__all__` names, and `__version__` (PEP 562)."""
        if name == "__version__":
            return import_module("importlib.metadata").version("palpate")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
        module = import_module(f".{_HOMES[name]}", __name__)
        if "warp" in sys.modules:
            import_module(".runtime.warp_start", __name__).start_quietly()
        found = globals()[name] = getattr(module, name)
        return found


def __dir__() -> list[str]:
    """What can be asked for."""
    return [*__all__, "__version__"]
