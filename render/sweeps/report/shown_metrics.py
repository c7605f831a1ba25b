"""Which metrics a picture of a sweep shows, with their titles, in shown units."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .table import USER_COLUMN, is_missing, is_user_column

ROWS = 5  # metrics shown at most
SHOWN_UNITS = {
    "m": ("mm", 1e3),
    "m2": ("cm²", 1e4),
    "Hz": ("Hz", 1.0),
    "dB": ("dB", 1.0),
    "Pa": ("Pa", 1.0),
    "1": ("", 1.0),
}
TITLES: dict[str, tuple[str, str]] = {
    "length_mean": ("length", "m"),
    "r": ("r = |CC| / |OC|", "1"),
    "noise_db_300_10k": ("noise, 300 Hz to 10 kHz", "dB"),
    "pressure_focus_pressure": ("pressure at the focal point", "Pa"),
    "draw_frequency_actual": ("draw frequency", "Hz"),
    "jumps": ("jumps, all causes", "1"),
    "area_mean": ("area of contact", "m2"),
    "polylines_mean": ("polylines a pose", "1"),
    "revisit_rate": ("revisit rate", "Hz"),
    "dwell_spread": ("spread of dwell", "1"),
}
"""Metrics shown, the first that there are: title and unit. A user's own metrics come before the last of them."""


def shown_metrics(table: Mapping[str, Sequence[Any]]) -> dict[str, np.ndarray]:
    """Metrics that have values, at most ROWS, in shown units; what never differs comes only if nothing else does."""
    jumps = [numbers(table[key]) for key in table if key.startswith("jumps_")]
    # What was asked for beyond contours and draw frequency comes first, but for the length.
    own = [name for name in table if is_user_column(name) and name.endswith("_mean")]
    place = list(TITLES).index("draw_frequency_actual")
    names = [*list(TITLES)[:place], *own, *list(TITLES)[place:]]
    source: dict[str, np.ndarray] = {key: numbers(table[key]) for key in names if key in table}
    if jumps:
        source["jumps"] = np.sum(jumps, axis=0)
    there = {key: source[key] for key in names if key in source and np.isfinite(source[key]).any()}
    telling = {key: values for key, values in there.items() if np.nanmax(values) > np.nanmin(values)} or there
    return {key: SHOWN_UNITS[titled(key)[1]][1] * values for key, values in list(telling.items())[:ROWS]}


def titled(metric: str) -> tuple[str, str]:
    """Title and unit; a user's own metric has the name of its function, and no unit."""
    return TITLES.get(metric) or (metric.removeprefix(USER_COLUMN).removesuffix("_mean").replace("_", " "), "1")


def numbers(values: Sequence[Any]) -> np.ndarray:
    """float64, NaN for what is missing."""
    return np.array([math.nan if is_missing(value) else value for value in values], np.float64)
