"""Options of all commands: what every command has, what their fields declare, and which words they know."""

from dataclasses import fields

import pytest
import typer.main
from command_line import MISUSED, refused, run

from palpate.datasets.shapes.built_in import shape_names
from palpate.device.link import TransportKind
from palpate.device.registry import array_kinds
from palpate.render.acoustics.averaged_frames import AVERAGES
from palpate.render.cli import array_options as arrays
from palpate.render.cli import contour_options as contours
from palpate.render.cli import inputs
from palpate.render.cli.app import app
from palpate.render.exports.file_export import FORMATS
from palpate.render.intersection.named_inputs import HANDS
from palpate.render.objects.voxels.files import UNITS, WRITERS
from palpate.render.objects.voxels.grid import KINDS
from palpate.render.objects.voxels.voxeliser import SIGNS
from palpate.render.playback.drive import AMPLITUDES, SOLVERS
from palpate.render.playback.file_playback import CLOCKS
from palpate.render.reports.picture_style import SUFFIXES
from palpate.render.sampling.presets import PRESETS as SAMPLINGS
from palpate.render.strategies.intersection_strategy import PRESETS as STRATEGIES


def commands():
    """Every command by its name; `sweep PLAN` is its group's hidden command."""
    for name, command in typer.main.get_command(app).commands.items():
        yield from (
            (f"{name} {part}".strip(), one) for part, one in getattr(command, "commands", {"": command}).items()
        )


def test_every_command_has_the_same_options_for_output():
    for name, command in commands():
        options = {word: option for option in command.params for word in option.opts}
        assert {"--json", "--quiet", "-q"} <= set(options), name
        assert "--overwrite" in options or "--out" not in options, name
        assert ("-o" in options) == ("--out" in options), name
        valued = [option for word, option in options.items() if word.startswith("--") and not option.is_flag]
        assert all(option.metavar for option in valued), name  # else the help shows <str>
        assert all(option.help and option.help.endswith(".") for option in options.values()), name


def test_names_that_the_command_line_knows_are_those_of_the_packages():
    """The command line has them once more, since the modules that have what they name import Warp or NumPy."""
    assert tuple(shape_names()) == inputs.OBJECTS
    assert tuple(STRATEGIES) == inputs.STRATEGIES
    assert tuple(SAMPLINGS) == inputs.SAMPLINGS
    assert inputs.HANDS == HANDS
    assert {kind.name: kind.aliases for kind in array_kinds()} == inputs.ARRAYS
    assert FORMATS == contours.FORMATS
    assert tuple(WRITERS) == contours.VOXELS
    assert SUFFIXES == contours.PICTURES


@pytest.mark.parametrize(
    ("command", "option", "known"),
    [
        (contours.RenderCommand, "kind", KINDS),
        (contours.RenderCommand, "unit", UNITS),
        (contours.VoxeliseCommand, "sign", SIGNS),
        (contours.FieldCommand, "average", AVERAGES),
        (arrays.PlayCommand, "amplitude", AMPLITUDES),
        (arrays.PlayCommand, "solver", SOLVERS),
        (arrays.PlayCommand, "clock", CLOCKS),
        (arrays.PlayCommand, "transport", TransportKind.__args__),
    ],
    ids=str,
)
def test_the_words_of_an_option_are_those_of_what_takes_it(command, option, known):
    declared = next(field for field in fields(command) if field.name == option)
    assert declared.metadata["one_of"] == tuple(known)


def test_a_wrong_word_of_an_option_suggests_a_known_one():
    refused(MISUSED, "of monotonic, virtual, not 'virtul' (did you mean 'virtual'?)", "demo", "--clock", "virtul")


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
