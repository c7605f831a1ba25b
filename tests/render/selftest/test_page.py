"""The page of the first hour and the table of its steps agree, and what they send people to is there."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from palpate.device.registry import array_model
from palpate.device.report import PlayReport
from palpate.render.selftest.steps import STEPS, steps_for

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs/guide/first-contact.md").read_text()
SHORT = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
WRONG = [(step, answer) for step in STEPS for answer in step.answers[1:]]
IN_TURN = [  # failures of issue 13, the likeliest first
    "grid of blocks", "adapter is not found", "FIFO mode", "board file is refused", "Divider 3", "y is mirrored",
    "AUTD3's firmware", "wrong length for a cancelled transfer",
]  # fmt: skip


def section(step):
    """What the page is to say of a step; a failing test prints it, to be put there."""
    played = " + ".join(f"{stimulus.seconds:g} s" for stimulus in step.stimuli) or "nothing"
    rows = [
        f"| `{answer.key}` | {answer.sentence} | "
        + (f"{answer.meaning} **Change:** {answer.change} |" if answer.meaning else "expected |")
        for answer in step.answers
    ]
    return (
        f"### `{step.name}`\n\n{step.instruction} (Plays {played}, on {', '.join(step.arrays)}.)\n\n"
        f"**{step.question}**\n\n| answer | | means |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.name)
def test_each_step_and_each_wrong_answer_stands_in_the_page(step):
    assert section(step) in PAGE


def test_the_page_has_no_other_steps_and_the_same_order():
    assert re.findall(r"^### `(.*)`$", PAGE, re.MULTILINE) == [step.name for step in STEPS]


def test_likely_failures_stand_in_their_order():
    listed = re.findall(r"^(\d)\. \*\*(.*?)\*\*", PAGE, re.MULTILINE)
    assert [int(number) for number, _ in listed] == list(range(1, 9))
    for (_, title), words in zip(listed, IN_TURN, strict=True):
        assert words in title


def test_keys_can_be_typed_and_are_no_commands():
    for step in STEPS:
        keys = [answer.key for answer in step.answers]
        assert len(set(keys)) == len(keys) >= 2
        assert all(SHORT.fullmatch(key) and len(key) > 1 for key in keys)  # ?, s and q are commands
        assert step.answers[0].meaning == step.answers[0].change == ""
    assert len({step.name for step in STEPS}) == len(STEPS)


@pytest.mark.parametrize(("step", "answer"), WRONG, ids=lambda one: getattr(one, "name", None) or one.key)
def test_what_is_to_be_changed_is_there(step, answer):
    """Files exist, and the names in them; what else stands in backticks is a step, an answer, a field, or typed."""
    assert answer.meaning.endswith(".")
    assert answer.change.endswith((".", ")"))
    named = [ROOT / name for name in re.findall(r"(?:device|render|docs)/[\w/-]+\.(?:py|md)", answer.change)]
    text = "".join(path.read_text() for path in named)
    known = {field.name for field in fields(PlayReport)} | {"failure"} | {one.name for one in STEPS}
    known |= {one.key for one in step.answers}
    for name in re.findall(r"`([^`]*)`", answer.change):
        if name in known or name.startswith(("--", "palpate ")):
            continue
        assert re.fullmatch(r"[A-Za-z_]\w*(\.\w+)?", name), name
        for part in name.split("."):
            assert re.search(rf"\b{part}\b", text), (name, named)


@pytest.mark.parametrize("array", ["emulator", "pat16", "sonicsurface", "autd3"])
def test_each_array_has_the_steps_that_can_be_played_on_it(array):
    names = [step.name for step in steps_for(array_model(array))]
    assert {"corner", "focus", "turn", "ending", "stopping", "minute"} <= set(names)
    assert ("unplug" in names) == (array != "autd3")  # which hangs on the network
    assert ("pitch" in names) == (array != "sonicsurface")  # 89 frames a second carry no tone
    assert ("fast" in names) == (array == "pat16")  # whose chip is the bottleneck
