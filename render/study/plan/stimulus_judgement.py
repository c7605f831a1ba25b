"""A plan's stimuli, each opened as the session will open it: what each lasts and drives, or why it cannot be played."""

import hashlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ....datasets.errors import DatasetError
from ....datasets.focus_files.frame_reader import WIRE_FRAMES, frame_format
from ....device.array import ArrayModel
from ....device.errors import DeviceError
from ....device.playing.limits import Guard, Limits
from ...errors import RenderError
from ...hands.hand import Hand
from ...intersection.named_inputs import load_solid
from ...intersection.scene import Scene
from ...live.handle import sampling_at
from ...live.session import LiveStimulus, Stimulus, opened_frames
from ...live.sources.named_sources import live_hand
from ...objects.mesh.placement import Placement
from ...objects.solid import Solid
from ...playback.focal_points import require_duration, sampling_for
from ...playback.placed_arrays import PlacedArray, with_points
from ...playback.prepared_frames import PreparedFrames
from ...trust.permission import AllowCode
from .study_plan import PlannedStimulus, StudyPlan

PlacedSolids = dict[tuple[str, Placement], Solid]
"""Objects that are rendered or seen, by name or path and placement."""
LIVE_TAIL = 0.15  # [s]; by which a live interval may emit longer than planned: what is drawn ahead, and its fade


@dataclass(frozen=True, kw_only=True)
class JudgedStimulus:
    """What a stimulus is, and what an interval with it drives at most."""

    name: str
    kind: Literal["stored", "live"]
    source: str
    """File, or name or path of the object."""
    sha256: str | None
    """Of the file, or of the digests of all files that it is made of; None: all is built in, or a file is missing."""
    seconds: float
    """Of the interval [s]."""
    duty: float
    """Mean duty of the interval, 0..1: measured of a stored one, 1 as the worst case of a live one."""
    update_rate: float | None
    """[Hz]; None where it is not known."""

    @property
    def emission_seconds(self) -> float:
        """How long it may emit [s]."""
        return self.seconds + (LIVE_TAIL if self.kind == "live" else 0.0)


@dataclass
class StimulusFindings:
    """What judging all stimuli has found."""

    stimuli: list[JudgedStimulus] = field(default_factory=list)
    update_rate: float = 0.0
    """That all stimuli have, or the first of them that has another one than the array's usual rate [Hz]."""
    foci: int = 1
    """Most focal points of a sample."""
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def stimulus_of(planned: PlannedStimulus, hand: Hand | str) -> Stimulus | LiveStimulus:
    """A planned stimulus as `Session.load` takes it; prepared frames are played to their end, so they get no duration.

    >>> from palpate.render.study.plan.stimulus_judgement import stimulus_of
    >>> from palpate.render.study.plan.study_plan import PlannedStimulus
    >>> stimulus_of(PlannedStimulus(name="tube oc", duration=7.0, solid="tube", strategy="oc"), "palm")
    LiveStimulus(solid='tube', duration=7.0, hand='palm', strategy='oc', sampling=None, drive=None)
    """
    if planned.file is None:
        return LiveStimulus(
            planned.solid or "", planned.duration, hand=hand, strategy=planned.strategy, sampling=planned.sampling
        )
    duration = None if frame_format(planned.file) == WIRE_FRAMES else planned.duration
    return Stimulus(planned.file, sampling=planned.sampling, duration=duration)


def judge_stimuli(
    plan: StudyPlan, array: ArrayModel, *, allow_code: AllowCode = False, solids: PlacedSolids | None = None
) -> StimulusFindings:
    """Open every stimulus of a plan for an array, measure what it drives, and list what cannot be played.

    solids: gets all objects that could be loaded.
    """
    arrays = (PlacedArray(array),)
    usual = sampling_for(None, arrays).update_rate
    found = StimulusFindings(update_rate=usual)
    for planned in plan.stimuli:
        # A session runs at one rate. A file may have its own, which decides then; faults are listed further down.
        with _listing(StimulusFindings(), ""):
            if planned.file is not None and planned.file.is_file():
                with opened_frames(_stored(planned), arrays, usual, sized=True) as frames:
                    found.update_rate = frames.update_rate
        if found.update_rate != usual:
            break
    with _listing(found, f"{array.name}: "):
        array.divider(found.update_rate)
    solids = {} if solids is None else solids
    tried: set[tuple[str, Placement]] = set()
    hand: Hand | None = None
    if any(planned.file is None for planned in plan.stimuli):
        with _listing(found, ""):
            hand = live_hand(plan.hand)
    prepared: dict[str, int] = {}  # focal points of a frame, by the names of stimuli of prepared frames
    for planned in plan.stimuli:
        where = f"stimulus {planned.name}: "
        for name in dict.fromkeys(name for name in (planned.solid, planned.shown) if name is not None):
            key = name, planned.placement
            if key not in tried:
                tried.add(key)
                with _listing(found, where):
                    solids[key] = load_solid(*key, allow_code=allow_code)
        if planned.file is not None:
            found.stimuli.append(_judge_stored(planned, planned.file, arrays, found, prepared))
        else:
            solid = solids.get((planned.solid or "", planned.placement))
            found.stimuli.append(_judge_live(planned, solid, hand, found))
    for name, foci in prepared.items() if array.takes_points else ():
        if foci != found.foci:
            found.faults.append(
                f"stimulus {name}: its prepared frames have {foci} focal points each, but array {array.name} is "
                f"opened for {found.foci}, the most of any stimulus: prepare frames of as many, or plan the contours"
            )
    return found


def _judge_stored(
    planned: PlannedStimulus,
    path: Path,
    arrays: tuple[PlacedArray, ...],
    found: StimulusFindings,
    prepared: dict[str, int],
) -> JudgedStimulus:
    digest, rate, seconds, duty = None, None, planned.duration, 1.0
    where = f"stimulus {planned.name}: "
    if not path.exists():
        found.faults.append(f"{where}{path} is missing")
    else:
        with _listing(found, where):
            digest = sha256_of(path)
            with opened_frames(_stored(planned), arrays, found.update_rate, sized=True) as frames:
                rate = frames.update_rate
                found.foci = max(found.foci, frames.foci)
                if isinstance(frames, PreparedFrames):
                    prepared[planned.name] = frames.foci
                seconds = frames.frame_count / rate
                driven = [0.0 for _ in arrays]
                sized = with_points(arrays, frames.foci)
                guards = [Guard(Limits(on_time_max=None, duty_max=None), placed.model) for placed in sized]
                for row in frames:
                    for number, (guard, block) in enumerate(zip(guards, row, strict=True)):
                        driven[number] += sum(dose.duty_sum for dose in guard.measure(block, len(block)))
                duty = max(driven) / frames.frame_count
                if refused := frames.making.refused:
                    found.notes.append(
                        f"{where}{refused} of {frames.frame_count} focal points are out of the array's reach and silent"
                    )
            if rate != found.update_rate:
                found.faults.append(
                    f"{where}{path} has an update rate of {rate:g} Hz, but all stimuli of a study must have the same, "
                    f"which is {found.update_rate:g} Hz"
                )
            if abs(seconds - planned.duration) > 1.5 / rate:
                found.faults.append(f"{where}{path} plays for {seconds:g} s, but duration is {planned.duration:g} s")
            if duty == 0.0:
                found.notes.append(f"{where}{path} emits nothing")
    return JudgedStimulus(
        name=planned.name, kind="stored", source=str(path), sha256=digest, seconds=seconds, duty=duty, update_rate=rate
    )


def _judge_live(
    planned: PlannedStimulus, solid: Solid | None, hand: Hand | None, found: StimulusFindings
) -> JudgedStimulus:
    digest, rate = None, None
    where = f"stimulus {planned.name}: "
    with _listing(found, where):
        require_duration(planned.duration)
        named = (planned.solid, planned.shown, planned.strategy, planned.sampling)
        paths = [Path(part) for name in named if name is not None for part in (name, name.rpartition(":")[0]) if part]
        digests = [sha256_of(path) for path in paths if path.is_file()]
        digest = next(iter(digests), None)
        if len(digests) > 1:
            digest = hashlib.sha256("".join(digests).encode()).hexdigest()
        sampling = sampling_at(planned.sampling or "stm", found.update_rate)
        rate, found.foci = sampling.update_rate, max(found.foci, sampling.foci)
        if rate != found.update_rate:
            found.faults.append(
                f"{where}its sampling has an update rate of {rate:g} Hz, but all stimuli of a study must have the "
                f"same, which is {found.update_rate:g} Hz"
            )
        if solid is not None and hand is not None:
            Scene.of(solid, hand, planned.strategy)
    return JudgedStimulus(
        name=planned.name,
        kind="live",
        source=planned.solid or "",
        sha256=digest,
        seconds=planned.duration,
        duty=1.0,
        update_rate=rate,
    )


def _stored(planned: PlannedStimulus) -> Stimulus:
    stimulus = stimulus_of(planned, "palm")
    assert isinstance(stimulus, Stimulus)
    return stimulus


@contextmanager
def _listing(found: StimulusFindings, where: str) -> Iterator[None]:
    """List what is raised for bad input as a fault, and what is warned of as a note; sentences begin with `where`."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            yield
        except (RenderError, DatasetError, DeviceError) as error:
            found.faults.append(f"{where}{error}")
        except OSError as error:
            found.faults.append(f"{where}cannot be read ({error.strerror or error})")
    found.notes += [f"{where}{own.message}" for own in warned]
