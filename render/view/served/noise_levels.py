"""How loud files are around a moment: A-weighted levels, of which only differences between files mean anything."""

from collections.abc import Sequence
from typing import Any

from ...acoustics.noise import NoiseModel
from ...acoustics.prediction import predict_noise
from ...acoustics.spectrum import levels_over_time
from ...errors import StrategyError
from ...playback.placed_arrays import PlacedArray
from ..file_scene import FileScene
from ..packing import Packer
from ..series import window_around, window_rows

SOURCES = 300
"""Virtual sources of noise: fewer than `palpate noise` takes, which needs seven times as long."""
SECONDS = 2.0  # before and after the moment


def predict_levels(
    scenes: Sequence[FileScene],
    poses: Sequence[int],
    labels: Sequence[str],
    arrays: Sequence[PlacedArray],
    packer: Packer,
) -> dict[str, Any]:
    """Levels of each file from two seconds before its pose to two seconds after it, and over that time.

    With two files, the level of each is told against the first; one file alone has a level in units of its own.
    Raises StrategyError where poses have no times, or are not all rendered.
    """
    windows = [window_around(scene, pose, SECONDS) for scene, pose in zip(scenes, poses, strict=True)]
    rows = [window_rows(scene, window) for scene, window in zip(scenes, windows, strict=True)]
    signals = []
    for row in rows:
        if row is None:
            raise StrategyError("noise needs poses with times, all of them rendered, around the shown moment")
        signals.append(predict_noise(row, array=arrays, model=NoiseModel(sources=SOURCES)))
    levels = [signal.spectrum().a_weighted for signal in signals]
    if len(levels) > 1:
        texts = [f"{label}: {level - levels[0]:+.1f} dB(A)" for label, level in zip(labels, levels, strict=True)]
        meaning = "against the first file"
    else:
        texts, meaning = [f"{levels[0]:.1f} dB(A)"], "in units of its own: compare two files"
    lines = [levels_over_time(signal) for signal in signals]
    begin, end = windows[0].time[[0, -1]]
    return {
        "text": f"{', '.join(texts)}; {begin:.2f} to {end:.2f} s, {meaning}",
        "files": [
            {"clock": packer.numbers(window.time[0] + time, "f8"), "level": packer.numbers(level, "f4")}
            for window, (time, level) in zip(windows, lines, strict=True)
        ],
    }
