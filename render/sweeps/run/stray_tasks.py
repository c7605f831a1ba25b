"""A task that was given to an engine and that none of its workers has: nobody would ever make it."""

from collections.abc import Callable, Sequence

from ...errors import SweepError
from ..make.task import Engine

STRAY_LONGEST = 10.0  # [s] for which all workers may be free although tasks are given: their outcomes are under way


class StrayTasks:
    """Watches for tasks that no worker has. clock: seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._held_at = clock()
        """When workers last had tasks, or none were given."""

    def look(self, numbers: Sequence[int], engine: Engine, *, is_moving: bool) -> None:
        """Raise SweepError if all workers have been free for `STRAY_LONGEST` although tasks were given.

        numbers: of tasks that were given and of which no outcome has come. is_moving: whether outcomes have just come.
        """
        workers = len(engine.devices)
        if is_moving or not numbers or not workers or engine.free_count() < workers:
            self._held_at = self._clock()
        elif self._clock() - self._held_at > STRAY_LONGEST:
            named = ", ".join(map(str, numbers))
            raise SweepError(
                f"no worker has task {named}, which was given to {engine.name}: a fault of palpate. What was made is "
                "kept; `--workers 1` makes the rest in one process"
            )
