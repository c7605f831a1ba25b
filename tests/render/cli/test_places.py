"""Odd places: standard streams closed or full, a narrow screen, names that are no text, a cache that cannot be written.

The truth is the system's: descriptors are closed, /dev/full is full, a mount is read-only.
"""

import os
import shlex
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest
from command_line import PALPATE, answer, run

from palpate.render.cli.app import exit_code

COMMANDS = {
    "info": ("info", "tube.h5"),
    "json": ("info", "tube.h5", "--json"),
    "sampling": ("sampling", "stm"),
    "version": ("--version",),
    "misuse": ("info", "nosuch.h5", "--json"),
    "misspelt": ("rendr", "--json"),
    "render": ("render", "tube", "exploration", "-o", "out.h5", "--duration", "2", "--overwrite"),
    "play": ("play", "tube.h5", "--clock", "virtual", "--duration", "0.2"),
}
PLACES = {  # redirections: whether results are lost, whether messages are
    ">&-": (True, False),
    "2>&-": (False, True),
    ">/dev/full": (True, False),
    "2>/dev/full": (False, True),
    "<&- >&- 2>&-": (True, True),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("places")
    assert run("render", "tube", "exploration", "-o", path / "tube.h5", "--duration", "2").exit_code == 0
    return path


def shell(folder, words, redirection="", **environment):
    line = f"{shlex.join([*PALPATE, *words])} {redirection}"
    return subprocess.run(
        ["sh", "-c", line], cwd=folder, env=os.environ | environment, capture_output=True, check=False, timeout=120
    )


@contextmanager
def standard_stream(number, path):
    """One of this process's standard streams leads to a file, or is closed if that is None."""
    name, kept = {1: "stdout", 2: "stderr"}[number], os.dup(number)
    before = getattr(sys, name)
    before.flush()
    os.close(number)
    if path is not None:
        os.dup2(target := os.open(path, os.O_WRONLY), number)
        if target != number:
            os.close(target)
    setattr(sys, name, None if path is None else open(number, "w", closefd=False))  # noqa: SIM115
    try:
        yield
    finally:
        os.dup2(kept, number)
        os.close(kept)
        setattr(sys, name, before)


@pytest.mark.parametrize("command", ["sampling", "version", "misuse", "misspelt"])
def test_results_that_nobody_can_read_are_a_failure_and_lost_messages_are_none(command, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["palpate", *COMMANDS[command]])
    usual = 2 if command in ("misuse", "misspelt") else 0
    for number, path, expected in ((1, None, 1), (1, "/dev/full", 1), (2, None, usual), (2, "/dev/full", usual)):
        with standard_stream(number, path):
            code = exit_code()
        shown = capfd.readouterr()
        assert code == expected, (number, path)
        assert "Traceback" not in shown.err
        assert shown.out if number == 2 else "standard output" in shown.err, (number, path)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("command", "place"),
    [
        ("sampling", ">&-"),
        ("misspelt", "2>&-"),
        ("version", ">/dev/full"),
        ("misuse", "2>/dev/full"),
        ("json", ">/dev/full"),
        ("info", "<&- >&- 2>&-"),
        ("render", "<&- >&- 2>&-"),
        ("play", ">&-"),
    ],
)
def test_a_stream_that_is_closed_or_full_gives_a_code_and_a_sentence(command, place, folder):
    loses_results, loses_messages = PLACES[place]
    done = shell(folder, COMMANDS[command], place)
    expected = 2 if command in ("misuse", "misspelt") else 0
    assert done.returncode == (1 if loses_results else expected), done.stderr
    for trouble in (b"Traceback", b"unexpected", b"Exception ignored"):
        assert trouble not in done.stderr
    if loses_results and not loses_messages:
        assert b"standard output" in done.stderr
    if not loses_results:
        assert done.stdout


@pytest.mark.exhaustive
def test_a_reader_that_has_enough_is_no_error(folder):
    done = shell(folder, ("sampling",), "| head -n 1")
    assert (done.stdout.count(b"\n"), done.stderr) == (1, b"")


def test_into_a_file_no_value_is_cut_or_folded_and_none_has_colours(folder, monkeypatch):
    told = answer("info", folder / "tube.h5")
    monkeypatch.setenv("COLUMNS", "20")
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = run("info", folder / "tube.h5").stdout
    assert any(told["object"]["hash"] in line for line in shown.splitlines())
    assert len(shown.splitlines()) < len(told) + 2
    assert "\x1b" not in shown


@pytest.mark.exhaustive
@pytest.mark.parametrize("words", [("info",), ("figure", "-o", "surrogates.png")], ids=lambda w: w[0])
def test_names_that_are_no_text_are_shown_escaped_and_drawn(words, folder):
    name = b"su\xffr\x1b]0;x.h5"
    shutil.copy(folder / "tube.h5", os.fsencode(folder) + b"/" + name)
    done = shell(folder, (words[0], os.fsdecode(name), *words[1:]))
    assert done.returncode == 0, done.stderr
    assert b"\x1b" not in done.stdout + done.stderr
    assert words[0] == "figure" or b"su\\udcffr\\x1b]0;x.h5" in done.stdout


CACHE = """
mkdir -m 700 cache && mount -t tmpfs -o size=100m,mode=700 tmp cache && export WARP_CACHE_PATH=$PWD/cache
{before}
{command}
"""
VOXELISE = ("voxelise", "cube", "-o", "cube.npz", "--spacing", "0.01")  # with one module of kernels


def in_mount(folder, before):
    if shutil.which("unshare") is None or subprocess.run(["unshare", "-rm", "true"], check=False).returncode:
        pytest.skip("this user may not make a mount namespace, which a read-only cache needs")
    command = shlex.join([*PALPATE, *VOXELISE, "--overwrite"])
    script = CACHE.format(before=before.format(command=command), command=command)
    return subprocess.run(
        ["unshare", "-rm", "sh", "-ec", script], cwd=folder, capture_output=True, text=True, check=False, timeout=300
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize("cause", ["mount -o remount,ro cache", "head -c 200000000 /dev/zero > cache/x || true"])
def test_where_the_cache_cannot_be_written_kernels_are_compiled_for_this_run(cause, tmp_path):
    done = in_mount(tmp_path, cause)
    assert done.returncode == 0, done.stderr
    assert "kernels were compiled for this run only" in done.stderr
    assert "WARP_CACHE_PATH" in done.stderr
    assert (tmp_path / "cube.npz").stat().st_size > 0


@pytest.mark.exhaustive
def test_the_temporary_cache_goes_with_its_process(tmp_path):
    script = (
        "from palpate.render.runtime import kernel_cache as k, warp_start\n"
        "warp_start.start_warp(); k.use_temporary_cache(); import os; print(os.environ['WARP_CACHE_PATH'])"
    )
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True)
    folder = done.stdout.strip()
    assert "palpate-kernels-" in folder
    assert not os.path.exists(folder)
