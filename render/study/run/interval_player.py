"""Plays the stimuli of a study's intervals on an open array, and says of each what was played and when."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ....datasets.contour_file.live_summary import summarise_run
from ....datasets.contour_file.reader import ContourFile
from ....datasets.errors import ContourFileError, DatasetError
from ....device.errors import DeviceTimeoutError
from ...errors import StudyStorageError
from ...live.session import ONSET_TIMEOUT, LiveStimulus, Onset, Session
from ...reports.file_summary import length_ratio
from ..plan.stimulus_judgement import PlacedSolids, stimulus_of
from ..plan.study_plan import StudyPlan

HAND_SECONDS = 1.0  # [s] that a live stimulus waits for a hand before the participant is asked for one
PLAYED, STOPPED = "played", "stopped"


@dataclass(frozen=True, kw_only=True)
class PlayedInterval:
    """What came of one interval. Times of CLOCK_MONOTONIC [s]."""

    stimulus: str
    outcome: str
    """`played`, or `stopped` and why."""
    onset: float | None = None
    """Of the first focal point; None where none was played."""
    is_estimate: bool = False
    """Whether the onset is when the first frame was due, as the array cannot say when it was played."""
    latency: float | None = None
    """From the call that began the stimulus to its onset [s]."""
    ended: float | None = None
    """When the array was silent again."""
    seconds_on: float = 0.0
    """For which something was drawn [s]: what heats the array."""
    poses_file: Path | None = None
    """Contour file of what was drawn live, if it was kept."""


@dataclass(frozen=True, kw_only=True)
class DrawnInterval:
    """What a live interval drew, from its contour file."""

    poses: int
    pose_latency_p50: float | None
    """From a pose's time stamp to its first focal point [s]."""
    pose_latency_p99: float | None
    dropped: int
    """Focal points that were not played as drawn."""
    length_mean: float
    """Of all contours, over all poses [m]."""
    r: float | None
    """|CC| / |OC| over the same poses; None where the strategy closes nothing, or no open contour was met."""
    r_open: float | None
    """The same, a palm wholly inside the object counted as nothing."""


class IntervalPlayer:
    """Stimuli of a plan, loaded on a session, each played by its name."""

    def __init__(self, session: Session, plan: StudyPlan, solids: PlacedSolids) -> None:
        self._session = session
        self._is_under_way = False
        self._duration = {own.name: own.duration for own in plan.stimuli}
        self._is_live = {own.name: own.file is None for own in plan.stimuli}
        stimuli = []
        for own in plan.stimuli:
            stimulus = stimulus_of(own, plan.hand)
            if isinstance(stimulus, LiveStimulus):
                stimulus = replace(stimulus, solid=solids[own.solid or "", own.placement])
            stimuli.append(stimulus)
        self._numbers = dict(zip(self._duration, session.load(stimuli), strict=True))

    @property
    def update_rate(self) -> float:
        """Of all stimuli [Hz]."""
        return self._session.update_rate

    def play(
        self,
        name: str,
        *,
        poses_file: Path | None,
        is_held: Callable[[], bool],
        begun: Callable[[Onset], object],
        waits_for_hand: Callable[[], object],
    ) -> PlayedInterval:
        """Play a stimulus to its end, or until `is_held` says that nothing may play now.

        poses_file: of a live one, which `save_poses` makes; None: its poses are not kept. begun: called at its onset.
        waits_for_hand: called once a live one has found no hand for a second.
        Raises what ends the session: the array failed, or a limit was met.
        """
        session, is_live = self._session, self._is_live[name]
        drawn = session.statistics().frames_on
        kept = poses_file if is_live else None
        asks_at = time.monotonic() + HAND_SECONDS

        was_held = False

        def is_cancelled() -> bool:
            nonlocal asks_at, was_held
            if time.monotonic() >= asks_at:
                asks_at = float("inf")
                waits_for_hand()
            was_held = was_held or is_held()  # a page that comes back a moment later does not undo it
            return was_held

        if is_held():
            return PlayedInterval(stimulus=name, outcome="stopped before it began")
        outcome = PLAYED
        self._is_under_way = True
        try:
            onset = session.play(
                self._numbers[name], record=kept, saves_later=True, timeout=float("inf") if is_live else ONSET_TIMEOUT,
                is_cancelled=is_cancelled,
            )  # fmt: skip
            begun(onset)
            while not session.wait(0.0):
                if is_held():
                    session.stop()
                    outcome = STOPPED
        except DeviceTimeoutError:
            if not was_held:  # a stored one did not begin, although nobody stopped it: the array does not play
                raise
            self._is_under_way = False
            return PlayedInterval(stimulus=name, outcome="stopped before it began")
        except BaseException:  # Ctrl-C, for one: nothing plays on while what was played is put on disk
            with contextlib.suppress(Exception):
                session.stop()
            raise
        self._is_under_way = False
        ended = session.silent_since or time.monotonic()
        seconds_on = ended - onset.time
        if ended - onset.time < self._duration[name] - 0.05:
            outcome = STOPPED
        if is_live:
            seconds_on = min(seconds_on, (session.statistics().frames_on - drawn) / session.update_rate + _COUNTED_EACH)
        return PlayedInterval(
            stimulus=name,
            outcome=outcome if outcome == PLAYED else f"stopped after {ended - onset.time:.3f} s",
            onset=onset.time,
            is_estimate=onset.is_estimate,
            latency=onset.latency,
            ended=ended,
            seconds_on=seconds_on,
            poses_file=kept,
        )

    def broken(self, name: str, error: BaseException, poses_file: Path | None) -> PlayedInterval:
        """What is known of an interval that an error has ended."""
        reason = str(error) or type(error).__name__
        onset = self._session.last_onset if self._is_under_way else None
        self._is_under_way = False
        if onset is None:
            return PlayedInterval(stimulus=name, outcome=f"stopped before it began: {reason}")
        ended = self._session.silent_since or time.monotonic()
        return PlayedInterval(
            stimulus=name,
            outcome=f"stopped after {ended - onset.time:.3f} s: {reason}",
            onset=onset.time,
            is_estimate=onset.is_estimate,
            latency=onset.latency,
            ended=ended,
            seconds_on=ended - onset.time,
            poses_file=poses_file,
        )

    def drawn(self, interval: PlayedInterval) -> DrawnInterval | None:
        """What an interval drew, of the file that `save_poses` has made; None where its poses were not kept.

        Raises ContourFileError for a file that is no recording of one.
        """
        return None if interval.poses_file is None else drawn_interval(interval.poses_file)

    def save_poses(self) -> None:
        """Make the files of poses of all intervals so far.

        Raises StudyStorageError, after which it may be called again.
        """
        try:
            self._session.save_records()
        except (DatasetError, OSError) as error:
            raise StudyStorageError(f"poses could not be kept: {error}") from error


_COUNTED_EACH = 0.3  # [s]: frames that are drawn are counted so often, so that the last ones may be missing


def drawn_interval(path: Path) -> DrawnInterval:
    """What a live interval drew; raises ContourFileError for a file that is no recording of one."""
    with ContourFile(path) as file:
        metrics = file.metrics(0, file.pose_count)
        transform = file.strategy.get("transform")
        run = summarise_run(file)
    if run is None:
        raise ContourFileError(f"{path}: it is no recording of a live rendering")
    length, length_object = (metrics[name].astype(np.float64) for name in ("length", "length_object"))
    whole, opened = float(length.sum()), float(length_object.sum())
    partly = float(length[length_object > 0].sum())
    closes = isinstance(transform, list) and "close" in transform
    return DrawnInterval(
        poses=len(length),
        pose_latency_p50=run["latency_p50"],
        pose_latency_p99=run["latency_p99"],
        dropped=run["samples"] - run["emitted"],
        length_mean=float(length.mean()) if len(length) else 0.0,
        r=length_ratio(whole, opened) if closes else None,
        r_open=length_ratio(partly, opened) if closes else None,
    )
