"""Seconds that the stages of a rendering take."""

from time import perf_counter
from typing import Any

import warp as wp


class QueuedTimes(dict[str, float]):
    """Seconds by stage on a GPU, which is not waited for after each stage; `resolved_times` fills them in."""

    def __init__(self) -> None:
        super().__init__()
        self.queued: list[tuple[str, wp.Event, wp.Event]] = []
        """Each stage's name, and the events that the GPU passes at its begin and end."""


def stage_times(device: str) -> dict[str, float]:
    """An empty `timing` for `StageClock` that makes it wait for no GPU; `resolved_times` gives its seconds."""
    return QueuedTimes() if wp.get_device(device).is_cuda else {}


def resolved_times(timing: dict[str, float]) -> dict[str, float]:
    """Seconds by stage; waits for the stages that are queued."""
    if isinstance(timing, QueuedTimes):
        for stage, begun, ended in timing.queued:
            timing[stage] = timing.get(stage, 0.0) + wp.get_event_elapsed_time(begun, ended) / 1e3
        timing.queued.clear()
    return dict(timing)


class StageClock:
    """Adds the seconds of a stage to `timing`, or does nothing if that is None; `QueuedTimes` are not waited for."""

    def __init__(self, timing: dict[str, float] | None, stage: str, device: str) -> None:
        self._timing, self._stage, self._device = timing, stage, device

    def __enter__(self) -> None:
        """Start."""
        self._begun = self._now()

    def __exit__(self, *raised: object) -> None:
        """Stop and add."""
        begun, ended = self._begun, self._now()
        if isinstance(self._timing, QueuedTimes):
            self._timing.queued.append((self._stage, begun, ended))
        elif self._timing is not None:
            self._timing[self._stage] = self._timing.get(self._stage, 0.0) + (ended - begun)

    def _now(self) -> Any:  # wp.Event, or float
        """An event that the device passes after all that it has been given, or the time once it has done that [s]."""
        if isinstance(self._timing, QueuedTimes):
            return wp.get_stream(self._device).record_event(wp.Event(self._device, enable_timing=True))
        if self._timing is not None:
            wp.synchronize_device(self._device)
        return perf_counter()
