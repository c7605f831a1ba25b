"""Asking a person: at a terminal, or by lines of a script on standard input."""

import sys
from typing import NamedTuple, TextIO

from ..errors import RenderError, StrategyError
from ..terminal.foreign_text import errors, print_message
from .question import Answer, Step

AT_ALL_TIMES = "? plays it again, s REASON skips the step, q ends; the report is kept"


class InputEnded(RenderError):
    """Standard input ended before all was answered."""


class Reply(NamedTuple):
    """What came back; exactly one of the fields is set."""

    answer: Answer | None = None
    skipped_because: str | None = None
    again: bool = False
    quits: bool = False


class Questioner:
    """Asks on standard error and reads lines: from a terminal, where a mistake is asked again, or from a script.

    A script's line that is no answer of the step at hand ends it with StrategyError: the lines behind it would be
    taken for answers to other questions. Empty lines of a script are left out.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stdin if stream is None else stream
        self.is_person = self._stream is not None and self._stream.isatty()

    def note(self, line: str) -> None:
        """Show a line."""
        print_message(line)

    def ready(self, step: Step) -> Reply | None:
        """Wait until a person is ready for the step, if it plays something: None to play. A script is always ready."""
        if not self.is_person or not step.stimuli:
            return None
        while True:
            line = self._line(step, "Enter plays it: ")
            if line in ("", "?"):
                return None
            if (reply := self._command(step, line)) is not None:
                return reply
            self.note(f"Nothing was played yet; {AT_ALL_TIMES}.")

    def ask(self, step: Step) -> Reply:
        """The answer to a step's question. Raises InputEnded at the end of input."""
        self.note(step.question)
        for answer in step.answers:
            self.note(f"  {answer.key:14} {answer.sentence}")
        while True:
            line = self._line(step, "answer: ")
            if (answer := step.answer(line.lower())) is not None:
                return Reply(answer=answer)
            if (reply := self._command(step, line)) is not None:
                return reply
            keys = ", ".join(answer.key for answer in step.answers)
            if not self.is_person:
                raise StrategyError(f"{line!r} answers nothing in step {step.name!r}; it takes {keys}, ?, s REASON, q")
            self.note(f"Please one of {keys}; {AT_ALL_TIMES}.")

    def _command(self, step: Step, line: str) -> Reply | None:
        word, _, rest = line.partition(" ")
        if line == "?":
            return Reply(again=True)
        if line.lower() == "q":
            return Reply(quits=True)
        if word.lower() != "s":
            return None
        reason = rest.strip()
        if not (reason or self.is_person):
            raise StrategyError(f"step {step.name!r} is skipped without a reason: write s REASON in one line")
        while not reason:
            reason = self._line(step, "why is it skipped? ")
        return Reply(skipped_because=reason)

    def _line(self, step: Step, prompt: str) -> str:
        """The next line, without blanks at its ends; a script's empty lines are left out."""
        while True:
            if self.is_person:
                errors.print(prompt, end="", markup=False)
            text = "" if self._stream is None else self._stream.readline()
            if text == "":
                raise InputEnded(f"the input ended before step {step.name!r} was answered")
            if self.is_person or text.strip():
                return text.strip()
