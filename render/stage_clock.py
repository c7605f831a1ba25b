"""How long stages take."""

import warp as wp


class StageClock:
    """Adds the seconds of a stage to `timing`, or does nothing if that is None."""

    def __init__(self, timing: dict[str, float] | None, stage: str, device: str) -> None:
        self._timing, self._stage, self._device = timing, stage, device
        self._timer = wp.ScopedTimer(stage, active=False)

    def __enter__(self) -> None:
        """Start."""
        if self._timing is not None:
            self._timer = wp.ScopedTimer(self._stage, print=False, synchronize=True)
            self._timer.__enter__()

    def __exit__(self, *raised: object) -> None:
        """Stop and add."""
        if self._timing is not None:
            self._timer.__exit__(*raised)
            self._timing[self._stage] = self._timing.get(self._stage, 0.0) + self._timer.elapsed / 1e3
