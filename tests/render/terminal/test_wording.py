"""Arguments in messages: as Python has them, as a command's options, as a plan's keys."""

import pytest

from palpate.render.cli.command_group import PLAN_KEYS
from palpate.render.terminal.wording import Wording

RENDER = Wording(["fit", "at", "up", "overwrite", "resume", "fill_holes", "strategy"], ["duration", "emulate"])


@pytest.mark.parametrize(
    ("in_python", "on_the_command_line"),
    [
        ("use scale=0.001, or fit=0.13", "use scale=0.001, or --fit 0.13"),
        ("at=(0, 0, 0.2) places it in front", "--at 0 0 0.2 places it in front"),
        ("x.h5: exists; overwrite=True replaces it", "x.h5: exists; --overwrite replaces it"),
        ('mode="overwrite" replaces it, mode="resume" keeps it', "--overwrite replaces it, --resume keeps it"),
        ("up must be one of x, y, not 'w'", "--up must be one of x, y, not 'w'"),
        ("mine.json: up must be one of x", "mine.json: up must be one of x"),  # a field of the file
        ("fill_holes=0.02 closes every hole", "--fill-holes 0.02 closes every hole"),
        ('strategy="oc" accepts any mesh', "--strategy oc accepts any mesh"),
        ("say duration=SECONDS, emulate=True", "say --duration SECONDS, --emulate"),  # of other commands
        ("the.fit=0.13 and --fit=0.13 are no arguments", "the.fit=0.13 and --fit=0.13 are no arguments"),
    ],
)
def test_arguments_become_options(in_python, on_the_command_line):
    assert RENDER(in_python) == on_the_command_line
    assert Wording()(in_python) == in_python


def test_where_a_plan_has_the_key_it_is_one():
    sweep = Wording(["overwrite"], keys=PLAN_KEYS)
    assert sweep("use scale=0.001 or at=(0, 0, 0.2)") == "use scale = 0.001 or at = [0, 0, 0.2]"
    assert sweep("overwrite=True") == "--overwrite"
