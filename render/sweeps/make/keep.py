"""Files that a sweep keeps beside its numbers: contours, focal points, drives (docs/formats/sweep-files.md).

A worker writes them into its unit's folder, and the process that has the store open puts them into their places.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ....datasets.contour_file.reader import ContourFile
from ....datasets.focus_files.frame_file import FrameField, FrameFile
from ....datasets.storage.hdf5_opening import Attribute
from ....kernels.driving.solve import POINTS_MOST
from ...errors import StrategyError
from ...intersection.file_recording import record
from ...playback.drive import Driver
from ...playback.focal_points import ContourRows
from ...sampling.metrics import FocalPoints
from ...sampling.sampler import joined
from ...sampling.strategy import SamplingStrategy
from ..plan.code_version import code_version
from ..plan.recipe import Recipe
from .rendering import Rendering, playing_arrays
from .sampling import RenderedContours

CONTOURS, FOCAL_POINTS, DRIVES = "contours", "focal-points", "drives"
POINTS_A_WRITE = 1 << 16  # 1 MB of focal points


def kept_file(folder: Path, kind: str, key: str) -> Path:
    """Path of a kept file in a unit's folder, as it is within the store; its folder is made."""
    path = folder / kind / f"{key}.h5"
    path.parent.mkdir(exist_ok=True)
    return path


def kept_payload(path: Path, seconds: dict[str, float]) -> dict[str, Any]:
    """The payload of a kept file that is whole: `path` within the store, `bytes`, `seconds`."""
    return {"path": f"{path.parent.name}/{path.name}", "bytes": path.stat().st_size, "seconds": seconds}


def keep_contours(rendering: Rendering, folder: Path, device: str) -> dict[str, Any]:
    """Render into a contour file, and return its payload; raises what `record` raises."""
    path, scene, started = kept_file(folder, CONTOURS, rendering.key), rendering.scene, perf_counter()
    record(path, scene.solid, scene.hand, rendering.poses.motion, scene.strategy, device=device)
    return kept_payload(path, {"keep-contours": perf_counter() - started})


@contextmanager
def contours_of(rendering: Rendering, folder: Path, device: str) -> Iterator[ContourRows]:
    """A rendering's contours: read from the file that this unit keeps of them, else rendered as they are read."""
    path, scene = folder / CONTOURS / f"{rendering.key}.h5", rendering.scene
    if not path.is_file():
        yield RenderedContours(scene, rendering.poses.motion, device, name=scene.solid.name)
        return
    with ContourFile(path) as file:
        yield file


class FocusKeeper:
    """Writes the focal points of a recipe into a file of their own."""

    def __init__(self, recipe: Recipe, folder: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        foci = () if strategy.foci == 1 else (strategy.foci,)
        self._waiting: list[FocalPoints] = []
        self.file = FrameFile(
            kept_file(folder, FOCAL_POINTS, recipe.key("keep-focal-points")),
            [FrameField("/focus/position", (*foci, 3), "m"), FrameField("/focus/intensity", foci, "1")],
            frame_count,
            attributes={
                "/": _attributes("palpate focal points", recipe, strategy),
                "/focus": {"update_rate": strategy.update_rate, "frame": "array"},
            },
        )

    def take(self, focus: FocalPoints) -> None:
        """Write the next focal points once they are many: HDF5 takes as long for a thousand as for ten thousand."""
        self._waiting.append(focus)
        if sum(own.intensity.size for own in self._waiting) >= POINTS_A_WRITE:
            self._write()

    def _write(self) -> None:
        focus, self._waiting = joined(self._waiting), []
        self.file.append({"/focus/position": focus.position, "/focus/intensity": focus.intensity})

    def publish(self) -> dict[str, Any]:
        """Complete the file, and return its payload."""
        if self._waiting:
            self._write()
        self.file.publish()
        return kept_payload(self.file.path, {})


def keep_focal_points(recipe: Recipe, folder: Path, strategy: SamplingStrategy, focus: FocalPoints) -> dict[str, Any]:
    """Write the file of all focal points of a recipe, and return its payload."""
    keeper = FocusKeeper(recipe, folder, strategy, len(focus.intensity))
    with keeper.file:
        keeper.take(focus)
        return keeper.publish()


class DriveKeeper:
    """Writes the drives of a recipe's arrays into a file of their own.

    Raises StrategyError, DeviceError for arrays that cannot play the sampling.
    """

    def __init__(self, recipe: Recipe, folder: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        if strategy.foci > POINTS_MOST:
            raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {strategy.foci}")
        models, drive = playing_arrays(recipe, strategy)
        # on the CPU, whatever renders: the same bits by whichever worker
        self._driver = Driver(models, drive, update_rate=strategy.update_rate)
        self._refused = 0
        self.file = FrameFile(
            kept_file(folder, DRIVES, recipe.key("keep-drives")),
            [
                FrameField("/drive/delay", (sum(model.transducer_count for model in models),), "turn"),
                FrameField("/drive/amplitude", (), "1"),
            ],
            frame_count,
            attributes={
                "/": _attributes("palpate drives", recipe, strategy),
                "/drive": {"update_rate": strategy.update_rate, "strategy": json.dumps(asdict(drive))},
                "/array": {
                    "names": json.dumps([model.name for model in models]),
                    "identities": json.dumps([model.identity() for model in models]),
                    "transducers": np.array([model.transducer_count for model in models]),
                    "carrier": models[0].carrier,
                },
            },
            arrays={
                FrameField("/array/position", (3,), "m"): np.concatenate([model.position for model in models]),
                FrameField("/array/normal", (3,), "1"): np.concatenate([model.normal for model in models]),
            },
        )

    def take(self, focus: FocalPoints) -> None:
        """Write the drives of the next focal points."""
        drives = self._driver.drive(focus)
        self._refused += drives.refused
        self.file.append({"/drive/delay": drives.delay, "/drive/amplitude": drives.amplitude})

    def publish(self) -> dict[str, Any]:
        """Complete the file, and return its payload, with the number of focal points that were `refused`."""
        self.file.publish()
        return {**kept_payload(self.file.path, {}), "refused": self._refused}


def _attributes(form: str, recipe: Recipe, strategy: SamplingStrategy) -> dict[str, Attribute]:
    """Attributes of the root of a file of frames."""
    return {
        "format": form,
        "version": np.array([1, 1], np.int32),
        "recipe": recipe.to_json(),
        "sampling": strategy.to_json(),
        "maker": code_version(),
    }
