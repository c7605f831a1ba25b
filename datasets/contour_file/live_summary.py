"""A live run in numbers: its latency, and the samples that the array did not emit as they were sampled."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..storage.schema import LIVE_MARKS
from .reader import ContourFile


def summarise_run(file: ContourFile) -> dict[str, Any] | None:
    """Poses, samples by their mark, and latency [s] of the live run that a file is the recording of; None for others.

    Latency is the time from the hand's being there to the pose's first focal point; None where no pose's is known.
    `seconds_dropped` is the number of seconds, counted from sample 0, with a sample that was not emitted as sampled.
    """
    if (run := file.live_run) is None:
        return None
    latency, mark = file.live_rows("emitted") - file.live_rows("stamp"), file.live_rows("mark")
    known = latency[np.isfinite(latency)]
    latencies = [float(part) for part in np.quantile(known, [0.5, 0.99, 1.0])] if len(known) else [None] * 3
    dropped = np.flatnonzero(mark != LIVE_MARKS.index("emitted"))
    return {
        "poses": file.pose_count,
        "poses_emitted": len(known),
        "samples": run.samples,
        "duration": run.duration,
        **dict(zip(("latency_p50", "latency_p99", "latency_max"), latencies, strict=True)),
        **{name: int(np.count_nonzero(mark == number)) for number, name in enumerate(LIVE_MARKS)},
        "seconds_dropped": len(np.unique((dropped / run.update_rate).astype(np.int64))),
    }
