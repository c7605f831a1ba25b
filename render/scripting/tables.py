"""What batches become outside palpate: tables of pandas and xarray, and what a notebook shows of them."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
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


FACT_UNITS = {"duration": "s", "length": "m", "draw": "Hz"}  # by the first word of a fact's name


@dataclass(frozen=True, repr=False)
class ShownPicture:
    """A PNG in memory, which a notebook shows where it ends a cell."""

    png: bytes

    def __repr__(self) -> str:
        """One line."""
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return f"ShownPicture(PNG of {width} x {height} pixels)"

    def _repr_png_(self) -> bytes:
        return self.png


def facts_page(title: str, facts: Mapping[str, object], png: bytes | None) -> str:
    """Facts as an HTML table, in which None has no row, and below it the picture, if there is one."""
    rows = ""
    for name, value in facts.items():
        if value is not None:
            cell = f"{value:.4g}" if isinstance(value, float) else escape(str(value))
            unit = FACT_UNITS.get(name.split("_")[0], "")
            rows += f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{cell} {unit}</td></tr>"
    picture = "" if png is None else f'<img src="data:image/png;base64,{b64encode(png).decode()}"/>'
    return f"<table><caption>{escape(title)}</caption>{rows}</table>{picture}"
