"""Warp kernels: arrays in, arrays out; no file, no object, no USB.

A module is one stage. Its kernels are private (`_verb_noun`); the host function of the same name beside them is the
interface: it checks, launches and returns arrays on the device of its inputs.
"""

import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

# Poses to contours of a mesh on patches.
RENDER_STAGES = (
    "patch",
    "section.scan",
    "section.clip",
    "section.tree",
    "section.flat_boxes",
    "section.flat_search",
    "section.flat_ranks",
    "section.join",
    "section.draw",
    "section.loops",
    "contours",
)
FIELD_STAGES = (
    "march.sample",
    "march.grid",
    "march.lines",
    "march.tip",
    "march.follow",
    "march.walk",
    "skin.curves",
    "fields.mesh_inside",
    "stages.move",
)  # of others
POINT_STAGES = (
    "tours.nodes",
    "tours.tour",
)  # to paths through points
FOLLOWING_STAGES = (
    "stages.cut",
    "stages.insertion",
    "stages.joint",
    "stages.ovals",
    "stages.prune",
    "stages.prune_crowded",
    "stages.prune_hidden",
    "stages.regions",
    "stages.curves",
    "solids.distance",
)
EMPHASIS_STAGES = ("emphasis.corners", "emphasis.edges", "emphasis.depth")  # strong and weak
FILLING_STAGES = (
    "fillings.hatch",
    "fillings.inset",
    "fillings.inset_pieces",
)  # of what contours enclose
MOTION_STAGES = ("metrics.contour_shift", "motions.halving")  # from pose to pose
OBJECT_STAGES = ("solids.crossing", "solids.nesting", "solids.voxelise")  # what is made of objects before
EXPLORATION_STAGES = ("motions.over_array", "motions.around")  # synthetic motions, over an array and around objects
SWEEP_STAGES = (
    "metrics.random_pose",
    "metrics.tally",
)  # random poses, and sums over poses
FOCUS_STAGES = (
    "sampling.cycles",
    "sampling.entry",
    "sampling.focus",
    "sampling.visits",
    "sampling.sums",
    "sampling.contour_faults",
    "sampling.dwelling",
)  # contours of one motion to focal points, on the CPU; what takes longest to compile comes first
SAMPLING_STAGES = (*FOCUS_STAGES, "motions.widening")  # contours of many motions to focal points
BYTE_STAGES = ("driving.pack", "driving.hold")  # focal points, one a frame, to wire bytes
PLAYING_STAGES = (*FOCUS_STAGES, *BYTE_STAGES)
DRIVE_STAGES = (*BYTE_STAGES, "driving.solve", "driving.slew", "driving.foci")  # focal points to what arrays take
ACOUSTIC_STAGES = (
    "acoustics.resonance",
    "acoustics.propagation",
    "acoustics.pressure_sum",
)  # phases to what is felt and heard
STAGES = (
    *RENDER_STAGES,
    *FIELD_STAGES,
    *POINT_STAGES,
    *FOLLOWING_STAGES,
    *EMPHASIS_STAGES,
    *FILLING_STAGES,
    *MOTION_STAGES,
    *OBJECT_STAGES,
    *EXPLORATION_STAGES,
    *SWEEP_STAGES,
    *SAMPLING_STAGES,
    *DRIVE_STAGES,
    *ACOUSTIC_STAGES,
)

if TYPE_CHECKING:
    __version__: str
else:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> str:
        """`__version__`, read when it is asked for: finding it takes longer than some imports do (PEP 562)."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module("importlib.metadata").version("palpate")


def uncompiled(stages: tuple[str, ...]) -> tuple[str, ...]:
    """The stages whose kernels Warp's cache lacks for the CPU; Warp must have been started."""
    import warp as wp

    def is_cached(stage: str) -> bool:
        identifier = wp.get_module(import_module(f".{stage}", __name__).__name__).get_module_identifier(1)
        return any(Path(wp.config.kernel_cache_dir or "", identifier).glob("*.o"))

    return tuple(stage for stage in stages if not is_cached(stage))


def compile_kernels(device: str = "cpu", stages: tuple[str, ...] = STAGES) -> None:
    """Compile the kernels of some stages for a device into Warp's cache: seconds once, nothing after.

    Each stage is otherwise compiled when it is first used, so rendering does not wait for what drives an array. Kernels
    that are made for a field's function (`field.MODULE`) are always compiled then, once for each kind of field.
    """
    import warp as wp

    from .offsets import BLOCK

    on_cpu, by_block = wp.get_device(device).is_cpu, {}
    for module in (import_module(f".{stage}", __name__) for stage in stages):
        blocks = {module.__name__: getattr(module, "BLOCK", BLOCK), **getattr(module, "OTHER_BLOCKS", {})}
        for name, block in blocks.items():
            by_block.setdefault(1 if on_cpu else block, []).append(wp.get_module(name))  # a CPU has blocks of one
    for block, modules in by_block.items():
        wp.force_load(device, modules, block_dim=block, max_workers=len(os.sched_getaffinity(0)))
