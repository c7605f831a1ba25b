"""Run a strategy's prune and transform stages over a batch of contours; output of user-defined stages is checked."""

from collections.abc import Mapping

import numpy as np

from ..contour_batch import ContourBatch
from ..errors import PalpateWarning, StrategyError
from ..stages.registry import BY_RAW_KERNELS, Stage, StageEntry, Value, find_stage
from ..stages.setting import Setting
from ..stages.user_output_check import checked_batch, checked_removal
from .intersection_strategy import IntersectionStrategy


def run_stages(
    batch: ContourBatch, strategy: IntersectionStrategy, setting: Setting
) -> tuple[ContourBatch, dict[str, np.ndarray]]:
    """Run all prune stages, then all transform stages, except those that the raw intersection does.

    Returns the batch, on the host or device as the last stage, and the length that each prune stage removed [m],
    float32, shape [pose], by name; a stage that is listed again is "name#2". Raises StrategyError, naming the stage,
    for a user-defined stage that raises or returns no valid batch.
    """
    removed: dict[str, np.ndarray] = {}
    for stage in strategy.prune_stages:
        if stage.name not in BY_RAW_KERNELS:
            batch, length = _run_stage("prune", stage, batch, setting)
            count = sum(name.partition("#")[0] == stage.name for name in removed)
            removed[f"{stage.name}#{count + 1}" if count else stage.name] = length
    for stage in strategy.transform_stages:
        if stage.name not in BY_RAW_KERNELS:
            batch, _ = _run_stage("transform", stage, batch, setting)
    return batch, removed


def _run_stage(role: str, stage: Stage, batch: ContourBatch, setting: Setting) -> tuple[ContourBatch, np.ndarray]:
    """Run a stage on the host or its device; the second result, the length removed, is empty for a transform stage."""
    entry = find_stage(role, stage.name)
    function = entry.function
    if function is None:
        raise StrategyError(f"{role}: stage {stage.name!r} is done by the raw intersection only")
    batch = batch.numpy() if entry.on == "host" else batch.to(setting.device)
    values = entry.values(stage, setting.focal_width)
    if entry.own:
        result = function(batch, setting, **values)
        return result if role == "prune" else (result, np.zeros(0, np.float32))
    return _run_checked(entry, batch, setting, values)


def _run_checked(
    entry: StageEntry, batch: ContourBatch, setting: Setting, values: Mapping[str, Value]
) -> tuple[ContourBatch, np.ndarray]:
    """Run a user-defined stage; errors that it raises, or that its result causes, name it."""
    title = f"{entry.role} stage {entry.name!r}"
    before = batch.length() if entry.role == "prune" else np.zeros(0)  # first: the stage may write into it
    try:
        result = entry.function(batch, setting, **values) if entry.function else None
    except (StrategyError, PalpateWarning):  # a warning, where the caller makes errors of warnings
        raise
    except (Exception, SystemExit) as error:  # a user's function may raise anything
        raise StrategyError(f"{title} failed: {type(error).__name__}: {error}") from error
    removed = None
    if entry.role == "prune" and isinstance(result, tuple) and len(result) == 2:
        result, removed = result
    device = setting.device if entry.on == "device" else None
    counts = {"pose_count": batch.pose_count, "patch_count": setting.hand.patch_count}
    after = checked_batch(result, title, device=device, **counts)
    if entry.role == "transform":
        return after, np.zeros(0, np.float32)
    gone = before - after.length()
    return after, checked_removal(gone if removed is None else removed, gone, before, title)
