"""Runs a page of the documents from top to bottom, in a folder with the files that it takes for granted."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from board_file_cases import board_lines, write
from page_blocks import blocks_of, commands_in

from palpate.datasets import HandMotion, write_sample
from palpate.render import MeshObject, Palm, closed_contour, record


def fill(folder: Path) -> None:
    """Put the files there that pages name as the reader's own, a rendering among them."""
    tube = MeshObject.load("tube")
    pose = np.tile(np.array([*tube.bounds.mean(axis=0), 0.7071068, 0, 0, 0.7071068], np.float32), (200, 1))
    record(folder / "tube.h5", tube, Palm(), HandMotion(np.arange(200) / 90, pose), closed_contour())
    fill_inputs(folder)


def fill_inputs(folder: Path) -> None:
    """Put meshes, volumes, recordings, boards and plans there."""
    for name in ("board", "board_7", "left", "right"):
        write(folder / f"{name}.pat", board_lines(np.random.default_rng(len(name)))[0])
    write_sample("leap", folder / "hand.json")
    (folder / "study.toml").write_text(
        '[object]\nsource = ["cube", "tube"]\n[motion]\nduration = 1.0\nseed = [1, 2, 3, 4]\n'
    )
    (folder / "array.json").write_text('{"position": [0, 0, 0], "orientation": [0.70710678, 0, 0, 0.70710678]}')
    (folder / "rig.json").write_text(
        '[{"array": "pat16", "calibration": "left.pat", "pose": [-0.09, 0, 0, 0, 0, 0, 1]},'
        ' {"array": "pat16", "calibration": "right.pat", "pose": [0.09, 0, 0, 0, 0, 0, 1]}]'
    )
    for name in ("meshes", "strategies", "volumes", "checks"):
        (folder / name).mkdir()
    save_mesh(folder / "meshes" / "mine.stl", 1.0)
    save_mesh(folder / "ring.stl", 1.0)
    save_mesh(folder / "skull.stl", 1000.0)  # in mm
    np.save(folder / "volumes" / "ball.npy", np.hypot(*np.mgrid[-20:21, -20:21])[None].repeat(20, 0) < 15)
    (folder / "strategies" / "mine.json").write_text('{"raw": "section"}')


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
                program.append("__import__('page_run').run_command({!r}, {!r})".format(*command))
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
    assert done.returncode == code, f"{line}\nexit code {done.returncode}\n{done.stdout}\n{done.stderr}"
