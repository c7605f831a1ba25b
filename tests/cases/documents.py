"""Blocks of code of the documents, found as Markdown has them, and the files that pages take for granted."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from acceptance_script import answers_of
from board_file_cases import board_lines, write
from markdown_it import MarkdownIt

from palpate.datasets import HandMotion, write_sample
from palpate.render import MeshObject, Palm, closed_contour, record

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELL = ("sh", "bash")  # languages of blocks whose lines are commands, as those of indented blocks are
NAMED = re.compile(r'\btitle="([^"]+)"')


class Block(NamedTuple):
    """A fenced or indented block of code."""

    page: Path
    line: int
    language: str
    marks: str
    text: str
    indented: bool

    @property
    def name(self) -> str | None:
        """The file that this block is: its title, or a first line `# NAME.py`."""
        if titled := NAMED.search(self.marks):
            return titled[1]
        first = re.match(r"# (\w+\.\w+)\n", self.text)
        return first[1] if first else None

    @property
    def place(self) -> str:
        """For messages and names of tests."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks_of(page: Path) -> list[Block]:
    """All blocks of a page, also those within lists and quotations."""
    found = []
    for token in MarkdownIt().parse(page.read_text()):
        if token.type in ("fence", "code_block"):
            language, _, marks = token.info.strip().partition(" ")
            found.append(Block(page, token.map[0] + 1, language, marks, token.content, token.type == "code_block"))
    return found


def commands_in(block: Block) -> list[str]:
    """Lines of a block that one types into a shell."""
    lines = block.text.splitlines() if block.indented or block.language in SHELL else []
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def command_lines(page: Path) -> list[str]:
    """Lines of a page that one types into a shell."""
    return [line for block in blocks_of(page) for line in commands_in(block)]


def spans_of(page: Path) -> list[str]:
    """Code within the sentences of a page, each on one line."""
    inline = [token for token in MarkdownIt("commonmark").enable("table").parse(page.read_text()) if token.children]
    return [child.content for token in inline for child in token.children if child.type == "code_inline"]


def fill(folder: Path) -> Path:
    """Put the files there that pages name as the reader's own."""
    tube = MeshObject.load("tube")
    pose = np.tile(np.array([*tube.bounds.mean(axis=0), 0.7071068, 0, 0, 0.7071068], np.float32), (200, 1))
    record(folder / "tube.h5", tube, Palm(), HandMotion(np.arange(200) / 90, pose), closed_contour())
    for name in ("board", "board_7", "left", "right"):
        write(folder / f"{name}.pat", board_lines(np.random.default_rng(len(name)))[0])
    write_sample("leap", folder / "hand.json")
    (folder / "study.toml").write_text(
        '[object]\nsource = ["cube", "tube"]\n[motion]\nduration = 1.0\nseed = [1, 2, 3, 4]\n'
    )
    (folder / "answers.txt").write_text("\n".join(answers_of("pat16")) + "\n")
    (folder / "array.json").write_text('{"position": [0, 0, 0], "orientation": [0.70710678, 0, 0, 0.70710678]}')
    (folder / "rig.json").write_text(
        '[{"array": "pat16", "calibration": "left.pat", "pose": [-0.09, 0, 0, 0, 0, 0, 1]},'
        ' {"array": "pat16", "calibration": "right.pat", "pose": [0.09, 0, 0, 0, 0, 0, 1]}]'
    )
    for name in ("meshes", "strategies", "volumes", "checks"):
        (folder / name).mkdir()
    save_mesh(folder / "meshes" / "mine.stl", 1.0)
    save_mesh(folder / "skull.stl", 1000.0)  # in mm
    np.save(folder / "volumes" / "ball.npy", np.hypot(*np.mgrid[-20:21, -20:21])[None].repeat(20, 0) < 15)
    (folder / "strategies" / "mine.json").write_text('{"raw": "section"}')
    return folder


def save_mesh(path: Path, scale: float) -> None:
    import trimesh

    tube = MeshObject.load("tube")
    trimesh.Trimesh(tube.vertices * scale, tube.faces).export(path)


def write_named_blocks(page: Path, folder: Path) -> None:
    """Write the blocks that are files."""
    for block in blocks_of(page):
        if block.name:
            (folder / block.name).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.name).write_text(block.text)


def run_page(page: Path, folder: Path, here: Callable[[str, Path], tuple[str, int] | None]) -> tuple[str, str]:
    """Run the page from top to bottom, its Python as one program; gives standard output and standard error.

    here: the command that stands for a line in this folder, with its exit code; None: the line is left out.
    """
    program = []
    for block in blocks_of(page):
        if block.language == "python" and not block.name and "no-run" not in block.marks:
            program.append(block.text)
        for line in commands_in(block):
            if command := here(line, folder):
                program.append("__import__('documents').run_command({!r}, {!r})".format(*command))
    path = folder / "document.py"
    path.write_text("\n\n".join(program))
    done = subprocess.run(
        [sys.executable, "-P", path.name], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def run_command(line: str, code: int = 0) -> None:
    """Run a line in a shell in which `palpate` is this one, after making the stores that it takes for granted."""
    needed = [name for name in ("study.sweep", "other.sweep", "old.sweep") if name in line]
    if needed and not Path("study.sweep").exists() and "study.toml" not in line:
        run_command("palpate sweep study.toml")
    for name in needed:
        if not Path(name).exists() and Path("study.sweep").exists():
            shutil.copytree("study.sweep", name)
    programs = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "200"}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", line], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, f"{line}\n{done.stdout}\n{done.stderr}"
