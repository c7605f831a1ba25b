"""The live run that a file is the recording of: its description, and whether its arrays fit each other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..errors import ContourFileError
from ..storage.schema import LIVE

OPTIONAL_ARRAYS = ("gain",)
"""Arrays of /live that a live run may lack: an intensity of 1 throughout needs no array."""


@dataclass(frozen=True, kw_only=True)
class RecordedRun:
    """Everything of a live run but its arrays."""

    sampling: Mapping[str, Any]
    """JSON of the sampling strategy, its update rate included."""
    update_rate: float
    """[Hz]"""
    hold: float
    """Age from which a pose faded [s]."""
    samples: int
    """Samples of the run: sample k was due at k / update_rate."""
    foci: int
    """Focal points of a sample."""
    source: str
    """What the poses came from."""
    array: str
    """Name of the array."""
    lead: float
    """How long before it was due a focal point was drawn at most [s]."""
    realtime: bool
    """Whether the writer had real-time rights."""
    emission: str
    """Whose times `emitted` are: the "board" reported them, or they are an "estimate"."""

    @property
    def duration(self) -> float:
        """When the last sample's time is over [s]."""
        return self.samples / self.update_rate

    def described(self) -> dict[str, Any]:
        """Every field, for JSON."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> RecordedRun:
        """Read back what `described` gave, without names that this version does not know; raises ContourFileError."""
        names = [own.name for own in fields(cls)]
        if missing := next((name for name in names if name not in values), None):
            raise ContourFileError(f"/live: its attribute run has no {missing!r}")
        run = cls(**{name: values[name] for name in names})
        sampling: object = values["sampling"]
        if not isinstance(sampling, Mapping):
            raise ContourFileError(f"/live: sampling must be a JSON object, not {sampling!r:.60}")
        for name, least in (("samples", 1), ("foci", 1)):
            value = getattr(run, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise ContourFileError(f"/live: {name} must be a whole number of {least} or more, not {value!r:.60}")
        for name in ("update_rate", "hold", "lead"):
            value = getattr(run, name)
            finite = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not finite or value < 0 or (name == "update_rate" and value == 0):
                raise ContourFileError(f"/live: {name} must be a finite number above 0, not {value!r:.60}")
        for name, kind in (("source", str), ("array", str), ("emission", str), ("realtime", bool)):
            if not isinstance(getattr(run, name), kind):
                raise ContourFileError(f"/live: {name} must be of type {kind.__name__}, not {getattr(run, name)!r:.60}")
        return run


def require_live(described: Mapping[str, Any] | None, rows: Mapping[str, int], pose_count: int) -> None:
    """Raise ContourFileError unless the arrays of /live, here their numbers of rows, are what its description says."""
    if described is None:
        if rows:
            raise ContourFileError(f"/live/{min(rows)} is there, but /live has no attribute run")
        return
    run = RecordedRun.from_json(described)
    for name in (spec.name for spec in LIVE if spec.name not in OPTIONAL_ARRAYS):
        if name not in rows:
            raise ContourFileError(f"/live/{name} is missing")
    expected = {"stamp": pose_count, "emitted": pose_count, "mark": run.samples, "gain": run.samples}
    expected |= dict.fromkeys(("position", "intensity"), run.samples * run.foci)
    for name, count in expected.items():
        if rows.get(name, count) != count:
            raise ContourFileError(f"/live/{name} has {rows[name]} rows, expected {count}")
