"""What `palpate field` and `palpate noise` do: pressure on the palm, in a plane or a volume; sound and its levels."""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.focus_files.frame_reader import frame_format
from ...datasets.rigid import rotate
from ...datasets.storage.durable import write_file
from ...device.array import ArrayModel
from ..acoustics.averaged_frames import frames_of_average
from ..acoustics.drawn_frames import DrawnPose, drawn_pose, drives_of, longest_pose, pose_at
from ..acoustics.field_metrics import planes_of, sampling_for, width_at
from ..acoustics.noise import NoiseListener, NoiseModel
from ..acoustics.prediction import frames_of
from ..acoustics.pressure import PressureSum, complex_drives, follow_drives, require_places
from ..acoustics.radiation import AIR_DENSITY, mean_square
from ..acoustics.sampled_places import sample_plane, sample_volume
from ..acoustics.skin_print import CELLS, SkinPrint, points_along, print_on, unevenness
from ..acoustics.spectrum import NoiseSignal, NoiseSpectrum, level_differences
from ..acoustics.transducers import PRESSURE_AT_1M, Resonance, TransducerSet
from ..acoustics.wave_files import require_wave_file, write_wave_files
from ..errors import StrategyError
from ..playback.drive import Driver, DriveStrategy
from ..playback.placed_arrays import PlacedArray, load_rig
from ..reports.field_figure import FieldPicture, draw_fields, print_picture, volume_picture
from ..reports.noise_figure import draw_noise
from ..runtime.warp_start import start_warp
from ..sampling.sampler import has_contours
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from ..terminal.value_words import words_of
from .contour_options import FieldCommand, NoiseCommand
from .play_commands import require_device, sampling_of

SIZES = {"plane": 0.2, "volume": 0.12}  # [m]
SPACINGS = {"palm": 1e-3, "plane": 1e-3, "volume": 4e-3}  # [m]
LEFT_OUT = "the hand's shadow and echo; pressures are right to some 50 %, forces to a factor of 2"
SHOWN = (
    "pose", "time", "where", "average", "frames", "points", "pressure_peak", "radiation_peak", "force", "focal_width",
    "share_on_contour", "unevenness", "out", "left_out", "supposed",
)  # fmt: skip


class AveragedDrives(NamedTuple):
    """What an array emits in the frames that are averaged, in units of full drive."""

    drawn: DrawnPose
    drive: np.ndarray
    """complex64, shape [frame, transducer]."""
    transducers: TransducerSet
    device: str

    @property
    def field(self) -> PressureSum:
        """Sums its waves."""
        return PressureSum(self.transducers, device=self.device)


def run_field(job: FieldCommand, *, as_json: bool) -> None:
    """Compute, draw or write, report; several files into one picture."""
    paths = job.files
    start_warp()
    arrays = load_rig(job.array, calibration=job.calibration)
    found, shown = [], []
    for path in paths:
        with bars.progress_bar(f"sampling {path}", quiet=as_json):
            emitted = averaged_drives(path, job, arrays)
        with bars.progress_bar("points", quiet=as_json) as bar:
            compute = _in_volume if job.where == "volume" else _on_planes
            values, picture = compute(path, job, emitted, arrays, bar)
        found.append(values)
        shown.append(picture)
    if job.out is not None and job.draws:
        look = {"width": job.width, "font_size": job.font_size}
        draw_fields(shown, job.out, overwrite=job.overwrite, **look)
    if as_json and len(found) > 1:
        console.show_values({"files": found}, as_json=True, title="")
        return
    for path, values in zip(paths, found, strict=True):
        console.show_values(values, as_json=as_json, title=str(path), shown_names=SHOWN)


def averaged_drives(path: Path, job: FieldCommand, arrays: tuple[PlacedArray, ...]) -> AveragedDrives:
    """What is emitted, as the boards round it, in the frames that a job asks for."""
    sampling = replace(
        sampling_for(job.sampling, arrays),
        **{name: getattr(job, name) for name in ("speed", "update_rate") if getattr(job, name) is not None},
    )
    resonance = None if job.resonance is None else Resonance(pole=job.resonance)
    with ContourFile(path) as file:
        if not file.sealed:
            raise StrategyError(f"{path}: is not finished; palpate render --resume finishes it")
        index = longest_pose(file) if job.pose is None else job.pose
        if job.at is not None:
            index = pose_at(file, job.at)
        drawn = drawn_pose(file, index)
    if not has_contours(drawn.batch) and job.average == "cycle":
        raise StrategyError(f"pose {index} of {path} has no contours, so nothing is drawn: choose another one")
    focus, lead = frames_of_average(path, drawn, job.at, job.average, sampling, arrays, resonance)
    models = [placed.model for placed in arrays]
    driver = Driver(models, update_rate=sampling.update_rate, device=job.device)
    strategy = driver.strategy
    transducers = TransducerSet(models, sound_speed=strategy.sound_speed, piston_radius=strategy.piston_radius)
    drive = complex_drives(drives_of(driver, focus), transducers, quantised=True)
    if resonance is not None:
        drive = follow_drives(drive, resonance, carrier=transducers.carrier, update_rate=sampling.update_rate)
    return AveragedDrives(drawn, drive[lead:], transducers, job.device)


def _facts(path: Path, job: FieldCommand, emitted: AveragedDrives) -> dict:
    drawn = emitted.drawn
    return {
        "path": str(path),
        "pose": drawn.index,
        "time": job.at if job.at is not None else drawn.time,
        "where": job.where,
        "average": job.average,
        "frames": len(emitted.drive),
        "out": None if job.out is None else str(job.out),
        "left_out": LEFT_OUT,
        "supposed": emitted.transducers.supposed,
    }


def _on_planes(
    path: Path,
    job: FieldCommand,
    emitted: AveragedDrives,
    arrays: tuple[PlacedArray, ...],
    bar: Callable[[int, int], None],
) -> tuple[dict, FieldPicture]:
    drawn, spacing = emitted.drawn, job.spacing or SPACINGS[job.where]
    if job.where == "palm":
        planes = planes_of(drawn, spacing)
    else:
        x, y = rotate(arrays[0].model.pose[3:], np.eye(3)[:2])
        size = job.size or SIZES["plane"]
        planes = [sample_plane(_centre(job, drawn), x, y, (size, size), spacing)]
    place = require_places(np.concatenate([plane.points for plane in planes]), emitted.transducers)
    skin = print_on(planes, emitted.field, emitted.drive, pressure_at_1m=PRESSURE_AT_1M, progress=bar)
    lines = drawn.polylines()
    values = _facts(path, job, emitted) | _numbers(skin, drawn, emitted, len(place), job.where == "palm")
    title = f"{path.stem}, pose {drawn.index}, {job.where}, mean over {len(emitted.drive)} frames ({job.average})"
    if job.out is not None and not job.draws:
        arrays_kept = {
            "points": place,
            "radiation": np.concatenate([part.ravel() for part in skin.radiation]),
            "shape": np.array([plane.shape for plane in planes]),
            "contour": np.concatenate([*lines, np.zeros((0, 3))]),
            "contour_start": np.cumsum([0, *map(len, lines)]),
        }
        _write_arrays(job.out, arrays_kept, emitted, place)
    return values, print_picture(skin, lines, title=title, focal_width=values["focal_width"])


def _numbers(
    skin: SkinPrint,
    drawn: DrawnPose,
    emitted: AveragedDrives,
    point_count: int,
    is_skin: bool,
) -> dict:
    lines, width = drawn.polylines(), width_at(drawn.pose[:3], emitted.transducers)
    along, _ = mean_square(emitted.field, points_along(lines, width / CELLS), emitted.drive)
    return {
        "points": point_count,
        "pressure_peak": skin.pressure_peak,
        "radiation_peak": skin.radiation_peak,
        "force": skin.force,
        "focal_width": width,
        "share_on_contour": skin.share_within(lines, width) if is_skin else None,
        "unevenness": unevenness(along),
        "pressure_at_1m": PRESSURE_AT_1M,
    }


def _in_volume(
    path: Path,
    job: FieldCommand,
    emitted: AveragedDrives,
    arrays: tuple[PlacedArray, ...],
    bar: Callable[[int, int], None],
) -> tuple[dict, FieldPicture]:
    centre = _centre(job, emitted.drawn)
    size, spacing = job.size or SIZES["volume"], job.spacing or SPACINGS["volume"]
    coordinates = sample_volume(centre.tolist(), size, spacing)
    z, y, x = np.meshgrid(*coordinates[::-1], indexing="ij")
    place = require_places(np.stack([x, y, z], axis=-1).reshape(-1, 3), emitted.transducers)
    mean, most = mean_square(emitted.field, place, emitted.drive, progress=bar)
    radiation = mean * (PRESSURE_AT_1M**2 / (AIR_DENSITY * emitted.transducers.sound_speed**2))
    if job.out is not None and not job.draws:
        kept = dict(zip("xyz", coordinates, strict=True)) | {"radiation": radiation.reshape(x.shape)}
        _write_arrays(job.out, kept, emitted, place)
    title = f"{path.stem}, pose {emitted.drawn.index}, mean over {len(emitted.drive)} frames ({job.average})"
    width = width_at(emitted.drawn.pose[:3], emitted.transducers)
    picture = volume_picture(coordinates, radiation.reshape(x.shape), title=title, focal_width=width)
    values = _facts(path, job, emitted) | {
        "points": len(place),
        "pressure_peak": PRESSURE_AT_1M * float(np.sqrt(most.max())),
        "radiation_peak": float(radiation.max()),
        "focal_width": width,
        "pressure_at_1m": PRESSURE_AT_1M,
    }
    return values, picture


def _centre(job: FieldCommand, drawn: DrawnPose) -> np.ndarray:
    return np.asarray(drawn.pose[:3] if job.centre is None else job.centre, float)


def _write_arrays(out: Path, arrays: dict[str, np.ndarray], emitted: AveragedDrives, place: np.ndarray) -> None:
    """Write arrays whole or not at all; of a single frame, its complex pressure [Pa] at the points, too."""
    if len(emitted.drive) == 1:
        parts = [part[0] for _, part in emitted.field.blocks(place, emitted.drive)]
        arrays = arrays | {"pressure": np.concatenate(parts) * np.float32(PRESSURE_AT_1M)}
    content = io.BytesIO()
    np.savez(content, **{name: np.asarray(value) for name, value in arrays.items()})  # type: ignore[arg-type]
    try:
        write_file(out, content.getbuffer())
    except OSError as error:
        raise ContourFileError(f"{out}: cannot be written ({error.strerror or error})") from error


def run_noise(job: NoiseCommand, *, as_json: bool) -> None:
    """Predict, compare with the first file, and write what is asked for."""
    files = job.files
    waves = _wave_files(job)
    arrays = load_rig(job.array, calibration=job.calibration)
    signals = _signals(job, arrays, as_json=as_json)
    spectra = {file: NoiseSpectrum.of(signal) for file, signal in signals.items()}
    for file, spectrum in spectra.items():
        if not np.isfinite(spectrum.rms):
            console.warn(f"{file}: there is nothing to hear, as nothing is drawn; its levels are those of silence")
    durations = [signal.duration for signal in signals.values()]
    if max(durations) > 1.02 * min(durations):
        console.warn(f"files last {min(durations):g} to {max(durations):g} s: levels of different motions are compared")
    first = spectra[files[0]]
    rows = [
        {
            "path": str(file),
            "duration": signals[file].duration,
            **spectrum.levels(),
            "difference": level_differences(spectrum, first),
        }
        for file, spectrum in spectra.items()
    ]
    if waves:
        write_wave_files({waves[file]: signal for file, signal in signals.items()}, overwrite=job.overwrite)
    if job.out is not None:
        stems = [file.stem for file in signals]
        label = {file: str(file) if stems.count(file.stem) > 1 else file.stem for file in signals}
        draw_noise({label[file]: signal for file, signal in signals.items()}, job.out)
    written = {
        "wav": [str(path) for path in waves.values()] or None,
        "picture": None if job.out is None else str(job.out),
    }
    supposed = TransducerSet([placed.model for placed in arrays]).supposed
    if as_json:
        chosen = {
            name: getattr(job, name)
            for name in ("array", "sampling", "speed", "update_rate", "slew", "source", "sources", "pole", "microphone")
        }
        values = {"files": rows, **written, "supposed": supposed, "options": chosen}
        console.show_values(values, as_json=True, title="")
        return
    for row in rows:
        found = {words_of(name).removeprefix("noise, "): value for name, value in row["difference"].items()}
        difference = {name: f"{value:+.2f}" for name, value in found.items()} if row is not rows[0] else None
        console.show_values(row | {"path": None, "difference": difference}, as_json=False, title=row["path"])
    if any(value is not None for value in written.values()):
        console.show_values(written, as_json=False, title="written")
    if supposed is not None:
        print_message(supposed, "note")
    console.conclude(meaning_of(rows), as_json=False)


def meaning_of(rows: list[dict]) -> str:
    """What levels of files say, in a sentence; rows: of each file its path and differences from the first [dB]."""
    first, others = rows[0]["path"], rows[1:]
    if not others:
        return "Levels have no absolute scale: name a second file, and the difference between both means something."
    found = []
    for row in others:
        more = row["difference"]["dba"]
        if not np.isfinite(more):
            return "A file without sound has no level that could be compared."
        word = "louder" if more > 0 else "quieter"
        low = row["difference"]["db_40_300"]
        found.append(f"{row['path']} is {abs(more):.1f} dB {word} to the ear (40 to 300 Hz: {low:+.1f} dB)")
    return f"Beside {first}, {', '.join(found)}."


def _signals(job: NoiseCommand, arrays: tuple[PlacedArray, ...], *, as_json: bool) -> dict[Path, NoiseSignal]:
    require_device(job.device)
    listener = _listener([placed.model for placed in arrays], job)
    drive = DriveStrategy(slew=job.slew)
    signals: dict[Path, NoiseSignal] = {}
    for file in job.files:
        with bars.progress_bar(f"sampling {file}", quiet=as_json):
            frames = frames_of(
                file,
                arrays,
                sampling=sampling_of(job, arrays, file, frame_format(file)),
                drive=drive,
                duration=job.duration,
                device=job.device,
            )
        with bars.progress_bar(f"listening to {file}", quiet=as_json) as progress:
            signals[file] = listener.listen(frames, progress)
    return signals


def _listener(arrays: list[ArrayModel], job: NoiseCommand) -> NoiseListener:
    model = NoiseModel(
        kind=job.source,
        resonance=Resonance(pole=job.pole),
        sources=job.sources,
        microphone=job.microphone,
    )
    return NoiseListener(arrays, model, device=job.device)


def _wave_files(job: NoiseCommand) -> dict[Path, Path]:
    """Where each file's sound goes; empty if none is asked for."""
    files = job.files
    if len({file.resolve() for file in files}) != len(files):
        raise StrategyError(f"{', '.join(map(str, files))}: a file is named twice")
    waves = {file: file.with_suffix(".wav") for file in files} if job.wav else {}
    if len(set(waves.values())) != len(waves):
        raise StrategyError(f"{', '.join(map(str, files))}: two files would have one WAV; rename one")
    for path in waves.values():
        require_wave_file(path, overwrite=job.overwrite, sources=files)
    return waves
