"""Batches as tables of pandas and xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.storage.schema import KIND_NAMES
from ..contour_batch import ContourBatch
from ..errors import StrategyError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

UNITS = {"time": "s", "x": "m", "y": "m", "z": "m", "length": "m"} | {f"length_{kind}": "m" for kind in KIND_NAMES}


def pose_frame(batch: ContourBatch, motion: HandMotion) -> pd.DataFrame:
    """One row for each pose, its index: time, the hand's pose, lengths by kind, polylines, points."""
    host = batch.numpy()
    lengths = host.lengths()
    columns: dict[str, np.ndarray] = {} if motion.time is None else {"time": motion.time}
    columns |= {name: motion.pose[:, k] for k, name in enumerate(("x", "y", "z", "qx", "qy", "qz", "qw"))}
    columns["length"] = lengths.sum(axis=1)
    columns |= {f"length_{kind}": lengths[:, k] for k, kind in enumerate(KIND_NAMES)}
    columns["polylines"] = np.diff(host.pose_start)
    columns["points"] = np.diff(host.polyline_start[host.pose_start])
    return frame_of(columns).rename_axis(index="pose")


def point_frame(batch: ContourBatch) -> pd.DataFrame:
    """One row for each point: pose, polyline, place [m], kind of the segment that begins there, intensity."""
    host = batch.numpy()
    polyline = np.repeat(np.arange(host.polyline_count), np.diff(host.polyline_start))
    pose = np.repeat(np.arange(len(host)), np.diff(host.pose_start))[polyline]
    columns: dict[str, Any] = {"pose": pose, "polyline": polyline}
    columns |= {name: host.points[:, k] for k, name in enumerate("xyz")}
    columns["kind"] = np.array(KIND_NAMES)[host.kind]
    columns["intensity"] = np.ones(len(pose), np.float32) if host.intensity is None else host.intensity
    return frame_of(columns)


def pose_dataset(batch: ContourBatch, motion: HandMotion) -> xr.Dataset:
    """The same with units as attributes; the times, if there are any, are a coordinate."""
    try:
        dataset = pose_frame(batch, motion).to_xarray()
    except ImportError as error:
        raise StrategyError("a Dataset needs xarray: pip install xarray") from error
    for name in UNITS.keys() & dataset.keys():
        dataset[name].attrs["units"] = UNITS[name]
    return dataset.set_coords("time") if "time" in dataset else dataset


def frame_of(columns: dict[str, Any]) -> pd.DataFrame:
    """Columns as a DataFrame; raises StrategyError if pandas is not installed."""
    try:
        import pandas
    except ImportError as error:
        raise StrategyError("a DataFrame needs pandas: pip install pandas") from error
    return pandas.DataFrame(columns)
