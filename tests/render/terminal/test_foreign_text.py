"""Foreign text is shown, never obeyed: control characters as escapes, brackets and colons as they are."""

import io
import json
import sys
import time
import unicodedata
import warnings
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.datasets import HandMotion, static_pose
from palpate.device.report import LiveStatistics
from palpate.render.cli.app import app, exit_code
from palpate.render.errors import PalpateWarning, PlanError
from palpate.render.terminal import bars, console
from palpate.render.terminal import foreign_text as terminal
from palpate.render.terminal.console import DONE, FAILED, MISUSED

ROOT = Path(__file__).parents[3]
TITLE, CLIPBOARD, CLEAR = "\x1b]0;pwned\x07", "\x1b]52;c;cm0gLXJmCg==\x07", "\x1b[2J\x1b[H"
HOSTILE = (TITLE, CLIPBOARD, CLEAR, "a\nOK: whole", "\r\x1b[32mwhole", "\x9b31mred", "\x7f", "\u202egnp.h5", "a\u2028b",
           "\udcff")  # fmt: skip
MARKUP = ("[red]x[/red]", "[/]", ":skull:", "[link=http://a]b[/link]", "{task.id}", "%s")


def is_harmless(text):
    """No terminal acts on any of it, by Unicode's own categories; line feeds are ours."""
    return not [c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")]


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)


def test_every_character_that_a_terminal_may_obey_is_an_escape():
    bidi = [*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x2028, 0x2029]
    for code in (*range(0x20), *range(0x7F, 0xA0), *bidi):
        shown = terminal.visible(chr(code))
        assert shown.isascii()
        assert shown.startswith("\\")
    kept = "Tube 1 µm ½ 手 ë [x] :skull: \\x1b"
    assert terminal.visible(kept) == kept


@pytest.fixture
def rendered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    HandMotion(None, static_pose([0, 0, 0.2]).pose).save(tmp_path / "still.csv")
    assert run("render", "cube", "still.csv", "-o", "a.h5", "--device", "cpu").exit_code == DONE
    return tmp_path / "a.h5"


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", [*HOSTILE, *MARKUP], ids=ascii)
def test_a_files_name_is_shown_and_not_obeyed(rendered, name):
    file = rendered.with_name(f"{name.replace('/', '_')}.h5")
    file.write_bytes(rendered.read_bytes())
    for words in (["info", file], ["check", file]):
        done = run(*words)
        assert done.exit_code == DONE, done.output
        assert is_harmless(done.output)
        assert "".join(terminal.visible(file.name).split()) in "".join(done.output.split())
        assert json.loads(run(*words, "--json").stdout)["path"] == str(file)
    with open(file, "r+b") as cut:
        cut.truncate(2000)
    for words in (
        ["check", file],
        ["info", file],
        ["play", file, "--clock", "virtual"],
    ):
        done = run(*words)
        assert done.exit_code == FAILED
        assert is_harmless(done.output)
        assert not [line for line in done.output.splitlines() if line.startswith("OK")]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", [*HOSTILE, *MARKUP], ids=ascii)
def test_what_is_wrong_with_options_is_shown_and_not_obeyed(name, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    for words in (
        ["info", name],
        ["info", "--" + name],
        [f"x{name}"],
        ["render", "cube", "m.csv", "-o", "a.h5", "--seed", name],
    ):
        monkeypatch.setattr(sys, "argv", ["palpate", *words])
        code = exit_code()
        told = capsys.readouterr()
        assert code in (FAILED, MISUSED)
        assert is_harmless(told.err + told.out)
        if words[0] == f"x{name}":  # others are told without the value, or as a path
            assert f"x{terminal.visible(name)}" in told.err


def test_a_traceback_is_shown_and_not_obeyed(monkeypatch, capsys, rendered):
    from palpate.render.cli import info_command as job

    def broken(path):
        raise KeyError(TITLE) from ValueError(f"{CLEAR}a\x85b")

    monkeypatch.setattr(job, "summarise", broken)
    monkeypatch.setenv("PALPATE_TRACEBACK", "1")
    monkeypatch.setattr(sys, "argv", ["palpate", "info", str(rendered)])
    code = exit_code()
    told = capsys.readouterr().err
    assert code == FAILED
    assert "in broken" in told
    assert is_harmless(told)


def test_warnings_faults_and_tables_are_shown_and_not_obeyed(capsys):
    def command():
        warnings.warn(f"{TITLE}[red]", PalpateWarning, stacklevel=1)
        console.show_values({f"a{CLEAR}": f"[b]{TITLE}", "n": 1}, as_json=False, title=f"[i]{TITLE}")
        console.show_values({f"a{CLEAR}\x7f": f"[b]{TITLE}"}, as_json=True, title="")
        raise PlanError(f"one{TITLE}", "two\nOK: three")

    assert console.run(command, as_json=False) == MISUSED
    told = capsys.readouterr()
    assert is_harmless(told.out + told.err)
    assert "[red]" in told.err
    assert "[b]" in told.out
    assert "[i]" in told.out
    assert told.err.splitlines()[-2:] == [r"error: one\x1b]0;pwned\x07", r"two\nOK: three"]


@pytest.mark.parametrize("name", [*HOSTILE, *MARKUP], ids=ascii)
def test_bars_show_names_and_do_not_obey_them(name, monkeypatch):
    screen = io.StringIO()
    screen.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(bars, "SILENT_SECONDS", 0.0)
    with bars.progress_bar(name, quiet=False) as bar:
        bar(name, 1, 2)
        time.sleep(0.02)  # the timer starts the bar
    with bars.playback_line(name, quiet=False) as line:
        line(LiveStatistics(1, 0.0, 2, 0, 0.0, 0.0), 5)
    told = screen.getvalue()
    for piece in (TITLE, CLIPBOARD, "\x1b]8;", "\x9b", "\x7f", "\u202e", "\u2028", "\udcff", "\nOK"):
        assert piece not in told
    assert told.count(terminal.visible(name)) >= 2
