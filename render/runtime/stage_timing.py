"""How long stages take."""

import warp as wp


class QueuedTimes(dict[str, float]):
    """Seconds of stages of a GPU that is not waited for after each: there once `resolve` has been called."""

    def __init__(self) -> None:
        super().__init__()
        self._stages: list[tuple[str, wp.Event, wp.Event]] = []

    def queue(self, stage: str, begun: wp.Event, ended: wp.Event) -> None:
        """Take what the device will pass at a stage's begin and end."""
        self._stages.append((stage, begun, ended))

    def resolve(self) -> None:
        """Wait for what is queued, and add up."""
        for stage, begun, ended in self._stages:
            self[stage] = self.get(stage, 0.0) + wp.get_event_elapsed_time(begun, ended) / 1e3
        self._stages.clear()


def stage_times(device: str) -> dict[str, float]:
    """What takes the seconds of stages on a device without waiting for them; see `resolved_times`."""
    return QueuedTimes() if wp.get_device(device).is_cuda else {}


def resolved_times(timing: dict[str, float]) -> dict[str, float]:
    """The seconds, once there."""
    if isinstance(timing, QueuedTimes):
        timing.resolve()
    return dict(timing)


class StageClock:
    """Adds the seconds of a stage to `timing`, or does nothing if that is None; `QueuedTimes` are not waited for."""

    def __init__(self, timing: dict[str, float] | None, stage: str, device: str) -> None:
        self._timing, self._stage, self._device = timing, stage, device
        self._timer = wp.ScopedTimer(stage, active=False)
        self._begun: wp.Event | None = None

    def _event(self) -> wp.Event:
        """What the device passes after all that it has been given."""
        return wp.get_stream(self._device).record_event(wp.Event(self._device, enable_timing=True))

    def __enter__(self) -> None:
        """Start."""
        if isinstance(self._timing, QueuedTimes):
            self._begun = self._event()
        elif self._timing is not None:
            self._timer = wp.ScopedTimer(self._stage, print=False, synchronize=True)
            self._timer.__enter__()

    def __exit__(self, *raised: object) -> None:
        """Stop and add."""
        if isinstance(self._timing, QueuedTimes):
            if self._begun is not None:
                self._timing.queue(self._stage, self._begun, self._event())
        elif self._timing is not None:
            self._timer.__exit__(*raised)
            self._timing[self._stage] = self._timing.get(self._stage, 0.0) + self._timer.elapsed / 1e3
