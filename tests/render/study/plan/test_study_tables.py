"""The keys of STUDY.toml: docs/formats/study-plan.md lists each with its bounds, its default and where it stands."""

import json
from pathlib import Path

import pytest
from pydantic import BeforeValidator

from palpate.render.study.plan.study_plan import TEXTS
from palpate.render.study.plan.study_tables import (
    CODE,
    COLUMN,
    DESIGN_KEYS,
    NAME,
    QUESTION_KEYS,
    LiveStimulusKeys,
    PreparedStimulusKeys,
    SentenceCheck,
    StudyKeys,
    check_key,
)
from palpate.render.sweeps.plan.values import ChoiceCheck, NumberCheck, PlanFault, VectorCheck

PAGE = Path(__file__).parents[4] / "docs/formats/study-plan.md"
GROUPS = {
    "study": {"": StudyKeys},
    "stimulus": {"object": LiveStimulusKeys, "file": PreparedStimulusKeys},
    "question": QUESTION_KEYS,
    "block": DESIGN_KEYS,
}


def form_of(check):
    """The values that a check takes, in words."""
    if isinstance(check, NumberCheck):
        return f"{'whole number' if check.whole else 'number'} in {check.span}"
    if isinstance(check, ChoiceCheck):
        return f"one of {', '.join(check.known)}"
    if isinstance(check, VectorCheck):
        return f"{check.size} numbers in {check.number.span}"
    return "text" if isinstance(check, SentenceCheck) else check.form


def default_of(field):
    if field.is_required():
        return "needed"
    if field.default is None or field.default in ("", []):
        return ""
    return f"`{json.dumps(field.default)}`"


def rows_of(group):
    """The rows of a table of keys; the first column says in which tables a key stands, if not in all."""
    owners, models = {}, GROUPS[group]
    for name, model in models.items():
        for key, field in model.model_fields.items():
            (check,) = [own.func for own in field.metadata if isinstance(own, BeforeValidator)] or [
                own.func for own in field.annotation.__args__[0].__metadata__
            ]
            row = f"`{key}` | {form_of(check)} | {default_of(field)} | {field.description}"
            owners.setdefault(row, []).append(name)
    every = sorted((row for row in owners if len(owners[row]) == len(models)), key=list(owners).index)
    others = [row for row in owners if row not in every]
    return [
        f"| {'' if row in every else ', '.join(owners[row])} | {row} |" if len(models) > 1 else f"| {row} |"
        for row in [*every, *others]
    ]


@pytest.mark.parametrize("group", GROUPS)
def test_the_page_lists_every_key_as_it_is_checked(group):
    rows = rows_of(group)
    assert len(rows) > 8
    assert "\n" + "\n".join(rows) + "\n\n" in PAGE.read_text(), "\n".join(rows)


def test_the_page_lists_the_sentences_that_can_be_translated():
    page = " ".join(PAGE.read_text().split())
    assert [name for name, text in TEXTS.items() if f'`{name}` "{text}"' not in page] == []


@pytest.mark.parametrize(
    ("check", "good", "bad"),
    [
        (
            NAME,
            ["a", "70 Hz", "cube-0.7", "größe +5%", "x" * 64],
            ["", " a", "a ", "x" * 65, "a/b", "a\n", "{a}", 3, "-"],
        ),
        (COLUMN, ["age", "how_hard", "größe", "x" * 64], ["", "2nd", "a b", "a-b", "_a", "x" * 65, None]),
        (CODE, ["P01", "a-b_c", "0" * 16], ["", "ä", "a b", "0" * 17, "a\n"]),
        (check_key, ["a", "1", " ", "é", "ArrowUp", "PageDown"], ["", "ab", "\n", "\x07", 1, "Escape"]),
    ],
)
def test_names_and_keys_are_of_certain_characters(check, good, bad):
    assert [check(own) for own in good] == good
    for own in bad:
        with pytest.raises(PlanFault):
            check(own)
