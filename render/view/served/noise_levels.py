"""How loud files are around a moment: A-weighted levels, of which only differences between files mean anything.

A prediction takes seconds, so a process of its own makes it: meanwhile the page goes on.
"""

import json
import pickle
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from math import isfinite
from pathlib import Path
from typing import Any

from ....datasets.errors import DatasetError
from ...acoustics.noise import NoiseModel
from ...acoustics.prediction import predict_noise
from ...acoustics.spectrum import levels_over_time
from ...errors import RenderError, StrategyError
from ...playback.placed_arrays import PlacedArray
from ...runtime.warp_start import start_warp
from ..file_scene import FileScene
from ..series import window_around, window_rows

SOURCES = 300
"""Virtual sources of noise: fewer than `palpate noise` takes, which needs seven times as long."""
SECONDS = 2.0  # before and after the moment
LONGEST = 300.0  # [s] of a prediction, with kernels that are compiled first


def predict_levels(
    paths: Sequence[Path], poses: Sequence[int], labels: Sequence[str], arrays: Sequence[PlacedArray]
) -> dict[str, Any]:
    """Levels of each file from two seconds before its pose to two seconds after it, and over that time.

    With two files, each level is given against the first; one file alone has a level in units of its own. Raises
    StrategyError where poses have no times, or are not all rendered.
    """
    with ExitStack() as opened:
        scenes = [opened.enter_context(FileScene(path)) for path in paths]
        windows = [window_around(scene, pose, SECONDS) for scene, pose in zip(scenes, poses, strict=True)]
        rows = [window_rows(scene, window) for scene, window in zip(scenes, windows, strict=True)]
    signals = []
    for row in rows:
        if row is None:
            raise StrategyError("noise needs poses with times, all of them rendered, around the shown moment")
        signals.append(predict_noise(row, array=arrays, model=NoiseModel(sources=SOURCES)))
    levels = [signal.spectrum().a_weighted for signal in signals]
    if len(levels) > 1 and isfinite(levels[0]):
        texts = [f"{label}: {_level_text(level - levels[0], '+')}" for label, level in zip(labels, levels, strict=True)]
        meaning = "against the first file"
    elif len(levels) > 1:
        texts = [f"{label}: {_level_text(level)}" for label, level in zip(labels, levels, strict=True)]
        meaning = "in units of their own, as the first file is silent"
    else:
        texts, meaning = [_level_text(levels[0])], "in units of its own: compare two files"
    lines = [levels_over_time(signal) for signal in signals]
    begin, end = windows[0].time[[0, -1]]
    return {
        "text": f"{', '.join(texts)}; {begin:.2f} to {end:.2f} s, {meaning}",
        "files": [
            {"clock": (window.time[0] + time).tolist(), "level": [each if isfinite(each) else None for each in level]}
            for window, (time, level) in zip(windows, lines, strict=True)
        ],
    }


def _level_text(level: float, sign: str = "-") -> str:
    return f"{level:{sign}.1f} dB(A)" if isfinite(level) else "silent"


def predict_levels_apart(*arguments: Any) -> dict[str, Any]:
    """The same in a process of its own; its errors are StrategyErrors here."""
    words = [sys.executable, "-P", "-m", "palpate.render.view.served.noise_levels"]
    try:
        done = subprocess.run(
            words,
            input=pickle.dumps(arguments),
            capture_output=True,
            timeout=LONGEST,
            check=False,
            start_new_session=True,  # the terminal's SIGINT is not for it
        )
        answer = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, OSError, ValueError) as error:
        raise StrategyError(f"noise could not be predicted ({error})") from error
    if "failure" in answer:
        raise StrategyError(answer["failure"])
    return answer


if __name__ == "__main__":
    start_warp()
    try:
        found = predict_levels(*pickle.loads(sys.stdin.buffer.read()))  # from the viewer that started this
    except (RenderError, DatasetError) as error:
        found = {"failure": str(error)}
    print(json.dumps(found))  # noqa: T201  # the viewer reads it
