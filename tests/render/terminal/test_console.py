"""The console prints results as one JSON object for machines and as a table for people."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from command_line import PALPATE

from palpate.render.terminal import console

STRATEGY = {"raw": "section", "prune": [{"stage": "close-together", "distance": 0.004}, "small"]}


def test_json_has_stages_with_options_as_objects(capsys):
    console.show_values({"strategy": STRATEGY}, as_json=True, title="")
    assert json.loads(capsys.readouterr().out) == {"strategy": STRATEGY}


def test_a_table_has_stages_with_options_as_words(capsys):
    console.show_values({"strategy": STRATEGY}, as_json=False, title="file.h5")
    assert "close-together (distance 0.004) small" in capsys.readouterr().out


def test_a_name_that_the_file_system_does_not_take_is_refused_with_its_length(tmp_path, capsys):
    path = tmp_path / ("é" * 140)
    assert console.run(path.stat, as_json=True) == 2
    assert "a name of 280 bytes is more than" in json.loads(capsys.readouterr().out)["error"]


ENDING = """
import atexit, os, signal, sys, threading
from palpate.render.terminal.console import end_process
atexit.register(print, "switched off")
threading.Thread(target=threading.Event().wait).start()  # which the interpreter's teardown would join for ever
atexit.register(os.kill, os.getpid(), signal.SIGTERM)  # a signal while it ends
sys.stdout.write("result, ")
end_process(3)
"""


def test_a_process_ends_with_its_exit_code_after_what_was_registered_whatever_its_threads_do():
    done = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout, done.stderr) == (3, "result, switched off\n", "")


@pytest.mark.exhaustive
def test_ctrl_c_while_kernels_are_compiled_ends_a_command_soon_and_leaves_nothing(tmp_path):
    """LLVM compiles for 6 to 10 s and hears no signal meanwhile; the processor may be busy with other tests."""
    (tmp_path / "home").mkdir()
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "home")}
    words = [*PALPATE, "render", "tube", "exploration", "-o", "a.h5", "--json"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, cwd=tmp_path, env=environment, text=True, **pipes) as process:
        builds = f"*/*_p{process.pid}_t*"
        while not list((tmp_path / "cache").glob(builds)):
            assert process.poll() is None
            time.sleep(0.01)
        begun = time.monotonic()
        process.send_signal(signal.SIGINT)
        out, told = process.communicate(timeout=60)
    assert time.monotonic() - begun < 5
    assert (process.returncode, json.loads(out), told) == (1, {"error": "interrupted"}, "error: interrupted\n")
    assert not list((tmp_path / "cache").glob(builds))
    assert not list((tmp_path / "home").iterdir())
