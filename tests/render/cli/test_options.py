"""Options of all commands: the same word means the same, and the page that lists them is what the code has."""

from collections import defaultdict
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from command_line import run

ROOT = Path(__file__).parents[3]
spec = spec_from_file_location("option_table", ROOT / "docs" / "option_table.py")
assert spec is not None
assert spec.loader is not None
option_table = module_from_spec(spec)
spec.loader.exec_module(option_table)
COMMANDS = dict(option_table.commands())
SEVERAL_MEANINGS = {
    "--at": "where an object is, or an instant",
    "--calibration": "devices takes several board files",
    "--device": "one, several, or only of solvers",
    "--dry-run": "of a sweep, of pruning, of a study",
    "--duration": "of an exploration, of a playback, of a stimulus, of a live run",
    "--kind": "of a volume that is read, of one that is made",
    "--label": "a part of a volume, or a file in a picture",
    "--out": "what is written",
    "--poses": "which of a file, how many of a measurement",
    "--sampling": "live takes several",
    "--resume": "a file's poses, or a participant",
    "--seed": "of an exploration, of simulated studies",
    "--side": "a recording's hands have ids, a live one is whichever is seen",
    "--source": "of poses, of noise",
    "--spacing": "of a volume by axis, of voxels that are made",
    "--strategy": "bench and live take several",
    "--strict": "what is warned of",
    "--workers": "a file, or a sweep",
    "--pressure": "of a page, or of a sweep",
    "--view": "where a picture is looked at from, or the page of a live run",
}
"""Options whose values are of one kind, and whose help says more than one sentence could for all commands."""


def test_the_page_of_options_is_what_the_commands_have():
    made, stands = option_table.page(), (ROOT / "docs" / "guide" / "options.md").read_text()
    assert made == stands, "run: python docs/option_table.py"


def test_an_option_has_one_meaning_or_a_reason_for_several():
    helps = defaultdict(set)
    for option in option_table.options():
        helps[option.names.split(", ")[-1]].add((option.takes, option.help))
    assert {name for name, texts in helps.items() if len(texts) > 1} == set(SEVERAL_MEANINGS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_the_same_options_for_output(command):
    options = {name: option for option in COMMANDS[command].params for name in option.opts}
    assert {"--json", "--quiet", "-q"} <= set(options)
    assert "--overwrite" in options or "--out" not in options
    assert ("-o" in options) == ("--out" in options)
    unnamed = [name for name, option in options.items() if name.startswith("--") and not option.is_flag]
    assert [name for name in unnamed if not options[name].metavar] == []  # else the help shows <str>
    assert all(option.help and option.help.endswith(".") for option in options.values())


def test_options_of_old_names_work():
    assert run("selftest", "--clock", "virtual", "--seconds=0.1").exit_code == 0


def test_a_value_that_looks_like_an_old_name_is_left_alone():
    renamed, taking = import_module("palpate.render.cli.options.command_group").renamed, {"-o", "--out"}
    assert renamed(["-o", "--folder", "--folder=x", "--", "--folder"], {"--folder": "--out"}, taking) == [
        "-o", "--folder", "--out=x", "--", "--folder"
    ]  # fmt: skip


def test_quiet_leaves_out_warnings_and_keeps_results_and_errors(tmp_path):
    far = tmp_path / "far.csv"
    far.write_text("time,x,y,z,qx,qy,qz,qw\n0,0,0,0.9,0.7071068,0,0,0.7071068\n0.1,0,0,0.9,0.7071068,0,0,0.7071068\n")
    told = run("render", "cube", far, "-o", tmp_path / "a.h5")
    quiet = run("render", "cube", far, "-o", tmp_path / "b.h5", "-q")
    assert "warning: no pose has a contour" in told.stderr
    assert quiet.stderr == ""
    assert quiet.stdout.count("\n") == told.stdout.count("\n")
    failed = run("render", "cube", far, "-o", tmp_path / "b.txt", "-q")
    assert failed.exit_code != 0
    assert "must end in .h5" in failed.stderr
