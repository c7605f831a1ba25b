"""`Live`: an object, a hand that moves now, an array."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np

from ...datasets.recordings.alignment import Alignment
from ...device.playing.limits import Limits
from ..errors import StrategyError
from ..hands.hand import Hand
from ..intersection.named_inputs import solid_of
from ..objects.solid import Solid
from ..playback.drive import Driver, DriveStrategy
from ..playback.file_playback import Connection, ConnectionFields
from ..playback.focal_points import sampling_for
from ..playback.placed_arrays import PlacedArray, arrays_of, with_points
from ..sampling.presets import sampling_of, sets_rate
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy, strategy_of
from ..trust.permission import AllowCode
from .counts import RunStatistics
from .drawing_run import DrawingRun, require_intensity
from .held_arrays import HeldArrays
from .moment import LiveMoment, LiveScene
from .recorder import record_path
from .renderer_process import LiveRendering
from .sources.hand_frame import PoseSource
from .sources.named_sources import settings_and_hand
from .sources.pose_stream import ANY
from .sources.shaping import shaping_of

POLL = 0.05  # [s]


class Live:
    """An object on a hand that moves now: from its tracker's poses to the array, in a few milliseconds.

    A context manager: the array is opened when it is made, focal points go out within its context, and the array is off
    afterwards, whatever ends it. Source, drawing and writing are processes of their own; if this process is killed,
    they end, and the array is off.

    Args:
        solid: an object, or a name or file that the command line takes.
        hand: "palm", "planes" (moved by the source's joints) or "skin" (moved as a whole), or a hand.
        strategy: an intersection strategy, its name or its JSON file.
        sampling: a sampling strategy, its name or its JSON file; its update rate is that of the array.
        source: where poses come from: "exploration", a file of a recording or a motion, "udp", "udp:HOST:PORT",
            "ultraleap", "ultraleap:ws://HOST:PORT/v6.json", "MODULE:NAME", or a `PoseSource`.
        array: name of an array, a file of several, or placed arrays.
        drive: conversion of focal points to drives.
        lead: how far ahead of the present focal points go to the array [s]. A machine may stall for as long as that
            before one is dropped; a pose is felt later by as much. None: 6 ms, or four frames where those take longer.
        intensity: of all focal points, 0..1.
        limits: of on-time and duty; None: the defaults.
        record: contour file that everything is saved to at the end; None: nothing is saved.
        overwrite: whether `record` may replace a file.
        realtime: whether real-time scheduling is asked for.
        told: called with sentences on what goes wrong.
        side: which hand of the source: any, left or right.
        alignment: from the tracker's frame to the array's, as `load_recording` takes it.
        prediction: how far ahead of the tracker poses are predicted [s], see `Prediction`; 0: they are not.
        smoothing: cutoff of a low-pass of poses [Hz], see `Smoothing`; 0: there is none.
        allow_code: whether a module that `source` names may run.
        connection: options of the connection to the arrays; or its fields, such as emulate=True.

    Raises:
        StrategyError, MeshError, PoseError: what cannot be rendered.
        DeviceError: an array cannot be opened, or failed (when the context is left).

    >>> from palpate.render import Live
    >>> with Live("tube", strategy="cc", array="emulator", source="exploration") as live:
    ...     live.wait(0.5)
    ...     live.change(solid="cube")
    ...     live.set_intensity(0.5)
    ...     live.wait(0.5)
    >>> live.outcome["off_confirmed"]
    True
    """

    def __init__(
        self,
        solid: Solid | str,
        *,
        hand: Hand | str = "palm",
        strategy: IntersectionStrategy | str = "cc",
        sampling: SamplingStrategy | str | None = None,
        source: str | PoseSource = "exploration",
        array: str | Sequence[PlacedArray] = "emulator",
        drive: DriveStrategy | None = None,
        lead: float | None = None,
        intensity: float = 1.0,
        limits: Limits | None = None,
        record: str | Path | None = None,
        overwrite: bool = False,
        realtime: bool = True,
        told: Callable[[str], object] | None = None,
        side: str = ANY,
        alignment: Alignment | None = None,
        prediction: float = 0.0,
        smoothing: float = 0.0,
        allow_code: AllowCode = False,
        connection: Connection | None = None,
        **fields: Unpack[ConnectionFields],
    ) -> None:
        require_intensity(intensity)
        if connection is not None and fields:
            raise StrategyError(f"{min(fields)} is a field of connection, which is given, too")
        path = None if record is None else record_path(record, overwrite=overwrite)
        arrays = arrays_of(array)
        solid, sampling = solid_of(solid), sampling_for(sampling, arrays)
        arrays = with_points(arrays, sampling.foci)
        settings, own_hand = settings_and_hand(
            source,
            hand,
            solid,
            side=side,
            alignment=alignment,
            shaper=shaping_of(prediction, smoothing),
            realtime=realtime,
            allow_code=allow_code,
        )
        rendering = LiveRendering(
            solid=solid,
            hand=own_hand,
            strategy=strategy_of(strategy),
            sampling=sampling,
            drive=drive or DriveStrategy(),
        )
        driver = Driver([placed.model for placed in arrays], rendering.drive, update_rate=sampling.update_rate)
        driver.require_played()  # refused before arrays are opened
        self.files: list[Path] = []
        """What was recorded; several files where the rendering was changed."""
        self._held = held = HeldArrays(
            arrays,
            connection or Connection(**fields),
            update_rate=sampling.update_rate,
            lead=lead,
            limits=limits,
            realtime=realtime,
            told=told,
        )
        try:
            self._run = DrawingRun(
                [rendering], settings, held, intensity=intensity, realtime=realtime, is_recorded=path is not None
            )
        except BaseException:
            held.close()
            raise
        if path is not None:
            held.recorder_to(path, overwrite=overwrite, source=source)

    def __repr__(self) -> str:
        return f"Live({self._run.rendering.solid.name}, {self.statistics().latency!r})"

    def __enter__(self) -> Self:
        """Begin: focal points go out with the next pose."""
        self._run.begin(recorder=self._held.recorder)
        self._note("began", "")
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        ended_by = self._held.error or self._held.supervisor.error
        if ended_by is not None and error is None:
            raise ended_by

    def close(self) -> None:
        """Fade, off, and everything ended; then save what was recorded. Closing twice does nothing."""
        held = self._held
        try:
            if held.is_running:
                self._run.fade()
                time.sleep(held.lead)
        finally:  # a second Ctrl-C, too
            held.close(self._run.end)
        if held.recorder is not None:
            recorder, held.recorder = held.recorder, None
            self.files = recorder.save()

    @property
    def intensity(self) -> float:
        """Of all focal points, 0..1."""
        return self._run.intensity

    def described(self) -> str:
        """What is rendered now, in a few words."""
        own = self._run.rendering
        return own.solid.name

    @property
    def outcome(self) -> dict[str, Any]:
        """What the writer reported at its end: counts, and of each array whether it is off; empty before."""
        return self._held.outcome

    def statistics(self) -> RunStatistics:
        """So far; after the end, of all."""
        return self._held.counts.statistics()

    def latencies(self) -> np.ndarray:
        """From the time stamp of each pose to its first focal point [s], in their order; of the last 400,000 poses."""
        return self._held.counts.latencies()

    def scene(self) -> LiveScene:
        """What a viewer draws and what stays the same until `change`: object, hand, strategy."""
        return self._run.scene()

    def moment(self) -> LiveMoment | None:
        """What is drawn now, for a viewer that asks again and again, from any thread; None while nothing is drawn.

        While somebody asks, at least twice a second, the process that draws copies what it draws at most 40 times a
        second, so asking more often gives the same again. A first call may take 50 ms, later ones do not wait.
        """
        return self._run.moment()

    @property
    def is_running(self) -> bool:
        """Whether focal points may still go out: no array failed, no limit was reached."""
        return self._held.is_running

    def wait(self, duration: float) -> None:
        """Wait for a time [s]; raises what ended the run before."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0:
            self._held.require_running()
            time.sleep(min(left, POLL))

    def change(
        self,
        *,
        solid: Solid | str | None = None,
        strategy: IntersectionStrategy | str | None = None,
        sampling: SamplingStrategy | str | None = None,
        drive: DriveStrategy | None = None,
    ) -> None:
        """Render something else from now on, prepared beside what runs; returns when it does.

        Raises what `Live` raises, and StrategyError for a sampling of another update rate; then what runs goes on.
        """
        rate = self._run.rendering.sampling.update_rate
        fields: dict[str, Any] = {
            "solid": None if solid is None else solid_of(solid),
            "strategy": None if strategy is None else strategy_of(strategy),
            "sampling": None if sampling is None else sampling_at(sampling, rate),
            "drive": drive,
        }
        given = {name: value for name, value in fields.items() if value is not None}
        self._run.change(**given)
        self._note("change", ", ".join(f"{name} {value!r}" for name, value in given.items()))

    def set_intensity(self, intensity: float) -> None:
        """Intensity of all focal points, 0..1."""
        self._run.set_intensity(intensity)
        self._note("intensity", f"{intensity:g}")

    def _note(self, kind: str, text: str) -> None:
        if self._held.recorder is not None:
            self._held.recorder.add_event(time.monotonic(), kind, text)


def sampling_at(sampling: SamplingStrategy | str, rate: float) -> SamplingStrategy:
    """A sampling strategy; names take the rate [Hz] that an array runs at."""

    own = sampling_of(sampling)
    return own if isinstance(sampling, SamplingStrategy) or sets_rate(sampling) else replace(own, update_rate=rate)
