"""The run sheet: what a study's plan amounts to, as text for people and as values for programs."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from ...terminal.foreign_text import visible
from .study_judgement import StudyJudgement
from .study_plan import StudyPlan

WIDTH = 100  # characters of a line
NAME_WIDTH = 40  # of the first column of a table; a longer name has a line of its own


def run_sheet(plan: StudyPlan, judgement: StudyJudgement) -> str:
    """The run sheet as plain text of lines of at most 100 characters."""
    return "\n".join(line for paragraph in _paragraphs(plan, judgement) for line in (*paragraph, "")).rstrip() + "\n"


def run_sheet_values(plan: StudyPlan, judgement: StudyJudgement) -> dict[str, Any]:
    """What the run sheet is written of, for JSON."""
    return {
        "plan": str(plan.path),
        "seed": plan.seed,
        "block_order": plan.block_order,
        "codes": list(plan.codes),
        **judgement.as_dict(),
    }


def _paragraphs(plan: StudyPlan, judgement: StudyJudgement) -> Iterator[list[str]]:
    yield [
        *_wrapped(plan.title),
        *_wrapped(f"plan {plan.path}, seed {plan.seed}, array {judgement.array} at {judgement.update_rate:g} Hz"),
    ]
    count = len(plan.codes)
    yield [
        *_wrapped(f"{count} participant{'' if count == 1 else 's'}; {judgement.balance}."),
        *_wrapped(
            f"One run: {_span(judgement.trials_least, judgement.trials_most)} trials, up to "
            f"{judgement.intervals_most} intervals, {_minutes(judgement.seconds, judgement.seconds_longest)} min if "
            f"each answer takes {plan.answer_seconds:g} s."
        ),
    ]
    rows = [
        (
            f"{number} {own.name}",
            own.design,
            str(own.practice),
            _span(own.trials_least, own.trials_most),
            str(own.intervals_most),
            _minutes(own.seconds, own.seconds_longest),
        )
        for number, own in enumerate(judgement.blocks, 1)
    ]
    yield _table(("block", "design", "practice", "trials", "intervals", "min"), rows)
    width = max(len(own.participant) for own in judgement.participants)
    numbers = {own.name: str(number) for number, own in enumerate(judgement.blocks, 1)}
    yield [
        "order of blocks",
        *(
            line
            for own in judgement.participants
            for line in _wrapped(
                f"{own.participant:<{width}}  {' '.join(numbers[name] for name in own.blocks)}", " " * (width + 2)
            )
        ),
    ]
    yield _limit_lines(judgement)
    yield _table(
        ("stimulus", "kind", "s", "duty"),
        [(own.name, own.kind, f"{own.seconds:g}", f"{own.duty:.3g}") for own in judgement.stimuli],
        [
            [f"{'file' if own.kind == 'stored' else 'object'} {own.source}"]
            + ([f"SHA-256 {own.sha256}"] if own.sha256 is not None else [])
            for own in judgement.stimuli
        ],
    )
    if judgement.notes:
        yield ["notes", *(line for own in judgement.notes for line in _wrapped(f"- {own}", "  "))]
    count = len(judgement.faults)
    if count == 0:
        yield ["The plan has no fault."]
    else:
        title = "1 fault: the study cannot be run before it is mended"
        if count > 1:
            title = f"{count} faults: the study cannot be run before they are mended"
        yield [title, *(line for own in judgement.faults for line in _wrapped(f"- {own}", "  "))]


def _limit_lines(judgement: StudyJudgement) -> list[str]:
    """What a run asks of the array at worst, beside the bounds."""
    limits = judgement.limits
    on_time = "no bound" if limits.on_time_max is None else f"bound {limits.on_time_max:g} s"
    duty = "no bound" if limits.duty_max is None else f"bound {limits.duty_max:g}"
    return [
        "array at worst",
        f"emission without a pause of {limits.pause_min:g} s: {judgement.on_time_worst:.4g} s ({on_time})",
        f"mean duty over {limits.duty_window:g} s: {judgement.duty_worst:.3g} ({duty})",
        f"pauses that these bounds add to one run: {judgement.pause_seconds:.0f} s",
    ]


def _table(
    head: Sequence[str], rows: Sequence[Sequence[str]], details: Sequence[Sequence[str]] | None = None
) -> list[str]:
    """Rows in columns, the first one to the left, numbers to the right; details: lines below each row."""
    cells = [[visible(cell) for cell in row] for row in (head, *rows)]
    names = [len(row[0]) for row in cells if len(row[0]) <= NAME_WIDTH]
    widths = [max(names), *(max(len(row[place]) for row in cells) for place in range(1, len(head)))]
    lines = []
    for number, (name, *values) in enumerate(cells):
        if len(name) > widths[0]:
            lines += _wrapped(name)
            name = ""
        columns = [
            f"{value:<{width}}" if place == 0 else f"{value:>{width}}"
            for place, (value, width) in enumerate(zip(values, widths[1:], strict=True))
        ]
        lines.append("  ".join([f"{name:<{widths[0]}}", *columns]).rstrip())
        if details is not None and number > 0:
            lines += [line for own in details[number - 1] for line in _wrapped(f"  {own}", "    ")]
    return lines


def _wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of a text, of which a word that is longer than a line is broken."""
    return textwrap.wrap(visible(text), WIDTH, subsequent_indent=indent, break_on_hyphens=False) or [""]


def _span(least: int, most: int) -> str:
    return str(least) if least == most else f"{least}-{most}"


def _minutes(seconds: float, longest: float) -> str:
    least, most = f"{seconds / 60:.1f}", f"{longest / 60:.1f}"
    return least if least == most else f"{least}-{most}"
