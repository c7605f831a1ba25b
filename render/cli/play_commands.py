"""`palpate play` and `palpate prepare`: frames to an array, or into a file, and what a hand would miss."""

import math
from dataclasses import replace
from pathlib import Path
from typing import cast

import warp as wp

from ...datasets.counted import counted
from ...datasets.focus_files.frame_reader import FOCAL_POINTS, WIRE_FRAMES, FrameReader, frame_format
from ...device.link import TransportKind
from ...device.playing.limits import Limits
from ...device.playing.signals import ending_on_signals
from ...device.registry import kind_of
from ..errors import StrategyError
from ..file_kinds import is_point_list
from ..playback.drive import DriveStrategy
from ..playback.file_playback import Connection, Playback, play_file
from ..playback.focal_points import live_run_of, sampling_of_run, usual_rate
from ..playback.frames import Making
from ..playback.placed_arrays import PlacedArray, load_rig
from ..playback.prepared_frames import prepare_frames
from ..runtime.warp_start import start_warp
from ..sampling.presets import load_sampling, sets_rate
from ..sampling.strategy import JUMP_LENGTH, SamplingStrategy
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from .array_options import PlayCommand, PrepareCommand
from .shared_options import DriveOptions, LimitOptions, SamplingOptions

SHOWN_OF_PLAYING = (
    "first_frame_seconds", "frames", "update_rate", "duration", "bytes", "repeats", "underruns", "starved", "silenced",
    "board_underruns", "lateness", "queue_depth", "jumps", "jumps_by_cause", "jump_length", "hops", "hops_by_cause",
    "hop_speed_max", "step_longest", "draw_frequency", "revisit_rate", "absence_max", "samples", "silent", "held",
    "refused", "switched", "duty", "on_time", "array", "serial", "clock", "transport", "short_writes", "stopped_by",
    "off_sent", "off_after", "off_confirmed", "may_emit", "off_doubt", "arrays",
)  # fmt: skip
SHOWN_OF_PREPARING = (
    "arrays", "frames", "update_rate", "duration", "bytes", "jumps", "jumps_by_cause", "jump_length", "hops",
    "hops_by_cause", "hop_speed_max", "step_longest", "draw_frequency", "revisit_rate", "absence_max", "samples",
    "silent", "held", "refused", "switched", "device",
)  # fmt: skip
MODEL_LATE = (
    "this machine was busy, so the model waited {count} times for frames, {seconds:.3g} s in all. It has no queue such "
    "as libusb keeps for a board: clock=virtual plays to it as fast as it goes"
)
ONLY_THE_BOARD_KNOWS = ("board_underruns", "off_confirmed", "may_emit")


def run_play(job: PlayCommand, *, as_json: bool) -> int:
    """Play and report; the exit code is 1 if anything was warned of, and `strict` asked for."""
    file = job.file
    arrays = load_rig(job.array, serial=job.serial, calibration=job.calibration, baud=job.baud)
    require_device(job.device)
    form = frame_format(file)
    names = ", ".join(f"{placed.model.name} {placed.serial or ''}".strip() for placed in arrays)
    line_of_progress = bars.playback_line(f"playing {file} to {names}", quiet=as_json, elapsed=console.since_start)
    before = console.since_start()
    with ending_on_signals(), line_of_progress as line:
        playback = play_file(
            file,
            array=arrays,
            sampling=sampling_of(job, arrays, file, form),
            drive=drive_of(job),
            duration=job.duration,
            repeats=job.repeats,
            limits=limits_of(job),
            connection=Connection(
                emulate=job.emulate,
                clock=job.clock,
                transport=cast("TransportKind", job.transport),
                uncalibrated=job.uncalibrated,
                watchdog=job.watchdog,
            ),
            device=job.device,
            watch=line,
            compiling=console.report_compiling,
        )
    is_busy = job.emulate and not job.strict
    notes = model_notes(playback) if is_busy else []
    notes += watchdog_notes(arrays) if job.watchdog else []
    warnings = warnings_of(playback, arrays, is_model=is_busy)
    values = playback.as_dict() | {"warnings": warnings, "notes": notes}
    if playback.first_frame_seconds is not None:
        values["first_frame_seconds"] = before + playback.first_frame_seconds
    if len(arrays) > 1 and not as_json:
        values["arrays"] = [
            f"{report.array} {report.serial}: {report.frames} frames, {report.underruns} underruns, "
            f"{console.off_state(report)};"
            for report in playback.reports
        ]
    console.show_values(
        values, as_json=as_json, title=str(file), shown_names=SHOWN_OF_PLAYING, unknown=ONLY_THE_BOARD_KNOWS
    )
    for sentence in notes:
        print_message(console.worded(sentence), "note")
    for sentence in warnings:
        console.warn(sentence)
    console.conclude(meaning_of(playback), as_json=as_json)
    return console.FAILED if warnings and job.strict else console.DONE


def meaning_of(playback: Playback) -> str:
    """What a playback's numbers say, in a sentence."""
    played = playback.played
    late = "none of them late" if not playback.underruns else f"with {counted(playback.underruns, 'underrun')}"
    text = f"{counted(played.frames, 'frame')} in {played.duration:.3g} s, {late}"
    if playback.count is not None and playback.sampling is not None:
        count = playback.count
        if frequency := count.draw_frequency(playback.sampling.update_rate):
            text += f"; each contour was drawn {frequency:.0f} times a second on average"
        text += f"; the focal point jumped {counted(sum(count.jumps.values()), 'time')}"
    return f"{text}; afterwards {console.off_state(played)}."


def run_prepare(job: PrepareCommand, *, as_json: bool) -> None:
    """Write frames, and report what was counted and what a hand would miss."""
    file = job.file
    arrays = load_rig(job.array, calibration=job.calibration, baud=job.baud)
    require_device(job.device)
    with bars.progress_bar(f"preparing {file}", quiet=as_json) as watch:
        prepared = prepare_frames(
            file,
            job.out,
            array=arrays,
            sampling=sampling_of(job, arrays, file, frame_format(file)),
            drive=drive_of(job),
            duration=job.duration,
            device=job.device,
            overwrite=job.overwrite,
            watch=watch,
        )
    warnings = content_warnings(prepared.making, arrays)
    values = prepared.as_dict() | {"warnings": warnings}
    console.show_values(values, as_json=as_json, title=str(job.out), shown_names=SHOWN_OF_PREPARING)
    for sentence in warnings:
        console.warn(sentence)


def watchdog_notes(arrays: tuple[PlacedArray, ...]) -> list[str]:
    """Sentences on arrays that need no watchdog: none was started for them."""
    kinds = dict.fromkeys(kind_of(placed.model) for placed in arrays)
    return [
        f"no watchdog was started for {kind.name}: {kind.watches_itself}"
        for kind in kinds
        if kind.watches_itself is not None
    ]


def model_notes(playback: Playback) -> list[str]:
    """What late frames mean where there is no board that they could be late for."""
    late = [report for report in playback.reports if report.is_late]
    return [MODEL_LATE.format(count=report.underruns, seconds=report.starved) for report in late]


def warnings_of(playback: Playback, arrays: tuple[PlacedArray, ...], *, is_model: bool = False) -> list[str]:
    """What a hand would miss, a sentence each. is_model: whether late frames are those of models, see `model_notes`."""
    sentences = [console.late_warning(report) for report in playback.reports if report.is_late and not is_model]
    return sentences + content_warnings(playback, arrays)


def content_warnings(playback: Playback | Making, arrays: tuple[PlacedArray, ...]) -> list[str]:
    """What a hand would miss whenever the frames are played, a sentence each."""
    sentences = []
    zone = arrays[0].model.focal_zone
    if playback.refused:
        sentences.append(
            f"{playback.refused} focal points were silenced: they lie where no array can focus "
            f"({arrays[0].model.name}: |x| and |y| up to {zone.lateral:g} m, z {zone.z_min:g} to {zone.z_max:g} m)"
        )
    strategy = playback.sampling
    if strategy is not None and strategy.pace.kind in ("speed", "capped") and strategy.step > JUMP_LENGTH:
        sentences.append(_too_fast(strategy))
    if playback.switched:
        sentences.append(
            f"{playback.switched} frames had intensities between 0 and 1, but the array can only switch: they were "
            "played as 0 or 1"
        )
    return sentences


def _too_fast(strategy: SamplingStrategy) -> str:
    """Sentence on steps that draw no contour: the speed that draws one, how often it does, and what else there is."""
    speed = rounded_down(JUMP_LENGTH * strategy.update_rate)
    return (
        f"the focal point moves by {strategy.step * 1e3:.0f} mm from frame to frame, which draws no contour: "
        f"--speed {speed:g} or less would, and draws a contour of 0.1 m {speed / 0.1:.2g} times a second. If that is "
        "too seldom to feel, play to an array with a higher update rate, or --sampling am at a single pose"
    )


def rounded_down(value: float) -> float:
    """A number of two digits that is at most a positive value, and near it: a limit that is kept by following it.

    >>> from palpate.render.cli.play_commands import rounded_down
    >>> rounded_down(0.4465), rounded_down(7.0)
    (0.44, 7.0)
    """
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / digit) * digit:.2g}")


def require_device(device: str) -> None:
    """Start Warp, and refuse a device that it does not have."""
    start_warp()
    try:
        wp.get_device(device)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(str(one) for one in wp.get_devices())
        raise StrategyError(f"unknown device {device!r}; known: {known}") from error


def sampling_of(
    job: SamplingOptions, arrays: tuple[PlacedArray, ...], file: Path, form: str | None
) -> SamplingStrategy | None:
    """The sampling strategy asked for: a preset or a file, with other fields where options say so.

    form: of the file, as `frame_format` has it.
    """
    changes = {name: getattr(job, name) for name in ("speed", "update_rate") if getattr(job, name) is not None}
    if form == WIRE_FRAMES:
        return _sampling_of_frames(job, changes, file)
    if is_point_list(file) or form == FOCAL_POINTS:
        if changes or job.sampling is not None:
            asked = _sampling_names(job, changes)
            raise StrategyError(f"{file}: holds focal points at a rate of its own, so {asked} cannot be asked for")
        return None
    source = "stm" if job.sampling is None else job.sampling
    run = live_run_of(file) if job.sampling is None and form is None else None
    sampling = load_sampling(source) if run is None else sampling_of_run(run)
    if "update_rate" not in changes and run is None and not sets_rate(source):
        changes["update_rate"] = usual_rate(arrays[0].model, sampling)
    if "speed" in changes and sampling.pace.kind in ("frequency", "still"):
        raise StrategyError(f"speed changes nothing in sampling {source!r}: its pace.kind is {sampling.pace.kind!r}")
    return replace(sampling, **changes)


def _sampling_names(job: SamplingOptions, changes: dict) -> str:
    """Options of sampling that were given."""
    named = [*(["sampling"] if job.sampling is not None else []), *sorted(changes)]
    return ", ".join(f"--{name.replace('_', '-')}" for name in named)


def _sampling_of_frames(job: SamplingOptions, changes: dict, file: Path) -> None:
    """Refuse another rate than that of prepared frames, and anything else of sampling."""
    rate = changes.pop("update_rate", None)
    if changes or job.sampling is not None:
        asked = _sampling_names(job, changes)
        raise StrategyError(f"{file}: holds frames that were sampled before, so {asked} cannot be asked for")
    if rate is not None:
        with FrameReader(file) as frames:
            if rate != frames.update_rate:
                raise StrategyError(f"{file}: holds frames at {frames.update_rate:g} Hz, so not at {rate:g} Hz")


def drive_of(job: DriveOptions) -> DriveStrategy:
    """How focal points become drives, as options say."""
    return DriveStrategy(
        amplitude=job.amplitude,
        solver=job.solver,
        slew=job.slew,
        sound_speed=job.sound_speed,
        level_max=job.level_max,
    )


def limits_of(job: LimitOptions) -> Limits:
    """Limits, as options say; 0 lifts one."""
    try:
        return Limits(on_time_max=job.on_time_max or None, duty_max=job.duty_max or None)
    except ValueError as error:
        raise StrategyError(str(error)) from error
