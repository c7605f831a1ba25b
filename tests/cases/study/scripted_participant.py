"""A participant for tests: reads the desk's screens as a page does, and presses keys by a rule."""

import threading
import time
from collections.abc import Callable

from palpate.render.study.run.desk import Screen, StudyDesk

Rule = Callable[[Screen], object]
"""What to do at a new screen: a key as text, ("give", value), or None for nothing."""


def first_key(screen: Screen) -> object:
    """The first key of each screen; of a number or a text, the least that is taken."""
    if screen.keys:
        return screen.keys[0].key
    question = screen.question
    if question is None or screen.kind != "question":
        return None
    return ("give", question.low or 0 if question.kind == "number" else "nothing")


class ScriptedParticipant:
    """Answers in a thread, from when the `with` is entered until it is left."""

    def __init__(self, desk: StudyDesk, rule: Rule = first_key, seconds: float = 0.25) -> None:
        self._desk, self._rule, self._seconds = desk, rule, seconds
        self.screens: list[Screen] = []
        self.error: BaseException | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "ScriptedParticipant":
        self._page = self._desk.open_page()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join(5)
        self._desk.close_page(self._page)

    def _run(self) -> None:
        number = -1
        try:
            while not self._is_over.is_set():
                screen = self._desk.screen()
                if screen.number != number:
                    number = screen.number
                    self.screens.append(screen)
                    self._answer(screen, self._rule(screen))
                time.sleep(0.001)
        except BaseException as error:
            self.error = error

    def _answer(self, screen: Screen, answer: object) -> None:
        if isinstance(answer, str):
            assert self._desk.press(screen.number, answer, self._seconds)
        elif answer is not None:
            assert self._desk.give(screen.number, answer[1], self._seconds)
