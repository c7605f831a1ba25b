"""The pipeline: objects and hands in, contours, focal points and drives out."""

import sys
from importlib import import_module
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
    from .acoustics.noise import NoiseListener, NoiseModel, NoiseSignal
    from .acoustics.prediction import predict_noise
    from .acoustics.pressure import pressure_at
    from .acoustics.radiation import radiation_pressure
    from .acoustics.spectrum import NoiseSpectrum, level_differences
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
    from .hands.flat_hand import flat_hand
    from .hands.hand import Hand, Palm
    from .hands.mesh_hand import MeshHand
    from .hands.plane_hand import HandPatch, PatchJoint, PlaneHand
    from .intersection.file_recording import record
    from .intersection.overlap_tour import overlap_points
    from .intersection.prepared_contours import PreparedContours
    from .intersection.scene import Scene, array_points
    from .live.counts import RunStatistics
    from .live.handle import Live
    from .live.instant import Instant
    from .live.moment import LiveMoment, LiveScene
    from .live.recording import LiveRecording
    from .live.session import LiveStimulus, Onset, Session, Stimulus
    from .live.shaping import PoseShaping, Prediction, Smoothing
    from .live.sources.hand_frame import PoseSource, SeenHand, SourceFault
    from .motions.explorations.explored import ExploredPoses, exploration
    from .motions.explorations.habits import ExplorerHabits, explorer_habits
    from .motions.groups import MotionGroup, render_motions
    from .objects.functions.expression import box, capsule, cylinder, half_space, sphere, torus
    from .objects.functions.expression_json import expression_from_json, expression_to_json, load_expression
    from .objects.functions.implicit_object import ImplicitObject
    from .objects.isosurface import isosurface
    from .objects.level_of_detail import simplify
    from .objects.mesh.placement import Placement
    from .objects.mesh.solid_mesh import MeshObject
    from .objects.voxels.files import save_voxels
    from .objects.voxels.voxel_object import VoxelObject
    from .objects.voxels.voxeliser import voxelise
    from .playback.drive import Driver, DriveStrategy, drive_focus
    from .playback.file_playback import Connection, play_file
    from .playback.placed_arrays import PlacedArray, load_rig
    from .playback.prepared_frames import prepare_frames
    from .reports.contour_animation import draw_animation
    from .reports.contour_figure import draw_figure
    from .reports.file_summary import summarise
    from .runtime.worker_devices import worker_devices
    from .sampling.metrics import FocalPoints, MotionSamples, dwell_map
    from .sampling.presets import load_sampling, preset
    from .sampling.revisits import revisit_rate
    from .sampling.sampler import Sampler, sample_bounds, sample_contours, sample_motions
    from .sampling.strategy import Dwell, Gap, SamplingStrategy
    from .scripting.rendered_batch import RenderedBatch
    from .scripting.rendering import load_contours, render
    from .scripting.sampled_contours import SampledContours
    from .stages.prune import cut_batch
    from .stages.registry import Stage, register_point_function, register_prune, register_transform
    from .strategies.intersection_strategy import IntersectionStrategy, closed_contour, load_strategy, open_contour
    from .sweeps.plan.loading import load_plans
    from .sweeps.report.table import tidy_columns
    from .sweeps.run.sweep_run import run_sweep
    from .sweeps.study import SweepResult, sweep
    from .view.page.export import export_page
    from .view.served.viewing import view_files


_ROOMS = {
    ".datasets.contour_file.check": "check_file",
    ".datasets.contour_file.reader": "ContourFile",
    ".datasets.errors": "DatasetError ContourFileError Hdf5Error MotionError ShapeError RecordingError "
    "SweepStoreError NotStoreError RecordingWarning",
    ".datasets.motions.hand_motion": "HandMotion static_pose",
    ".datasets.recordings.files": "load_recording",
    ".datasets.shapes.built_in": "shape_names",
    "acoustics.emission": "PlayedFrames",
    "acoustics.field_metrics": "PressureMetrics pressure_metrics",
    "acoustics.noise": "NoiseListener NoiseModel NoiseSignal",
    "acoustics.prediction": "predict_noise",
    "acoustics.pressure": "pressure_at",
    "acoustics.radiation": "radiation_pressure",
    "acoustics.spectrum": "NoiseSpectrum level_differences",
    "acoustics.transducers": "Resonance",
    "acoustics.wave_files": "write_wave_files",
    "contour_batch": "ContourBatch",
    "errors": "RenderError MeshError VoxelError ImplicitError StrategyError PlacementError RepairError "
    "PoseError SweepError PlanError UntrustedCodeError TrustStoreError KernelCacheError "
    "ViewError PalpateWarning",
    "exports.file_export": "export_file",
    "focal_spot": "focal_width",
    "hands.combined_hands": "together",
    "hands.flat_hand": "flat_hand",
    "hands.hand": "Hand Palm",
    "hands.mesh_hand": "MeshHand",
    "hands.plane_hand": "HandPatch PatchJoint PlaneHand",
    "intersection.file_recording": "record",
    "intersection.overlap_tour": "overlap_points",
    "intersection.prepared_contours": "PreparedContours",
    "intersection.scene": "Scene array_points",
    "objects.functions.expression": "box capsule cylinder half_space sphere torus",
    "objects.functions.expression_json": "expression_from_json expression_to_json load_expression",
    "objects.functions.implicit_object": "ImplicitObject",
    "objects.isosurface": "isosurface",
    "objects.level_of_detail": "simplify",
    "objects.mesh.placement": "Placement",
    "objects.mesh.solid_mesh": "MeshObject",
    "objects.voxels.files": "save_voxels",
    "objects.voxels.voxel_object": "VoxelObject",
    "objects.voxels.voxeliser": "voxelise",
    "live.counts": "RunStatistics",
    "live.handle": "Live",
    "live.instant": "Instant",
    "live.moment": "LiveMoment LiveScene",
    "live.recording": "LiveRecording",
    "live.session": "LiveStimulus Onset Session Stimulus",
    "live.shaping": "PoseShaping Prediction Smoothing",
    "live.sources.hand_frame": "PoseSource SeenHand SourceFault",
    "motions.groups": "MotionGroup render_motions",
    "motions.explorations.explored": "ExploredPoses exploration",
    "motions.explorations.habits": "ExplorerHabits explorer_habits",
    "playback.drive": "Driver DriveStrategy drive_focus",
    "playback.file_playback": "Connection play_file",
    "playback.placed_arrays": "PlacedArray load_rig",
    "playback.prepared_frames": "prepare_frames",
    "reports.contour_animation": "draw_animation",
    "reports.contour_figure": "draw_figure",
    "reports.file_summary": "summarise",
    "runtime.worker_devices": "worker_devices",
    "sampling.metrics": "FocalPoints MotionSamples dwell_map",
    "sampling.presets": "load_sampling preset",
    "sampling.revisits": "revisit_rate",
    "sampling.sampler": "Sampler sample_bounds sample_contours sample_motions",
    "sampling.strategy": "Dwell Gap SamplingStrategy",
    "scripting.rendered_batch": "RenderedBatch",
    "scripting.rendering": "load_contours render",
    "scripting.sampled_contours": "SampledContours",
    "stages.registry": "Stage register_point_function register_prune register_transform",
    "stages.prune": "cut_batch",
    "strategies.intersection_strategy": "IntersectionStrategy closed_contour load_strategy open_contour",
    "sweeps.plan.loading": "load_plans",
    "sweeps.run.sweep_run": "run_sweep",
    "sweeps.report.table": "tidy_columns",
    "sweeps.study": "SweepResult sweep",
    "view.served.viewing": "view_files",
    "view.page.export": "export_page",
}
"""What each module has that scripts use: it is imported when that is asked for, as a command needs few of them."""

_HOMES = {name: room for room, names in _ROOMS.items() for name in names.split()}

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
    "draw_animation",
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
    "overlap_points",
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
