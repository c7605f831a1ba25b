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


def row(step):
    """What the page is to show of a step; a failing test prints it, to be put there."""
    seconds = sum(stimulus.seconds for stimulus in step.stimuli)
    return f"| `{step.name}` | {step.question} | `{step.answers[0].key}` | {seconds:g} s | {', '.join(step.arrays)} |"


def test_each_step_stands_in_the_page_with_its_question_and_the_expected_answer():
    rows = [line for line in PAGE.partition("## The steps")[2].splitlines() if line.startswith("| `")]
    assert rows == [row(step) for step in STEPS]


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.name)
def test_what_is_to_be_changed_is_there(step):
    """Files exist, and the names in them; what else stands in backticks is a step, an answer, a field, or typed."""
    for answer in step.answers[1:]:
        assert answer.meaning.endswith(".")
        assert answer.change.endswith((".", ")"))
        named = [
            ROOT / name for name in re.findall(r"(?:device|kernels|render|docs)/[\w/-]+\.(?:py|md)", answer.change)
        ]
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
