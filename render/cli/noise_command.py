"""What `palpate noise` does."""

from pathlib import Path

import numpy as np

from ...datasets.errors import ContourFileError, name_nothing
from ...datasets.focus_files.frame_reader import frame_format
from ...datasets.known_names import likely_file
from ...device.array import ArrayModel
from ..acoustics.noise import NoiseListener, NoiseModel
from ..acoustics.prediction import frames_of
from ..acoustics.spectrum import NoiseSignal, NoiseSpectrum, level_differences
from ..acoustics.transducers import Resonance, TransducerSet
from ..acoustics.wave_files import require_wave_file, write_wave_files
from ..errors import StrategyError
from ..file_kinds import is_point_list
from ..playback.drive import DriveStrategy
from ..playback.placed_arrays import PlacedArray, load_rig
from ..reports.noise_figure import draw_noise
from ..reports.picture_style import require_picture
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from ..terminal.value_words import words_of
from ..validation import choose, refuse_object
from .play_commands import require_device, sampling_of

KINDS = ("beam", "transducers")


def run_noise(files: list[Path], options: dict, *, as_json: bool) -> None:
    """Predict, compare with the first file, and write what is asked for."""
    waves = _wave_files(files, options)
    out = options["out"]
    if out is not None:
        require_picture(out, overwrite=options["overwrite"], sources=files)
    arrays = load_rig(options["array"], calibration=options["calibration"])
    signals = _signals(files, arrays, options, as_json=as_json)
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
        write_wave_files({waves[file]: signal for file, signal in signals.items()}, overwrite=options["overwrite"])
    if options["out"] is not None:
        stems = [file.stem for file in signals]
        label = {file: str(file) if stems.count(file.stem) > 1 else file.stem for file in signals}
        draw_noise({label[file]: signal for file, signal in signals.items()}, options["out"])
    written = {
        "wav": [str(path) for path in waves.values()] or None,
        "picture": None if options["out"] is None else str(options["out"]),
    }
    supposed = TransducerSet([placed.model for placed in arrays]).supposed
    if as_json:
        chosen = {
            name: options[name]
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


def _signals(
    files: list[Path], arrays: tuple[PlacedArray, ...], options: dict, *, as_json: bool
) -> dict[Path, NoiseSignal]:
    require_device(options["device"])
    listener = _listener([placed.model for placed in arrays], options)
    drive = DriveStrategy(slew=options["slew"])
    signals: dict[Path, NoiseSignal] = {}
    for file in files:
        with bars.loading_bar(f"sampling {file}", quiet=as_json):
            frames = frames_of(
                file,
                arrays,
                sampling=sampling_of(options, arrays, file, frame_format(file)),
                drive=drive,
                duration=options["duration"],
                device=options["device"],
            )
        with bars.progress_bar(f"listening to {file}", quiet=as_json) as progress:
            signals[file] = listener.listen(frames, progress)
    return signals


def _listener(arrays: list[ArrayModel], options: dict) -> NoiseListener:
    model = NoiseModel(
        kind=choose("source", options["source"], KINDS),
        resonance=Resonance(pole=options["pole"]),
        sources=options["sources"],
        microphone=options["microphone"],
    )
    return NoiseListener(arrays, model, device=options["device"])


def _wave_files(files: list[Path], options: dict) -> dict[Path, Path]:
    """Where each file's sound goes; empty if none is asked for."""
    for file in files:
        if not is_point_list(file):
            refuse_object(file)
        if not file.exists():
            raise name_nothing(ContourFileError(f"{file} does not exist{likely_file(file)}"))
    if len({file.resolve() for file in files}) != len(files):
        raise StrategyError(f"{', '.join(map(str, files))}: a file is named twice")
    waves = {file: file.with_suffix(".wav") for file in files} if options["wav"] else {}
    if len(set(waves.values())) != len(waves):
        raise StrategyError(f"{', '.join(map(str, files))}: two files would have one WAV; rename one")
    for path in waves.values():
        require_wave_file(path, overwrite=options["overwrite"], sources=files)
    return waves
