"""Python blocks of the documents run as they stand, one after the other, and what they name is what there is."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.datasets import HandMotion
from palpate.render import MeshObject, Palm, closed_contour, record

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NOT_RUN = {
    "boards.md": "needs a board and its file",
    "emulator.md": "an outline with gaps",
    "sampling.md": "plays in real time",
}
WITH_PYTHON = [p for p in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))] if BLOCK.search(p.read_text())]

DOCUMENTS = [path for path in WITH_PYTHON if path.name not in {*NOT_RUN, "README.md"}]


@pytest.fixture
def folder(tmp_path):
    """A folder with the one file that documents take for granted."""
    tube = MeshObject.load("tube")
    pose = np.tile(np.array([*tube.bounds.mean(axis=0), 0.7071068, 0, 0, 0.7071068], np.float32), (200, 1))
    record(tmp_path / "tube.h5", tube, Palm(), HandMotion(np.arange(200) / 90, pose), closed_contour())
    return tmp_path


@pytest.mark.exhaustive
@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_python_in_documents_runs(document, folder):
    """All blocks as one program; one that begins with `# NAME.py` is that file, one marked `no-run` is left out."""
    run_document(document, folder)


def test_the_readmes_python_is_a_page_that_a_newcomer_can_guess_and_runs(tmp_path):
    """At most twelve lines, names of one module, and nothing of Warp."""
    ((_, code),) = BLOCK.findall((ROOT / "README.md").read_text())
    assert len(code.splitlines()) <= 12
    assert re.findall(r"^(?:from|import) .*", code, re.MULTILINE) == [code.splitlines()[0]]
    assert code.startswith("from palpate.render import ")
    said, warned = run_document(ROOT / "README.md", tmp_path)
    assert [line.split("(")[0] for line in said.splitlines()] == ["RenderedBatch", "SampledContours", "Playback"]
    assert warned == ""
    assert {"tube.h5", "tube.png"} <= {path.name for path in tmp_path.iterdir()}


def run_document(document, folder):
    """Standard output and standard error of a document's program."""
    program = []
    for mark, code in BLOCK.findall(document.read_text()):
        if named := re.match(r"# (\w+\.py)\n", code):
            (folder / named[1]).write_text(code)
        elif "no-run" not in mark:
            program.append(code)
    path = folder / "document.py"
    path.write_text("\n\n".join(program))
    done = subprocess.run(
        [sys.executable, "-P", path.name], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_what_a_shell_would_take_apart_is_quoted():
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "render").rglob("*.py")]:
        assert not re.findall(r"--set [\w.]+=[^\s`'\"]*[{\[].*", path.read_text()), path.name


def test_what_needs_a_board_is_not_in_a_block_to_copy():
    copied = [line for line in (ROOT / "README.md").read_text().splitlines() if line.startswith("    palpate")]
    assert copied
    assert not [line for line in copied if "--calibration" in line]


def test_documents_that_are_not_run_are_there():
    assert set(NOT_RUN) <= {path.name for path in WITH_PYTHON}
