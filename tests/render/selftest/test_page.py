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


def test_each_step_and_each_wrong_answer_stands_in_the_page():
    for step in STEPS:
        assert section(step) in PAGE, step.name


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
