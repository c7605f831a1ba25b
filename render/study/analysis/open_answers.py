"""Answers that no test is made of: counts of options, numbers as mean and range, and what people wrote."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from ..plan.study_plan import Question
from .answer_measures import counted
from .study_table import AnswerRecord, StudyTable

PLAIN_BELOW = 1e6
"""Numbers from which on a power of ten is written."""
AROUND = {"before": "before all blocks", "after": "after all blocks"}


@dataclass(frozen=True, kw_only=True)
class QuestionAnswers:
    """All answers to one question at one place."""

    question: Question
    place: str
    """A block's name, with the stimuli of the trial, or "before all blocks"."""
    answers: tuple[AnswerRecord, ...]

    @property
    def summary(self) -> str:
        """Of choices how often each was given; of numbers mean, deviation and range; of texts how many there are."""
        given = [own.value for own in self.answers if own.value is not None and own.value != ""]
        left = len(self.answers) - len(given)
        empty = f"; {left} left empty" if left else ""
        if self.question.kind == "choice":
            found = Counter(own.label for own in self.answers)
            return ", ".join(f"{option} {found[option]}" for option in self.question.options)
        numbers = np.array([own for own in given if isinstance(own, int | float)], dtype=np.float64)
        if self.question.kind == "text" or not len(numbers):
            return f"{len(given)} answer{'s' * (len(given) != 1)}{empty}"
        with np.errstate(over="ignore"):  # a person may type 1e300
            mean, deviation = float(numbers.mean()), float(numbers.std(ddof=1)) if len(numbers) > 1 else None
        form = ".1f" if np.abs(numbers).max() < PLAIN_BELOW else ".3g"
        spread = "" if deviation is None else f" ± {deviation:{form}}"
        return f"{mean:{form}}{spread} ({numbers.min():g} to {numbers.max():g}), n = {len(numbers)}{empty}"

    @property
    def texts(self) -> tuple[tuple[str, str], ...]:
        """Who wrote what, where something was written."""
        return tuple((own.code, own.value) for own in self.answers if isinstance(own.value, str) and own.value)


def open_answers(table: StudyTable) -> list[QuestionAnswers]:
    """Questions before and after all blocks, after blocks but scales, and of explorations but scales, as asked."""
    found = []
    plan, answers = table.plan, list(counted(table))
    for place, questions in (("before", plan.questions_before), ("after", plan.questions_after)):
        for question in questions:
            own = tuple(one for one in answers if (one.block, one.name) == (place, question.name))
            found.append(QuestionAnswers(question=question, place=AROUND[place], answers=own))
    for block in plan.blocks:
        of_block = [own for own in answers if own.block == block.name]
        asked = block.questions if block.design == "exploration" else ()
        for names in block.sets:
            for question in asked:
                own = tuple(one for one in of_block if (one.name, one.stimuli) == (question.name, names))
                place = f"{block.name}: {', '.join(names)}"
                if question.kind != "scale":
                    found.append(QuestionAnswers(question=question, place=place, answers=own))
        for question in block.questions_after:
            own = tuple(one for one in of_block if (one.name, one.trial) == (question.name, -1))
            if question.kind != "scale":
                found.append(QuestionAnswers(question=question, place=block.name, answers=own))
    return found
