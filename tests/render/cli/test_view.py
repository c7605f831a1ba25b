"""`palpate view` as a process: it tells its address, ends by Ctrl-C with 0, and refuses what it cannot show."""

import json
import re
import signal
import subprocess
import sys
import threading
import urllib.request

import pytest
from typer.testing import CliRunner

from palpate.render import exploration, render
from palpate.render.cli import view_command
from palpate.render.cli.app import app
from palpate.render.view.served import viewing
from palpate.render.view.served.viewing import announce, view_files


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return render("tube", "palm", exploration("tube", duration=0.2, seed=1), "oc").save(
        tmp_path_factory.mktemp("view") / "a.h5"
    )


def started(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "palpate.render.cli", "view", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.exhaustive
def test_it_serves_until_ctrl_c(file):
    process = started(file, "--no-browser", "--json")
    try:
        address = json.loads(process.stdout.readline())["address"]
        with urllib.request.urlopen(address, timeout=10) as page:
            assert b"<html" in page.read().lower()
        taken = re.search(r":(\d+)/", address)[1]
        second = CliRunner().invoke(app, ["view", str(file), "--no-browser", "--port", taken])
        assert second.exit_code == 1
        assert f"port {taken} of 127.0.0.1 cannot be had" in second.output
    finally:
        process.send_signal(signal.SIGINT)
        said, warned = process.communicate(timeout=30)
    assert process.returncode == 0
    assert said == ""
    assert "Traceback" not in warned


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["nothing.h5"], 2, "nothing.h5 does not exist"),
        (["FILE", "--port", "70000"], 2, "--port must be 1 to 65535, not 70000"),
        (["FILE", "FILE", "FILE"], 2, "one file, or 2 side by side, not 3"),
        (["FILE", "--every", "0"], 2, "--every is of a page that --export writes"),
        (["FILE", "--export", "a.html", "--port", "0"], 2, "--port is of a page that is served"),
        (["FILE", "--every", "2"], 2, "--every is of a page that --export writes"),
        (["tube"], 2, "tube is an object, not a file"),
        (["old.html"], 2, "old.html is a page: open it in a browser"),
        (["wave.csv", "tube"], 2, "wave.csv is a motion: a preview takes the object first, then the motion"),
        (["FILE", "--array", "no-such"], 2, "no-such"),
    ],
)
def test_what_cannot_be_shown_is_refused(file, tmp_path, monkeypatch, arguments, code, sentence):
    def view_and_end(files, **options):
        ended = threading.Event()
        ended.set()
        view_files(files, stop=ended, **options)

    monkeypatch.setattr(view_command, "view_files", view_and_end)  # what is shown by mistake is not served for ever
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.html").write_text("<!DOCTYPE html>")
    (tmp_path / "wave.csv").write_text("time,x,y,z,qx,qy,qz,qw\n0,0,0,0.2,0,0,0,1\n")
    given = [str(file) if argument == "FILE" else argument for argument in arguments]
    result = CliRunner().invoke(app, ["view", "--no-browser", *given])
    assert result.exit_code == code
    assert sentence in result.output


@pytest.mark.exhaustive
def test_a_preview_is_named_and_leaves_nothing_behind_when_it_is_ended(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with started("cube", "exploration", "--no-browser") as process:
        line = next(line for line in process.stderr if "palpate shows" in line)
        assert "palpate shows a preview of cube on http://127.0.0.1:" in line
        assert list(tmp_path.glob("palpate-preview-*"))
        process.send_signal(signal.SIGTERM)
        said, warned = process.communicate(timeout=30)
    assert (process.returncode, said) == (0, "")
    assert "Traceback" not in warned
    assert not list(tmp_path.glob("palpate-preview-*"))


@pytest.mark.parametrize("way", ["no display", "no browser"])
def test_where_no_page_can_be_opened_its_address_is_printed_with_what_to_do(monkeypatch, capfd, way):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    opened = []
    monkeypatch.setattr(viewing, "ticket_address", "the ticket of {}".format)
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or False)
    if way == "no browser":
        monkeypatch.setenv("DISPLAY", ":0")
    announce("http://127.0.0.1:8080/?token=x", "tube.h5", no_browser=False)
    assert opened == ([] if way == "no display" else ["the ticket of http://127.0.0.1:8080/?token=x"])
    printed = capfd.readouterr().err
    assert "palpate shows tube.h5 on http://127.0.0.1:8080/?token=x until Ctrl-C" in printed
    assert "open http://127.0.0.1:8080/?token=x in one on this machine" in printed
