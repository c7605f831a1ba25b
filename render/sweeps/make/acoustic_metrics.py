"""Audible noise of a whole recipe, and pressure at a sample of its poses: how loud it is, and how it presses."""

import math
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from ....kernels.acoustics.resonance import DeviceFrames
from ...acoustics.emission import require_room
from ...acoustics.field_metrics import PoseMeter, measure_sample
from ...acoustics.noise import DURATION_LEAST, NoiseListener
from ...acoustics.transducers import PRESSURE_AT_1M, Resonance
from ...contour_batch import ContourBatch
from ...hands.hand import Hand
from ...hands.mesh_hand import MeshHand
from ...playback.drive import Driver, require_alike
from ...playback.focal_points import POINTS_A_READ, ContourRows
from ...playback.placed_arrays import PlacedArray
from ...sampling.metrics import FocalPoints
from ...sampling.strategy import SamplingStrategy
from ..plan.recipe import Recipe
from .rendering import playing_arrays


class NoiseMeter:
    """Takes the focal points of a recipe, and predicts the levels of the noise that they make [dB].

    The frames of all of them stay in the device's memory until then. device: Warp's; a GPU's levels are within 0.02 dB
    of the CPU's.
    Raises StrategyError for more frames than fit into memory, DeviceError for arrays that cannot play the sampling.
    """

    def __init__(self, recipe: Recipe, strategy: SamplingStrategy, frame_count: int, *, device: str = "cpu") -> None:
        models, drive = playing_arrays(recipe, strategy)
        require_alike(models)
        require_room(frame_count, strategy.update_rate, models)
        self._driver = Driver(models, drive, update_rate=strategy.update_rate, device=device)
        shape = (frame_count, self._driver.transducer_count)
        self._frames = DeviceFrames(
            wp.empty(shape, dtype=wp.uint8, device=device), wp.zeros(frame_count, dtype=wp.float32, device=device)
        )
        self._count, self._rate = 0, strategy.update_rate

    def take(self, focus: FocalPoints) -> None:
        """Add the frames of the next focal points."""
        rows = slice(self._count, self._count + len(focus.intensity))
        found = self._driver.rounded(focus)
        wp.copy(self._frames.delay[rows], found.delay)
        wp.copy(self._frames.level[rows], found.amplitude)
        self._count = rows.stop

    def publish(self) -> dict[str, Any]:
        """The levels by their columns, None for silence; a reason instead if the frames are too few for a spectrum."""
        started = perf_counter()
        duration = self._count / self._rate
        if duration < DURATION_LEAST:
            return {"reason": f"{duration:g} s are too short for a spectrum", "seconds": {}}
        listener = NoiseListener(self._driver.arrays, device=self._driver.device)
        frames = DeviceFrames(*(own[: self._count] for own in self._frames))
        signal = listener.signal_of(frames, self._rate)
        levels = signal.spectrum().levels()
        heard = {f"noise_{name}": level if math.isfinite(level) else None for name, level in levels.items()}
        return {**heard, "seconds": {"noise": perf_counter() - started}}


def measure_pressure(
    contours: ContourRows,
    hand: Hand,
    strategy: SamplingStrategy,
    recipe: Recipe,
    *,
    device: str = "cpu",
) -> dict[str, Any]:
    """Pressure of a recipe at a sample of its poses, by its columns; none of a hand that is a mesh.

    device: Warp's; a GPU's values are within 1e-3 of the CPU's.
    """
    started = perf_counter()
    if isinstance(hand, MeshHand):
        return {"reason": "pressure is predicted on patches of skin, not on meshes", "seconds": {}}
    models, drive = playing_arrays(recipe, strategy)
    blocks = contours.blocks(point_limit=POINTS_A_READ)
    lengths = [ContourBatch.from_arrays(contours.contours(first, stop)).length() for first, stop in blocks]
    length = np.concatenate(lengths) if lengths else np.zeros(0)
    arrays = tuple(PlacedArray(model) for model in models)
    meter = PoseMeter(arrays, strategy, drive, Resonance(), PRESSURE_AT_1M, device)
    found = measure_sample(contours, hand, length, meter).as_dict()
    columns = {f"pressure_{name}": value for name, value in found.items()}
    return {**columns, "seconds": {"pressure": perf_counter() - started}}
