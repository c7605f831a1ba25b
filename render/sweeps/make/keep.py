"""What a sweep keeps beside its numbers: contour files, focal points, drives (docs/formats/sweep-files.md).

| file | written | after a kill |
|---|---|---|
| contours/<key>.h5 | as `palpate render` does | goes on where it was |
| focal-points/<key>.h5 | block by block, under a temporary name | is made anew |
| drives/<key>.h5 | the same, while the focal points are made | is made anew |
"""

import json
import os
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import numpy as np

from ....datasets.contour_file.blocks import work_folder
from ....datasets.contour_file.check import check_file
from ....datasets.contour_file.reader import ContourFile
from ....datasets.errors import ContourFileError
from ....datasets.focus_files.frame_file import FrameField, FrameFile
from ....datasets.json_text import read_json
from ....datasets.motions.hand_motion import HandMotion
from ....datasets.storage.durable import FolderLock, discard, write_file
from ....datasets.storage.hdf5 import is_of_system
from ....datasets.storage.hdf5_opening import Attribute
from ....datasets.sweeps.counted_versions import read_counted
from ....datasets.sweeps.shard import DAMAGED_SUFFIX
from ....kernels.driving.solve import POINTS_MOST
from ...errors import PalpateWarning, StrategyError
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
LOOK_AGAIN = 0.2  # [s] while another process writes the same contour file
POINTS_A_WRITE = 1 << 16  # 1 MB of focal points
TRIES = 3  # of a contour file that others have just finished, or given up


def contours_at(store: Path, key: str) -> Path:
    """Where the contours of a rendering are kept."""
    return store / CONTOURS / f"{key}.h5"


def is_kept(path: Path) -> bool:
    """Whether a contour file is there whose code version counts; what has damaged it since is seen when it is read."""
    return path.is_file() and _is_counted(path)


def keep_contours(
    scene: Scene,
    motion: HandMotion,
    recipe: Recipe,
    key: str,
    store: Path,
    device: str,
    *,
    tick: Callable[[], object] = lambda: None,
) -> dict[str, Any]:
    """Have a rendering's contour file in the store; one that another process writes is waited for.

    An unfinished one of the same code is gone on with; what other code has made is made anew, and so is what is
    damaged, which is set aside. Returns `path` within the store, `bytes`, `seconds`. Raises what `record` raises.
    """
    path, started = contours_at(store, key), perf_counter()
    path.parent.mkdir(exist_ok=True)
    for left in reversed(range(TRIES)):
        while FolderLock.is_held(work_folder(path)):  # another process writes it
            sleep(LOOK_AGAIN)
            tick()
        if is_kept(path):
            damage = damage_of(path)
            if damage is None:
                break
            set_aside(path, damage)
        try:
            _claim(path, recipe)
            solid, hand, strategy = scene.solid, scene.hand, scene.strategy
            record(
                path, solid, hand, motion, strategy, mode="resume", device=device, progress=lambda done, count: tick()
            )
            break
        except ContourFileError:
            if left == 0 or not (FolderLock.is_held(work_folder(path)) or is_kept(path)):
                raise
    seconds = perf_counter() - started
    return {"path": f"{CONTOURS}/{path.name}", "bytes": path.stat().st_size, "seconds": {"keep-contours": seconds}}


def damage_of(path: Path) -> str | None:
    """What is damaged in a contour file, all of which is read; None if it is whole.

    Raises ContourFileError if the system does not let it be read now: that is no damage.
    """
    problems = check_file(path)
    if hindrance := next(filter(is_of_system, problems), None):
        raise ContourFileError(hindrance)
    return problems[0] if problems else None


def set_aside(path: Path, problem: str) -> bool:
    """Rename a contour file that is damaged, with a warning (PalpateWarning); False if there is none any more."""
    aside = path.with_name(path.name + DAMAGED_SUFFIX)
    try:
        os.replace(path, aside)
    except OSError:
        return False
    why = problem.removeprefix(f"{path} ")
    warnings.warn(f"{path} is damaged ({why}): kept as {aside.name}, and rendered again", PalpateWarning, 2)
    return True


def _claim(path: Path, recipe: Recipe) -> None:
    """Say beside a contour file which code makes it, what other code has left of it being removed first."""
    if _is_counted(path):
        return
    discard(path)
    if (folder := work_folder(path)).exists():
        shutil.rmtree(folder)
    parts = {name: getattr(recipe, name) for name in ("thing", "hand", "motion", "strategy")}
    text = json.dumps({"maker": code_version(), "recipe": parts}, indent=2)
    write_file(_beside(path), text.encode())


def _beside(path: Path) -> Path:
    return path.with_suffix(".json")


def _is_counted(path: Path) -> bool:
    """Whether a contour file, finished or not, is of this code, or of code whose results count for it."""
    maker, own = _maker_beside(path), code_version()
    return maker == own or (maker is not None and maker in read_counted(path.parents[1], own))


def _maker_beside(path: Path) -> str | None:
    """The code version that made a contour file; None if no file has it.

    Raises OSError if the file that has it may not be read: contours of other code are removed, so none may be mistaken.
    """
    try:
        beside = read_json(_beside(path))
    except (FileNotFoundError, ValueError):
        return None
    return beside.get("maker") if isinstance(beside, dict) else None


@contextmanager
def contours_of(scene: Scene, motion: HandMotion, key: str, store: Path, device: str) -> Iterator[ContourRows]:
    """A rendering's contours: read where they are kept, else rendered as they are read."""
    path = contours_at(store, key)
    if not is_kept(path):
        yield RenderedContours(scene, motion, device, name=scene.solid.name)
        return
    with ContourFile(path) as file:
        yield file


class FocusKeeper:
    """Focal points into a file of their own."""

    def __init__(self, recipe: Recipe, key: str, store: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        foci = () if strategy.foci == 1 else (strategy.foci,)
        self._name = f"{FOCAL_POINTS}/{key}.h5"
        self._waiting: list[FocalPoints] = []
        self.file = FrameFile(
            _room_for(store, self._name),
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


def keep_focal_points(recipe: Recipe, store: Path, strategy: SamplingStrategy, focus: FocalPoints) -> dict[str, Any]:
    """Have the file of all focal points of a recipe in the store; see `FocusKeeper`."""
    keeper = FocusKeeper(recipe, recipe.key("keep-focal-points"), store, strategy, len(focus.intensity))
    with keeper.file:
        keeper.take(focus)
        return keeper.publish()


class DriveKeeper:
    """Drives of a recipe's arrays into a file of their own.

    Raises StrategyError, DeviceError for arrays that cannot play the sampling.
    """

    def __init__(self, recipe: Recipe, key: str, store: Path, strategy: SamplingStrategy, frame_count: int) -> None:
        models, drive = arrays_of(recipe.array)
        if strategy.foci > POINTS_MOST:
            raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {strategy.foci}")
        for model in models:
            model.divider(strategy.update_rate)
        # on the CPU, whatever renders: the same bits by whichever worker
        self._driver = Driver(models, drive, update_rate=strategy.update_rate)
        self._name, self._refused = f"{DRIVES}/{key}.h5", 0
        self.file = FrameFile(
            _room_for(store, self._name),
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


def _room_for(store: Path, name: str) -> Path:
    path = store / name
    path.parent.mkdir(exist_ok=True)
    return path


def _attributes(form: str, recipe: Recipe, strategy: SamplingStrategy) -> dict[str, Attribute]:
    """Attributes of every file."""
    return {
        "format": form,
        "version": np.array([1, 1], np.int32),
        "recipe": recipe.to_json(),
        "sampling": strategy.to_json(),
        "maker": code_version(),
    }
