"""Commands that the fuzzer gives damaged files to."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_described import STRATEGY, box, ptlist_seeds
from fuzz_format import Refused, Wrong, one_file
from fuzz_stored import chunk_rows_of, frame_seeds

# commands


def command(*arguments: object) -> str:
    """Standard output and error of a command that ends with 0; Refused with its sentence where it ends with 1 or 2."""
    from typer.testing import CliRunner

    from palpate.render.cli.app import app

    os.environ["PALPATE_TRACEBACK"] = "1"  # raw errors come through
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    told = result.output
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    if any((ord(letter) < 32 and letter != "\n") or 127 <= ord(letter) < 160 for letter in told):
        raise Wrong(f"control characters are printed: {told[-200:]!r}")
    if result.exit_code:
        if result.exit_code not in (1, 2) or "error" not in told.lower():
            raise Wrong(f"exit code {result.exit_code} without a sentence: {told[-200:]!r}")
        raise Refused(told)
    return told


def rendered_seeds(folder: Path) -> None:
    """What the commands read together: an object, a motion, a strategy."""
    from palpate.datasets import exploration

    for name in ("motion", "strategy", "object", "hand"):
        own = folder / name
        own.mkdir()
        bounds = np.array([[-0.05, -0.05, 0.15], [0.05, 0.05, 0.25]])
        exploration(bounds, duration=0.2, rate=30.0, seed=1).save(own / "motion.csv")
        (own / "strategy.json").write_text(STRATEGY)
        box().apply_translation((0, 0, 0.2)).export(own / "object.stl")
        box().apply_scale(1.5).export(own / "hand.stl")


def run_render(folder: Path) -> Any:
    """A rendering of which one file is damaged."""
    out = folder / "out.h5"
    options = ["--workers", "1", "--overwrite"]
    options += ["--hand", folder / "hand.stl"] if folder.name == "hand" else ["--strategy", folder / "strategy.json"]
    return command("render", folder / "object.stl", folder / "motion.csv", "-o", out, *options)


def run_on_contours(path: Path) -> Any:
    told = ""
    out = path.with_suffix(".ptlist")
    refused: list[str] = []
    play = ("play", path, "--clock", "virtual", "--duration", "0.01")
    commands = {"check": ("check", path), "info": ("info", path), "export": ("export", path, "-o", out), "play": play}
    known = {"cube": commands, "points": ("check", "info", "play"), "drives": ("check", "info"), "a": ("play",)}
    for name in known[path.stem]:
        try:
            told += command(*commands[name])
        except Refused as error:
            refused.append(str(error))
    if refused:
        raise Refused(refused[0])
    return told


def playable_seeds(folder: Path) -> None:
    from palpate.datasets import exploration
    from palpate.render import MeshObject, Palm, closed_contour, record

    cube = MeshObject.load("cube")
    motion = exploration(cube.bounds, duration=0.3, rate=30.0, seed=1)
    record(folder / "cube.h5", cube, Palm(), motion, closed_contour())
    ptlist_seeds(folder)
    frame_seeds(folder)


def run_check(path: Path) -> Any:
    with chunk_rows_of(path):
        return command("check", path)


def run_info(path: Path) -> Any:
    return command("info", one_file(path, ".gltf"))


def run_sweep(folder: Path) -> Any:
    return command("sweep", folder / "study.toml", "--dry-run")


def run_sampling(path: Path) -> Any:
    return command("sampling", path)


def run_devices(folder: Path) -> Any:
    return command("devices", "--calibration", folder / "board.pat")
