"""What the command line imports before it answers: neither help nor a request that must fail waits for Warp."""

import subprocess
import sys

import pytest

HELP = {"numpy", "scipy", "warp", "h5py", "trimesh", "matplotlib", "pydantic", "usb", "rich"}
"""Libraries that help does without."""
FAILURE = HELP - {"pydantic"}
"""Libraries that a command does without that must fail; typer takes options with pydantic."""
REFUSED = """
demo --clock x
render tube exploration -o a.txt
render tube exploraton -o a.h5
render tube exploration -o nosuch/a.h5
render tube exploration -o a.h5 --hand palmm
render nosuch.stl exploration -o a.h5
render tube nosuch.csv -o a.h5
render tube exploration -o a.h5 --strategy hacth
render tube exploration -o a.h5 --workers many
render tube exploration -o a.h5 --up q
voxelise tube -o a.stl --spacing 0.01
voxelise nosuch.stl -o a.npz --spacing 0.01
strategies hacth
strategies -o a.txt
info nosuch.h5
check nosuch.h5
figure nosuch.h5 -o a.png
figure {file} -o a.txt
view nosuch.h5
view {file} --every 2
export {file} -o a.txt
field nosuch.h5
field {file} --where moon
noise {file} -o a.txt
noise nosuch.h5
noise {file} --duration 0
bench --strategy hatch
trust nosuch.json
play nosuch.h5
play {file} --array pat61
play {file} --sampling stn
play {file} --solver x
prepare {file} -o nosuch/a.h5
live nosuch.stl
live tube --duration -1
live tube --source ultralep
sampling stn
selftest --array pat61
sweep nosuch.toml
sweep status nosuch
study nosuch.toml
study analyse nosuch.toml
"""
SCRIPT = """
import sys
from palpate.render.cli.app import exit_code
for line in {lines!r}:
    sys.argv[1:] = line.split()
    print(exit_code(), *sorted(set(sys.modules) & {heavy!r}), line, sep="|", file=sys.stderr)
"""


def imported(lines, heavy):
    """Exit code, heavy modules and line of each command, run one after the other in one process."""
    words = [sys.executable, "-P", "-c", SCRIPT.format(lines=lines, heavy=heavy)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [line.split("|") for line in done.stderr.splitlines() if "|" in line]


@pytest.mark.exhaustive
def test_help_imports_nothing_that_computes():
    lines = ["--help", "sweep --help", "sweep status --help"]
    assert imported(lines, HELP) == [["0", line] for line in lines]


@pytest.mark.exhaustive
def test_a_command_that_must_fail_imports_nothing_that_computes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.file.h5").write_bytes(b"")
    lines = REFUSED.format(file="a.file.h5").split("\n")[1:-1]
    assert imported(lines, FAILURE) == [["2", line] for line in lines]
    assert list(tmp_path.iterdir()) == [tmp_path / "a.file.h5"]


@pytest.mark.exhaustive
def test_the_check_sees_what_is_imported():
    assert "numpy" in imported(["sampling --json"], HELP)[0]
