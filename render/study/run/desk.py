"""What participant and experimenter see and say: between the thread that runs a study and the pages in browsers."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from ...errors import StudyError
from ..plan.study_plan import Answer, Question


class StudyClock:
    """Time of CLOCK_MONOTONIC, and waiting in it. Tests have subclasses, so that a study takes seconds there."""

    def __repr__(self) -> str:
        """One line."""
        return f"{type(self).__name__}({self.now():.3f} s)"

    def now(self) -> float:
        """The time [s of time.monotonic()]."""
        return time.monotonic()

    def wait(self, changed: threading.Condition, seconds: float, until: Callable[[], bool] | None = None) -> None:
        """Wait on a condition, whose lock the caller holds: until `until` is true, or without it until it is notified.

        seconds: that it takes at most. Without `until` it may return earlier: callers ask again.
        """
        if until is None:
            changed.wait(seconds)
        else:
            changed.wait_for(until, seconds)

    def sleep(self, seconds: float) -> None:
        """Do nothing for a time [s]."""
        time.sleep(seconds)


ScreenKind = Literal["text", "question", "stimulus", "rest", "wait", "ended"]
LOST_SECONDS = 1.5  # without a word of the participant's page, after which it counts as closed


@dataclass(frozen=True, kw_only=True)
class KeyChoice:
    """A key, and what it stands for on a screen."""

    key: str
    """As browsers name it: "ArrowLeft", " ", "1", "Enter"."""
    label: str
    value: Answer = None
    """The answer that it gives."""


@dataclass(frozen=True, kw_only=True)
class ShownObject:
    """What a participant sees beside the words."""

    solid: str
    """Name of the mesh that is drawn; it does not reveal to the participant how it is rendered."""
    opacity: float
    """Above 0, at most 1."""
    has_hand: bool


@dataclass(frozen=True, kw_only=True)
class Screen:
    """What the participant's page shows; the next one has a larger number."""

    number: int
    kind: ScreenKind
    """`text`: to read; `question`; `stimulus`: an interval plays; `rest`: until `ends` [s of time.monotonic()]; `wait`:
    the study is stopped, or nothing has begun; `ended`: nothing more comes."""
    text: str
    """What is read in large letters."""
    title: str = ""
    """Above the text: which part or trial this is."""
    hint: str = ""
    """Below it: what to do."""
    keys: tuple[KeyChoice, ...] = ()
    """Keys that do something; of a `number` or `text` question none: its characters and Enter do."""
    question: Question | None = None
    shown: ShownObject | None = None
    refusal: str = ""
    """What is read where the question does not take what was typed; empty: the desk's own sentence."""
    ends: float | None = None
    has_noise: bool = False
    """Masking noise plays."""
    progress: float = 0.0
    """Of the whole study, 0..1."""


@dataclass(frozen=True, kw_only=True)
class Response:
    """What a participant has answered to a screen."""

    value: Answer
    key: str
    """The key that was pressed; "Enter" of what was typed."""
    seconds: float
    """From when the page showed the screen until the key went down, by the browser's clock [s]."""


class StudyDesk:
    """Where the thread that runs a study puts screens and gets responses; pages ask it from threads of their own.

    A response counts once, and only for the screen that is shown: a key pressed twice, or for a screen that has gone,
    changes nothing and is counted. clock: by which a page that has not asked for a while counts as closed.
    """

    def __init__(self, clock: StudyClock | None = None) -> None:
        self.clock = clock or StudyClock()
        self._changed = threading.Condition()
        self._screen = Screen(number=0, kind="wait", text="")
        self._response: Response | None = None
        self._seen = float("-inf")
        self._page = self._page_count = 0  # number of the page that is open, 0 for none; pages that were opened
        self._is_stopped = self._is_ended = False
        self._stop_reason = ""
        self._status: dict[str, Any] = {}
        self._watchers: list[Callable[[Screen], None]] = []
        self.extra_presses = 0
        """Keys that came too late, twice, or where none was asked for."""

    # For the participant's page.

    def screen(self) -> Screen:
        """What is shown now; that the page asks says that it is open."""
        with self._changed:
            self._seen = self.clock.now()
            return self._screen

    def press(self, number: int, key: str, seconds: float) -> bool:
        """A key went down while screen `number` was shown; whether it counts."""
        with self._changed:
            choice = next((own for own in self._screen.keys if own.key == key), None)
            if choice is None:
                self.extra_presses += 1
                return False
            return self._respond(number, Response(value=choice.value, key=key, seconds=seconds))

    def give(self, number: int, value: Answer, seconds: float) -> bool:
        """A number or a text was typed for screen `number`; whether it counts.

        Raises StudyError for one that the question does not take.
        """
        with self._changed:
            question = self._screen.question
            if question is None or question.kind not in ("number", "text") or number != self._screen.number:
                self.extra_presses += 1
                return False
            _require_fitting(question, value)
            return self._respond(number, Response(value=value, key="Enter", seconds=seconds))

    def open_page(self) -> int:
        """The participant's page is open; returns its number. Raises StudyError where one is already."""
        with self._changed:
            if self.has_page:
                raise StudyError("the participant's page is open already: close it, or go on there")
            self._page_count += 1
            self._page, self._seen = self._page_count, self.clock.now()
            self._changed.notify_all()
            return self._page

    def is_open(self, page: int) -> bool:
        """Whether a page is still the participant's, and no other one has taken its place since it was lost."""
        return self._page == page

    def close_page(self, page: int) -> None:
        """A page was closed: if it is the participant's, what plays is stopped."""
        with self._changed:
            if self._page == page:
                self._page = 0
                self._changed.notify_all()

    # For the experimenter's page.

    def stop(self, reason: str) -> None:
        """Stop what plays, and wait until `go_on`."""
        with self._changed:
            self._is_stopped, self._stop_reason = True, reason
            self._changed.notify_all()

    def go_on(self) -> None:
        """Go on after `stop`; the trial that was stopped is played again."""
        with self._changed:
            self._is_stopped = False
            self._changed.notify_all()

    def end(self) -> None:
        """End the run now; the participant may go on another time."""
        with self._changed:
            self._is_ended = True
            self._changed.notify_all()

    def status(self) -> dict[str, Any]:
        """What the experimenter sees: the values that the run has set, and whether a page is open and it is stopped."""
        with self._changed:
            return {
                **self._status,
                "has_page": self.has_page,
                "is_stopped": self._is_stopped,
                "stop_reason": self._stop_reason if self._is_stopped else "",
                "is_ended": self._is_ended,
                "screen": self._screen.kind,
                "extra_presses": self.extra_presses,
            }

    # For others who show what the participant sees.

    @property
    def shown(self) -> Screen:
        """What is shown now; asking does not say that the participant's page is open."""
        return self._screen

    def watch(self, callback: Callable[[Screen], None]) -> Callable[[], None]:
        """Have each new screen handed to `callback`, by the thread that shows it; the result ends this.

        No lock of the desk is held meanwhile, so that the callback may ask the desk. It must neither wait nor raise.
        """
        with self._changed:
            self._watchers.append(callback)

        def end() -> None:
            with self._changed:
                if callback in self._watchers:
                    self._watchers.remove(callback)

        return end

    # For the thread that runs the study.

    @property
    def has_page(self) -> bool:
        """Whether the participant's page is open, and has asked for its screen lately."""
        return self._page > 0 and self.clock.now() - self._seen < LOST_SECONDS

    @property
    def is_ended(self) -> bool:
        """Whether `end` was called."""
        return self._is_ended

    @property
    def is_held(self) -> bool:
        """Whether nothing may play now: the study is stopped, ended, or no page is open."""
        return self._is_stopped or self._is_ended or not self.has_page

    @property
    def is_stopped(self) -> bool:
        """Whether the experimenter has stopped the study."""
        return self._is_stopped

    def show(self, kind: ScreenKind, text: str, **fields: Any) -> Screen:
        """Show a screen; fields as `Screen`'s."""
        with self._changed:
            self._screen = Screen(number=self._screen.number + 1, kind=kind, text=text, **fields)
            self._response = None
            self._changed.notify_all()
            screen, watchers = self._screen, tuple(self._watchers)
        for watcher in watchers:
            watcher(screen)
        return screen

    def await_response(self, seconds: float) -> Response | None:
        """The response to the screen that is shown; None if none has come after so many seconds, or the run is held."""
        with self._changed:
            self.clock.wait(self._changed, seconds, lambda: self._response is not None or self.is_held)
            return self._response

    def await_change(self, seconds: float, clock: StudyClock | None = None) -> None:
        """Wait for `stop`, `go_on`, `end`, a page that opens or closes, or the time by `clock`, else the desk's own."""
        with self._changed:
            (clock or self.clock).wait(self._changed, seconds)

    def set_status(self, **values: Any) -> None:
        """What the experimenter sees from now on."""
        with self._changed:
            self._status |= values

    def _respond(self, number: int, response: Response) -> bool:
        if number != self._screen.number or self._response is not None or self._is_stopped:
            self.extra_presses += 1
            return False
        self._response = response
        self._screen = replace(self._screen, keys=())  # what is pressed twice finds no key
        self._changed.notify_all()
        return True


def _require_fitting(question: Question, value: Answer) -> None:
    """Raise StudyError for a typed answer that the question does not take."""
    if value is None or value == "":
        if not question.is_optional:
            raise StudyError(f"{question.name} must be answered")
        return
    if question.kind == "text":
        if not isinstance(value, str) or len(value) > 10_000:
            raise StudyError(f"{question.name} must be a text of at most 10000 characters")
        return
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise StudyError(f"{question.name} must be a number, not {value!r}")
    low, high = question.low, question.high
    if not (float("-inf") if low is None else low) <= value <= (float("inf") if high is None else high):
        raise StudyError(
            f"{question.name} must be from {'-inf' if low is None else low} to {'inf' if high is None else high}, not "
            f"{value!r}"
        )
