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
from ....datasets.motions.hand_motion import HandMotion
from ....datasets.storage.hdf5_opening import Attribute
from ....kernels.driving.solve import POINTS_MOST
from ...errors import StrategyError
from ...intersection.file_recording import record
from ...intersection.scene import Scene
from ...playback.drive import Driver
from ...playback.focal_points import ContourRows
from ...sampling.metrics import FocalPoints
from ...sampling.sampler import joined
from ...sampling.strategy import SamplingStrategy
from ..plan.code_version import code_version
from ..plan.recipe import Recipe
from .rendering import arrays_of
from .sampling import RenderedContours

CONTOURS, FOCAL_POINTS, DRIVES = "contours", "focal-points", "drives"
POINTS_A_WRITE = 1 << 16  # 1 MB of focal points


def kept_file(folder: Path, kind: str, key: str) -> Path:
    """Path of a kept file in a unit's folder, as it is within the store; its folder is made."""
    path = folder / kind / f"{key}.h5"
    path.parent.mkdir(exist_ok=True)
    return path


def keep_contours(scene: Scene, motion: HandMotion, key: str, folder: Path, device: str) -> dict[str, Any]:
    """Render into a contour file: `path` within the store, `bytes`, `seconds`; raises what `record` raises."""
    path, started = kept_file(folder, CONTOURS, key), perf_counter()
    record(path, scene.solid, scene.hand, motion, scene.strategy, device=device)
    seconds = {"keep-contours": perf_counter() - started}
    return {"path": f"{CONTOURS}/{path.name}", "bytes": path.stat().st_size, "seconds": seconds}


@contextmanager
def contours_of(scene: Scene, motion: HandMotion, key: str, folder: Path, device: str) -> Iterator[ContourRows]:
    """A rendering's contours: read from the file that this unit keeps of them, else rendered as they are read."""
    path = folder / CONTOURS / f"{key}.h5"
    if not path.is_file():
        yield RenderedContours(scene, motion, device, name=scene.solid.name)
        return
    with ContourFile(path) as file:
        yield file


class FocusKeeper:
    """Focal points into a file of their own."""

    def __init__(self, recipe: Recipe, key: str, folder: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        foci = () if strategy.foci == 1 else (strategy.foci,)
        self._name = f"{FOCAL_POINTS}/{key}.h5"
        self._waiting: list[FocalPoints] = []
        self.file = FrameFile(
            kept_file(folder, FOCAL_POINTS, key),
            [FrameField("/focus/position", (*foci, 3), "m"), FrameField("/focus/intensity", foci, "1")],
            frame_count,
            attributes={
                "/": _attributes("palpate focal points", recipe, strategy),
                "/focus": {"update_rate": strategy.update_rate, "frame": "array"},
            },
        )

    def take(self, focus: FocalPoints) -> None:
        """Write the next ones, once they are many: HDF5 takes as long for a thousand as for ten thousand."""
        self._waiting.append(focus)
        if sum(own.intensity.size for own in self._waiting) >= POINTS_A_WRITE:
            self._write()

    def _write(self) -> None:
        focus, self._waiting = joined(self._waiting), []
        self.file.append({"/focus/position": focus.position, "/focus/intensity": focus.intensity})

    def publish(self) -> dict[str, Any]:
        """Have the file in its place: `path` within the store, `bytes`."""
        if self._waiting:
            self._write()
        return {"path": self._name, "bytes": self.file.publish(), "seconds": {}}


def keep_focal_points(recipe: Recipe, folder: Path, strategy: SamplingStrategy, focus: FocalPoints) -> dict[str, Any]:
    """Write the file of all focal points of a recipe; see `FocusKeeper`."""
    keeper = FocusKeeper(recipe, recipe.key("keep-focal-points"), folder, strategy, len(focus.intensity))
    with keeper.file:
        keeper.take(focus)
        return keeper.publish()


class DriveKeeper:
    """Drives of a recipe's arrays into a file of their own.

    Raises StrategyError, DeviceError for arrays that cannot play the sampling.
    """

    def __init__(self, recipe: Recipe, key: str, folder: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        models, drive = arrays_of(recipe.array)
        if strategy.foci > POINTS_MOST:
            raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {strategy.foci}")
        for model in models:
            model.divider(strategy.update_rate)
        # on the CPU, whatever renders: the same bits by whichever worker
        self._driver = Driver(models, drive, update_rate=strategy.update_rate)
        self._name, self._refused = f"{DRIVES}/{key}.h5", 0
        self.file = FrameFile(
            kept_file(folder, DRIVES, key),
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
        """Write drives of the next focal points."""
        drives = self._driver.drive(focus)
        self._refused += drives.refused
        self.file.append({"/drive/delay": drives.delay, "/drive/amplitude": drives.amplitude})

    def publish(self) -> dict[str, Any]:
        """Have the file in its place: `path` within the store, `bytes`, focal points that were `refused`."""
        return {"path": self._name, "bytes": self.file.publish(), "refused": self._refused, "seconds": {}}


def _attributes(form: str, recipe: Recipe, strategy: SamplingStrategy) -> dict[str, Attribute]:
    """Attributes of every file."""
    return {
        "format": form,
        "version": np.array([1, 1], np.int32),
        "recipe": recipe.to_json(),
        "sampling": strategy.to_json(),
        "maker": code_version(),
    }
