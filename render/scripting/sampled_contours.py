"""Focal points of a whole motion, with what happened on the way."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...datasets.focus_files.ptlist import PointListError, write_ptlist
from ..batch_rows import BatchRows
from ..playback.focal_points import ContourSource
from ..sampling.metrics import FocalPoints, SamplingCount
from ..sampling.presets import sampling_of
from ..sampling.sampler import Sampler, joined
from ..sampling.strategy import SamplingStrategy
from .tables import frame_of

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False, eq=False)
class SampledContours:
    """Focal points at the update rate, as `RenderedBatch.sample` gives them.

    >>> from palpate.render import render, static_pose
    >>> sampled = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").sample("stm", duration=0.1)
    >>> sampled.position.shape, round(sampled.draw_frequency, 1)  # 0.34 m at 7 m/s [Hz]
    ((1000, 3), 20.6)
    """

    focus: FocalPoints
    sampling: SamplingStrategy
    count: SamplingCount
    """Jumps, hops and silence."""

    def __repr__(self) -> str:
        """One line: how many, how fast, and what disturbs."""
        jumps, frequency = sum(self.count.jumps.values()), self.draw_frequency
        drawn = f"draw frequency {frequency:.1f} Hz" if frequency else "no contour drawn around"
        return (
            f"SampledContours({len(self)} focal points at {self.update_rate:g} Hz, {len(self) / self.update_rate:g} s, "
            f"{self.count.silent} silent, {jumps} jumps, {drawn})"
        )

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.focus.intensity)

    @property
    def position(self) -> np.ndarray:
        """[m], array frame, float32, shape [sample, 3]; with several foci [sample, focus, 3]."""
        return self.focus.position

    @property
    def intensity(self) -> np.ndarray:
        """Relative pressure amplitude 0..1, float32, shape [sample] or [sample, focus]."""
        return self.focus.intensity

    @property
    def time(self) -> np.ndarray:
        """Of each sample [s], shape [sample]."""
        return np.arange(len(self)) / self.update_rate

    @property
    def update_rate(self) -> float:
        """Samples a second [Hz]."""
        return self.sampling.update_rate

    @property
    def draw_frequency(self) -> float | None:
        """Mean draw frequency while something is drawn [Hz]; None if nothing is (docs/guide/sampling.md)."""
        return self.count.draw_frequency(self.update_rate)

    @property
    def revisit_rate(self) -> float | None:
        """How often a place on the skin is drawn in fact [Hz]; None if none was drawn again."""
        return self.count.revisit_rate

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a point list (.ptlist), which `play_file` and DOLPHIN read; returns its path.

        Raises PointListError for several focal points at once, another suffix, and a file that is there already.
        """
        if Path(path).suffix.lower() != ".ptlist":
            raise PointListError(f"{path}: a point list must end in .ptlist; to_pandas().to_csv(path) writes a table")
        write_ptlist(path, self.position, self.intensity, self.update_rate, overwrite=overwrite)
        return Path(path)

    def to_pandas(self) -> "pd.DataFrame":
        """A table with one row for each sample and focal point: time [s], x, y, z [m], intensity."""
        position = self.position.reshape(-1, 3)
        columns = {"time": np.repeat(self.time, len(position) // max(1, len(self)))}
        columns |= {name: position[:, k] for k, name in enumerate("xyz")}
        return frame_of(columns | {"intensity": self.intensity.ravel()})


def sample_rows(
    rows: BatchRows, sampling: SamplingStrategy | str | Path, duration: float | None, **changes: float | None
) -> SampledContours:
    """Focal points of contours in memory; changes: of the strategy's values; others as for `RenderedBatch.sample`."""
    given = {name: value for name, value in changes.items() if value is not None}
    sampler = Sampler(replace(sampling_of(sampling), **given))
    blocks = list(ContourSource(rows, sampler, duration))
    return SampledContours(joined(blocks), sampler.strategy, sampler.count)
